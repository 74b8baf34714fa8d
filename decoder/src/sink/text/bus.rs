//! The words of events about bus and capture rather than a node.

use std::fmt::Write as _;

use super::Tone;
use super::parts::{Said, bytes, seconds};
use super::pdo::push_signals;
use crate::event::Undecoded;
use crate::frame::{FrameFlags, LinkState};
use crate::query::record::{can_error_text, time_of_day};
use crate::wire::Malformed;
use crate::wire::canopen::test_marker::TestMarker;
use crate::wire::error_frame::ErrorFrame;
use crate::words::plural;

pub(super) fn sync(counter: Option<u8>, expected: Option<u8>) -> Said {
    let counter = counter.map_or(String::new(), |counter| format!(" counter {counter}"));
    match expected {
        Some(expected) => ("SYNC", format!("SYNC{counter}, expected {expected}"), Tone::Caution),
        None => ("SYNC", format!("SYNC{counter}"), Tone::Quiet),
    }
}

pub(super) fn time(milliseconds: u32, days: u16) -> Said {
    ("TIME", time_of_day(milliseconds, days), Tone::Plain)
}

pub(super) fn can_error(error: ErrorFrame) -> Said {
    let mut what = can_error_text(error);
    if error.transmit_errors != 0 || error.receive_errors != 0 {
        let _ = write!(what, ", counters tx {} rx {}", error.transmit_errors, error.receive_errors);
    }
    ("ERROR", what, Tone::Bad)
}

pub(super) fn frame(undecoded: &Undecoded) -> Said {
    let tone = if undecoded.message.is_some() { Tone::Plain } else { Tone::Quiet };
    ("FRAME", frame_words(undecoded), tone)
}

pub(super) fn malformed(error: &Malformed, reason: &str) -> Said {
    if error.needed == 0 {
        return ("BAD", reason.to_owned(), Tone::Caution);
    }
    let needed = plural(error.needed, "byte");
    let what = format!("{reason}: {} of {needed} there from byte {}", error.available, error.offset);
    ("BAD", what, Tone::Caution)
}

pub(super) fn evicted(what: &str, count: u64) -> Said {
    ("LIMIT", format!("{count} × {what} given up: limit reached"), Tone::Caution)
}

/// `step` in nanoseconds, negative.
pub(super) fn clock_step(step: i64) -> Said {
    let what = format!("time stamps went back by {} s", seconds(step.saturating_neg()));
    ("CLOCK", what, Tone::Caution)
}

/// `gap` in nanoseconds.
pub(super) fn bus_silent(gap: i64) -> Said {
    let what = format!("no frame at all for {} s; deadlines within it do not count", seconds(gap));
    ("SILENT", what, Tone::Caution)
}

pub(super) fn lost_frames(count: Option<u64>) -> Said {
    let count = count.map_or("some frames".into(), |count| plural(count, "frame"));
    ("DROP", format!("the recorder lost {count}"), Tone::Bad)
}

/// What becomes of the bus; `bit_rate` in bit/s.
pub(super) fn link(state: LinkState, bit_rate: Option<u32>) -> Said {
    let tone = if state == LinkState::Up { Tone::Plain } else { Tone::Bad };
    let what = match (state, bit_rate) {
        (LinkState::Up, Some(rate)) => format!("the way to the bus is open, {rate} bit/s"),
        (LinkState::Up, None) => "the way to the bus is open".to_owned(),
        (LinkState::Down, _) => "the interface is down: nothing is seen until it is up".to_owned(),
        (LinkState::Gone, _) => "the interface is gone: nothing is seen until it is back".to_owned(),
    };
    ("LINK", what, tone)
}

fn frame_words(undecoded: &Undecoded) -> String {
    let frame = &undecoded.frame;
    let name = undecoded.name.map_or(String::new(), |name| format!(" ({name})"));
    let remote = if frame.flags.contains(FrameFlags::REMOTE) { " remote" } else { "" };
    let fd = if frame.flags.contains(FrameFlags::FD) { " FD" } else { "" };
    let Some(message) = &undecoded.message else {
        return format!("{}{fd}{remote} [{}] {}{name}", frame.id, frame.length, bytes(frame.data()));
    };
    let mut signals = Vec::new();
    push_signals(&message.layout, frame.data(), &mut signals);
    let signals = String::from_utf8_lossy(&signals);
    format!("{}{fd} {} {}{signals}", frame.id, message.name, bytes(frame.data()))
}

pub(super) fn test_case(marker: TestMarker) -> Said {
    let step = match marker.result {
        Some(result) => format!("ends: {} by the test tool", result.name()),
        None => "begins".to_owned(),
    };
    ("TEST", format!("conformance test {}.{} {step}", marker.group, marker.case), Tone::Plain)
}

pub(super) fn unreadable(line: Option<u64>, offset: Option<u64>, reason: &str) -> Said {
    let what = match (line, offset) {
        (Some(line), _) => format!("line {line}: {reason}"),
        (None, Some(offset)) => format!("byte {offset}: {reason}"),
        (None, None) => reason.to_owned(),
    };
    ("UNREAD", what, Tone::Caution)
}
