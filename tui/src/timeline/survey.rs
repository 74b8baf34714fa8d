//! Results about the whole capture: findings, transfers, errors, load. Filled by
//! [`threads::survey`](super::threads::survey).

use cobscope_decoder::diagnosis::Diagnosis;
use cobscope_decoder::event::{Event, EventKind, FindingNews, FrameRange, Kind, TransferOutcome};
use cobscope_decoder::finding::Findings;
use cobscope_decoder::frame::{BusIndex, Timestamp};
use cobscope_decoder::profile::device::Severity;
use cobscope_decoder::replay::EventPosition;
use cobscope_decoder::sink::text::Tone;
use cobscope_decoder::statistics::{LoadOverTime, Statistics};
use cobscope_decoder::wire::NodeId;

/// Maximum number of transfers kept; later ones are only counted.
pub const MOST_EXCHANGES: usize = 50_000;

/// Maximum number of error positions kept.
pub const MOST_ERRORS: usize = 200_000;

/// Maximum number of times of NMT kept.
pub(super) const MOST_NMT: usize = 100_000;

/// Maximum number of findings kept until the groups are known.
pub(super) const MOST_NEWS: usize = 10_000;

/// Procedure that changes the bit rate of a bus.
const BIT_RATE_CHANGE: &str = "bit-rate change";

/// Results about the whole capture so far.
#[derive(Default)]
pub struct Survey {
    /// Number of frames surveyed.
    pub frames: u64,
    /// Whether these are all frames.
    pub is_complete: bool,
    /// Findings in the order in which they opened.
    pub news: Vec<OpenedFinding>,
    /// Findings in groups; None until the end.
    pub findings: Option<Findings>,
    /// Stories of the findings so far; None before the first one.
    pub diagnosis: Option<Diagnosis>,
    /// Number of errors and warnings in the diagnosis.
    pub diagnosed: (usize, usize),
    /// Number of diagnoses so far; a new number means that lines may have changed.
    pub revision: u64,
    /// Positions of the kept occurrences of findings, in order.
    pub places: Vec<FindingOccurrence>,
    /// SDO transfers, J1939 transport sessions and UDS exchanges.
    pub exchanges: Vec<Exchange>,
    /// Number of transfers beyond those kept.
    pub more_exchanges: u64,
    /// Positions of error events.
    pub errors: Vec<EventPosition>,
    /// Number of events of each kind, in the order of `Kind::ALL`.
    pub kinds: Vec<u64>,
    /// NMT commands, changes of NMT states, and boot-ups, in order.
    pub nmt: Vec<NmtMoment>,
    /// Load of each bus over time.
    pub load: Vec<LoadOverTime>,
    /// Statistics so far.
    pub statistics: Statistics,
    /// Names of all buses, including those without frames; not escaped. Empty until the end.
    pub buses: Vec<String>,
    /// Bus name and text of the last announced change of the bit rate.
    pub bit_rate_change: Option<(String, String)>,
}

impl Survey {
    /// Replaces the stories and the numbers of errors and warnings.
    pub(super) fn set_diagnosis(&mut self, (diagnosis, diagnosed): (Diagnosis, (usize, usize))) {
        self.diagnosis = Some(diagnosis);
        self.diagnosed = diagnosed;
        self.revision += 1;
    }
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

/// An occurrence of a finding.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct FindingOccurrence {
    /// Frame of evidence.
    pub frame: u64,
    /// Time of the frame.
    pub time: Option<Timestamp>,
    /// Id of the finding.
    pub id: u64,
    /// Severity of the finding.
    pub severity: Severity,
}

/// A transfer of several messages.
#[derive(Debug, Clone)]
pub struct Exchange {
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
    pub tone: Tone,
}

/// The time of an NMT command, an NMT state or a boot-up; None for other events.
pub(super) fn nmt_moment(event: &Event) -> Option<NmtMoment> {
    let is_change = match &event.kind {
        EventKind::NmtState(state) => state.from != Some(state.to),
        EventKind::NmtCommand { .. } | EventKind::BootUp { .. } => false,
        _ => return None,
    };
    Some(NmtMoment { time: event.time?, bus: event.bus, node: event.node, is_change })
}

/// Text of an announced change of the bit rate.
pub fn bit_rate_change(event: &Event) -> Option<&str> {
    match &event.kind {
        EventKind::Procedure(procedure) if procedure.procedure == BIT_RATE_CHANGE => Some(&procedure.text),
        _ => None,
    }
}
