//! Selection of frames, start of output files, and comments on frames.

use cobscope_decoder::capture::{BusNames, Notice};
use cobscope_decoder::decoder::Decoder;
use cobscope_decoder::event::{Event, FrameRange, KindSet};
use cobscope_decoder::frame::{Frame, Timestamp};
use cobscope_decoder::query::Filter;
use cobscope_decoder::session::{Bus, BusSnapshot, NoObserver, Observer, SessionOptions};

use super::arguments::ConvertArgs;
use crate::run::arguments::NodeArg;
use crate::run::frame_comment::add_event;
use crate::select::{BoundSide, RangeBound, Span, ensure_order, plain_event};

/// Decision on a frame.
#[derive(Debug, Clone, Copy, Default)]
pub(super) struct FrameDecision {
    /// Whether to write the frame.
    pub(super) takes: bool,
    /// Whether to start a new file with this frame or the next one written.
    pub(super) splits: bool,
}

/// Selection of frames by the command line.
pub(super) struct FrameChoice {
    from: Option<RangeBound>,
    to: Option<RangeBound>,
    first: Option<Timestamp>,
    /// Whether no later frame can be selected.
    is_over: bool,
    /// `None` if frames need not be decoded.
    reading: Option<ChoiceReading>,
    /// State before the first frame of the range.
    start: RangeStart,
}

/// State before the first frame of the range.
enum RangeStart {
    NotNeeded,
    Pending,
    Known(Box<BusSnapshot>),
}

struct ChoiceReading {
    decoder: Decoder,
    filter: Option<Filter>,
    nodes: Vec<NodeArg>,
    split_at: Option<Filter>,
    own_kinds: KindSet,
    /// Comment on the frame; `None` without `--comments`.
    comment: Option<String>,
}

impl FrameChoice {
    pub(super) fn new(arguments: &ConvertArgs, options: SessionOptions) -> Self {
        let ConvertArgs { filter, only_node, split_at, comments, from, to, bus_file, .. } = arguments;
        let start = if bus_file.is_some() { RangeStart::Pending } else { RangeStart::NotNeeded };
        let understands = filter.is_some()
            || !only_node.is_empty()
            || split_at.is_some()
            || *comments
            || bus_file.is_some();
        let reading = understands.then(|| ChoiceReading {
            decoder: Decoder::new(options),
            filter: filter.clone(),
            nodes: only_node.clone(),
            split_at: split_at.clone(),
            own_kinds: KindSet::of_frames(),
            comment: comments.then(String::new),
        });
        Self { from: *from, to: *to, first: None, is_over: false, reading, start }
    }

    /// Called with the first frame of all captures.
    ///
    /// # Errors
    /// If a selection by time is requested and the captures have no timestamps.
    pub(super) fn begin(&mut self, first: &Frame, span: Span<'_>) -> anyhow::Result<()> {
        self.first = first.time;
        self.from = self.from.map(|from| from.resolve_bound(BoundSide::From, first, span)).transpose()?;
        self.to = self.to.map(|to| to.resolve_bound(BoundSide::To, first, span)).transpose()?;
        ensure_order(self.from, self.to)
    }

    /// Whether no later frame can be selected. Only frame numbers decide, because timestamps can step back.
    pub(super) fn is_over(&self) -> bool {
        self.is_over
    }

    /// Comment on the last frame.
    pub(super) fn frame_comment(&self) -> &str {
        self.reading.as_ref().and_then(|reading| reading.comment.as_deref()).unwrap_or_default()
    }

    /// State before the first frame of the range; `None` before that frame, or if it was not requested.
    pub(super) fn take_start(&mut self) -> Option<BusSnapshot> {
        match std::mem::replace(&mut self.start, RangeStart::NotNeeded) {
            RangeStart::Known(state) => Some(*state),
            RangeStart::NotNeeded | RangeStart::Pending => None,
        }
    }

    pub(super) fn on_notice(&mut self, notice: &Notice, names: &BusNames) {
        if let Some(reading) = &mut self.reading {
            reading.decoder.on_notice(notice, names, &mut NoObserver);
        }
    }

    #[inline]
    pub(super) fn judge_frame(&mut self, frame: &Frame, names: &BusNames) -> FrameDecision {
        let is_early = self.from.is_some_and(|from| from.is_behind(frame, self.first));
        if matches!(self.start, RangeStart::Pending) && !is_early {
            let buses = self.reading.as_ref().map(|reading| reading.decoder.buses());
            self.start = RangeStart::Known(Box::new(BusSnapshot::snapshot_of(buses.unwrap_or_default())));
        }
        let read = self.reading.as_mut().map_or(FrameDecision { takes: true, splits: false }, |reading| {
            reading.judge_frame(frame, names)
        });
        if self.from.is_none() && self.to.is_none() {
            return read;
        }
        let is_late = self.to.is_some_and(|to| to.is_before(frame, self.first));
        self.is_over = is_late && matches!(self.to, Some(RangeBound::Frame(_)));
        FrameDecision { takes: read.takes && !is_early && !is_late, ..read }
    }
}

impl ChoiceReading {
    fn judge_frame(&mut self, frame: &Frame, names: &BusNames) -> FrameDecision {
        let Self { decoder, filter, nodes, split_at, own_kinds, comment } = self;
        if let Some(comment) = comment {
            comment.clear();
        }
        let mut look = FrameEvents {
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
            return FrameDecision { takes: true, splits };
        };
        let is_own = |arg: &NodeArg| arg.bus.as_deref().is_none_or(|name| name == bus.name());
        let is_of_node =
            nodes.is_empty() || nodes.iter().any(|arg| is_own(arg) && bus.concerns_node(frame, arg.id));
        let passes = filter.as_ref().is_none_or(|filter| {
            own.unwrap_or_else(|| {
                let plain = plain_event(frame, bus.node_of(frame));
                filter.matches_frame(&plain, &plain, bus)
            })
        });
        FrameDecision { takes: is_of_node && passes, splits }
    }
}

/// Observer for the events of one frame.
struct FrameEvents<'a> {
    frame: &'a Frame,
    filter: Option<&'a Filter>,
    split_at: Option<&'a Filter>,
    own_kinds: KindSet,
    /// Whether the message of the frame passes the filter; `None` before its event.
    own: Option<bool>,
    splits: bool,
    comment: Option<&'a mut String>,
}

impl Observer for FrameEvents<'_> {
    fn on_event(&mut self, event: &Event, bus: &Bus) {
        let FrameRange { first, last } = event.frames;
        let is_own = first == self.frame.number && last == first && self.own_kinds.contains(&event.kind);
        if let Some(filter) = self.filter.filter(|_| is_own && self.own.is_none()) {
            self.own = Some(filter.matches_frame(event, &plain_event(self.frame, event.node), bus));
        }
        self.splits |= self.split_at.is_some_and(|filter| filter.matches_event(event, bus, None));
        if let Some(comment) = &mut self.comment {
            add_event(comment, event, bus);
        }
    }
}
