//! candump logs of other projects and our own, compared with python-can frame by frame.

use std::fs;
use std::path::{Path, PathBuf};
use std::process::Command;

use cobscope_decoder::capture::{Batch, CaptureReader, ReadOptions};
use cobscope_decoder::frame::{CanId, Frame, FrameFlags};

use crate::support::{corpus, python, skip, workspace};

const CORPUS: &[&str] = &[
    "canopen/CANopenDemo__ctt_3.0.3.10_run.log",
    "canopen/canopen-lens__sample_cia402.log",
    "canopen/canopen-lens__sample_amr_2wheel.log",
    "formats/SavvyCAN__candump.log",
    "formats/mdf4-converters__multiple_CAN.log",
    "formats/mdf4-converters__multiple_LIN.log",
    "nmea2000/canboat__actisense-522.candump.log",
    "j1939/remora_ctrl_proto__candump-2021-07-21_220402-15-seconds-engine-on-big-truck.log",
];

/// A frame in the format of the oracle, with its time in µs.
fn row(frame: &Frame, buses: &[String]) -> (i64, String) {
    let letters = [
        (matches!(frame.id, CanId::Extended(_)), 'X'),
        (frame.flags.contains(FrameFlags::REMOTE), 'R'),
        (frame.flags.contains(FrameFlags::FD), 'F'),
        (frame.flags.contains(FrameFlags::BIT_RATE_SWITCH), 'B'),
        (frame.flags.contains(FrameFlags::ERROR_STATE), 'S'),
    ];
    let flags: String = letters.iter().filter(|(on, _)| *on).map(|(_, letter)| *letter).collect();
    let data: Vec<String> = frame.data().iter().map(|byte| format!("{byte:02X}")).collect();
    let or_dash = |text: String| if text.is_empty() { "-".to_owned() } else { text };
    let bus = &buses[usize::from(frame.bus.0)];
    let text =
        format!("{bus}\t{}\t{}\t{}\t{}", frame.id, or_dash(flags), frame.length, or_dash(data.concat()));
    (frame.time.unwrap().0 / 1_000, text)
}

fn compare(path: &Path, python: &Path) {
    let script = workspace().join("tests/oracles/frames.py");
    let output = Command::new(python).arg(script).arg(path).output().unwrap();
    assert!(output.status.success(), "{}: {}", path.display(), String::from_utf8_lossy(&output.stderr));
    let theirs = String::from_utf8(output.stdout).unwrap();
    let bytes = fs::read(path).unwrap();
    let mut reader = CaptureReader::open(&bytes[..], &ReadOptions::default()).unwrap();
    let mut batch = Batch::new();
    let mut ours = Vec::new();
    while reader.read(&mut batch).unwrap() {
        // python-can misreads error frames of all classes but one: omitted on both sides.
        let frames = batch.frames().iter().filter(|frame| !frame.flags.contains(FrameFlags::ERROR));
        ours.extend(frames.map(|frame| row(frame, reader.buses().names())));
    }
    let error_ids = ["00000004", "00000008", "00000001", "00000002"];
    let theirs: Vec<&str> = theirs
        .lines()
        .filter(|line| {
            let columns: Vec<&str> = line.split('\t').collect();
            !(columns[3].contains('E')
                || error_ids.contains(&columns[2]) && path.ends_with("canopen-lens__sample_cia402.log"))
        })
        .collect();
    assert_eq!(ours.len(), theirs.len(), "{}", path.display());
    for ((time, ours), theirs) in ours.iter().zip(theirs) {
        let (seconds, theirs) = theirs.split_once('\t').unwrap();
        let (whole, fraction) = seconds.split_once('.').unwrap();
        let micros = whole.parse::<i64>().unwrap() * 1_000_000 + fraction.parse::<i64>().unwrap() / 1_000;
        // The times of python-can are doubles.
        assert!((time - micros).abs() <= 1, "{}: {time} {micros}", path.display());
        assert_eq!(ours, theirs, "{}", path.display());
    }
}

#[test]
fn python_can_reads_the_same_frames_from_candump_logs() {
    let Some(python) = python() else {
        return skip("python", "no Python with tests/oracles/requirements.txt");
    };
    if !corpus().join("README.md").exists() {
        return skip("corpus", "no captures of other projects");
    }
    for name in CORPUS {
        compare(&corpus().join(name), &python);
    }
}

#[test]
fn python_can_reads_the_same_frames_from_our_fixtures() {
    let Some(python) = python() else {
        return skip("python", "no Python with tests/oracles/requirements.txt");
    };
    let folder = workspace().join("fixtures/canopen");
    let paths = fs::read_dir(folder).unwrap().map(|entry| entry.unwrap().path());
    let logs: Vec<PathBuf> = paths.filter(|path| path.extension().is_some_and(|e| e == "log")).collect();
    for path in logs.iter().filter(|path| !path.ends_with("error_frames.log")) {
        compare(path, &python);
    }
}
