//! Signals by name: where in a layout they stand is found out once a layout, not once a message.

use std::collections::HashMap;
use std::fmt;
use std::sync::Arc;

use foldhash::fast::FixedState;

use super::nearest::Nearest;
use crate::event::{Event, EventKind, Outcome};
use crate::finding::About;
use crate::frame::CanId;
use crate::profile::{Field, Layout, Meaning, SignalId, Value};
use crate::rules::Context;
use crate::wire::canopen::ObjectAddress;

/// Kinds of events that carry values.
pub(super) const KINDS: [&str; 5] = ["pdo", "sdo-transfer", "j1939-message", "j1939-transfer", "frame"];

/// Messages beside PDOs whose layouts are kept; the signals of further ones are not judged.
const MESSAGE_LIMIT: usize = 4096;

/// A signal as the user names it.
#[derive(Debug, Clone, PartialEq, Eq)]
pub(super) enum SignalName {
    Object(ObjectAddress),
    Spn(u32),
    Name(Arc<str>),
}

impl SignalName {
    /// `6041:00`, `spn:190`; anything else is a name.
    pub(super) fn read(text: &str) -> Self {
        if let Some(number) = text.strip_prefix("spn:").and_then(|number| number.trim().parse().ok()) {
            return Self::Spn(number);
        }
        let is_object = text.starts_with(|first: char| first.is_ascii_digit()) || text.contains(':');
        match text.parse() {
            Ok(object) if is_object => Self::Object(object),
            _ => Self::Name(text.into()),
        }
    }

    /// Whether a field is it.
    pub(super) fn is(&self, field: &Field) -> bool {
        match (self, field.id) {
            (Self::Object(wanted), SignalId::Object(object)) => *wanted == object,
            (Self::Spn(wanted), SignalId::Spn(spn)) => *wanted == spn,
            (Self::Name(wanted), _) => field.name() == Some(wanted),
            (Self::Object(_) | Self::Spn(_), _) => false,
        }
    }

    /// Whether an object is it.
    fn is_object(&self, object: ObjectAddress, meaning: &Meaning) -> bool {
        match self {
            Self::Object(wanted) => *wanted == object,
            Self::Name(wanted) => *meaning.name == **wanted,
            Self::Spn(_) => false,
        }
    }

    /// What a finding is about.
    pub(super) fn about(&self) -> About {
        match self {
            Self::Object(object) => About::Object(*object),
            Self::Spn(_) => About::Name(self.to_string().into()),
            Self::Name(name) => About::Name(Arc::clone(name)),
        }
    }
}

impl fmt::Display for SignalName {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::Object(object) => write!(f, "{object}"),
            Self::Spn(spn) => write!(f, "spn:{spn}"),
            Self::Name(name) => f.write_str(name),
        }
    }
}

/// What brings values again and again.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash)]
enum Carrier {
    /// The PDO that is being judged.
    Pdo,
    Message(CanId),
    /// Source and group.
    Transfer(u8, u32),
}

/// The layout of a message, and its bytes.
fn laid_out(event: &Event) -> Option<(Carrier, &Arc<Layout>, &[u8])> {
    match &event.kind {
        EventKind::Pdo(pdo) if !pdo.is_request => Some((Carrier::Pdo, pdo.layout.as_ref()?, pdo.payload())),
        EventKind::J1939Message(message) => {
            Some((Carrier::Message(message.can_id), message.layout.as_ref()?, message.payload()))
        }
        EventKind::J1939Transfer(transfer) => {
            let carrier = Carrier::Transfer(transfer.source, transfer.pgn?.number());
            Some((carrier, transfer.layout.as_ref()?, &transfer.data))
        }
        EventKind::Frame(undecoded) => {
            let message = undecoded.message.as_ref()?;
            Some((Carrier::Message(undecoded.frame.id), &message.layout, undecoded.frame.data()))
        }
        _ => None,
    }
}

/// Something of each message with a layout.
#[derive(Debug, Default)]
pub(super) struct Messages<T> {
    pdos: Vec<Slot<T>>,
    others: HashMap<Carrier, Slot<T>, FixedState>,
}

/// A message, the layout it had last, and what is remembered of it.
#[derive(Debug, Default)]
struct Slot<T> {
    layout: Option<Arc<Layout>>,
    known: T,
}

impl<T: Default> Messages<T> {
    /// What is remembered of the event's message, and its bytes; `learn` sees each layout that is new to it.
    #[inline]
    pub(super) fn of<'a, 'e>(
        &'a mut self,
        event: &'e Event,
        context: &Context<'_>,
        learn: impl FnOnce(&Layout, &mut T),
    ) -> Option<(&'a mut T, &'e Layout, &'e [u8])> {
        let (carrier, layout, payload) = laid_out(event)?;
        let slot = match carrier {
            Carrier::Pdo => {
                let place = context.traffic.current()?.place;
                if place >= self.pdos.len() {
                    self.pdos.resize_with(place + 1, Slot::default);
                }
                self.pdos.get_mut(place)?
            }
            other => {
                let has_room = self.others.len() < MESSAGE_LIMIT;
                if !has_room && !self.others.contains_key(&other) {
                    return None;
                }
                self.others.entry(other).or_default()
            }
        };
        if slot.layout.as_ref().is_none_or(|known| !Arc::ptr_eq(known, layout)) {
            slot.layout = Some(Arc::clone(layout));
            learn(layout, &mut slot.known);
        }
        Some((&mut slot.known, layout, payload))
    }
}

/// Where a signal is in one layout, and what is remembered of it there.
#[derive(Debug, Default)]
struct Found<T> {
    /// Fields that are it: several where it is multiplexed.
    fields: Vec<usize>,
    known: T,
}

/// Values of one signal, wherever they come from.
#[derive(Debug)]
pub(super) struct Values<T> {
    name: SignalName,
    messages: Messages<Found<T>>,
    was_seen: bool,
    nearest: Nearest,
}

/// A value that came.
pub(super) struct Reading<'a, T> {
    /// In engineering units.
    pub(super) number: f64,
    value: Value,
    meaning: Option<&'a Meaning>,
    is_assumed: bool,
    /// Of the message that brought it; nothing for what an SDO transfer did.
    pub(super) known: Option<&'a mut T>,
}

impl<T: Default> Values<T> {
    pub(super) fn new(name: SignalName) -> Self {
        Self { name, messages: Messages::default(), was_seen: false, nearest: Nearest::default() }
    }

    /// Why nothing could be judged.
    pub(super) fn idle(&self) -> String {
        if self.was_seen {
            return format!("the signal '{}' had no value to be judged", self.name);
        }
        format!("the signal '{}' was never seen{}", self.name, self.nearest.hint())
    }

    /// The signal's value in an event, where it is a number.
    #[inline]
    pub(super) fn read<'a>(&'a mut self, event: &'a Event, context: &Context<'_>) -> Option<Reading<'a, T>> {
        if let EventKind::SdoTransfer(transfer) = &event.kind {
            let (object, meaning) = (transfer.object?, transfer.meaning.as_deref()?);
            let is_whole = transfer.outcome == Outcome::Complete && !transfer.truncated;
            if !is_whole || transfer.data.is_empty() || !self.name.is_object(object, meaning) {
                return None;
            }
            self.was_seen = true;
            let value = meaning.decode(&transfer.data);
            let number = number(Some(meaning), &value)?;
            let is_assumed = meaning.assumed;
            return Some(Reading { number, value, meaning: Some(meaning), is_assumed, known: None });
        }
        let (name, nearest) = (&self.name, &self.nearest);
        let learn = |layout: &Layout, found: &mut Found<T>| {
            let all = layout.fields.iter().enumerate().filter(|(_, field)| name.is(field));
            if let SignalName::Name(wanted) = name {
                nearest.see_all(wanted, layout);
            }
            *found = Found { fields: all.map(|(place, _)| place).collect(), known: T::default() };
        };
        let (found, layout, payload) = self.messages.of(event, context, learn)?;
        let signal = found.fields.iter().find_map(|field| layout.signal(*field, payload))?;
        self.was_seen = true;
        let meaning = signal.field.meaning.as_deref();
        let number = number(meaning, &signal.value)?;
        let is_assumed = layout.assumed || meaning.is_some_and(|meaning| meaning.assumed);
        Some(Reading { number, value: signal.value, meaning, is_assumed, known: Some(&mut found.known) })
    }
}

impl<T> Reading<'_, T> {
    /// The value as lines have it: `251.3 bar`, with `?` where its scale or mapping is assumed.
    pub(super) fn show(&self) -> String {
        let shown = self.meaning.map_or_else(|| self.value.to_string(), |meaning| meaning.show(&self.value));
        if self.is_assumed { format!("{shown}?") } else { shown }
    }

    /// Unit behind a number: ` bar`.
    pub(super) fn unit(&self) -> String {
        match self.meaning.map(|meaning| meaning.unit.as_str()) {
            None | Some("") => String::new(),
            Some(unit) => format!(" {unit}"),
        }
    }
}

/// A value as a number in its unit; nothing for a special one, which is no quantity.
fn number(meaning: Option<&Meaning>, value: &Value) -> Option<f64> {
    let scaled = meaning.and_then(|meaning| meaning.scaled(value));
    let is_special =
        meaning.is_some_and(|meaning| meaning.values.is_none() && meaning.label(value).is_some());
    if scaled.is_none() && is_special {
        return None;
    }
    let number = scaled.or(match value {
        #[expect(clippy::cast_precision_loss, reason = "compared with limits of few digits")]
        Value::Unsigned(number) => Some(*number as f64),
        #[expect(clippy::cast_precision_loss, reason = "compared with limits of few digits")]
        Value::Integer(number) => Some(*number as f64),
        Value::Real(number) => Some(*number),
        Value::Text(_) | Value::Bytes(_) => None,
    });
    number.filter(|number| number.is_finite())
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn names_of_signals() {
        let object = |index, sub| SignalName::Object(ObjectAddress::new(index, sub));
        assert_eq!(SignalName::read("6041:00"), object(0x6041, 0));
        assert_eq!(SignalName::read("0x6041:00"), object(0x6041, 0));
        assert_eq!(SignalName::read("2001sub3"), object(0x2001, 3));
        assert_eq!(SignalName::read("a000:01"), object(0xA000, 1));
        assert_eq!(SignalName::read("spn:190"), SignalName::Spn(190));
        for name in ["face", "pump.pressure", "spn:x", "Actual pressure", "5 bar"] {
            assert_eq!(SignalName::read(name), SignalName::Name(name.into()), "{name}");
            assert_eq!(SignalName::read(name).to_string(), name);
        }
    }
}
