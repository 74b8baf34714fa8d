//! Events of J1939 and ISOBUS, and of transport protocols.

use std::sync::Arc;

use super::SdoOutcome;
use crate::frame::{CanId, MAX_DATA};
use crate::profile::PayloadLayout;
use crate::wire::j1939::{self, J1939Id, J1939Name, Pgn};

/// A single-frame message; signals are decoded on demand.
#[derive(Debug, Clone)]
#[non_exhaustive]
pub struct J1939Message {
    /// Decoded identifier: priority, PGN, addresses.
    pub id: J1939Id,
    /// Raw identifier.
    pub can_id: CanId,
    /// Name of the parameter group, if known.
    pub name: Option<Arc<str>>,
    /// Payload length in bytes.
    pub length: u8,
    /// Payload, padded; see `length`.
    pub bytes: [u8; MAX_DATA],
    /// Layout of the signals, if known.
    pub layout: Option<Arc<PayloadLayout>>,
}

impl J1939Message {
    /// Payload without padding.
    pub fn payload(&self) -> &[u8] {
        self.bytes.get(..usize::from(self.length)).unwrap_or(&self.bytes)
    }
}

/// Transport protocol of a multi-packet message.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum TransportMode {
    /// Broadcast announce message: to all nodes, without a response (J1939-21 §5.10.2.5).
    Broadcast,
    /// Request and clear to send, up to 1,785 bytes (J1939-21 §5.10.3).
    Connection,
    /// Extended transport protocol, up to 117,440,505 bytes (ISO 11783-3).
    Extended,
    /// Fast packet of NMEA 2000, up to 223 bytes in frames of one group.
    FastPacket,
}

impl TransportMode {
    /// The name used in all output.
    pub const fn name(self) -> &'static str {
        match self {
            Self::Broadcast => "bam",
            Self::Connection => "rts-cts",
            Self::Extended => "etp",
            Self::FastPacket => "fast-packet",
        }
    }
}

/// Time-out of a transport protocol.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord)]
pub enum TransportTimer {
    /// 750 ms: next packet (J1939-21 §5.10.2.4; also T2 to Th).
    T1,
    /// 1,250 ms: first packet after a clear to send.
    T2,
    /// 1,250 ms: response to the last packet.
    T3,
    /// 1,050 ms: next clear to send after a hold message.
    T4,
    /// 200 ms: any response.
    Tr,
    /// 500 ms: next clear to send while the connection is held.
    Th,
    /// 1,000 ms: flow control (ISO 15765-2 §9.7).
    NBs,
    /// 1,000 ms: next consecutive frame (ISO 15765-2 §9.7).
    NCr,
}

impl TransportTimer {
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
    /// Reason code.
    pub reason: u8,
    /// Sent by the sender of the data, not by its receiver.
    pub by_sender: bool,
}

/// A multi-packet message, from its first frame to its last.
#[derive(Debug, Clone)]
#[non_exhaustive]
pub struct J1939Transfer {
    /// Transport protocol; None if the start is not in the capture.
    pub mode: Option<TransportMode>,
    /// Parameter group; None if the start is not in the capture.
    pub pgn: Option<Pgn>,
    /// Name of the parameter group, if known.
    pub name: Option<Arc<str>>,
    /// Priority of the packets.
    pub priority: u8,
    /// Address of the sender of the data.
    pub source: u8,
    /// Address of the receiver, or 255.
    pub destination: u8,
    /// Announced size in bytes.
    pub announced: Option<u32>,
    /// Announced number of packets.
    pub packets: Option<u32>,
    /// Bytes seen, without repetitions.
    pub size: u64,
    /// Packets that were not seen.
    pub missing: u32,
    /// Packets seen more than once.
    pub repeated: u32,
    /// Shortest and longest time between the frames of a broadcast, in ns, except across missing packets.
    pub spacing: Option<(i64, i64)>,
    /// Data in order, up to 64 KiB or to the first missing packet.
    pub data: Vec<u8>,
    /// `data` is incomplete: over the limit, or packets are missing.
    pub truncated: bool,
    /// Layout of the signals, if known and the data is complete.
    pub layout: Option<Arc<PayloadLayout>>,
    /// Time from first to last frame, in ns.
    pub duration: Option<i64>,
    /// Result of the transfer.
    pub outcome: SdoOutcome,
    /// Time-out that ended it.
    pub timer: Option<TransportTimer>,
    /// Abort that ended it.
    pub abort: Option<TransportAbort>,
    /// The first frames are not in the capture.
    pub cut_start: bool,
    /// The last frames are not in the capture.
    pub cut_end: bool,
    /// Number of frames.
    pub frame_count: u64,
}

/// Irregularity that does not end a transfer.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
#[non_exhaustive]
pub enum IrregularityKind {
    /// A packet arrived before an earlier one.
    Gap,
    /// A packet was repeated without a request.
    Duplicate,
    /// The receiver requested packets again.
    Retransmission,
    /// A response arrived after its time-out without ending the transfer.
    Late,
    /// A message that belongs to no open transfer.
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

/// An irregularity within a transfer.
#[derive(Debug, Clone, PartialEq, Eq)]
#[non_exhaustive]
pub struct TransferIrregularity {
    /// Kind of irregularity.
    pub what: IrregularityKind,
    /// Name of the message: `TP.CM_CTS`, `consecutive frame`.
    pub message: &'static str,
    /// Parameter group of the transfer.
    pub pgn: Option<Pgn>,
    /// Address of the sender of the frame; None if addresses are unknown.
    pub source: Option<u8>,
    /// Address of the receiver of the frame; None if addresses are unknown.
    pub destination: Option<u8>,
    /// Number of the packet received.
    pub packet: Option<u32>,
    /// Number of the packet expected.
    pub expected: Option<u32>,
    /// Expired time-out.
    pub timer: Option<TransportTimer>,
    /// Actual time in ns.
    pub delay: Option<i64>,
}

/// A request for a parameter group (PGN 59904).
#[derive(Debug, Clone, PartialEq, Eq)]
#[non_exhaustive]
pub struct J1939Request {
    /// Requested parameter group.
    pub pgn: Pgn,
    /// Name of the parameter group, if known.
    pub name: Option<Arc<str>>,
    /// Address of the requester.
    pub source: u8,
    /// Requested address, or 255.
    pub destination: u8,
}

/// An acknowledgement (PGN 59392).
#[derive(Debug, Clone, PartialEq, Eq)]
#[non_exhaustive]
pub struct J1939Acknowledgement {
    /// Decoded acknowledgement.
    pub message: j1939::Acknowledgement,
    /// Name of the parameter group, if known.
    pub name: Option<Arc<str>>,
    /// Address of the sender.
    pub source: u8,
    /// Address of the receiver, or 255.
    pub destination: u8,
}

impl J1939Acknowledgement {
    /// Name of the control byte in all output.
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

/// Result of an address claim.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
#[non_exhaustive]
pub enum ClaimAction {
    /// The device now has the address.
    Claimed,
    /// The device already had the address: response to a request, or to the claim of another device.
    Confirmed,
    /// Another device with a lower NAME has the address.
    Lost,
    /// The device found no free address; its source address is 254.
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

/// Two devices claim the same address.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct AddressConflict {
    /// NAME of the other device.
    pub other: J1939Name,
    /// Lower of the two NAMEs.
    pub winner: J1939Name,
}

/// An address claim (J1939-81 §4.2.2).
#[derive(Debug, Clone, PartialEq, Eq)]
#[non_exhaustive]
pub struct AddressClaim {
    /// Result of the claim.
    pub action: ClaimAction,
    /// NAME of the claiming device.
    pub name: J1939Name,
    /// Claimed address; 254 for cannot claim.
    pub source: u8,
    /// Previous address of the device.
    pub from: Option<u8>,
    /// Contention with another device for the address.
    pub contention: Option<AddressConflict>,
    /// Frame of the commanded address that caused the claim; 0 if none.
    pub commanded: u64,
}

/// A commanded address (PGN 65240).
#[derive(Debug, Clone, PartialEq, Eq)]
#[non_exhaustive]
pub struct CommandedAddress {
    /// NAME of the commanded device.
    pub name: J1939Name,
    /// New address.
    pub address: u8,
    /// Address of the commander.
    pub source: u8,
    /// Current address of the device, if known.
    pub present: Option<u8>,
}

/// Change of a fault.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
#[non_exhaustive]
pub enum DtcAction {
    /// Reported for the first time, or again after an interruption.
    Raised,
    /// The occurrence count rose while the fault was reported.
    Recurred,
    /// No longer reported: cleared, or hidden by another fault.
    NoLongerReported,
    /// Contained in a list of previously active faults.
    PreviouslyActive,
    /// Cleared, with an acknowledgement of the device.
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

/// A diagnostic trouble code (J1939-73 §5.7.1.6) and its change.
#[derive(Debug, Clone, PartialEq, Eq)]
#[non_exhaustive]
pub struct Dtc {
    /// Suspect parameter number, 19 bits.
    pub spn: u32,
    /// Failure mode identifier, 5 bits.
    pub fmi: u8,
    /// Occurrence count, 0..=126; None if the device does not count.
    pub count: Option<u8>,
    /// Change of the fault.
    pub action: DtcAction,
    /// Address of the reporting device.
    pub source: u8,
    /// The conversion method bit is set, so one of three older SPN encodings is assumed.
    pub is_old_coding: bool,
    /// Names of lit lamps, with `-slow` or `-fast` if they flash.
    pub lamps: Vec<&'static str>,
    /// First frame that reported it.
    pub first_frame: u64,
    /// Last frame that reported it.
    pub last_frame: u64,
    /// Time since `last_frame`, in ns.
    pub since: Option<i64>,
    /// No longer reported by a device that reports only its most urgent fault, and now reports another one.
    pub may_be_hidden: bool,
    /// Ended by the absence of DM1, not by a DM1 without the fault.
    pub by_silence: bool,
}

/// A message was later than the device manual permits.
#[derive(Debug, Clone, PartialEq, Eq)]
#[non_exhaustive]
pub struct MessageGap {
    /// Title of the message in the profile: `AVC valve 0`.
    pub message: String,
    /// Parameter group of the message.
    pub pgn: Pgn,
    /// Address of the last sender.
    pub source: u8,
    /// Time without the message, in ns.
    pub gap: i64,
    /// Maximum permitted time, in ns.
    pub limit: i64,
    /// Usual interval and the largest deviation from it, in ns, from the last messages.
    pub usual: Option<(i64, i64)>,
    /// The message was received again; false if it was still missing at the end of the capture.
    pub has_returned: bool,
}
