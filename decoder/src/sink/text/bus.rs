//! The words of events about bus and capture rather than a node.

use std::fmt::Write as _;

use super::Tone;
use super::parts::{Words, bytes, seconds};
use super::pdo::push_signals;
use crate::event::{Event, EventKind, Undecoded};
use crate::frame::{FrameFlags, LinkState};
use crate::query::record::{can_error_text, time_of_day};
use crate::wire::canopen::test_marker::TestMarker;
use crate::words::plural;

/// Kinds that are about bus and capture rather than a node.
pub(super) fn words(event: &Event, words: impl Fn(&'static str, String, Tone) -> Words) -> Words {
    match &event.kind {
        EventKind::Sync { counter, expected } => {
            let counter = counter.map_or(String::new(), |counter| format!(" counter {counter}"));
            match expected {
                Some(expected) => words("SYNC", format!("SYNC{counter}, expected {expected}"), Tone::Caution),
                None => words("SYNC", format!("SYNC{counter}"), Tone::Quiet),
            }
        }
        EventKind::Time { milliseconds, days } => {
            words("TIME", time_of_day(*milliseconds, *days), Tone::Plain)
        }
        EventKind::CanError(error) => {
            let mut what = can_error_text(*error);
            if error.transmit_errors != 0 || error.receive_errors != 0 {
                let _ = write!(what, ", counters tx {} rx {}", error.transmit_errors, error.receive_errors);
            }
            words("ERROR", what, Tone::Bad)
        }
        EventKind::Frame(undecoded) => {
            let tone = if undecoded.message.is_some() { Tone::Plain } else { Tone::Quiet };
            words("FRAME", frame(undecoded), tone)
        }
        EventKind::Malformed { error, reason } => {
            let what = format!(
                "{reason}: {} of {} there from byte {}",
                error.available,
                plural(error.needed, "byte"),
                error.offset
            );
            let what = if error.needed == 0 { (*reason).to_owned() } else { what };
            words("BAD", what, Tone::Caution)
        }
        EventKind::Evicted { what, count } => {
            words("LIMIT", format!("{count} × {what} given up: limit reached"), Tone::Caution)
        }
        EventKind::ClockStep { step } => words(
            "CLOCK",
            format!("time stamps went back by {} s", seconds(step.saturating_neg())),
            Tone::Caution,
        ),
        EventKind::BusSilent { gap } => words(
            "SILENT",
            format!("no frame at all for {} s; deadlines within it do not count", seconds(*gap)),
            Tone::Caution,
        ),
        EventKind::LostFrames { count } => {
            let count = count.map_or("some frames".into(), |count| plural(count, "frame"));
            words("DROP", format!("the recorder lost {count}"), Tone::Bad)
        }
        EventKind::Link { state, bit_rate } => {
            let tone = if *state == LinkState::Up { Tone::Plain } else { Tone::Bad };
            words("LINK", link(*state, *bit_rate), tone)
        }
        EventKind::Unreadable { line, offset, reason, .. } => {
            words("UNREAD", unreadable(*line, *offset, reason), Tone::Caution)
        }
        EventKind::TestCase(marker) => words("TEST", test_case(*marker), Tone::Plain),
        EventKind::Note { text } => words("NOTE", text.clone(), Tone::Caution),
        _ => words("", event.kind.name().into(), Tone::Plain),
    }
}

/// What becomes of the bus; `bit_rate` in bit/s.
fn link(state: LinkState, bit_rate: Option<u32>) -> String {
    match (state, bit_rate) {
        (LinkState::Up, Some(rate)) => format!("the way to the bus is open, {rate} bit/s"),
        (LinkState::Up, None) => "the way to the bus is open".to_owned(),
        (LinkState::Down, _) => "the interface is down: nothing is seen until it is up".to_owned(),
        (LinkState::Gone, _) => "the interface is gone: nothing is seen until it is back".to_owned(),
    }
}

fn frame(undecoded: &Undecoded) -> String {
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

fn test_case(marker: TestMarker) -> String {
    let step = match marker.result {
        Some(result) => format!("ends: {} by the test tool", result.name()),
        None => "begins".to_owned(),
    };
    format!("conformance test {}.{} {step}", marker.group, marker.case)
}

fn unreadable(line: Option<u64>, offset: Option<u64>, reason: &str) -> String {
    match (line, offset) {
        (Some(line), _) => format!("line {line}: {reason}"),
        (None, Some(offset)) => format!("byte {offset}: {reason}"),
        (None, None) => reason.to_owned(),
    }
}
