//! Behaviour of one capture: everything that a comparison needs, without the capture itself.

use std::collections::{BTreeMap, BTreeSet};
use std::sync::Arc;

use crate::finding::Severity;
use crate::frame::{BusIndex, CanId};
use crate::profile::PdoName;
use crate::statistics::{DurationDistribution, ReactionTime};
use crate::wire::NodeId;
use crate::wire::canopen::ObjectAddress;

/// Maximum number of codes, states and set points per node; further ones are not compared.
pub const MOST_SUBJECTS: usize = 256;

/// Maximum number of steps of a sequence.
pub const MOST_STEPS: usize = 4_096;

/// Evidence in a capture: frame, and time in ns from the first frame.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub struct EvidenceMark {
    /// Number of the frame; 0 for none.
    pub frame: u64,
    /// Time in ns from the first frame; `None` without timestamps.
    pub time: Option<i64>,
}

/// Number of occurrences, and the first one.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub struct Occurrences {
    /// Number of occurrences.
    pub count: u64,
    /// First occurrence.
    pub first: EvidenceMark,
}

/// Behaviour of one capture.
#[derive(Debug, Clone, Default)]
#[non_exhaustive]
pub struct CaptureRecord {
    /// Name of the capture for output.
    pub name: String,
    /// Time from the first to the last frame in ns; `None` without timestamps.
    pub duration: Option<i64>,
    /// Last frame.
    pub end: EvidenceMark,
    /// Number of frames, including error frames.
    pub frames: u64,
    /// Number of error frames.
    pub error_frames: u64,
    /// Whether the timestamps are those of a recorder.
    pub is_timed: bool,
    /// Granularity of the timestamps in ns.
    pub granularity: i64,
    /// Buses in order of appearance.
    pub buses: Vec<BusRecord>,
    /// Stories, most important first.
    pub stories: Vec<StoryRecord>,
    /// Findings that are reported.
    pub findings: Vec<FindingRecord>,
    /// Rules with at least one verdict.
    pub exercised: BTreeSet<Arc<str>>,
    /// Rules that need timestamps.
    pub timing_rules: BTreeSet<Arc<str>>,
    /// Steps from the first event that matches on; `None` if none was requested.
    pub sequence: Option<EventSequence>,
}

impl CaptureRecord {
    /// Duration in seconds, at least 1 ms; 0 without timestamps.
    #[expect(clippy::cast_precision_loss, reason = "a rate needs few digits")]
    pub(super) fn seconds(&self) -> f64 {
        self.duration.map_or(0.0, |duration| (duration as f64 / 1e9).max(1e-3))
    }
}

/// Behaviour of one bus.
#[derive(Debug, Clone, Default)]
#[non_exhaustive]
pub struct BusRecord {
    /// Name in the capture.
    pub name: String,
    /// Bit rate from the bus file or the capture, in bit/s.
    pub bit_rate: Option<u32>,
    /// Number of frames.
    pub frames: u64,
    /// Number of bits on the wire.
    pub bits: u64,
    /// Nodes in ascending order.
    pub nodes: Vec<NodeBehaviour>,
    /// Identifiers in order of appearance.
    pub messages: Vec<MessageRecord>,
}

/// Behaviour of one node.
#[derive(Debug, Clone)]
#[non_exhaustive]
pub struct NodeBehaviour {
    /// Node-ID or address.
    pub id: NodeId,
    /// Name from the bus file.
    pub name: Option<String>,
    /// Profile and variant.
    pub device: Option<String>,
    /// Vendor and product; `None` if at least one of them is unknown.
    pub kind: Option<(u64, u64)>,
    /// Identity values by name, without the serial number.
    pub identity: BTreeMap<&'static str, (String, EvidenceMark)>,
    /// Parameters with their last confirmed value.
    pub parameters: BTreeMap<ObjectAddress, ParameterRecord>,
    /// Objects in each PDO.
    pub mappings: BTreeMap<PdoName, MappingRecord>,
    /// Boot-ups.
    pub boots: Occurrences,
    /// Losses by NMT error control or monitoring.
    pub losses: Occurrences,
    /// Start of a silence of the heartbeat until the end.
    pub silent_since: Option<i64>,
    /// The node was operational, or is a J1939 device with an address.
    pub was_operational: bool,
    /// The node sent or served at least one message.
    pub is_present: bool,
    /// EMCY codes, trouble codes, SDO abort codes and UDS response codes.
    pub codes: BTreeMap<RecordedCode, CodeRecord>,
    /// Duration of SDO transfers, in ns.
    pub transfers: DurationDistribution,
    /// Latency of UDS exchanges, in ns.
    pub exchanges: DurationDistribution,
    /// Reaction times of the controller.
    pub reactions: Vec<ReactionTime>,
    /// State machines: NMT, and those of the device by channel.
    pub machines: BTreeMap<String, StateRecord>,
    /// Set points.
    pub points: BTreeMap<(ObjectAddress, Option<u8>), PointRecord>,
}

impl NodeBehaviour {
    /// A node without any behaviour.
    pub(super) fn new(id: NodeId) -> Self {
        Self {
            id,
            name: None,
            device: None,
            kind: None,
            identity: BTreeMap::new(),
            parameters: BTreeMap::new(),
            mappings: BTreeMap::new(),
            boots: Occurrences::default(),
            losses: Occurrences::default(),
            silent_since: None,
            was_operational: false,
            is_present: false,
            codes: BTreeMap::new(),
            transfers: DurationDistribution::default(),
            exchanges: DurationDistribution::default(),
            reactions: Vec::new(),
            machines: BTreeMap::new(),
            points: BTreeMap::new(),
        }
    }
}

/// Value of a parameter, and its origin.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct ParameterRecord {
    /// Name in the dictionary of the node.
    pub name: String,
    /// Formatted value.
    pub text: String,
    /// Value in bytes.
    pub data: Vec<u8>,
    /// Origin as in text output: `written`, `read`.
    pub origin: &'static str,
    /// The value may have changed since, for example by a restart.
    pub is_stale: bool,
    /// Frame and time of the value.
    pub mark: EvidenceMark,
    /// Last confirmed write, if the capture contains one.
    pub written: Option<WrittenValue>,
}

/// Last confirmed write of an object.
#[derive(Debug, Clone, PartialEq, Eq, Default)]
pub struct WrittenValue {
    /// Formatted value.
    pub text: String,
    /// Value in bytes.
    pub data: Vec<u8>,
    /// Frame and time of the last write.
    pub mark: EvidenceMark,
    /// Number of writes in NMT state operational.
    pub in_operation: u64,
}

/// Objects in a PDO.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct MappingRecord {
    /// Objects in their order.
    pub objects: Vec<String>,
    /// Default, or possibly changed without being seen.
    pub is_assumed: bool,
    /// Last write of the mapping, or the first PDO.
    pub mark: EvidenceMark,
}

/// Kind and number of a code.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Hash)]
pub enum RecordedCode {
    /// EMCY error code.
    Emcy(u16),
    /// Trouble code: SPN and FMI.
    Dtc(u32, u8),
    /// SDO abort code and object.
    Abort(u32, Option<ObjectAddress>),
    /// SDO transfer without a response.
    NoResponse(Option<ObjectAddress>),
    /// Negative response code of UDS.
    Uds(u8),
}

/// Occurrences of a code.
#[derive(Debug, Clone, PartialEq, Eq, Default)]
pub struct CodeRecord {
    /// Meaning of the code.
    pub text: String,
    /// Occurrences.
    pub at: Occurrences,
}

/// States of one state machine.
#[derive(Debug, Clone, Default)]
pub struct StateRecord {
    /// States in order of appearance.
    pub states: BTreeMap<String, StateTime>,
    /// Last state.
    pub last: String,
    /// Entry into the last state.
    pub since: EvidenceMark,
}

/// Time in one state.
#[derive(Debug, Clone, Copy, Default)]
pub struct StateTime {
    /// Total time in ns.
    pub time: i64,
    /// Entries.
    pub at: Occurrences,
    /// The state is a fault.
    pub is_fault: bool,
}

/// Values of a set point and their effect.
#[derive(Debug, Clone, Default)]
pub struct PointRecord {
    /// Name of the object.
    pub signal: String,
    /// Smallest and largest value.
    pub range: Option<(f64, f64)>,
    /// Both values as text.
    pub texts: [String; 2],
    /// Last occurrence of an extreme value.
    pub extreme: EvidenceMark,
    /// Unit of the values.
    pub unit: String,
    /// Deviations of the measured value from set points held for at least 0.5 s, in thousandths of the unit.
    pub deviations: DurationDistribution,
    /// The scale or the mapping is assumed.
    pub is_assumed: bool,
    /// Events with effect.
    pub effective: Occurrences,
    /// Events without effect, for values other than 0.
    pub ineffective: Occurrences,
    /// Closed gates at the first event without effect.
    pub gates: Vec<String>,
}

/// Role of an identifier on its bus.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord)]
pub enum MessageRole {
    /// A PDO of a node.
    Pdo(NodeId, PdoName),
    /// Service of the predefined connection set: function code and node.
    Service(u16, NodeId),
    /// Any other identifier.
    Id(CanId),
}

/// Timing of one identifier.
#[derive(Debug, Clone)]
#[non_exhaustive]
pub struct MessageRecord {
    /// Role on the bus.
    pub role: MessageRole,
    /// Identifier.
    pub id: CanId,
    /// The frames are remote frames.
    pub is_remote: bool,
    /// Meaning of the identifier.
    pub meaning: String,
    /// Number of frames.
    pub count: u64,
    /// Distribution of the intervals.
    pub gaps: DurationDistribution,
    /// Start of the longest interval in ns from the first frame of the capture.
    pub longest_at: Option<i64>,
    /// Start of a silence until the end, in the same time.
    pub silent_since: Option<i64>,
    /// Last frame.
    pub last: EvidenceMark,
}

/// A story of the diagnosis.
#[derive(Debug, Clone)]
#[non_exhaustive]
pub struct StoryRecord {
    /// Bus and node.
    pub place: (BusIndex, Option<NodeId>),
    /// Cause, or first effect.
    pub title: String,
    /// Whether the capture shows the cause.
    pub is_cause_visible: bool,
    /// Sum of the weights of its findings.
    pub rank: f64,
    /// First occurrence.
    pub mark: EvidenceMark,
    /// Numbers of the findings, cause first.
    pub findings: Vec<u64>,
}

/// A finding.
#[derive(Debug, Clone)]
#[non_exhaustive]
pub struct FindingRecord {
    /// Number within the capture.
    pub id: u64,
    /// Name of the rule.
    pub rule: Arc<str>,
    /// Bus and node.
    pub place: (BusIndex, Option<NodeId>),
    /// Subject within the node or bus.
    pub about: String,
    /// Severity.
    pub severity: Severity,
    /// Text of the first occurrence.
    pub text: String,
    /// Occurrences.
    pub at: Occurrences,
    /// Printed with another finding.
    pub is_member: bool,
}

/// Steps after an event.
#[derive(Debug, Clone, Default)]
pub struct EventSequence {
    /// First event that matches; `None` if none does.
    pub start: Option<EvidenceMark>,
    /// Steps in their order, at most [`MOST_STEPS`].
    pub steps: Vec<SequenceStep>,
}

/// A step of a sequence.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct SequenceStep {
    /// Bus and node.
    pub place: (BusIndex, Option<NodeId>),
    /// Content of the event, without times and frame numbers.
    pub text: String,
    /// Frame and time.
    pub mark: EvidenceMark,
}
