//! Events: facts about a bus. Rules evaluate them, and sinks print them.
//!
//! An event of several frames has the time of its last frame; an event at a deadline has the time of the
//! deadline. The names of kinds and their keys in output are defined in `query/`.

mod device;
mod evicted;
mod figures;
mod finding;
mod frame_range;
mod j1939;
mod kind;
mod kind_set;
mod node;
mod signals;
mod transfer;
mod uds;
mod undecoded;

pub use device::{
    AssignedBy, BitsChanged, ChangeOrigin, DeviceCause, DeviceState, EffectiveState, ModeChange,
    NodeIdentified, ObjectChange, ProcedureEvent, ProcedurePhase, Quantity, SetPoint, SourceConflict,
    StatePath,
};
pub use evicted::EvictedState;
pub use figures::{OutcomeGroup, TransferFigures, TransferOutcome};
pub use finding::FindingNews;
pub use frame_range::FrameRange;
pub use j1939::{
    AddressClaim, AddressConflict, ClaimAction, CommandedAddress, Dtc, DtcAction, IrregularityKind,
    J1939Acknowledgement, J1939Message, J1939Request, J1939Transfer, MessageGap, TransferIrregularity,
    TransportAbort, TransportMode, TransportTimer,
};
pub use kind::{EventKind, Kind};
pub use kind_set::KindSet;
pub use node::{
    BootCause, ByteOrderSource, EmcyAction, Emergency, NodeIdSource, NodeSilence, PowerSign, StateCause,
    StateCertainty, StateChange,
};
pub use transfer::{
    CrcCheck, DataRange, DecodedPdo, MisplacedResponse, SdoAbort, SdoDirection, SdoIrregularity,
    SdoIrregularityKind, SdoMode, SdoOutcome, SdoTransfer,
};
pub use uds::{ExchangeOutcome, IsoTpTransfer, MessageOutcome, UdsEndpoints, UdsExchange, UdsMessage};
pub use undecoded::UndecodedFrame;

pub use crate::profile::device::MonitoringMethod;

use crate::frame::{BusIndex, Frame, Timestamp};
use crate::wire::NodeId;

/// Protocol of an event.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
#[non_exhaustive]
pub enum EventProtocol {
    /// The CAN bus itself: errors, silence, clocks, frames of no known protocol.
    Can,
    /// CiA 301 and CiA 305.
    Canopen,
    /// SAE J1939 and ISO 11783.
    J1939,
    /// ISO 15765-2 and ISO 14229.
    Uds,
    /// The capture.
    Capture,
}

/// A fact about a bus or the capture.
#[derive(Debug, Clone)]
#[non_exhaustive]
pub struct Event {
    /// Timestamp; None without timestamps in the capture.
    pub time: Option<Timestamp>,
    /// Index of the bus.
    pub bus: BusIndex,
    /// Frames of the event.
    pub frames: FrameRange,
    /// Protocol of the event.
    pub protocol: EventProtocol,
    /// Node of the event, if any.
    pub node: Option<NodeId>,
    /// Decoded as CANopen without evidence that the bus uses it.
    pub presumed: bool,
    /// A repetition without new information, hidden in the default view.
    pub routine: bool,
    /// Kind and data.
    pub kind: EventKind,
}

impl Event {
    /// Creates an event of the bus itself, without time and node; other fields can be set later.
    pub fn new(bus: BusIndex, frames: FrameRange, kind: EventKind) -> Self {
        Self {
            time: None,
            bus,
            frames,
            protocol: EventProtocol::Can,
            node: None,
            presumed: false,
            routine: false,
            kind,
        }
    }

    /// Creates the event of a frame that no protocol explains.
    pub fn undecoded(frame: &Frame) -> Self {
        let kind = EventKind::Frame(UndecodedFrame { frame: *frame, name: None, message: None });
        Self { time: frame.time, ..Self::new(frame.bus, FrameRange::one(frame.number), kind) }
    }
}
