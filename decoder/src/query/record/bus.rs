//! Fields and texts of events about the bus and the capture.

use super::{FieldConsumer, FieldValue, number_or_null, visit_signals};
use crate::event::{EvictedState, UndecodedFrame};
use crate::frame::{FrameFlags, LinkState};
use crate::profile;
use crate::wire::MalformedPayload;
use crate::wire::canopen::test_marker::TestMarker;
use crate::wire::error_frame::ErrorFrameFields;

pub(super) fn visit_sync(counter: Option<u8>, expected: Option<u8>, fields: &mut dyn FieldConsumer) {
    fields.add_field("counter", number_or_null(counter));
    if let Some(expected) = expected {
        fields.add_field("expected", FieldValue::Unsigned(u64::from(expected)));
    }
}

pub(super) fn visit_time(milliseconds: u32, days: u16, fields: &mut dyn FieldConsumer) {
    fields.add_field("time", FieldValue::Text(&time_of_day(milliseconds, days)));
}

pub(super) fn visit_undecoded(undecoded: &UndecodedFrame, fields: &mut dyn FieldConsumer) {
    fields.add_field("id", FieldValue::Id(undecoded.frame.id));
    let message = undecoded.message.as_deref();
    if let Some(name) = message.map(|message| message.name.as_str()).or(undecoded.name) {
        fields.add_field("name", FieldValue::Text(name));
    }
    frame_flags(undecoded.frame.flags, fields);
    fields.add_field("size", FieldValue::Unsigned(u64::from(undecoded.frame.length)));
    fields.add_field("data", FieldValue::Bytes(undecoded.frame.data()));
    if let Some(message) = message.filter(|_| fields.wants_signals()) {
        visit_signals(&message.layout, undecoded.frame.data(), fields);
    }
}

pub(super) fn visit_malformed(error: &MalformedPayload, reason: &str, fields: &mut dyn FieldConsumer) {
    fields.add_field("layer", FieldValue::Text(error.layer));
    fields.add_field("offset", FieldValue::Unsigned(u64::from(error.offset)));
    fields.add_field("needed", FieldValue::Unsigned(u64::from(error.needed)));
    fields.add_field("available", FieldValue::Unsigned(u64::from(error.available)));
    fields.add_field("reason", FieldValue::Text(reason));
}

pub(super) fn visit_evicted(what: EvictedState, count: u64, fields: &mut dyn FieldConsumer) {
    fields.add_field("what", FieldValue::Text(what.name()));
    fields.add_field("count", FieldValue::Unsigned(count));
}

pub(super) fn test_case(marker: TestMarker, fields: &mut dyn FieldConsumer) {
    fields.add_field("case", FieldValue::Text(&format!("{}.{}", marker.group, marker.case)));
    let result = marker.result.map_or(FieldValue::Null, |result| FieldValue::Text(result.name()));
    fields.add_field("result", result);
}

pub(super) fn lost_frames(count: Option<u64>, fields: &mut dyn FieldConsumer) {
    fields.add_field("count", count.map_or(FieldValue::Null, FieldValue::Unsigned));
}

pub(super) fn visit_link(state: LinkState, bit_rate: Option<u32>, fields: &mut dyn FieldConsumer) {
    fields.add_field("state", FieldValue::Text(state.name()));
    fields.add_field("bit_rate", bit_rate.map_or(FieldValue::Null, |rate| FieldValue::Unsigned(rate.into())));
}

pub(super) fn visit_unreadable(
    file: Option<&str>,
    line: Option<u64>,
    offset: Option<u64>,
    reason: &str,
    fields: &mut dyn FieldConsumer,
) {
    if let Some(file) = file {
        fields.add_field("file", FieldValue::Text(file));
    }
    if let Some(line) = line {
        fields.add_field("line", FieldValue::Unsigned(line));
    }
    if let Some(offset) = offset {
        fields.add_field("offset", FieldValue::Unsigned(offset));
    }
    fields.add_field("reason", FieldValue::Text(reason));
}

fn frame_flags(flags: FrameFlags, fields: &mut dyn FieldConsumer) {
    if flags.contains(FrameFlags::REMOTE) {
        fields.add_field("remote", FieldValue::Bool(true));
    }
    if flags.contains(FrameFlags::FD) {
        fields.add_field("fd", FieldValue::Bool(true));
    }
}

pub(super) fn can_error(error: ErrorFrameFields, fields: &mut dyn FieldConsumer) {
    let names = profile::can_errors();
    let classes: Vec<&str> = names.classes.set_names(error.classes & !ErrorFrameFields::COUNTERS).collect();
    fields.add_field("class", FieldValue::Text(&classes.join(",")));
    fields.add_field("text", FieldValue::Text(&can_error_text(error)));
    // linux/can/error.h: the counters are valid with class bit 0x200; older drivers fill them anyway.
    if error.classes & ErrorFrameFields::COUNTERS != 0
        || error.transmit_errors != 0
        || error.receive_errors != 0
    {
        fields.add_field("tx_errors", FieldValue::Unsigned(u64::from(error.transmit_errors)));
        fields.add_field("rx_errors", FieldValue::Unsigned(u64::from(error.receive_errors)));
    }
}

/// Text of an error frame: error classes with their details.
pub fn can_error_text(error: ErrorFrameFields) -> String {
    let names = profile::can_errors();
    let mut parts: Vec<String> = Vec::new();
    let is_named =
        |class: &u32| error.classes & class != 0 && names.classes.set_names(*class).next().is_some();
    for class in (0..29).map(|bit| 1 << bit).filter(is_named) {
        let details: Vec<&str> = match class {
            ErrorFrameFields::CONTROLLER => names.controller.set_texts(u32::from(error.controller)).collect(),
            ErrorFrameFields::PROTOCOL => {
                let location =
                    names.location.text_of(u32::from(error.location)).filter(|_| error.location != 0);
                names.protocol.set_texts(u32::from(error.protocol)).chain(location).collect()
            }
            ErrorFrameFields::TRANSCEIVER => {
                names.transceiver.text_of(u32::from(error.transceiver)).into_iter().collect()
            }
            ErrorFrameFields::COUNTERS => continue,
            _ => names.classes.set_texts(class).collect(),
        };
        let at = if class == ErrorFrameFields::LOST_ARBITRATION && error.arbitration_bit != 0 {
            format!(" at bit {}", error.arbitration_bit)
        } else {
            String::new()
        };
        let details = if details.is_empty() {
            names.classes.set_texts(class).collect::<String>()
        } else {
            details.join(", ")
        };
        parts.push(format!("{details}{at}"));
    }
    if error.is_only_counters() {
        "error counters of the controller".to_owned()
    } else if parts.is_empty() {
        format!("unknown error class {:08X}", error.classes)
    } else {
        parts.join("; ")
    }
}

/// Converts a TIME message to a date (CiA 301 §7.1.6.5: days since 1984-01-01).
pub fn time_of_day(milliseconds: u32, days: u16) -> String {
    let midnight = jiff::civil::date(1984, 1, 1).saturating_add(jiff::Span::new().days(i64::from(days)));
    let time = midnight.at(0, 0, 0, 0).checked_add(jiff::Span::new().milliseconds(i64::from(milliseconds)));
    time.map_or_else(|_| format!("{days} d {milliseconds} ms"), |time| format!("{time:.3}"))
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::wire::error_frame;

    #[test]
    fn time_of_day_counts_from_1984() {
        // 14,610 days after 1984-01-01 is 2024-01-01; 43,200,000 ms is noon.
        assert_eq!(time_of_day(43_200_000, 14_610), "2024-01-01T12:00:00.000");
    }

    #[test]
    fn error_frames_in_words() {
        let error = error_frame::parse_error_frame(0x2000_0204, &[0, 0x04, 0, 0, 0, 0, 96, 128]);
        assert_eq!(can_error_text(error), "receive errors at warning level");
        let error = error_frame::parse_error_frame(0x2000_0008, &[0, 0, 0x04, 0x19, 0, 0, 0, 0]);
        assert_eq!(can_error_text(error), "bit stuffing error, ACK slot");
        assert_eq!(can_error_text(error_frame::parse_error_frame(0x2000_0040, &[])), "controller is bus-off");
    }
}
