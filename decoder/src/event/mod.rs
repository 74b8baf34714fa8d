//! Events: what happened on a bus, as facts. Judgements are made of them by rules, lines by sinks.
//!
//! An event of several frames carries the time of its last one; an event a deadline brings carries the
//! deadline's time. Names of kinds and of their keys in output are in `query/`.

mod device;
mod finding;
mod frame_range;
mod j1939;
mod kind;
mod node;
mod signals;
mod transfer;
mod uds;
mod undecoded;

pub use device::{
    BitsChanged, Conflict, DeviceCause, DeviceState, Effective, ModeChange, NodeIdentified, ObjectChange,
    Path, ProcedureEvent, Quantity, SetPoint,
};
pub use finding::FindingNews;
pub use frame_range::FrameRange;
pub use j1939::{
    AddressClaim, ClaimAction, CommandedAddress, Contention, Dtc, DtcAction, Irregularity, IrregularityKind,
    J1939Acknowledgement, J1939Message, J1939Request, J1939Transfer, MessageGap, Timer, TransportAbort,
    TransportMode,
};
pub use kind::{EventKind, Kind};
pub use node::{BootCause, Certainty, EmcyAction, Emergency, PowerSign, Silence, StateCause, StateChange};
pub use transfer::{
    Abort, Crc, Direction, Mode, Outcome, Pdo, SdoIrregularity, SdoIrregularityKind, SdoTransfer,
};
pub use uds::{Ends, ExchangeOutcome, IsoTpTransfer, Message, MessageOutcome, UdsExchange};
pub use undecoded::Undecoded;

use crate::frame::{BusIndex, Frame, Timestamp};
use crate::wire::NodeId;

/// What the event's protocol is.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
#[non_exhaustive]
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
#[non_exhaustive]
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

impl Event {
    /// An event without time or node, of the bus itself; all of it can be set afterwards.
    pub fn new(bus: BusIndex, frames: FrameRange, kind: EventKind) -> Self {
        Self {
            time: None,
            bus,
            frames,
            protocol: Protocol::Can,
            node: None,
            presumed: false,
            routine: false,
            kind,
        }
    }

    /// The event of a frame that is taken by itself, as no protocol explains it.
    pub fn undecoded(frame: &Frame) -> Self {
        let kind = EventKind::Frame(Undecoded { frame: *frame, name: None, message: None });
        Self { time: frame.time, ..Self::new(frame.bus, FrameRange::one(frame.number), kind) }
    }
}
