//! PDO layouts: which bits of a payload are which object, everything resolved.
//!
//! A layout is immutable; a configuration that takes effect makes a new one. So an event that holds the
//! layout and the payload can be understood later, and elsewhere, without the object store.

use std::fmt;
use std::ops::RangeInclusive;
use std::str::FromStr;
use std::sync::Arc;

use super::data_type::{DataType, Value};
use super::meaning::Meaning;
use crate::wire::canopen::ObjectAddress;

/// Direction as the device sees it.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Hash)]
pub enum PdoDirection {
    /// TPDO: the device sends.
    Transmit,
    /// RPDO: the device receives.
    Receive,
}

/// Which PDO of a node.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Hash)]
pub struct PdoName {
    /// Sent or received by the node.
    pub direction: PdoDirection,
    /// 1..=512.
    pub number: u16,
}

impl PdoName {
    /// Index of the communication parameter: 0x1400 + n − 1 or 0x1800 + n − 1.
    pub const fn communication_index(self) -> u16 {
        let base = match self.direction {
            PdoDirection::Transmit => 0x1800,
            PdoDirection::Receive => 0x1400,
        };
        base + (self.number.wrapping_sub(1) & 0x1FF)
    }

    /// Index of the mapping parameter: 0x1600 + n − 1 or 0x1A00 + n − 1.
    pub const fn mapping_index(self) -> u16 {
        self.communication_index() + 0x200
    }

    /// The PDO a communication or mapping parameter belongs to.
    pub const fn of_parameter(index: u16) -> Option<Self> {
        let direction = match index {
            0x1400..=0x17FF => PdoDirection::Receive,
            0x1800..=0x1BFF => PdoDirection::Transmit,
            _ => return None,
        };
        Some(Self { direction, number: (index & 0x1FF) + 1 })
    }
}

/// `TPDO1`, `RPDO4`.
impl fmt::Display for PdoName {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let direction = match self.direction {
            PdoDirection::Transmit => "TPDO",
            PdoDirection::Receive => "RPDO",
        };
        write!(f, "{direction}{}", self.number)
    }
}

/// `TPDO1` to `TPDO512`, `RPDO1` to `RPDO512`, in any case.
impl FromStr for PdoName {
    type Err = &'static str;

    fn from_str(text: &str) -> Result<Self, &'static str> {
        let lower = text.to_ascii_lowercase();
        let (direction, number) = match (lower.strip_prefix("tpdo"), lower.strip_prefix("rpdo")) {
            (Some(number), _) => (PdoDirection::Transmit, number),
            (None, Some(number)) => (PdoDirection::Receive, number),
            (None, None) => return Err("a PDO is written TPDO1 or RPDO1"),
        };
        let number = number.parse().ok().filter(|number| (1..=512).contains(number));
        Ok(Self { direction, number: number.ok_or("PDOs are numbered 1 to 512")? })
    }
}

impl<'de> serde::Deserialize<'de> for PdoName {
    fn deserialize<D: serde::Deserializer<'de>>(deserializer: D) -> Result<Self, D::Error> {
        let text = String::deserialize(deserializer)?;
        text.parse().map_err(serde::de::Error::custom)
    }
}

/// What a signal is the value of.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum SignalId {
    /// An object of the node; of a J1939 message of a profile its PGN and the parameter's number.
    Object(ObjectAddress),
    /// A suspect parameter (SAE J1939-71).
    Spn(u32),
    /// Only its name tells.
    Name,
}

/// `6041:00`, `SPN 190`; nothing where only a name tells.
impl fmt::Display for SignalId {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::Object(object) => write!(f, "{object}"),
            Self::Spn(spn) => write!(f, "SPN {spn}"),
            Self::Name => Ok(()),
        }
    }
}

/// In which order the bits of a field stand.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub enum BitOrder {
    /// The least significant first: CANopen, J1939, "Intel".
    #[default]
    LittleEndian,
    /// The most significant first: "Motorola".
    BigEndian,
}

/// When a multiplexed field is there.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Selector {
    /// Place in the layout of the field that selects.
    pub field: usize,
    /// Its raw values that do.
    pub values: Vec<RangeInclusive<u64>>,
}

/// One value within a payload.
#[derive(Debug, Clone, PartialEq)]
pub struct Field {
    /// What the bits belong to.
    pub id: SignalId,
    /// What its values mean, if known.
    pub meaning: Option<Arc<Meaning>>,
    /// First bit of the payload, counted from the least significant bit of byte 0.
    pub bit: u16,
    /// Width in bits, 1..=64.
    pub bits: u16,
    /// Order of the bits.
    pub order: BitOrder,
    /// Only with these values of another field.
    pub present: Option<Selector>,
    /// How the bits are read.
    pub data_type: DataType,
    /// Whether `data_type` is known rather than taken from the width.
    pub is_typed: bool,
}

/// All fields of a PDO.
#[derive(Debug, Clone, PartialEq, Default)]
pub struct Layout {
    /// Fields in order of their bits.
    pub fields: Vec<Field>,
    /// Bits the mapping takes, gaps included.
    pub bits: u16,
    /// Where it comes from: `wire` (SDO traffic seen), `bus-file`, …
    pub origin: &'static str,
    /// It may have changed unseen since it was learnt (the node restarted), or is a default.
    pub assumed: bool,
    /// Objects whose values decided something: when one changes, so does the layout.
    pub depends: Vec<ObjectAddress>,
}

/// A field's bits as a number.
pub type RawValue = u64;

/// One field's value in one payload.
#[derive(Debug, Clone, PartialEq)]
pub struct Signal<'a> {
    /// Where and what.
    pub field: &'a Field,
    /// Bits as sent.
    pub raw: RawValue,
    /// Bits read by the field's type.
    pub value: Value,
}

impl Layout {
    /// Values of all fields the payload is long enough for.
    pub fn signals<'a>(&'a self, payload: &'a [u8]) -> impl Iterator<Item = Signal<'a>> {
        self.fields.iter().filter_map(move |field| {
            let raw = field.extract(payload)?;
            Some(Signal { field, raw, value: field.data_type.number(raw) })
        })
    }
}

impl Layout {
    /// Fields a payload is too short for.
    pub fn missing<'a>(&'a self, payload: &'a [u8]) -> impl Iterator<Item = &'a Field> {
        self.fields.iter().filter(move |field| field.extract(payload).is_none())
    }
}

impl Field {
    /// A value of an object whose bits stand as CANopen and J1939 order them; nothing more is known of it.
    pub fn of_object(object: ObjectAddress, bit: u16, bits: u16, data_type: DataType) -> Self {
        Self {
            id: SignalId::Object(object),
            meaning: None,
            bit,
            bits,
            order: BitOrder::LittleEndian,
            present: None,
            data_type,
            is_typed: false,
        }
    }

    /// The object it is a value of, if it is one's.
    pub const fn object(&self) -> Option<ObjectAddress> {
        match self.id {
            SignalId::Object(object) => Some(object),
            SignalId::Spn(_) | SignalId::Name => None,
        }
    }

    /// Its name, if known.
    pub fn name(&self) -> Option<&str> {
        self.meaning.as_deref().map(|meaning| meaning.name.as_str())
    }

    /// The field's bits in `payload`; `None` if it is too short.
    pub fn extract(&self, payload: &[u8]) -> Option<RawValue> {
        let first = usize::from(self.bit / 8);
        let end = usize::from(self.bit.checked_add(self.bits)?.div_ceil(8));
        let bytes = payload.get(first..end)?;
        // Up to nine bytes: 64 bits that do not start at a byte.
        let wide = bytes.iter().rev().fold(0_u128, |value, byte| value << 8 | u128::from(*byte));
        let mask = if self.bits >= 64 { u64::MAX } else { (1 << self.bits) - 1 };
        #[expect(clippy::cast_possible_truncation, reason = "masked to 64 bits")]
        let low = (wide >> (self.bit % 8)) as u64;
        Some(low & mask)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn field(bit: u16, bits: u16, data_type: DataType) -> Field {
        Field::of_object(ObjectAddress::new(0x6000, 1), bit, bits, data_type)
    }

    #[test]
    fn fields_at_bytes_bits_and_across() {
        // 0x01 0xFE 0x80: byte field, signed byte, one bit.
        let payload = [0x01, 0xFE, 0x80];
        assert_eq!(field(0, 16, DataType::Unsigned16).extract(&payload), Some(0xFE01));
        assert_eq!(field(8, 8, DataType::Integer8).extract(&payload), Some(0xFE));
        assert_eq!(field(23, 1, DataType::Boolean).extract(&payload), Some(1));
        assert_eq!(field(4, 12, DataType::Unsigned16).extract(&payload), Some(0xFE0));
        assert_eq!(field(16, 16, DataType::Unsigned16).extract(&payload), None);
    }

    #[test]
    fn sixty_four_bits_off_a_byte_boundary() {
        let payload = [0xF0, 0xFF, 0xFF, 0xFF, 0xFF, 0xFF, 0xFF, 0xFF, 0x0F];
        assert_eq!(field(4, 64, DataType::Unsigned64).extract(&payload), Some(u64::MAX));
    }

    #[test]
    fn parameters_belong_to_pdos() {
        let name = PdoName::of_parameter(0x1A03).unwrap();
        assert_eq!(name.to_string(), "TPDO4");
        assert_eq!((name.communication_index(), name.mapping_index()), (0x1803, 0x1A03));
        assert_eq!(PdoName::of_parameter(0x15FF).unwrap().number, 512);
        assert_eq!(PdoName::of_parameter(0x1200), None);
    }
}
