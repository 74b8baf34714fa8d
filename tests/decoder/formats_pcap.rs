//! pcap and pcapng: captures of other projects and synthetic ones compared with tshark, and damaged ones.

#![expect(clippy::disallowed_methods, reason = "the rule is for the decoder, not for what tests it")]
#![expect(clippy::unwrap_used, clippy::indexing_slicing, reason = "helpers of tests fail so")]
#![expect(clippy::cast_possible_truncation, clippy::cast_possible_wrap, reason = "made-up numbers are small")]

use std::fmt::Write as _;
use std::fs::{self, File};
use std::io::{BufReader, Read};
use std::path::{Path, PathBuf};
use std::process::Command;
use std::sync::LazyLock;
use std::time::Duration;

use cobscope_decoder::capture::{Batch, CaptureError, CaptureReader, Notice, ReadOptions, decompress};
use cobscope_decoder::frame::{CanId, Frame, FrameFlags};
use pcap_file::pcap::{PcapHeader, PcapTsResolution, PcapWriter, RawPcapPacket};
use pcap_file::pcapng::PcapNgWriter;
use pcap_file::pcapng::blocks::enhanced_packet::EnhancedPacketBlock;
use pcap_file::pcapng::blocks::interface_description::{
    InterfaceDescriptionBlock, InterfaceDescriptionOption, InterfaceTsResolution,
};
use pcap_file::{DataLink, Endianness};
use proptest::prelude::*;

use crate::support::{corpus, is_readable, python, skip, workspace};

/// Captures with their number of frames.
const CAPTURES: &[(&str, usize)] = &[
    (TRACE_AS_PACKETS, 6_968),
    ("nmea2000/canboat__can0-1.pcap", 49_928),
    ("uds/scapy__ecu_trace.pcap.gz", 141),
    (REVERSED, 9_434),
    ("uds/scapy__canfd.pcap.gz", 4),
    (CONVERTED, 164),
];

/// Also exists as a PEAK trace with the same frames.
const TRACE_AS_PACKETS: &str = "canopen/canopen-message-interpreter__pcan2.pcapng";
const TRACE: &str = "canopen/canopen-message-interpreter__pcan2.trc";
/// Has little-endian identifiers, which link type 227 does not permit.
const REVERSED: &str = "uds/scapy__candump_uds_scanner.pcap.gz";
/// Also exists as candump text with the same traffic.
const CONVERTED: &str = "formats/mdf4-converters__multiple_CAN.pcap";
const SAME_AS_TEXT: &str = "formats/mdf4-converters__multiple_CAN.log";

#[derive(Debug, Default, PartialEq)]
pub struct Content {
    pub format: &'static str,
    pub frames: Vec<Frame>,
    pub notices: Vec<Notice>,
    pub buses: Vec<String>,
}

pub fn read(source: impl Read) -> Result<Content, CaptureError> {
    let mut reader = CaptureReader::open(source, &ReadOptions::default())?;
    let (mut batch, mut content) =
        (Batch::new(), Content { format: reader.format().name, ..Content::default() });
    while reader.read(&mut batch)? {
        content.frames.extend(batch.frames());
        content.notices.extend(batch.notices().iter().map(|(_, notice)| notice.clone()));
    }
    content.buses = reader.buses().names().to_vec();
    Ok(content)
}

pub fn read_file(path: &Path) -> Content {
    read(decompress(BufReader::new(File::open(path).unwrap())).unwrap()).unwrap()
}

pub fn corpus_file(name: &str) -> Option<PathBuf> {
    let path = corpus().join(name);
    if !path.exists() {
        skip("corpus", &format!("{} is missing", path.display()));
        return None;
    }
    Some(path)
}

/// A frame in the columns of `frames_tshark.py`.
pub fn columns(frame: &Frame, buses: &[String]) -> String {
    let is = |flag| frame.flags.contains(flag);
    let is_extended = matches!(frame.id, CanId::Extended(_));
    let letters: String = [
        ('X', is_extended && !is(FrameFlags::ERROR)),
        ('R', is(FrameFlags::REMOTE)),
        ('E', is(FrameFlags::ERROR)),
        ('F', is(FrameFlags::FD)),
        ('B', is(FrameFlags::BIT_RATE_SWITCH)),
        ('S', is(FrameFlags::ERROR_STATE)),
    ]
    .iter()
    .filter_map(|(letter, is_set)| is_set.then_some(*letter))
    .collect();
    let mut data = String::new();
    for byte in frame.data() {
        write!(data, "{byte:02X}").unwrap();
    }
    let or_none = |text: String| if text.is_empty() { "-".into() } else { text };
    let bus = &buses[usize::from(frame.bus.0)];
    let time = frame.time.unwrap();
    format!("{time}\t{bus}\t{}\t{}\t{}\t{}", frame.id, or_none(letters), frame.length, or_none(data))
}

/// Frames as decoded by tshark; `None` if it is missing.
pub fn tshark(path: &Path, swap_identifiers: bool) -> Option<Vec<String>> {
    if Command::new("tshark").arg("-v").output().is_err() {
        skip("tshark", "the program is missing");
        return None;
    }
    let python = python().unwrap_or_else(|| "python3".into());
    if Command::new(&python).arg("--version").output().is_err() {
        skip("python", "the program is missing");
        return None;
    }
    let mut command = Command::new(python);
    command.arg(workspace().join("tests/oracles/frames_tshark.py")).arg(path);
    if swap_identifiers {
        let program = Path::new(env!("CARGO_TARGET_TMPDIR")).join("tshark-swapped");
        fs::write(&program, "#!/bin/sh\nexec tshark -o can.byte_swap:TRUE \"$@\"\n").unwrap();
        let made = Command::new("chmod").arg("+x").arg(&program).status().unwrap();
        assert!(made.success());
        command.env("TSHARK", program);
    }
    // tshark reads the dates of BLF as local time.
    let output = command.env("TZ", "UTC").output().unwrap();
    assert!(output.status.success(), "{}: {}", path.display(), String::from_utf8_lossy(&output.stderr));
    Some(String::from_utf8(output.stdout).unwrap().lines().map(str::to_owned).collect())
}

/// Compares with tshark, which prints no bus name if the capture has none.
fn assert_equals_tshark(path: &Path, content: &Content, theirs: &[String]) {
    assert_eq!(content.frames.len(), theirs.len(), "{}", path.display());
    for (frame, theirs) in content.frames.iter().zip(theirs) {
        let ours = columns(frame, &content.buses);
        let bus = theirs.split('\t').nth(1).unwrap();
        let (time, rest) = ours.split_once('\t').unwrap();
        let ours = match bus {
            "-" => format!("{time}\t-\t{}", rest.split_once('\t').unwrap().1),
            _ => ours,
        };
        // The oracle reads the class of an error frame from the packet, without knowing its byte order.
        let class = (frame.id.number() | 0x2000_0000).swap_bytes() & 0x1FFF_FFFF;
        let swapped = ours.replace(&frame.id.to_string(), &format!("{class:08X}"));
        if frame.flags.contains(FrameFlags::ERROR) && *theirs == swapped {
            continue;
        }
        assert_eq!(&ours, theirs, "{}: frame {}", path.display(), frame.number);
    }
}

#[test]
fn captures_of_other_projects_have_the_frames_that_are_known() {
    for (name, frames) in CAPTURES.iter().filter(|(name, _)| is_readable(name)) {
        let Some(path) = corpus_file(name) else { return };
        let content = read_file(&path);
        assert_eq!(content.frames.len(), *frames, "{name}");
        let notices: Vec<String> = content.notices.iter().map(ToString::to_string).collect();
        if *name == REVERSED {
            assert_eq!(notices.len(), 1, "{notices:?}");
            assert!(notices[0].contains("little-endian"), "{notices:?}");
        } else {
            assert_eq!(notices, [] as [&str; 0], "{name}");
        }
    }
}

#[test]
fn captures_of_other_projects_are_what_tshark_reads() {
    for (name, _) in CAPTURES.iter().filter(|(name, _)| is_readable(name)) {
        let Some(path) = corpus_file(name) else { return };
        let Some(theirs) = tshark(&path, *name == REVERSED) else { return };
        assert_equals_tshark(&path, &read_file(&path), &theirs);
    }
}

#[test]
fn a_converted_capture_is_its_text() {
    let (Some(packets), Some(text)) = (corpus_file(CONVERTED), corpus_file(SAME_AS_TEXT)) else { return };
    let (packets, text) = (read_file(&packets), read_file(&text));
    assert_eq!((packets.format, text.format), ("pcapng", "candump"));
    assert_eq!(packets.buses, ["CAN 1", "CAN 2"]);
    assert_eq!(packets.frames.len(), text.frames.len());
    for (packet, line) in packets.frames.iter().zip(&text.frames) {
        assert!(packet.time.unwrap().since(line.time.unwrap()).abs() < 1_000, "{packet:?} {line:?}");
        let same = Frame { time: line.time, flags: line.flags, ..*packet };
        assert_eq!(same, *line);
        let direction = FrameFlags::TRANSMITTED.with(FrameFlags::RECEIVED).0;
        assert_eq!(packet.flags.0 & !direction, line.flags.0 & !direction, "{packet:?} {line:?}");
    }
}

#[test]
fn a_trace_in_packets_is_the_trace() {
    let (Some(packets), Some(trace)) = (corpus_file(TRACE_AS_PACKETS), corpus_file(TRACE)) else { return };
    let (packets, trace) = (read_file(&packets), read_file(&trace));
    assert_eq!(packets.frames.len(), trace.frames.len());
    for (packet, line) in packets.frames.iter().zip(&trace.frames) {
        assert_eq!((packet.id, packet.data()), (line.id, line.data()), "{packet:?} {line:?}");
    }
}

/// A frame as stored in a packet, with a big-endian identifier, and its expected decoding.
fn sample(number: u32) -> (Vec<u8>, bool, Frame) {
    let noise = number.wrapping_mul(2_654_435_761);
    let [_, _, a, b] = noise.to_be_bytes();
    let kind = number % 7;
    let is_fd = kind >= 5;
    let extended = noise & 0x100 != 0;
    let length = if is_fd { [0, 3, 8, 12, 20, 48, 64][usize::from(a) % 7] } else { usize::from(a) % 9 };
    let mut frame = Frame::EMPTY;
    frame.id = if extended {
        CanId::from_extended(noise >> 3)
    } else {
        CanId::from_standard(u16::from_be_bytes([a, b]))
    };
    let mut word = frame.id.number() | if extended { 0x8000_0000 } else { 0 };
    let mut bits = 0;
    frame.set_data(&vec![b; length]);
    match kind {
        3 => {
            word |= 0x4000_0000;
            frame.flags = FrameFlags::REMOTE;
        }
        4 => {
            word = 0x2000_0000 | (noise & 0x1FF);
            frame.id = CanId::from_extended(noise & 0x1FF);
            frame.flags = FrameFlags::ERROR;
            frame.set_data(&[b; 8]);
        }
        5 => {
            bits = 0x05;
            frame.flags = FrameFlags::FD.with(FrameFlags::BIT_RATE_SWITCH);
        }
        6 => {
            bits = 0x06;
            frame.flags = FrameFlags::FD.with(FrameFlags::ERROR_STATE);
        }
        _ => {}
    }
    let mut packet = word.to_be_bytes().to_vec();
    packet.extend([frame.length, bits, 0, 0]);
    packet.extend(&frame.bytes[..usize::from(frame.length)]);
    packet.resize(if is_fd { 72 } else { 16 }, 0);
    (packet, is_fd, frame)
}

/// The packet of a link type; after cooked headers the identifier has the byte order of the capture.
fn packet(link: DataLink, endianness: Endianness, number: u32) -> (Vec<u8>, Frame) {
    let (mut can, is_fd, mut frame) = sample(number);
    if link != DataLink::CAN_SOCKETCAN && endianness.is_little() {
        can[..4].reverse();
    }
    let protocol = if is_fd { 0x0D } else { 0x0C };
    let outgoing = if number.is_multiple_of(3) { 4 } else { 1 };
    let mut packet = match link {
        DataLink::LINUX_SLL => vec![0, outgoing, 1, 0x18, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0, protocol],
        DataLink::LINUX_SLL2 => {
            vec![0, protocol, 0, 0, 0, 0, 0, 5, 1, 0x18, outgoing, 0, 0, 0, 0, 0, 0, 0, 0, 0]
        }
        _ => Vec::new(),
    };
    if !packet.is_empty() && outgoing == 4 {
        frame.flags = frame.flags.with(FrameFlags::TRANSMITTED);
    }
    packet.extend(can);
    (packet, frame)
}

const LINKS: [DataLink; 3] = [DataLink::CAN_SOCKETCAN, DataLink::LINUX_SLL, DataLink::LINUX_SLL2];
const SAMPLES: u32 = 700;
const START: u64 = 1_700_000_000;

/// Name, bytes, and frames with their times in nanoseconds.
type MadeUp = (String, Vec<u8>, Vec<(i64, Frame)>);

/// A capture from another writer, and its frames with their times in nanoseconds.
fn classic(
    link: DataLink,
    endianness: Endianness,
    resolution: PcapTsResolution,
) -> (Vec<u8>, Vec<(i64, Frame)>) {
    let header =
        PcapHeader { datalink: link, endianness, ts_resolution: resolution, ..PcapHeader::default() };
    let mut writer = PcapWriter::with_header(Vec::new(), header).unwrap();
    let mut frames = Vec::new();
    for number in 0..SAMPLES {
        let (data, frame) = packet(link, endianness, number);
        let (seconds, micros) = (START as u32 + number / 10, number * 997);
        let is_nano = resolution == PcapTsResolution::NanoSecond;
        let (fraction, worth) = if is_nano { (micros * 1_000 + number, 1) } else { (micros, 1_000) };
        let length = data.len() as u32;
        let raw = RawPcapPacket {
            ts_sec: seconds,
            ts_frac: fraction,
            incl_len: length,
            orig_len: length,
            data: data.into(),
        };
        writer.write_raw_packet(&raw).unwrap();
        frames.push((i64::from(seconds) * 1_000_000_000 + i64::from(fraction) * worth, frame));
    }
    (writer.into_inner(), frames)
}

/// A pcapng capture with all link types, each with its own name and resolution.
fn next_generation(endianness: Endianness) -> (Vec<u8>, Vec<(i64, Frame)>) {
    let mut writer = PcapNgWriter::with_endianness(Vec::new(), endianness).unwrap();
    let resolutions =
        [InterfaceTsResolution::MICRO, InterfaceTsResolution::NANO, InterfaceTsResolution::MILLI];
    for ((link, resolution), name) in LINKS.into_iter().zip(resolutions).zip(["bus one", "any", "two"]) {
        let mut block = InterfaceDescriptionBlock::new(link, 0);
        block.options.push(InterfaceDescriptionOption::IfName(name.into()));
        block.options.push(InterfaceDescriptionOption::IfTsResol(resolution));
        writer.write_pcapng_block(block).unwrap();
    }
    let mut frames = Vec::new();
    for number in 0..SAMPLES {
        let interface = number % 3;
        let (data, frame) = packet(LINKS[interface as usize], endianness, number);
        let nanoseconds = START * 1_000_000_000 + u64::from(number) * 1_000_000_000;
        let block = EnhancedPacketBlock {
            interface_id: interface,
            timestamp: Duration::from_nanos(nanoseconds),
            original_len: data.len() as u32,
            data: data.into(),
            options: Vec::new(),
        };
        writer.write_pcapng_block(block).unwrap();
        frames.push((nanoseconds as i64, frame));
    }
    (writer.into_inner(), frames)
}

fn made_up() -> Vec<MadeUp> {
    let mut captures = Vec::new();
    for endianness in [Endianness::Big, Endianness::Little] {
        for resolution in [PcapTsResolution::MicroSecond, PcapTsResolution::NanoSecond] {
            for link in LINKS {
                let (bytes, frames) = classic(link, endianness, resolution);
                captures.push((format!("{endianness:?}-{resolution:?}-{link:?}.pcap"), bytes, frames));
            }
        }
        let (bytes, frames) = next_generation(endianness);
        captures.push((format!("{endianness:?}.pcapng"), bytes, frames));
    }
    captures
}

#[test]
fn captures_of_another_writer_give_what_was_written() {
    for (name, bytes, expected) in MADE_UP.iter() {
        let content = read(&bytes[..]).unwrap();
        assert_eq!(content.notices, [], "{name}");
        assert_eq!(content.frames.len(), expected.len(), "{name}");
        for (frame, (time, expected)) in content.frames.iter().zip(expected) {
            let expected = Frame { number: frame.number, time: frame.time, bus: frame.bus, ..*expected };
            assert_eq!((frame.time.unwrap().0, *frame), (*time, expected), "{name}");
        }
        let buses: &[&str] = match &name[..] {
            name if name.ends_with("pcapng") => &["bus one", "any", "two"],
            name if name.contains("SLL2") => &["if5"],
            _ => &["can0"],
        };
        assert_eq!(content.buses, buses, "{name}");
    }
}

#[test]
fn captures_of_another_writer_are_what_tshark_reads() {
    for (name, bytes, _) in MADE_UP.iter() {
        let path = Path::new(env!("CARGO_TARGET_TMPDIR")).join(name);
        fs::write(&path, bytes).unwrap();
        let Some(theirs) = tshark(&path, false) else { return };
        assert_equals_tshark(&path, &read(&bytes[..]).unwrap(), &theirs);
    }
}

static MADE_UP: LazyLock<Vec<MadeUp>> = LazyLock::new(made_up);

/// A reader that returns a few bytes at a time.
struct Dripping<'a>(&'a [u8], usize);

impl Read for Dripping<'_> {
    fn read(&mut self, room: &mut [u8]) -> std::io::Result<usize> {
        let count = self.1.min(self.0.len()).min(room.len());
        room[..count].copy_from_slice(&self.0[..count]);
        self.0 = &self.0[count..];
        Ok(count)
    }
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(64))]

    #[test]
    fn damaged_captures_are_read_alike_in_pieces_of_any_size(
        which in 0usize..14,
        damage in proptest::collection::vec((12usize..20_000, any::<u8>()), 0..20),
        cut in 30usize..40_000,
        size in 1usize..5_000,
    ) {
        let mut bytes = MADE_UP[which].1.clone();
        for (at, byte) in damage {
            if let Some(target) = bytes.get_mut(at) {
                *target = byte;
            }
        }
        bytes.truncate(cut);
        let whole = read(&bytes[..]);
        let pieces = read(Dripping(&bytes, size));
        prop_assert_eq!(whole.map_err(|error| error.to_string()), pieces.map_err(|error| error.to_string()));
    }
}
