//! Events and values as text for findings.

use crate::event::{Event, EventKind};
use crate::finding::FindingSubject;
use crate::profile::device::{ProfileTrigger, TriggerEvent, ValueUpdate};
use crate::profile::object::NumberFormat;
use crate::profile::{DataType, ObjectMeaning};
use crate::wire::canopen::ObjectAddress;
use crate::wire::j1939::Pgn;

/// Text of a rule with details in parentheses; parentheses at the end of the text are continued.
pub(super) fn with_details(text: &str, details: &str) -> String {
    match text.strip_suffix(')') {
        _ if details.is_empty() => text.to_owned(),
        Some(open) => format!("{open}, {details})"),
        None => format!("{text} ({details})"),
    }
}

/// Value of an update as text.
pub(super) fn show_update(update: &ValueUpdate<'_>) -> String {
    match (update.raw, update.meaning) {
        (Some(raw), Some(meaning)) => show_number(meaning, raw),
        (Some(raw), None) => format!("{:X}h", raw.cast_unsigned()),
        (None, _) => "value".to_owned(),
    }
}

/// Number with its meaning; a bit field is printed as hexadecimal only, since the names of its bits are too
/// long.
pub(super) fn show_number(meaning: &ObjectMeaning, raw: i64) -> String {
    let digits = meaning.data_type.and_then(DataType::bits).map_or(0, |bits| usize::from(bits.div_ceil(4)));
    match (&meaning.bits, meaning.format) {
        // A signature: the first character is in the least significant byte.
        (_, NumberFormat::Ascii) => {
            let all = raw.to_le_bytes();
            let length = all.iter().rposition(|byte| *byte != 0).map_or(0, |last| last + 1);
            let bytes = all.into_iter().take(if digits == 0 { length } else { digits / 2 });
            format!("'{}'", bytes.map(char::from).collect::<String>().escape_default())
        }
        (Some(_), _) => format!("{:0digits$X}h", raw.cast_unsigned()),
        (None, _) => meaning.format_value(&meaning.convert_raw(raw)),
    }
}

/// Event as text.
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
        TriggerEvent::Boot { .. } => "boot-up".to_owned(),
        TriggerEvent::Guard => "guarding request".to_owned(),
        TriggerEvent::Reports(state) => format!("{state} reported"),
        TriggerEvent::Lss(lss) => format!("LSS {}", lss.service),
    }
}

/// Subject of a finding about an event; `cause` is the event on the bus.
pub(super) fn about_event(event: &TriggerEvent<'_>, cause: Option<&Event>) -> FindingSubject {
    match event {
        TriggerEvent::Value(update) => FindingSubject::Object(update.object),
        TriggerEvent::Message(_) => {
            cause.and_then(event_pgn).map_or(FindingSubject::Whole, |pgn| FindingSubject::Pgn(pgn.number()))
        }
        TriggerEvent::Emcy(code) => FindingSubject::Code(*code),
        TriggerEvent::Dtc(spn, fmi) => FindingSubject::Fault(*spn, *fmi),
        TriggerEvent::Pdo(name) => FindingSubject::Name(name.to_string().into()),
        TriggerEvent::Reports(state) => FindingSubject::Name((*state).into()),
        TriggerEvent::State(Some(channel), _) => FindingSubject::Name(format!("channel {channel}").into()),
        _ => FindingSubject::Whole,
    }
}

fn event_pgn(event: &Event) -> Option<Pgn> {
    match &event.kind {
        EventKind::J1939Message(message) => Some(message.id.pgn),
        EventKind::MessageGap(gap) => Some(gap.pgn),
        _ => None,
    }
}

/// Subject of a finding without an event: the first awaited trigger.
pub(super) fn about_first(triggers: &[ProfileTrigger]) -> FindingSubject {
    match triggers.first() {
        Some(ProfileTrigger::Pdo(name)) => FindingSubject::Name(name.to_string().into()),
        Some(ProfileTrigger::Write(of, _) | ProfileTrigger::Read(of, _)) => FindingSubject::Object(of.object),
        Some(ProfileTrigger::Bit(bit, _)) => FindingSubject::Object(bit.object.object),
        Some(ProfileTrigger::Set(set) | ProfileTrigger::Shows(set)) => {
            FindingSubject::Object(set.object.object)
        }
        Some(ProfileTrigger::Message(message)) => FindingSubject::Name(message.name.as_str().into()),
        _ => FindingSubject::Whole,
    }
}

/// Whether an event is a value of this object.
pub(super) fn is_value_of(event: &TriggerEvent<'_>, object: Option<ObjectAddress>) -> bool {
    matches!(event, TriggerEvent::Value(update) if Some(update.object) == object)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn details_follow_the_text_in_one_pair_of_parentheses() {
        assert_eq!(with_details("AVC interval above 250 ms", "312 ms"), "AVC interval above 250 ms (312 ms)");
        let signature = with_details("wrong store signature (expected 'save')", "'SAVE' written");
        assert_eq!(signature, "wrong store signature (expected 'save', 'SAVE' written)");
        assert_eq!(with_details("no response", ""), "no response");
    }
}
