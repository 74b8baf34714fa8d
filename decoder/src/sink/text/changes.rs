//! Text of a message with its changed signals first.
//!
//! ```text
//! TPDO1  spool 12.5 → 29.7 %?, word DHAR → DHar?   unchanged: pressure 157.5 bar
//! ```

use super::parts::format_bytes;
use super::pdo;
use crate::event::{Event, EventKind};
use crate::profile::{DecodedSignal, ObjectMeaning, PayloadLayout, SignalField, word_letters};
use crate::query::record::event_device as device_of;
use crate::session::Bus;

/// Number of payload bytes without a layout that are shown as a whole.
const SHOWN_BYTES: usize = 8;

/// A PDO, J1939 message or frame of a database, compared with an earlier one of its identifier.
#[derive(Debug, Clone, Default, PartialEq, Eq)]
pub struct MessageChanges {
    /// PDO, PGN or message.
    pub name: String,
    /// Changed signals with their old values; all signals of a first message.
    pub changed: String,
    /// Unchanged signals.
    pub unchanged: String,
    /// Name of the group, users of the identifier, missing signals.
    pub note: String,
}

impl MessageChanges {
    /// Whether an event is a message with signals or bytes.
    pub fn is_of(event: &Event) -> bool {
        match &event.kind {
            EventKind::Pdo(message) => !message.is_request,
            EventKind::Frame(undecoded) => undecoded.message.is_some(),
            kind => matches!(kind, EventKind::J1939Message(_)),
        }
    }

    /// The signals of a message; None for other events. `earlier` is the payload to compare with.
    pub fn changes_in(event: &Event, bus: &Bus, earlier: Option<&[u8]>) -> Option<Self> {
        let (name, layout, payload, note) = match &event.kind {
            EventKind::Pdo(message) if !message.is_request => {
                let mut note = Vec::new();
                if let Some(users) = bus.node_table().other_users(message.cob_id) {
                    pdo::push_users(message, event, users, bus, &mut note);
                }
                if message.layout.is_none() {
                    pdo::push_missing(message, event, device_of(event, bus), &mut note);
                }
                (message.name.to_string(), message.layout.as_deref(), message.payload(), note)
            }
            EventKind::J1939Message(message) => {
                let (acronym, rest) = group_name(message.name.as_deref().unwrap_or_default());
                let name = format!("{}{acronym}", message.id.pgn);
                let note = if rest.is_empty() { String::new() } else { format!(" | {rest}") };
                (name, message.layout.as_deref(), message.payload(), note.into_bytes())
            }
            EventKind::Frame(undecoded) => {
                let message = undecoded.message.as_deref()?;
                (message.name.clone(), Some(&*message.layout), undecoded.frame.data(), Vec::new())
            }
            _ => return None,
        };
        let note = String::from_utf8_lossy(&note).into_owned();
        let Some(layout) = layout else {
            let changed = changed_bytes(payload, earlier);
            return Some(Self { name, changed, unchanged: String::new(), note });
        };
        let (changed, unchanged) = split_signals(layout, payload, earlier);
        let mut absent = Vec::new();
        pdo::push_absent_signals(layout, payload, &mut absent);
        let note = format!("{}{note}", String::from_utf8_lossy(&absent));
        Some(Self { name, changed, unchanged, note })
    }
}

/// Acronym with a blank before it, and the rest of the name of a parameter group: ` EEC1` and `electronic
/// engine controller 1`.
pub(super) fn group_name(name: &str) -> (String, &str) {
    let (first, rest) = name.split_once(' ').unwrap_or((name, ""));
    let is_acronym = !first.is_empty()
        && first.chars().all(|letter| letter.is_ascii_uppercase() || letter.is_ascii_digit());
    if is_acronym { (format!(" {first}"), rest) } else { (String::new(), name) }
}

/// Changed and unchanged signals, device words after the others: their changes are also events.
fn split_signals(layout: &PayloadLayout, payload: &[u8], earlier: Option<&[u8]>) -> (String, String) {
    let (mut changed, mut unchanged) = ([Vec::new(), Vec::new()], [Vec::new(), Vec::new()]);
    for (number, field) in layout.fields.iter().enumerate() {
        let Some(now) = layout.decode_signal(number, payload) else { continue };
        let before = earlier.and_then(|payload| layout.decode_signal(number, payload));
        let value = SignalValue::value_of(&now);
        let is_assumed = layout.assumed || field.meaning.as_deref().is_some_and(|meaning| meaning.assumed);
        let mark = if is_assumed { "?" } else { "" };
        let name = short_name(layout, field);
        let old = before.as_ref().map(SignalValue::value_of);
        let is_new = earlier.is_none() || old.as_ref() != Some(&value);
        let text = match old.filter(|_| is_new) {
            Some(old) => format!("{name} {} → {}{mark}", old.without_unit_of(&value), value.text),
            None => format!("{name} {}{mark}", value.text),
        };
        let list = if is_new { &mut changed } else { &mut unchanged };
        if let Some(list) = list.get_mut(usize::from(is_word(field))) {
            list.push(text);
        }
    }
    (changed.concat().join(", "), unchanged.concat().join(", "))
}

/// Value of a signal as text.
#[derive(Debug, PartialEq, Eq)]
struct SignalValue {
    text: String,
    /// Unit at the end of the text, with its blank; empty for other values.
    unit: String,
}

impl SignalValue {
    fn value_of(signal: &DecodedSignal<'_>) -> Self {
        let Some(meaning) = signal.field.meaning.as_deref() else {
            return Self { text: signal.value.to_string(), unit: String::new() };
        };
        if let Some(text) = meaning.bits.as_deref().and_then(|bits| word_letters(bits, signal.raw)) {
            return Self { text, unit: String::new() };
        }
        let mut text = meaning.format_value(&signal.value);
        let unit = if meaning.unit.is_empty() { String::new() } else { format!(" {}", meaning.unit) };
        let unit = if text.ends_with(&unit) { unit } else { String::new() };
        text.push_str(&limit_text(meaning, signal));
        Self { text, unit }
    }

    /// The text without a unit that the new value repeats.
    fn without_unit_of(&self, new: &Self) -> &str {
        let is_same = self.unit == new.unit && !self.unit.is_empty();
        is_same.then(|| self.text.split_once(&self.unit)).flatten().map_or(&self.text, |(number, _)| number)
    }
}

/// ` of 315`, ` (outside)`.
fn limit_text(meaning: &ObjectMeaning, signal: &DecodedSignal<'_>) -> String {
    let full = meaning.scale.and_then(|scale| scale.full_scale);
    let full = full.map_or(String::new(), |(_, full)| format!(" of {full}"));
    let outside = if meaning.is_outside(&signal.value) { " (outside)" } else { "" };
    full + outside
}

fn is_word(field: &SignalField) -> bool {
    field.meaning.as_deref().is_some_and(|meaning| meaning.bits.is_some())
}

/// Short name with the channel; of a device word the last words of its name that no other signal has.
fn short_name(layout: &PayloadLayout, field: &SignalField) -> String {
    let Some(meaning) = field.meaning.as_deref() else { return field.id.to_string() };
    let channel = meaning.channel.filter(|_| pdo::has_several_channels(layout));
    let channel = channel.map_or(String::new(), |channel| format!("c{channel} "));
    let name = match &meaning.short {
        Some(short) => short,
        None if is_word(field) => last_words(layout, field, &meaning.name),
        None => &meaning.name,
    };
    format!("{channel}{name}")
}

fn last_words<'a>(layout: &PayloadLayout, field: &SignalField, name: &'a str) -> &'a str {
    let others = || layout.fields.iter().filter(|other| *other != field).filter_map(SignalField::name);
    let ends = name.rmatch_indices(' ').filter_map(|(at, _)| name.get(at.saturating_add(1)..));
    let is_own = |end: &&str| !others().any(|other| other.ends_with(end));
    ends.into_iter().find(is_own).unwrap_or(name)
}

/// Bytes without a layout; of a long payload those that changed: `byte 12: 05 → 06`.
fn changed_bytes(payload: &[u8], earlier: Option<&[u8]>) -> String {
    let same_length = earlier.filter(|earlier| earlier.len() == payload.len());
    let Some(earlier) = same_length.filter(|_| payload.len() > SHOWN_BYTES) else {
        return format_bytes(payload);
    };
    let pairs = earlier.iter().zip(payload).enumerate().filter(|(_, (old, new))| old != new);
    let changed: Vec<_> = pairs.map(|(at, (old, new))| format!("byte {at}: {old:02X} → {new:02X}")).collect();
    if changed.is_empty() { format_bytes(payload) } else { changed.join(", ") }
}

#[cfg(test)]
mod tests {
    use std::sync::Arc;

    use super::*;
    use crate::profile::{BitName, BitNames, DataType, RawConversion};
    use crate::wire::canopen::ObjectAddress;

    /// A status word and a position in tenths of a percent.
    fn layout() -> PayloadLayout {
        let bit = |(bit, name): (u8, &str)| BitName {
            bit,
            width: 1,
            name: name.to_owned(),
            text: None,
            off: None,
            values: None,
            reserved: false,
        };
        let names = BitNames { list: vec![bit((0, "disabled")), bit((1, "hold"))] };
        let word = ObjectMeaning {
            name: "Device status word".into(),
            bits: Some(Arc::new(names)),
            assumed: true,
            ..ObjectMeaning::default()
        };
        let scale = RawConversion { factor: 0.1, offset: 0.0, full_scale: None, is_reciprocal: false };
        let position = ObjectMeaning {
            name: "Spool position".into(),
            short: Some("spool".into()),
            unit: "%".into(),
            decimals: 1,
            scale: Some(scale),
            ..ObjectMeaning::default()
        };
        let field = |index, bit, meaning| SignalField {
            meaning: Some(Arc::new(meaning)),
            ..SignalField::of_object(ObjectAddress::new(index, 0), bit, 8, DataType::Unsigned8)
        };
        let fields = vec![field(0x6041, 0, word), field(0x6301, 8, position)];
        PayloadLayout { fields, bits: 16, ..PayloadLayout::default() }
    }

    #[test]
    fn changed_signals_lead_and_a_word_is_letters() {
        let shown = |earlier: Option<&[u8]>, now: &[u8]| split_signals(&layout(), now, earlier);
        let text = |changed: &str, unchanged: &str| (changed.to_owned(), unchanged.to_owned());
        assert_eq!(shown(None, &[3, 125]), text("spool 12.5 %, word DH?", ""));
        assert_eq!(shown(Some(&[3, 125]), &[3, 200]), text("spool 12.5 → 20.0 %", "word DH?"));
        assert_eq!(shown(Some(&[3, 200]), &[1, 200]), text("word DH → Dh?", "spool 20.0 %"));
        assert_eq!(shown(Some(&[3, 200]), &[3, 200]), text("", "spool 20.0 %, word DH?"));
        // The earlier payload does not contain the signal.
        assert_eq!(shown(Some(&[3]), &[3, 200]), text("spool 20.0 %", "word DH?"));
    }

    #[test]
    fn of_a_word_the_distinct_end_of_its_name_is_shown() {
        let mut layout = layout();
        assert_eq!(short_name(&layout, &layout.fields[0]), "word");
        let mut other = layout.fields[0].clone();
        other.bit = 16;
        other.meaning = other
            .meaning
            .map(|meaning| Arc::new(ObjectMeaning { name: "Drive word".into(), ..(*meaning).clone() }));
        layout.fields.push(other);
        assert_eq!(short_name(&layout, &layout.fields[0]), "status word");
        assert_eq!(short_name(&layout, &layout.fields[2]), "Drive word");
    }

    #[test]
    fn the_acronym_of_a_group_precedes_its_values() {
        let text = |acronym: &str, rest| (acronym.to_owned(), rest);
        assert_eq!(group_name("EEC1 engine controller 1"), text(" EEC1", "engine controller 1"));
        assert_eq!(group_name("proprietary B"), text("", "proprietary B"));
        assert_eq!((group_name("DM1"), group_name("")), (text(" DM1", ""), text("", "")));
    }

    #[test]
    fn of_a_long_payload_the_changed_bytes_are_shown() {
        let (mut old, mut new) = ([0_u8; 12], [0_u8; 12]);
        (old[11], new[11], new[3]) = (5, 6, 0xAB);
        assert_eq!(changed_bytes(&new, Some(&old)), "byte 3: 00 → AB, byte 11: 05 → 06");
        assert_eq!(changed_bytes(&[1, 2], Some(&[1, 3])), "01 02");
    }
}
