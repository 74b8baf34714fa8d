//! Filter expressions for the cells of an event: its subject and its kind.
//!
//! ```text
//! Kind    Object                     filters
//! SDO r   1018:01 Vendor-ID          kind == "sdo-transfer" && direction == "upload"     object == 0x1018:01
//! EMCY    8305                       kind == "emcy"                                      code == 0x8305
//! ```

use super::record::{FieldConsumer, FieldValue, direction_name, visit_event};
use crate::event::{Event, EventKind};
use crate::session::Bus;

/// Fields that name the subject of an event, the most specific first.
const SUBJECTS: [&str; 6] = ["object", "code", "pdo", "spn", "pgn", "service_id"];

/// Filter for the subject of an event: object, code, PDO, trouble code, PGN or service. `None` without one.
pub fn subject_filter(event: &Event, bus: &Bus) -> Option<String> {
    let mut found = SubjectFields::default();
    visit_event(event, bus, None, &mut found);
    let (_, field, value) = found.best?;
    Some(format!("{field} == {value}"))
}

/// Filter for the kind of an event as it is shown: SDO uploads and downloads are two kinds.
pub fn kind_filter(event: &Event) -> String {
    let kind = format!("kind == {:?}", event.kind.name());
    match &event.kind {
        EventKind::SdoTransfer(transfer) => match transfer.direction {
            Some(known) => format!("{kind} && direction == {:?}", direction_name(known)),
            None => kind,
        },
        _ => kind,
    }
}

/// Selects the most specific of the fields outside groups and lists.
#[derive(Default)]
struct SubjectFields {
    depth: usize,
    /// Index in [`SUBJECTS`], field and value in filter syntax.
    best: Option<(usize, &'static str, String)>,
}

impl FieldConsumer for SubjectFields {
    fn add_field(&mut self, key: &'static str, value: FieldValue<'_>) {
        let Some(rank) = SUBJECTS.iter().position(|name| *name == key).filter(|_| self.depth == 0) else {
            return;
        };
        let text = match value {
            FieldValue::Unsigned(number) => number.to_string(),
            FieldValue::Text(text) => format!("{text:?}"),
            FieldValue::Code(code, digits) => format!("0x{code:0width$X}", width = usize::from(digits)),
            FieldValue::Object(object) => format!("0x{object}"),
            _ => return,
        };
        if self.best.as_ref().is_none_or(|(best, ..)| rank < *best) {
            self.best = Some((rank, key, text));
        }
    }

    fn open_group(&mut self, _key: &'static str) {
        self.depth = self.depth.saturating_add(1);
    }

    fn close_group(&mut self) {
        self.depth = self.depth.saturating_sub(1);
    }

    fn open_list(&mut self, _key: &'static str) {
        self.depth = self.depth.saturating_add(1);
    }

    fn close_list(&mut self) {
        self.depth = self.depth.saturating_sub(1);
    }

    fn wants_signals(&self) -> bool {
        false
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Nested fields, texts of other fields and unknown values are no subject.
    #[test]
    fn the_most_specific_field_outside_groups_is_the_subject() {
        let mut found = SubjectFields::default();
        found.open_group("cause");
        found.add_field("object", FieldValue::Text("nested"));
        found.close_group();
        found.add_field("code", FieldValue::Null);
        found.add_field("pgn", FieldValue::Unsigned(65_226));
        found.add_field("spn", FieldValue::Unsigned(110));
        found.add_field("service_id", FieldValue::Code(0x22, 2));
        found.add_field("name", FieldValue::Text("oil"));
        assert_eq!(found.best, Some((3, "spn", "110".to_owned())));
        found.add_field("code", FieldValue::Code(0x8305, 4));
        assert_eq!(found.best, Some((1, "code", "0x8305".to_owned())));
    }
}
