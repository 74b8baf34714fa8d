//! A signal: a field of an identifier, and its position in another layout of the same identifier.
//!
//! ```text
//! 182#08A01FF91F   ▸ TPDO1 of 2/02 ▸ field 2 of its layout ▸ 5002:00 actual pressure, bar
//! ```

use std::sync::Arc;

use crate::escape::escape;
use crate::event::{Event, EventKind};
use crate::frame::{BusIndex, CanId, FrameFlags};
use crate::profile::{DecodedValue, PayloadLayout, SignalField, SignalId};

/// A signal: a field in the payload of an identifier.
#[derive(Debug, Clone)]
pub struct SignalKey {
    /// Bus of the identifier.
    pub bus: BusIndex,
    /// CAN identifier.
    pub id: CanId,
    /// Index of the field in `layout`.
    pub field: usize,
    /// Displayed name.
    pub name: String,
    /// Displayed unit.
    pub unit: String,
    /// Layout from which the signal was chosen.
    pub layout: Arc<PayloadLayout>,
}

/// Signals with different scales are equal; signals with different units are not.
impl PartialEq for SignalKey {
    fn eq(&self, other: &Self) -> bool {
        (self.bus, self.id, &self.unit) == (other.bus, other.id, &other.unit)
            && self.place_in(&other.layout) == Some(other.field)
    }
}

impl SignalKey {
    /// A field of a layout; None if the index is too large.
    pub fn new(bus: BusIndex, id: CanId, layout: &Arc<PayloadLayout>, field: usize) -> Option<Self> {
        let known = layout.fields.get(field)?;
        let name = match (known.name(), known.id) {
            (Some(name), _) => escape(name).into_owned(),
            (None, SignalId::Name) => format!("bit {}", known.bit),
            (None, id) => id.to_string(),
        };
        let unit = escape(signal_unit(known)).into_owned();
        Some(Self { bus, id, field, name, unit, layout: Arc::clone(layout) })
    }

    /// All fields of a layout.
    pub fn signals_of(bus: BusIndex, id: CanId, layout: &Arc<PayloadLayout>) -> impl Iterator<Item = Self> {
        (0..layout.fields.len()).filter_map(move |field| Self::new(bus, id, layout, field))
    }

    /// Index of the same signal in another layout.
    pub fn place_in(&self, layout: &Arc<PayloadLayout>) -> Option<usize> {
        if Arc::ptr_eq(&self.layout, layout) {
            return Some(self.field);
        }
        let wanted = self.layout.fields.get(self.field)?;
        let is_it = |field: &&SignalField| is_same(field, wanted);
        // A mapping may contain an object more than once.
        let before = self.layout.fields.iter().take(self.field).filter(is_it).count();
        let mut places = layout.fields.iter().enumerate().filter(|(_, field)| is_it(field));
        places.nth(before).map(|(place, _)| place)
    }

    /// The field in another layout, if it has the same unit there.
    pub fn field_in<'a>(&self, layout: &'a Arc<PayloadLayout>) -> Option<(usize, &'a SignalField)> {
        let place = self.place_in(layout)?;
        let field = layout.fields.get(place)?;
        (escape(signal_unit(field)) == self.unit).then_some((place, field))
    }
}

fn signal_unit(field: &SignalField) -> &str {
    field.meaning.as_deref().map_or("", |meaning| meaning.unit.as_str())
}

fn is_same(field: &SignalField, other: &SignalField) -> bool {
    field.id == other.id && (field.id != SignalId::Name || field.name() == other.name())
}

/// Whether a value is presumed.
pub fn is_assumed(layout: &PayloadLayout, field: &SignalField) -> bool {
    layout.assumed || field.meaning.as_deref().is_some_and(|meaning| meaning.assumed)
}

/// A value with its unit, and `?` if it is presumed.
pub fn value_text(layout: &PayloadLayout, field: &SignalField, value: &DecodedValue) -> String {
    let mut text = match field.meaning.as_deref() {
        Some(meaning) => escape(&meaning.format_value(value)).into_owned(),
        None => value.to_string(),
    };
    if is_assumed(layout, field) {
        text.push('?');
    }
    text
}

/// Identifier, layout and payload of an event that has a layout.
#[inline]
pub fn carried_layout(event: &Event) -> Option<(CanId, &Arc<PayloadLayout>, &[u8])> {
    match &event.kind {
        EventKind::Pdo(pdo) if !pdo.is_request => Some((pdo.cob_id, pdo.layout.as_ref()?, pdo.payload())),
        EventKind::J1939Message(message) => {
            Some((message.can_id, message.layout.as_ref()?, message.payload()))
        }
        EventKind::Frame(undecoded) if !undecoded.frame.flags.contains(FrameFlags::REMOTE) => {
            Some((undecoded.frame.id, &undecoded.message.as_ref()?.layout, undecoded.frame.data()))
        }
        _ => None,
    }
}
