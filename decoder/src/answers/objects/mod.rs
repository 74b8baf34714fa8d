//! Object values of nodes, as `cobscope objects -f json` prints them.

mod expected;
pub mod text;

use serde::Serialize;

use super::numbers::{format_bytes, seconds_after};
use crate::ascii::push_hex;
use crate::escape::escape;
use crate::frame::Timestamp;
use crate::profile::{DecodedValue, Persistence};
use crate::session::{Bus, Node, PendingValue, StoredObject};
use crate::wire::canopen::ObjectAddress;
pub use expected::ExpectedValues;

/// The value of one object.
#[derive(Debug, Clone, Serialize)]
pub struct ObjectRecord {
    /// Name of the bus.
    pub bus: String,
    /// Name of the capture.
    pub capture: String,
    /// Bytes in hexadecimal digits, of a long value the first 1024.
    pub data: String,
    /// Frame that carried the value; null for a value from a file.
    pub frame: Option<u64>,
    /// Name of the object.
    pub name: Option<String>,
    /// Node-ID.
    pub node: u8,
    /// Index and sub-index.
    pub object: String,
    /// download, upload, pdo, bus-file or dcf.
    pub origin: &'static str,
    /// Whether the value outlives a restart: yes, no or not-stored; null if unknown.
    pub persists: Option<&'static str>,
    /// Number of bytes of the complete value.
    pub size: u64,
    /// The value may have changed since.
    pub stale: bool,
    /// Unit of the scaled value.
    pub unit: Option<String>,
    /// Number or text; null for bytes.
    pub value: Option<ObjectValue>,
    /// New value that is not in effect yet.
    pub waiting: Option<WaitingValue>,
}

/// A number or a text.
#[derive(Debug, Clone, Serialize)]
#[serde(untagged)]
pub enum ObjectValue {
    /// Unsigned integer or Boolean.
    Unsigned(u64),
    /// Signed integer.
    Integer(i64),
    /// Real number.
    Real(f64),
    /// Text.
    Text(String),
}

/// A written value that is not in effect yet.
#[derive(Debug, Clone, Serialize)]
pub struct WaitingValue {
    /// Bytes in hexadecimal digits.
    pub data: String,
    /// What brings it into effect.
    pub effective: &'static str,
    /// Frame that carried it.
    pub frame: Option<u64>,
}

/// An object of a node in a list. Its texts are escaped.
#[derive(Debug, Clone, Serialize)]
pub struct ShownObject {
    /// Frame that carried the value; 0 for a value from a file.
    pub frame: u64,
    /// Name of the object.
    pub name: Option<String>,
    /// Index and sub-index.
    pub object: String,
    /// Origin of the value.
    pub origin: &'static str,
    /// Bytes of the new value that is not in effect yet.
    pub pending: Option<String>,
    /// Whether the value outlives a restart.
    pub persists: Option<&'static str>,
    /// Bytes of the value.
    pub raw: String,
    /// Seconds from the first frame to the value.
    pub time: Option<f64>,
    /// Value with its unit, and ? if it may have changed since.
    pub value: Option<String>,
}

/// A node with its number of known objects.
#[derive(Debug, Clone, Serialize)]
pub struct ObjectCount {
    /// Name of the bus.
    pub bus: String,
    /// Name of the capture.
    pub capture: String,
    /// Node-ID.
    pub node: u8,
    /// Number of known objects.
    pub objects: usize,
}

/// An object compared with its value in a DCF or XDC.
#[derive(Debug, Clone, Serialize)]
pub struct ExpectedObject {
    /// Name of the bus.
    pub bus: String,
    /// Name of the capture.
    pub capture: String,
    /// Bytes of the value; null if it was never seen.
    pub data: Option<String>,
    /// Frame that carried the value.
    pub frame: Option<u64>,
    /// Name of the object.
    pub name: Option<String>,
    /// Node-ID.
    pub node: u8,
    /// Index and sub-index.
    pub object: String,
    /// download, upload, pdo or bus-file; null if the value was never seen.
    pub origin: Option<&'static str>,
    /// equal, differs or never-seen.
    pub result: &'static str,
    /// The value may have changed since.
    pub stale: Option<bool>,
    /// Bytes of the expected value.
    pub wanted: String,
}

impl ObjectRecord {
    /// An object of a node.
    pub fn new(
        (bus, node): (&Bus, &Node),
        (object, entry): (ObjectAddress, &StoredObject),
        capture: &str,
    ) -> Self {
        let known = node.meaning(object);
        let value = known.as_ref().map(|known| known.decode(&entry.value));
        Self {
            bus: bus.name().to_owned(),
            capture: capture.to_owned(),
            data: format_hex(&entry.value),
            frame: carrier(entry.origin.frame),
            name: known.as_ref().map(|known| known.name.clone()),
            node: node.id().number(),
            object: format!("0x{object}"),
            origin: entry.origin.kind.name(),
            persists: node.persistence_text(object).map(Persistence::name),
            size: entry.size,
            stale: entry.stale,
            unit: known.map(|known| known.unit.clone()).filter(|unit| !unit.is_empty()),
            value: value.and_then(ObjectValue::new),
            waiting: node.store().waiting_value(object).map(WaitingValue::new),
        }
    }
}

impl ShownObject {
    /// An object of a node; `zero` is the time of the first frame.
    pub fn new(
        node: &Node,
        (object, entry): (ObjectAddress, &StoredObject),
        zero: Option<Timestamp>,
    ) -> Self {
        let meaning = node.meaning(object);
        let value = meaning.as_ref().map(|meaning| meaning.format_value(&meaning.decode(&entry.value)));
        Self {
            frame: entry.origin.frame,
            name: meaning.map(|meaning| escape(&meaning.name).into_owned()),
            object: object.to_string(),
            origin: entry.origin.kind.origin_text(),
            pending: node.store().waiting_value(object).map(|pending| format_bytes(&pending.value)),
            persists: node.persistence_text(object).map(Persistence::name),
            raw: format_bytes(&entry.value),
            time: seconds_after(entry.origin.time, zero),
            value: value.map(|value| format!("{}{}", escape(&value), if entry.stale { "?" } else { "" })),
        }
    }
}

impl ObjectValue {
    fn new(value: DecodedValue) -> Option<Self> {
        match value {
            DecodedValue::Unsigned(value) => Some(Self::Unsigned(value)),
            DecodedValue::Integer(value) => Some(Self::Integer(value)),
            DecodedValue::Real(value) => Some(Self::Real(value)),
            DecodedValue::Text(text) => Some(Self::Text(text)),
            DecodedValue::Bytes(_) => None,
        }
    }
}

impl WaitingValue {
    fn new(value: &PendingValue) -> Self {
        Self {
            data: format_hex(&value.value),
            effective: value.effect.name(),
            frame: carrier(value.origin.frame),
        }
    }
}

impl ObjectCount {
    /// The count of a node.
    pub fn new(bus: &Bus, node: &Node, capture: &str) -> Self {
        Self {
            bus: bus.name().to_owned(),
            capture: capture.to_owned(),
            node: node.id().number(),
            objects: node.store().len(),
        }
    }
}

impl ExpectedObject {
    /// An object of a node with its expected bytes; `entry` is `None` for a value that was never seen.
    pub fn new(
        (bus, node): (&Bus, &Node),
        (object, entry): (ObjectAddress, Option<&StoredObject>),
        (result, wanted): (&'static str, &[u8]),
        capture: &str,
    ) -> Self {
        Self {
            bus: bus.name().to_owned(),
            capture: capture.to_owned(),
            data: entry.map(|entry| format_hex(&entry.value)),
            frame: entry.and_then(|entry| carrier(entry.origin.frame)),
            name: node.meaning(object).map(|meaning| meaning.name.clone()),
            node: node.id().number(),
            object: format!("0x{object}"),
            origin: entry.map(|entry| entry.origin.kind.name()),
            result,
            stale: entry.map(|entry| entry.stale),
            wanted: format_hex(wanted),
        }
    }
}

/// Frame of a value; `None` for a value from a file.
fn carrier(frame: u64) -> Option<u64> {
    Some(frame).filter(|frame| *frame != 0)
}

/// Hex pairs without spaces.
fn format_hex(bytes: &[u8]) -> String {
    let mut digits = Vec::new();
    push_hex(&mut digits, bytes);
    String::from_utf8_lossy(&digits).into_owned()
}
