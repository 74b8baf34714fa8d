//! PDO layouts: which bits of a payload are which object, everything resolved.
//!
//! A layout is immutable; a configuration that takes effect makes a new one. So an event that holds the
//! layout and the payload can be understood later, and elsewhere, without the object store.

use std::fmt;
use std::ops::RangeInclusive;
use std::str::FromStr;
use std::sync::Arc;

use super::data_type::{DataType, Value, sign_extend};
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
    pub(crate) const fn communication_index(self) -> u16 {
        let base = match self.direction {
            PdoDirection::Transmit => 0x1800,
            PdoDirection::Receive => 0x1400,
        };
        base + (self.number.wrapping_sub(1) & 0x1FF)
    }

    /// Index of the mapping parameter: 0x1600 + n − 1 or 0x1A00 + n − 1.
    pub(crate) const fn mapping_index(self) -> u16 {
        self.communication_index() + 0x200
    }

    /// The PDO a communication or mapping parameter belongs to.
    pub(crate) const fn of_parameter(index: u16) -> Option<Self> {
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

/// What brings values of a node.
#[derive(Debug, Clone, PartialEq, Eq)]
pub enum Carrier {
    /// A PDO.
    Pdo(PdoName),
    /// A J1939 message, by the name the profile gives it.
    Message(Arc<str>),
}

/// `RPDO1`, `AVC`.
impl fmt::Display for Carrier {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::Pdo(name) => write!(f, "{name}"),
            Self::Message(name) => f.write_str(name),
        }
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

/// When a multiplexed field is there. The field that selects may be selected itself.
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
    /// Where it begins: bit `n % 8` of byte `n / 8`, bit 0 of a byte being its least significant one. That is
    /// the field's least significant bit, of one with the most significant bit first that one.
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
pub(crate) type RawValue = u64;

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

/// Fields that select one another in a row. Vector's tools have no limit; nobody nests more than three.
pub(super) const DEEPEST_SELECTION: usize = 8;

impl Layout {
    /// Values of all fields the payload has: it is long enough for them, and a multiplexed one is selected.
    pub fn signals<'a>(&'a self, payload: &'a [u8]) -> impl Iterator<Item = Signal<'a>> {
        let selected = self.fields.iter().filter(move |field| self.is_selected(field, payload));
        selected.filter_map(move |field| {
            let raw = field.extract(payload)?;
            Some(Signal { field, raw, value: field.value(raw) })
        })
    }

    /// The value of one field, where the payload has it.
    pub fn signal<'a>(&'a self, field: usize, payload: &[u8]) -> Option<Signal<'a>> {
        let field = self.fields.get(field).filter(|field| self.is_selected(field, payload))?;
        let raw = field.extract(payload)?;
        Some(Signal { field, raw, value: field.value(raw) })
    }

    /// Fields a payload is too short for. One that is not selected is not missed.
    pub fn missing<'a>(&'a self, payload: &'a [u8]) -> impl Iterator<Item = &'a Field> {
        self.fields
            .iter()
            .filter(move |field| field.extract(payload).is_none() && self.is_selected(field, payload))
    }

    /// Whether all fields that select this one, each by the next, have such a value. Bounded, for a layout
    /// made of a file may select in a circle.
    fn is_selected(&self, field: &Field, payload: &[u8]) -> bool {
        let mut selector = &field.present;
        for _ in 0..DEEPEST_SELECTION {
            let Some(wanted) = selector else { return true };
            let Some(by) = self.fields.get(wanted.field) else { return false };
            let Some(raw) = by.extract(payload) else { return false };
            if !wanted.values.iter().any(|range| range.contains(&raw)) {
                return false;
            }
            selector = &by.present;
        }
        selector.is_none()
    }
}

impl<'a> Signal<'a> {
    /// Name, if known; else [`Field::id`] identifies it.
    pub fn name(&self) -> Option<&'a str> {
        self.field.name()
    }

    /// Quantity in [`Self::unit`]; `None` if no scale is known, and for special values such as "not available".
    pub fn scaled(&self) -> Option<f64> {
        self.field.meaning.as_deref()?.scaled(&self.value)
    }

    /// Unit of the scaled value; empty for plain numbers.
    pub fn unit(&self) -> &'a str {
        self.field.meaning.as_deref().map_or("", |meaning| &meaning.unit)
    }

    /// Name of the value: of an enumeration, or of a special value.
    pub fn label(&self) -> Option<&'a str> {
        self.field.meaning.as_deref()?.label(&self.value)
    }

    /// Value as people write it: `157.5 bar`, `pressure control (2)`, `80000185h`.
    pub fn text(&self) -> String {
        self.field
            .meaning
            .as_deref()
            .map_or_else(|| self.value.to_string(), |meaning| meaning.show(&self.value))
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
        let end = usize::from(self.end()?.div_ceil(8));
        let bytes = payload.get(first..end)?;
        let mask = self.mask();
        if self.order == BitOrder::LittleEndian && bytes.len() <= 8 {
            let word = bytes.iter().rev().fold(0, |word: u64, byte| word << 8 | u64::from(*byte));
            return Some(word >> (self.bit % 8) & mask);
        }
        // Up to nine bytes: 64 bits that do not start at a byte.
        let join = |value: u128, byte: &u8| value << 8 | u128::from(*byte);
        let (wide, below) = match self.order {
            BitOrder::LittleEndian => (bytes.iter().rev().fold(0, join), self.bit % 8),
            BitOrder::BigEndian => (bytes.iter().fold(0, join), (8 - self.end()? % 8) % 8),
        };
        #[expect(clippy::cast_possible_truncation, reason = "masked to 64 bits")]
        let low = (wide >> below) as u64;
        Some(low & mask)
    }

    /// As many low bits as the field has.
    pub fn mask(&self) -> RawValue {
        if self.bits >= 64 { u64::MAX } else { (1 << self.bits) - 1 }
    }

    /// Bits of a payload up to the end of the field, counted in its order: of one with the most significant
    /// bit first, bit 7 of byte 0 is the first of all.
    ///
    /// ```text
    /// byte     |       0       |        1        |
    /// bit      |7 6 5 4 3 2 1 0|15 14 … 10  9   8|   as `bit` counts
    ///          |0 1 2 3 4 5 6 7| 8  9 … 13 14  15|   in the order of a big-endian field
    /// ```
    pub fn end(&self) -> Option<u16> {
        let first = match self.order {
            BitOrder::LittleEndian => self.bit,
            BitOrder::BigEndian => (self.bit & !7) | (7 - self.bit % 8),
        };
        first.checked_add(self.bits)
    }

    /// The number of bits taken by [`Self::extract`]; the sign of an integer is the field's uppermost bit.
    pub fn value(&self, raw: RawValue) -> Value {
        if self.data_type.is_signed() {
            Value::Integer(sign_extend(raw, self.bits.min(self.data_type.bits().unwrap_or(64))))
        } else {
            self.data_type.number(raw)
        }
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
    fn the_most_significant_bit_first() {
        let big = |bit, bits, data_type| Field { order: BitOrder::BigEndian, ..field(bit, bits, data_type) };
        // 0001_0010 0011_0100 0101_0110.
        let payload = [0x12, 0x34, 0x56];
        assert_eq!(big(7, 16, DataType::Unsigned16).extract(&payload), Some(0x1234));
        assert_eq!(big(3, 12, DataType::Unsigned16).extract(&payload), Some(0x234));
        // From bit 5 of byte 0 on: 01_0010 0011_0.
        assert_eq!(big(5, 11, DataType::Unsigned16).extract(&payload), Some(0b010_0100_0110));
        assert_eq!(big(0, 17, DataType::Unsigned24).extract(&payload), Some(0x3456));
        assert_eq!(big(16, 1, DataType::Boolean).extract(&payload), Some(0));
        assert_eq!(big(16, 2, DataType::Unsigned8).extract(&payload), None);
        let nine = [0x01, 0xFF, 0xFF, 0xFF, 0xFF, 0xFF, 0xFF, 0xFF, 0xFE];
        assert_eq!(big(0, 64, DataType::Unsigned64).extract(&nine), Some(u64::MAX));
    }

    #[test]
    fn the_sign_is_the_uppermost_bit_of_the_field() {
        assert_eq!(field(0, 5, DataType::Integer8).value(0x1F), Value::Integer(-1));
        assert_eq!(field(0, 5, DataType::Integer8).value(0x0F), Value::Integer(15));
        assert_eq!(field(0, 64, DataType::Integer64).value(u64::MAX), Value::Integer(-1));
    }

    #[test]
    fn a_multiplexed_field_is_there_when_those_before_it_select_it() {
        let selected = |bit, by, values: &[RangeInclusive<u64>]| Field {
            present: Some(Selector { field: by, values: values.to_vec() }),
            ..field(bit, 8, DataType::Unsigned8)
        };
        let layout = Layout {
            fields: vec![
                field(0, 8, DataType::Unsigned8),
                selected(8, 0, &[1..=1, 4..=6]),
                selected(16, 1, &[9..=9]),
                selected(24, 4, &[0..=255]),
                selected(24, 3, &[0..=255]),
            ],
            ..Layout::default()
        };
        let bits = |payload: &[u8]| layout.signals(payload).map(|it| it.field.bit).collect::<Vec<_>>();
        assert_eq!(bits(&[5, 9, 7, 0]), [0, 8, 16]);
        assert_eq!(bits(&[1, 8, 7, 0]), [0, 8]);
        // Of the third neither: the second is not there, whatever its bits are. The last two select each other.
        assert_eq!(bits(&[2, 9, 7, 0]), [0]);
        assert_eq!(layout.signal(2, &[5, 9, 7, 0]).map(|it| it.raw), Some(7));
        assert!(layout.signal(2, &[1, 8, 7, 0]).is_none() && layout.signal(5, &[5, 9, 7, 0]).is_none());
        assert_eq!(layout.missing(&[5, 9]).map(|it| it.bit).collect::<Vec<_>>(), [16]);
        assert_eq!(layout.missing(&[2]).count(), 0);
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
