//! The session: any frames in any order, with steps in time.
//!
//! ```text
//! byte 0      options: bits 0..1 protocol, bits 2..7 position of the checkpoint
//! then frames:
//! control     bits 0..1 time (0 +1 ms, 1 +100 ms, 2 -10 ms, each times the next byte; 3 none)
//!             bit 2 29-bit  bit 3 remote  bit 4 error  bit 5 FD  bits 6..7 bus
//! time        one byte, omitted for none
//! identifier  two or four bytes, least significant first
//! length      one byte: modulo 9, of FD modulo 65
//! data        length bytes; none in a remote frame
//! ```

use std::sync::OnceLock;

use cobscope_decoder::capture::BusNames;
use cobscope_decoder::decoder::Decoder;
use cobscope_decoder::frame::{BusIndex, CanId, Frame, FrameFlags, Timestamp};
use cobscope_decoder::profile::Catalogue;
use cobscope_decoder::session::{AssignedBy, Assignment, ProtocolChoice, SessionOptions};

use super::observe::Checker;

/// Interface names that a malicious capture could contain.
const NAMES: [&[u8]; 4] = [b"can0", b"\x1b[31mcan\x07", b"::error::x", b"\xFF\xFE\r\n"];

const MILLISECOND: i64 = 1_000_000;
const START: i64 = 1_700_000_000_000_000_000;

const FLAGS: [(u8, FrameFlags); 3] =
    [(1 << 3, FrameFlags::REMOTE), (1 << 4, FrameFlags::ERROR), (1 << 5, FrameFlags::FD)];

/// Profiles of the nodes of `devices`.
const DEVICES: [(u8, &str); 6] = [
    (1, "wandfluh-md2:amplifier"),
    (2, "rexroth-sydfec"),
    (3, "wandfluh-md2:controller"),
    (5, "rexroth-ifb-iac"),
    (32, "danfoss-pve-ci"),
    (63, "rexroth-vpcd"),
];

/// Decodes frames built from the bytes with all sinks, then again from a checkpoint.
pub fn session(data: &[u8]) {
    checked(data, &SessionOptions::default());
}

/// The same as [`session`], with nodes that have a device profile.
pub fn devices(data: &[u8]) {
    static OPTIONS: OnceLock<SessionOptions> = OnceLock::new();
    let options = OPTIONS.get_or_init(|| {
        let catalogue = Catalogue::default();
        let assign = |(node, id): (u8, &str)| {
            let device = catalogue.device(id).unwrap();
            Assignment { bus: None, node: node.into(), device, by: AssignedBy::Option }
        };
        SessionOptions { assignments: DEVICES.map(assign).into(), ..SessionOptions::default() }
    });
    checked(data, options);
}

fn checked(data: &[u8], given: &SessionOptions) {
    let Some((options, rest)) = data.split_first() else { return };
    let frames = frames(rest);
    let mut names = BusNames::default();
    for name in NAMES {
        names.index_of(name);
    }
    let protocol = match options & 3 {
        0 => ProtocolChoice::Auto,
        3 => ProtocolChoice::None,
        _ => ProtocolChoice::Canopen,
    };
    let mut decoder = Decoder::new(SessionOptions { protocol, ..given.clone() });
    let place = frames.len() * usize::from(options >> 2) / 64;
    let (before, after) = frames.split_at(place);
    push(&mut decoder, before, &names, &mut Checker::new());
    let mut checkpoint = decoder.clone();
    let events = finish(&mut decoder, after, &names, Checker::keeping());
    assert_eq!(finish(&mut checkpoint, after, &names, Checker::comparing()), events, "from the checkpoint");
    assert!(decoder.footprint() < 16 << 20);
}

fn push(decoder: &mut Decoder, frames: &[Frame], names: &BusNames, checker: &mut Checker) {
    for frame in frames {
        checker.last_frame = frame.number;
        decoder.push(frame, names, checker);
    }
}

fn finish(decoder: &mut Decoder, frames: &[Frame], names: &BusNames, mut checker: Checker) -> Vec<String> {
    checker.last_frame = frames.first().map_or(u64::MAX, |frame| frame.number - 1);
    push(decoder, frames, names, &mut checker);
    decoder.finish_capture(names, &mut checker);
    checker.kept.unwrap_or_default()
}

/// Builds frames from the bytes after the options.
pub fn frames(mut bytes: &[u8]) -> Vec<Frame> {
    let mut now = START;
    let mut frames = Vec::new();
    while let Some((mut frame, rest)) = frame(bytes, &mut now) {
        frame.number = frames.len() as u64 + 1;
        frames.push(frame);
        bytes = rest;
    }
    frames
}

fn frame<'a>(bytes: &'a [u8], now: &mut i64) -> Option<(Frame, &'a [u8])> {
    let (&control, mut bytes) = bytes.split_first()?;
    let mut time = None;
    if control & 3 != 3 {
        let (&amount, rest) = bytes.split_first()?;
        let unit = [1, 100, -10][usize::from(control & 3)];
        *now = now.saturating_add(i64::from(amount) * unit * MILLISECOND);
        (time, bytes) = (Some(Timestamp(*now)), rest);
    }
    let id = if control & 4 == 0 {
        let (id, rest) = bytes.split_first_chunk()?;
        bytes = rest;
        CanId::from_standard(u16::from_le_bytes(*id))
    } else {
        let (id, rest) = bytes.split_first_chunk()?;
        bytes = rest;
        CanId::from_extended(u32::from_le_bytes(*id))
    };
    let flags = FLAGS.iter().filter(|(bit, _)| control & bit != 0).map(|(_, flag)| *flag);
    let flags = flags.fold(FrameFlags(0), FrameFlags::with);
    let (&length, bytes) = bytes.split_first()?;
    let length = length % if flags.contains(FrameFlags::FD) { 65 } else { 9 };
    let sent = if flags.contains(FrameFlags::REMOTE) { 0 } else { usize::from(length) };
    let (data, bytes) = bytes.split_at_checked(sent)?;
    let mut frame = Frame::data_frame(id, data);
    (frame.flags, frame.length, frame.time) = (flags, length, time);
    frame.bus = BusIndex(control >> 6);
    Some((frame, bytes))
}

/// Encodes frames as closely as the encoding allows; used to create seeds from captures.
pub fn encode(frames: &[Frame]) -> Vec<u8> {
    let mut bytes = vec![1 | 32 << 2];
    let mut last = frames.first().and_then(|frame| frame.time);
    for frame in frames {
        let mut control = frame.bus.0 << 6;
        for (bit, flag) in FLAGS {
            control |= if frame.flags.contains(flag) { bit } else { 0 };
        }
        let step = frame.time.zip(last).map_or(0, |(time, last)| time.since(last) / MILLISECOND);
        last = frame.time;
        let (mode, amount) = match step {
            _ if frame.time.is_none() => (3, None),
            ..0 => (2, Some((step / -10).min(255))),
            0..256 => (0, Some(step)),
            _ => (1, Some((step / 100).min(255))),
        };
        control |= mode | if matches!(frame.id, CanId::Extended(_)) { 4 } else { 0 };
        bytes.push(control);
        bytes.extend(amount.and_then(|amount| u8::try_from(amount).ok()));
        match frame.id {
            CanId::Standard(id) => bytes.extend(id.to_le_bytes()),
            CanId::Extended(id) => bytes.extend(id.to_le_bytes()),
        }
        bytes.push(frame.length);
        bytes.extend(frame.data());
    }
    bytes
}
