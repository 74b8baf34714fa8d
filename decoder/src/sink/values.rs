//! Values that come together: those of a PDO, of a J1939 group, of a message that a database describes.

use std::collections::HashMap;
use std::sync::Arc;

use foldhash::fast::FixedState;

use crate::event::{Event, EventKind};
use crate::frame::{BusIndex, CanId};
use crate::profile::{Field, Layout, PdoName, Signal, SignalId};
use crate::query::record::{FieldValue, quantity};
use crate::session::Bus;

/// Values that an event carries.
pub(super) struct Carried<'a> {
    pub(super) group: Group,
    pub(super) layout: &'a Arc<Layout>,
    pub(super) payload: &'a [u8],
}

impl<'a> Carried<'a> {
    /// The values there are, each with what belongs to its field; `others` has one for each field of the layout.
    pub(super) fn with<I: IntoIterator>(&self, others: I) -> impl Iterator<Item = (Signal<'a>, I::Item)> {
        let layout: &'a Layout = self.layout;
        // Fields that are not there leave a gap: what is a field's is told by its place.
        let mut others = layout.fields.iter().zip(others);
        layout.signals(self.payload).filter_map(move |signal| {
            let (_, other) = others.find(|(field, _)| std::ptr::eq(*field, signal.field))?;
            Some((signal, other))
        })
    }
}

/// Which values belong together over time.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash, PartialOrd, Ord)]
pub(super) enum Group {
    /// A PDO of a node.
    Pdo(BusIndex, u8, PdoName),
    /// A parameter group of an address.
    Parameters(BusIndex, u8, u32),
    /// A message of a database.
    Frame(BusIndex, CanId),
}

/// What is remembered of each group as long as its layout stays.
pub(super) struct Groups<T>(HashMap<Group, (Arc<Layout>, T), FixedState>);

impl<T> Default for Groups<T> {
    fn default() -> Self {
        Self(HashMap::default())
    }
}

impl<T> Groups<T> {
    /// What is known of a group; learnt when it comes for the first time, or is laid out anew.
    pub(super) fn of(&mut self, carried: &Carried<'_>, learn: impl FnOnce() -> T) -> Option<&mut T> {
        let known = self.0.get(&carried.group);
        if !known.is_some_and(|(layout, _)| Arc::ptr_eq(layout, carried.layout)) {
            self.0.insert(carried.group, (Arc::clone(carried.layout), learn()));
        }
        self.0.get_mut(&carried.group).map(|(_, known)| known)
    }
}

/// What a group and its fields are called.
pub(super) struct Named {
    pub(super) group: String,
    /// Name and identity of each field of the layout.
    pub(super) fields: Vec<(String, String)>,
}

impl Named {
    pub(super) fn of(carried: &Carried<'_>, bus: &Bus) -> Self {
        let fields = carried.layout.fields.iter();
        let fields = fields.map(|field| (field_name(field), field.id.to_string())).collect();
        Self { group: name(carried.group, bus), fields }
    }
}

/// The values of an event, if it has any whose meaning is known.
pub(super) fn carried(event: &Event) -> Option<Carried<'_>> {
    let (layout, payload) = event.laid_out()?;
    let group = match &event.kind {
        EventKind::Pdo(pdo) => Group::Pdo(event.bus, event.node?.number(), pdo.name),
        EventKind::J1939Message(message) => {
            Group::Parameters(event.bus, message.id.source, message.id.pgn.number())
        }
        EventKind::J1939Transfer(transfer) => {
            Group::Parameters(event.bus, transfer.source, transfer.pgn?.number())
        }
        EventKind::Frame(frame) => Group::Frame(event.bus, frame.frame.id),
        _ => return None,
    };
    Some(Carried { group, layout, payload })
}

/// What values are called together: `node/2/tpdo1`, `sa/80/61444`, `frame/0C8`; with the name of the bus in front on all
/// but the first one.
pub(super) fn name(group: Group, bus: &Bus) -> String {
    let (index, name) = match group {
        Group::Pdo(index, node, name) => {
            (index, format!("node/{node}/{}", name.to_string().to_ascii_lowercase()))
        }
        Group::Parameters(index, source, pgn) => (index, format!("sa/{source:02X}/{pgn}")),
        Group::Frame(index, id) => (index, format!("frame/{id}")),
    };
    if index == BusIndex::default() { name } else { format!("{}/{name}", bus.name()) }
}

/// One value as it is told everywhere.
pub(super) struct Told<'a> {
    pub(super) value: FieldValue<'a>,
    pub(super) label: Option<&'a str>,
}

/// A signal's value in its unit, and its name.
pub(super) fn told<'a>(signal: &'a Signal<'a>) -> Told<'a> {
    let (value, label) = quantity(signal.field.meaning.as_deref(), &signal.value);
    Told { value, label }
}

/// The unit of a field's values; empty without one.
pub(super) fn unit(field: &Field) -> &str {
    field.meaning.as_deref().map_or("", |meaning| &meaning.unit)
}

/// What a field is called: its name, else its object or parameter, else its place.
pub(super) fn field_name(field: &Field) -> String {
    match (field.name(), field.id) {
        (Some(name), _) if !name.is_empty() => name.to_owned(),
        (_, SignalId::Name) => format!("bits {}", field.bit),
        (_, id) => id.to_string(),
    }
}

/// The first spelling that is not among those taken: without a number, then with 2, 3 and so on.
pub(super) fn not_taken(taken: &[String], spell: impl Fn(Option<u32>) -> String) -> String {
    let numbers = std::iter::once(None).chain((2..).map(Some));
    numbers.map(spell).find(|spelt| !taken.contains(spelt)).unwrap_or_default()
}

/// Names of all fields of a layout as identifiers, each once: letters, digits and `_`.
#[cfg(feature = "mcap")]
pub(super) fn keys(layout: &Layout) -> Vec<String> {
    let mut keys: Vec<String> = Vec::new();
    for field in &layout.fields {
        let plain = identifier(&field_name(field));
        keys.push(not_taken(&keys, |number| {
            number.map_or(plain.clone(), |number| format!("{plain}_{number}"))
        }));
    }
    keys
}

#[cfg(feature = "mcap")]
fn identifier(name: &str) -> String {
    let mut key = String::new();
    for letter in name.chars() {
        if letter.is_ascii_alphanumeric() {
            key.push(letter);
        } else if !key.is_empty() && !key.ends_with('_') {
            key.push('_');
        }
    }
    let key = key.trim_end_matches('_');
    if key.is_empty() || key.starts_with(|first: char| first.is_ascii_digit()) {
        format!("_{key}")
    } else {
        key.to_owned()
    }
}

#[cfg(all(test, feature = "mcap"))]
mod tests {
    use super::*;
    use crate::profile::DataType;
    use crate::wire::canopen::ObjectAddress;

    #[test]
    fn names_become_identifiers_each_once() {
        assert_eq!(identifier("Actual pressure (p1)"), "Actual_pressure_p1");
        assert_eq!(identifier("6041:00"), "_6041_00");
        assert_eq!(identifier("°"), "_");
        let field = |index| Field::of_object(ObjectAddress::new(index, 0), 0, 8, DataType::Unsigned8);
        let layout = Layout { fields: vec![field(0x6041), field(0x6041)], ..Layout::default() };
        assert_eq!(keys(&layout), ["_6041_00", "_6041_00_2"]);
    }
}
