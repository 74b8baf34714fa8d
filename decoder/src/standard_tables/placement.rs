//! Places of the fields in one payload: lengths of texts, repetitions, keyed values.

use super::definition::{DefinitionLine, GroupDefinition};
use super::field::FieldDefinition;
use super::kind::{FieldKind, KindColumn};
use super::place::{FieldOrigin, FieldPlace};
use super::standard::referenced_field;
use crate::frame::low_bits;
use crate::profile::little_endian;

/// Max fields of a payload: those of a full message of J1939-21 with one byte each.
const MOST_FIELDS: usize = 1785;

/// Position in a payload while its fields are placed.
pub(super) struct PlacementWalk<'a> {
    definition: &'a GroupDefinition,
    payload: &'a [u8],
    bit: usize,
    places: Vec<FieldPlace>,
    /// Last number of each line.
    numbers: Vec<u64>,
    /// Last key, with its line.
    key: Option<(u16, u64)>,
    /// Length of the next keyed value in bytes.
    length: Option<u64>,
    /// Last number of a group, and last number of a field.
    reference: (u64, u64),
}

/// Content of a field within its length.
struct FieldExtent {
    /// Bits before and after the content, such as the length of a text.
    before: usize,
    bits: usize,
    after: usize,
    is_wide: bool,
}

impl FieldExtent {
    const fn new(bits: usize) -> Self {
        Self { before: 0, bits, after: 0, is_wide: false }
    }
}

impl<'a> PlacementWalk<'a> {
    /// Places of all fields that the payload contains.
    pub(super) fn place_fields(definition: &'a GroupDefinition, payload: &'a [u8]) -> Vec<FieldPlace> {
        let numbers = vec![0; definition.lines.len()];
        let (places, key, length) = (Vec::new(), None, None);
        let mut walk = Self { definition, payload, bit: 0, places, numbers, key, length, reference: (0, 0) };
        // An incomplete field ends the walk; the fields before it are valid.
        let _ = walk.place_all();
        walk.places
    }

    fn place_all(&mut self) -> Option<()> {
        let mut line = 0;
        while let Some(next) = self.definition.lines.get(line) {
            match next {
                DefinitionLine::Field(field) => {
                    self.place_line(line, field, 0)?;
                    line = line.checked_add(1)?;
                }
                DefinitionLine::Repeat { count, fields } => {
                    let first = line.checked_add(1)?;
                    line = first.checked_add(*fields)?;
                    self.place_repetitions(first..line, self.repetitions(*count))?;
                }
            }
        }
        Some(())
    }

    /// Number of repetitions; 0 if the count is unavailable.
    fn repetitions(&self, count: Option<usize>) -> u64 {
        let Some(line) = count else { return u64::MAX };
        let number = self.numbers.get(line).copied().unwrap_or(0);
        let bits = self.definition.field(line).map_or(0, |field| field.column.bits);
        if number == low_bits(u32::from(bits)) { 0 } else { number }
    }

    fn place_repetitions(&mut self, lines: std::ops::Range<usize>, count: u64) -> Option<()> {
        let mut repetition: u16 = 0;
        while u64::from(repetition) < count && self.bit < self.payload.len().checked_mul(8)? {
            let start = self.bit;
            repetition = repetition.checked_add(1)?;
            for line in lines.clone() {
                let field = self.definition.field(line)?;
                self.place_line(line, field, repetition)?;
            }
            if self.bit == start {
                return None;
            }
        }
        Some(())
    }

    fn place_line(&mut self, line: usize, field: &'a FieldDefinition, repetition: u16) -> Option<()> {
        let (origin, field) = self.resolve_field(field);
        let mut extent = self.extent_of(field)?;
        if let (FieldOrigin::Key { .. }, Some(length)) = (origin, self.length) {
            // The length of the message has precedence over that of the key.
            let bits = usize::try_from(length).ok()?.checked_mul(8)?;
            extent.bits = extent.bits.min(bits);
            extent.after = bits.saturating_sub(extent.bits);
        }
        if let FieldOrigin::Group { .. } = origin {
            // Each value of a group function starts at a byte.
            extent.after = (8 - extent.bits % 8) % 8;
        }
        let bit = self.bit.checked_add(extent.before)?;
        let end = bit.checked_add(extent.bits)?;
        if end > self.payload.len().checked_mul(8)? || self.places.len() >= MOST_FIELDS {
            return None;
        }
        if matches!(field.column.kind, FieldKind::Gap) || extent.bits == 0 && !field.column.kind.is_text() {
            self.bit = end.checked_add(extent.after)?;
            return Some(());
        }
        self.note_number(line, field.column, bit, extent.bits);
        self.places.push(FieldPlace {
            line: u16::try_from(line).ok()?,
            repetition,
            bit: u16::try_from(bit).ok()?,
            bits: u16::try_from(extent.bits).ok()?,
            is_wide: extent.is_wide,
            origin,
        });
        self.bit = end.checked_add(extent.after)?;
        Some(())
    }

    /// Definition of the value at a line: its own, or that of a key or of a field of another group.
    fn resolve_field(&self, field: &'a FieldDefinition) -> (FieldOrigin, &'a FieldDefinition) {
        match field.column.kind {
            FieldKind::KeyedValue => {
                let found = self.key.and_then(|(line, key)| {
                    let table = self.definition.field(usize::from(line))?.table?;
                    Some((FieldOrigin::Key { line, key }, table.key_entry(key, self.definition.tables)?))
                });
                found.unwrap_or((FieldOrigin::Line, field))
            }
            FieldKind::Referenced => {
                let (group, number) = self.reference;
                let found =
                    u32::try_from(group).ok().zip(u8::try_from(number).ok()).and_then(|(group, number)| {
                        let origin = FieldOrigin::Group { number: group, field: number };
                        Some((origin, referenced_field(group, number)?))
                    });
                found.unwrap_or((FieldOrigin::Line, field))
            }
            _ => (FieldOrigin::Line, field),
        }
    }

    /// Length of a field at the present position.
    fn extent_of(&self, field: &FieldDefinition) -> Option<FieldExtent> {
        let KindColumn { kind, bits, length_line, .. } = field.column;
        let left = self.payload.len().checked_mul(8)?.checked_sub(self.bit)?;
        let bits = usize::from(bits);
        Some(match kind {
            FieldKind::EncodedText => self.encoded_text()?,
            FieldKind::CountedText => self.counted_text()?,
            FieldKind::DelimitedText => self.delimited_text()?,
            FieldKind::Bytes if length_line.is_some() => {
                let number = length_line.and_then(|line| self.numbers.get(line).copied()).unwrap_or(0);
                FieldExtent::new(usize::try_from(number).ok()?.min(left))
            }
            // Short messages end within their last text.
            FieldKind::Text | FieldKind::Bytes | FieldKind::Digits if bits == 0 => FieldExtent::new(left),
            FieldKind::Text | FieldKind::Bytes => FieldExtent::new(bits.min(left)),
            // Nothing is known about the value: its length ends it, or the payload.
            FieldKind::KeyedValue | FieldKind::Referenced => FieldExtent::new(self.value_bits(left)),
            _ => FieldExtent::new(bits),
        })
    }

    fn value_bits(&self, left: usize) -> usize {
        let length = self.length.and_then(|length| usize::try_from(length).ok()?.checked_mul(8));
        length.unwrap_or(left).min(left)
    }

    /// Bytes from the present position on; `None` within a byte.
    fn bytes_left(&self) -> Option<&'a [u8]> {
        self.bit.is_multiple_of(8).then(|| self.payload.get(self.bit / 8..)).flatten()
    }

    /// Length with itself and the encoding, encoding (0: two bytes per character), characters.
    fn encoded_text(&self) -> Option<FieldExtent> {
        let [length, encoding, characters @ ..] = self.bytes_left()? else { return None };
        // A text that the message cuts off is as long as the message.
        let length = usize::from(*length).checked_sub(2)?.min(characters.len());
        Some(FieldExtent { before: 16, bits: length * 8, after: 0, is_wide: *encoding == 0 })
    }

    /// Length, characters, a zero that the length does not count.
    fn counted_text(&self) -> Option<FieldExtent> {
        let [length, characters @ ..] = self.bytes_left()? else { return None };
        let length = usize::from(*length).min(characters.len());
        let after = if characters.get(length) == Some(&0) { 8 } else { 0 };
        Some(FieldExtent { before: 8, bits: length * 8, after, is_wide: false })
    }

    /// Characters up to an asterisk, or to the end.
    fn delimited_text(&self) -> Option<FieldExtent> {
        let bytes = self.bytes_left().filter(|bytes| !bytes.is_empty())?;
        let (length, after) = match bytes.iter().position(|byte| *byte == b'*') {
            Some(place) => (place, 8),
            None => (bytes.len(), 0),
        };
        Some(FieldExtent { before: 0, bits: length.checked_mul(8)?, after, is_wide: false })
    }

    /// Stores a number that later fields depend on.
    fn note_number(&mut self, line: usize, column: KindColumn, bit: usize, bits: usize) {
        let is_number = (1..=64).contains(&bits) && !column.kind.is_text();
        let first = bit / 8;
        let end = bit.saturating_add(bits).div_ceil(8);
        // Numbers that other fields depend on have at most 24 bits, within eight bytes.
        let Some(bytes) = self.payload.get(first..end).filter(|bytes| is_number && bytes.len() <= 8) else {
            return;
        };
        let bits = u32::try_from(bits).unwrap_or(64);
        let number = little_endian(bytes) >> (bit % 8) & low_bits(bits);
        if let Some(last) = self.numbers.get_mut(line) {
            *last = number;
        }
        match column.kind {
            FieldKind::Key => {
                (self.key, self.length) = (u16::try_from(line).ok().map(|line| (line, number)), None);
            }
            FieldKind::Length => self.length = Some(number.saturating_sub(column.overhead)),
            FieldKind::Group => self.reference.0 = number,
            FieldKind::Unsigned => self.reference.1 = number,
            _ => {}
        }
    }
}
