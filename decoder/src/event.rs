//! Events: what happened on a bus, as facts. Judgements are made of them by rules, lines by sinks.
//!
//! An event of several frames carries the time of its last one; an event a deadline brings carries the
//! deadline's time. Names of kinds and of their keys in output are in `query/`.

use std::sync::Arc;

use crate::frame::{BusIndex, CanId, Frame, MAX_DATA, Timestamp};
use crate::profile::{Layout, PdoName};
use crate::wire::Malformed;
use crate::wire::canopen::emcy::ByteOrder;
use crate::wire::canopen::lss::Content;
use crate::wire::canopen::nmt::NmtService;
use crate::wire::canopen::{NmtState, ObjectAddress};
use crate::wire::error_frame::ErrorFrame;

/// First and last frame of something, numbered from 1 within a capture; 0 for "none".
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub struct FrameRange {
    /// First frame.
    pub first: u64,
    /// Last frame.
    pub last: u64,
}

impl FrameRange {
    /// A single frame.
    pub const fn one(number: u64) -> Self {
        Self { first: number, last: number }
    }
}

/// What the event's protocol is.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Protocol {
    /// The bus itself: errors, silence, clocks, frames nobody owns.
    Can,
    /// CiA 301 and CiA 305.
    Canopen,
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
    /// CANopen node-ID it is about, 1..=127.
    pub node: Option<u8>,
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
    BootUp { cause: BootCause },
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
    /// The object store learnt another value.
    ObjectChange(Box<ObjectChange>),
    /// The controller's report of an error.
    CanError(ErrorFrame),
    /// A frame nothing more is known of; `name` where its service is named.
    Frame(Box<Undecoded>),
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
    /// A line or record of the capture that could not be read.
    Unreadable { line: Option<u64>, offset: Option<u64>, reason: String },
    /// Something to know about the whole bus or capture, said once.
    Note { text: String },
}

/// Why a node's state is what it is.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum StateCause {
    /// An NMT command, unconfirmed as all of them are.
    Command,
    /// A boot-up message.
    BootUp,
    /// A heartbeat.
    Heartbeat,
    /// A guarding reply.
    GuardReply,
    /// A PDO the node sent: only operational nodes do.
    Pdo,
    /// EMCY 8130: life guarding or heartbeat consumer fired.
    LifeGuard,
}

impl StateCause {
    /// The name used in all output.
    pub const fn name(self) -> &'static str {
        match self {
            Self::Command => "nmt-command",
            Self::BootUp => "boot-up",
            Self::Heartbeat => "heartbeat",
            Self::GuardReply => "guard-reply",
            Self::Pdo => "pdo",
            Self::LifeGuard => "life-guard",
        }
    }
}

/// How sure a state is (CiA 301 NMT commands are never acknowledged).
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Certainty {
    /// Follows from a command.
    Presumed,
    /// The node said or showed it.
    Confirmed,
}

/// A change of NMT state.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct StateChange {
    /// State before, if known.
    pub from: Option<NmtState>,
    /// State now.
    pub to: NmtState,
    /// What tells it.
    pub cause: StateCause,
    /// Frame of the command or message that caused it.
    pub cause_frame: u64,
    /// Nanoseconds since the command that this confirms.
    pub after: Option<i64>,
    /// How sure it is.
    pub certainty: Certainty,
}

/// Why a node started.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum BootCause {
    /// An NMT reset since its last frame.
    Commanded {
        /// Frame of the command.
        frame: u64,
    },
    /// No reset was commanded: power-on or a restart of its own.
    PresumedPowerOn {
        /// What makes a power-on likelier than a restart of this node alone.
        sign: Option<PowerSign>,
    },
}

/// What speaks for a power-on of the machine. A trace never shows one.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum PowerSign {
    /// Another node booted uncommanded just before.
    OtherNodesToo,
    /// The bus had been silent until just before.
    BusWasSilent,
}

impl PowerSign {
    /// The name used in all output.
    pub const fn name(self) -> &'static str {
        match self {
            Self::OtherNodesToo => "other-nodes-too",
            Self::BusWasSilent => "bus-was-silent",
        }
    }
}

/// A node's silence.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Silence {
    /// Last frame heard from it.
    pub last_frame: u64,
    /// Its state then.
    pub last_state: Option<NmtState>,
    /// Its last error code other than 0.
    pub last_emcy: Option<u16>,
    /// Nanoseconds without a sign.
    pub gap: i64,
    /// What was expected.
    pub monitored_by: &'static str,
}

/// What an EMCY does to the set of active errors.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum EmcyAction {
    /// An error appeared, or appeared again.
    Raised,
    /// Code 0 with errors left in the register.
    Cleared,
    /// Code 0 with an empty register.
    AllCleared,
    /// No data: started without error (CiA 301 version 3).
    Ready,
    /// Code 0 as one of the first messages after boot-up.
    NoErrorAtBoot,
}

impl EmcyAction {
    /// The name used in all output.
    pub const fn name(self) -> &'static str {
        match self {
            Self::Raised => "raised",
            Self::Cleared => "cleared",
            Self::AllCleared => "all-cleared",
            Self::Ready => "ready",
            Self::NoErrorAtBoot => "no-error-at-boot",
        }
    }
}

/// An emergency message.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Emergency {
    /// Code in the byte order in force; `None` for "ready".
    pub code: Option<u16>,
    /// Error register, object 0x1001.
    pub register: Option<u8>,
    /// Manufacturer-specific bytes.
    pub vendor: [u8; 5],
    /// How many of them were sent.
    pub vendor_length: u8,
    /// What it does.
    pub action: EmcyAction,
    /// Active errors after it.
    pub active: u16,
    /// Byte order used.
    pub byte_order: ByteOrder,
}

/// A PDO: layout and payload; signals are computed by whoever wants them.
#[derive(Debug, Clone)]
pub struct Pdo {
    /// Which PDO of the node.
    pub name: PdoName,
    /// Its identifier.
    pub cob_id: CanId,
    /// A remote frame: a request for this PDO.
    pub is_request: bool,
    /// Payload length in bytes; of a request the length asked for.
    pub length: u8,
    /// Payload.
    pub bytes: [u8; MAX_DATA],
    /// What the bits mean, if known.
    pub layout: Option<Arc<Layout>>,
}

impl Pdo {
    /// The payload; empty for a request.
    pub fn payload(&self) -> &[u8] {
        let length = if self.is_request { 0 } else { usize::from(self.length) };
        self.bytes.get(..length).unwrap_or(&self.bytes)
    }
}

/// Direction of an SDO transfer as CiA 301 names it.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Direction {
    /// Client reads.
    Upload,
    /// Client writes.
    Download,
}

/// Kind of SDO transfer.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Mode {
    /// Data in the initiate message.
    Expedited,
    /// Confirmed segments.
    Segmented,
    /// Blocks.
    Block,
}

/// How an SDO transfer ended.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Outcome {
    /// As it should.
    Complete,
    /// By an abort message.
    Aborted,
    /// Nothing more came within the silence limit.
    Timeout,
    /// The client began another one.
    Superseded,
    /// The capture ended first.
    Unfinished,
}

impl Outcome {
    /// The name used in all output.
    pub const fn name(self) -> &'static str {
        match self {
            Self::Complete => "complete",
            Self::Aborted => "aborted",
            Self::Timeout => "timeout",
            Self::Superseded => "superseded",
            Self::Unfinished => "unfinished",
        }
    }
}

/// The CRC of a block transfer.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Crc {
    /// Both sides offered it and it equals the data seen.
    Correct,
    /// Both sides offered it and it differs.
    Wrong,
    /// Not both sides offered it.
    NotUsed,
    /// Segments were not seen, so it cannot be judged.
    Unchecked,
}

impl Crc {
    /// The name used in all output.
    pub const fn name(self) -> &'static str {
        match self {
            Self::Correct => "correct",
            Self::Wrong => "wrong",
            Self::NotUsed => "not-used",
            Self::Unchecked => "unchecked",
        }
    }
}

/// An abort message.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Abort {
    /// Abort code.
    pub code: u32,
    /// Sent by the client rather than the server.
    pub by_client: bool,
}

/// One SDO transfer, from its first frame to its last.
#[derive(Debug, Clone)]
pub struct SdoTransfer {
    /// Identifier of the requests.
    pub request: CanId,
    /// Identifier of the responses.
    pub response: CanId,
    /// Node-ID of the client, if configured.
    pub client: Option<u8>,
    /// `None` where the capture began too late to tell.
    pub direction: Option<Direction>,
    /// `None` where the capture began too late to tell.
    pub mode: Option<Mode>,
    /// Object; `None` where the capture began too late to tell.
    pub object: Option<ObjectAddress>,
    /// Bytes transferred; with a failed transfer those seen.
    pub size: u64,
    /// Size announced, if it was.
    pub announced: Option<u32>,
    /// Data, cut at 64 KiB.
    pub data: Vec<u8>,
    /// Data is not whole: over the limit, or segments were not seen.
    pub truncated: bool,
    /// Value known before this transfer.
    pub previous: Option<Vec<u8>>,
    /// Nanoseconds from first to last frame.
    pub duration: Option<i64>,
    /// How it ended.
    pub outcome: Outcome,
    /// Abort message, if any.
    pub abort: Option<Abort>,
    /// CRC of a block transfer.
    pub crc: Option<Crc>,
    /// First frames not in the capture.
    pub cut_start: bool,
    /// Last frames not in the capture.
    pub cut_end: bool,
    /// Frames it took.
    pub frame_count: u64,
}

/// A change in the object store.
#[derive(Debug, Clone)]
pub struct ObjectChange {
    /// Object.
    pub object: ObjectAddress,
    /// Bytes known before.
    pub from: Option<Vec<u8>>,
    /// Bytes now.
    pub to: Vec<u8>,
    /// `download` or `upload`.
    pub origin: &'static str,
}

/// A frame that is no message of any protocol.
#[derive(Debug, Clone)]
pub struct Undecoded {
    /// The frame.
    pub frame: Frame,
    /// Name of its service where that is all that is known.
    pub name: Option<&'static str>,
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
            Self::ObjectChange(_) => "object-change",
            Self::CanError(_) => "can-error",
            Self::Frame(_) => "frame",
            Self::Malformed { .. } => "malformed",
            Self::Evicted { .. } => "evicted",
            Self::ClockStep { .. } => "clock-step",
            Self::BusSilent { .. } => "bus-silent",
            Self::LostFrames { .. } => "lost-frames",
            Self::Unreadable { .. } => "unreadable",
            Self::Note { .. } => "note",
        }
    }
}
