//! Fields and texts of events about the bus and the capture.

use super::{FieldValue, Fields, number_or_null, signals};
use crate::event::{EvictedState, Undecoded};
use crate::frame::{FrameFlags, LinkState};
use crate::profile;
use crate::wire::Malformed;
use crate::wire::canopen::test_marker::TestMarker;
use crate::wire::error_frame::ErrorFrame;

pub(super) fn sync(counter: Option<u8>, expected: Option<u8>, fields: &mut dyn Fields) {
    fields.field("counter", number_or_null(counter));
    if let Some(expected) = expected {
        fields.field("expected", FieldValue::Unsigned(u64::from(expected)));
    }
}

pub(super) fn time(milliseconds: u32, days: u16, fields: &mut dyn Fields) {
    fields.field("time", FieldValue::Text(&time_of_day(milliseconds, days)));
}

pub(super) fn undecoded(undecoded: &Undecoded, fields: &mut dyn Fields) {
    fields.field("id", FieldValue::Id(undecoded.frame.id));
    let message = undecoded.message.as_deref();
    if let Some(name) = message.map(|message| message.name.as_str()).or(undecoded.name) {
        fields.field("name", FieldValue::Text(name));
    }
    frame_flags(undecoded.frame.flags, fields);
    fields.field("size", FieldValue::Unsigned(u64::from(undecoded.frame.length)));
    fields.field("data", FieldValue::Bytes(undecoded.frame.data()));
    if let Some(message) = message.filter(|_| fields.wants_signals()) {
        signals(&message.layout, undecoded.frame.data(), fields);
    }
}

pub(super) fn malformed(error: &Malformed, reason: &str, fields: &mut dyn Fields) {
    fields.field("layer", FieldValue::Text(error.layer));
    fields.field("offset", FieldValue::Unsigned(u64::from(error.offset)));
    fields.field("needed", FieldValue::Unsigned(u64::from(error.needed)));
    fields.field("available", FieldValue::Unsigned(u64::from(error.available)));
    fields.field("reason", FieldValue::Text(reason));
}

pub(super) fn evicted(what: EvictedState, count: u64, fields: &mut dyn Fields) {
    fields.field("what", FieldValue::Text(what.name()));
    fields.field("count", FieldValue::Unsigned(count));
}

pub(super) fn test_case(marker: TestMarker, fields: &mut dyn Fields) {
    fields.field("case", FieldValue::Text(&format!("{}.{}", marker.group, marker.case)));
    let result = marker.result.map_or(FieldValue::Null, |result| FieldValue::Text(result.name()));
    fields.field("result", result);
}

pub(super) fn lost_frames(count: Option<u64>, fields: &mut dyn Fields) {
    fields.field("count", count.map_or(FieldValue::Null, FieldValue::Unsigned));
}

pub(super) fn link(state: LinkState, bit_rate: Option<u32>, fields: &mut dyn Fields) {
    fields.field("state", FieldValue::Text(state.name()));
    fields.field("bit_rate", bit_rate.map_or(FieldValue::Null, |rate| FieldValue::Unsigned(rate.into())));
}

pub(super) fn unreadable(
    file: Option<&str>,
    line: Option<u64>,
    offset: Option<u64>,
    reason: &str,
    fields: &mut dyn Fields,
) {
    if let Some(file) = file {
        fields.field("file", FieldValue::Text(file));
    }
    if let Some(line) = line {
        fields.field("line", FieldValue::Unsigned(line));
    }
    if let Some(offset) = offset {
        fields.field("offset", FieldValue::Unsigned(offset));
    }
    fields.field("reason", FieldValue::Text(reason));
}

fn frame_flags(flags: FrameFlags, fields: &mut dyn Fields) {
    if flags.contains(FrameFlags::REMOTE) {
        fields.field("remote", FieldValue::Bool(true));
    }
    if flags.contains(FrameFlags::FD) {
        fields.field("fd", FieldValue::Bool(true));
    }
}

pub(super) fn can_error(error: ErrorFrame, fields: &mut dyn Fields) {
    let names = profile::can_errors();
    let classes: Vec<&str> = names.classes.names(error.classes & !ErrorFrame::COUNTERS).collect();
    fields.field("class", FieldValue::Text(&classes.join(",")));
    fields.field("text", FieldValue::Text(&can_error_text(error)));
    // linux/can/error.h: the counters are valid with class bit 0x200; older drivers fill them anyway.
    if error.classes & ErrorFrame::COUNTERS != 0 || error.transmit_errors != 0 || error.receive_errors != 0 {
        fields.field("tx_errors", FieldValue::Unsigned(u64::from(error.transmit_errors)));
        fields.field("rx_errors", FieldValue::Unsigned(u64::from(error.receive_errors)));
    }
}

/// Text of an error frame: error classes with their details.
pub fn can_error_text(error: ErrorFrame) -> String {
    let names = profile::can_errors();
    let mut parts: Vec<String> = Vec::new();
    let is_named = |class: &u32| error.classes & class != 0 && names.classes.names(*class).next().is_some();
    for class in (0..29).map(|bit| 1 << bit).filter(is_named) {
        let details: Vec<&str> = match class {
            ErrorFrame::CONTROLLER => names.controller.texts(u32::from(error.controller)).collect(),
            ErrorFrame::PROTOCOL => {
                let location =
                    names.location.text_of(u32::from(error.location)).filter(|_| error.location != 0);
                names.protocol.texts(u32::from(error.protocol)).chain(location).collect()
            }
            ErrorFrame::TRANSCEIVER => {
                names.transceiver.text_of(u32::from(error.transceiver)).into_iter().collect()
            }
            ErrorFrame::COUNTERS => continue,
            _ => names.classes.texts(class).collect(),
        };
        let at = if class == ErrorFrame::LOST_ARBITRATION && error.arbitration_bit != 0 {
            format!(" at bit {}", error.arbitration_bit)
        } else {
            String::new()
        };
        let details = if details.is_empty() {
            names.classes.texts(class).collect::<String>()
        } else {
            details.join(", ")
        };
        parts.push(format!("{details}{at}"));
    }
    if parts.is_empty() { format!("unknown error class {:08X}", error.classes) } else { parts.join("; ") }
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
        let error = error_frame::parse(0x2000_0204, &[0, 0x04, 0, 0, 0, 0, 96, 128]);
        assert_eq!(can_error_text(error), "receive errors at warning level");
        let error = error_frame::parse(0x2000_0008, &[0, 0, 0x04, 0x19, 0, 0, 0, 0]);
        assert_eq!(can_error_text(error), "bit stuffing error, ACK slot");
        assert_eq!(can_error_text(error_frame::parse(0x2000_0040, &[])), "controller is bus-off");
    }
}
