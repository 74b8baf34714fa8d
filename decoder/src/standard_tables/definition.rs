//! Definitions of groups: name, variants and fields, as their lines state them.

use std::collections::HashMap;
use std::sync::{Arc, Mutex};

use foldhash::fast::FixedState;

use super::field::{FieldDefinition, ValueTables};
use super::kind::{FieldKind, KindColumn};
use super::place::FieldPlace;
use crate::frame::low_bits;
use crate::profile::{PayloadLayout, little_endian};

/// Layouts of one definition; more lengths of a hostile sender are not stored.
pub(super) const MOST_LAYOUTS: usize = 64;

/// One definition of a group. A group of several manufacturers has one for each of their messages.
pub(super) struct GroupDefinition {
    pub(super) name: Arc<str>,
    pub(super) is_fast: bool,
    pub(super) lines: Vec<DefinitionLine>,
    matches: Vec<RequiredNumber>,
    /// Value tables of the file.
    pub(super) tables: &'static ValueTables,
    /// Total length in bits, if it does not depend on the payload.
    pub(super) fixed_bits: Option<u16>,
    /// Layouts by the places of the fields.
    pub(super) layouts: LayoutCache,
}

/// Layouts by the places of the fields.
pub(super) type LayoutCache = Mutex<HashMap<Vec<FieldPlace>, Arc<PayloadLayout>, FixedState>>;

/// A line of a definition.
#[derive(Debug)]
pub(super) enum DefinitionLine {
    Field(Box<FieldDefinition>),
    /// The next `fields` lines repeat: as often as the number of line `count`, or up to the end of the payload.
    Repeat {
        count: Option<usize>,
        fields: usize,
    },
}

/// Number that selects a definition.
#[derive(Debug, Clone, Copy)]
struct RequiredNumber {
    bit: u16,
    bits: u16,
    number: u64,
}

impl RequiredNumber {
    fn is_in(self, payload: &[u8]) -> bool {
        let first = usize::from(self.bit / 8);
        let end = usize::from(self.bit.saturating_add(self.bits).div_ceil(8));
        let Some(bytes) = payload.get(first..end) else { return false };
        little_endian(bytes) >> (self.bit % 8) & low_bits(u32::from(self.bits)) == self.number
    }
}

/// Definitions in the lines of one group.
pub(super) fn parse_groups(lines: &'static str, tables: &'static ValueTables) -> Vec<GroupDefinition> {
    let mut groups: Vec<GroupDefinition> = Vec::new();
    for line in lines.lines() {
        let mut columns = line.split('\t');
        let Some(first) = columns.next() else { continue };
        match (first, groups.last_mut()) {
            ("%G" | "%R", _) => groups.extend(GroupDefinition::parse_head(columns, tables)),
            ("%L" | "%B" | "%K", _) | (_, None) => {}
            (_, Some(group)) => group.lines.extend(DefinitionLine::parse_line(line, tables)),
        }
    }
    groups.iter_mut().for_each(GroupDefinition::locate_numbers);
    groups
}

impl DefinitionLine {
    fn parse_line(line: &'static str, tables: &'static ValueTables) -> Option<Self> {
        let mut columns = line.split('\t');
        if columns.next() == Some("%*") {
            let count = columns.next().and_then(|line| line.parse().ok());
            return Some(Self::Repeat { count, fields: columns.next()?.parse().ok()? });
        }
        FieldDefinition::parse_columns(line.split('\t'), tables).map(|field| Self::Field(Box::new(field)))
    }
}

impl GroupDefinition {
    fn parse_head(mut columns: std::str::Split<'static, char>, tables: &'static ValueTables) -> Option<Self> {
        Some(Self {
            // The number is the key of the index.
            is_fast: columns.nth(1)? == "F",
            name: columns.next().unwrap_or_default().into(),
            lines: Vec::new(),
            matches: Vec::new(),
            tables,
            fixed_bits: None,
            layouts: LayoutCache::default(),
        })
    }

    /// Sets the places of the required numbers and the length. Required numbers precede fields of a variable length.
    fn locate_numbers(&mut self) {
        let mut bit: u16 = 0;
        for line in &self.lines {
            let DefinitionLine::Field(field) = line else { return };
            let KindColumn { kind, bits, wanted, .. } = field.column;
            let is_fixed = bits > 0
                && !matches!(
                    kind,
                    FieldKind::EncodedText | FieldKind::CountedText | FieldKind::DelimitedText
                );
            if !is_fixed {
                return;
            }
            if let Some(number) = wanted {
                self.matches.push(RequiredNumber { bit, bits, number });
            }
            bit = bit.saturating_add(bits);
        }
        let depends = |line: &DefinitionLine| matches!(line, DefinitionLine::Field(field) if field.column.kind == FieldKind::Key);
        self.fixed_bits = (!self.lines.iter().any(depends)).then_some(bit);
    }

    /// Whether a payload has all required numbers.
    pub(super) fn matches_payload(&self, payload: &[u8]) -> bool {
        self.matches.iter().all(|required| required.is_in(payload))
    }

    /// Bits of the first eight bytes that decide whether this definition applies, and where its fields are.
    pub(super) fn deciding_bits(&self) -> u64 {
        if self.fixed_bits.is_none() {
            return u64::MAX;
        }
        let bits = self.matches.iter().map(|required| {
            low_bits(u32::from(required.bits)).checked_shl(u32::from(required.bit)).unwrap_or(0)
        });
        bits.fold(0, |all, bits| all | bits)
    }

    /// Field at a line.
    pub(super) fn field(&self, line: usize) -> Option<&FieldDefinition> {
        match self.lines.get(line)? {
            DefinitionLine::Field(field) => Some(field),
            DefinitionLine::Repeat { .. } => None,
        }
    }

    /// Field with this number, from 1, as messages refer to it; repeated fields count once.
    pub(super) fn numbered_field(&self, number: u64) -> Option<&FieldDefinition> {
        let fields = self.lines.iter().filter_map(|line| match line {
            DefinitionLine::Field(field) => Some(&**field),
            DefinitionLine::Repeat { .. } => None,
        });
        fields.into_iter().nth(usize::try_from(number.checked_sub(1)?).ok()?)
    }
}
