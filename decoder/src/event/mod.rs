//! Events: what happened on a bus, as facts. Judgements are made of them by rules, lines by sinks.
//!
//! An event of several frames carries the time of its last one; an event a deadline brings carries the
//! deadline's time. Names of kinds and of their keys in output are in `query/`.

mod device;
mod finding;
mod frame_range;
mod j1939;
mod node;
mod signals;
mod transfer;
mod uds;

pub use device::{
    BitsChanged, Conflict, DeviceCause, DeviceState, Effective, ModeChange, NodeIdentified, Path,
    ProcedureEvent, Quantity, SetPoint,
};
pub use finding::FindingNews;
pub use frame_range::FrameRange;
pub use j1939::{
    AddressClaim, ClaimAction, CommandedAddress, Contention, Dtc, DtcAction, Irregularity, IrregularityKind,
    J1939Acknowledgement, J1939Message, J1939Request, J1939Transfer, MessageGap, Timer, TransportAbort,
    TransportMode,
};
pub use node::{BootCause, Certainty, EmcyAction, Emergency, PowerSign, Silence, StateCause, StateChange};
pub use transfer::{
    Abort, Crc, Direction, Mode, Outcome, Pdo, SdoIrregularity, SdoIrregularityKind, SdoTransfer,
};
pub use uds::{Ends, ExchangeOutcome, IsoTpTransfer, Message, MessageOutcome, UdsExchange};

use std::sync::Arc;

use crate::frame::{BusIndex, Frame, LinkState, Timestamp};
use crate::profile::Effect;
use crate::profile::dbc::DatabaseMessage;
use crate::wire::canopen::lss::Content;
use crate::wire::canopen::nmt::NmtService;
use crate::wire::canopen::test_marker::TestMarker;
use crate::wire::canopen::{NmtState, ObjectAddress};
use crate::wire::error_frame::ErrorFrame;
use crate::wire::{Malformed, NodeId};

/// What the event's protocol is.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Protocol {
    /// The bus itself: errors, silence, clocks, frames nobody owns.
    Can,
    /// CiA 301 and CiA 305.
    Canopen,
    /// SAE J1939 and ISO 11783.
    J1939,
    /// ISO 15765-2 and ISO 14229.
    Uds,
    /// Messages about the capture.
    Capture,
}

/// One fact.
#[derive(Debug, Clone)]
pub struct Event {
    /// When; `None` where the capture has no times.
    pub time: Option<Timestamp>,
    /// Which bus.
    pub bus: BusIndex,
    /// Frames it is made of.
    pub frames: FrameRange,
    /// Protocol.
    pub protocol: Protocol,
    /// Node it is about.
    pub node: Option<NodeId>,
    /// Understood as CANopen without evidence that the bus is one.
    pub presumed: bool,
    /// Says nothing new: a repetition that a reader of changes need not see.
    pub routine: bool,
    /// What happened.
    pub kind: EventKind,
}

/// What happened.
#[derive(Debug, Clone)]
#[expect(missing_docs, reason = "fields are documented by the field table in query/")]
pub enum EventKind {
    /// The NMT master commands.
    NmtCommand { service: NmtService, target: u8, from: Option<NmtState>, to: Option<NmtState> },
    /// A node's state changed, became known or was confirmed.
    NmtState(StateChange),
    /// A node started.
    BootUp { cause: BootCause, lost: u32 },
    /// A producer's heartbeat.
    Heartbeat { state: Option<NmtState>, code: u8 },
    /// The master's guarding request (remote frame).
    GuardRequest,
    /// A node's answer to guarding.
    GuardReply { state: Option<NmtState>, code: u8, toggle: bool, toggle_error: bool },
    /// A monitored node went silent.
    NodeLost(Silence),
    /// It is heard again.
    NodeBack(Silence),
    /// SYNC.
    Sync { counter: Option<u8>, expected: Option<u8> },
    /// TIME.
    Time { milliseconds: u32, days: u16 },
    /// EMCY.
    Emcy(Emergency),
    /// A PDO.
    Pdo(Pdo),
    /// A whole SDO transfer.
    SdoTransfer(Box<SdoTransfer>),
    /// An LSS message.
    Lss { command: u8, from_master: bool, content: Content },
    /// A node took another node-ID.
    NodeIdChange { from: Option<u8>, to: u8, by: &'static str },
    /// What a node said of itself told which device it is.
    NodeIdentified(Box<NodeIdentified>),
    /// The device reports another state.
    DeviceState(Box<DeviceState>),
    /// Bits of a control or status word changed.
    BitsChanged(Box<BitsChanged>),
    /// A set point changed, or began or ceased to act.
    SetPoint(Box<SetPoint>),
    /// A mode of operation changed.
    Mode(Box<ModeChange>),
    /// A procedure started, went on or ended.
    Procedure(Box<ProcedureEvent>),
    /// Two sources say different things of one object.
    Conflict(Box<Conflict>),
    /// The object store learnt another value.
    ObjectChange(Box<ObjectChange>),
    /// A J1939 message of one frame.
    J1939Message(J1939Message),
    /// A J1939 message of several packets.
    J1939Transfer(Box<J1939Transfer>),
    /// A request for a J1939 group.
    J1939Request(J1939Request),
    /// An answer to a request or command that carries no data.
    Acknowledgement(J1939Acknowledgement),
    /// A device claims an address, or cannot.
    AddressClaim(AddressClaim),
    /// A device is told to take another address.
    CommandedAddress(CommandedAddress),
    /// A diagnostic trouble code was raised, left or was cleared.
    Dtc(Box<Dtc>),
    /// A message came later than the device's manual permits.
    MessageGap(Box<MessageGap>),
    /// Something irregular within a transport session.
    TransportIrregularity(Box<Irregularity>),
    /// A whole ISO-TP message.
    IsoTpTransfer(Box<IsoTpTransfer>),
    /// A UDS request with its answer.
    UdsExchange(Box<UdsExchange>),
    /// A rule found something wrong.
    FindingOpened(Box<FindingNews>),
    /// It is over, or did not come again for a while.
    FindingClosed(Box<FindingNews>),
    /// The controller's report of an error.
    CanError(ErrorFrame),
    /// CiA's conformance test tool begins or ends a case.
    TestCase(TestMarker),
    /// A frame nothing more is known of; `name` where its service is named.
    Frame(Undecoded),
    /// Bytes too few for their service, or a command that does not exist.
    Malformed { error: Malformed, reason: &'static str },
    /// State was given up to keep memory bounded.
    Evicted { what: &'static str, count: u64 },
    /// Stamps went backwards by `step` nanoseconds (negative).
    ClockStep { step: i64 },
    /// All traffic stopped for `gap` nanoseconds.
    BusSilent { gap: i64 },
    /// The recorder lost frames.
    LostFrames { count: Option<u64> },
    /// The way to the bus opened or closed; `bit_rate` in bit/s where it is known.
    Link { state: LinkState, bit_rate: Option<u32> },
    /// A line or record of the capture that could not be read, or at the end all that were not told one by one.
    Unreadable { line: Option<u64>, offset: Option<u64>, count: u64, reason: String },
    /// Something to know about the whole bus or capture, said once.
    Note { text: String },
}

/// A change in the object store.
#[derive(Debug, Clone)]
pub struct ObjectChange {
    /// Object.
    pub object: ObjectAddress,
    /// Bytes known before.
    pub from: Option<Vec<u8>>,
    /// Bytes now; `None` if they fell back to something unknown.
    pub to: Option<Vec<u8>>,
    /// `download` or `upload`; `reset`: the device fell back to what it keeps; `restart`: a value that
    /// waited for it took effect.
    pub origin: &'static str,
    /// When it acts, if known.
    pub effect: Option<Effect>,
    /// Whether it stays: `yes`, `no`, `needs-save`, `unknown`.
    pub persists: Option<&'static str>,
}

/// A frame that is no message of any protocol.
#[derive(Debug, Clone)]
pub struct Undecoded {
    /// The frame.
    pub frame: Frame,
    /// Name of its service where that is all that is known.
    pub name: Option<&'static str>,
    /// What a database of the user tells of its identifier.
    pub message: Option<Arc<DatabaseMessage>>,
}

impl EventKind {
    /// The name used in all output.
    pub const fn name(&self) -> &'static str {
        match self {
            Self::NmtCommand { .. } => "nmt-command",
            Self::NmtState(_) => "nmt-state",
            Self::BootUp { .. } => "boot-up",
            Self::Heartbeat { .. } => "heartbeat",
            Self::GuardRequest => "guard-request",
            Self::GuardReply { .. } => "guard-reply",
            Self::NodeLost(_) => "node-lost",
            Self::NodeBack(_) => "node-back",
            Self::Sync { .. } => "sync",
            Self::Time { .. } => "time",
            Self::Emcy(_) => "emcy",
            Self::Pdo(_) => "pdo",
            Self::SdoTransfer(_) => "sdo-transfer",
            Self::Lss { .. } => "lss",
            Self::NodeIdChange { .. } => "node-id-change",
            Self::NodeIdentified(_) => "node-identified",
            Self::DeviceState(_) => "device-state",
            Self::BitsChanged(_) => "bits-changed",
            Self::SetPoint(_) => "set-point",
            Self::Mode(_) => "mode",
            Self::Procedure(_) => "procedure",
            Self::Conflict(_) => "conflict",
            Self::ObjectChange(_) => "object-change",
            Self::J1939Message(_) => "j1939-message",
            Self::J1939Transfer(_) => "j1939-transfer",
            Self::J1939Request(_) => "j1939-request",
            Self::Acknowledgement(_) => "acknowledgement",
            Self::AddressClaim(_) => "address-claim",
            Self::CommandedAddress(_) => "commanded-address",
            Self::Dtc(_) => "dtc",
            Self::MessageGap(_) => "message-gap",
            Self::TransportIrregularity(_) => "transport-irregularity",
            Self::IsoTpTransfer(_) => "isotp-transfer",
            Self::UdsExchange(_) => "uds-exchange",
            Self::FindingOpened(_) => "finding-opened",
            Self::FindingClosed(_) => "finding-closed",
            Self::CanError(_) => "can-error",
            Self::TestCase(_) => "test-case",
            Self::Frame(_) => "frame",
            Self::Malformed { .. } => "malformed",
            Self::Evicted { .. } => "evicted",
            Self::ClockStep { .. } => "clock-step",
            Self::BusSilent { .. } => "bus-silent",
            Self::LostFrames { .. } => "lost-frames",
            Self::Link { .. } => "link",
            Self::Unreadable { .. } => "unreadable",
            Self::Note { .. } => "note",
        }
    }
}
