//! Fields of a record, and conversion of times.

use super::block::MdfBlock;

/// Data types.
const UNSIGNED_BIG: u8 = 1;
const SIGNED_LITTLE: u8 = 2;
const SIGNED_BIG: u8 = 3;
const REAL_LITTLE: u8 = 4;
const REAL_BIG: u8 = 5;
const FIRST_TEXT: u8 = 6;
const LAST_TEXT: u8 = 9;

/// Channel types.
const VARIABLE: u8 = 1;
const VIRTUAL_MASTER: u8 = 3;
const VIRTUAL_DATA: u8 = 6;

/// Conversion type: a + b · x.
const LINEAR: u8 = 1;

const NANOSECONDS: f64 = 1e9;

/// Position and data type of a value in a record.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct RecordField {
    kind: u8,
    data_type: u8,
    bit_offset: u8,
    byte_offset: usize,
    bits: usize,
    /// Value of virtual data, which are not in the record: offset and factor of the record number.
    of_number: Option<(f64, f64)>,
}

/// A record, and its number in its group, from 0.
#[derive(Debug, Clone, Copy)]
pub(super) struct GroupRecord<'a> {
    pub(super) bytes: &'a [u8],
    pub(super) number: u64,
}

impl RecordField {
    /// Parses a channel block.
    pub(super) fn new(file: &[u8], channel: &MdfBlock<'_>) -> Option<Self> {
        let is_virtual = channel.u8(0)? == VIRTUAL_DATA;
        Some(Self {
            of_number: if is_virtual { Some(of_number(file, channel)?) } else { None },
            kind: channel.u8(0)?,
            data_type: channel.u8(2)?,
            bit_offset: channel.u8(3)?,
            byte_offset: usize::try_from(channel.u32(4)?).ok()?,
            bits: usize::try_from(channel.u32(8)?).ok()?,
        })
    }

    /// Whether the value is an offset of variable-length data.
    pub(super) fn is_variable(&self) -> bool {
        self.kind == VARIABLE
    }

    /// Value as an unsigned number, also of virtual data: the record number through the conversion.
    pub(super) fn number_of(&self, record: GroupRecord<'_>) -> Option<u64> {
        match self.of_number {
            #[expect(clippy::cast_precision_loss, reason = "the conversion uses these types")]
            Some((offset, factor)) => nearest_integer(offset + factor * record.number as f64)
                .and_then(|value| u64::try_from(value).ok()),
            None => self.read_number(record.bytes),
        }
    }

    /// Bytes of a field that consists of whole bytes.
    pub(super) fn field_bytes<'a>(&self, record: &'a [u8]) -> Option<&'a [u8]> {
        record.get(self.byte_offset..)?.get(..self.bits / 8)
    }

    /// Value as an unsigned number; the first byte of a text.
    pub(super) fn read_number(&self, record: &[u8]) -> Option<u64> {
        let bytes = record.get(self.byte_offset..)?;
        if (FIRST_TEXT..=LAST_TEXT).contains(&self.data_type) {
            return bytes.first().map(|byte| u64::from(*byte));
        }
        if self.bits == 0 || self.bits > 64 || self.bit_offset > 7 {
            return None;
        }
        let length = (usize::from(self.bit_offset) + self.bits).div_ceil(8);
        let bytes = bytes.get(..length)?;
        let is_big = matches!(self.data_type, UNSIGNED_BIG | SIGNED_BIG | REAL_BIG);
        let add = |number: u128, byte: &u8| number << 8 | u128::from(*byte);
        let number = if is_big { bytes.iter().fold(0, add) } else { bytes.iter().rev().fold(0, add) };
        let mask = u128::MAX >> (128 - self.bits);
        u64::try_from(number >> self.bit_offset & mask).ok()
    }

    /// Value as an integer or a real number.
    fn read_value(&self, record: &[u8], index: u64) -> Option<RecordValue> {
        if self.kind == VIRTUAL_MASTER {
            return i64::try_from(index).ok().map(RecordValue::Integer);
        }
        let number = self.read_number(record)?;
        match self.data_type {
            REAL_LITTLE | REAL_BIG if self.bits == 64 => Some(RecordValue::Real(f64::from_bits(number))),
            REAL_LITTLE | REAL_BIG => {
                let bits = u32::try_from(number).ok().filter(|_| self.bits == 32)?;
                Some(RecordValue::Real(f32::from_bits(bits).into()))
            }
            SIGNED_LITTLE | SIGNED_BIG => {
                let unused = 64_usize.checked_sub(self.bits)?;
                Some(RecordValue::Integer((number << unused).cast_signed() >> unused))
            }
            _ => i64::try_from(number).ok().map(RecordValue::Integer),
        }
    }
}

/// Offset and factor of a linear conversion; `None` if the conversion is not linear.
fn of_number(file: &[u8], channel: &MdfBlock<'_>) -> Option<(f64, f64)> {
    let Some(conversion) = channel.link_target(4) else { return Some((0.0, 1.0)) };
    let conversion = MdfBlock::parse_kind_at(file, conversion, *b"CC")?;
    let real = |at| conversion.u64(at).map(f64::from_bits);
    match conversion.u8(0)? {
        0 => Some((0.0, 1.0)),
        LINEAR => Some((real(24)?, real(32)?)),
        _ => None,
    }
}

#[derive(Debug, Clone, Copy)]
enum RecordValue {
    Integer(i64),
    Real(f64),
}

/// Converts the time field of records.
#[derive(Debug, Clone, Copy)]
pub(super) struct RecordClock {
    field: RecordField,
    /// Nanoseconds at value 0, and nanoseconds per unit of the value.
    offset: f64,
    step: f64,
}

impl RecordClock {
    /// Clock of a time channel with its conversion; `None` if the conversion is not linear.
    pub(super) fn new(file: &[u8], channel: &MdfBlock<'_>) -> Option<Self> {
        let field = RecordField::new(file, channel)?;
        let Some(conversion) = channel.link_target(4) else {
            return Some(Self { field, offset: 0.0, step: NANOSECONDS });
        };
        let conversion = MdfBlock::parse_kind_at(file, conversion, *b"CC")?;
        let real = |at| conversion.u64(at).map(f64::from_bits);
        match conversion.u8(0)? {
            0 => Some(Self { field, offset: 0.0, step: NANOSECONDS }),
            LINEAR => {
                let (offset, factor) = (real(24)? * NANOSECONDS, real(32)? * NANOSECONDS);
                // A factor of 1e-9 means exactly one nanosecond, without the rounding error of 1e-9.
                let whole = factor.round();
                let step = if (factor - whole).abs() <= whole.abs() * 1e-12 { whole } else { factor };
                Some(Self { field, offset, step })
            }
            _ => None,
        }
    }

    /// Time of the record with this index, in nanoseconds since the start of the capture.
    pub(super) fn record_time(&self, record: &[u8], index: u64) -> Option<i64> {
        match self.field.read_value(record, index)? {
            RecordValue::Integer(value) if self.offset == 0.0 && self.step.fract() == 0.0 => {
                value.checked_mul(nearest_integer(self.step)?)
            }
            #[expect(clippy::cast_precision_loss, reason = "the conversion uses these types")]
            RecordValue::Integer(value) => nearest_integer(self.offset + value as f64 * self.step),
            RecordValue::Real(value) => nearest_integer(self.offset + value * self.step),
        }
    }
}

/// The nearest integer; `None` if it is out of range.
#[expect(clippy::cast_possible_truncation, reason = "the range is checked")]
fn nearest_integer(value: f64) -> Option<i64> {
    (value.abs() < 9.2e18).then(|| value.round() as i64)
}

#[cfg(test)]
mod tests {
    use super::*;

    fn field(data_type: u8, byte_offset: usize, bit_offset: u8, bits: usize) -> RecordField {
        RecordField { kind: 0, data_type, bit_offset, byte_offset, bits, of_number: None }
    }

    #[test]
    fn bits_are_taken_from_where_they_stand() {
        // As written by CANedge: 29 bits from bit 3.
        let record = [0, 0x0B, 0x00, 0x00, 0x80, 0xFF];
        assert_eq!(field(0, 1, 3, 29).read_number(&record), Some(0x1000_0001));
        assert_eq!(field(0, 1, 0, 1).read_number(&record), Some(1));
        assert_eq!(field(1, 1, 0, 16).read_number(&record), Some(0x0B00));
        assert_eq!(field(0, 5, 4, 4).read_number(&record), Some(0xF));
        assert_eq!(field(0, 5, 4, 5).read_number(&record), None, "behind the end");
        assert_eq!(field(0, usize::MAX, 0, 8).read_number(&record), None);
        assert_eq!(field(6, 5, 0, 16).read_number(&record), Some(0xFF));
    }

    /// ASAM MDF 4.1, channel type 6: the raw value is the zero-based record number.
    #[test]
    fn virtual_data_are_the_record_number_through_the_conversion() {
        let value = |of_number, number| {
            let field = RecordField { kind: VIRTUAL_DATA, of_number: Some(of_number), ..field(0, 0, 0, 0) };
            field.number_of(GroupRecord { bytes: &[], number })
        };
        assert_eq!([0, 1, 900].map(|number| value((2.0, 0.0), number)), [Some(2); 3], "a constant bus");
        assert_eq!([0, 1, 900].map(|number| value((0.0, 1.0), number)), [Some(0), Some(1), Some(900)]);
        assert_eq!(value((-5.0, 1.0), 2), None);
        assert_eq!(value((f64::NAN, 1.0), 2), None);
        assert_eq!(value((1e300, 0.0), 2), None);
    }

    fn clock(data_type: u8, bits: usize, offset: f64, factor: f64) -> RecordClock {
        RecordClock { field: field(data_type, 0, 0, bits), offset: offset * 1e9, step: factor * 1e9 }
    }

    #[test]
    fn times_are_whole_nanoseconds() {
        let integer = clock(0, 64, 0.0, 1e-9);
        assert_eq!(
            integer.record_time(&9_007_199_254_740_993_u64.to_le_bytes(), 0),
            Some(9_007_199_254_740_993)
        );
        assert_eq!(clock(0, 32, 1.5, 1e-3).record_time(&7_u32.to_le_bytes(), 0), Some(1_507_000_000));
        assert_eq!(clock(4, 64, 0.0, 1.0).record_time(&0.1_f64.to_le_bytes(), 0), Some(100_000_000));
        assert_eq!(clock(5, 32, 0.0, 1.0).record_time(&0.5_f32.to_be_bytes(), 0), Some(500_000_000));
        assert_eq!(clock(2, 16, 0.0, 1.0).record_time(&(-2_i16).to_le_bytes(), 0), Some(-2_000_000_000));
        assert_eq!(clock(4, 64, 0.0, 1.0).record_time(&f64::NAN.to_le_bytes(), 0), None);
        assert_eq!(clock(4, 64, 0.0, 1.0).record_time(&1e300_f64.to_le_bytes(), 0), None);
    }
}
