//! Hostile captures of `fixtures/malformed/`.

use std::fs;

use cobscope_decoder::capture::{CaptureReader, MAX_BUSES, ReadOptions, decompress};
use cobscope_decoder::decoder::{Decoder, SHOWN_UNREADABLE};
use cobscope_decoder::session::SessionOptions;
use serde_json::Value;

use crate::harness::observe::Checker;
use crate::harness::pipeline;
use crate::support::workspace;

/// Result of decoding a capture.
#[derive(Debug)]
struct Outcome {
    frames: u64,
    unreadable: u64,
    error: Option<String>,
    events: Vec<Value>,
    written: usize,
    footprint: usize,
}

impl Outcome {
    fn of_kind(&self, kind: &str) -> Vec<&Value> {
        self.events.iter().filter(|event| event["kind"] == kind).collect()
    }
}

/// Decodes bytes to events with all checks of the harness.
fn decode(bytes: &[u8]) -> Result<Outcome, String> {
    let source = decompress(bytes).map_err(|error| error.to_string())?;
    let mut reader =
        CaptureReader::open(source, &ReadOptions::default()).map_err(|error| error.to_string())?;
    let mut decoder = Decoder::new(SessionOptions::default());
    let mut checker = Checker::keeping();
    let error = pipeline::run(&mut reader, &mut decoder, &mut checker);
    let events = checker.kept.iter().flatten().map(|line| serde_json::from_str(line).unwrap());
    Ok(Outcome {
        frames: checker.last_frame,
        unreadable: decoder.unreadable_count(),
        error,
        events: events.collect(),
        written: checker.written,
        footprint: decoder.footprint(),
    })
}

fn decode_file(name: &str) -> Result<Outcome, String> {
    decode(&fs::read(workspace().join("fixtures/malformed").join(name)).unwrap())
}

/// Readable captures: frames, unreadable lines or records, and the error that ends them early.
const READABLE: &[(&str, u64, u64, &str)] = &[
    ("block_4_gib.pcapng", 0, 1, ""),
    ("block_length_0.pcapng", 0, 1, ""),
    ("candump_errors.log", 41, 35, ""),
    ("candump_last_second.log", 16, 0, ""),
    ("device_name_escapes.log", 15, 0, ""),
    ("every_length.log", 86, 0, ""),
    ("header_cut_off.pcap", 0, 0, "expected a header of 24 bytes"),
    ("header_only.pcap", 0, 0, ""),
    ("interface_names.log", 9, 0, ""),
    ("interfaces_70.log", 64, 6, ""),
    ("order_by_no_frame.pcap", 2, 1, ""),
    ("packet_4_gib.pcap", 1, 2, ""),
    ("packet_cut_off.pcap", 1, 1, ""),
    ("packet_without_interface.pcapng", 0, 1, ""),
    ("records_without_bytes.mf4", 0, 7, ""),
    ("sdo_commands.log", 519, 0, ""),
    ("sdo_storm.log", 508, 0, ""),
    ("time_jumps.log", 24, 0, ""),
];

const GZIPPED: &[(&str, u64, u64, &str)] = &[
    ("bomb.log.gz", 2, 1, ""),
    ("cut_off.log.gz", 338, 0, "the file is cut off: incomplete gzip member at byte 1571"),
    ("long_lines.log.gz", 3, 2, ""),
];

/// Captures that cannot be opened, with the error.
const UNREADABLE: &[(&str, &str)] = &[
    ("cut_off.log.zst", "the file is cut off: incomplete zstd frame at byte 1193"),
    ("cut_off_header.log.gz", "the file is cut off: incomplete gzip member at byte 7"),
    ("not_gzip.log.gz", "invalid gzip header"),
    ("not_zstd.log.zst", "Unsupported frame parameter"),
];

/// Whether this build supports the compression of a file name.
fn is_supported(name: &str) -> bool {
    let is_gzip = std::path::Path::new(name).extension().is_some_and(|end| end == "gz");
    let is_zstd = std::path::Path::new(name).extension().is_some_and(|end| end == "zst");
    (cfg!(feature = "gzip") || !is_gzip) && (cfg!(feature = "zstd") || !is_zstd)
}

#[test]
fn what_can_be_read_is_read() {
    for (name, frames, unreadable, end) in READABLE.iter().chain(GZIPPED) {
        if !is_supported(name) {
            continue;
        }
        let outcome = decode_file(name).unwrap_or_else(|error| panic!("{name}: {error}"));
        assert_eq!((outcome.frames, outcome.unreadable), (*frames, *unreadable), "{name}");
        let error = outcome.error.unwrap_or_default();
        assert!(error.ends_with(end) && error.is_empty() == end.is_empty(), "{name}: {error}");
        assert!(outcome.written < 1 << 20, "{name}: {} bytes", outcome.written);
        // 70 buses, each with its own searches for evidence, need the most.
        assert!(outcome.footprint < 552 << 10, "{name}: {} bytes", outcome.footprint);
    }
}

#[test]
fn what_cannot_be_read_says_why() {
    for (name, why) in UNREADABLE {
        let error = decode_file(name).unwrap_err();
        assert!(!is_supported(name) || error.contains(why), "{name}: {error}");
    }
}

#[test]
fn no_file_is_left_out_above() {
    let listed = READABLE.iter().chain(GZIPPED).map(|(name, ..)| *name);
    let mut listed: Vec<_> = listed.chain(UNREADABLE.iter().map(|(name, _)| *name)).collect();
    listed.push("make_malformed.py");
    let readme = fs::read_to_string(workspace().join("fixtures/README.md")).unwrap();
    for entry in fs::read_dir(workspace().join("fixtures/malformed")).unwrap() {
        let name = entry.unwrap().file_name().into_string().unwrap();
        assert!(listed.contains(&name.as_str()), "{name} is not in the tables");
        assert!(readme.contains(&format!("`{name}`")), "{name} is not in fixtures/README.md");
    }
}

/// Each bad line is followed by a good one, which must not be lost.
#[test]
fn the_first_bad_lines_are_shown_and_the_others_counted() {
    let outcome = decode_file("candump_errors.log").unwrap();
    let shown = outcome.of_kind("unreadable");
    assert_eq!(shown.len() as u64, SHOWN_UNREADABLE + 1);
    assert_eq!(shown.last().unwrap()["reason"], format!("{} more, 35 in total", 35 - SHOWN_UNREADABLE));
}

#[test]
fn a_hostile_device_name_arrives_whole_in_json() {
    let outcome = decode_file("device_name_escapes.log").unwrap();
    let transfers = outcome.of_kind("sdo-transfer");
    let name = b"\x1b]0;owned\x07\x1b[2J\r\n::error::x\n\xff\xfe\x9b31m\0end!!!";
    let hex = transfers[0]["data"].as_str().unwrap();
    let bytes = (0..hex.len()).step_by(2).map(|at| u8::from_str_radix(&hex[at..at + 2], 16).unwrap());
    assert_eq!(bytes.collect::<Vec<_>>(), name);
    assert_eq!((transfers.len(), &transfers[0]["outcome"]), (1, &"complete".into()));
}

#[test]
fn interface_names_are_made_text_and_cut() {
    let outcome = decode_file("interface_names.log").unwrap();
    let boot: Vec<_> = outcome.events.iter().filter_map(|event| event["bus"].as_str()).collect();
    assert!(boot.contains(&"\u{FFFD}\u{FFFD}\u{FFFD}"), "{boot:?}");
    assert!(boot.contains(&"::error::pwned") && boot.contains(&"n".repeat(32).as_str()), "{boot:?}");
}

#[cfg(feature = "gzip")]
#[test]
fn the_rest_of_a_line_that_was_cut_is_no_line() {
    let outcome = decode_file("long_lines.log.gz").unwrap();
    let nodes: Vec<_> = outcome.events.iter().filter_map(|event| event["node"].as_u64()).collect();
    assert!(!nodes.is_empty() && nodes.iter().all(|node| *node == 5), "node 6 is in the rest: {nodes:?}");
}

#[test]
fn more_interfaces_than_a_capture_may_have_are_unreadable() {
    let outcome = decode_file("interfaces_70.log").unwrap();
    assert_eq!(outcome.frames, MAX_BUSES as u64);
    let reasons = outcome.of_kind("unreadable");
    assert!(reasons.iter().all(|event| event["reason"] == format!("more than {MAX_BUSES} interfaces")));
}

/// 00000180 is from address 128 to address 1; in the other byte order the destination would be 0.
#[test]
fn what_is_no_frame_proves_no_byte_order() {
    let outcome = decode_file("order_by_no_frame.pcap").unwrap();
    let notes = outcome.of_kind("note");
    assert!(notes.iter().all(|note| !note["text"].as_str().unwrap().contains("order")), "{notes:?}");
    let ends = |event: &Value| (event["source_address"].as_u64(), event["destination_address"].as_u64());
    assert!(outcome.events.iter().any(|event| ends(event) == (Some(128), Some(1))), "{:?}", outcome.events);
}
