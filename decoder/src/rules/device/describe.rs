//! Events and values as findings name them.

use crate::event::{Event, EventKind};
use crate::finding::About;
use crate::profile::device::{Trigger, TriggerEvent, ValueUpdate};
use crate::profile::object::Format;
use crate::profile::{DataType, Meaning};
use crate::wire::canopen::ObjectAddress;
use crate::wire::j1939::Pgn;

/// A value as text.
pub(super) fn show_update(update: &ValueUpdate<'_>) -> String {
    match (update.raw, update.meaning) {
        (Some(raw), Some(meaning)) => show(meaning, raw),
        (Some(raw), None) => format!("{:X}h", raw.cast_unsigned()),
        (None, _) => "value".to_owned(),
    }
}

/// A number by its meaning; of bits only the word, as their names would fill the line.
pub(super) fn show(meaning: &Meaning, raw: i64) -> String {
    let digits = meaning.data_type.and_then(DataType::bits).map_or(0, |bits| usize::from(bits.div_ceil(4)));
    match (&meaning.bits, meaning.format) {
        (Some(_), _) => format!("{:0digits$X}h", raw.cast_unsigned()),
        // A signature: the first character is in the least significant byte.
        (None, Format::Ascii) => {
            let bytes = raw.to_le_bytes().into_iter().take(digits / 2);
            format!("'{}'", bytes.map(char::from).collect::<String>().escape_default())
        }
        (None, _) => meaning.show(&meaning.number(raw)),
    }
}

/// What happened, in words.
pub(super) fn show_event(event: &TriggerEvent<'_>) -> String {
    match event {
        TriggerEvent::Pdo(name) => name.to_string(),
        TriggerEvent::Message(name) => (*name).to_owned(),
        TriggerEvent::Value(update) => format!("{} {}", show_update(update), update.source.name()),
        TriggerEvent::Nmt(command) => format!("NMT {command}"),
        TriggerEvent::State(_, state) => format!("state {state}"),
        TriggerEvent::Sync => "SYNC".to_owned(),
        TriggerEvent::Emcy(code) => format!("EMCY {code:04X}"),
        TriggerEvent::Dtc(spn, fmi) => format!("SPN {spn} FMI {fmi}"),
        TriggerEvent::Boot => "start".to_owned(),
        TriggerEvent::Guard => "guarding request".to_owned(),
        TriggerEvent::Lss(lss) => format!("LSS {}", lss.service),
    }
}

/// What of the node a finding about an event is about; `cause` is the event of the bus.
pub(super) fn about_event(event: &TriggerEvent<'_>, cause: Option<&Event>) -> About {
    match event {
        TriggerEvent::Value(update) => About::Object(update.object),
        TriggerEvent::Message(_) => cause.and_then(pgn).map_or(About::Whole, |pgn| About::Pgn(pgn.number())),
        TriggerEvent::Emcy(code) => About::Code(*code),
        TriggerEvent::Dtc(spn, fmi) => About::Fault(*spn, *fmi),
        TriggerEvent::Pdo(name) => About::Name(name.to_string().into()),
        TriggerEvent::State(Some(channel), _) => About::Name(format!("channel {channel}").into()),
        _ => About::Whole,
    }
}

fn pgn(event: &Event) -> Option<Pgn> {
    match &event.kind {
        EventKind::J1939Message(message) => Some(message.id.pgn),
        EventKind::MessageGap(gap) => Some(gap.pgn),
        _ => None,
    }
}

/// What a finding is about if no event shows it: the first of the triggers that are waited for.
pub(super) fn about_first(triggers: &[Trigger]) -> About {
    match triggers.first() {
        Some(Trigger::Pdo(name)) => About::Name(name.to_string().into()),
        Some(Trigger::Write(of, _) | Trigger::Read(of, _)) => About::Object(of.object),
        Some(Trigger::Bit(bit, _)) => About::Object(bit.object.object),
        Some(Trigger::Set(set)) => About::Object(set.object.object),
        Some(Trigger::Message(message)) => About::Name(message.name.as_str().into()),
        _ => About::Whole,
    }
}

/// Whether an event is a value of this object.
pub(super) fn is_value_of(event: &TriggerEvent<'_>, object: Option<ObjectAddress>) -> bool {
    matches!(event, TriggerEvent::Value(update) if Some(update.object) == object)
}
