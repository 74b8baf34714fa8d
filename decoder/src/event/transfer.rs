//! Events that carry objects: PDOs and SDO transfers.

use std::sync::Arc;

use crate::frame::{CanId, MAX_DATA};
use crate::profile::{Effect, Layout, Meaning, PdoName};
use crate::wire::canopen::ObjectAddress;

/// A PDO: layout and payload; signals are computed by whoever wants them.
#[derive(Debug, Clone)]
#[non_exhaustive]
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

    /// The first eight bytes as a number, least significant byte first; bytes beyond the payload are zero.
    #[inline]
    pub fn word(&self) -> u64 {
        self.bytes.first_chunk().map_or(0, |bytes| u64::from_le_bytes(*bytes))
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

/// How a transfer ended.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
#[non_exhaustive]
pub enum Outcome {
    /// As it should.
    Complete,
    /// By an abort message.
    Aborted,
    /// Nothing more came within the silence limit.
    Timeout,
    /// Another one began in its place.
    Superseded,
    /// It came to its end, but not all of it was seen.
    Incomplete,
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
            Self::Incomplete => "incomplete",
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

/// What within a transfer is against the protocol.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
#[non_exhaustive]
pub enum SdoIrregularityKind {
    /// A toggle bit that does not alternate, or does not answer the other side's.
    Toggle,
    /// A block size other than 1 to 127.
    BlockSize,
    /// A sequence number beyond the block, or an acknowledgement of one.
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

/// The first thing within a transfer that is against the protocol.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct SdoIrregularity {
    /// What.
    pub what: SdoIrregularityKind,
    /// The client did it rather than the server.
    pub by_client: bool,
    /// Frame.
    pub frame: u64,
}

/// One SDO transfer, from its first frame to its last.
#[derive(Debug, Clone)]
#[non_exhaustive]
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
    /// What its value means, if known.
    pub meaning: Option<Arc<Meaning>>,
    /// When a write acts, if known.
    pub effect: Option<Effect>,
    /// Whether a written value stays: `yes`, `no`, `needs-save`, `unknown`.
    pub persists: Option<&'static str>,
    /// Size announced, if it was.
    pub announced: Option<u32>,
    /// Data, cut at 64 KiB.
    pub data: Vec<u8>,
    /// Data is not whole: over the limit, or segments were not seen.
    pub truncated: bool,
    /// Value known before this transfer.
    pub previous: Option<Vec<u8>>,
    /// That value is a default, or may have changed unseen.
    pub previous_assumed: bool,
    /// Nanoseconds from first to last frame.
    pub duration: Option<i64>,
    /// Nanoseconds the server was given, where it sent nothing before the client gave up or time ran out; 0 without
    /// stamps.
    pub waited: Option<i64>,
    /// How it ended.
    pub outcome: Outcome,
    /// Abort message, if any.
    pub abort: Option<Abort>,
    /// CRC of a block transfer.
    pub crc: Option<Crc>,
    /// What in it is against the protocol.
    pub irregularity: Option<SdoIrregularity>,
    /// First frames not in the capture.
    pub cut_start: bool,
    /// Last frames not in the capture.
    pub cut_end: bool,
    /// Frames it took.
    pub frame_count: u64,
}
