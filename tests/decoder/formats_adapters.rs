//! Texts of adapters and other programs: a run report of the CTT compared with a log of the same run, and exports of tshark
//! with the capture that they were made from.

use std::process::Command;

use cobscope_decoder::frame::{CanId, Frame};

use crate::formats_text::{Content, has_corpus, read, read_file};
use crate::support::{corpus, skip};

/// The report, and a log of the same frames by another program, which gave them a time.
const REPORT: &str = "canopen/CANopenDemo__ctt_3.0.3.10_report.md.txt";
const LOG: &str = "canopen/CANopenDemo__ctt_3.0.3.10_run.log";

/// Captures that tshark exports, and whether the bytes alone are read: a cooked header needs the details.
const EXPORTED: &[(&str, bool)] = &[
    ("formats/mdf4-converters__multiple_CAN.pcap", false),
    ("canopen/canopen-message-interpreter__pcan2.pcapng", true),
];

/// Packets of each export.
const MOST_PACKETS: usize = 500;

fn payloads(frames: &[Frame]) -> Vec<(CanId, Vec<u8>)> {
    frames.iter().map(|frame| (frame.id, frame.data().to_vec())).collect()
}

#[test]
fn a_run_report_has_the_frames_of_its_log() {
    if !has_corpus() {
        return;
    }
    let (report, log) = (read_file(&corpus().join(REPORT)), read_file(&corpus().join(LOG)));
    assert_eq!((report.format, report.unreadable()), ("ctt", vec![]));
    assert_eq!(payloads(&report.frames), payloads(&log.frames));
}

/// The text that tshark prints for the first packets of a capture; `None` without tshark.
fn export(name: &str, options: &[&str]) -> Option<Vec<u8>> {
    let mut command = Command::new("tshark");
    command.arg("-r").arg(corpus().join(name)).args(["-c", &MOST_PACKETS.to_string()]).args(options);
    let Ok(output) = command.output() else {
        skip("tshark", "the program is missing");
        return None;
    };
    Some(output.stdout)
}

#[test]
fn exports_of_tshark_have_the_frames_of_their_capture() {
    if !has_corpus() {
        return;
    }
    for (name, has_bytes) in EXPORTED {
        let capture = read_file(&corpus().join(name));
        let expected = &capture.frames[..capture.frames.len().min(MOST_PACKETS)];
        for (options, has_times) in [(&["-V", "-x"][..], true), (&["-x"], false)] {
            if !has_times && !has_bytes {
                continue;
            }
            let Some(text) = export(name, options) else { return };
            let found: Content = read(&text[..]).unwrap();
            assert_eq!((found.format, found.unreadable()), ("tshark", vec![]), "{name} {options:?}");
            assert_eq!(payloads(&found.frames), payloads(expected), "{name} {options:?}");
            let times = |frames: &[Frame]| frames.iter().map(|frame| frame.time).collect::<Vec<_>>();
            if has_times {
                assert_eq!(times(&found.frames), times(expected), "{name}");
            } else {
                assert!(found.frames.iter().all(|frame| frame.time.is_none()), "{name}");
            }
        }
    }
}
