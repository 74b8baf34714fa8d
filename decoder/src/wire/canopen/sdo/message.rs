//! Decoded SDO messages.

use super::super::ObjectAddress;

/// Data or size in an initiate message.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum InitiateData<'a> {
    /// The data itself, at most four bytes.
    Expedited {
        /// Data bytes; all transmitted bytes if the size is not indicated.
        data: &'a [u8],
        /// Whether the message indicates the size.
        sized: bool,
    },
    /// The data follows in segments.
    Segmented {
        /// Size in bytes, if indicated.
        size: Option<u32>,
    },
}

/// One SDO message.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum SdoMessage<'a> {
    /// Client: write an object (specifier 1).
    InitiateDownload {
        /// Object to write.
        object: ObjectAddress,
        /// Data or size.
        payload: InitiateData<'a>,
    },
    /// Server: object accepted (3).
    DownloadInitiated {
        /// Object written.
        object: ObjectAddress,
    },
    /// Client: data of a segmented download (0).
    DownloadSegment(SdoSegment<'a>),
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
        /// Object read.
        object: ObjectAddress,
        /// Data or size.
        payload: InitiateData<'a>,
    },
    /// Client: request for the next segment (3).
    RequestUploadSegment {
        /// Toggle bit.
        toggle: bool,
    },
    /// Server: data of a segmented upload (0).
    UploadSegment(SdoSegment<'a>),
    /// Client: block download of an object (6, sub 0).
    InitiateBlockDownload {
        /// Object to write.
        object: ObjectAddress,
        /// Whether the client supports CRC.
        crc: bool,
        /// Size in bytes, if indicated.
        size: Option<u32>,
    },
    /// Server: ready for blocks (5, sub 0).
    BlockDownloadInitiated {
        /// Object written.
        object: ObjectAddress,
        /// Whether the server supports CRC.
        crc: bool,
        /// Segments per block, 1..=127.
        block_size: u8,
    },
    /// Server: block acknowledged (5, sub 2).
    BlockDownloadAcknowledged {
        /// Sequence number of the last segment received in order.
        sequence: u8,
        /// Segments in the next block.
        block_size: u8,
    },
    /// Client: end of a block download (6, sub 1).
    EndBlockDownload(BlockEnd),
    /// Server: end of a block download confirmed (5, sub 1).
    BlockDownloadEnded,
    /// Client: block upload of an object (5, sub 0).
    InitiateBlockUpload {
        /// Object to read.
        object: ObjectAddress,
        /// Whether the client supports CRC.
        crc: bool,
        /// Segments per block, 1..=127.
        block_size: u8,
        /// Max size in bytes for which the server may use segmented transfer instead.
        switch_threshold: u8,
    },
    /// Server: ready for the block upload (6, sub 0).
    BlockUploadInitiated {
        /// Object read.
        object: ObjectAddress,
        /// Whether the server supports CRC.
        crc: bool,
        /// Size in bytes, if indicated.
        size: Option<u32>,
    },
    /// Client: start of the block upload (5, sub 3).
    StartBlockUpload,
    /// Client: block acknowledged (5, sub 2).
    BlockUploadAcknowledged {
        /// Sequence number of the last segment received in order.
        sequence: u8,
        /// Segments in the next block.
        block_size: u8,
    },
    /// Server: end of a block upload (6, sub 1).
    EndBlockUpload(BlockEnd),
    /// Client: end of a block upload confirmed (5, sub 1).
    BlockUploadEnded,
    /// Client or server: a segment of a block.
    BlockSegment {
        /// Sequence number 1..=127, restarts at 1 in each block; 0 is invalid.
        sequence: u8,
        /// Whether this is the last segment.
        last: bool,
        /// Seven bytes; the end message contains the number of unused bytes in the last segment.
        data: &'a [u8],
    },
    /// Client or server: transfer aborted (4).
    Abort {
        /// Object in the abort message.
        object: ObjectAddress,
        /// Abort code.
        code: u32,
    },
    /// A command specifier that CiA 301 does not define for this sender.
    Unknown {
        /// Byte 0 as sent.
        command: u8,
    },
}

impl SdoMessage<'_> {
    /// Whether this is a request that starts a transfer.
    pub const fn starts_transfer(&self) -> bool {
        matches!(
            self,
            Self::InitiateDownload { .. }
                | Self::InitiateUpload { .. }
                | Self::InitiateBlockDownload { .. }
                | Self::InitiateBlockUpload { .. }
        )
    }

    /// Whether the message belongs to an upload; `None` if the message does not show it.
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

    /// Object in the message; `None` if the message type has no object.
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
pub struct SdoSegment<'a> {
    /// Toggle bit: clear in the first segment, then alternating.
    pub toggle: bool,
    /// Whether this is the last segment.
    pub last: bool,
    /// One to seven bytes; no bytes for an empty object.
    pub data: &'a [u8],
}

/// End of a block transfer.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct BlockEnd {
    /// Unused bytes in the last segment, 0..=7.
    pub unused: u8,
    /// CRC-16 over the object's data; valid only if client and server support CRC.
    pub crc: u16,
}
