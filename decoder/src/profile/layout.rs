//! Resolved PDO layouts: the bits of a payload and their objects.
//!
//! A layout is immutable; a new configuration creates a new one. An event that holds layout and payload can
//! therefore be decoded later without the object store.

use std::fmt::{self, Write as _};
use std::ops::RangeInclusive;
use std::str::FromStr;
use std::sync::Arc;

use strum::IntoStaticStr;

use super::data_type::{DataType, DecodedValue, little_endian, padded_text, sign_extend};
use super::meaning::ObjectMeaning;
use super::object::NumberFormat;
use crate::frame::low_bits;
use crate::wire::canopen::ObjectAddress;

/// Direction as seen from the device.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Hash)]
pub enum PdoDirection {
    /// TPDO: the device sends.
    Transmit,
    /// RPDO: the device receives.
    Receive,
}

/// PDO of a node by direction and number.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Hash)]
pub struct PdoName {
    /// Direction as seen from the node.
    pub direction: PdoDirection,
    /// Number, 1..=512.
    pub number: u16,
}

impl PdoName {
    /// Whether it is a TPDO.
    pub(crate) const fn is_sent(self) -> bool {
        matches!(self.direction, PdoDirection::Transmit)
    }

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

    /// PDO that a communication or mapping parameter belongs to.
    pub(crate) const fn of_parameter(index: u16) -> Option<Self> {
        let direction = match index {
            0x1400..=0x17FF => PdoDirection::Receive,
            0x1800..=0x1BFF => PdoDirection::Transmit,
            _ => return None,
        };
        Some(Self { direction, number: (index & 0x1FF) + 1 })
    }
}

/// Prints `TPDO1`, `RPDO4`.
impl fmt::Display for PdoName {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let direction = match self.direction {
            PdoDirection::Transmit => "TPDO",
            PdoDirection::Receive => "RPDO",
        };
        write!(f, "{direction}{}", self.number)
    }
}

/// Parses `TPDO1` to `TPDO512`, `RPDO1` to `RPDO512`, in any letter case.
impl FromStr for PdoName {
    type Err = &'static str;

    fn from_str(text: &str) -> Result<Self, &'static str> {
        let lower = text.to_ascii_lowercase();
        let (direction, number) = match (lower.strip_prefix("tpdo"), lower.strip_prefix("rpdo")) {
            (Some(number), _) => (PdoDirection::Transmit, number),
            (None, Some(number)) => (PdoDirection::Receive, number),
            (None, None) => return Err("expected a PDO such as TPDO1 or RPDO1"),
        };
        let number = number.parse().ok().filter(|number| (1..=512).contains(number));
        Ok(Self { direction, number: number.ok_or("expected a PDO number 1 to 512")? })
    }
}

impl<'de> serde::Deserialize<'de> for PdoName {
    fn deserialize<D: serde::Deserializer<'de>>(deserializer: D) -> Result<Self, D::Error> {
        let text = String::deserialize(deserializer)?;
        text.parse().map_err(serde::de::Error::custom)
    }
}

/// Message that carries values of a node.
#[derive(Debug, Clone, PartialEq, Eq)]
pub enum ValueCarrier {
    /// A PDO by name.
    Pdo(PdoName),
    /// A J1939 message, by its name in the profile.
    Message(Arc<str>),
}

/// Prints `RPDO1`, `AVC`.
impl fmt::Display for ValueCarrier {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::Pdo(name) => write!(f, "{name}"),
            Self::Message(name) => f.write_str(name),
        }
    }
}

/// Identification of a signal.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum SignalId {
    /// Object of the node; for a J1939 message of a profile, PGN and number of the parameter.
    Object(ObjectAddress),
    /// Suspect parameter number (SAE J1939-71).
    Spn(u32),
    /// Identified by its name only.
    Name,
}

/// Prints `6041:00`, `SPN 190`, or nothing for a name.
impl fmt::Display for SignalId {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::Object(object) => write!(f, "{object}"),
            Self::Spn(spn) => write!(f, "SPN {spn}"),
            Self::Name => Ok(()),
        }
    }
}

/// Bit order of a field.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub enum BitOrder {
    /// Least significant bit first: CANopen, J1939, "Intel".
    #[default]
    LittleEndian,
    /// Most significant bit first: "Motorola".
    BigEndian,
}

/// Multiplexor of a field; the multiplexor can itself be multiplexed.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct FieldSelector {
    /// Index of the multiplexor in the layout.
    pub field: usize,
    /// Raw values of the multiplexor that select the field.
    pub values: Vec<RangeInclusive<u64>>,
}

/// Definition of a value within a payload.
#[derive(Debug, Clone, PartialEq)]
pub struct SignalField {
    /// Object, SPN or name of the value.
    pub id: SignalId,
    /// Meaning of the value, if known.
    pub meaning: Option<Arc<ObjectMeaning>>,
    /// Start bit: bit `n % 8` of byte `n / 8`, where bit 0 is the least significant bit of a byte. It is the
    /// least significant bit of a little-endian field, the most significant bit of a big-endian one.
    pub bit: u16,
    /// Length in bits, 1..=64.
    pub bits: u16,
    /// Order of the bits.
    pub order: BitOrder,
    /// Multiplexor that selects the field; `None` if the field is always present.
    pub present: Option<FieldSelector>,
    /// Data type of the bits.
    pub data_type: DataType,
    /// Whether `data_type` is known rather than derived from the length.
    pub is_typed: bool,
}

/// Source of the fields of a PDO or message.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, IntoStaticStr)]
#[strum(serialize_all = "kebab-case")]
pub enum LayoutOrigin {
    /// Profile of the device.
    #[default]
    Profile,
    /// ISO 11783.
    Standard,
    /// Table of J1939 in this program.
    J1939,
    /// Table of NMEA 2000 in this program.
    Nmea2000,
    /// Table of RV-C in this program.
    RvC,
    /// Mapping objects seen on the bus.
    Wire,
    /// Bus file of the user.
    BusFile,
    /// EDS of the device.
    Eds,
    /// DCF of the device.
    Dcf,
    /// XDD of the device.
    Xdd,
    /// XDC of the device.
    Xdc,
    /// Message database in DBC.
    Dbc,
    /// Message database in JSON.
    Json,
}

impl LayoutOrigin {
    /// The name used in all output.
    pub fn name(self) -> &'static str {
        self.into()
    }

    /// Name for people: `EDS`, `profile`.
    pub fn title(self) -> String {
        if self == Self::Profile { self.name().to_owned() } else { self.name().to_ascii_uppercase() }
    }

    /// Whether the fields are those of a table of a public standard.
    pub const fn is_standard_table(self) -> bool {
        matches!(self, Self::J1939 | Self::Nmea2000 | Self::RvC)
    }

    /// Whether the fields are those of a message database, which need not fill the message.
    pub const fn is_database(self) -> bool {
        matches!(self, Self::Dbc | Self::Json)
    }
}

/// Fields of a PDO or message.
#[derive(Debug, Clone, PartialEq, Default)]
pub struct PayloadLayout {
    /// Fields in order of their bits.
    pub fields: Vec<SignalField>,
    /// Total length in bits, including gaps.
    pub bits: u16,
    /// Source of the fields.
    pub origin: LayoutOrigin,
    /// Whether it is a default or may have changed without being seen, for example after a restart of the
    /// node.
    pub assumed: bool,
    /// Objects that the layout depends on; it must be rebuilt when one changes.
    pub depends: Vec<ObjectAddress>,
    /// Bits of the first eight bytes with a fixed content in the profile.
    pub fixed: FixedBits,
}

/// Bits with a fixed content, little-endian: bit 0 is bit 0 of byte 0.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub struct FixedBits {
    /// The bits.
    pub mask: u64,
    /// Their content.
    pub value: u64,
}

impl FixedBits {
    /// Adds a field; bits after the first eight bytes are ignored.
    pub(crate) fn add_field(&mut self, bit: u16, bits: u16, content: u64) {
        let ones = low_bits(u32::from(bits));
        let shifted = |number: u64| number.checked_shl(u32::from(bit)).unwrap_or(0);
        self.mask |= shifted(ones);
        self.value |= shifted(content & ones);
    }

    /// Bits of a payload that differ; `bytes` is its length.
    pub(crate) const fn differing_bits(self, word: u64, bytes: usize) -> u64 {
        let sent = if bytes >= 8 { u64::MAX } else { (1 << (8 * bytes)) - 1 };
        (word ^ self.value) & self.mask & sent
    }
}

/// Bits of a field as a number.
pub(crate) type RawValue = u64;

/// Value of a field in one payload.
#[derive(Debug, Clone, PartialEq)]
pub struct DecodedSignal<'a> {
    /// Definition of the field.
    pub field: &'a SignalField,
    /// Bits as transmitted.
    pub raw: RawValue,
    /// Value decoded with the data type of the field.
    pub value: DecodedValue,
}

/// Max nesting depth of multiplexors. Vector's tools have no limit; files in practice nest up to three.
pub(super) const DEEPEST_SELECTION: usize = 8;

impl PayloadLayout {
    /// Values of all fields that the payload is long enough for and whose multiplexor selects them.
    pub fn decode_signals<'a>(&'a self, payload: &'a [u8]) -> impl Iterator<Item = DecodedSignal<'a>> {
        let selected = self.fields.iter().filter(move |field| self.is_selected(field, payload));
        selected.filter_map(move |field| field.decode_signal(payload))
    }

    /// Value of one field; `None` if the payload is too short or the multiplexor does not select it.
    pub fn decode_signal<'a>(&'a self, field: usize, payload: &[u8]) -> Option<DecodedSignal<'a>> {
        self.fields.get(field).filter(|field| self.is_selected(field, payload))?.decode_signal(payload)
    }

    /// Selected fields that the payload is too short for.
    pub fn missing_fields<'a>(&'a self, payload: &'a [u8]) -> impl Iterator<Item = &'a SignalField> {
        self.fields
            .iter()
            .filter(move |field| field.extract_bits(payload).is_none() && self.is_selected(field, payload))
    }

    /// Whether all multiplexors in the chain of this field select it. Limited in depth, because a layout from
    /// a file can contain a cycle.
    fn is_selected(&self, field: &SignalField, payload: &[u8]) -> bool {
        let mut selector = &field.present;
        for _ in 0..DEEPEST_SELECTION {
            let Some(wanted) = selector else { return true };
            let Some(by) = self.fields.get(wanted.field) else { return false };
            let Some(raw) = by.extract_bits(payload) else { return false };
            if !wanted.values.iter().any(|range| range.contains(&raw)) {
                return false;
            }
            selector = &by.present;
        }
        selector.is_none()
    }
}

impl<'a> DecodedSignal<'a> {
    /// Name, if known; otherwise [`SignalField::id`] identifies the signal.
    pub fn name(&self) -> Option<&'a str> {
        self.field.name()
    }

    /// Quantity in [`Self::unit`]; `None` if no scale is known, and for special values such as "not
    /// available".
    pub fn scaled_value(&self) -> Option<f64> {
        self.field.meaning.as_deref()?.scaled_value(&self.value)
    }

    /// Unit of the scaled value; empty for plain numbers.
    pub fn unit(&self) -> &'a str {
        self.field.meaning.as_deref().map_or("", |meaning| &meaning.unit)
    }

    /// Name of an enumeration value or special value.
    pub fn label(&self) -> Option<&'a str> {
        self.field.meaning.as_deref()?.value_label(&self.value)
    }

    /// Value for output: `157.5 bar`, `pressure control (2)`, `80000185h`.
    pub fn text(&self) -> String {
        self.field
            .meaning
            .as_deref()
            .map_or_else(|| self.value.to_string(), |meaning| meaning.format_value(&self.value))
    }
}

impl SignalField {
    /// Bits of the field in the first eight bytes of a payload, if the field is little-endian; bit 0 is the lowest bit of
    /// byte 0.
    pub fn payload_bits(&self) -> u64 {
        low_bits(u32::from(self.bits)).checked_shl(u32::from(self.bit)).unwrap_or(0)
    }

    /// Little-endian field of an object without further information, as in CANopen and J1939.
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

    /// Object of the field, if it belongs to one.
    pub const fn object(&self) -> Option<ObjectAddress> {
        match self.id {
            SignalId::Object(object) => Some(object),
            SignalId::Spn(_) | SignalId::Name => None,
        }
    }

    /// Name of the field, if known.
    pub fn name(&self) -> Option<&str> {
        self.meaning.as_deref().map(|meaning| meaning.name.as_str())
    }

    /// Whether the field contains characters or bytes, which have no raw number.
    pub const fn is_text(&self) -> bool {
        matches!(self.data_type, DataType::VisibleString | DataType::UnicodeString | DataType::OctetString)
    }

    /// Value in a payload; `None` if the payload is too short.
    fn decode_signal(&self, payload: &[u8]) -> Option<DecodedSignal<'_>> {
        if !self.is_text() {
            let raw = self.extract_bits(payload)?;
            return Some(DecodedSignal { field: self, raw, value: self.convert_raw(raw) });
        }
        let first = usize::from(self.bit / 8);
        let bytes = payload.get(first..first.checked_add(usize::from(self.bits / 8))?)?;
        let format = self.meaning.as_deref().map(|meaning| meaning.format);
        let value = match (self.data_type, format) {
            (_, Some(NumberFormat::DecimalPairs)) => {
                // FF: not available.
                let digits = bytes.iter().take_while(|byte| **byte <= 99);
                DecodedValue::Text(digits.fold(String::new(), |mut text, byte| {
                    let _ = write!(text, "{byte:02}");
                    text
                }))
            }
            (DataType::VisibleString, _) => DecodedValue::Text(padded_text(bytes)),
            (data_type, _) => data_type.decode(bytes),
        };
        Some(DecodedSignal { field: self, raw: little_endian(bytes), value })
    }

    /// Bits of the field in `payload`; `None` if the payload is too short.
    pub fn extract_bits(&self, payload: &[u8]) -> Option<RawValue> {
        let first = usize::from(self.bit / 8);
        let end = usize::from(self.end()?.div_ceil(8));
        let bytes = payload.get(first..end)?;
        let mask = self.mask();
        if self.order == BitOrder::LittleEndian && bytes.len() <= 8 {
            let word = bytes.iter().rev().fold(0, |word: u64, byte| word << 8 | u64::from(*byte));
            return Some(word >> (self.bit % 8) & mask);
        }
        // Up to nine bytes: 64 bits that start within a byte.
        let join = |value: u128, byte: &u8| value << 8 | u128::from(*byte);
        let (wide, below) = match self.order {
            BitOrder::LittleEndian => (bytes.iter().rev().fold(0, join), self.bit % 8),
            BitOrder::BigEndian => (bytes.iter().fold(0, join), (8 - self.end()? % 8) % 8),
        };
        #[expect(clippy::cast_possible_truncation, reason = "masked to 64 bits")]
        let low = (wide >> below) as u64;
        Some(low & mask)
    }

    /// Mask with the length of the field.
    pub fn mask(&self) -> RawValue {
        if self.bits >= 64 { u64::MAX } else { (1 << self.bits) - 1 }
    }

    /// Number of bits up to the end of the field, counted in its bit order: big-endian starts with bit 7 of
    /// byte 0.
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

    /// Value of the extracted bits; the sign bit of an integer is the top bit of the field.
    pub fn convert_raw(&self, raw: RawValue) -> DecodedValue {
        if self.data_type.is_signed() {
            DecodedValue::Integer(sign_extend(raw, self.bits.min(self.data_type.bits().unwrap_or(64))))
        } else {
            self.data_type.decode_raw(raw)
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn field(bit: u16, bits: u16, data_type: DataType) -> SignalField {
        SignalField::of_object(ObjectAddress::new(0x6000, 1), bit, bits, data_type)
    }

    #[test]
    fn fields_at_bytes_bits_and_across() {
        // 0x01 0xFE 0x80: byte field, signed byte, one bit.
        let payload = [0x01, 0xFE, 0x80];
        assert_eq!(field(0, 16, DataType::Unsigned16).extract_bits(&payload), Some(0xFE01));
        assert_eq!(field(8, 8, DataType::Integer8).extract_bits(&payload), Some(0xFE));
        assert_eq!(field(23, 1, DataType::Boolean).extract_bits(&payload), Some(1));
        assert_eq!(field(4, 12, DataType::Unsigned16).extract_bits(&payload), Some(0xFE0));
        assert_eq!(field(16, 16, DataType::Unsigned16).extract_bits(&payload), None);
    }

    #[test]
    fn sixty_four_bits_off_a_byte_boundary() {
        let payload = [0xF0, 0xFF, 0xFF, 0xFF, 0xFF, 0xFF, 0xFF, 0xFF, 0x0F];
        assert_eq!(field(4, 64, DataType::Unsigned64).extract_bits(&payload), Some(u64::MAX));
    }

    #[test]
    fn the_most_significant_bit_first() {
        let big =
            |bit, bits, data_type| SignalField { order: BitOrder::BigEndian, ..field(bit, bits, data_type) };
        // 0001_0010 0011_0100 0101_0110.
        let payload = [0x12, 0x34, 0x56];
        assert_eq!(big(7, 16, DataType::Unsigned16).extract_bits(&payload), Some(0x1234));
        assert_eq!(big(3, 12, DataType::Unsigned16).extract_bits(&payload), Some(0x234));
        // From bit 5 of byte 0 on: 01_0010 0011_0.
        assert_eq!(big(5, 11, DataType::Unsigned16).extract_bits(&payload), Some(0b010_0100_0110));
        assert_eq!(big(0, 17, DataType::Unsigned24).extract_bits(&payload), Some(0x3456));
        assert_eq!(big(16, 1, DataType::Boolean).extract_bits(&payload), Some(0));
        assert_eq!(big(16, 2, DataType::Unsigned8).extract_bits(&payload), None);
        let nine = [0x01, 0xFF, 0xFF, 0xFF, 0xFF, 0xFF, 0xFF, 0xFF, 0xFE];
        assert_eq!(big(0, 64, DataType::Unsigned64).extract_bits(&nine), Some(u64::MAX));
    }

    #[test]
    fn the_sign_is_the_uppermost_bit_of_the_field() {
        assert_eq!(field(0, 5, DataType::Integer8).convert_raw(0x1F), DecodedValue::Integer(-1));
        assert_eq!(field(0, 5, DataType::Integer8).convert_raw(0x0F), DecodedValue::Integer(15));
        assert_eq!(field(0, 64, DataType::Integer64).convert_raw(u64::MAX), DecodedValue::Integer(-1));
    }

    #[test]
    fn a_multiplexed_field_is_there_when_those_before_it_select_it() {
        let selected = |bit, by, values: &[RangeInclusive<u64>]| SignalField {
            present: Some(FieldSelector { field: by, values: values.to_vec() }),
            ..field(bit, 8, DataType::Unsigned8)
        };
        let layout = PayloadLayout {
            fields: vec![
                field(0, 8, DataType::Unsigned8),
                selected(8, 0, &[1..=1, 4..=6]),
                selected(16, 1, &[9..=9]),
                selected(24, 4, &[0..=255]),
                selected(24, 3, &[0..=255]),
            ],
            ..PayloadLayout::default()
        };
        let bits = |payload: &[u8]| layout.decode_signals(payload).map(|it| it.field.bit).collect::<Vec<_>>();
        assert_eq!(bits(&[5, 9, 7, 0]), [0, 8, 16]);
        assert_eq!(bits(&[1, 8, 7, 0]), [0, 8]);
        // Without the second field, the third is also absent. The last two select each other.
        assert_eq!(bits(&[2, 9, 7, 0]), [0]);
        assert_eq!(layout.decode_signal(2, &[5, 9, 7, 0]).map(|it| it.raw), Some(7));
        assert!(
            layout.decode_signal(2, &[1, 8, 7, 0]).is_none()
                && layout.decode_signal(5, &[5, 9, 7, 0]).is_none()
        );
        assert_eq!(layout.missing_fields(&[5, 9]).map(|it| it.bit).collect::<Vec<_>>(), [16]);
        assert_eq!(layout.missing_fields(&[2]).count(), 0);
    }

    #[test]
    fn fixed_bits_are_compared_within_the_payload() {
        let mut fixed = FixedBits::default();
        fixed.add_field(32, 16, 0);
        fixed.add_field(56, 8, 0xAA);
        assert_eq!(fixed, FixedBits { mask: 0xFF00_FFFF_0000_0000, value: 0xAA00_0000_0000_0000 });
        let word = |bytes: [u8; 8]| u64::from_le_bytes(bytes);
        assert_eq!(fixed.differing_bits(word([7, 0, 0, 16, 0, 0, 9, 0xAA]), 8), 0);
        assert_eq!(fixed.differing_bits(word([7, 0, 0, 16, 0, 1, 9, 0xAA]), 8), 1 << 40);
        // The last byte is not in the payload.
        assert_eq!(fixed.differing_bits(word([7, 0, 0, 16, 0, 0, 0, 0]), 6), 0);
        fixed.add_field(64, 8, 1);
        assert_eq!(fixed.mask, 0xFF00_FFFF_0000_0000);
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
