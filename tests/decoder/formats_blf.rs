//! BLF captures of other projects and of python-can, compared with python-can and tshark.

#[cfg(feature = "gzip")]
use std::fs;
use std::path::{Path, PathBuf};
use std::process::Command;

#[cfg(feature = "gzip")]
use cobscope_decoder::capture::{CaptureReader, ReadOptions};
use cobscope_decoder::frame::{Frame, FrameFlags};
use cobscope_decoder::words::UNKNOWN_ZONE;

use crate::formats_pcap::{Content, columns, corpus_file, read_file, tshark};
use crate::support::{python, skip, workspace};

/// Captures with their numbers of frames and of error frames.
const CAPTURES: &[(&str, usize, usize)] = &[
    (COMPRESSED, 22, 0),
    (ERRORS, 2, 2),
    ("formats/python-can__test_CanFdMessage.blf", 2, 0),
    ("formats/python-can__test_CanFdMessage64.blf", 2, 0),
    ("formats/python-can__test_CanMessage.blf", 2, 0),
    ("formats/python-can__test_CanMessage2.blf", 2, 0),
];

/// Written by a program of Vector. The other captures are synthetic, with a distinct digit in each field.
const COMPRESSED: &str = "formats/python-can__issue_1905.blf";
const ERRORS: &str = "formats/python-can__test_CanErrorFrameExt.blf";

fn is_readable(name: &str) -> bool {
    cfg!(feature = "gzip") || name != COMPRESSED
}

#[test]
fn blf_captures_of_other_projects_have_the_frames_that_are_known() {
    for (name, frames, errors) in CAPTURES.iter().filter(|(name, ..)| is_readable(name)) {
        let Some(path) = corpus_file(name) else { return };
        let content = read_file(&path);
        assert_eq!((content.format, content.frames.len()), ("blf", *frames), "{name}");
        let found = content.frames.iter().filter(|frame| frame.flags.contains(FrameFlags::ERROR)).count();
        assert_eq!(found, *errors, "{name}");
        let notices: Vec<String> = content.notices.iter().map(ToString::to_string).collect();
        let expected: &[&str] = match *name {
            COMPRESSED => &[UNKNOWN_ZONE],
            _ => &[],
        };
        assert_eq!(notices, expected, "{name}");
    }
}

/// The objects of this file contain 48 of 64 valid bytes; the others are 0, as shown by programs of Vector.
#[cfg(feature = "gzip")]
#[test]
fn a_blf_capture_of_a_program_of_vector() {
    let Some(path) = corpus_file(COMPRESSED) else { return };
    let content = read_file(&path);
    assert_eq!(content.buses, ["7"]);
    let first = columns(&content.frames[0], &content.buses);
    let data = "FF".repeat(48) + &"00".repeat(16);
    assert_eq!(first, format!("1735654183.491113000\t7\t6A9\tFB\t64\t{data}"));
}

fn without_flags(line: &str) -> Vec<String> {
    let fields = line.split('\t').enumerate();
    fields
        .filter(|(index, _)| *index != 3)
        .map(|(_, field)| field.trim_start_matches("CAN-").into())
        .collect()
}

/// Compares with tshark 4.0, which does not mark FD in BLF and decodes error frames as other objects.
fn assert_equals_tshark(content: &Content, theirs: &[String], name: &str) {
    let ours = content.frames.iter().filter(|frame| !frame.flags.contains(FrameFlags::ERROR));
    let theirs: Vec<_> = theirs.iter().filter(|line| line.split('\t').nth(3) != Some("E")).collect();
    assert_eq!(ours.clone().count(), theirs.len(), "{name}");
    for (frame, theirs) in ours.zip(theirs) {
        let (ours, theirs) = (without_flags(&columns(frame, &content.buses)), without_flags(theirs));
        assert_eq!(ours, theirs, "{name}: frame {}", frame.number);
    }
}

/// A capture written by python-can, with its frames; `None` without python-can.
fn written(level: i32, container: usize) -> Option<(PathBuf, Vec<String>)> {
    let Some(python) = python() else {
        skip("python", "no Python with tests/oracles/requirements.txt");
        return None;
    };
    let path = Path::new(env!("CARGO_TARGET_TMPDIR")).join(format!("written_{level}_{container}.blf"));
    let output = Command::new(python)
        .arg(workspace().join("tests/oracles/blf_capture.py"))
        .arg(&path)
        .args(["5000", &level.to_string(), &container.to_string()])
        .output()
        .unwrap();
    assert!(output.status.success(), "{}", String::from_utf8_lossy(&output.stderr));
    Some((path, String::from_utf8(output.stdout).unwrap().lines().map(str::to_owned).collect()))
}

/// Compression levels and container sizes: slightly more than one object (with less, python-can loses the
/// last object), and the usual sizes.
const WRITTEN: &[(i32, usize)] = &[(0, 151), (0, 4_096), (-1, 131_072), (1, 333), (9, 10_000)];

/// A frame in the columns of `blf_capture.py`.
fn with_direction(frame: &Frame, buses: &[String]) -> String {
    let line = columns(frame, buses);
    if !frame.flags.contains(FrameFlags::TRANSMITTED) {
        return line;
    }
    let mut fields: Vec<String> = line.split('\t').map(str::to_owned).collect();
    fields[3] = format!("{}T", fields[3].trim_matches('-'));
    fields.join("\t")
}

#[test]
fn blf_captures_python_can_writes_read_as_they_were_written() {
    for (level, container) in WRITTEN {
        if *level != 0 && !cfg!(feature = "gzip") {
            continue;
        }
        let Some((path, theirs)) = written(*level, *container) else { return };
        let content = read_file(&path);
        let notices: Vec<String> = content.notices.iter().map(ToString::to_string).collect();
        assert_eq!(notices, [UNKNOWN_ZONE]);
        assert_eq!(content.frames.len(), theirs.len());
        for (frame, theirs) in content.frames.iter().zip(&theirs) {
            assert_eq!(&with_direction(frame, &content.buses), theirs, "frame {}", frame.number);
        }
        // Only the usual containers: 4.0 loses objects that span smaller ones.
        if *container == 131_072 {
            let Some(theirs) = tshark(&path, false) else { return };
            assert_equals_tshark(&content, &theirs, &path.display().to_string());
        }
    }
}

/// A change anywhere in a container is reported and does not affect preceding frames.
#[cfg(feature = "gzip")]
#[test]
fn a_damaged_blf_capture_says_so_and_keeps_what_is_before() {
    let Some((path, _)) = written(1, 333) else { return };
    let bytes = fs::read(path).unwrap();
    let bytes = &bytes[..6_000];
    let read = |bytes: &[u8]| crate::formats_pcap::read(bytes).unwrap();
    let whole = read(bytes);
    for at in (144..bytes.len()).step_by(7) {
        let mut damaged = bytes.to_vec();
        damaged[at] ^= 1 << (at % 8);
        let content = read(&damaged);
        // The preceding frame may end in the damaged container.
        let same = content.frames.iter().zip(&whole.frames).take_while(|(ours, whole)| ours == whole).count();
        let expected = frames_before(bytes, at);
        assert!(same >= expected, "bit {} of byte {at}: {same} of {expected} frames", at % 8);
        if content.frames != whole.frames {
            assert!(content.notices.len() >= whole.notices.len(), "byte {at}: nothing is said");
        }
    }
    let mut reader = CaptureReader::open(bytes, &ReadOptions::default()).unwrap();
    assert!(reader.read(&mut cobscope_decoder::capture::Batch::new()).unwrap());
}

/// Number of frames that end before the container at `at`.
#[cfg(feature = "gzip")]
fn frames_before(bytes: &[u8], at: usize) -> usize {
    let begins = (144..=at).rev().find(|start| bytes[*start..].starts_with(b"LOBJ")).unwrap();
    crate::formats_pcap::read(&bytes[..begins]).unwrap().frames.len()
}
