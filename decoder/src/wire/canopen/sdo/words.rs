//! SDO messages in words, for people.

use super::{Payload, Sdo, Segment};
use crate::words::plural;

impl Sdo<'_> {
    /// The message in words, for people.
    pub fn describe(&self) -> String {
        let toggle = |toggle: bool| u8::from(toggle);
        match *self {
            Self::InitiateDownload { object, payload } => {
                format!("initiate download of {object}, {}", payload.describe())
            }
            Self::DownloadInitiated { object } => format!("download of {object} accepted"),
            Self::DownloadSegment(segment) => format!("download segment, {}", segment.describe()),
            Self::DownloadSegmentAccepted { toggle: bit } => {
                format!("download segment accepted, toggle {}", toggle(bit))
            }
            Self::InitiateUpload { object } => format!("initiate upload of {object}"),
            Self::UploadInitiated { object, payload } => {
                format!("upload of {object}, {}", payload.describe())
            }
            Self::RequestUploadSegment { toggle: bit } => {
                format!("ask for an upload segment, toggle {}", toggle(bit))
            }
            Self::UploadSegment(segment) => format!("upload segment, {}", segment.describe()),
            Self::Abort { object, code } => format!("abort of {object}, code {code:08X}"),
            Self::Unknown { command } => format!("unknown command specifier, byte 0 is {command:02X}"),
            _ => self.describe_block(),
        }
    }

    fn describe_block(&self) -> String {
        let bytes = |size: Option<u32>| size.map_or("size not said".into(), |size| plural(size, "byte"));
        let crc = |crc: bool| if crc { "CRC" } else { "no CRC" };
        match *self {
            Self::InitiateBlockDownload { object, crc: with, size } => {
                format!("initiate block download of {object}, {}, {}", bytes(size), crc(with))
            }
            Self::BlockDownloadInitiated { object, crc: with, block_size } => {
                format!("block download of {object} accepted, {block_size} segments a block, {}", crc(with))
            }
            Self::InitiateBlockUpload { object, crc: with, block_size, .. } => {
                format!("initiate block upload of {object}, {block_size} segments a block, {}", crc(with))
            }
            Self::BlockUploadInitiated { object, crc: with, size } => {
                format!("block upload of {object}, {}, {}", bytes(size), crc(with))
            }
            Self::BlockDownloadAcknowledged { sequence, block_size }
            | Self::BlockUploadAcknowledged { sequence, block_size } => {
                format!("block acknowledged up to segment {sequence}, next block of {block_size}")
            }
            Self::EndBlockDownload(end) | Self::EndBlockUpload(end) => {
                format!(
                    "end of block transfer, {} of the last segment unused, CRC {:04X}",
                    plural(end.unused, "byte"),
                    end.crc
                )
            }
            Self::StartBlockUpload => "start of block upload".into(),
            Self::BlockDownloadEnded | Self::BlockUploadEnded => "end of block transfer confirmed".into(),
            Self::BlockSegment { sequence, .. } => format!("segment {sequence} of a block"),
            _ => String::new(),
        }
    }
}

impl Payload<'_> {
    fn describe(&self) -> String {
        match self {
            Self::Expedited { data, sized: true } => format!("expedited, {}", plural(data.len(), "byte")),
            Self::Expedited { data, sized: false } => {
                format!("expedited, size not said, {} there", plural(data.len(), "byte"))
            }
            Self::Segmented { size: Some(size) } => format!("segmented, {}", plural(*size, "byte")),
            Self::Segmented { size: None } => "segmented, size not said".into(),
        }
    }
}

impl Segment<'_> {
    fn describe(&self) -> String {
        let last = if self.last { ", the last one" } else { "" };
        format!("toggle {}, {}{last}", u8::from(self.toggle), plural(self.data.len(), "byte"))
    }
}
