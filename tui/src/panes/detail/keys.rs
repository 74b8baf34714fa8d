//! All fields of an event by the names filters know them by.
//!
//! ```text
//! code = 0x8305
//! signals.name = Spool set point
//! ```

use cobscope_decoder::event::Event;
use cobscope_decoder::query::Filter;
use cobscope_decoder::query::record::{FieldValue, Fields, visit};
use cobscope_decoder::session::Bus;

/// Bytes of data that are written.
const SHOWN_BYTES: usize = 32;

/// One field.
#[derive(Debug, Clone, PartialEq, Eq)]
pub(super) struct Key {
    /// Its name, as filters have it.
    pub(super) name: String,
    /// Its value, as filters have it.
    pub(super) value: String,
    /// The filter that wants it.
    pub(super) filter: Option<String>,
    /// A frame other than the event's own that it names.
    pub(super) frame: Option<u64>,
}

/// All fields of an event.
pub(super) fn of(event: &Event, bus: &Bus) -> Vec<Key> {
    let mut keys = Keys { all: Vec::new(), path: Vec::new() };
    visit(event, bus, None, &mut keys);
    keys.all
}

struct Keys {
    all: Vec<Key>,
    path: Vec<&'static str>,
}

impl Fields for Keys {
    fn field(&mut self, key: &'static str, value: FieldValue<'_>) {
        let parts = self.path.iter().copied().chain([key]).filter(|part| !part.is_empty());
        let name = parts.collect::<Vec<_>>().join(".");
        let frame = match value {
            FieldValue::Unsigned(frame) if names_a_frame(&name) && frame > 0 => Some(frame),
            _ => None,
        };
        let mut value_text = text(value);
        let filter = format!("{name} == {value_text}");
        let filter = (value != FieldValue::Null && filter.parse::<Filter>().is_ok()).then_some(filter);
        if let FieldValue::Bytes(bytes) = value
            && bytes.len() > SHOWN_BYTES
        {
            value_text = text(FieldValue::Bytes(bytes.get(..SHOWN_BYTES).unwrap_or(bytes))) + " …";
        }
        let key = Key { name, value: value_text, filter, frame };
        // Of one frame the first and the last one are the same.
        if self.all.last() != Some(&key) {
            self.all.push(key);
        }
    }

    fn open(&mut self, key: &'static str) {
        self.path.push(key);
    }

    fn close(&mut self) {
        self.path.pop();
    }

    fn open_list(&mut self, key: &'static str) {
        self.path.push(key);
    }

    fn close_list(&mut self) {
        self.path.pop();
    }
}

/// Whether a number under this name is that of a frame.
fn names_a_frame(name: &str) -> bool {
    let last = name.rsplit('.').next().unwrap_or(name);
    last.ends_with("frame") || last.ends_with("frames") && name != "frames"
}

/// A value as a filter would have it.
fn text(value: FieldValue<'_>) -> String {
    match value {
        FieldValue::Null => "null".into(),
        FieldValue::Bool(value) => value.to_string(),
        FieldValue::Unsigned(value) => value.to_string(),
        FieldValue::Integer(value) => value.to_string(),
        FieldValue::Real(value) => value.to_string(),
        FieldValue::Text(text) => format!("{text:?}"),
        FieldValue::Seconds(value) => cobscope_decoder::frame::Timestamp(value).to_string(),
        FieldValue::Code(value, digits) => format!("0x{value:0width$X}", width = usize::from(digits)),
        FieldValue::Id(id) => format!("0x{id}"),
        FieldValue::Object(object) => format!("0x{object}"),
        FieldValue::Bytes(bytes) => {
            let pairs: Vec<_> = bytes.iter().map(|byte| format!("{byte:02X}")).collect();
            pairs.join(":")
        }
    }
}
