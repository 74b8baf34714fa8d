//! Which frames are written, where a file begins, and what is said of a frame.

use anyhow::ensure;
use cobscope_decoder::capture::{BusNames, Notice};
use cobscope_decoder::decoder::Decoder;
use cobscope_decoder::event::{Event, EventKind, FrameRange, Protocol, Undecoded};
use cobscope_decoder::frame::{Frame, Timestamp};
use cobscope_decoder::query::{Filter, KindSet};
use cobscope_decoder::session::{Bus, Observer, SessionOptions};
use cobscope_decoder::sink::escape;
use cobscope_decoder::sink::text::Line;
use cobscope_decoder::wire::NodeId;

use crate::cli::{ConvertArgs, NodeArg};
use crate::select::Bound;

/// What is to be done with a frame.
#[derive(Debug, Clone, Copy, Default)]
pub(super) struct Verdict {
    /// It is written.
    pub(super) takes: bool,
    /// A file begins with it, or with the next one that is written.
    pub(super) splits: bool,
}

/// What the command line chooses.
pub(super) struct Choice {
    from: Option<Bound>,
    to: Option<Bound>,
    first: Option<Timestamp>,
    /// Whether frames of later numbers cannot be meant.
    is_over: bool,
    /// None where frames need not be understood.
    reading: Option<Reading>,
}

struct Reading {
    decoder: Decoder,
    filter: Option<Filter>,
    nodes: Vec<NodeArg>,
    split_at: Option<Filter>,
    own_kinds: KindSet,
    /// What is said of the frame, where comments are wanted.
    comment: Option<String>,
}

impl Choice {
    pub(super) fn new(arguments: &ConvertArgs, options: SessionOptions) -> Self {
        let ConvertArgs { filter, only_node, split_at, comments, from, to, .. } = arguments;
        let understands = filter.is_some() || !only_node.is_empty() || split_at.is_some() || *comments;
        let reading = understands.then(|| Reading {
            decoder: Decoder::new(options),
            filter: filter.clone(),
            nodes: only_node.clone(),
            split_at: split_at.clone(),
            own_kinds: KindSet::of_frames(),
            comment: comments.then(String::new),
        });
        Self { from: *from, to: *to, first: None, is_over: false, reading }
    }

    /// The first frame of all.
    ///
    /// # Errors
    /// When a time is asked for and there are none.
    pub(super) fn begin(&mut self, first: &Frame) -> anyhow::Result<()> {
        self.first = first.time;
        let wants_times =
            [self.from, self.to].iter().flatten().any(|bound| !matches!(bound, Bound::Frame(_)));
        ensure!(
            first.time.is_some() || !wants_times,
            "the frames have no times; give numbers as --from #1234"
        );
        Ok(())
    }

    /// Whether no further frame can be meant. Times may step back, numbers do not.
    pub(super) fn is_over(&self) -> bool {
        self.is_over
    }

    /// What is said of the frame that was judged last.
    pub(super) fn comment(&self) -> &str {
        self.reading.as_ref().and_then(|reading| reading.comment.as_deref()).unwrap_or_default()
    }

    pub(super) fn notice(&mut self, notice: &Notice, names: &BusNames) {
        if let Some(reading) = &mut self.reading {
            reading.decoder.notice(notice, names, &mut Nobody);
        }
    }

    #[inline]
    pub(super) fn judge(&mut self, frame: &Frame, names: &BusNames) -> Verdict {
        let read = self
            .reading
            .as_mut()
            .map_or(Verdict { takes: true, splits: false }, |reading| reading.judge(frame, names));
        if self.from.is_none() && self.to.is_none() {
            return read;
        }
        let is_early = self.from.is_some_and(|from| from.is_behind(frame, self.first));
        let is_late = self.to.is_some_and(|to| to.is_before(frame, self.first));
        self.is_over = is_late && matches!(self.to, Some(Bound::Frame(_)));
        Verdict { takes: read.takes && !is_early && !is_late, ..read }
    }
}

impl Reading {
    fn judge(&mut self, frame: &Frame, names: &BusNames) -> Verdict {
        let Self { decoder, filter, nodes, split_at, own_kinds, comment } = self;
        if let Some(comment) = comment {
            comment.clear();
        }
        let mut look = Look {
            frame,
            filter: filter.as_ref(),
            split_at: split_at.as_ref(),
            own_kinds: *own_kinds,
            own: None,
            splits: false,
            comment: comment.as_mut(),
        };
        decoder.push(frame, names, &mut look);
        let (own, splits) = (look.own, look.splits);
        let Some(bus) = decoder.buses().get(usize::from(frame.bus.0)) else {
            return Verdict { takes: true, splits };
        };
        let is_own = |arg: &NodeArg| arg.bus.as_deref().is_none_or(|name| name == bus.name());
        let is_of_node =
            nodes.is_empty() || nodes.iter().any(|arg| is_own(arg) && bus.concerns(frame, arg.id));
        let passes = filter.as_ref().is_none_or(|filter| {
            own.unwrap_or_else(|| {
                let plain = plain(frame, bus.node_of(frame));
                filter.matches_frame(&plain, &plain, bus)
            })
        });
        Verdict { takes: is_of_node && passes, splits }
    }
}

/// A frame by itself.
fn plain(frame: &Frame, node: Option<NodeId>) -> Event {
    let protocol = match node {
        Some(NodeId::Canopen(_)) => Protocol::Canopen,
        Some(NodeId::J1939(_)) => Protocol::J1939,
        None => Protocol::Can,
    };
    let mut event = Event::undecoded(frame);
    (event.protocol, event.node) = (protocol, node);
    event
}

/// What the events at a frame say of it.
struct Look<'a> {
    frame: &'a Frame,
    filter: Option<&'a Filter>,
    split_at: Option<&'a Filter>,
    own_kinds: KindSet,
    /// Whether its own message passes the filter, once there is one.
    own: Option<bool>,
    splits: bool,
    comment: Option<&'a mut String>,
}

impl Observer for Look<'_> {
    fn event(&mut self, event: &Event, bus: &Bus) {
        let FrameRange { first, last } = event.frames;
        let is_own = first == self.frame.number && last == first && self.own_kinds.contains(&event.kind);
        if let Some(filter) = self.filter.filter(|_| is_own && self.own.is_none()) {
            self.own = Some(filter.matches_frame(event, &plain(self.frame, event.node), bus));
        }
        self.splits |= self.split_at.is_some_and(|filter| filter.matches(event, bus, None));
        let says = !matches!(&event.kind, EventKind::Frame(Undecoded { name: None, message: None, .. }));
        if let Some(comment) = self.comment.as_mut().filter(|_| says) {
            let line = Line::of(event, bus);
            if !comment.is_empty() {
                comment.push('\n');
            }
            for part in
                [line.who.as_str(), line.kind, line.what.as_str()].iter().filter(|part| !part.is_empty())
            {
                if !comment.is_empty() && !comment.ends_with('\n') {
                    comment.push(' ');
                }
                comment.push_str(&escape(part));
            }
        }
    }
}

struct Nobody;

impl Observer for Nobody {
    fn event(&mut self, _event: &Event, _bus: &Bus) {}
}
