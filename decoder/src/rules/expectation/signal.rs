//! Look-up of signals by name, cached per layout.

use std::collections::HashMap;
use std::fmt;
use std::sync::Arc;

use foldhash::fast::FixedState;

use super::nearest::NearestName;
use crate::event::{Event, EventKind, Kind, SdoOutcome};
use crate::finding::FindingSubject;
use crate::frame::CanId;
use crate::profile::{DecodedValue, ObjectMeaning, PayloadLayout, SignalField, SignalId};
use crate::rules::RuleContext;
use crate::wire::canopen::ObjectAddress;

/// Event kinds that contain values.
pub(super) const KINDS: [Kind; 5] =
    [Kind::Pdo, Kind::SdoTransfer, Kind::J1939Message, Kind::J1939Transfer, Kind::Frame];

/// Maximum number of messages other than PDOs with a cached layout; signals of further messages are ignored.
const MESSAGE_LIMIT: usize = 4096;

/// Signal reference in the notation of the user.
#[derive(Debug, Clone, PartialEq, Eq)]
pub(super) enum SignalReference {
    Object(ObjectAddress),
    Spn(u32),
    Name(Arc<str>),
}

impl SignalReference {
    /// Parses `6041:00` and `spn:190`; any other text is a name.
    pub(super) fn parse_reference(text: &str) -> Self {
        if let Some(number) = text.strip_prefix("spn:").and_then(|number| number.trim().parse().ok()) {
            return Self::Spn(number);
        }
        let is_object = text.starts_with(|first: char| first.is_ascii_digit()) || text.contains(':');
        match text.parse() {
            Ok(object) if is_object => Self::Object(object),
            _ => Self::Name(text.into()),
        }
    }

    /// Whether a field is this signal.
    pub(super) fn is_field(&self, field: &SignalField) -> bool {
        match (self, field.id) {
            (Self::Object(wanted), SignalId::Object(object)) => *wanted == object,
            (Self::Spn(wanted), SignalId::Spn(spn)) => *wanted == spn,
            (Self::Name(wanted), _) => field.name() == Some(wanted),
            (Self::Object(_) | Self::Spn(_), _) => false,
        }
    }

    /// Whether an object is this signal.
    fn is_object(&self, object: ObjectAddress, meaning: &ObjectMeaning) -> bool {
        match self {
            Self::Object(wanted) => *wanted == object,
            Self::Name(wanted) => *meaning.name == **wanted,
            Self::Spn(_) => false,
        }
    }

    /// Subject of a finding about the signal.
    pub(super) fn finding_subject(&self) -> FindingSubject {
        match self {
            Self::Object(object) => FindingSubject::Object(*object),
            Self::Spn(_) => FindingSubject::Name(self.to_string().into()),
            Self::Name(name) => FindingSubject::Name(Arc::clone(name)),
        }
    }
}

impl fmt::Display for SignalReference {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::Object(object) => write!(f, "{object}"),
            Self::Spn(spn) => write!(f, "spn:{spn}"),
            Self::Name(name) => f.write_str(name),
        }
    }
}

/// Source of repeated values.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash)]
enum RepeatedSource {
    /// The current PDO of the traffic statistics.
    Pdo,
    Message(CanId),
    /// Source address and PGN.
    Transfer(u8, u32),
}

/// Source, layout and payload of an event with a layout.
fn laid_out(event: &Event) -> Option<(RepeatedSource, &Arc<PayloadLayout>, &[u8])> {
    match &event.kind {
        EventKind::Pdo(pdo) if !pdo.is_request => {
            Some((RepeatedSource::Pdo, pdo.layout.as_ref()?, pdo.payload()))
        }
        EventKind::J1939Message(message) => {
            Some((RepeatedSource::Message(message.can_id), message.layout.as_ref()?, message.payload()))
        }
        EventKind::J1939Transfer(transfer) => {
            let carrier = RepeatedSource::Transfer(transfer.source, transfer.pgn?.number());
            Some((carrier, transfer.layout.as_ref()?, &transfer.data))
        }
        EventKind::Frame(undecoded) => {
            let message = undecoded.message.as_ref()?;
            Some((RepeatedSource::Message(undecoded.frame.id), &message.layout, undecoded.frame.data()))
        }
        _ => None,
    }
}

/// Table by message with a layout.
#[derive(Debug, Default)]
pub(super) struct LayoutTable<T> {
    pdos: Vec<LayoutSlot<T>>,
    others: HashMap<RepeatedSource, LayoutSlot<T>, FixedState>,
}

/// Entry of a message with its last layout.
#[derive(Debug, Default)]
struct LayoutSlot<T> {
    layout: Option<Arc<PayloadLayout>>,
    known: T,
}

impl<T: Default> LayoutTable<T> {
    /// Entry, layout and payload for an event; `learn` is called for each new layout of the message.
    #[inline]
    pub(super) fn layout_for<'a, 'e>(
        &'a mut self,
        event: &'e Event,
        context: &RuleContext<'_>,
        learn: impl FnOnce(&PayloadLayout, &mut T),
    ) -> Option<(&'a mut T, &'e PayloadLayout, &'e [u8])> {
        let (carrier, layout, payload) = laid_out(event)?;
        let slot = match carrier {
            RepeatedSource::Pdo => {
                let place = context.traffic.current_slot()?.place;
                if place >= self.pdos.len() {
                    self.pdos.resize_with(place + 1, LayoutSlot::default);
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

/// Position of a signal in one layout, and the state of the task for this message.
#[derive(Debug, Default)]
struct LocatedSignal<T> {
    /// Indices of matching fields; several if the signal is multiplexed.
    fields: Vec<usize>,
    known: T,
}

/// Values of one signal from all sources.
#[derive(Debug)]
pub(super) struct SignalSources<T> {
    name: SignalReference,
    messages: LayoutTable<LocatedSignal<T>>,
    was_seen: bool,
    nearest: NearestName,
}

/// One value of the signal.
pub(super) struct ExpectedReading<'a, T> {
    /// Value in engineering units.
    pub(super) number: f64,
    value: DecodedValue,
    meaning: Option<&'a ObjectMeaning>,
    is_assumed: bool,
    /// State of the task for the message; None for an SDO transfer.
    pub(super) known: Option<&'a mut T>,
}

impl<T: Default> SignalSources<T> {
    pub(super) fn new(name: SignalReference) -> Self {
        Self { name, messages: LayoutTable::default(), was_seen: false, nearest: NearestName::default() }
    }

    /// Reason text if no value was checked.
    pub(super) fn idle_reason(&self) -> String {
        if self.was_seen {
            return format!("signal '{}' had no value to check", self.name);
        }
        format!("signal '{}' did not occur{}", self.name, self.nearest.hint_text())
    }

    /// Numeric value of the signal in an event.
    #[inline]
    pub(super) fn read_value<'a>(
        &'a mut self,
        event: &'a Event,
        context: &RuleContext<'_>,
    ) -> Option<ExpectedReading<'a, T>> {
        if let EventKind::SdoTransfer(transfer) = &event.kind {
            let (object, meaning) = (transfer.object?, transfer.meaning.as_deref()?);
            let is_whole = transfer.outcome == SdoOutcome::Complete && !transfer.truncated;
            if !is_whole || transfer.data.is_empty() || !self.name.is_object(object, meaning) {
                return None;
            }
            self.was_seen = true;
            let value = meaning.decode(&transfer.data);
            let number = value_as_number(Some(meaning), &value)?;
            let is_assumed = meaning.assumed;
            return Some(ExpectedReading { number, value, meaning: Some(meaning), is_assumed, known: None });
        }
        let (name, nearest) = (&self.name, &self.nearest);
        let learn = |layout: &PayloadLayout, found: &mut LocatedSignal<T>| {
            let all = layout.fields.iter().enumerate().filter(|(_, field)| name.is_field(field));
            if let SignalReference::Name(wanted) = name {
                nearest.see_all(wanted, layout);
            }
            *found = LocatedSignal { fields: all.map(|(place, _)| place).collect(), known: T::default() };
        };
        let (found, layout, payload) = self.messages.layout_for(event, context, learn)?;
        let signal = found.fields.iter().find_map(|field| layout.decode_signal(*field, payload))?;
        self.was_seen = true;
        let meaning = signal.field.meaning.as_deref();
        let number = value_as_number(meaning, &signal.value)?;
        let is_assumed = layout.assumed || meaning.is_some_and(|meaning| meaning.assumed);
        Some(ExpectedReading {
            number,
            value: signal.value,
            meaning,
            is_assumed,
            known: Some(&mut found.known),
        })
    }
}

impl<T> ExpectedReading<'_, T> {
    /// Value as text: `251.3 bar`, with `?` if the scale or mapping is assumed.
    pub(super) fn show_value(&self) -> String {
        let shown =
            self.meaning.map_or_else(|| self.value.to_string(), |meaning| meaning.format_value(&self.value));
        if self.is_assumed { format!("{shown}?") } else { shown }
    }

    /// Unit with a leading blank: ` bar`.
    pub(super) fn unit_suffix(&self) -> String {
        match self.meaning.map(|meaning| meaning.unit.as_str()) {
            None | Some("") => String::new(),
            Some(unit) => format!(" {unit}"),
        }
    }
}

/// Value as a number in its unit; None for a special value, which is not a quantity.
fn value_as_number(meaning: Option<&ObjectMeaning>, value: &DecodedValue) -> Option<f64> {
    let scaled = meaning.and_then(|meaning| meaning.scaled_value(value));
    let is_special =
        meaning.is_some_and(|meaning| meaning.values.is_none() && meaning.value_label(value).is_some());
    if scaled.is_none() && is_special {
        return None;
    }
    let number = scaled.or(match value {
        #[expect(clippy::cast_precision_loss, reason = "compared with limits of few digits")]
        DecodedValue::Unsigned(number) => Some(*number as f64),
        #[expect(clippy::cast_precision_loss, reason = "compared with limits of few digits")]
        DecodedValue::Integer(number) => Some(*number as f64),
        DecodedValue::Real(number) => Some(*number),
        DecodedValue::Text(_) | DecodedValue::Bytes(_) => None,
    });
    number.filter(|number| number.is_finite())
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn names_of_signals() {
        let object = |index, sub| SignalReference::Object(ObjectAddress::new(index, sub));
        assert_eq!(SignalReference::parse_reference("6041:00"), object(0x6041, 0));
        assert_eq!(SignalReference::parse_reference("0x6041:00"), object(0x6041, 0));
        assert_eq!(SignalReference::parse_reference("2001sub3"), object(0x2001, 3));
        assert_eq!(SignalReference::parse_reference("a000:01"), object(0xA000, 1));
        assert_eq!(SignalReference::parse_reference("spn:190"), SignalReference::Spn(190));
        for name in ["face", "pump.pressure", "spn:x", "Actual pressure", "5 bar"] {
            assert_eq!(SignalReference::parse_reference(name), SignalReference::Name(name.into()), "{name}");
            assert_eq!(SignalReference::parse_reference(name).to_string(), name);
        }
    }
}
