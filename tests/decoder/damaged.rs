//! Every format, truncated and damaged: the reader returns all frames before the damage, invents none, and
//! its notices have a position.

use std::fs;
use std::io::{self, Write};
use std::sync::{Arc, Mutex};

use cobscope_decoder::capture::{
    CaptureCompression, CapturePlace, FORMATS, Notice, ReadOptions, WRITABLE, WriteOptions,
};
use cobscope_decoder::frame::{CanId, Frame, FrameFlags, Timestamp};

use crate::formats_foreign::SEVERAL_FRAMES;
use crate::harness::reader::{Content, format, holds_its_contract, parse};
use crate::support::workspace;

/// Max tested positions per capture, because the tests are slow.
const PLACES: usize = 150;

/// Bytes written so far.
#[derive(Clone, Default)]
pub(crate) struct Shared(pub(crate) Arc<Mutex<Vec<u8>>>);

impl Write for Shared {
    fn write(&mut self, bytes: &[u8]) -> io::Result<usize> {
        self.0.lock().unwrap().write(bytes)
    }

    fn flush(&mut self) -> io::Result<()> {
        Ok(())
    }
}

/// A capture written by this program.
fn written(name: &str, packing: CaptureCompression) -> Vec<u8> {
    let format = WRITABLE.iter().find(|format| format.name == name).unwrap();
    let output = Shared::default();
    let mut writer =
        (format.writer)(Box::new(output.clone()), &WriteOptions { packing, ..WriteOptions::default() });
    for number in 0..30_u8 {
        let frame = Frame::data_frame(CanId::from_standard(0x180 + u16::from(number)), &[number; 4]);
        let time = Some(Timestamp(1_700_000_000_000_000_000 + i64::from(number) * 1_000_000));
        writer.write(&Frame { time, flags: FrameFlags::RECEIVED, ..frame }, "can0").unwrap();
        if number % 10 == 9 {
            writer.flush().unwrap();
        }
    }
    writer.finish().unwrap();
    output.0.lock().unwrap().clone()
}

/// pcap with nanoseconds, little-endian, LINKTYPE_CAN_SOCKETCAN.
fn pcap() -> Vec<u8> {
    let mut bytes = b"\x4D\x3C\xB2\xA1\x02\0\x04\0\0\0\0\0\0\0\0\0\xFF\xFF\0\0\xE3\0\0\0".to_vec();
    for number in 0..30_u32 {
        for word in [1_700_000_000, number * 1_000_000, 16, 16] {
            bytes.extend_from_slice(&u32::to_le_bytes(word));
        }
        bytes.extend_from_slice(&(0x180 + number).to_be_bytes());
        bytes.extend_from_slice(&[4, 0, 0, 0, 1, 2, 3, number.to_le_bytes()[0], 0, 0, 0, 0]);
    }
    bytes
}

/// The synthetic capture of a format.
fn sample(format: &str) -> Option<Vec<u8>> {
    let inputs = fs::read_dir(workspace().join("fixtures/fuzz").join(format)).unwrap();
    let mut paths = inputs.map(|entry| entry.unwrap().path());
    let path = paths.find(|path| path.file_stem().is_some_and(|stem| stem == "sample"))?;
    Some(fs::read(path).unwrap())
}

fn fixture(name: &str) -> Vec<u8> {
    fs::read(workspace().join("fixtures").join(name)).unwrap()
}

/// Name and bytes of a capture in each format.
fn captures() -> Vec<(&'static str, Vec<u8>)> {
    let mut captures = vec![
        ("pcap", pcap()),
        ("blf", fixture("recorders/stored.blf")),
        ("mdf4", fixture("recorders/unsorted.mf4")),
        ("csv", fixture("fuzz/csv/python-can.csv")),
        ("candump", fixture("dialects/candump_ta.txt")),
        ("asc", fixture("dialects/log2asc.asc")),
    ];
    captures
        .extend(WRITABLE.iter().map(|format| (format.name, written(format.name, CaptureCompression::None))));
    captures.extend(FORMATS.iter().filter_map(|format| Some((format.name, sample(format.name)?))));
    captures
}

/// Compressed captures: damage loses all data of the same block.
fn packed() -> Vec<(&'static str, Vec<u8>)> {
    let mut captures = Vec::new();
    if cfg!(feature = "gzip") {
        captures.push(("blf", fixture("recorders/zlib.blf")));
        captures.push(("mdf4", fixture("recorders/sorted.mf4")));
    }
    if cfg!(feature = "mcap") {
        captures.push(("mcap", written("mcap", CaptureCompression::Zstd)));
        captures.push(("mcap", written("mcap", CaptureCompression::Lz4)));
    }
    captures
}

fn content(name: &str, bytes: &[u8]) -> Content {
    let content = parse(&mut *(format(name).parser)(&ReadOptions::default()), bytes, || usize::MAX);
    for (_, notice) in &content.notices {
        if let Notice::Unreadable { place, reason } | Notice::CutOff { place, reason } = notice {
            let is_line = matches!(place, CapturePlace::Line(line) if *line > 0);
            // Links of MDF4 may refer to positions after the end of the file.
            let within = |at: u64| name == "mdf4" || at <= bytes.len() as u64;
            let is_offset = matches!(place, CapturePlace::Offset(at) if within(*at));
            assert!(if format(name).is_text { is_line } else { is_offset }, "{name}: {place}: {reason}");
            assert!(!reason.is_empty() && reason.len() < 400, "{name}: {reason}");
        }
    }
    content
}

/// Whether damage is reported; an assumption counts only for an unfinished file.
fn is_reported(content: &Content) -> bool {
    let is_remark = |notice: &Notice| match notice {
        Notice::Assumption(text) => text.contains("not finished"),
        _ => true,
    };
    content.error.is_some() || content.notices.iter().any(|(_, notice)| is_remark(notice))
}

/// Whether a notice reports that the capture ends inside a record.
fn is_cut_off(content: &Content) -> bool {
    content.notices.iter().any(|(_, notice)| matches!(notice, Notice::CutOff { .. }))
}

/// About [`PLACES`] positions of a capture; all positions of a small one.
fn places(bytes: &[u8]) -> impl Iterator<Item = usize> {
    (1..bytes.len()).step_by(bytes.len() / PLACES + 1)
}

/// Maximum number of frames of a line.
fn frames_of_line(name: &str) -> usize {
    if SEVERAL_FRAMES.contains(&name) { 32 } else { 1 }
}

fn same(ours: &[Frame], whole: &[Frame]) -> usize {
    ours.iter().zip(whole).take_while(|(ours, whole)| ours == whole).count()
}

/// Whether `frames` is a subsequence of `whole`.
fn is_within(frames: &[Frame], whole: &[Frame]) -> bool {
    let mut whole = whole.iter();
    frames.iter().all(|frame| whole.any(|other| Frame { number: frame.number, ..*other } == *frame))
}

#[test]
fn there_is_a_capture_of_every_format() {
    let captures = captures();
    // The sample of MCAP is written by this program.
    for format in FORMATS.iter().filter(|format| format.name != "mcap" || cfg!(feature = "mcap")) {
        assert!(captures.iter().any(|(name, _)| *name == format.name), "{}", format.name);
    }
    for (name, bytes) in captures {
        let content = content(name, &bytes);
        assert!(content.frames.len() > 2, "{name}");
        assert_eq!((content.error, (format(name).detect)(&bytes)), (None, true), "{name}");
    }
}

#[test]
fn a_capture_cut_off_anywhere_gives_all_before_the_cut_and_nothing_else() {
    for (name, bytes) in captures().into_iter().chain(packed()) {
        let (whole, is_text) = (content(name, &bytes), format(name).is_text);
        let (mut before, mut silent) = (0, 0);
        for cut in places(&bytes) {
            let part = content(name, &bytes[..cut]);
            // A part of the lines may be too few to infer columns.
            if name == "columns" && part.frames.is_empty() {
                continue;
            }
            if name == "mdf4" {
                // Groups of MDF4 are merged by time, so frames of a damaged group are missing in between.
                assert!(is_within(&part.frames, &whole.frames), "{name}: {cut} bytes");
                before = part.frames.len();
                silent += usize::from(before < whole.frames.len() && !is_reported(&part));
                continue;
            }
            let same = same(&part.frames, &whole.frames);
            // A truncated line may be a shorter frame.
            let is_last_line = is_text && part.frames.len() - same <= frames_of_line(name);
            assert!(same == part.frames.len() || is_last_line, "{name}: {cut} bytes");
            assert!(same >= before, "{name}: {cut} bytes: {same} frames, {before} of fewer");
            if is_text {
                // Complete lines are read as in the whole capture.
                let lines = bytes[..cut]
                    .iter()
                    .rposition(|byte| matches!(byte, b'\n' | b'\r'))
                    .map_or(0, |end| end + 1);
                let lines = content(name, &bytes[..lines]).frames.len();
                assert!(
                    same >= lines.min(whole.frames.len()) && same <= lines + frames_of_line(name),
                    "{name}: {cut} bytes"
                );
            }
            silent += usize::from(part.frames.len() < whole.frames.len() && !is_reported(&part));
            before = same;
        }
        // In MDF4, other blocks may depend on the last one.
        let is_all = name == "mdf4" || before + 1 >= whole.frames.len();
        assert!(is_all, "{name}: {before} of {} frames", whole.frames.len());
        // A capture may end between two records, but not inside one.
        assert!(
            is_text || silent <= whole.frames.len() + 3,
            "{name}: {silent} cuts of which nothing is said"
        );
    }
}

#[test]
fn a_capture_that_ends_inside_its_last_record_says_so_and_a_whole_one_does_not() {
    for (name, bytes) in captures().into_iter().chain(packed()) {
        assert!(!is_cut_off(&content(name, &bytes)), "{name}");
        // The last line of text needs no line end; MCAP has a magic after its last record.
        let missing = if name == "mcap" { 12 } else { 3 };
        let cut = content(name, &bytes[..bytes.len() - missing]);
        assert_eq!(is_cut_off(&cut), !format(name).is_text, "{name}: {:?}", cut.notices);
    }
}

#[test]
fn bytes_changed_anywhere_cost_nothing_before_them() {
    for (name, bytes) in captures() {
        // MDF4 has a separate test: its header contains the order of the groups. A damaged line may leave too few to
        // infer columns.
        if ["mdf4", "columns"].contains(&name) {
            continue;
        }
        let whole = content(name, &bytes);
        for at in places(&bytes) {
            let before = content(name, &bytes[..at]);
            // The start of a file determines the format, and the preceding frame may extend to this position.
            let kept = same(&before.frames, &whole.frames).saturating_sub(frames_of_line(name));
            if kept == 0 {
                continue;
            }
            for change in [1 << (at % 8), 0xFF, b'\n'] {
                let mut damaged = bytes.clone();
                damaged[at] ^= change;
                let found = content(name, &damaged);
                let found = same(&found.frames, &whole.frames);
                let size = bytes.len();
                assert!(
                    found >= kept,
                    "{name}: byte {at} of {size} ^ {change:#04X}: {found} of {kept} frames"
                );
            }
        }
    }
}

#[test]
fn lengths_that_lie_anywhere_end_and_cost_nothing_before_them() {
    for (name, bytes) in captures() {
        if format(name).is_text {
            continue;
        }
        let whole = content(name, &bytes);
        for at in places(&bytes) {
            let kept = same(&content(name, &bytes[..at]).frames, &whole.frames).saturating_sub(1);
            for (size, lie) in [(2, 0xFF), (4, 0xFF), (8, 0xFF), (8, 0x7F), (4, 0)] {
                let mut lying = bytes.clone();
                let end = (at + size).min(lying.len());
                lying[at..end].fill(lie);
                let found = content(name, &lying);
                assert!(found.frames.len() <= bytes.len(), "{name}: byte {at}");
                assert!(found.notices.len() <= bytes.len(), "{name}: byte {at}");
                if name != "mdf4" {
                    let found = same(&found.frames, &whole.frames);
                    assert!(
                        found >= kept,
                        "{name}: {size} bytes {lie:02X} at {at}: {found} of {kept} frames"
                    );
                }
            }
        }
    }
}

#[test]
fn any_reader_holds_its_contract_on_any_capture_that_is_damaged() {
    for (name, bytes) in captures().into_iter().chain(packed()) {
        for at in places(&bytes).step_by(7) {
            let mut damaged = bytes.clone();
            damaged[at] ^= 1 << (at % 8);
            holds_its_contract(name, &damaged[..damaged.len() - at % 5]);
        }
    }
}
