//! What a whole capture comes to: findings, exchanges, errors, load. Filled by [`threads::survey`](super::threads::survey).

use cobscope_decoder::event::{Event, EventKind, FindingNews, FrameRange};
use cobscope_decoder::finding::Findings;
use cobscope_decoder::frame::{BusIndex, Timestamp};
use cobscope_decoder::profile::device::Severity;
use cobscope_decoder::replay::Spot;
use cobscope_decoder::sink::text::Tone;
use cobscope_decoder::statistics::Statistics;
use cobscope_decoder::wire::NodeId;

use super::load::LoadOverTime;

/// Exchanges kept, the first ones.
pub const MOST_EXCHANGES: usize = 50_000;

/// Errors kept, the first ones.
pub const MOST_ERRORS: usize = 200_000;

/// Findings kept until their groups are known, the first ones.
pub(super) const MOST_NEWS: usize = 10_000;

/// The procedure that takes a bus to another bit rate.
const BIT_RATE_CHANGE: &str = "bit-rate change";

/// What is known of the capture as a whole.
#[derive(Default)]
pub struct Survey {
    /// Frames looked at.
    pub frames: u64,
    /// Whether these are all.
    pub is_complete: bool,
    /// Findings as they opened.
    pub news: Vec<Opened>,
    /// Findings in groups, at the end.
    pub findings: Option<Findings>,
    /// Where findings are: in order, each occurrence that was kept.
    pub places: Vec<Occurred>,
    /// SDO transfers, J1939 transport sessions, UDS exchanges.
    pub exchanges: Vec<Exchange>,
    /// Exchanges beyond those kept.
    pub more_exchanges: u64,
    /// Places of events that tell of an error.
    pub errors: Vec<Spot>,
    /// Load of each bus over time.
    pub load: Vec<LoadOverTime>,
    /// Figures of the whole capture so far.
    pub statistics: Statistics,
    /// Names of all buses, those without a frame too, at the end; they are not escaped.
    pub buses: Vec<String>,
    /// The last change of the bit rate that was announced on a bus: its name, and what is to come.
    pub bit_rate_change: Option<(String, String)>,
}

/// A finding when it opened.
#[derive(Debug, Clone)]
pub struct Opened {
    /// Where.
    pub spot: Spot,
    /// When.
    pub time: Option<Timestamp>,
    /// Bus it is about.
    pub bus: BusIndex,
    /// Node it is about.
    pub node: Option<NodeId>,
    /// What was found.
    pub news: FindingNews,
}

/// An occurrence of a finding.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Occurred {
    /// Frame that showed it.
    pub frame: u64,
    /// Its time.
    pub time: Option<Timestamp>,
    /// Finding.
    pub id: u64,
    /// How bad.
    pub severity: Severity,
}

/// Messages that belong together, as one.
#[derive(Debug, Clone)]
pub struct Exchange {
    /// Where it ended.
    pub spot: Spot,
    /// When it ended.
    pub time: Option<Timestamp>,
    /// Its frames.
    pub frames: FrameRange,
    /// Its bus.
    pub bus: BusIndex,
    /// Sender and receiver.
    pub who: Box<str>,
    /// Node it is about.
    pub node: Option<NodeId>,
    /// Kind in at most six letters.
    pub kind: &'static str,
    /// The same as filters name it.
    pub event_kind: &'static str,
    /// What it is about, and what came of it.
    pub what: Box<str>,
    /// Nanoseconds from its first frame to its last.
    pub duration: Option<i64>,
    /// Bytes transferred.
    pub size: u64,
    /// How it ended.
    pub outcome: &'static str,
    /// How it looks.
    pub tone: Tone,
}

/// What is to become of the bit rate, where an event announces it.
pub fn bit_rate_change(event: &Event) -> Option<&str> {
    match &event.kind {
        EventKind::Procedure(procedure) if procedure.procedure == BIT_RATE_CHANGE => Some(&procedure.text),
        _ => None,
    }
}
