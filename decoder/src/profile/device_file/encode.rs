//! Encodes values of device files to the bytes on the wire.

use super::{DeviceObject, EntryValue};
use crate::profile::DataType;

impl DeviceObject {
    /// Bytes of the configured value (DCF, XDC); `None` without such a value or with an unknown type.
    pub fn configured_bytes(&self, node_id: u8) -> Option<Vec<u8>> {
        self.value.as_ref()?.encode_value(self.data_type?, node_id)
    }
}

impl EntryValue {
    /// Encodes a value little-endian; `None` if it does not fit the type.
    pub fn encode_value(&self, data_type: DataType, node_id: u8) -> Option<Vec<u8>> {
        match (self, data_type) {
            (Self::Number(_) | Self::Formula { .. }, _) => {
                encode_integer(self.number_for(node_id)?, data_type)
            }
            #[expect(
                clippy::cast_possible_truncation,
                reason = "the value is within the range of a short type"
            )]
            (Self::Real(number), DataType::Real32) => Some((*number as f32).to_le_bytes().to_vec()),
            (Self::Real(number), DataType::Real64) => Some(number.to_le_bytes().to_vec()),
            (Self::Text(text), DataType::UnicodeString) => {
                Some(text.encode_utf16().flat_map(u16::to_le_bytes).collect())
            }
            (Self::Text(text), DataType::VisibleString) => {
                text.chars().map(|c| u8::try_from(c).ok()).collect()
            }
            (Self::Bytes(bytes), _) => Some(bytes.clone()),
            (Self::Real(_) | Self::Text(_), _) => None,
        }
    }
}

fn encode_integer(number: i128, data_type: DataType) -> Option<Vec<u8>> {
    let bits = u32::from(data_type.bits()?);
    let fits = if data_type.is_signed() {
        let limit = 1_i128 << (bits - 1);
        (-limit..limit).contains(&number)
    } else {
        !matches!(data_type, DataType::Real32 | DataType::Real64) && (0..1_i128 << bits).contains(&number)
    };
    let length = usize::try_from(bits.div_ceil(8)).ok()?;
    fits.then(|| number.to_le_bytes().into_iter().take(length).collect())
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn values_are_as_wide_as_their_type() {
        let number = |number, data_type| EntryValue::Number(number).encode_value(data_type, 5);
        assert_eq!(number(1, DataType::Boolean), Some(vec![1]));
        assert_eq!(number(-2, DataType::Integer24), Some(vec![0xFE, 0xFF, 0xFF]));
        assert_eq!(number(i128::from(u64::MAX), DataType::Unsigned64), Some(vec![0xFF; 8]));
        assert_eq!((number(256, DataType::Unsigned8), number(-129, DataType::Integer8)), (None, None));
        assert_eq!((number(1, DataType::Real32), number(1, DataType::Domain)), (None, None));
        let formula = EntryValue::Formula { offset: 0x4000_0180 };
        assert_eq!(formula.encode_value(DataType::Unsigned32, 5), Some(vec![0x85, 1, 0, 0x40]));
    }

    #[test]
    fn what_is_no_number() {
        assert_eq!(EntryValue::Real(1.5).encode_value(DataType::Real32, 5), Some(vec![0, 0, 0xC0, 0x3F]));
        assert_eq!(EntryValue::Real(1.5).encode_value(DataType::Unsigned32, 5), None);
        let text = |text: &str, data_type| EntryValue::Text(text.to_owned()).encode_value(data_type, 5);
        assert_eq!(text("Aé", DataType::VisibleString), Some(vec![0x41, 0xE9]));
        assert_eq!(text("Aé", DataType::UnicodeString), Some(vec![0x41, 0, 0xE9, 0]));
        assert_eq!((text("→", DataType::VisibleString), text("a", DataType::Domain)), (None, None));
        assert_eq!(EntryValue::Bytes(vec![1, 2]).encode_value(DataType::Domain, 5), Some(vec![1, 2]));
    }
}
