//! Decoded values of one PDO, J1939 parameter group or DBC message, as the value formats write them.

use std::borrow::Cow;
use std::collections::HashMap;
use std::collections::hash_map::Entry;
use std::sync::Arc;

use foldhash::fast::FixedState;

use crate::event::{Event, EventKind, ExchangeOutcome, SdoDirection, SdoOutcome, SdoTransfer};
use crate::frame::{BusIndex, CanId};
use crate::profile::{
    DecodedSignal, DecodedValue, ObjectMeaning, PayloadLayout, PdoName, SignalField, SignalId, ValueIn,
    uds_names,
};
use crate::query::record::{FieldValue, quantity_value};
use crate::session::Bus;
use crate::wire::NodeId;

/// Decoded values of an event.
pub(super) struct EventValues<'a> {
    pub(super) group: ValueGroupKey,
    pub(super) layout: &'a Arc<PayloadLayout>,
    pub(super) payload: &'a [u8],
}

impl<'a> EventValues<'a> {
    /// Each value in the payload, with the entry of `others` for its field; `others` has one entry per field
    /// of the layout.
    pub(super) fn zip_values<I: IntoIterator>(
        &self,
        others: I,
    ) -> impl Iterator<Item = (DecodedSignal<'a>, I::Item)> {
        let layout: &'a PayloadLayout = self.layout;
        // Absent fields leave gaps, so entries are matched by field, not by position.
        let mut others = layout.fields.iter().zip(others);
        layout.decode_signals(self.payload).filter_map(move |signal| {
            let (_, other) = others.find(|(field, _)| std::ptr::eq(*field, signal.field))?;
            Some((signal, other))
        })
    }
}

/// Identity of a group of values over time.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash, PartialOrd, Ord)]
pub(super) enum ValueGroupKey {
    /// A PDO of a node.
    Pdo(BusIndex, u8, PdoName),
    /// A parameter group from one source address.
    Parameters(BusIndex, u8, u32),
    /// A message described by a database.
    Frame(BusIndex, CanId),
}

/// Cached data per group; recomputed if the layout changes.
pub(super) struct CachedGroups<T>(HashMap<ValueGroupKey, (Arc<PayloadLayout>, T), FixedState>);

impl<T> Default for CachedGroups<T> {
    fn default() -> Self {
        Self(HashMap::default())
    }
}

impl<T> CachedGroups<T> {
    /// Cached data of a group; `learn` computes it for a new group or a new layout.
    pub(super) fn cached_or_learn(&mut self, carried: &EventValues<'_>, learn: impl FnOnce() -> T) -> &mut T {
        let learned = || (Arc::clone(carried.layout), learn());
        match self.0.entry(carried.group) {
            Entry::Vacant(unknown) => &mut unknown.insert(learned()).1,
            Entry::Occupied(known) => {
                let known = known.into_mut();
                if !Arc::ptr_eq(&known.0, carried.layout) {
                    *known = learned();
                }
                &mut known.1
            }
        }
    }
}

/// Name, identity and last label of a field.
pub(super) struct FieldNames {
    pub(super) name: String,
    pub(super) id: String,
    pub(super) label: LabelCache,
}

/// Name of a group and names of its fields.
pub(super) struct GroupNames {
    pub(super) group: String,
    /// Name, identity and last label of each field of the layout.
    pub(super) fields: Vec<FieldNames>,
}

impl GroupNames {
    pub(super) fn names_of(carried: &EventValues<'_>, bus: &Bus) -> Self {
        let fields = carried.layout.fields.iter();
        let fields = fields.map(|field| FieldNames {
            name: field_name(field),
            id: field.id.to_string(),
            label: LabelCache::default(),
        });
        let fields = fields.collect();
        Self { group: group_name(carried.group, bus), fields }
    }
}

/// Values of an event; `None` without a layout.
pub(super) fn carried_values(event: &Event) -> Option<EventValues<'_>> {
    let (layout, payload) = event.laid_out()?;
    let group = match &event.kind {
        EventKind::Pdo(pdo) => ValueGroupKey::Pdo(event.bus, event.node?.number(), pdo.name),
        EventKind::J1939Message(message) => {
            ValueGroupKey::Parameters(event.bus, message.id.source, message.id.pgn.number())
        }
        EventKind::J1939Transfer(transfer) => {
            ValueGroupKey::Parameters(event.bus, transfer.source, transfer.pgn?.number())
        }
        EventKind::Frame(frame) => ValueGroupKey::Frame(event.bus, frame.frame.id),
        _ => return None,
    };
    Some(EventValues { group, layout, payload })
}

/// Value that a service transferred.
pub(super) struct TransferredValue<'a> {
    /// `node/2/sdo-read`, `node/2/sdo-write`, `sa/80/uds-read`, `sa/80/uds-write`.
    pub(super) group: String,
    pub(super) name: &'a str,
    /// Object or data identifier.
    pub(super) id: String,
    pub(super) value: DecodedValue,
    pub(super) meaning: Option<&'a ObjectMeaning>,
}

/// Value of a completed SDO transfer or UDS service; `None` for all other events.
pub(super) fn transferred_value<'a>(event: &'a Event, bus: &Bus) -> Option<TransferredValue<'a>> {
    let node = match event.node {
        Some(NodeId::Canopen(id)) => format!("node/{id}/"),
        Some(NodeId::J1939(address)) => format!("sa/{address:02X}/"),
        None => String::new(),
    };
    let place = if event.bus == BusIndex::default() { node } else { format!("{}/{node}", bus.name()) };
    match &event.kind {
        EventKind::SdoTransfer(transfer) => transferred_object(transfer, &place),
        EventKind::UdsExchange(exchange) => {
            let is_read = uds_names().service_by_id(exchange.service)?.value_in() == Some(ValueIn::Response);
            let value = exchange.decoded_value().filter(|_| exchange.outcome == ExchangeOutcome::Positive)?;
            Some(TransferredValue {
                group: format!("{place}uds-{}", if is_read { "read" } else { "write" }),
                name: exchange.name().unwrap_or_default(),
                id: exchange.identifier.map_or(String::new(), |identifier| format!("{identifier:04X}")),
                value,
                meaning: exchange.meaning.as_deref(),
            })
        }
        _ => None,
    }
}

fn transferred_object<'a>(transfer: &'a SdoTransfer, place: &str) -> Option<TransferredValue<'a>> {
    let is_whole = transfer.outcome == SdoOutcome::Complete && !transfer.truncated && !transfer.cut_start;
    let (object, direction) = transfer.object.zip(transfer.direction)?;
    if !is_whole || transfer.data.is_empty() {
        return None;
    }
    let meaning = transfer.meaning.as_deref();
    Some(TransferredValue {
        group: format!("{place}sdo-{}", if direction == SdoDirection::Upload { "read" } else { "write" }),
        name: meaning.map_or("", |meaning| &meaning.name),
        id: object.to_string(),
        value: meaning.map_or_else(
            || DecodedValue::Bytes(transfer.data.clone()),
            |meaning| meaning.decode(&transfer.data),
        ),
        meaning,
    })
}

/// Name of a group: `node/2/tpdo1`, `sa/80/61444`, `frame/0C8`; prefixed with the bus name on all buses but
/// the first.
pub(super) fn group_name(group: ValueGroupKey, bus: &Bus) -> String {
    let (index, name) = match group {
        ValueGroupKey::Pdo(index, node, name) => {
            (index, format!("node/{node}/{}", name.to_string().to_ascii_lowercase()))
        }
        ValueGroupKey::Parameters(index, source, pgn) => (index, format!("sa/{source:02X}/{pgn}")),
        ValueGroupKey::Frame(index, id) => (index, format!("frame/{id}")),
    };
    if index == BusIndex::default() { name } else { format!("{}/{name}", bus.name()) }
}

/// A value with its label, as all formats write it.
pub(super) struct SignalReading<'a> {
    pub(super) value: FieldValue<'a>,
    pub(super) label: Option<&'a str>,
}

/// Label of the last raw value of a field: the texts of bits are composed only when they change.
#[derive(Debug, Default)]
pub(super) struct LabelCache {
    last: Option<u64>,
    text: Option<String>,
}

/// Value of a signal in its unit, and its label.
pub(super) fn signal_reading<'a>(
    signal: &'a DecodedSignal<'a>,
    cache: &'a mut LabelCache,
) -> SignalReading<'a> {
    let meaning = signal.field.meaning.as_deref();
    let composed = meaning.filter(|meaning| meaning.is_composed());
    let label = match (composed, meaning) {
        (Some(meaning), _) => {
            if cache.last != Some(signal.raw) {
                let text = meaning.description(&signal.value).map(Cow::into_owned);
                *cache = LabelCache { last: Some(signal.raw), text };
            }
            cache.text.as_deref()
        }
        (None, meaning) => meaning.and_then(|meaning| meaning.value_label(&signal.value)),
    };
    SignalReading { value: quantity_value(meaning, &signal.value), label }
}

/// Unit of the values of a field; empty without one.
pub(super) fn field_unit(field: &SignalField) -> &str {
    field.meaning.as_deref().map_or("", |meaning| &meaning.unit)
}

/// Name of a field: its own name, else its object or parameter, else its bit position.
pub(super) fn field_name(field: &SignalField) -> String {
    match (field.name(), field.id) {
        (Some(name), _) if !name.is_empty() => name.to_owned(),
        (_, SignalId::Name) => format!("bits {}", field.bit),
        (_, id) => id.to_string(),
    }
}

/// First spelling not in `taken`: without a number, then with 2, 3 and so on.
pub(super) fn not_taken(taken: &[String], spell: impl Fn(Option<u32>) -> String) -> String {
    let numbers = std::iter::once(None).chain((2..).map(Some));
    numbers.map(spell).find(|spelt| !taken.contains(spelt)).unwrap_or_default()
}

/// Unique identifiers for all fields of a layout, made of letters, digits and `_`.
#[cfg(feature = "mcap")]
pub(super) fn unique_keys(layout: &PayloadLayout) -> Vec<String> {
    let mut keys: Vec<String> = Vec::new();
    for field in &layout.fields {
        let plain = to_identifier(&field_name(field));
        keys.push(not_taken(&keys, |number| {
            number.map_or(plain.clone(), |number| format!("{plain}_{number}"))
        }));
    }
    keys
}

#[cfg(feature = "mcap")]
fn to_identifier(name: &str) -> String {
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
    fn names_become_unique_identifiers() {
        assert_eq!(to_identifier("Actual pressure (p1)"), "Actual_pressure_p1");
        assert_eq!(to_identifier("6041:00"), "_6041_00");
        assert_eq!(to_identifier("°"), "_");
        let field = |index| SignalField::of_object(ObjectAddress::new(index, 0), 0, 8, DataType::Unsigned8);
        let layout = PayloadLayout { fields: vec![field(0x6041), field(0x6041)], ..PayloadLayout::default() };
        assert_eq!(unique_keys(&layout), ["_6041_00", "_6041_00_2"]);
    }
}
