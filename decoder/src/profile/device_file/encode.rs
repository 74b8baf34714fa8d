//! Values of device files as a device sends them.

use super::{DeviceObject, Given};
use crate::profile::DataType;

impl DeviceObject {
    /// What the device is configured to (DCF, XDC), as it is sent; `None` where the file does not say it, or
    /// its type is unknown.
    pub fn wanted(&self, node_id: u8) -> Option<Vec<u8>> {
        self.value.as_ref()?.encode(self.data_type?, node_id)
    }
}

impl Given {
    /// The bytes of a value, least significant first; `None` if it does not fit the type.
    pub fn encode(&self, data_type: DataType, node_id: u8) -> Option<Vec<u8>> {
        match (self, data_type) {
            (Self::Number(_) | Self::Formula { .. }, _) => integer(self.number(node_id)?, data_type),
            #[expect(clippy::cast_possible_truncation, reason = "the type says that it is a short one")]
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

fn integer(number: i128, data_type: DataType) -> Option<Vec<u8>> {
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
        let number = |number, data_type| Given::Number(number).encode(data_type, 5);
        assert_eq!(number(1, DataType::Boolean), Some(vec![1]));
        assert_eq!(number(-2, DataType::Integer24), Some(vec![0xFE, 0xFF, 0xFF]));
        assert_eq!(number(i128::from(u64::MAX), DataType::Unsigned64), Some(vec![0xFF; 8]));
        assert_eq!((number(256, DataType::Unsigned8), number(-129, DataType::Integer8)), (None, None));
        assert_eq!((number(1, DataType::Real32), number(1, DataType::Domain)), (None, None));
        let formula = Given::Formula { offset: 0x4000_0180 };
        assert_eq!(formula.encode(DataType::Unsigned32, 5), Some(vec![0x85, 1, 0, 0x40]));
    }

    #[test]
    fn what_is_no_number() {
        assert_eq!(Given::Real(1.5).encode(DataType::Real32, 5), Some(vec![0, 0, 0xC0, 0x3F]));
        assert_eq!(Given::Real(1.5).encode(DataType::Unsigned32, 5), None);
        let text = |text: &str, data_type| Given::Text(text.to_owned()).encode(data_type, 5);
        assert_eq!(text("Aé", DataType::VisibleString), Some(vec![0x41, 0xE9]));
        assert_eq!(text("Aé", DataType::UnicodeString), Some(vec![0x41, 0, 0xE9, 0]));
        assert_eq!((text("→", DataType::VisibleString), text("a", DataType::Domain)), (None, None));
        assert_eq!(Given::Bytes(vec![1, 2]).encode(DataType::Domain, 5), Some(vec![1, 2]));
    }
}
