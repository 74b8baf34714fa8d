//! Statistics of a capture, as `cobscope stats -f json` prints them: times in s, intervals in ms.

mod addresses;
mod figures;
mod nodes;
pub mod phrases;
pub mod text;

use std::collections::BTreeMap;

use serde::Serialize;

use super::numbers::{to_millis, to_seconds};
use crate::frame::CanId;
use crate::session::{Bus, Buses, SdoPairHint, UdsPairHint};
use crate::statistics::{BusStatistics, CaptureBeginning, IdStatistics, MasterStatistics, Statistics};
use crate::suggestion::{Suggestion, firm_suggestions};
use crate::wire::NodeId;
pub use figures::{DurationFigures, IntervalFigures};
pub use nodes::{J1939DeviceFigures, NodeFigures, RaisedDtc, ReactionFigures, SdoServerFigures, SpnFmi};

/// Statistics of a capture.
#[derive(Debug, Clone, Serialize)]
pub struct CaptureStatistics {
    /// Buses, in order of appearance.
    pub buses: Vec<BusFigures>,
    /// Name of the capture.
    pub capture: String,
    /// Backward steps of the timestamps.
    pub clock_steps: u64,
    /// Time from the first frame to the last, in s; null without timestamps.
    pub duration: Option<f64>,
    /// Error frames by class.
    pub error_classes: BTreeMap<String, u64>,
    /// Number of error frames.
    pub error_frames: u64,
    /// Format of the capture.
    pub format: String,
    /// Number of frames.
    pub frames: u64,
    /// Step of the timestamps.
    pub granularity_ms: Option<f64>,
    /// Frames lost by the recorder.
    pub lost_frames: u64,
    /// Interval of synthetic timestamps.
    pub made_up_interval_ms: Option<f64>,
    /// Gaps without any frame.
    pub silences: u64,
    /// Unreadable lines or records.
    pub unreadable: u64,
}

/// Statistics of one bus.
#[derive(Debug, Clone, Serialize)]
pub struct BusFigures {
    /// How the capture begins; null without a CANopen node.
    pub begins: Option<BeginningNodes>,
    /// Bit rate in bit/s.
    pub bit_rate: Option<u32>,
    /// Number of bits.
    pub bits: u64,
    /// Name of the bus.
    pub bus: String,
    /// Detected as CANopen.
    pub canopen: bool,
    /// Reason why the bus is not detected as CANopen.
    pub doubt: Option<String>,
    /// Number of frames.
    pub frames: u64,
    /// Guarding requests of the master.
    pub guard_requests: u64,
    /// Identifiers, in ascending order.
    pub ids: Vec<IdentifierFigures>,
    /// Detected as J1939.
    pub j1939: bool,
    /// J1939 source addresses.
    pub j1939_devices: Vec<J1939DeviceFigures>,
    /// Parts of the traffic that were not decoded, and why.
    pub limits: Vec<String>,
    /// Malformed messages.
    pub malformed: u64,
    /// NMT commands by service.
    pub nmt_commands: BTreeMap<String, u64>,
    /// CANopen nodes that sent or served anything.
    pub nodes: Vec<NodeFigures>,
    /// SDO dialogues on identifiers without a channel.
    pub sdo_dialogues: Vec<SdoDialogue>,
    /// Possible profiles.
    pub suggestions: Vec<SuggestedProfile>,
    /// SYNC messages.
    pub sync: SyncFigures,
    /// TIME messages.
    pub time: u64,
    /// Detected as UDS.
    pub uds: bool,
    /// Frames of no known service.
    pub undecoded: u64,
    /// Pairs of identifiers that behave like UDS.
    pub unnamed_uds: Vec<UdsDialogue>,
    /// Maxima over one second.
    pub worst_second: WorstSecond,
}

/// How a capture begins for the CANopen nodes.
#[derive(Debug, Clone, Serialize)]
pub struct BeginningNodes {
    /// `power-on`, `nmt-reset` or `operation`.
    pub at: &'static str,
    /// Nodes that ran before the capture.
    pub running: Vec<u8>,
    /// Nodes that start in the capture.
    pub starting: Vec<u8>,
}

/// Statistics of one identifier.
#[derive(Debug, Clone, Serialize)]
pub struct IdentifierFigures {
    /// Number of frames.
    pub frames: u64,
    /// Identifier in hexadecimal digits: 3, or 8 if extended.
    pub id: String,
    /// Time between frames; null below two frames with timestamps.
    pub period_ms: Option<IntervalFigures>,
    /// Remote frames.
    pub remote: bool,
    /// Time of the last frame of a periodic message that stopped, in s.
    pub silent_since: Option<f64>,
    /// Message or service.
    pub what: String,
}

/// An SDO dialogue on identifiers without a channel.
#[derive(Debug, Clone, Serialize)]
pub struct SdoDialogue {
    /// Lines for the bus file.
    pub bus_file: String,
    /// Presumed node-ID of the server.
    pub node: u8,
    /// Identifier of the requests.
    pub request: String,
    /// Identifier of the responses.
    pub response: String,
}

/// A profile that the behaviour of a node suggests.
#[derive(Debug, Clone, Serialize)]
pub struct SuggestedProfile {
    /// Signs.
    pub because: Vec<String>,
    /// Node-ID or J1939 address.
    pub node: u8,
    /// Profile.
    pub profile: String,
    /// Title of the profile.
    pub title: String,
}

/// Statistics of SYNC.
#[derive(Debug, Clone, Serialize)]
pub struct SyncFigures {
    /// Number of messages.
    pub count: u64,
    /// Gaps in the counter.
    pub counter_gaps: u64,
    /// Time between messages.
    pub period_ms: Option<IntervalFigures>,
}

/// A pair of identifiers that exchange messages like UDS client and server.
#[derive(Debug, Clone, Serialize)]
pub struct UdsDialogue {
    /// Matching responses.
    pub answers: u32,
    /// Identifier of the requests.
    pub request: String,
    /// Identifier of the responses.
    pub response: String,
}

/// Maxima over one second.
#[derive(Debug, Clone, Serialize)]
pub struct WorstSecond {
    /// Bits.
    pub bits: u64,
    /// Frames.
    pub frames: u64,
}

impl CaptureStatistics {
    /// Statistics after the last frame; `bit_rate` is that of a bus, for the bus load.
    pub fn new(
        (capture, format): (&str, &str),
        statistics: &Statistics,
        buses: Buses<'_>,
        bit_rate: impl Fn(&Bus) -> Option<u32>,
    ) -> Self {
        let quality = &statistics.quality;
        let figures = buses.iter().zip(&statistics.buses);
        let figures = figures.map(|(bus, own)| BusFigures::new(bus, own, quality.last, bit_rate(bus)));
        Self {
            buses: figures.collect(),
            capture: capture.to_owned(),
            clock_steps: quality.clock_steps.0,
            duration: quality.duration().map(to_seconds),
            error_classes: quality.error_classes.iter().cloned().collect(),
            error_frames: quality.error_frames,
            format: format.to_owned(),
            frames: quality.frames,
            granularity_ms: quality.granularity().map(to_millis),
            lost_frames: quality.lost,
            made_up_interval_ms: quality.made_up_interval().map(to_millis),
            silences: quality.silences.0,
            unreadable: quality.unreadable,
        }
    }
}

impl BusFigures {
    fn new(bus: &Bus, statistics: &BusStatistics, end: Option<i64>, bit_rate: Option<u32>) -> Self {
        let BusStatistics { load, master, .. } = statistics;
        let present = statistics.nodes().filter(|(_, node)| node.is_present());
        let commands = master.commands.iter().map(|(service, count)| (service.name().to_owned(), *count));
        let identifier = |(id, is_remote, own)| IdentifierFigures::new(bus, (id, is_remote), own, end);
        Self {
            begins: statistics.capture_beginning().as_ref().map(BeginningNodes::new),
            bit_rate,
            bits: load.bits,
            bus: bus.name().to_owned(),
            canopen: bus.protocols().is_canopen(),
            doubt: bus.protocols().detection_doubt(),
            frames: load.frames,
            guard_requests: master.guard_requests,
            ids: statistics.ids().into_iter().map(identifier).collect(),
            j1939: bus.protocols().is_j1939(),
            j1939_devices: J1939DeviceFigures::all(bus, statistics),
            limits: bus.protocols().limit_texts(),
            malformed: statistics.malformed,
            nmt_commands: commands.collect(),
            nodes: present.map(|(id, node)| NodeFigures::new(bus, id, node, end)).collect(),
            sdo_dialogues: bus.hints().sdo_dialogues().iter().map(SdoDialogue::new).collect(),
            suggestions: firm_suggestions(bus).iter().map(SuggestedProfile::new).collect(),
            sync: SyncFigures::new(master),
            time: master.times,
            uds: bus.protocols().is_uds(),
            undecoded: statistics.undecoded,
            unnamed_uds: bus.hints().unnamed_uds().iter().map(UdsDialogue::new).collect(),
            worst_second: WorstSecond { bits: load.worst_bits().0, frames: load.worst_frames().0 },
        }
    }
}

impl BeginningNodes {
    fn new(beginning: &CaptureBeginning) -> Self {
        let numbers = |nodes: &[NodeId]| nodes.iter().map(|id| id.number()).collect();
        Self {
            at: beginning.name(),
            running: numbers(&beginning.running),
            starting: numbers(&beginning.starting),
        }
    }
}

impl IdentifierFigures {
    fn new(bus: &Bus, (id, remote): (CanId, bool), figures: &IdStatistics, end: Option<i64>) -> Self {
        Self {
            frames: figures.frames,
            id: id.to_string(),
            period_ms: IntervalFigures::new(&figures.intervals),
            remote,
            silent_since: figures.intervals.silent_since(end).map(to_seconds),
            what: bus.describe_id(id),
        }
    }
}

impl SdoDialogue {
    pub(in crate::answers) fn new(hint: &SdoPairHint) -> Self {
        Self {
            bus_file: hint.bus_file(),
            node: hint.node,
            request: hint.request.to_string(),
            response: hint.response.to_string(),
        }
    }
}

impl SuggestedProfile {
    fn new(suggestion: &Suggestion) -> Self {
        let Suggestion { node, profile, title, because, .. } = suggestion.clone();
        Self { because, node: node.number(), profile, title }
    }
}

impl SyncFigures {
    fn new(master: &MasterStatistics) -> Self {
        Self {
            count: master.syncs,
            counter_gaps: master.sync_gaps,
            period_ms: IntervalFigures::new(&master.sync),
        }
    }
}

impl UdsDialogue {
    fn new(hint: &UdsPairHint) -> Self {
        Self { answers: hint.answers, request: hint.request.to_string(), response: hint.response.to_string() }
    }
}
