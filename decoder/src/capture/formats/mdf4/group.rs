//! Groups of a capture, and detection of groups with frames.
//!
//! ```text
//! HD ─▶ DG ─▶ DG …          links of DG: 0 next  1 first CG  2 data;  byte 0: size of the record number
//!       └▶ CG ─▶ CG …       links of CG: 0 next  1 first CN  2 name
//!          └▶ CN ─▶ CN …    links of CN: 0 next  1 first member  2 name  4 conversion  5 data
//!
//! CG   0 record number (8)  8 records (8)  16 flags (2): 1 values of variable length
//!     24 record size (4)  28 size of the validity bits after it (4)
//! CN   0 channel type (1)  1 axis type (1)  2 data type (1)  3 bit (1)  4 byte (4)  8 bits (4)
//! ```
//! Records of a single group follow each other; with several groups, each record begins with the number of
//! its group.

use std::collections::BTreeSet;

use super::block::{MdfBlock, text_at};
use super::field::{RecordClock, RecordField};
use super::stream::{Damage, has_separate_validity};

/// Maximum number of groups, and of channels in a group.
const MOST_GROUPS: usize = 65_536;
const MOST_CHANNELS: usize = 4_096;

/// Flag of a group: values of variable length.
const VARIABLE_LENGTH: u16 = 1;
/// The master channel, here the time, is in another group (MDF 4.2).
const REMOTE_MASTER: u16 = 1 << 3;

const MASTER: u8 = 2;
const VIRTUAL_MASTER: u8 = 3;
const TIME: u8 = 1;

/// Maximum size of a record with a frame, in bytes.
const LARGEST_RECORD: u64 = 64 * 1024;

/// Content of a group's records.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum GroupContent {
    Data,
    Remote,
    Error,
    Overload,
}

/// Start of channel names in the bus logging standard.
const KINDS: &[(&[u8], GroupContent)] = &[
    (b"CAN_DataFrame", GroupContent::Data),
    (b"CAN_RemoteFrame", GroupContent::Remote),
    (b"CAN_ErrorFrame", GroupContent::Error),
    (b"CAN_OverloadFrame", GroupContent::Overload),
];

/// Fields of a record that are read, by the last part of the channel name.
#[derive(Debug, Clone, Copy, Default)]
pub(super) struct GroupFields {
    pub(super) channel: Option<RecordField>,
    pub(super) id: Option<RecordField>,
    pub(super) extended: Option<RecordField>,
    pub(super) dlc: Option<RecordField>,
    pub(super) length: Option<RecordField>,
    pub(super) data: Option<RecordField>,
    pub(super) direction: Option<RecordField>,
    pub(super) is_fd: Option<RecordField>,
    pub(super) bit_rate_switch: Option<RecordField>,
    pub(super) error_state: Option<RecordField>,
    pub(super) error: Option<RecordField>,
}

impl GroupFields {
    fn slot_of(&mut self, name: &[u8]) -> Option<&mut Option<RecordField>> {
        Some(match name {
            b"BusChannel" => &mut self.channel,
            b"ID" => &mut self.id,
            b"IDE" => &mut self.extended,
            b"DLC" => &mut self.dlc,
            b"DataLength" => &mut self.length,
            b"DataBytes" => &mut self.data,
            b"Dir" => &mut self.direction,
            b"EDL" => &mut self.is_fd,
            b"BRS" => &mut self.bit_rate_switch,
            b"ESI" => &mut self.error_state,
            b"ErrorType" => &mut self.error,
            _ => return None,
        })
    }
}

/// Description of a group of frames.
#[derive(Debug, Clone, Copy)]
pub(super) struct FrameGroup {
    pub(super) kind: GroupContent,
    pub(super) fields: GroupFields,
    pub(super) clock: Option<RecordClock>,
    /// Byte offset of the values of variable length.
    pub(super) values: Option<u64>,
}

/// Record size of a group.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum RecordSize {
    /// Fixed size in bytes.
    Fixed(u64),
    /// Variable size, stored before each record.
    Variable,
}

/// A channel group: records of the same layout.
#[derive(Debug)]
pub(super) struct ChannelGroup {
    /// Byte offset of the block.
    pub(super) at: u64,
    pub(super) number: u64,
    pub(super) records: u64,
    pub(super) size: RecordSize,
    pub(super) name: Vec<u8>,
    /// Description of the frames; `None` if the group contains other data.
    pub(super) frames: Option<FrameGroup>,
}

/// A data group: channel groups that share data.
#[derive(Debug)]
pub(super) struct DataGroup {
    pub(super) at: u64,
    pub(super) data: Option<u64>,
    /// Size of the group number before each record, in bytes.
    pub(super) number_size: usize,
    pub(super) groups: Vec<ChannelGroup>,
}

/// Reads the group blocks and stores their offsets to detect loops.
#[derive(Default)]
pub(super) struct GroupReader {
    pub(super) seen: BTreeSet<u64>,
    pub(super) damages: Vec<Damage>,
}

impl GroupReader {
    /// Reads all data groups of a linked list.
    pub(super) fn data_groups(&mut self, file: &[u8], first: Option<u64>) -> Vec<DataGroup> {
        let mut found = Vec::new();
        let mut next = first;
        while let Some(block) = self.follow_link(file, next, *b"DG", "data group") {
            let number_size = usize::from(block.u8(0).unwrap_or(0));
            let groups = self.read_groups(
                file,
                block.link_target(1),
                has_separate_validity(file, block.link_target(2)),
            );
            if matches!(number_size, 0 | 1 | 2 | 4 | 8) {
                found.push(DataGroup { at: block.at, data: block.link_target(2), number_size, groups });
            } else {
                let reason = format!("record number size {number_size}; expected 0, 1, 2, 4 or 8");
                self.damages.push((block.at, reason));
            }
            next = block.link_target(0);
        }
        found
    }

    fn follow_link<'a>(
        &mut self,
        file: &'a [u8],
        link: Option<u64>,
        kind: [u8; 2],
        what: &str,
    ) -> Option<MdfBlock<'a>> {
        let link = link?;
        let block = MdfBlock::parse_kind_at(file, link, kind);
        let reason = match block {
            None => format!("{what} block missing"),
            Some(_) if self.seen.len() >= MOST_GROUPS * 16 => {
                format!("{what} block skipped: more than {} blocks", MOST_GROUPS * 16)
            }
            Some(_) if !self.seen.insert(link) => format!("{what} block linked twice"),
            Some(_) => return block,
        };
        self.damages.push((link, reason));
        None
    }

    fn read_groups(
        &mut self,
        file: &[u8],
        first: Option<u64>,
        is_validity_separate: bool,
    ) -> Vec<ChannelGroup> {
        let mut found = Vec::new();
        let mut next = first;
        while let Some(block) = self.follow_link(file, next, *b"CG", "channel group")
            && found.len() < MOST_GROUPS
        {
            next = block.link_target(0);
            let numbers = (block.u64(0), block.u64(8), block.u16(16), block.u32(24), block.u32(28));
            let (Some(number), Some(records), Some(flags), Some(bytes), Some(validity)) = numbers else {
                self.damages.push((block.at, "channel group block too short".into()));
                continue;
            };
            let has_channels = block.link_target(1).is_some();
            let size = if flags & VARIABLE_LENGTH != 0 && !has_channels {
                RecordSize::Variable
            } else {
                RecordSize::Fixed(
                    u64::from(bytes) + u64::from(if is_validity_separate { 0 } else { validity }),
                )
            };
            if flags & REMOTE_MASTER != 0 {
                let reason =
                    "column storage: timestamps are in another group; frames of this group have none";
                self.damages.push((block.at, reason.into()));
            }
            if flags & VARIABLE_LENGTH != 0 && has_channels {
                self.damages.push((
                    block.at,
                    "variable-length group has channels: read as fixed-length records".into(),
                ));
            }
            let frames = match size {
                RecordSize::Fixed(1..=LARGEST_RECORD) => self.read_frame_group(file, block.link_target(1)),
                _ => None,
            };
            let name = text_at(file, block.link_target(2)).unwrap_or_default().to_vec();
            found.push(ChannelGroup { at: block.at, number, records, size, name, frames });
        }
        found
    }

    /// Reads a list of channels; `None` if they do not describe frames.
    fn read_frame_group(&mut self, file: &[u8], first: Option<u64>) -> Option<FrameGroup> {
        let (mut fields, mut clock, mut kind, mut values) = (GroupFields::default(), None, None, None);
        let mut links = vec![first];
        let mut left = MOST_CHANNELS;
        while let Some(link) = links.pop() {
            let Some(channel) = self.follow_link(file, link, *b"CN", "channel") else { continue };
            left = left.checked_sub(1)?;
            links.push(channel.link_target(0));
            // A member may also be an array block; frames contain no arrays.
            links.push(
                channel.link_target(1).filter(|link| MdfBlock::parse_kind_at(file, *link, *b"CN").is_some()),
            );
            if matches!(channel.u8(0), Some(MASTER | VIRTUAL_MASTER)) && channel.u8(1) == Some(TIME) {
                clock = RecordClock::new(file, &channel);
                if clock.is_none() {
                    let reason = "nonlinear time conversion: frames have no timestamps";
                    self.damages.push((channel.at, reason.into()));
                }
            }
            let name = text_at(file, channel.link_target(2)).unwrap_or_default();
            let known = KINDS.iter().find(|(start, _)| name.starts_with(start));
            let (Some((_, of)), Some(field)) = (known, RecordField::new(file, &channel)) else { continue };
            kind = kind.or(Some(*of));
            let end = name.rsplit(|byte| *byte == b'.').next().unwrap_or_default();
            if let Some(place) = fields.slot_of(end) {
                *place = Some(field);
                if end == b"DataBytes" && field.is_variable() {
                    values = channel.link_target(5);
                }
            }
        }
        let is_complete = kind != Some(GroupContent::Data) || (fields.id.is_some() && fields.data.is_some());
        kind.filter(|_| is_complete).map(|kind| FrameGroup { kind, fields, clock, values })
    }
}
