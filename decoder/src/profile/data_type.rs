//! Data types of CiA 301 §7.1.6, and decoding of their values.

use std::fmt;

use serde::Deserialize;

/// Basic data types (CiA 301 table 44).
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash, Deserialize)]
#[serde(rename_all = "SCREAMING_SNAKE_CASE")]
#[expect(missing_docs, reason = "names of the standard")]
pub enum DataType {
    Boolean,
    Integer8,
    Integer16,
    Integer24,
    Integer32,
    Integer40,
    Integer48,
    Integer56,
    Integer64,
    Unsigned8,
    Unsigned16,
    Unsigned24,
    Unsigned32,
    Unsigned40,
    Unsigned48,
    Unsigned56,
    Unsigned64,
    Real32,
    Real64,
    VisibleString,
    OctetString,
    UnicodeString,
    TimeOfDay,
    TimeDifference,
    Domain,
}

/// Decoded value without unit.
#[derive(Debug, Clone, PartialEq)]
pub enum DecodedValue {
    /// BOOLEAN or UNSIGNEDn.
    Unsigned(u64),
    /// INTEGERn.
    Integer(i64),
    /// REAL32 or REAL64.
    Real(f64),
    /// String. May contain control characters: escape before printing.
    Text(String),
    /// Bytes without a number or text: domains, times, data of the wrong length.
    Bytes(Vec<u8>),
}

/// Prints integers in full, reals in the shortest form, text escaped, bytes in hex pairs.
impl fmt::Display for DecodedValue {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::Unsigned(value) => write!(f, "{value}"),
            Self::Integer(value) => write!(f, "{value}"),
            Self::Real(value) => write!(f, "{value}"),
            Self::Text(text) => write!(f, "\"{}\"", text.escape_debug()),
            Self::Bytes(bytes) => {
                for (index, byte) in bytes.iter().enumerate() {
                    let separator = if index == 0 { "" } else { " " };
                    write!(f, "{separator}{byte:02X}")?;
                }
                Ok(())
            }
        }
    }
}

impl DataType {
    /// Name in the standard: `UNSIGNED32`, `TIME_OF_DAY`.
    pub fn name(self) -> String {
        let mut name = String::new();
        for letter in format!("{self:?}").chars() {
            if letter.is_uppercase() && !name.is_empty() {
                name.push('_');
            }
            name.push(letter.to_ascii_uppercase());
        }
        name
    }

    /// Length in bits; `None` for types of variable length.
    pub const fn bits(self) -> Option<u16> {
        Some(match self {
            Self::Boolean => 1,
            Self::Integer8 | Self::Unsigned8 => 8,
            Self::Integer16 | Self::Unsigned16 => 16,
            Self::Integer24 | Self::Unsigned24 => 24,
            Self::Integer32 | Self::Unsigned32 | Self::Real32 => 32,
            Self::Integer40 | Self::Unsigned40 => 40,
            Self::Integer48 | Self::Unsigned48 | Self::TimeOfDay | Self::TimeDifference => 48,
            Self::Integer56 | Self::Unsigned56 => 56,
            Self::Integer64 | Self::Unsigned64 | Self::Real64 => 64,
            Self::VisibleString | Self::OctetString | Self::UnicodeString | Self::Domain => return None,
        })
    }

    /// Whether the type is an INTEGERn.
    pub const fn is_signed(self) -> bool {
        matches!(
            self,
            Self::Integer8
                | Self::Integer16
                | Self::Integer24
                | Self::Integer32
                | Self::Integer40
                | Self::Integer48
                | Self::Integer56
                | Self::Integer64
        )
    }

    /// Whether the type is an INTEGERn or UNSIGNEDn.
    pub(crate) fn is_integer(self) -> bool {
        self.is_signed() || self.bits().is_some_and(|bits| self == Self::unsigned_of(bits))
    }

    /// Minimum and maximum of an integer type; `None` for other types and ranges beyond `i64`.
    pub fn bounds(self) -> Option<[i64; 2]> {
        let bits = u32::from(self.bits().filter(|_| self.is_integer())?);
        Some(if self.is_signed() {
            [i64::MIN >> (64 - bits), i64::MAX >> (64 - bits)]
        } else {
            [0, i64::MAX.checked_shr(63_u32.checked_sub(bits)?)?]
        })
    }

    /// Decodes little-endian data. Data of the wrong length become [`DecodedValue::Bytes`]; trailing zeros are
    /// ignored, as in an expedited transfer without a size.
    pub fn decode(self, data: &[u8]) -> DecodedValue {
        match self {
            Self::VisibleString => return DecodedValue::Text(decode_latin1(data)),
            Self::UnicodeString => return DecodedValue::Text(decode_utf16(data)),
            _ => {}
        }
        let bytes = || DecodedValue::Bytes(data.to_vec());
        let Some(bits) = self.bits() else { return bytes() };
        let length = usize::from(bits.div_ceil(8));
        let Some((head, padding)) = data.split_at_checked(length) else { return bytes() };
        if padding.iter().any(|byte| *byte != 0) || matches!(self, Self::TimeOfDay | Self::TimeDifference) {
            return bytes();
        }
        self.decode_raw(little_endian(head))
    }

    /// Converts extracted bits to a value.
    pub fn decode_raw(self, raw: u64) -> DecodedValue {
        match self {
            Self::Real32 => DecodedValue::Real(f64::from(f32::from_bits(u32::try_from(raw).unwrap_or(0)))),
            Self::Real64 => DecodedValue::Real(f64::from_bits(raw)),
            _ if self.is_signed() => DecodedValue::Integer(sign_extend(raw, self.bits().unwrap_or(64))),
            _ => DecodedValue::Unsigned(raw),
        }
    }

    /// Integer type for the low `bits` of a wider integer; `None` if no type has that length.
    pub(crate) fn narrow_to(self, bits: u16) -> Option<Self> {
        self.bits().filter(|width| *width > bits)?;
        let unsigned = Self::unsigned_of(bits);
        if !self.is_integer() || unsigned.bits() != Some(bits) {
            return None;
        }
        Some(if self.is_signed() { Self::signed_of(bits) } else { unsigned })
    }

    /// Signed integer type of at least this length.
    pub const fn signed_of(bits: u16) -> Self {
        match bits {
            0..=8 => Self::Integer8,
            9..=16 => Self::Integer16,
            17..=24 => Self::Integer24,
            25..=32 => Self::Integer32,
            33..=40 => Self::Integer40,
            41..=48 => Self::Integer48,
            49..=56 => Self::Integer56,
            _ => Self::Integer64,
        }
    }

    /// Unsigned integer type of at least this length, for objects of unknown type.
    pub const fn unsigned_of(bits: u16) -> Self {
        match bits {
            0..=8 => Self::Unsigned8,
            9..=16 => Self::Unsigned16,
            17..=24 => Self::Unsigned24,
            25..=32 => Self::Unsigned32,
            33..=40 => Self::Unsigned40,
            41..=48 => Self::Unsigned48,
            49..=56 => Self::Unsigned56,
            _ => Self::Unsigned64,
        }
    }
}

/// Up to eight bytes as a little-endian number.
pub(crate) fn little_endian(bytes: &[u8]) -> u64 {
    bytes.iter().take(8).rev().fold(0, |value, byte| value << 8 | u64::from(*byte))
}

/// The low `bits` of `raw` as a signed number.
pub(crate) const fn sign_extend(raw: u64, bits: u16) -> i64 {
    let unused = if bits >= 64 { 0 } else { 64 - bits as u32 };
    (raw << unused).cast_signed() >> unused
}

/// Decodes a VISIBLE_STRING as Latin-1: a superset of ISO 646 that some devices send. Ends at a zero byte.
fn decode_latin1(data: &[u8]) -> String {
    data.iter().take_while(|byte| **byte != 0).map(|byte| char::from(*byte)).collect()
}

/// Decodes a text of a message, which ends at a zero or FF byte; spaces and `@` at its end are padding. UTF-8 if valid,
/// otherwise Latin-1.
pub(crate) fn padded_text(data: &[u8]) -> String {
    let end = data.iter().position(|byte| matches!(byte, 0 | 0xFF)).unwrap_or(data.len());
    let bytes = data.get(..end).unwrap_or(data);
    let text = std::str::from_utf8(bytes).map_or_else(|_| decode_latin1(bytes), str::to_owned);
    text.trim_end_matches([' ', '@']).to_owned()
}

fn decode_utf16(data: &[u8]) -> String {
    let units = data.chunks_exact(2).map(|pair| match pair {
        [low, high] => u16::from_le_bytes([*low, *high]),
        _ => 0,
    });
    char::decode_utf16(units.take_while(|unit| *unit != 0))
        .map(|character| character.unwrap_or(char::REPLACEMENT_CHARACTER))
        .collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn numbers_are_little_endian_and_signed_by_type() {
        assert_eq!(DataType::Unsigned16.decode(&[0xE8, 0x03]), DecodedValue::Unsigned(1000));
        assert_eq!(DataType::Integer16.decode(&[0xB2, 0xFF]), DecodedValue::Integer(-78));
        assert_eq!(DataType::Integer24.decode(&[0xFF, 0xFF, 0xFF]), DecodedValue::Integer(-1));
        assert_eq!(DataType::Real32.decode(&[0, 0, 0xC0, 0x3F]), DecodedValue::Real(1.5));
        assert_eq!(DataType::Unsigned64.decode(&[0xFF; 8]), DecodedValue::Unsigned(u64::MAX));
    }

    #[test]
    fn integers_have_bounds() {
        assert_eq!(DataType::Integer8.bounds(), Some([-128, 127]));
        assert_eq!(DataType::Integer64.bounds(), Some([i64::MIN, i64::MAX]));
        assert_eq!(DataType::Unsigned24.bounds(), Some([0, 0xFF_FFFF]));
        assert_eq!(DataType::Unsigned56.bounds(), Some([0, 0xFF_FFFF_FFFF_FFFF]));
        assert_eq!((DataType::Unsigned64.bounds(), DataType::Real32.bounds()), (None, None));
        assert!(!DataType::Boolean.is_integer() && !DataType::TimeOfDay.is_integer());
    }

    #[test]
    fn padding_is_cut_but_a_wrong_length_stays_bytes() {
        assert_eq!(DataType::Unsigned8.decode(&[5, 0, 0, 0]), DecodedValue::Unsigned(5));
        assert_eq!(DataType::Unsigned8.decode(&[5, 1]), DecodedValue::Bytes(vec![5, 1]));
        assert_eq!(DataType::Unsigned32.decode(&[5]), DecodedValue::Bytes(vec![5]));
    }

    #[test]
    fn names_are_those_of_the_standard() {
        assert_eq!(DataType::Unsigned32.name(), "UNSIGNED32");
        assert_eq!(DataType::TimeOfDay.name(), "TIME_OF_DAY");
    }

    #[test]
    fn strings_end_at_zero_and_are_escaped_when_shown() {
        let value = DataType::VisibleString.decode(b"IO\x1b[2J\0xx");
        assert_eq!(value, DecodedValue::Text("IO\x1b[2J".into()));
        assert_eq!(value.to_string(), "\"IO\\u{1b}[2J\"");
        assert_eq!(DataType::UnicodeString.decode(&[0x41, 0, 0xE9, 0]), DecodedValue::Text("Aé".into()));
    }
}
