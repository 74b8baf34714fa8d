//! SDO messages as text.

use super::{InitiateData, SdoMessage, SdoSegment};
use crate::words::count_noun;

impl SdoMessage<'_> {
    /// The message as one line of text.
    pub fn message_text(&self) -> String {
        let toggle = |toggle: bool| u8::from(toggle);
        match *self {
            Self::InitiateDownload { object, payload } => {
                format!("initiate download of {object}, {}", payload.message_text())
            }
            Self::DownloadInitiated { object } => format!("download of {object} accepted"),
            Self::DownloadSegment(segment) => format!("download segment, {}", segment.message_text()),
            Self::DownloadSegmentAccepted { toggle: bit } => {
                format!("download segment accepted, toggle {}", toggle(bit))
            }
            Self::InitiateUpload { object } => format!("initiate upload of {object}"),
            Self::UploadInitiated { object, payload } => {
                format!("upload of {object}, {}", payload.message_text())
            }
            Self::RequestUploadSegment { toggle: bit } => {
                format!("request for upload segment, toggle {}", toggle(bit))
            }
            Self::UploadSegment(segment) => format!("upload segment, {}", segment.message_text()),
            Self::Abort { object, code } => format!("abort of {object}, code {code:08X}"),
            Self::Unknown { command } => format!("unknown command specifier, byte 0 is {command:02X}"),
            _ => self.describe_block(),
        }
    }

    fn describe_block(&self) -> String {
        let bytes =
            |size: Option<u32>| size.map_or("size not indicated".into(), |size| count_noun(size, "byte"));
        let crc = |crc: bool| if crc { "CRC" } else { "no CRC" };
        match *self {
            Self::InitiateBlockDownload { object, crc: with, size } => {
                format!("initiate block download of {object}, {}, {}", bytes(size), crc(with))
            }
            Self::BlockDownloadInitiated { object, crc: with, block_size } => {
                format!("block download of {object} accepted, {block_size} segments/block, {}", crc(with))
            }
            Self::InitiateBlockUpload { object, crc: with, block_size, .. } => {
                format!("initiate block upload of {object}, {block_size} segments/block, {}", crc(with))
            }
            Self::BlockUploadInitiated { object, crc: with, size } => {
                format!("block upload of {object}, {}, {}", bytes(size), crc(with))
            }
            Self::BlockDownloadAcknowledged { sequence, block_size }
            | Self::BlockUploadAcknowledged { sequence, block_size } => {
                format!("block acknowledged up to segment {sequence}, next block {block_size} segments")
            }
            Self::EndBlockDownload(end) | Self::EndBlockUpload(end) => {
                format!(
                    "end of block transfer, {} unused in the last segment, CRC {:04X}",
                    count_noun(end.unused, "byte"),
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

impl InitiateData<'_> {
    fn message_text(&self) -> String {
        match self {
            Self::Expedited { data, sized: true } => format!("expedited, {}", count_noun(data.len(), "byte")),
            Self::Expedited { data, sized: false } => {
                format!("expedited, size not indicated, max {}", count_noun(data.len(), "byte"))
            }
            Self::Segmented { size: Some(size) } => format!("segmented, {}", count_noun(*size, "byte")),
            Self::Segmented { size: None } => "segmented, size not indicated".into(),
        }
    }
}

impl SdoSegment<'_> {
    fn message_text(&self) -> String {
        let last = if self.last { ", last segment" } else { "" };
        format!("toggle {}, {}{last}", u8::from(self.toggle), count_noun(self.data.len(), "byte"))
    }
}
