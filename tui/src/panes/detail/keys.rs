//! All fields of an event under their filter names.
//!
//! ```text
//! code = 0x8305
//! signals.name = Spool set point
//! ```

use cobscope_decoder::event::Event;
use cobscope_decoder::query::Filter;
use cobscope_decoder::query::record::{FieldConsumer, FieldValue, visit_event};
use cobscope_decoder::session::Bus;

/// Maximum number of data bytes shown.
const SHOWN_BYTES: usize = 32;

/// Last word in the names of fields that contain frame numbers; the field [`FRAMES`] is about the event itself.
const FRAME: &str = "frame";
const FRAMES: &str = "frames";

/// A field of an event.
#[derive(Debug, Clone, PartialEq, Eq)]
pub(super) struct EventField {
    /// Name as in filters: `object.index`.
    pub(super) name: String,
    /// Value as in filters.
    pub(super) value: String,
    /// Filter for this value; None if filters cannot express it.
    pub(super) filter: Option<String>,
    /// Frame number in the value, other than the frames of the event.
    pub(super) frame: Option<u64>,
}

pub(super) fn event_fields(event: &Event, bus: &Bus) -> Vec<EventField> {
    let mut keys = EventFields { all: Vec::new(), path: Vec::new() };
    visit_event(event, bus, None, &mut keys);
    keys.all
}

struct EventFields {
    all: Vec<EventField>,
    path: Vec<&'static str>,
}

impl FieldConsumer for EventFields {
    fn add_field(&mut self, key: &'static str, value: FieldValue<'_>) {
        let parts = self.path.iter().copied().chain([key]).filter(|part| !part.is_empty());
        let name = parts.collect::<Vec<_>>().join(".");
        let frame = match value {
            FieldValue::Unsigned(frame) if names_a_frame(&name) && frame > 0 => Some(frame),
            _ => None,
        };
        let mut value_text = filter_value(value);
        let filter = format!("{name} == {value_text}");
        let filter = (value != FieldValue::Null && filter.parse::<Filter>().is_ok()).then_some(filter);
        if let FieldValue::Bytes(bytes) = value
            && bytes.len() > SHOWN_BYTES
        {
            value_text = filter_value(FieldValue::Bytes(bytes.get(..SHOWN_BYTES).unwrap_or(bytes))) + " …";
        }
        let key = EventField { name, value: value_text, filter, frame };
        // For a single frame the first and last frame field are equal.
        if self.all.last() != Some(&key) {
            self.all.push(key);
        }
    }

    fn open_group(&mut self, key: &'static str) {
        self.path.push(key);
    }

    fn close_group(&mut self) {
        self.path.pop();
    }

    fn open_list(&mut self, key: &'static str) {
        self.path.push(key);
    }

    fn close_list(&mut self) {
        self.path.pop();
    }
}

/// Whether the field contains a frame number.
fn names_a_frame(name: &str) -> bool {
    let last = name.rsplit('.').next().unwrap_or(name);
    last.ends_with(FRAME) || last.ends_with(FRAMES) && name != FRAMES
}

/// A value in filter syntax.
fn filter_value(value: FieldValue<'_>) -> String {
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
