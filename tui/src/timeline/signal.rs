//! A signal: one field of what an identifier carries, and where it is in whatever layout is in force.
//!
//! ```text
//! 182#08A01FF91F   ▸ TPDO1 of 2/02 ▸ field 2 of its layout ▸ 5002:00 actual pressure, bar
//! ```

use std::sync::Arc;

use cobscope_decoder::event::{Event, EventKind};
use cobscope_decoder::frame::{BusIndex, CanId, FrameFlags};
use cobscope_decoder::profile::{Field, Layout, SignalId, Value, integer, word};
use cobscope_decoder::sink::escape;

/// A signal: a field of what an identifier carries.
#[derive(Debug, Clone)]
pub struct SignalKey {
    /// Bus.
    pub bus: BusIndex,
    /// Identifier.
    pub id: CanId,
    /// Field of its layout.
    pub field: usize,
    /// Its name, as shown.
    pub name: String,
    /// Its unit, as shown.
    pub unit: String,
    /// The layout it was chosen from.
    pub layout: Arc<Layout>,
}

/// Two are the same although a scale changed between them; another unit makes another quantity.
impl PartialEq for SignalKey {
    fn eq(&self, other: &Self) -> bool {
        (self.bus, self.id, &self.unit) == (other.bus, other.id, &other.unit)
            && self.place_in(&other.layout) == Some(other.field)
    }
}

impl SignalKey {
    /// A field of a layout; nothing if it has no such field.
    pub fn new(bus: BusIndex, id: CanId, layout: &Arc<Layout>, field: usize) -> Option<Self> {
        let known = layout.fields.get(field)?;
        let name = match (known.name(), known.id) {
            (Some(name), _) => escape(name).into_owned(),
            (None, SignalId::Name) => format!("bit {}", known.bit),
            (None, id) => id.to_string(),
        };
        let unit = escape(unit(known)).into_owned();
        Some(Self { bus, id, field, name, unit, layout: Arc::clone(layout) })
    }

    /// All fields of a layout.
    pub fn all(bus: BusIndex, id: CanId, layout: &Arc<Layout>) -> impl Iterator<Item = Self> {
        (0..layout.fields.len()).filter_map(move |field| Self::new(bus, id, layout, field))
    }

    /// Where the same signal is in another layout.
    pub fn place_in(&self, layout: &Arc<Layout>) -> Option<usize> {
        if Arc::ptr_eq(&self.layout, layout) {
            return Some(self.field);
        }
        let wanted = self.layout.fields.get(self.field)?;
        let is_it = |field: &&Field| is_same(field, wanted);
        // A mapping may hold an object more than once.
        let before = self.layout.fields.iter().take(self.field).filter(is_it).count();
        let mut places = layout.fields.iter().enumerate().filter(|(_, field)| is_it(field));
        places.nth(before).map(|(place, _)| place)
    }

    /// The field in another layout, if it is of the same quantity there.
    pub fn field_in<'a>(&self, layout: &'a Arc<Layout>) -> Option<(usize, &'a Field)> {
        let place = self.place_in(layout)?;
        let field = layout.fields.get(place)?;
        (escape(unit(field)) == self.unit).then_some((place, field))
    }
}

fn unit(field: &Field) -> &str {
    field.meaning.as_deref().map_or("", |meaning| meaning.unit.as_str())
}

fn is_same(field: &Field, other: &Field) -> bool {
    field.id == other.id && (field.id != SignalId::Name || field.name() == other.name())
}

/// A value as a number to be drawn: the scaled quantity, or the number of a state. Nothing where it says that there
/// is no value.
pub fn number(field: &Field, value: &Value) -> Option<f64> {
    let plain = match value {
        #[expect(clippy::cast_precision_loss, reason = "drawn with a few digits")]
        Value::Unsigned(number) => *number as f64,
        #[expect(clippy::cast_precision_loss, reason = "drawn with a few digits")]
        Value::Integer(number) => *number as f64,
        Value::Real(number) => *number,
        Value::Text(_) | Value::Bytes(_) => return None,
    };
    let Some(meaning) = field.meaning.as_deref() else { return Some(plain) };
    if meaning.scale.is_some() {
        return meaning.scaled(value);
    }
    // A name from the values is a state; any other one says why there is no number.
    let special = meaning.special.as_deref().zip(integer(value)).and_then(|(names, raw)| names.get(raw));
    let indicated = meaning.indicators.zip(word(value)).and_then(|(indicators, raw)| indicators.label(raw));
    special.or(indicated).is_none().then_some(plain)
}

/// Whether a value rests on an assumption.
pub fn is_assumed(layout: &Layout, field: &Field) -> bool {
    layout.assumed || field.meaning.as_deref().is_some_and(|meaning| meaning.assumed)
}

/// A value as people write it, with `?` where it rests on an assumption.
pub fn text(layout: &Layout, field: &Field, value: &Value) -> String {
    let mut text = match field.meaning.as_deref() {
        Some(meaning) => escape(&meaning.show(value)).into_owned(),
        None => value.to_string(),
    };
    if is_assumed(layout, field) {
        text.push('?');
    }
    text
}

/// What an event carries that has a layout: identifier, layout and payload.
#[inline]
pub fn carried(event: &Event) -> Option<(CanId, &Arc<Layout>, &[u8])> {
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
