//! MDF4 captures of loggers and of python-can, compared with asammdf.

use std::fs;
use std::path::{Path, PathBuf};
use std::process::Command;

#[cfg(feature = "mcap")]
use cobscope_decoder::capture::Notice;
use cobscope_decoder::frame::{FrameFlags, Timestamp};
use cobscope_decoder::words::UNKNOWN_ZONE;
use proptest::prelude::*;

use crate::formats_pcap::{Content, columns, corpus_file, read, read_file};
use crate::harness::reader::holds_its_contract;
use crate::support::{python, skip, workspace};

/// Captures with their number of frames and start time, in ns since 1970.
const CAPTURES: &[(&str, usize, i64)] = &[
    ("j1939/api-examples__00000001-60B621D9.MF4", 1_815, 1_622_547_829_000_000_000),
    ("nmea2000/api-examples__00000002.MF4", 9_600, 0),
    ("uds/api-examples__00000170.MF4", 2_010, 0),
    ("uds/api-examples__00000001.MF4", 5_588, 0),
];

/// Start time of a capture: the first number of its header.
fn start(path: &Path) -> i64 {
    let bytes = fs::read(path).unwrap();
    let links = usize::try_from(u64::from_le_bytes(bytes[80..88].try_into().unwrap())).unwrap();
    i64::from_le_bytes(bytes[88 + 8 * links..][..8].try_into().unwrap())
}

/// Output of the script.
fn oracle(arguments: &[&str]) -> Option<Vec<String>> {
    let Some(python) = python() else {
        skip("python", "no Python with tests/oracles/requirements.txt");
        return None;
    };
    let mut command = Command::new(python);
    let output =
        command.arg(workspace().join("tests/oracles/mdf4_frames.py")).args(arguments).output().unwrap();
    assert!(output.status.success(), "{arguments:?}: {}", String::from_utf8_lossy(&output.stderr));
    Some(String::from_utf8(output.stdout).unwrap().lines().map(str::to_owned).collect())
}

/// Compares frames; times may differ by the resolution of the script, 1 µs.
fn assert_equals(content: &Content, start: i64, theirs: &[String], name: &str) {
    assert_eq!(content.frames.len(), theirs.len(), "{name}");
    for (frame, theirs) in content.frames.iter().zip(theirs) {
        let line = columns(frame, &content.buses);
        let (_, line) = line.split_once('\t').unwrap();
        let (seconds, rest) = theirs.split_once('\t').unwrap();
        let sent = frame.flags.contains(FrameFlags::TRANSMITTED);
        let mut fields: Vec<String> = line.split('\t').map(str::to_owned).collect();
        if sent {
            fields[2] = format!("{}T", fields[2].trim_matches('-'));
        }
        assert_eq!(fields.join("\t"), rest, "{name}: frame {}", frame.number);
        let (whole, micros) = seconds.split_once('.').unwrap();
        let expected = (whole.parse::<i64>().unwrap() * 1_000_000 + micros.parse::<i64>().unwrap()) * 1_000;
        let found = frame.time.unwrap().since(Timestamp(start));
        assert!((found - expected).abs() <= 1_000, "{name}: frame {}: {found} {expected}", frame.number);
    }
}

fn notices(content: &Content) -> Vec<String> {
    content.notices.iter().map(ToString::to_string).collect()
}

#[test]
fn mdf4_captures_of_loggers_have_the_frames_that_are_known() {
    for (name, frames, begins) in CAPTURES {
        let Some(path) = corpus_file(name) else { return };
        let content = read_file(&path);
        assert_eq!((content.format, content.frames.len()), ("mdf4", *frames), "{name}");
        assert_eq!(notices(&content), [""; 0], "{name}");
        assert!(*begins == 0 || *begins == start(&path), "{name}");
    }
}

#[test]
fn mdf4_captures_of_loggers_are_what_asammdf_reads() {
    for (name, ..) in CAPTURES {
        let Some(path) = corpus_file(name) else { return };
        let Some(theirs) = oracle(&["read", path.to_str().unwrap()]) else { return };
        assert_equals(&read_file(&path), start(&path), &theirs, name);
    }
}

fn made(name: &str) -> PathBuf {
    Path::new(env!("CARGO_TARGET_TMPDIR")).join(name)
}

#[test]
fn mdf4_captures_python_can_writes_read_as_they_were_written() {
    for compression in ["0", "1", "2"] {
        if compression != "0" && !cfg!(feature = "gzip") {
            continue;
        }
        let path = made(&format!("written_{compression}.mf4"));
        let Some(theirs) = oracle(&["write", path.to_str().unwrap(), "4000", compression]) else { return };
        let content = read_file(&path);
        assert_eq!(notices(&content), [UNKNOWN_ZONE]);
        assert_equals(&content, start(&path), &theirs, compression);
    }
}

/// MDF 4.3 adds zstd and LZ4 to the compressions of data blocks.
#[cfg(feature = "mcap")]
#[test]
fn mdf4_captures_asammdf_packs_with_zstd_and_lz4_hold_the_same_frames() {
    let plain = made("plain.mf4");
    let Some(theirs) = oracle(&["write", plain.to_str().unwrap(), "600", "0"]) else { return };
    for compression in ["3", "4", "5", "6"] {
        let path = made(&format!("packed_{compression}.mf4"));
        let Some(_) = oracle(&["repack", plain.to_str().unwrap(), path.to_str().unwrap(), compression])
        else {
            return;
        };
        let content = read_file(&path);
        let unreadable = content.notices.iter().filter(|notice| matches!(notice, Notice::Unreadable { .. }));
        assert_eq!(unreadable.count(), 0, "{compression}: {:?}", content.notices);
        assert_equals(&content, start(&path), &theirs, compression);
    }
}

/// MDF 4.2: records in an LD block. Column storage itself cannot be compared: asammdf 8.8 fails when it writes it.
#[test]
fn mdf4_captures_asammdf_writes_with_lists_of_values_hold_the_same_frames() {
    let (plain, listed) = (made("plain_list.mf4"), made("list.mf4"));
    let Some(theirs) = oracle(&["write", plain.to_str().unwrap(), "600", "0"]) else { return };
    let Some(_) = oracle(&["list", plain.to_str().unwrap(), listed.to_str().unwrap()]) else { return };
    let bytes = fs::read(&listed).unwrap();
    assert!(bytes.windows(4).any(|kind| kind == b"##LD"));
    assert_equals(&read_file(&listed), start(&listed), &theirs, "list");
}

fn fixture(name: &str) -> Vec<u8> {
    fs::read(workspace().join("fixtures/recorders").join(name)).unwrap()
}

/// Frames of the script that wrote the fixtures; with `all`, also remote and error frames. Only MDF4 stores
/// whether the recorder sent an error frame.
fn recorded(all: bool, tells_sender: bool) -> Vec<(u32, Vec<u8>)> {
    (0..120_u32)
        .filter(|number| all || number % 8 < 6)
        .map(|number| match (number % 8, number % 3) {
            (7, _) if tells_sender && number % 5 == 0 => (0x88, vec![0, 0, 0x80, 0, 0, 0, 0, 0]),
            (7, _) => (0x88, vec![0; 8]),
            (kind, 0) => (number * 0x12_3457 % (1 << 29), data(number, kind)),
            (kind, _) => (number * 17 % (1 << 11), data(number, kind)),
        })
        .collect()
}

fn data(number: u32, kind: u32) -> Vec<u8> {
    if kind == 6 {
        return Vec::new();
    }
    (0..number % 9).map(|index| u8::try_from((number + index) % 256).unwrap()).collect()
}

fn found(content: &Content) -> Vec<(u32, Vec<u8>)> {
    content.frames.iter().map(|frame| (frame.id.number(), frame.data().to_vec())).collect()
}

#[test]
fn recorders_fixtures_hold_what_was_written() {
    let content = read(&fixture("stored.blf")[..]).unwrap();
    assert_eq!(found(&content), recorded(true, false));
    if cfg!(feature = "gzip") {
        for (name, tells_sender) in [("zlib.blf", false), ("sorted.mf4", true)] {
            let content = read(&fixture(name)[..]).unwrap();
            assert_eq!(found(&content), recorded(true, tells_sender), "{name}");
        }
    }
    let content = read(&fixture("unsorted.mf4")[..]).unwrap();
    assert_eq!(found(&content), recorded(false, false));
    assert_eq!(notices(&content), ["9 records of groups without CAN frames skipped (LIN_Frame)"]);
    let last = content.frames.last().unwrap();
    assert_eq!(last.time, Some(Timestamp(1_700_000_001_828_125_000)), "117 / 64 s");
    assert_eq!(content.buses, ["0", "1"]);
}

/// Replaces the channels with this end of their name by virtual data (channel type 6, no bits) with a linear conversion.
#[cfg(feature = "gzip")]
fn make_virtual(file: &mut Vec<u8>, end: &str, offset: f64, factor: f64) {
    let number = |file: &[u8], at: usize| {
        usize::try_from(u64::from_le_bytes(file[at..at + 8].try_into().unwrap())).unwrap()
    };
    file.resize(file.len().next_multiple_of(8), 0);
    let conversion = file.len() as u64;
    file.extend(b"##CC\0\0\0\0");
    file.extend([24 + 32 + 40_u64, 4].iter().flat_map(|number| number.to_le_bytes()));
    file.extend([0; 32]);
    file.extend([1, 0, 0, 0, 0, 0, 2, 0]);
    file.extend([0.0, 0.0, offset, factor].iter().flat_map(|number| number.to_le_bytes()));
    let mut changed = 0;
    for at in (0..file.len() - 72).filter(|at| at % 8 == 0) {
        if &file[at..at + 4] != b"##CN" {
            continue;
        }
        let name = number(file, at + 24 + 16);
        let text = &file[name + 24..name + number(file, name + 8)];
        if !text.split(|byte| *byte == 0).next().unwrap().ends_with(end.as_bytes()) {
            continue;
        }
        file[at + 24 + 32..at + 24 + 40].copy_from_slice(&conversion.to_le_bytes());
        let data = at + 24 + 8 * number(file, at + 16);
        file[data] = 6;
        file[data + 8..data + 12].fill(0);
        changed += 1;
    }
    assert!(changed > 0, "{end}");
}

/// ASAM MDF 4.1: the value of virtual data is the zero-based record number through the conversion. Recorders write a
/// constant bus and direction in this way.
#[cfg(feature = "gzip")]
#[test]
fn mdf4_virtual_channels_keep_buses_and_directions_apart() {
    let plain = read(&fixture("sorted.mf4")[..]).unwrap();
    let mut file = fixture("sorted.mf4");
    make_virtual(&mut file, ".BusChannel", 3.0, 0.0);
    make_virtual(&mut file, ".Dir", 1.0, 0.0);
    let content = read(&file[..]).unwrap();
    assert_eq!((found(&content).len(), content.buses), (found(&plain).len(), vec!["3".to_owned()]));
    assert!(content.frames.iter().all(|frame| frame.flags.contains(FrameFlags::TRANSMITTED)));
    let mut counted = fixture("sorted.mf4");
    make_virtual(&mut counted, "CAN_DataFrame.BusChannel", 0.0, 1.0);
    let content = read(&counted[..]).unwrap();
    assert!(content.buses.len() > 60, "one bus for each record: {:?}", content.buses.len());
    let limits = content.notices.iter().filter(|notice| notice.to_string().contains("more than 64 channels"));
    assert!(limits.count() > 0, "{:?}", content.notices);
}

/// Number of leading frames that equal those of the whole capture.
fn same(ours: &Content, whole: &Content) -> usize {
    ours.frames.iter().zip(&whole.frames).take_while(|(ours, whole)| ours == whole).count()
}

#[test]
fn an_mdf4_capture_cut_off_anywhere_gives_what_is_whole() {
    let bytes = fixture("unsorted.mf4");
    let whole = read(&bytes[..]).unwrap();
    let data = bytes.len() - whole.frames.len() * 32;
    for length in (8..bytes.len()).rev() {
        let Ok(content) = read(&bytes[..length]) else {
            assert!(length < 64 + 24 + 48, "{length} bytes hold a header");
            continue;
        };
        assert_eq!(same(&content, &whole), content.frames.len(), "{length}");
        assert!(length < data || content.frames.len() + 2 >= (length - data) / 32, "{length}");
    }
}

#[test]
fn an_mdf4_capture_with_a_wrong_bit_keeps_what_is_before() {
    // The data of sorted.mf4 is compressed.
    for name in ["unsorted.mf4", "sorted.mf4"].into_iter().take(if cfg!(feature = "gzip") { 2 } else { 1 }) {
        let bytes = fixture(name);
        let whole = read(&bytes[..]).unwrap();
        let (mut silent, mut changed) = (0, 0);
        for at in (64..bytes.len()).step_by(5) {
            let mut damaged = bytes.clone();
            damaged[at] ^= 1 << (at % 8);
            let Ok(content) = read(&damaged[..]) else { continue };
            if content.frames.len() < whole.frames.len() {
                changed += 1;
                silent += usize::from(content.notices == whole.notices);
            }
        }
        assert!(changed > 0);
        assert_eq!(silent, 0, "{name}: frames are missing and nothing is said");
    }
}

proptest! {
    #![proptest_config(ProptestConfig { cases: 2_000, failure_persistence: None, ..ProptestConfig::default() })]

    #[test]
    fn recorders_captures_with_any_bytes_changed_hold_what_readers_promise(
        name in prop::sample::select(vec!["stored.blf", "zlib.blf", "sorted.mf4", "unsorted.mf4"]),
        edits in prop::collection::vec((any::<prop::sample::Index>(), any::<u8>()), 1..6),
        numbers in prop::collection::vec((any::<prop::sample::Index>(), 0..12_000_u64), 0..3),
        end in any::<prop::sample::Index>(),
    ) {
        let mut bytes = fixture(name);
        for (at, byte) in edits {
            let at = at.index(bytes.len());
            bytes[at] = byte;
        }
        // Links and sizes are aligned to four bytes.
        for (at, number) in numbers {
            let at = at.index(bytes.len() / 4 - 2) * 4;
            bytes[at..at + 8].copy_from_slice(&number.to_le_bytes());
        }
        bytes.truncate(end.index(bytes.len() * 2));
        let format = if name.ends_with("blf") { "blf" } else { "mdf4" };
        holds_its_contract(format, &bytes);
    }
}
