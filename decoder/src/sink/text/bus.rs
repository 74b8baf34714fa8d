//! Text of events that concern the bus or the capture.

use std::fmt::Write as _;

use super::LineTone;
use super::parts::{LineContent, format_bytes};
use super::pdo::push_signals;
use crate::event::{EvictedState, UndecodedFrame};
use crate::figures::format_seconds;
use crate::frame::{FrameFlags, LinkState};
use crate::query::record::{can_error_text, time_of_day};
use crate::wire::MalformedPayload;
use crate::wire::canopen::test_marker::TestMarker;
use crate::wire::error_frame::ErrorFrameFields;
use crate::words::count_noun;

pub(super) fn sync_line(counter: Option<u8>, expected: Option<u8>) -> LineContent {
    let counter = counter.map_or(String::new(), |counter| format!(" counter {counter}"));
    match expected {
        Some(expected) => ("SYNC", format!("SYNC{counter}, expected {expected}"), LineTone::Caution),
        None => ("SYNC", format!("SYNC{counter}"), LineTone::Quiet),
    }
}

pub(super) fn time_line(milliseconds: u32, days: u16) -> LineContent {
    ("TIME", time_of_day(milliseconds, days), LineTone::Plain)
}

pub(super) fn can_error(error: ErrorFrameFields) -> LineContent {
    if error.is_only_counters() {
        let (transmit, receive) = (error.transmit_errors, error.receive_errors);
        return (
            "STATE",
            format!("error counters of the controller: tx {transmit} rx {receive}"),
            LineTone::Plain,
        );
    }
    let mut what = can_error_text(error);
    if error.transmit_errors != 0 || error.receive_errors != 0 {
        let _ = write!(what, ", counters tx {} rx {}", error.transmit_errors, error.receive_errors);
    }
    ("ERROR", what, LineTone::Bad)
}

pub(super) fn frame_line(undecoded: &UndecodedFrame) -> LineContent {
    let tone = if undecoded.message.is_some() { LineTone::Plain } else { LineTone::Quiet };
    ("FRAME", frame_words(undecoded), tone)
}

pub(super) fn malformed_line(error: &MalformedPayload, reason: &str) -> LineContent {
    if error.needed == 0 {
        return ("BAD", reason.to_owned(), LineTone::Caution);
    }
    let needed = count_noun(error.needed, "byte");
    let what = format!("{reason}: needs {needed} from byte {}, found {}", error.offset, error.available);
    ("BAD", what, LineTone::Caution)
}

pub(super) fn evicted_line(what: EvictedState, count: u64) -> LineContent {
    ("LIMIT", format!("{count} × {} evicted: limit reached", what.name()), LineTone::Caution)
}

/// `step` in nanoseconds, negative.
pub(super) fn clock_step(step: i64) -> LineContent {
    let what = match step {
        ..0 => format!("timestamps jumped back by {} s", format_seconds(step.saturating_neg())),
        _ => format!("clock set forward by {} s", format_seconds(step)),
    };
    ("CLOCK", what, LineTone::Caution)
}

/// `gap` in nanoseconds.
pub(super) fn bus_silent(gap: i64) -> LineContent {
    let what = format!("no frames for {} s; deadlines within this gap ignored", format_seconds(gap));
    ("SILENT", what, LineTone::Caution)
}

pub(super) fn lost_frames(count: Option<u64>) -> LineContent {
    let count = count.map_or("frames (count unknown)".into(), |count| count_noun(count, "frame"));
    ("DROP", format!("recorder lost {count}"), LineTone::Bad)
}

/// Change of the interface; `bit_rate` in bit/s.
pub(super) fn link_line(state: LinkState, bit_rate: Option<u32>) -> LineContent {
    let tone = if state == LinkState::Up { LineTone::Plain } else { LineTone::Bad };
    let what = match (state, bit_rate) {
        (LinkState::Up, Some(rate)) => format!("link up, {rate} bit/s"),
        (LinkState::Up, None) => "link up".to_owned(),
        (LinkState::Down, _) => "interface down: no frames until it is up".to_owned(),
        (LinkState::Gone, _) => "interface removed: no frames until it is back".to_owned(),
    };
    ("LINK", what, tone)
}

fn frame_words(undecoded: &UndecodedFrame) -> String {
    let frame = &undecoded.frame;
    let name = undecoded.name.map_or(String::new(), |name| format!(" ({name})"));
    let remote = if frame.flags.contains(FrameFlags::REMOTE) { " remote" } else { "" };
    let fd = if frame.flags.contains(FrameFlags::FD) { " FD" } else { "" };
    let Some(message) = &undecoded.message else {
        return format!("{}{fd}{remote} [{}] {}{name}", frame.id, frame.length, format_bytes(frame.data()));
    };
    let mut signals = Vec::new();
    push_signals(&message.layout, frame.data(), &mut signals);
    let signals = String::from_utf8_lossy(&signals);
    format!("{}{fd} {} {}{signals}", frame.id, message.name, format_bytes(frame.data()))
}

pub(super) fn test_case(marker: TestMarker) -> LineContent {
    let step = match marker.result {
        Some(result) => format!("ended: {} (test tool)", result.name()),
        None => "started".to_owned(),
    };
    ("TEST", format!("conformance test {}.{} {step}", marker.group, marker.case), LineTone::Plain)
}

pub(super) fn unreadable_line(
    file: Option<&str>,
    line: Option<u64>,
    offset: Option<u64>,
    reason: &str,
) -> LineContent {
    let what = match (file, line, offset) {
        (Some(file), Some(line), _) => format!("{file}:{line}: {reason}"),
        (Some(file), None, Some(offset)) => format!("{file}: byte {offset}: {reason}"),
        (None, Some(line), _) => format!("line {line}: {reason}"),
        (None, None, Some(offset)) => format!("byte {offset}: {reason}"),
        (_, None, None) => reason.to_owned(),
    };
    ("UNREAD", what, LineTone::Caution)
}
