//! Compares captures in `fixtures/uds/` with the hand-written events next to them.
//!
//! The notation is described in `fixtures/README.md`.

use std::fmt::Write as _;
use std::fs;
use std::path::Path;
use std::process::Command;

use cobscope_decoder::bus_file::BusFile;
use cobscope_decoder::capture::{Batch, BatchItem, CaptureReader, ReadOptions, decompress};
use cobscope_decoder::decoder::Decoder;
use cobscope_decoder::event::{Event, EventKind, MessageOutcome, UdsExchange};
use cobscope_decoder::profile::Catalogue;
use cobscope_decoder::session::{Bus, SessionOptions};

use crate::devices::options;
use crate::scene::{Expected, captures, events};
use crate::support;

#[test]
fn every_capture_of_uds_gives_the_events_written_beside_it() {
    let catalogue = Catalogue::default();
    let names = captures("uds");
    assert!(names.len() >= 8);
    let mut report = String::new();
    for name in &names {
        let expected = Expected::read(&name.with_extension("expected.txt"));
        let found = events(&name.with_extension("log"), options(name, &expected, &catalogue), 1);
        expected.compare(&name.file_name().unwrap().to_string_lossy(), &found, &mut report);
    }
    assert!(report.is_empty(), "\n{report}");
}

/// Complete messages of a capture in the format of `uds_tshark.py`, and its exchanges.
fn decode(path: &Path, bus_file: &str) -> (Vec<String>, Vec<UdsExchange>) {
    let bytes = fs::read(path).unwrap();
    let mut reader = CaptureReader::open(decompress(&bytes[..]).unwrap(), &ReadOptions::default()).unwrap();
    let bus_file = BusFile::parse(bus_file).unwrap();
    let mut decoder = Decoder::new(SessionOptions { bus_file, ..SessionOptions::default() });
    let (mut messages, mut exchanges) = (Vec::new(), Vec::new());
    let mut see = |event: &Event, _: &Bus| match &event.kind {
        EventKind::IsoTpTransfer(message) if message.outcome == MessageOutcome::Complete => {
            let mut line = format!("{} {:X} ", event.frames.last, message.id.number());
            message.data.iter().for_each(|byte| write!(line, "{byte:02X}").unwrap());
            messages.push(line);
        }
        EventKind::UdsExchange(exchange) => exchanges.push((**exchange).clone()),
        _ => {}
    };
    let mut batch = Batch::new();
    while reader.read(&mut batch).unwrap() {
        for item in batch.items() {
            if let BatchItem::Frame(frame) = item {
                decoder.push(frame, reader.buses(), &mut see);
            }
        }
    }
    decoder.finish_capture(reader.buses(), &mut see);
    (messages, exchanges)
}

/// Messages reassembled by tshark for the identifiers in `ids`, all if empty; `None` if it is missing.
fn tshark(path: &Path, swap: bool, ids: &[&str]) -> Option<Vec<String>> {
    if Command::new("tshark").arg("-v").output().is_err() {
        support::skip("tshark", "the program is missing");
        return None;
    }
    let python = support::python().unwrap_or_else(|| "python3".into());
    if Command::new(&python).arg("--version").output().is_err() {
        support::skip("python", "the program is missing");
        return None;
    }
    let mut command = Command::new(python);
    command.arg(support::workspace().join("tests/oracles/uds_tshark.py"));
    if swap {
        command.arg("--swap");
    }
    let output = command.arg(path).output().unwrap();
    assert!(output.status.success(), "{}: {}", path.display(), String::from_utf8_lossy(&output.stderr));
    let lines = String::from_utf8(output.stdout).unwrap();
    let is_meant = |line: &&str| ids.is_empty() || ids.contains(&line.split(' ').nth(1).unwrap());
    Some(lines.lines().filter(is_meant).map(str::to_owned).collect())
}

/// tshark 4.0 mixes messages of several senders, so only captures with one sender are compared.
#[test]
fn messages_are_those_tshark_puts_together() {
    for name in ["single", "segmented"] {
        let path = support::workspace().join("fixtures/uds").join(name).with_extension("log");
        let Some(theirs) = tshark(&path, false, &[]) else { return };
        assert_eq!(decode(&path, "").0, theirs, "{name}");
    }
}

/// A flashing session with 58 messages by tshark (README of the corpus).
#[cfg(feature = "gzip")]
#[test]
fn a_recorded_flashing_session() {
    let path = support::corpus().join("uds/scapy__ecu_trace.pcap.gz");
    if !path.exists() {
        return support::skip("corpus", &format!("{} is not there", path.display()));
    }
    let bus_file = "[[uds]]\nrequest = 0x710\nresponse = 0x77A\nfunctional = 0x700\n\
                    [[uds]]\nrequest = 0x713\nresponse = 0x77D\nfunctional = 0x700\n";
    let (messages, exchanges) = decode(&path, bus_file);
    assert_eq!(messages.len(), 58);
    if let Some(theirs) = tshark(&path, false, &[]) {
        assert_eq!(messages, theirs);
    }
    // Each block of the download is confirmed by its number (ISO 14229-1 §14.5).
    let blocks = exchanges.iter().filter(|exchange| exchange.service == 0x36);
    for block in blocks {
        let (request, response) = (block.request.as_ref().unwrap(), block.response.as_ref().unwrap());
        assert_eq!(request.data[1], response.data[1]);
    }
}

/// A scan of one server; the identifiers of the capture have the reverse byte order.
#[cfg(feature = "gzip")]
#[test]
fn a_recorded_scan() {
    let path = support::corpus().join("uds/scapy__candump_uds_scanner.pcap.gz");
    if !path.exists() {
        return support::skip("corpus", &format!("{} is not there", path.display()));
    }
    let (messages, exchanges) = decode(&path, "[[uds]]\nrequest = 0x641\nresponse = 0x651\n");
    assert!(messages.len() > 5_000);
    if let Some(theirs) = tshark(&path, true, &["641", "651"]) {
        assert_eq!(messages, theirs);
    }
    assert!(exchanges.len() > 2_600);
    // The server responds to each request of the scan separately: no response belongs to another request.
    let mixed = exchanges.iter().filter(|exchange| {
        let (Some(request), Some(response)) = (&exchange.request, &exchange.response) else { return false };
        request.frames.last > response.frames.first
    });
    assert_eq!(mixed.count(), 0);
}
