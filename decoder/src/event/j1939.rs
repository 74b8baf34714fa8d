//! Events of J1939 and ISOBUS, and of transport protocols.

use std::sync::Arc;

use super::Outcome;
use crate::frame::{CanId, MAX_DATA};
use crate::profile::Layout;
use crate::wire::j1939::{self, J1939Id, Name, Pgn};

/// A message that fits one frame; signals are computed by whoever wants them.
#[derive(Debug, Clone)]
#[non_exhaustive]
pub struct J1939Message {
    /// What its identifier says.
    pub id: J1939Id,
    /// The identifier itself.
    pub can_id: CanId,
    /// Name of its group, if known.
    pub name: Option<Arc<str>>,
    /// Payload length in bytes.
    pub length: u8,
    /// Payload.
    pub bytes: [u8; MAX_DATA],
    /// What the bits mean, if known.
    pub layout: Option<Arc<Layout>>,
}

impl J1939Message {
    /// The payload.
    pub fn payload(&self) -> &[u8] {
        self.bytes.get(..usize::from(self.length)).unwrap_or(&self.bytes)
    }
}

/// How a longer message travels.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum TransportMode {
    /// Broadcast announce message: to all, nobody answers (J1939-21 §5.10.2.5).
    Broadcast,
    /// Request and clear to send, up to 1,785 bytes (J1939-21 §5.10.3).
    Connection,
    /// Extended transport protocol, up to 117,440,505 bytes (ISO 11783-3).
    Extended,
}

impl TransportMode {
    /// The name used in all output.
    pub const fn name(self) -> &'static str {
        match self {
            Self::Broadcast => "bam",
            Self::Connection => "rts-cts",
            Self::Extended => "etp",
        }
    }
}

/// A time-out of a transport protocol.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord)]
pub enum Timer {
    /// 750 ms: the next packet (J1939-21 §5.10.2.4, as are those below).
    T1,
    /// 1,250 ms: the first packet behind a clear to send.
    T2,
    /// 1,250 ms: the answer to the last packet.
    T3,
    /// 1,050 ms: the next clear to send behind one that holds.
    T4,
    /// 200 ms: any answer.
    Tr,
    /// 500 ms: the next clear to send while the connection is held.
    Th,
    /// 1,000 ms: flow control (ISO 15765-2 §9.7).
    NBs,
    /// 1,000 ms: the next consecutive frame (ISO 15765-2 §9.7).
    NCr,
}

impl Timer {
    /// The name used in all output.
    pub const fn name(self) -> &'static str {
        match self {
            Self::T1 => "T1",
            Self::T2 => "T2",
            Self::T3 => "T3",
            Self::T4 => "T4",
            Self::Tr => "Tr",
            Self::Th => "Th",
            Self::NBs => "N_Bs",
            Self::NCr => "N_Cr",
        }
    }
}

/// A connection abort (J1939-21 §5.10.3.4).
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct TransportAbort {
    /// Reason.
    pub reason: u8,
    /// By the sender of the data rather than its receiver.
    pub by_sender: bool,
}

/// A message of several packets, from its first frame to its last.
#[derive(Debug, Clone)]
#[non_exhaustive]
pub struct J1939Transfer {
    /// How it travels; `None` where the capture began too late to tell.
    pub mode: Option<TransportMode>,
    /// Its group; `None` where the capture began too late to tell.
    pub pgn: Option<Pgn>,
    /// Name of the group, if known.
    pub name: Option<Arc<str>>,
    /// Priority of its packets.
    pub priority: u8,
    /// Who sends the data.
    pub source: u8,
    /// To whom: an address or 255.
    pub destination: u8,
    /// Bytes announced.
    pub announced: Option<u32>,
    /// Packets announced.
    pub packets: Option<u32>,
    /// Bytes seen, each once.
    pub size: u64,
    /// Packets that were not seen.
    pub missing: u32,
    /// Packets seen more than once.
    pub repeated: u32,
    /// Of a broadcast, shortest and longest time between its frames in nanoseconds, missing packets apart.
    pub spacing: Option<(i64, i64)>,
    /// Data in order, cut at 64 KiB; up to the first gap where packets are missing.
    pub data: Vec<u8>,
    /// `data` is not whole: over the limit, or packets were not seen.
    pub truncated: bool,
    /// What the bits mean, if known and all are there.
    pub layout: Option<Arc<Layout>>,
    /// Nanoseconds from first to last frame.
    pub duration: Option<i64>,
    /// How it ended.
    pub outcome: Outcome,
    /// The time-out that ended it.
    pub timer: Option<Timer>,
    /// The abort that ended it.
    pub abort: Option<TransportAbort>,
    /// First frames not in the capture.
    pub cut_start: bool,
    /// Last frames not in the capture.
    pub cut_end: bool,
    /// Frames it took.
    pub frame_count: u64,
}

/// What is not as it should be within a transfer that goes on.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
#[non_exhaustive]
pub enum IrregularityKind {
    /// A packet came before an earlier one.
    Gap,
    /// A packet came again that nobody asked for.
    Duplicate,
    /// The receiver asked for packets again.
    Retransmission,
    /// An answer came later than its time-out, which does not end the transfer.
    Late,
    /// A message that no open transfer explains.
    Unexpected,
}

impl IrregularityKind {
    /// The name used in all output.
    pub const fn name(self) -> &'static str {
        match self {
            Self::Gap => "gap",
            Self::Duplicate => "duplicate",
            Self::Retransmission => "retransmission",
            Self::Late => "late",
            Self::Unexpected => "unexpected",
        }
    }
}

/// Something irregular within a transfer.
#[derive(Debug, Clone, PartialEq, Eq)]
#[non_exhaustive]
pub struct Irregularity {
    /// What.
    pub what: IrregularityKind,
    /// What it is about, for people: `TP.CM_CTS`, `consecutive frame`.
    pub message: &'static str,
    /// Group of the transfer.
    pub pgn: Option<Pgn>,
    /// Who sent the frame; `None` where addresses are not known.
    pub source: Option<u8>,
    /// To whom.
    pub destination: Option<u8>,
    /// Number of the packet that came.
    pub packet: Option<u32>,
    /// Number of the packet that was due.
    pub expected: Option<u32>,
    /// The time-out that passed.
    pub timer: Option<Timer>,
    /// Nanoseconds it took.
    pub delay: Option<i64>,
}

/// A request for a group (PGN 59904).
#[derive(Debug, Clone, PartialEq, Eq)]
#[non_exhaustive]
pub struct J1939Request {
    /// The group asked for.
    pub pgn: Pgn,
    /// Its name, if known.
    pub name: Option<Arc<str>>,
    /// Who asks.
    pub source: u8,
    /// Whom: an address or 255.
    pub destination: u8,
}

/// An acknowledgement (PGN 59392).
#[derive(Debug, Clone, PartialEq, Eq)]
#[non_exhaustive]
pub struct J1939Acknowledgement {
    /// What it says.
    pub message: j1939::Acknowledgement,
    /// Name of the group, if known.
    pub name: Option<Arc<str>>,
    /// Who sends it.
    pub source: u8,
    /// To whom: an address or 255.
    pub destination: u8,
}

impl J1939Acknowledgement {
    /// Name of the control byte used in all output.
    pub const fn control(&self) -> &'static str {
        match self.message.control {
            0 => "ack",
            1 => "nack",
            2 => "access-denied",
            3 => "cannot-respond",
            _ => "reserved",
        }
    }
}

/// What a claim comes to.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
#[non_exhaustive]
pub enum ClaimAction {
    /// The device has the address now.
    Claimed,
    /// It had it before: an answer to a request, or after another one's claim.
    Confirmed,
    /// Another device with a lower NAME has the address.
    Lost,
    /// The device found no address: its source is 254.
    CannotClaim,
}

impl ClaimAction {
    /// The name used in all output.
    pub const fn name(self) -> &'static str {
        match self {
            Self::Claimed => "claimed",
            Self::Confirmed => "confirmed",
            Self::Lost => "lost",
            Self::CannotClaim => "cannot-claim",
        }
    }
}

/// Two devices want one address.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Contention {
    /// The other one.
    pub other: Name,
    /// Whose NAME is lower.
    pub winner: Name,
}

/// An address claim (J1939-81 §4.2.2).
#[derive(Debug, Clone, PartialEq, Eq)]
#[non_exhaustive]
pub struct AddressClaim {
    /// What it comes to.
    pub action: ClaimAction,
    /// Who claims.
    pub name: Name,
    /// The address; 254 of who cannot claim.
    pub source: u8,
    /// Address the device had before.
    pub from: Option<u8>,
    /// The other device that wants the address.
    pub contention: Option<Contention>,
    /// Frame of the commanded address that brought it; 0 if there is none.
    pub commanded: u64,
}

/// A commanded address (PGN 65240).
#[derive(Debug, Clone, PartialEq, Eq)]
#[non_exhaustive]
pub struct CommandedAddress {
    /// Whom it is for.
    pub name: Name,
    /// Address it is to take.
    pub address: u8,
    /// Who commands.
    pub source: u8,
    /// Present address of the device, if it is known.
    pub present: Option<u8>,
}

/// What became of a fault.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
#[non_exhaustive]
pub enum DtcAction {
    /// It is reported for the first time, or again after it was not.
    Raised,
    /// Its occurrence count rose while it was reported.
    Recurred,
    /// It is reported no longer: gone, or hidden by another one.
    NoLongerReported,
    /// A list of previously active faults has it.
    PreviouslyActive,
    /// It was cleared, as the device acknowledged.
    Cleared,
}

impl DtcAction {
    /// The name used in all output.
    pub const fn name(self) -> &'static str {
        match self {
            Self::Raised => "raised",
            Self::Recurred => "recurred",
            Self::NoLongerReported => "no-longer-reported",
            Self::PreviouslyActive => "previously-active",
            Self::Cleared => "cleared",
        }
    }
}

/// A diagnostic trouble code (J1939-73 §5.7.1.6) and what became of it.
#[derive(Debug, Clone, PartialEq, Eq)]
#[non_exhaustive]
pub struct Dtc {
    /// Suspect parameter, 19 bits.
    pub spn: u32,
    /// Failure mode, 5 bits.
    pub fmi: u8,
    /// Occurrences, 0..=126; `None` where the device does not count.
    pub count: Option<u8>,
    /// What became of it.
    pub action: DtcAction,
    /// Who reports it.
    pub source: u8,
    /// Conversion method bit is set, and which of three older ways the SPN is coded in is assumed.
    pub is_old_coding: bool,
    /// Lamps that are lit, as the tables name them; with `-slow` or `-fast` where they flash.
    pub lamps: Vec<&'static str>,
    /// First frame that reported it.
    pub first_frame: u64,
    /// Last frame that reported it.
    pub last_frame: u64,
    /// Nanoseconds since that frame.
    pub since: Option<i64>,
    /// It left, but the device shows only its most urgent fault, and shows another one.
    pub may_be_hidden: bool,
    /// It ended by silence of DM1, not by a DM1 without it.
    pub by_silence: bool,
}

/// A message came later than the device's manual permits.
#[derive(Debug, Clone, PartialEq, Eq)]
#[non_exhaustive]
pub struct MessageGap {
    /// Message, as the profile titles it: `AVC valve 0`.
    pub message: String,
    /// Its group.
    pub pgn: Pgn,
    /// Who sent it last.
    pub source: u8,
    /// Nanoseconds without it.
    pub gap: i64,
    /// Nanoseconds permitted.
    pub limit: i64,
    /// Usual interval in nanoseconds, and the largest deviation from it, of the last ones.
    pub usual: Option<(i64, i64)>,
    /// It came again; else it is still missing when the capture ends.
    pub came_again: bool,
}
