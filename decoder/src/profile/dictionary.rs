//! Objects by address: name, type, unit, how people read the value.

use std::sync::OnceLock;

use serde::Deserialize;

use super::data_type::{DataType, Value};
use super::parse;
use crate::wire::canopen::ObjectAddress;

/// How a number is read by people.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum Format {
    /// Decimal.
    #[default]
    Decimal,
    /// Hexadecimal, as wide as the type.
    Hex,
    /// A PDO mapping entry: object and width in bits.
    Mapping,
    /// Bytes as characters: the signatures "save" and "load".
    Ascii,
}

/// Objects of one or more documents.
#[derive(Debug, Default)]
pub struct Dictionary {
    objects: Vec<Object>,
}

#[derive(Default, Deserialize)]
#[serde(deny_unknown_fields)]
struct File {
    #[serde(default)]
    object: Vec<Object>,
    #[serde(default, rename = "id")]
    _id: String,
    #[serde(default, rename = "title")]
    _title: String,
    #[serde(default, rename = "source")]
    _source: String,
}

#[derive(Debug, Clone, Deserialize)]
#[serde(deny_unknown_fields)]
struct Object {
    index: u16,
    name: String,
    #[serde(default)]
    repeat: Option<Repeat>,
    #[serde(default)]
    sub: Vec<Entry>,
    #[serde(default, rename = "source")]
    _source: String,
    #[serde(rename = "type", default)]
    data_type: Option<DataType>,
    #[serde(default)]
    unit: String,
    #[serde(default)]
    scale: Option<f64>,
    #[serde(default)]
    format: Format,
    #[serde(default, rename = "access")]
    _access: String,
    #[serde(default, rename = "effect")]
    _effect: String,
}

#[derive(Debug, Clone, Copy, Deserialize)]
#[serde(deny_unknown_fields)]
struct Repeat {
    count: u16,
    stride: u16,
}

#[derive(Debug, Clone, Deserialize)]
#[serde(deny_unknown_fields)]
struct Entry {
    sub: u8,
    #[serde(default)]
    to: Option<u8>,
    name: String,
    #[serde(rename = "type", default)]
    data_type: Option<DataType>,
    #[serde(default)]
    unit: String,
    #[serde(default)]
    scale: Option<f64>,
    #[serde(default)]
    format: Format,
    #[serde(default, rename = "access")]
    _access: String,
    #[serde(default, rename = "effect")]
    _effect: String,
}

/// What is known of one entry.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct ObjectEntry<'a> {
    /// Name of the object.
    pub object_name: &'a str,
    /// Name of the sub-entry, if the object has several.
    pub entry_name: Option<&'a str>,
    /// Data type, if the entry has a fixed one.
    pub data_type: Option<DataType>,
    /// Unit of the scaled value; empty if it has none.
    pub unit: &'a str,
    /// Factor from raw number to `unit`.
    pub scale: f64,
    /// How people read it.
    pub format: Format,
}

impl Dictionary {
    /// The entry at an address.
    pub fn find(&self, address: ObjectAddress) -> Option<ObjectEntry<'_>> {
        let object = self.objects.iter().find(|object| object.covers(address.index))?;
        if object.sub.is_empty() {
            return (address.sub == 0).then_some(ObjectEntry {
                object_name: &object.name,
                entry_name: None,
                data_type: object.data_type,
                unit: &object.unit,
                scale: object.scale.unwrap_or(1.0),
                format: object.format,
            });
        }
        let entry = object.sub.iter().find(|entry| {
            let last = entry.to.unwrap_or(entry.sub);
            (entry.sub..=last).contains(&address.sub)
        });
        Some(ObjectEntry {
            object_name: &object.name,
            entry_name: entry.map(|entry| entry.name.as_str()),
            data_type: entry.and_then(|entry| entry.data_type),
            unit: entry.map_or("", |entry| &entry.unit),
            scale: entry.and_then(|entry| entry.scale).unwrap_or(1.0),
            format: entry.map_or(Format::Decimal, |entry| entry.format),
        })
    }
}

impl Object {
    fn covers(&self, index: u16) -> bool {
        let repeat = self.repeat.unwrap_or(Repeat { count: 1, stride: 1 });
        match index.checked_sub(self.index) {
            Some(distance) => {
                distance % repeat.stride.max(1) == 0 && distance / repeat.stride.max(1) < repeat.count
            }
            None => false,
        }
    }
}

impl ObjectEntry<'_> {
    /// `Producer heartbeat time`, `Identity object, Vendor-ID`.
    pub fn name(&self) -> String {
        match self.entry_name {
            Some(entry) if entry != self.object_name => format!("{}, {entry}", self.object_name),
            _ => self.object_name.to_owned(),
        }
    }

    /// The value of `data`; bytes where the type is unknown.
    pub fn decode(&self, data: &[u8]) -> Value {
        match self.data_type {
            _ if self.format == Format::Ascii => DataType::VisibleString.decode(data),
            Some(data_type) => data_type.decode(data),
            None => Value::Bytes(data.to_vec()),
        }
    }

    /// The value as people write it, with its unit.
    pub fn show(&self, value: &Value) -> String {
        let number = match (value, self.format) {
            (Value::Unsigned(number), Format::Hex) => {
                let digits = usize::from(self.data_type.and_then(DataType::bits).unwrap_or(32).div_ceil(4));
                format!("{number:0digits$X}h")
            }
            // Bits 31..16 index, 15..8 sub-index, 7..0 width (CiA 301 figure 70).
            (Value::Unsigned(number), Format::Mapping) if *number != 0 => {
                format!("{:04X}:{:02X}/{} bit", number >> 16, number >> 8 & 0xFF, number & 0xFF)
            }
            #[expect(clippy::cast_precision_loss, reason = "scaled values are for reading")]
            (Value::Unsigned(number), _) if self.has_scale() => (*number as f64 * self.scale).to_string(),
            #[expect(clippy::cast_precision_loss, reason = "scaled values are for reading")]
            (Value::Integer(number), _) if self.has_scale() => (*number as f64 * self.scale).to_string(),
            _ => value.to_string(),
        };
        if self.unit.is_empty() { number } else { format!("{number} {}", self.unit) }
    }

    fn has_scale(&self) -> bool {
        (self.scale - 1.0).abs() > f64::EPSILON
    }
}

/// The objects CiA 301 (and 302, 304, 305) define at 0x1000..=0x1FFF.
pub fn communication_objects() -> &'static Dictionary {
    static TABLE: OnceLock<Dictionary> = OnceLock::new();
    TABLE.get_or_init(|| Dictionary { objects: parse::<File>("standard/cia301.toml").object })
}

#[cfg(test)]
mod tests {
    use super::*;

    fn entry(index: u16, sub: u8) -> ObjectEntry<'static> {
        communication_objects().find(ObjectAddress::new(index, sub)).unwrap()
    }

    #[test]
    fn names_of_variables_records_and_ranges() {
        assert_eq!(entry(0x1017, 0).name(), "Producer heartbeat time");
        assert_eq!(entry(0x1018, 1).name(), "Identity object, Vendor-ID");
        assert_eq!(entry(0x1A05, 3).data_type, Some(DataType::Unsigned32));
        assert!(communication_objects().find(ObjectAddress::new(0x2000, 0)).is_none());
    }

    #[test]
    fn values_with_units_as_people_write_them() {
        let heartbeat = entry(0x1017, 0);
        assert_eq!(heartbeat.show(&heartbeat.decode(&[0xE8, 3])), "1000 ms");
        let cob_id = entry(0x1800, 1);
        assert_eq!(cob_id.show(&cob_id.decode(&[0x85, 1, 0, 0x80])), "80000185h");
        let mapping = entry(0x1A00, 1);
        assert_eq!(mapping.show(&mapping.decode(&[0x10, 0, 0x41, 0x60])), "6041:00/16 bit");
        let store = entry(0x1010, 1);
        assert_eq!(store.show(&store.decode(b"save")), "\"save\"");
    }
}
