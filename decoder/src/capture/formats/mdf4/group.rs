//! The groups of a capture, and which of them hold frames.
//!
//! ```text
//! HD ─▶ DG ─▶ DG …          links of DG: 0 next  1 first CG  2 data;  byte 0: size of a record's number
//!       └▶ CG ─▶ CG …       links of CG: 0 next  1 first CN  2 name
//!          └▶ CN ─▶ CN …    links of CN: 0 next  1 first of its members  2 name  4 conversion  5 data
//!
//! CG   0 record number (8)  8 records (8)  16 flags (2): 1 values of variable length
//!     24 bytes of a record (4)  28 bytes behind them that say what is valid (4)
//! CN   0 kind (1)  1 kind of axis (1)  2 data type (1)  3 bit (1)  4 byte (4)  8 bits (4)
//! ```
//! Records of one group stand behind one another; of several, each begins with the number of its group.

use std::collections::BTreeSet;

use super::block::{Block, text};
use super::field::{Clock, Field};
use super::stream::Damage;

/// Groups, and channels of a group, that are looked at.
const MOST_GROUPS: usize = 65_536;
const MOST_CHANNELS: usize = 4_096;

/// Flag of a group.
const VARIABLE_LENGTH: u16 = 1;

const MASTER: u8 = 2;
const VIRTUAL_MASTER: u8 = 3;
const TIME: u8 = 1;

/// Largest record that can be one of a frame.
const LARGEST_RECORD: u64 = 64 * 1024;

/// What the records of a group are.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum Kind {
    Data,
    Remote,
    Error,
    Overload,
}

/// Beginnings of the names of channels, by the standard for bus logging.
const KINDS: &[(&[u8], Kind)] = &[
    (b"CAN_DataFrame", Kind::Data),
    (b"CAN_RemoteFrame", Kind::Remote),
    (b"CAN_ErrorFrame", Kind::Error),
    (b"CAN_OverloadFrame", Kind::Overload),
];

/// Fields of a record that are read, by the ends of their channels' names.
#[derive(Debug, Clone, Copy, Default)]
pub(super) struct Fields {
    pub(super) channel: Option<Field>,
    pub(super) id: Option<Field>,
    pub(super) extended: Option<Field>,
    pub(super) dlc: Option<Field>,
    pub(super) length: Option<Field>,
    pub(super) data: Option<Field>,
    pub(super) direction: Option<Field>,
    pub(super) is_fd: Option<Field>,
    pub(super) bit_rate_switch: Option<Field>,
    pub(super) error_state: Option<Field>,
    pub(super) error: Option<Field>,
}

impl Fields {
    fn of(&mut self, name: &[u8]) -> Option<&mut Option<Field>> {
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

/// What a group's channels say.
#[derive(Debug, Clone, Copy)]
pub(super) struct Frames {
    pub(super) kind: Kind,
    pub(super) fields: Fields,
    pub(super) clock: Option<Clock>,
    /// Where the values of variable length are.
    pub(super) values: Option<u64>,
}

/// Size of the records of a group.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum Size {
    /// So many bytes.
    Fixed(u64),
    /// As many as stand before them.
    Variable,
}

/// A group of records.
#[derive(Debug)]
pub(super) struct Group {
    /// Byte offset of its block.
    pub(super) at: u64,
    pub(super) number: u64,
    pub(super) records: u64,
    pub(super) size: Size,
    pub(super) name: Vec<u8>,
    /// Its frames, if that is what it holds.
    pub(super) frames: Option<Frames>,
}

/// Groups with common data.
#[derive(Debug)]
pub(super) struct DataGroup {
    pub(super) at: u64,
    pub(super) data: Option<u64>,
    /// Bytes of the number before each record.
    pub(super) number_size: usize,
    pub(super) groups: Vec<Group>,
}

/// Reads the descriptions, and remembers where they are.
#[derive(Default)]
pub(super) struct Reading {
    pub(super) seen: BTreeSet<u64>,
    pub(super) damages: Vec<Damage>,
}

impl Reading {
    /// All groups behind a link.
    pub(super) fn data_groups(&mut self, file: &[u8], first: Option<u64>) -> Vec<DataGroup> {
        let mut found = Vec::new();
        let mut next = first;
        while let Some(block) = self.follow(file, next, *b"DG", "a group of data") {
            let number_size = usize::from(block.u8(0).unwrap_or(0));
            let groups = self.groups(file, block.link(1));
            if matches!(number_size, 0 | 1 | 2 | 4 | 8) {
                found.push(DataGroup { at: block.at, data: block.link(2), number_size, groups });
            } else {
                let reason =
                    format!("numbers of {number_size} bytes before records, expected 0, 1, 2, 4 or 8");
                self.damages.push((block.at, reason));
            }
            next = block.link(0);
        }
        found
    }

    fn follow<'a>(
        &mut self,
        file: &'a [u8],
        link: Option<u64>,
        kind: [u8; 2],
        what: &str,
    ) -> Option<Block<'a>> {
        let link = link?;
        let block = Block::of(file, link, kind);
        let reason = match block {
            None => format!("no description of {what} where one should be"),
            Some(_) if self.seen.len() >= MOST_GROUPS * 16 => format!("too many descriptions to read {what}"),
            Some(_) if !self.seen.insert(link) => format!("a description of {what} that is there twice"),
            Some(_) => return block,
        };
        self.damages.push((link, reason));
        None
    }

    fn groups(&mut self, file: &[u8], first: Option<u64>) -> Vec<Group> {
        let mut found = Vec::new();
        let mut next = first;
        while let Some(block) = self.follow(file, next, *b"CG", "a group")
            && found.len() < MOST_GROUPS
        {
            next = block.link(0);
            let numbers = (block.u64(0), block.u64(8), block.u16(16), block.u32(24), block.u32(28));
            let (Some(number), Some(records), Some(flags), Some(bytes), Some(validity)) = numbers else {
                self.damages.push((block.at, "a description of a group that is too short".into()));
                continue;
            };
            let has_channels = block.link(1).is_some();
            let size = if flags & VARIABLE_LENGTH != 0 && !has_channels {
                Size::Variable
            } else {
                Size::Fixed(u64::from(bytes) + u64::from(validity))
            };
            if flags & VARIABLE_LENGTH != 0 && has_channels {
                self.damages
                    .push((block.at, "a group of values that has channels: taken for one of records".into()));
            }
            let frames = match size {
                Size::Fixed(1..=LARGEST_RECORD) => self.frames(file, block.link(1)),
                _ => None,
            };
            let name = text(file, block.link(2)).unwrap_or_default().to_vec();
            found.push(Group { at: block.at, number, records, size, name, frames });
        }
        found
    }

    /// What the channels behind a link say, if they are those of frames.
    fn frames(&mut self, file: &[u8], first: Option<u64>) -> Option<Frames> {
        let (mut fields, mut clock, mut kind, mut values) = (Fields::default(), None, None, None);
        let mut links = vec![first];
        let mut left = MOST_CHANNELS;
        while let Some(link) = links.pop() {
            let Some(channel) = self.follow(file, link, *b"CN", "a channel") else { continue };
            left = left.checked_sub(1)?;
            links.push(channel.link(0));
            // Members may also be of another kind of block: arrays, which no frame has.
            links.push(channel.link(1).filter(|link| Block::of(file, *link, *b"CN").is_some()));
            if matches!(channel.u8(0), Some(MASTER | VIRTUAL_MASTER)) && channel.u8(1) == Some(TIME) {
                clock = Clock::new(file, &channel);
                if clock.is_none() {
                    let reason = "times with a conversion that is not linear: frames have none";
                    self.damages.push((channel.at, reason.into()));
                }
            }
            let name = text(file, channel.link(2)).unwrap_or_default();
            let known = KINDS.iter().find(|(start, _)| name.starts_with(start));
            let (Some((_, of)), Some(field)) = (known, Field::new(&channel)) else { continue };
            kind = kind.or(Some(*of));
            let end = name.rsplit(|byte| *byte == b'.').next().unwrap_or_default();
            if let Some(place) = fields.of(end) {
                *place = Some(field);
                if end == b"DataBytes" && field.is_variable() {
                    values = channel.link(5);
                }
            }
        }
        let is_complete = kind != Some(Kind::Data) || (fields.id.is_some() && fields.data.is_some());
        kind.filter(|_| is_complete).map(|kind| Frames { kind, fields, clock, values })
    }
}
