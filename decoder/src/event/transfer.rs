//! Events that contain objects: PDOs and SDO transfers.

use std::sync::Arc;

use crate::frame::{CanId, MAX_DATA};
use crate::profile::{ObjectMeaning, PayloadLayout, PdoName, Persistence, WriteEffect};
use crate::wire::canopen::ObjectAddress;

/// A PDO with layout and payload; signals are decoded on demand.
#[derive(Debug, Clone)]
#[non_exhaustive]
pub struct DecodedPdo {
    /// Direction and number of the PDO.
    pub name: PdoName,
    /// COB-ID of the PDO.
    pub cob_id: CanId,
    /// A remote frame: a request for this PDO.
    pub is_request: bool,
    /// Payload length in bytes; for a request, the requested length.
    pub length: u8,
    /// Payload, padded; see `length`.
    pub bytes: [u8; MAX_DATA],
    /// Layout of the signals, if known.
    pub layout: Option<Arc<PayloadLayout>>,
}

impl DecodedPdo {
    /// Payload without padding; empty for a request.
    pub fn payload(&self) -> &[u8] {
        let length = if self.is_request { 0 } else { usize::from(self.length) };
        self.bytes.get(..length).unwrap_or(&self.bytes)
    }

    /// First eight bytes as a number, least significant byte first; bytes beyond the payload are 0.
    #[inline]
    pub fn first_word(&self) -> u64 {
        self.bytes.first_chunk().map_or(0, |bytes| u64::from_le_bytes(*bytes))
    }
}

/// Direction of an SDO transfer, as defined in CiA 301.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum SdoDirection {
    /// The client reads.
    Upload,
    /// The client writes.
    Download,
}

/// Kind of SDO transfer.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum SdoMode {
    /// Data in the initiate message.
    Expedited,
    /// Confirmed segments.
    Segmented,
    /// Block transfer.
    Block,
}

/// Result of a transfer.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
#[non_exhaustive]
pub enum SdoOutcome {
    /// Completed correctly.
    Complete,
    /// Ended by an abort message.
    Aborted,
    /// No further message within the time limit.
    Timeout,
    /// Replaced by a new transfer.
    Superseded,
    /// Completed, but not all frames were seen.
    Incomplete,
    /// The capture ended before the transfer.
    Unfinished,
}

impl SdoOutcome {
    /// The name used in all output.
    pub const fn name(self) -> &'static str {
        match self {
            Self::Complete => "complete",
            Self::Aborted => "aborted",
            Self::Timeout => "timeout",
            Self::Superseded => "superseded",
            Self::Incomplete => "incomplete",
            Self::Unfinished => "unfinished",
        }
    }
}

/// CRC check of a block transfer.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum CrcCheck {
    /// Offered by client and server, and equal to that of the data.
    Correct,
    /// Offered by client and server, but different from that of the data.
    Wrong,
    /// Not offered by both.
    NotUsed,
    /// Segments were not seen, so it cannot be checked.
    Unchecked,
}

impl CrcCheck {
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
pub struct SdoAbort {
    /// Abort code.
    pub code: u32,
    /// Sent by the client, not by the server.
    pub by_client: bool,
}

/// Protocol violation within a transfer.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
#[non_exhaustive]
pub enum SdoIrregularityKind {
    /// A toggle bit that does not alternate, or a response with the wrong toggle bit.
    Toggle,
    /// A block size other than 1 to 127.
    BlockSize,
    /// A sequence number beyond the block, or an acknowledgement of such a number.
    Sequence,
}

impl SdoIrregularityKind {
    /// The name used in all output.
    pub const fn name(self) -> &'static str {
        match self {
            Self::Toggle => "toggle",
            Self::BlockSize => "block-size",
            Self::Sequence => "sequence",
        }
    }
}

/// First protocol violation within a transfer.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct SdoIrregularity {
    /// Kind of violation.
    pub what: SdoIrregularityKind,
    /// Caused by the client, not by the server.
    pub by_client: bool,
    /// Frame of the violation.
    pub frame: u64,
}

/// A response that a server sent on another identifier than that of its responses.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct MisplacedResponse {
    /// Identifier of the response.
    pub id: CanId,
    /// Frame of the response.
    pub frame: u64,
}

/// Contiguous captured bytes of a transfer.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct DataRange {
    /// Position of the first byte in the transferred value; without the start of the transfer, from the first
    /// byte captured.
    pub offset: u64,
    /// Captured bytes.
    pub data: Vec<u8>,
}

impl DataRange {
    /// Position after the last byte.
    pub fn end(&self) -> u64 {
        self.offset.saturating_add(self.data.len() as u64)
    }
}

/// One SDO transfer, from its first frame to its last.
#[derive(Debug, Clone)]
#[non_exhaustive]
pub struct SdoTransfer {
    /// COB-ID of the requests.
    pub request: CanId,
    /// COB-ID of the responses.
    pub response: CanId,
    /// Node-ID of the client, if configured.
    pub client: Option<u8>,
    /// Upload or download; None if the start is not in the capture.
    pub direction: Option<SdoDirection>,
    /// Kind of transfer; None if the start is not in the capture.
    pub mode: Option<SdoMode>,
    /// Address of the object; None if the start is not in the capture.
    pub object: Option<ObjectAddress>,
    /// Number of bytes transferred; in a failed transfer, up to the last one seen.
    pub size: u64,
    /// Bytes of `size` that are missing in the capture.
    pub unseen: u64,
    /// Meaning of the value, if known.
    pub meaning: Option<Arc<ObjectMeaning>>,
    /// Time of effect of a write, if known.
    pub effect: Option<WriteEffect>,
    /// Whether a written value survives a restart, if known.
    pub persists: Option<Persistence>,
    /// Announced size in bytes, if any.
    pub announced: Option<u32>,
    /// Transferred data up to the first byte that is missing in the capture, max 64 KiB with `later_data`.
    pub data: Vec<u8>,
    /// Data after bytes that are missing in the capture, in ascending order.
    pub later_data: Vec<DataRange>,
    /// Segments of a block transfer that the receiver acknowledged, but that are missing in the capture.
    pub missing_segments: u64,
    /// Blocks of which the receiver did not acknowledge all segments: lost on the bus and repeated.
    pub losses: u64,
    /// Sequence number of the first lost segment, and frame of the acknowledgement, if captured.
    pub first_loss: Option<(u8, Option<u64>)>,
    /// `data` is incomplete: over the limit, or segments were not seen.
    pub truncated: bool,
    /// Value known before this transfer.
    pub previous: Option<Vec<u8>>,
    /// `previous` is a default, or may have changed unseen.
    pub previous_assumed: bool,
    /// Time from first to last frame, in ns.
    pub duration: Option<i64>,
    /// Time in ns that a silent server had until the client stopped waiting or the time-out expired; 0
    /// without timestamps.
    pub waited: Option<i64>,
    /// Result of the transfer.
    pub outcome: SdoOutcome,
    /// Abort message, if any.
    pub abort: Option<SdoAbort>,
    /// CRC of a block transfer.
    pub crc: Option<CrcCheck>,
    /// First protocol violation, if any.
    pub irregularity: Option<SdoIrregularity>,
    /// Time in ns from the request to the next one of the client, which did not wait for the response.
    pub overlap: Option<i64>,
    /// Number of times that the client repeated the request.
    pub retries: u32,
    /// Two transfers were open, so that segments may belong to the other one.
    pub is_ambiguous: bool,
    /// A response or an abort message without a request.
    pub is_unrequested: bool,
    /// Responses that the client did not request, during the transfer.
    pub unrequested_responses: u64,
    /// Response on another identifier than `response`; none arrived there.
    pub misplaced: Option<MisplacedResponse>,
    /// The server sent the last frame.
    pub awaits_client: bool,
    /// The first frames are not in the capture.
    pub cut_start: bool,
    /// The last frames are not in the capture.
    pub cut_end: bool,
    /// Number of frames.
    pub frame_count: u64,
}

impl SdoTransfer {
    /// All captured data with its position.
    pub fn ranges(&self) -> impl Iterator<Item = (u64, &[u8])> {
        let first = Some((0, self.data.as_slice())).filter(|(_, data)| !data.is_empty());
        first.into_iter().chain(self.later_data.iter().map(|range| (range.offset, range.data.as_slice())))
    }

    /// Bytes captured.
    pub fn captured_bytes(&self) -> u64 {
        self.size.saturating_sub(self.unseen)
    }

    /// Bytes captured and bytes of the whole value, if they differ because the capture lacks some.
    pub fn partly_seen(&self) -> Option<(u64, u64)> {
        let announced = self.announced.map_or(0, u64::from);
        let whole = self.size.max(announced);
        let is_partial = self.missing_segments > 0 || self.unseen > 0 || self.cut_end && !self.cut_start;
        Some((self.captured_bytes(), whole)).filter(|(seen, whole)| is_partial && seen < whole && *whole > 0)
    }
}
