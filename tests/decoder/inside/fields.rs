//! Compares the field table with the fields of events.

use std::collections::BTreeSet;

use crate::event::KindSet;
use crate::query::fields::{FieldDefinition, FieldType, field_table};
use crate::query::record::{FieldConsumer, FieldValue, visit_event};

use super::events;

/// Checks each field of an event against the table.
struct Check {
    kind: &'static str,
    path: Vec<&'static str>,
    reported: BTreeSet<(String, &'static str)>,
}

impl Check {
    fn find(&mut self, key: &'static str) -> &'static FieldDefinition {
        let parts = self.path.iter().copied().chain([key]).filter(|part| !part.is_empty());
        let key = parts.collect::<Vec<_>>().join(".");
        let mut fields = field_table().fields.iter();
        let found = fields.find(|field| field.key == key && field.kinds.names().any(|own| own == self.kind));
        let Some(field) = found else { panic!("{} tells {key}, which the table does not have", self.kind) };
        self.reported.insert((key, self.kind));
        field
    }

    fn enter(&mut self, key: &'static str, is_list: bool) {
        if !key.is_empty() {
            let field = self.find(key);
            assert_eq!(field.list, is_list, "{}", field.key);
            assert!(is_list || field.value == FieldType::Group, "{}", field.key);
        }
        self.path.push(key);
    }
}

impl FieldConsumer for Check {
    fn add_field(&mut self, key: &'static str, value: FieldValue<'_>) {
        let field = self.find(key);
        assert_eq!(field.list, key.is_empty(), "{}", field.key);
        let reported = match value {
            FieldValue::Null => {
                assert!(field.null, "{} of {} is null", field.key, self.kind);
                return;
            }
            FieldValue::Bool(_) => FieldType::Bool,
            FieldValue::Unsigned(_) => FieldType::Unsigned,
            FieldValue::Integer(_) => FieldType::Integer,
            FieldValue::Real(_) => FieldType::Real,
            FieldValue::Text(text) => {
                let is_value = field.values.is_empty() || field.values.iter().any(|value| value == text);
                assert!(is_value, "{} of {} is {text}", field.key, self.kind);
                FieldType::Text
            }
            FieldValue::Seconds(_) => FieldType::Seconds,
            FieldValue::Code(..) => FieldType::Code,
            FieldValue::Id(_) => FieldType::Id,
            FieldValue::Object(_) => FieldType::Object,
            FieldValue::Bytes(_) => FieldType::Bytes,
        };
        assert!(
            field.value == reported || field.value == FieldType::Any,
            "{} is told as {reported:?}",
            field.key
        );
    }

    fn open_group(&mut self, key: &'static str) {
        self.enter(key, false);
    }

    fn close_group(&mut self) {
        self.path.pop();
    }

    fn open_list(&mut self, key: &'static str) {
        self.enter(key, true);
    }

    fn close_list(&mut self) {
        self.path.pop();
    }
}

#[test]
fn every_emitted_field_is_in_the_table_and_every_field_of_the_table_is_emitted() {
    let bus = events::bus();
    let mut check = Check { kind: "", path: Vec::new(), reported: BTreeSet::new() };
    for event in events::all() {
        check.kind = event.kind.name();
        visit_event(&event, &bus, Some("a.log"), &mut check);
    }
    let described = field_table().fields.iter().flat_map(|field| {
        let of_kinds = field.kinds.names();
        of_kinds.map(|kind| (field.key.clone(), kind))
    });
    let never: Vec<_> = described.filter(|pair| !check.reported.contains(pair)).collect();
    assert!(never.is_empty(), "never told: {never:?}");
}

#[test]
fn kinds_are_numbered_as_they_are_named() {
    for event in events::all() {
        let own = KindSet::of(&[event.kind.kind()]);
        assert!(own.contains(&event.kind), "{}", event.kind.name());
        assert!(!own.complement().contains(&event.kind), "{}", event.kind.name());
    }
    let kinds: BTreeSet<_> = events::all().iter().map(|event| event.kind.name()).collect();
    assert_eq!(kinds.len(), KindSet::ALL.names().count());
}
