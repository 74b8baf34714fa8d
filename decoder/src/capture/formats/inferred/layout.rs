//! The layout of the lines: which column contains what, and how its text is read.

use std::fmt::Write as _;

use super::token::Dialect;
use crate::capture::column_list::{ColumnRole, ColumnUnit, MOST_COLUMNS};

/// Number of word positions that are counted from the last word before a column.
pub(super) const WORD_POSITIONS: usize = 8;

/// Slot of the words after the data; those after the next numbers have the slots before it.
pub(super) const LAST_SLOT: usize = MOST_COLUMNS - 1;

/// Number of slots after the data.
const SLOTS_AFTER: usize = 12;

/// Slot of the words after `count` columns after the data.
pub(super) fn slot_after(count: usize) -> usize {
    LAST_SLOT - count.min(SLOTS_AFTER - 1)
}

/// Whether a slot is one after the data.
pub(super) fn is_after(slot: usize) -> bool {
    slot > LAST_SLOT - SLOTS_AFTER
}

/// Layout of all lines of a capture.
#[derive(Debug, Clone, PartialEq, Eq, Default)]
pub(super) struct Layout {
    /// Separators.
    pub(super) dialect: Dialect,
    /// First word of a frame on several lines; `None` if each line is a frame.
    pub(super) record_start: Option<Vec<u8>>,
    /// Roles of the numbers before the data; with cells, of all cells.
    pub(super) before: Vec<ColumnRole>,
    /// Roles of the numbers after the data; empty with cells.
    pub(super) after: Vec<ColumnRole>,
    /// With cells, the last cell of the data.
    pub(super) last_data_cell: usize,
    /// Form of the data.
    pub(super) data: DataForm,
    /// Word before the data of each line, in lower case; without it, a line has no data.
    pub(super) data_label: Option<Vec<u8>>,
    /// Whether numbers may follow the columns after the data.
    pub(super) has_tail: bool,
    /// Form of identifiers.
    pub(super) id: IdentifierForm,
    /// Form of times; `None` without times.
    pub(super) time: Option<TimeForm>,
    /// Words with a meaning, by slot.
    pub(super) words: WordPlaces,
}

/// Form of the data.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub(super) struct DataForm {
    /// Whether the bytes follow each other without separator.
    pub(super) is_packed: bool,
    /// Whether the bytes are decimal.
    pub(super) is_decimal: bool,
    /// Whether a column contains the length.
    pub(super) has_length: bool,
    /// Whether a word names the data in each line.
    pub(super) has_label: bool,
    /// Separator between bytes, and the number of separators.
    pub(super) separator: (u8, u8),
    /// Width of a byte with the separators before it.
    pub(super) pitch: u8,
    /// Minimum and maximum number of bytes in the sample.
    pub(super) bytes: (u8, u8),
}

/// Form of identifiers.
#[derive(Debug, Clone, PartialEq, Eq, Default)]
pub(super) struct IdentifierForm {
    /// Whether identifiers are decimal.
    pub(super) is_decimal: bool,
    /// Whether more than four digits mark extended identifiers.
    pub(super) is_wide_extended: bool,
    /// Word before each identifier, in lower case.
    pub(super) label: Option<Vec<u8>>,
    /// Minimum number of digits: 3 if only the width distinguishes identifiers from bytes.
    pub(super) least_width: u8,
    /// Separator before each identifier, if all have the same.
    pub(super) gap: Option<u8>,
}

/// Form of times.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) struct TimeForm {
    /// Unit of numbers; `None` for times of day and dates.
    pub(super) unit: Option<ColumnUnit>,
    /// Whether times count from the frame before.
    pub(super) is_delta: bool,
    /// Whether a date precedes the day first.
    pub(super) has_date: bool,
}

impl WordPlaces {
    /// Positions and letters of a slot.
    pub(super) fn of_slot(&self, slot: usize) -> (u8, u8) {
        let of = |table: &[u8; MOST_COLUMNS]| table.get(slot).copied().unwrap_or(0);
        (of(&self.positions), of(&self.letters))
    }
}

/// Words with a meaning.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub(super) struct WordPlaces {
    /// Positions with a meaning, per slot: bit 0 is the last word of the slot, after the data the first one.
    pub(super) positions: [u8; MOST_COLUMNS],
    /// Pair of letters of a slot: index in the table plus 1.
    pub(super) letters: [u8; MOST_COLUMNS],
    /// Slot and position of the bus name.
    pub(super) bus: Option<(u8, u8)>,
}

impl Layout {
    /// Columns in the form of `--columns`.
    pub(super) fn columns_text(&self) -> String {
        let mut all: Vec<String> = Vec::new();
        let is_last = |index: usize| self.dialect.cell.is_some() && index > self.last_data_cell;
        let mut has_data = false;
        for (index, role) in self.before.iter().enumerate() {
            // The cells of one byte each are one column.
            if *role == ColumnRole::Data && std::mem::replace(&mut has_data, true) && !is_last(index) {
                continue;
            }
            all.push(self.role_text(*role));
        }
        if self.dialect.cell.is_none() {
            all.push(self.role_text(ColumnRole::Data));
        }
        all.extend(self.after.iter().map(|role| self.role_text(*role)));
        while all.last().is_some_and(|last| last == "skip") {
            all.pop();
        }
        all.join(" ")
    }

    fn role_text(&self, role: ColumnRole) -> String {
        let name = role.name();
        match role {
            ColumnRole::Time | ColumnRole::Delta => match self.time.and_then(|time| time.unit) {
                Some(unit) => format!("{name}:{}", unit.symbol()),
                None => name.into(),
            },
            ColumnRole::Id if self.id.is_decimal => format!("{name}:dec"),
            ColumnRole::Data if self.data.is_decimal => format!("{name}:dec"),
            _ => name.into(),
        }
    }

    /// Description of the columns: `time (ms), identifier, length, 8 bytes`.
    pub(super) fn describe_columns(&self) -> String {
        let mut text = String::new();
        let mut last = ColumnRole::Skip;
        let data = self.dialect.cell.is_none().then_some(ColumnRole::Data);
        for role in self.before.iter().copied().chain(data).chain(self.after.iter().copied()) {
            if role == ColumnRole::Data && last == ColumnRole::Data {
                continue;
            }
            last = role;
            let part = match role {
                ColumnRole::Skip | ColumnRole::Counter | ColumnRole::Kind | ColumnRole::Direction => continue,
                ColumnRole::Time => self.describe_time(),
                ColumnRole::Delta => format!("{} since the frame before", self.describe_time()),
                ColumnRole::Date => "date".into(),
                ColumnRole::Id if self.id.is_decimal => "identifier (decimal)".into(),
                ColumnRole::Id => "identifier".into(),
                ColumnRole::Length => "length".into(),
                ColumnRole::Bus => "bus".into(),
                ColumnRole::Extended => "extended".into(),
                ColumnRole::Remote => "remote".into(),
                ColumnRole::Data => self.describe_data(),
            };
            let separator = if text.is_empty() { "" } else { ", " };
            let _ = write!(text, "{separator}{part}");
        }
        if self.words.bus.is_some() {
            text.push_str(", bus name");
        }
        text
    }

    fn describe_time(&self) -> String {
        match self.time {
            Some(TimeForm { unit: Some(unit), .. }) => format!("time ({})", unit.symbol()),
            Some(TimeForm { has_date: true, .. }) => "date and time".into(),
            Some(_) => "time of day".into(),
            None => "time".into(),
        }
    }

    fn describe_data(&self) -> String {
        let base = if self.data.is_decimal { " (decimal)" } else { "" };
        match self.data.bytes {
            (1, 1) => format!("1 byte{base}"),
            (least, most) if least == most => format!("{most} bytes{base}"),
            (least, most) => format!("{least} to {most} bytes{base}"),
        }
    }
}
