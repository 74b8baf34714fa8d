//! Drives that do not follow the control word (CiA 402-2 §7: state machine of a drive).

use super::failure::Conclusion;
use crate::finding::FindingSubject;
use crate::frame::CanId;
use crate::session::{Bus, BusStream, Node};

/// First RPDO and TPDO of the predefined connection set (CiA 301 §7.3.3), with control word and status word in front
/// (CiA 402-3 §9.3, §9.4).
const CONTROL: u16 = 0x200;
const STATUS: u16 = 0x180;

/// Low half of the device type of a drive (CiA 402-2 §6).
const DEVICE_TYPE: i64 = 402;

/// Time in ns for which control word and status word must not change.
const UNCHANGED: i64 = 2_000_000_000;

/// Control words (CiA 402-2 table 30, bits 0 to 3 and 7), with the states from which they have an effect.
const COMMANDS: [(u16, &str, &[DriveState]); 3] = [
    (0x06, "shutdown", &[DriveState::SwitchOnDisabled]),
    (0x07, "switch on", &[DriveState::SwitchOnDisabled, DriveState::ReadyToSwitchOn]),
    (
        0x0F,
        "enable operation",
        &[DriveState::SwitchOnDisabled, DriveState::ReadyToSwitchOn, DriveState::SwitchedOn],
    ),
];

/// States of the status word in which a drive waits (CiA 402-2 table 31).
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum DriveState {
    SwitchOnDisabled,
    ReadyToSwitchOn,
    SwitchedOn,
    Other,
}

impl DriveState {
    fn of_status(word: u16) -> Self {
        match (word & 0x4F, word & 0x6F) {
            (0x40, _) => Self::SwitchOnDisabled,
            (_, 0x21) => Self::ReadyToSwitchOn,
            (_, 0x23) => Self::SwitchedOn,
            _ => Self::Other,
        }
    }

    fn name(self) -> &'static str {
        match self {
            Self::SwitchOnDisabled => "SWITCH ON DISABLED",
            Self::ReadyToSwitchOn => "READY TO SWITCH ON",
            Self::SwitchedOn => "SWITCHED ON",
            Self::Other => "another state",
        }
    }
}

pub(super) fn conclude_drives(bus: &Bus) -> Vec<Conclusion> {
    let streams: Vec<BusStream> = bus.streams().collect();
    bus.nodes().filter_map(|node| not_enabled(bus, node, &streams)).collect()
}

/// A drive that stays in a state although the control word commands the next one.
fn not_enabled(bus: &Bus, node: &Node, streams: &[BusStream]) -> Option<Conclusion> {
    let number = u16::from(node.id().canopen()?);
    let stream = |base: u16| streams.iter().find(|it| it.id == CanId::from_standard(base + number));
    let (control, status) = (stream(CONTROL)?, stream(STATUS)?);
    let is_still = |stream: &BusStream| {
        let since = if stream.changes.count == 0 { stream.times.0 } else { stream.changes.last };
        stream.times.1.saturating_sub(since) > UNCHANGED
            && bus.now().saturating_sub(stream.times.1) < UNCHANGED
    };
    let (command, word) = (low_word(control.payload), low_word(status.payload));
    if !is_still(control) || !is_still(status) || !is_drive(node, command, word) {
        return None;
    }
    let state = DriveState::of_status(word);
    let (_, name, from) = COMMANDS.into_iter().find(|(known, _, _)| command & 0x8F == *known)?;
    if !from.contains(&state) {
        return None;
    }
    let since = |stream: &BusStream| match stream.changes.count {
        0 => (stream.times.0, stream.last_frame),
        _ => (stream.changes.last, stream.changes.frame),
    };
    let began = since(control).max(since(status));
    let voltage = if word & 0x10 == 0 { ", voltage enabled (bit 4) = 0" } else { "" };
    let text = format!(
        "control word {command:04X}h ({name}) without effect: status word {word:04X}h, {}{voltage} {{{}}}",
        state.name(),
        status.last_frame
    );
    Some(Conclusion {
        hypothesis: "command-not-followed",
        node: Some(node.id()),
        nodes: vec![node.id()],
        about: FindingSubject::Whole,
        text,
        began,
        is_note: false,
        ended: None,
    })
}

/// Whether a node is a drive by its device type, or by both words: "remote" (bit 9) is set, reserved bits are 0.
fn is_drive(node: &Node, control: u16, status: u16) -> bool {
    let device_type = node.proven_value(crate::wire::canopen::ObjectAddress::new(0x1000, 0));
    match device_type {
        Some((value, _)) => value & 0xFFFF == DEVICE_TYPE,
        None => control & 0xFE00 == 0 && status & 0x0200 != 0 && status & 0xC100 == 0,
    }
}

/// The first two bytes of a payload.
fn low_word(payload: u64) -> u16 {
    #[expect(clippy::cast_possible_truncation, reason = "masked")]
    let word = (payload & 0xFFFF) as u16;
    word
}
