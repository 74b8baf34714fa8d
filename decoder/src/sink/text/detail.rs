//! All fields of an event, indented below its line.

use crate::escape::escape;
use crate::event::{Event, EventKind};
use crate::profile;
use crate::query::record::{FieldConsumer, FieldValue, visit_event};
use crate::session::Bus;

/// Fields already shown in the event line.
const ABOVE: &[&str] = &["t", "bus", "frames", "kind", "protocol", "node", "node_name", "presumed"];

/// Fields of an event, one per line.
pub(super) fn detail_lines(event: &Event, bus: &Bus) -> String {
    let mut text = String::new();
    let mut lines = DetailLines { text: &mut text, path: Vec::new() };
    visit_event(event, bus, None, &mut lines);
    if let Some(hint) = error_hint(event) {
        lines.push_line("hint", hint);
    }
    text
}

/// Usual cause of an error.
fn error_hint(event: &Event) -> Option<&'static str> {
    let hint = match &event.kind {
        EventKind::SdoTransfer(transfer) => &profile::abort_codes().find_code(transfer.abort?.code)?.hint,
        EventKind::Emcy(emergency) => {
            &profile::emcy_codes().find_code(u32::from(emergency.code.filter(|code| *code != 0)?))?.hint
        }
        _ => return None,
    };
    (!hint.is_empty()).then_some(hint.as_str())
}

struct DetailLines<'a> {
    text: &'a mut String,
    path: Vec<&'static str>,
}

impl DetailLines<'_> {
    fn push_line(&mut self, key: &str, value: &str) {
        self.text.push_str("             ");
        let parts = self.path.iter().copied().chain([key]).filter(|part| !part.is_empty());
        self.text.push_str(&parts.collect::<Vec<_>>().join("."));
        self.text.push_str(": ");
        self.text.push_str(&escape(value));
        self.text.push('\n');
    }
}

impl FieldConsumer for DetailLines<'_> {
    fn add_field(&mut self, key: &'static str, value: FieldValue<'_>) {
        if self.path.is_empty() && ABOVE.contains(&key)
            || self.path.first().is_some_and(|first| ABOVE.contains(first))
        {
            return;
        }
        let value = match value {
            FieldValue::Null | FieldValue::Bytes([]) => return,
            FieldValue::Bool(value) => value.to_string(),
            FieldValue::Unsigned(value) => value.to_string(),
            FieldValue::Integer(value) => value.to_string(),
            FieldValue::Real(value) => value.to_string(),
            FieldValue::Text(text) => text.to_owned(),
            FieldValue::Seconds(value) => format!("{} s", crate::frame::Timestamp(value)),
            FieldValue::Code(value, digits) => format!("{value:0width$X}h", width = usize::from(digits)),
            FieldValue::Id(id) => id.to_string(),
            FieldValue::Object(object) => object.to_string(),
            FieldValue::Bytes(bytes) => profile::DecodedValue::Bytes(bytes.to_vec()).to_string(),
        };
        self.push_line(key, &value);
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
