//! Values of objects as a person writes them, to the bytes a device sends.

use serde::Deserialize;

use super::settings::ObjectValue;
use crate::profile::{DataType, plain_device};
use crate::wire::canopen::ObjectAddress;

/// A value in the file.
#[derive(Deserialize)]
#[serde(untagged)]
pub(super) enum Value {
    Integer(i64),
    Text(String),
}

/// A value of an object that CiA 301 defines, in bytes; of another one the number, for the node's profile.
pub(super) fn bytes(address: ObjectAddress, value: Value) -> Result<ObjectValue, String> {
    let number = match value {
        Value::Text(text) => return Ok(ObjectValue::Bytes(text.into_bytes())),
        Value::Integer(number) => number,
    };
    match plain_device().dictionary.data_type(address) {
        Some(data_type) => encode(number, Some(data_type)).map(ObjectValue::Bytes),
        None => Ok(ObjectValue::Number(number)),
    }
}

/// The bytes of a number, least significant first, as wide as its type; without one the next of 8, 16, 32
/// and 64 bits that holds it.
///
/// # Errors
/// A number that does not fit the type.
pub fn encode(number: i64, data_type: Option<DataType>) -> Result<Vec<u8>, String> {
    let bits = data_type.and_then(DataType::bits).unwrap_or_else(|| width(number));
    let signed = data_type.map_or(number < 0, DataType::is_signed);
    if !fits(number, bits, signed) {
        let name = data_type.map_or_else(String::new, |known| format!(" {}", known.name()));
        return Err(format!("{number} does not fit{name}"));
    }
    let length = usize::from(bits.div_ceil(8)).min(8);
    Ok(number.to_le_bytes().into_iter().take(length).collect())
}

fn width(number: i64) -> u16 {
    let needed = if number < 0 { 65 - (!number).leading_zeros() } else { 64 - number.leading_zeros() };
    match needed {
        0..=8 => 8,
        9..=16 => 16,
        17..=32 => 32,
        _ => 64,
    }
}

fn fits(number: i64, bits: u16, signed: bool) -> bool {
    let bits = u32::from(bits.clamp(1, 64));
    if signed {
        let limit = 1_i128 << (bits - 1);
        (-limit..limit).contains(&i128::from(number))
    } else {
        (0..1_i128 << bits).contains(&i128::from(number))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn numbers_of_unknown_objects_take_the_next_width() {
        let of = |number| encode(number, None);
        assert_eq!(of(255), Ok(vec![255]));
        assert_eq!(of(256), Ok(vec![0, 1]));
        assert_eq!(of(0x6041_0010), Ok(vec![0x10, 0, 0x41, 0x60]));
        assert_eq!(of(-1), Ok(vec![0xFF]));
        assert_eq!(of(-129), Ok(vec![0x7F, 0xFF]));
        assert_eq!(of(1 << 32), Ok(vec![0, 0, 0, 0, 1, 0, 0, 0]));
    }
}
