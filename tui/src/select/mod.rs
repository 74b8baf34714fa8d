//! Selection of the printed events: `--filter`, `--from`, `--to`, `--only-node`. The session still receives
//! every frame: later frames can complete or time out earlier transfers, and timestamps can step back.

mod bound;
mod clock;
mod limit;

use std::cmp::Ordering;

use cobscope_decoder::event::{Event, EventKind, EventProtocol, KindSet};
use cobscope_decoder::finding::{FindingGroup, Occurrence};
use cobscope_decoder::frame::{Frame, Timestamp};
use cobscope_decoder::query::Filter;
use cobscope_decoder::session::Bus;
use cobscope_decoder::why::NodeChoice;
use cobscope_decoder::wire::NodeId;

pub use bound::{RangeBound, Span, ensure_order};
pub use clock::{BoundSide, spans_days, wall_clock};
use cobscope_decoder::figures::format_seconds;
pub use limit::TimeLimit;

/// Selected nodes; all if empty.
#[derive(Debug, Default)]
pub struct SelectedNodes(Vec<SelectedNode>);

#[derive(Debug)]
struct SelectedNode {
    choice: NodeChoice,
    /// Matches events with the node as receiver.
    receives: Option<Filter>,
}

impl SelectedNodes {
    /// Selects nodes.
    pub fn new(nodes: Vec<NodeChoice>) -> Self {
        let selected = |choice: NodeChoice| {
            let receives = match choice.node {
                NodeId::Canopen(_) => None,
                NodeId::J1939(address) => format!("destination_address == {address}").parse().ok(),
            };
            SelectedNode { choice, receives }
        };
        Self(nodes.into_iter().map(selected).collect())
    }

    /// Whether an event concerns a selected node: as for frames, with SYNC, TIME and NMT commands to all
    /// CANopen nodes. Notices on the capture concern every node.
    pub fn note_event(&self, event: &Event, bus: &Bus) -> bool {
        self.0.is_empty() || self.0.iter().any(|node| node.admits_event(event, bus))
    }

    /// Whether a frame is sent or received by a selected node.
    pub fn admit_frame(&self, frame: &Frame, bus: &Bus) -> bool {
        let is_of = |node: &SelectedNode| node.is_on(bus) && bus.concerns_node(frame, node.choice.node);
        self.0.is_empty() || self.0.iter().any(is_of)
    }
}

impl SelectedNode {
    fn is_on(&self, bus: &Bus) -> bool {
        self.choice.bus.as_deref().is_none_or(|name| name == bus.name())
    }

    fn admits_event(&self, event: &Event, bus: &Bus) -> bool {
        if event.protocol == EventProtocol::Capture {
            return true;
        }
        let is_to_all = matches!(
            event.kind,
            EventKind::NmtCommand { target: 0, .. } | EventKind::Sync { .. } | EventKind::Time { .. }
        );
        let is_canopen = self.choice.node.canopen().is_some();
        let is_target = match event.kind {
            EventKind::NmtCommand { target, .. } => self.choice.node.canopen() == Some(target),
            _ => false,
        };
        let receives = || self.receives.as_ref().is_some_and(|filter| filter.matches_event(event, bus, None));
        self.is_on(bus)
            && (event.node == Some(self.choice.node) || is_target || (is_to_all && is_canopen) || receives())
    }
}

/// Event for a frame without its meaning.
pub fn plain_event(frame: &Frame, node: Option<NodeId>) -> Event {
    let protocol = match node {
        Some(NodeId::Canopen(_)) => EventProtocol::Canopen,
        Some(NodeId::J1939(_)) => EventProtocol::J1939,
        None => EventProtocol::Can,
    };
    let mut event = Event::undecoded(frame);
    (event.protocol, event.node) = (protocol, node);
    event
}

/// The selection of one command, applied to one capture after the other.
#[derive(Debug, Default)]
pub struct Selection {
    filter: Option<Filter>,
    nodes: SelectedNodes,
    /// Bounds as typed.
    wanted: (Option<RangeBound>, Option<RangeBound>),
    /// Bounds in the current capture.
    from: Option<RangeBound>,
    to: Option<RangeBound>,
    capture: Option<String>,
    first: Option<Timestamp>,
    /// An event at or after `from` was found.
    is_reached: bool,
    /// The current frame, and whether its own message passes the filter.
    own: Option<(Frame, Option<bool>)>,
}

impl Selection {
    /// # Errors
    /// `from` is after `to`.
    pub fn new(
        filter: Option<Filter>,
        (from, to): (Option<RangeBound>, Option<RangeBound>),
        nodes: Vec<NodeChoice>,
    ) -> anyhow::Result<Self> {
        ensure_order(from, to)?;
        let nodes = SelectedNodes::new(nodes);
        Ok(Self { filter, nodes, wanted: (from, to), from, to, ..Self::default() })
    }

    /// Whether there is a filter or a selected node.
    pub fn has_filter(&self) -> bool {
        self.filter.is_some() || !self.nodes.0.is_empty()
    }

    /// Whether there is a filter, a selected node or a limit of time.
    #[inline]
    pub fn is_limited(&self) -> bool {
        self.from.is_some() || self.to.is_some() || self.has_filter()
    }

    /// Starts a capture with this name.
    pub fn set_capture(&mut self, name: &str) {
        self.capture = Some(name.to_owned());
        self.first = None;
        self.is_reached = false;
    }

    /// Takes the first frame of the capture, and its span of time for wall-clock times.
    ///
    /// # Errors
    /// A time is requested and the capture has no timestamps, or a wall-clock time is ambiguous.
    pub fn begin_capture(&mut self, first: &Frame, span: Span<'_>) -> anyhow::Result<()> {
        self.first = first.time;
        let (from, to) = self.wanted;
        self.from = from.map(|bound| bound.resolve_bound(BoundSide::From, first, span)).transpose()?;
        self.to = to.map(|bound| bound.resolve_bound(BoundSide::To, first, span)).transpose()?;
        ensure_order(self.from, self.to)
    }

    /// Start of the range in the current capture.
    pub fn from(&self) -> Option<RangeBound> {
        self.from
    }

    /// End of the range in the current capture.
    pub fn range_end(&self) -> Option<RangeBound> {
        self.to
    }

    /// Message for a capture that ends before `from`; `frame` and `last` belong to its last frame.
    pub fn missed_text(&self, frame: u64, last: Option<Timestamp>) -> Option<String> {
        let from = self.from.filter(|_| !self.is_reached)?;
        let at = match (from, last, self.first) {
            (RangeBound::Moment(_), Some(last), _) => jiff::Timestamp::from_nanosecond(last.0.into())
                .map_or(String::new(), |at| format!(" at {at}")),
            (_, Some(last), Some(first)) => format!(" at {} s", format_seconds(last.since(first))),
            _ => String::new(),
        };
        Some(format!("--from is after the last frame, #{frame}{at}"))
    }

    /// Whether an event is printed, by its last frame or its own time; a missed deadline has the time of the
    /// deadline. An event without a time is before every time.
    #[inline]
    pub fn admits_event(&mut self, event: &Event, bus: &Bus) -> bool {
        if !self.is_limited() {
            self.is_reached = true;
            return true;
        }
        self.admits_limited(event, bus)
    }

    fn admits_limited(&mut self, event: &Event, bus: &Bus) -> bool {
        let is_late_enough =
            self.from.is_none_or(|from| self.compare_bound(event, from).is_some_and(Ordering::is_ge));
        self.is_reached |= is_late_enough;
        let is_early_enough =
            self.to.is_none_or(|to| self.compare_bound(event, to).is_none_or(Ordering::is_le));
        is_late_enough && is_early_enough && self.admits_content(event, bus)
    }

    /// Whether an event passes the filter and concerns a selected node, at any time.
    pub fn admits_content(&self, event: &Event, bus: &Bus) -> bool {
        self.nodes.note_event(event, bus)
            && self
                .filter
                .as_ref()
                .is_none_or(|filter| filter.matches_event(event, bus, self.capture.as_deref()))
    }

    /// Whether a frame is in the range.
    #[inline]
    pub fn admits_frame(&mut self, frame: &Frame) -> bool {
        if self.from.is_none() && self.to.is_none() {
            self.is_reached = true;
            return true;
        }
        let is_late_enough = !self.from.is_some_and(|from| from.is_behind(frame, self.first));
        self.is_reached |= is_late_enough;
        is_late_enough && !self.to.is_some_and(|to| to.is_before(frame, self.first))
    }

    /// Whether a frame is after the end of the range.
    pub fn is_over(&self, frame: &Frame) -> bool {
        self.to.is_some_and(|to| to.is_before(frame, self.first))
    }

    /// Starts a frame whose own message decides, together with its node, whether it is selected.
    pub fn begin_frame(&mut self, frame: &Frame) {
        self.own = Some((*frame, None));
    }

    /// Takes an event, which may be the message of the current frame.
    pub fn on_event(&mut self, event: &Event, bus: &Bus) {
        let (Some(filter), Some((frame, own))) = (&self.filter, &mut self.own) else { return };
        let is_own = (event.frames.first, event.frames.last) == (frame.number, frame.number)
            && KindSet::of_frames().contains(&event.kind);
        if is_own && own.is_none() {
            *own = Some(filter.matches_frame(event, &plain_event(frame, event.node), bus));
        }
    }

    /// Whether the current frame passes the filter and concerns a selected node. `bus` is in the state after
    /// the frame.
    pub fn admits_decoded(&self, bus: &Bus) -> bool {
        let Some((frame, own)) = &self.own else { return true };
        let passes = self.filter.as_ref().is_none_or(|filter| {
            own.unwrap_or_else(|| {
                let plain = plain_event(frame, bus.node_of(frame));
                filter.matches_frame(&plain, &plain, bus)
            })
        });
        passes && self.nodes.admit_frame(frame, bus)
    }

    /// Whether any part of a finding is in the range: an occurrence, or the duration of a condition. If not
    /// all occurrences are recorded, everything from the first to the last one counts.
    pub fn overlaps_finding(&mut self, group: &FindingGroup) -> bool {
        let recorded = (group.first.len() + group.last.len()) as u64;
        let is_range = group.lasted.is_some() || group.count > recorded;
        let is_in = if is_range {
            let began = group.first_occurrence();
            let lasted = group.lasted.unwrap_or(0);
            let end = began.time.map(|time| time.plus(lasted)).max(group.last_occurrence().time);
            let ended = Occurrence { time: end, ..group.last_occurrence() };
            (group.lasts_to_end || self.is_from_reached(ended)) && self.is_before_to(began)
        } else {
            let mut all = group.first.iter().chain(&group.last);
            all.any(|at| self.is_from_reached(*at) && self.is_before_to(*at))
        };
        self.is_reached |= is_in;
        is_in
    }

    fn is_from_reached(&self, at: Occurrence) -> bool {
        self.from.is_none_or(|from| self.order_of(at.frames.last, at.time, from).is_some_and(Ordering::is_ge))
    }

    fn is_before_to(&self, at: Occurrence) -> bool {
        self.to.is_none_or(|to| self.order_of(at.frames.first, at.time, to).is_none_or(Ordering::is_le))
    }

    /// Order of an event and a bound; None for an event without a time.
    fn compare_bound(&self, event: &Event, bound: RangeBound) -> Option<Ordering> {
        self.order_of(event.frames.last, event.time, bound)
    }

    fn order_of(&self, frame: u64, time: Option<Timestamp>, bound: RangeBound) -> Option<Ordering> {
        match bound {
            RangeBound::Frame(number) => Some(frame.cmp(&number)),
            RangeBound::Moment(moment) => Some(time?.cmp(&moment)),
            RangeBound::Offset(offset) => Some(time?.since(self.first?).cmp(&offset)),
            RangeBound::Clock(_) => None,
        }
    }
}
