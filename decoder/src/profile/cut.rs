//! Fast extraction of integers from the first eight bytes of a payload, without the layout.

use super::data_type::DataType;
use super::layout::{BitOrder, SignalField};

/// Position of an integer within eight bytes.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) struct IntegerPosition {
    /// Required length of the payload, in bytes.
    bytes: usize,
    /// Number of bits above the integer.
    above: u32,
    /// Number of bits outside the integer.
    others: u32,
    is_signed: bool,
}

impl IntegerPosition {
    /// Position of a field; `None` if it is not an integer of up to 64 bits within the first eight bytes.
    pub fn position_of(field: &SignalField) -> Option<Self> {
        let is_number = !matches!(field.data_type, DataType::Real32 | DataType::Real64);
        let is_signed = field.data_type.is_signed();
        let end = field.end().filter(|end| *end <= 64 && field.order == BitOrder::LittleEndian)?;
        // If the type is narrower than the field, the sign bit is not the top bit. An unsigned 64-bit number
        // can exceed `i64`.
        let fits = match field.data_type.bits() {
            Some(width) if is_signed => field.bits <= width,
            _ => field.bits < 64,
        };
        (is_number && fits && field.bits > 0).then(|| Self {
            bytes: usize::from(end.div_ceil(8)),
            above: 64 - u32::from(end),
            others: 64 - u32::from(field.bits),
            is_signed,
        })
    }

    /// Its bits within eight bytes; bit 0 is the lowest bit of byte 0.
    pub const fn bits(self) -> u64 {
        u64::MAX << self.others >> self.above
    }

    /// Raw bits; the payload must be long enough.
    #[inline]
    pub fn raw_bits(self, word: u64) -> u64 {
        (word << self.above) >> self.others
    }

    /// Number from the first eight bytes (little-endian) of a payload; `None` if its `length` is too short.
    #[inline]
    pub fn number(self, word: u64, length: usize) -> Option<i64> {
        let top = word << self.above;
        let number = if self.is_signed {
            top.cast_signed() >> self.others
        } else {
            (top >> self.others).cast_signed()
        };
        (length >= self.bytes).then_some(number)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::profile::as_integer;
    use crate::wire::canopen::ObjectAddress;

    #[test]
    fn numbers_are_those_of_the_field() {
        let payload = [0x81, 0xF2, 0x03, 0x94, 0xA5, 0x76, 0xE7, 0x98];
        let types = [DataType::Unsigned8, DataType::Integer8, DataType::Unsigned16, DataType::Integer16];
        for (data_type, bit, bits) in types
            .into_iter()
            .flat_map(|of| (0..56_u16).flat_map(move |bit| (1..=16).map(move |bits| (of, bit, bits))))
        {
            let field = SignalField::of_object(ObjectAddress::new(0x2000, 0), bit, bits, data_type);
            let Some(cut) = IntegerPosition::position_of(&field) else { continue };
            for length in 0..=8 {
                let raw = field.extract_bits(&payload[..length]);
                let number = raw.and_then(|raw| as_integer(&field.convert_raw(raw)));
                assert_eq!(cut.bits(), field.payload_bits());
                assert!(raw.is_none_or(|raw| cut.raw_bits(u64::from_le_bytes(payload)) == raw));
                assert_eq!(
                    cut.number(u64::from_le_bytes(payload), length),
                    number,
                    "{data_type:?} {bit} {bits}"
                );
            }
        }
        let wide = SignalField::of_object(ObjectAddress::new(0x2000, 0), 0, 64, DataType::Integer64);
        assert_eq!(IntegerPosition::position_of(&wide).unwrap().number(u64::MAX, 8), Some(-1));
        let real = SignalField::of_object(ObjectAddress::new(0x2000, 0), 0, 32, DataType::Real32);
        assert_eq!(IntegerPosition::position_of(&real), None);
    }
}
