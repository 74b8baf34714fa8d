//! One SDO message, read.

use super::super::ObjectAddress;

/// What an initiate message carries.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Payload<'a> {
    /// The data itself, at most four bytes.
    Expedited {
        /// The bytes; all that were sent where the size is not indicated.
        data: &'a [u8],
        /// Whether the message says how many bytes count.
        sized: bool,
    },
    /// Segments follow.
    Segmented {
        /// Size in bytes, if indicated.
        size: Option<u32>,
    },
}

/// One SDO message.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Sdo<'a> {
    /// Client: write an object (specifier 1).
    InitiateDownload {
        /// Object to write.
        object: ObjectAddress,
        /// Data or size.
        payload: Payload<'a>,
    },
    /// Server: object accepted (3).
    DownloadInitiated {
        /// Object.
        object: ObjectAddress,
    },
    /// Client: data of a segmented download (0).
    DownloadSegment(Segment<'a>),
    /// Server: segment accepted (1).
    DownloadSegmentAccepted {
        /// Toggle bit.
        toggle: bool,
    },
    /// Client: read an object (2).
    InitiateUpload {
        /// Object to read.
        object: ObjectAddress,
    },
    /// Server: the object's data or size (2).
    UploadInitiated {
        /// Object.
        object: ObjectAddress,
        /// Data or size.
        payload: Payload<'a>,
    },
    /// Client: asks for the next segment (3).
    RequestUploadSegment {
        /// Toggle bit.
        toggle: bool,
    },
    /// Server: data of a segmented upload (0).
    UploadSegment(Segment<'a>),
    /// Client: write by blocks (6, sub 0).
    InitiateBlockDownload {
        /// Object to write.
        object: ObjectAddress,
        /// Client can make a CRC.
        crc: bool,
        /// Size in bytes, if indicated.
        size: Option<u32>,
    },
    /// Server: ready for blocks (5, sub 0).
    BlockDownloadInitiated {
        /// Object.
        object: ObjectAddress,
        /// Server can make a CRC.
        crc: bool,
        /// Segments a block, 1..=127.
        block_size: u8,
    },
    /// Server: block acknowledged (5, sub 2).
    BlockDownloadAcknowledged {
        /// Last segment received in order.
        sequence: u8,
        /// Segments of the next block.
        block_size: u8,
    },
    /// Client: all sent (6, sub 1).
    EndBlockDownload(BlockEnd),
    /// Server: all received (5, sub 1).
    BlockDownloadEnded,
    /// Client: read by blocks (5, sub 0).
    InitiateBlockUpload {
        /// Object to read.
        object: ObjectAddress,
        /// Client can make a CRC.
        crc: bool,
        /// Segments a block, 1..=127.
        block_size: u8,
        /// Up to this many bytes the server may choose segmented transfer instead.
        switch_threshold: u8,
    },
    /// Server: will send blocks (6, sub 0).
    BlockUploadInitiated {
        /// Object.
        object: ObjectAddress,
        /// Server can make a CRC.
        crc: bool,
        /// Size in bytes, if indicated.
        size: Option<u32>,
    },
    /// Client: begin (5, sub 3).
    StartBlockUpload,
    /// Client: block acknowledged (5, sub 2).
    BlockUploadAcknowledged {
        /// Last segment received in order.
        sequence: u8,
        /// Segments of the next block.
        block_size: u8,
    },
    /// Server: all sent (6, sub 1).
    EndBlockUpload(BlockEnd),
    /// Client: all received (5, sub 1).
    BlockUploadEnded,
    /// Either: a segment within a block.
    BlockSegment {
        /// 1..=127, from 1 in each block; 0 is invalid.
        sequence: u8,
        /// No segment follows.
        last: bool,
        /// Seven bytes; how many of the last segment's count, the end message says.
        data: &'a [u8],
    },
    /// Either: transfer ended with an error (4).
    Abort {
        /// Object the sender names.
        object: ObjectAddress,
        /// Abort code.
        code: u32,
    },
    /// A command byte CiA 301 does not define for this sender.
    Unknown {
        /// The byte.
        command: u8,
    },
}

impl Sdo<'_> {
    /// Whether a client begins a transfer with it.
    pub const fn begins(&self) -> bool {
        matches!(
            self,
            Self::InitiateDownload { .. }
                | Self::InitiateUpload { .. }
                | Self::InitiateBlockDownload { .. }
                | Self::InitiateBlockUpload { .. }
        )
    }

    /// Whether it belongs to an upload; `None` where the message does not tell.
    pub(crate) const fn is_upload(&self) -> Option<bool> {
        match self {
            Self::InitiateUpload { .. }
            | Self::UploadInitiated { .. }
            | Self::RequestUploadSegment { .. }
            | Self::UploadSegment(_)
            | Self::InitiateBlockUpload { .. }
            | Self::BlockUploadInitiated { .. }
            | Self::StartBlockUpload
            | Self::BlockUploadAcknowledged { .. }
            | Self::EndBlockUpload(_)
            | Self::BlockUploadEnded => Some(true),
            Self::InitiateDownload { .. }
            | Self::DownloadInitiated { .. }
            | Self::DownloadSegment(_)
            | Self::DownloadSegmentAccepted { .. }
            | Self::InitiateBlockDownload { .. }
            | Self::BlockDownloadInitiated { .. }
            | Self::BlockDownloadAcknowledged { .. }
            | Self::EndBlockDownload(_)
            | Self::BlockDownloadEnded => Some(false),
            Self::BlockSegment { .. } | Self::Abort { .. } | Self::Unknown { .. } => None,
        }
    }

    /// The object it names.
    pub const fn object(&self) -> Option<ObjectAddress> {
        match self {
            Self::InitiateDownload { object, .. }
            | Self::DownloadInitiated { object }
            | Self::InitiateUpload { object }
            | Self::UploadInitiated { object, .. }
            | Self::InitiateBlockDownload { object, .. }
            | Self::BlockDownloadInitiated { object, .. }
            | Self::InitiateBlockUpload { object, .. }
            | Self::BlockUploadInitiated { object, .. }
            | Self::Abort { object, .. } => Some(*object),
            _ => None,
        }
    }
}

/// A segment of a segmented transfer.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Segment<'a> {
    /// Toggle bit: clear in the first segment, then alternating.
    pub toggle: bool,
    /// No segment follows.
    pub last: bool,
    /// One to seven bytes (none is allowed for an empty object).
    pub data: &'a [u8],
}

/// End of a block transfer.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct BlockEnd {
    /// Bytes of the last segment that do not count, 0..=7.
    pub unused: u8,
    /// CRC-16 over the object's bytes (meaningful if both sides offered it).
    pub crc: u16,
}
