//! Encodes values of objects from the bus file to the bytes on the wire.

use std::ops::RangeInclusive;

use serde::Deserialize;

use crate::profile::{DataType, plain_device};
use crate::wire::canopen::ObjectAddress;

/// Value of an object.
#[derive(Debug, Clone, PartialEq, Eq)]
pub enum ObjectValue {
    /// Bytes as transmitted.
    Bytes(Vec<u8>),
    /// Number, encoded with the data type from the node's profile.
    Number(i64),
}

/// Value as written in the file.
#[derive(Deserialize)]
#[serde(
    untagged,
    expecting = "expected a whole number or a text; give other values as data, bytes in hexadecimal"
)]
pub(super) enum TypedEntryValue {
    Integer(i64),
    Text(String),
}

/// Bytes of the value if CiA 301 defines the type of the object; otherwise the number, which is encoded with
/// the node's profile.
pub(super) fn encode_value(address: ObjectAddress, value: TypedEntryValue) -> Result<ObjectValue, String> {
    let number = match value {
        TypedEntryValue::Text(text) => return Ok(ObjectValue::Bytes(text.into_bytes())),
        TypedEntryValue::Integer(number) => number,
    };
    match plain_device().dictionary.data_type(address) {
        Some(data_type) => encode_number(number, Some(data_type)).map(ObjectValue::Bytes),
        None => Ok(ObjectValue::Number(number)),
    }
}

/// Encodes a number little-endian in the width of its type; without a type, in the smallest of 8, 16, 32
/// and 64 bits that fits.
///
/// # Errors
/// The number does not fit the type.
pub fn encode_number(number: i64, data_type: Option<DataType>) -> Result<Vec<u8>, String> {
    let bits = data_type.and_then(DataType::bits).unwrap_or_else(|| needed_bits(number));
    let signed = data_type.map_or(number < 0, DataType::is_signed);
    let range = number_range(bits, signed);
    if !range.contains(&i128::from(number)) {
        let name = data_type.map_or_else(|| "the object".into(), DataType::name);
        return Err(format!("{number} does not fit {name}; expected {} to {}", range.start(), range.end()));
    }
    let length = usize::from(bits.div_ceil(8)).min(8);
    Ok(number.to_le_bytes().into_iter().take(length).collect())
}

fn needed_bits(number: i64) -> u16 {
    let needed = if number < 0 { 65 - (!number).leading_zeros() } else { 64 - number.leading_zeros() };
    match needed {
        0..=8 => 8,
        9..=16 => 16,
        17..=32 => 32,
        _ => 64,
    }
}

fn number_range(bits: u16, signed: bool) -> RangeInclusive<i128> {
    let bits = u32::from(bits.clamp(1, 64));
    if signed {
        let limit = 1_i128 << (bits - 1);
        -limit..=limit - 1
    } else {
        0..=(1_i128 << bits) - 1
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn numbers_of_unknown_objects_take_the_next_width() {
        let of = |number| encode_number(number, None);
        assert_eq!(of(255), Ok(vec![255]));
        assert_eq!(of(256), Ok(vec![0, 1]));
        assert_eq!(of(0x6041_0010), Ok(vec![0x10, 0, 0x41, 0x60]));
        assert_eq!(of(-1), Ok(vec![0xFF]));
        assert_eq!(of(-129), Ok(vec![0x7F, 0xFF]));
        assert_eq!(of(1 << 32), Ok(vec![0, 0, 0, 0, 1, 0, 0, 0]));
    }
}
