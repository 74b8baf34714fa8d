//! Values from the tables of public standards: RV-C by its own evidence, precedence, messages of manufacturers, and a
//! separate reader on captures of other projects.

use std::borrow::Cow;
use std::collections::BTreeSet;
use std::io::Write as _;
use std::process::{Command, Stdio};
use std::sync::Arc;
use std::thread;

use cobscope_decoder::capture::BusNames;
use cobscope_decoder::decoder::Decoder;
use cobscope_decoder::event::{Event, EventKind, SdoOutcome};
use cobscope_decoder::frame::{CanId, Frame, Timestamp};
use cobscope_decoder::profile::dbc::{Database, parse_database};
use cobscope_decoder::profile::{DecodedSignal, DecodedValue};
use cobscope_decoder::session::{Bus, SessionOptions};
use serde_json::{Value, json};

use crate::corpus::decode;
use crate::support;

/// Names of the messages of frames, with the text and origin of their values.
fn messages(options: SessionOptions, frames: &[(u32, [u8; 8])]) -> Vec<(String, Vec<String>, &'static str)> {
    let mut names = BusNames::default();
    names.index_of(b"can0");
    let mut decoder = Decoder::new(options);
    let mut found = Vec::new();
    let mut observer = |event: &Event, _: &Bus| {
        if let EventKind::J1939Message(message) = &event.kind {
            let values = event.decode_signals();
            let values =
                values.map(|it| format!("{} {}", it.name().unwrap_or_default(), it.text())).collect();
            let origin = message.layout.as_deref().map_or("", |layout| layout.origin.name());
            found.push((message.name.as_deref().unwrap_or_default().to_owned(), values, origin));
        }
    };
    for ((id, data), number) in frames.iter().zip(1_i64..) {
        let time = Some(Timestamp(number * 10_000_000));
        let id = CanId::from_extended(*id);
        let frame = Frame { number: number.unsigned_abs(), time, ..Frame::data_frame(id, data) };
        decoder.push(&frame, &names, &mut observer);
    }
    found
}

/// DC source 1: priority 120, F4h × 0.05 = 12.2 V, 0 A (2,000,000,000 × 0.001 - 2,000,000).
const BATTERY: (u32, [u8; 8]) = (0x19FF_FD80, [1, 120, 0xF4, 0, 0x00, 0x94, 0x35, 0x77]);

#[test]
fn rv_c_is_recognised_by_four_of_its_groups() {
    // DC_SOURCE_STATUS_1, DATE_TIME_STATUS, TANK_STATUS and THERMOSTAT_AMBIENT_STATUS: 1FFFD, 1FFFF, 1FFB7, 1FF9C.
    let others = [0x19FF_FF9C, 0x19FF_B772, 0x19FF_9C81].map(|id| (id, [1; 8]));
    let frames = [&[BATTERY, BATTERY][..], &others, &[BATTERY]].concat();
    let found = messages(SessionOptions::default(), &frames);
    // Nothing is known about the bus before the fourth group; the number is that of proprietary groups of NMEA 2000.
    assert_eq!(found[0].2, "");
    let (name, values, origin) = found.last().unwrap();
    assert_eq!((name.as_str(), *origin), ("dc source status 1", "rv-c"));
    assert_eq!(values[2..], ["dc voltage 12.20 V", "dc current 0.000 A"]);
}

#[test]
fn a_bus_of_nmea_2000_is_not_one_of_rv_c() {
    // Vessel heading (1F112) first: the other groups are then fast packets of manufacturers.
    let heading = (0x09F1_1201, [1, 0x09, 0x3D, 0xFF, 0x7F, 0xFF, 0x7F, 0xFD]);
    let others = [0x19FF_FF9C, 0x19FF_B772, 0x19FF_9C81, 0x19FF_FD80].map(|id| (id, [1; 8]));
    let found = messages(SessionOptions::default(), &[&[heading][..], &others, &[BATTERY]].concat());
    assert!(found.iter().all(|(.., origin)| *origin != "rv-c"));
    assert_eq!((found[0].0.as_str(), found[0].2), ("vessel heading", "nmea2000"));
    assert_eq!(found[0].1[1], "Heading 1.5625 rad");
}

#[test]
fn a_database_precedes_the_tables() {
    // EEC1 (F004) of 00: 35F0h × 0.125 = 1726 rpm.
    let frame = (0x0CF0_0400, [0xFF, 0xFF, 0xFF, 0xF0, 0x35, 0xFF, 0xFF, 0xFF]);
    let plain = messages(SessionOptions::default(), &[frame]);
    assert_eq!((plain[0].2, plain[0].1[4].as_str()), ("j1939", "Engine Speed 1726.000 rpm"));
    let text = "BO_ 2364539904 MY_EEC1: 8 N\n SG_ Speed : 24|16@1+ (0.125,0) [0|8031] \"1/min\" N\n";
    let mut database = Database::default();
    database.add_file(parse_database(text.as_bytes()).unwrap());
    let options = SessionOptions { database: Arc::new(database), ..SessionOptions::default() };
    let given = messages(options, &[frame]);
    assert_eq!((given[0].0.as_str(), given[0].2), ("MY_EEC1", "dbc"));
    assert_eq!(given[0].1, ["Speed 1726.000 1/min"]);
}

#[test]
fn messages_of_one_identifier_can_have_several_definitions() {
    // 65305 (FF19) of Simrad (1857, industry 4: 9F41h): byte 3 is the report, 2 or 10.
    let heading = (0x09F1_1201, [0xFF; 8]);
    let frame = |report: u8| (0x18FF_1905, [0x41, 0x9F, 0x00, report, 0x02, 0x00, 0x00, 0xFF]);
    let found = messages(SessionOptions::default(), &[heading, frame(0x02), frame(0x0A), frame(0x02)]);
    let names: Vec<_> = found[1..].iter().map(|(name, ..)| name.as_str()).collect();
    assert_eq!(names, ["Simnet: Device Status", "Simnet: Pilot Mode", "Simnet: Device Status"]);
}

/// Every capture of NMEA 2000 in the corpus.
const CAPTURES: [&str; 8] = [
    "api-examples__00000002.MF4",
    "canboat__actisense-522.candump.log",
    "canboat__can0-1.pcap",
    "canboat__candump-fast-cr.txt",
    "canboat__candump-fast.txt",
    "canboat__candumpSample2.txt",
    "canboat__candumpSample3.txt",
    "canboat__sample3_PCAN-View.trc",
];

/// A message as a line for `tests/oracles/nmea2000_values.py`; `None` without values.
fn message_line(event: &Event) -> Option<String> {
    let (pgn, data) = match &event.kind {
        EventKind::J1939Message(message) => (message.id.pgn, message.payload()),
        EventKind::J1939Transfer(transfer) => {
            (transfer.pgn.filter(|_| transfer.outcome == SdoOutcome::Complete)?, transfer.data.as_slice())
        }
        _ => return None,
    };
    let signals: Vec<_> = event.decode_signals().map(|signal| signal_json(&signal)).collect();
    let line = json!({"pgn": pgn.number(), "data": hex(data), "signals": signals});
    (!signals.is_empty()).then(|| format!("{line}\n"))
}

fn hex(data: &[u8]) -> String {
    data.iter().fold(String::new(), |text, byte| format!("{text}{byte:02X}"))
}

fn signal_json(signal: &DecodedSignal<'_>) -> Value {
    let meaning = signal.field.meaning.as_deref();
    let label = meaning.and_then(|meaning| meaning.description(&signal.value)).map(Cow::into_owned);
    let value = match (signal.scaled_value(), &signal.value) {
        (Some(quantity), _) => json!(quantity),
        (None, _) if !signal.unit().is_empty() && signal.label().is_some() => Value::Null,
        (None, DecodedValue::Unsigned(number)) => json!(number),
        (None, DecodedValue::Integer(number)) => json!(number),
        (None, DecodedValue::Real(number)) => json!(number),
        (None, DecodedValue::Text(text)) => json!(text),
        (None, DecodedValue::Bytes(bytes)) => json!(hex(bytes)),
    };
    json!({"name": signal.name(), "value": value, "label": label})
}

#[test]
fn a_separate_reader_reads_the_same_values() {
    let Some(python) = support::python() else { return support::skip("python", "no Python for oracles") };
    let mut lines = BTreeSet::new();
    for name in CAPTURES {
        let decoder = decode(&format!("nmea2000/{name}"), |event, _| lines.extend(message_line(event)));
        if decoder.is_none() {
            return;
        }
    }
    let script = support::workspace().join("tests/oracles/nmea2000_values.py");
    let command = &mut Command::new(python);
    let mut child = command.arg(script).stdin(Stdio::piped()).stdout(Stdio::piped()).spawn().unwrap();
    let mut input = child.stdin.take().unwrap();
    let writer = thread::spawn(move || lines.iter().all(|line| input.write_all(line.as_bytes()).is_ok()));
    let output = child.wait_with_output().unwrap();
    assert!(output.status.success() && writer.join().unwrap());
    let counts: Value = serde_json::from_slice(&output.stdout).unwrap();
    let expected: Value = serde_json::from_str(include_str!("nmea2000_values.json")).unwrap();
    assert_eq!(counts, expected, "docs/cross-checks.md explains the differences");
}
