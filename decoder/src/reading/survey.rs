//! Overview of a capture for a display: transfers, errors, findings as they open, NMT, load, kinds of events.

use std::ops::Deref;

use super::part::{FrameDemand, ReadingPart};
use crate::capture::BusNames;
use crate::event::{Event, EventKind, FindingNews, FrameRange, Kind, TransferFigures, TransferOutcome};
use crate::frame::{BusIndex, Frame, Timestamp};
use crate::query::{kind_filter, subject_filter};
use crate::replay::{EventPosition, PlacedEvent};
use crate::session::{Bus, Buses};
use crate::sink::escape;
use crate::sink::text::{EventLine, LineTone, TransferWords};
use crate::statistics::{LoadOverTime, Statistics};
use crate::wire::NodeId;

/// Maximum number of transfers kept; later ones are only counted.
pub const MOST_TRANSFERS: usize = 50_000;

/// Maximum number of error positions kept.
pub const MOST_ERRORS: usize = 200_000;

/// Maximum number of times of NMT kept.
pub const MOST_NMT: usize = 100_000;

/// Maximum number of opened findings kept.
pub const MOST_OPENED: usize = 10_000;

/// Procedure that changes the bit rate of a bus.
const BIT_RATE_CHANGE: &str = "bit-rate change";

/// The first items of a list, and the number of all further ones.
#[derive(Debug, Clone)]
pub struct BoundedList<T, const MOST: usize> {
    items: Vec<T>,
    /// Items kept so far, those that were moved included.
    kept: usize,
    /// Items beyond those kept.
    pub more: u64,
}

impl<T, const MOST: usize> Default for BoundedList<T, MOST> {
    fn default() -> Self {
        Self { items: Vec::new(), kept: 0, more: 0 }
    }
}

impl<T, const MOST: usize> Deref for BoundedList<T, MOST> {
    type Target = [T];

    fn deref(&self) -> &[T] {
        &self.items
    }
}

impl<T, const MOST: usize> BoundedList<T, MOST> {
    /// Adds an item, or counts it if the list is full.
    pub fn push(&mut self, item: T) {
        if self.kept < MOST {
            self.kept += 1;
            self.items.push(item);
        } else {
            self.more = self.more.saturating_add(1);
        }
    }

    /// Number of all items.
    pub fn total(&self) -> u64 {
        self.more.saturating_add(self.kept as u64)
    }

    /// Moves the items since the last call to the end of another list.
    pub fn move_to(&mut self, list: &mut Self) {
        list.items.append(&mut self.items);
        (list.kept, list.more) = (self.kept, self.more);
    }
}

/// Overview of a capture so far, in bounded memory.
#[derive(Debug, Clone, Default)]
pub struct Survey {
    /// Statistics of the buses.
    pub statistics: Statistics,
    /// Load of each bus over time.
    pub load: Vec<LoadOverTime>,
    /// Number of events of each kind, in the order of `Kind::ALL`.
    pub kinds: Vec<u64>,
    /// SDO transfers, J1939 transport sessions and UDS exchanges in order of their end.
    pub transfers: BoundedList<TransferRow, MOST_TRANSFERS>,
    /// Positions of error events, in order.
    pub errors: BoundedList<EventPosition, MOST_ERRORS>,
    /// NMT commands, changes of NMT states, and boot-ups, in order.
    pub nmt: BoundedList<NmtMoment, MOST_NMT>,
    /// Findings in the order in which they opened.
    pub opened: BoundedList<OpenedFinding, MOST_OPENED>,
    /// Bus name and text of the last announced change of the bit rate.
    pub bit_rate_change: Option<(String, String)>,
}

/// Time of an NMT event.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct NmtMoment {
    /// Time of the event.
    pub time: Timestamp,
    /// Bus of the event.
    pub bus: BusIndex,
    /// Node of the event.
    pub node: Option<NodeId>,
    /// The NMT state of the node changed.
    pub is_change: bool,
}

/// A finding at the time it opened.
#[derive(Debug, Clone)]
pub struct OpenedFinding {
    /// Position of the event.
    pub spot: EventPosition,
    /// Time of the event.
    pub time: Option<Timestamp>,
    /// Bus of the finding.
    pub bus: BusIndex,
    /// Node of the finding.
    pub node: Option<NodeId>,
    /// Rule, severity and text.
    pub news: FindingNews,
}

/// A transfer of several messages; its texts are escaped.
#[derive(Debug, Clone)]
pub struct TransferRow {
    /// Position of its end.
    pub spot: EventPosition,
    /// Time of its end.
    pub time: Option<Timestamp>,
    /// First and last frame.
    pub frames: FrameRange,
    /// Bus of the transfer.
    pub bus: BusIndex,
    /// Client → server, or source → destination.
    pub who: Box<str>,
    /// Node of the transfer.
    pub node: Option<NodeId>,
    /// Kind in at most six characters.
    pub kind: &'static str,
    /// Event kind as in filters.
    pub event_kind: Kind,
    /// Filter for the kind as it is shown.
    pub kind_filter: Box<str>,
    /// Filter for the object, PGN or service, if it has one.
    pub subject: Option<Box<str>>,
    /// Object or service, and result.
    pub what: Box<str>,
    /// The same for a row: value or failure before the name of the object.
    pub news: Box<str>,
    /// Time from the first to the last frame, in ns.
    pub duration: Option<i64>,
    /// Number of bytes transferred.
    pub size: u64,
    /// Outcome as in filters.
    pub outcome: TransferOutcome,
    /// Tone that decides the colour.
    pub tone: LineTone,
}

impl TransferRow {
    /// The transfer of an event; `None` for other events.
    pub fn of(placed: &PlacedEvent<'_>) -> Option<Self> {
        let (event, bus) = (placed.event, placed.bus);
        let TransferFigures { duration, size, outcome } = event.transfer_figures()?;
        let line = EventLine::describe_event(event, bus);
        let news = TransferWords::of_event(event, bus)
            .map_or_else(|| line.what.clone(), |words| words.joined_text());
        Some(Self {
            spot: placed.spot,
            time: event.time,
            frames: event.frames,
            bus: event.bus,
            who: escape(&line.who).into(),
            node: event.node,
            kind: line.kind,
            event_kind: event.kind.kind(),
            kind_filter: kind_filter(event).into(),
            subject: subject_filter(event, bus).map(Into::into),
            what: escape(&line.what).into(),
            news: escape(&news).into(),
            duration,
            size,
            outcome,
            tone: line.tone,
        })
    }
}

impl NmtMoment {
    /// The time of an NMT command, an NMT state or a boot-up; `None` for other events.
    pub fn of(event: &Event) -> Option<Self> {
        let is_change = match &event.kind {
            EventKind::NmtState(state) => state.from != Some(state.to),
            EventKind::NmtCommand { .. } | EventKind::BootUp { .. } => false,
            _ => return None,
        };
        Some(Self { time: event.time?, bus: event.bus, node: event.node, is_change })
    }
}

/// Text of an announced change of the bit rate.
pub fn bit_rate_change(event: &Event) -> Option<&str> {
    match &event.kind {
        EventKind::Procedure(procedure) if procedure.procedure == BIT_RATE_CHANGE => Some(&procedure.text),
        _ => None,
    }
}

impl Survey {
    /// Brings another survey up to date, which shows this one: moves the items since the last call.
    pub fn publish(&mut self, shown: &mut Self) {
        self.transfers.move_to(&mut shown.transfers);
        self.errors.move_to(&mut shown.errors);
        self.nmt.move_to(&mut shown.nmt);
        self.opened.move_to(&mut shown.opened);
        shown.kinds.clone_from(&self.kinds);
        shown.load.clone_from(&self.load);
        shown.statistics.clone_from(&self.statistics);
        shown.bit_rate_change.clone_from(&self.bit_rate_change);
    }
}

impl ReadingPart for Survey {
    fn event(&mut self, event: &Event, bus: &Bus) {
        self.statistics.count_event(event);
        let kind = event.kind.kind() as usize;
        if self.kinds.len() <= kind {
            self.kinds.resize(Kind::ALL.len(), 0);
        }
        if let Some(count) = self.kinds.get_mut(kind) {
            *count += 1;
        }
        if let Some(change) = bit_rate_change(event) {
            self.bit_rate_change = Some((escape(bus.name()).into_owned(), escape(change).into_owned()));
        }
        if let Some(moment) = NmtMoment::of(event) {
            self.nmt.push(moment);
        }
    }

    fn finding(&mut self, _event: &Event, _bus: &Bus) {}

    fn placed(&mut self, placed: &PlacedEvent<'_>) {
        self.event(placed.event, placed.bus);
        if placed.event.is_error() {
            self.errors.push(placed.spot);
        }
        if let Some(transfer) = TransferRow::of(placed) {
            self.transfers.push(transfer);
        }
    }

    fn placed_finding(&mut self, placed: &PlacedEvent<'_>) {
        let event = placed.event;
        if let EventKind::FindingOpened(news) = &event.kind {
            let (time, bus, node, news) = (event.time, event.bus, event.node, (**news).clone());
            self.opened.push(OpenedFinding { spot: placed.spot, time, bus, node, news });
        }
    }

    fn demand(&self) -> FrameDemand {
        FrameDemand::Batches
    }

    fn frame(&mut self, frame: &Frame, _names: &BusNames) {
        self.statistics.count_frame(frame);
        let bus = usize::from(frame.bus.0);
        if self.load.len() <= bus {
            self.load.resize_with(bus.saturating_add(1), LoadOverTime::default);
        }
        if let Some(load) = self.load.get_mut(bus) {
            load.count_frame(frame);
        }
    }

    fn finish(&mut self, buses: Buses<'_>) {
        self.statistics.withdraw_canopen(buses);
    }
}
