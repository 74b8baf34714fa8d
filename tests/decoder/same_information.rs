//! Values in the text of an event are contained in its JSON object and in its CSV rows.
//!
//! The text is the reference: it is cut into words, and each word must occur in the other formats, as a part
//! of a string or as a number with the decimals of the text. Names of signals are exempt, since the text may
//! contain their short form.

#![expect(clippy::panic, reason = "helpers of tests fail so")]

use std::collections::BTreeSet;
use std::fmt::Write as _;
use std::fs;
use std::io::{self, Write};
use std::path::Path;
use std::sync::{Arc, Mutex};

use cobscope_decoder::capture::{Batch, BatchItem, CaptureReader, ReadOptions};
use cobscope_decoder::decoder::Decoder;
use cobscope_decoder::event::{Event, EventKind, ExchangeOutcome, SdoDirection, SdoOutcome};
use cobscope_decoder::profile::Catalogue;
use cobscope_decoder::profile::dbc::{self, Database};
use cobscope_decoder::session::{Bus, ProtocolChoice, SessionOptions};
use cobscope_decoder::sink::jsonl::JsonlSink;
use cobscope_decoder::sink::text::EventLine;
use cobscope_decoder::sink::{EVENT_FORMATS, EventSink, Output, OutputFiles, SinkOptions, SpoolFile};
use serde_json::Value as Json;

use crate::devices;
use crate::scene::{self, Expected};

/// Output that the test reads while it is written.
#[derive(Clone, Default)]
struct Shared(Arc<Mutex<Vec<u8>>>);

impl Shared {
    fn take(&self) -> String {
        String::from_utf8(std::mem::take(&mut *self.0.lock().unwrap())).unwrap()
    }
}

impl Write for Shared {
    fn write(&mut self, bytes: &[u8]) -> io::Result<usize> {
        self.0.lock().unwrap().extend_from_slice(bytes);
        Ok(bytes.len())
    }

    fn flush(&mut self) -> io::Result<()> {
        Ok(())
    }
}

impl OutputFiles for Shared {
    fn whole_file(&mut self) -> io::Result<Output> {
        Ok(Box::new(self.clone()))
    }

    fn part_file(&mut self, _content: &str) -> io::Result<Output> {
        self.whole_file()
    }

    fn spool_file(&mut self) -> io::Result<Box<dyn SpoolFile>> {
        Err(io::ErrorKind::Unsupported.into())
    }
}

/// Texts and numbers of one event in another format.
#[derive(Default)]
struct Contents {
    texts: String,
    numbers: Vec<f64>,
}

impl Contents {
    fn of_json(line: &str) -> Self {
        let mut contents = Self::default();
        contents.add(&serde_json::from_str(line).unwrap());
        contents
    }

    fn add(&mut self, value: &Json) {
        match value {
            Json::String(text) => self.text(text),
            Json::Number(number) => self.numbers.extend(number.as_f64()),
            Json::Array(list) => list.iter().for_each(|item| self.add(item)),
            Json::Object(members) => members.values().for_each(|member| self.add(member)),
            Json::Null | Json::Bool(_) => {}
        }
    }

    fn text(&mut self, text: &str) {
        self.texts.push(' ');
        self.texts.push_str(text);
        self.numbers.extend(text.parse::<f64>());
    }

    fn of_csv(rows: &str) -> Self {
        let mut contents = Self::default();
        rows.lines().flat_map(|row| row.split(',')).for_each(|cell| contents.text(cell.trim_matches('"')));
        contents
    }

    fn has(&self, word: &str) -> bool {
        let digits = word.split_once('.').map_or(0, |(_, digits)| digits.len());
        let half = 0.5 / 10_f64.powi(i32::try_from(digits).unwrap()) * (1.0 + 1e-6);
        let is_near = |number: f64| self.numbers.iter().any(|other| (number - other).abs() <= half);
        let hex = word.strip_suffix('h').and_then(|digits| u64::from_str_radix(digits, 16).ok());
        #[expect(clippy::cast_precision_loss, reason = "the words of a text have few digits")]
        let is_hex = |number: u64| self.numbers.contains(&(number as f64));
        self.texts.contains(word) || word.parse().is_ok_and(is_near) || hex.is_some_and(is_hex)
    }
}

/// Part of the text that contains values; `None` for events without them.
fn values<'a>(event: &Event, text: &'a str) -> Option<&'a str> {
    /// Words after the value of a transfer.
    const ENDS: [&str; 8] =
        [" ok", " REFUSED", " ABORTED", " NO RESPONSE", " superseded", " unfinished", " NRC", " ("];
    match &event.kind {
        EventKind::J1939Transfer(transfer) => {
            event.decode_signals().next()?;
            // The values follow the bytes, the outcome and the mode.
            text.split_once(&format!("{}: ", transfer.mode?.name())).map(|(_, values)| values)
        }
        EventKind::Pdo(_) | EventKind::J1939Message(_) | EventKind::Frame(_) => {
            event.decode_signals().next()?;
            text.split_once(": ").map(|(_, values)| values)
        }
        EventKind::SdoTransfer(transfer) => {
            let value = text.split_once(" = ")?.1;
            // The previous value is that of an earlier event.
            let value = value.split_once(" → ").map_or(value, |(_, value)| value);
            let end = ENDS.iter().filter_map(|end| value.find(end)).min();
            (transfer.meaning.is_some()).then_some(value.get(..end?)?)
        }
        EventKind::UdsExchange(exchange) => {
            let value = text.split_once(" = ")?.1;
            let end = ENDS.iter().filter_map(|end| value.find(end)).min().unwrap_or(value.len());
            exchange.decoded_value().and_then(|_| value.get(..end))
        }
        EventKind::Emcy(_) if !text.starts_with("empty") && !text.starts_with("0000") => Some(text),
        EventKind::BitsChanged(_) => text.split_once(": ").map(|(_, values)| values),
        EventKind::Mode(_) => text.split_once(" = ").map(|(_, values)| values),
        _ => None,
    }
}

/// Whether CSV has a row for each value of the event.
fn is_in_csv(event: &Event) -> bool {
    match &event.kind {
        EventKind::SdoTransfer(transfer) => {
            transfer.outcome == SdoOutcome::Complete
                && transfer
                    .direction
                    .is_some_and(|way| matches!(way, SdoDirection::Upload | SdoDirection::Download))
                && !transfer.truncated
                && !transfer.cut_start
        }
        EventKind::UdsExchange(exchange) => exchange.outcome == ExchangeOutcome::Positive,
        EventKind::Emcy(_) | EventKind::BitsChanged(_) | EventKind::Mode(_) => false,
        _ => true,
    }
}

/// The text without escaped characters such as `\u{7f}`: the formats escape them in different ways.
fn without_escapes(text: &str) -> String {
    let mut parts = text.split("\\u{");
    let first = parts.next().unwrap_or_default().to_owned();
    let rest = parts.map(|part| part.split_once('}').map_or(part, |(_, rest)| rest));
    rest.fold(first, |text, part| text + " " + part)
}

/// Words of the text that are part of a value, without names of signals and connecting words.
fn words<'a>(event: &'a Event, text: &'a str) -> Vec<&'a str> {
    const CONNECTING: [&str; 14] = [
        "outside",
        "mapping",
        "needs",
        "missing",
        "unused",
        "byte",
        "bytes",
        "of",
        "vendor",
        "active",
        "register",
        "byte-swapped",
        "more",
        "words",
    ];
    let names: BTreeSet<_> = event
        .decode_signals()
        .filter_map(|signal| signal.field.meaning.as_deref())
        .flat_map(|meaning| [meaning.short.as_deref().unwrap_or_default(), meaning.name.as_str()])
        .flat_map(|name| name.split(|c: char| !is_word(c)))
        .collect();
    let text = text.split(" (mapping needs ").next().unwrap_or(text);
    let all = text.split(|c: char| !is_word(c)).map(|word| word.trim_matches('.'));
    let full_scale = |word: &&str| text.contains(&format!(" of {word}"));
    let is_value = |word: &&str| {
        // The channel of a device with several outputs: `c1`.
        let is_channel = word.len() == 2 && word.starts_with('c');
        !(word.is_empty()
            || CONNECTING.contains(word)
            || names.contains(word)
            || full_scale(word)
            || is_channel)
    };
    all.filter(is_value).collect()
}

fn is_word(c: char) -> bool {
    c.is_alphanumeric() || matches!(c, '.' | '-' | '%' | '°' | '/' | '_' | '\'' | 'µ')
}

/// Compares the formats of all events of a capture; returns the number of words.
fn compare(name: &Path, options: SessionOptions, report: &mut String) -> usize {
    // A name can contain dots.
    let bytes = fs::read(format!("{}.log", name.display())).unwrap();
    let mut reader = CaptureReader::open(&bytes[..], &ReadOptions::default()).unwrap();
    let mut decoder = Decoder::new(options);
    let mut batch = Batch::new();
    let mut shared = Shared::default();
    let format = EVENT_FORMATS.iter().find(|format| format.name == "csv").unwrap();
    let mut csv = (format.sink)(&mut shared, &SinkOptions::default()).unwrap();
    let mut count = 0;
    let mut observer = |event: &Event, bus: &Bus| {
        csv.write_event(event, bus);
        let rows = shared.take();
        let text = without_escapes(&EventLine::describe_event(event, bus).what);
        let Some(text) = values(event, &text) else { return };
        let mut line = Vec::new();
        JsonlSink::new(&mut line).write_event(event, bus);
        let json = String::from_utf8(line).unwrap();
        let (in_json, in_csv) = (Contents::of_json(&json), Contents::of_csv(&rows));
        for word in words(event, text) {
            count += 1;
            if !in_json.has(word) {
                let _ = write!(report, "{}: \"{word}\" of \"{text}\" not in {json}", name.display());
            }
            if is_in_csv(event) && !in_csv.has(word) {
                let _ = writeln!(report, "{}: \"{word}\" of \"{text}\" not in {rows}", name.display());
            }
        }
    };
    while reader.read(&mut batch).unwrap() {
        for item in batch.items() {
            match item {
                BatchItem::Frame(frame) => decoder.push(frame, reader.buses(), &mut observer),
                BatchItem::Notice(notice) => decoder.on_notice(notice, reader.buses(), &mut observer),
            }
        }
    }
    decoder.finish_capture(reader.buses(), &mut observer);
    count
}

#[test]
fn json_and_csv_contain_the_values_of_the_text() {
    let mut report = String::new();
    let mut count = 0;
    for name in ["canopen", "j1939", "rules", "rules/clean", "uds"].into_iter().flat_map(scene::captures) {
        count += compare(&name, SessionOptions::default(), &mut report);
    }
    let catalogue = Catalogue::default();
    for name in scene::captures("devices") {
        let expected = Expected::read(&name.with_extension("expected.txt"));
        count += compare(&name, devices::options(&name, &expected, &catalogue), &mut report);
    }
    assert!(report.is_empty(), "{report}");
    assert!(count > 5_000, "{count}");
}

/// A database as a session uses it.
fn with_database(text: &str) -> SessionOptions {
    let file = dbc::parse_database(text.as_bytes()).unwrap_or_else(|problem| panic!("{problem}"));
    assert_eq!(file.problems, []);
    let mut database = Database::default();
    database.add_file(file);
    // 0x100 is TIME on a CANopen bus.
    let protocol = ProtocolChoice::None;
    SessionOptions { database: Arc::new(database), protocol, ..SessionOptions::default() }
}

/// JSON lines and CSV rows of a capture.
fn both(capture: &str, options: SessionOptions) -> (Vec<Json>, Vec<String>) {
    let mut reader = CaptureReader::open(capture.as_bytes(), &ReadOptions::default()).unwrap();
    let mut decoder = Decoder::new(options);
    let mut batch = Batch::new();
    let mut shared = Shared::default();
    let format = EVENT_FORMATS.iter().find(|format| format.name == "csv").unwrap();
    let mut csv = (format.sink)(&mut shared, &SinkOptions::default()).unwrap();
    let mut lines = Vec::new();
    let mut observer = |event: &Event, bus: &Bus| {
        csv.write_event(event, bus);
        let mut line = Vec::new();
        JsonlSink::new(&mut line).write_event(event, bus);
        lines.push(serde_json::from_slice(&line).unwrap());
    };
    while reader.read(&mut batch).unwrap() {
        for frame in batch.frames() {
            decoder.push(frame, reader.buses(), &mut observer);
        }
    }
    decoder.finish_capture(reader.buses(), &mut observer);
    (lines, shared.take().lines().skip(1).map(str::to_owned).collect())
}

/// A label names a value and does not replace it; "not available" has no value (SAE J1939-71 §5.1.4).
#[test]
fn a_labelled_value_keeps_its_number_and_unit() {
    let options = with_database(
        "BO_ 256 Tank: 1 N\n SG_ Level : 0|8@1+ (0.5,0) [0|125] \"%\" N\nVAL_ 256 Level 0 \"Empty\" 250 \"Full\" 255 \"Not available\" ;\n",
    );
    let (lines, rows) =
        both("(1.0) can0 100#00\n(1.1) can0 100#FA\n(1.2) can0 100#FF\n(1.3) can0 100#02\n", options);
    let signals: Vec<_> = lines.iter().filter_map(|line| line["signals"].get(0)).collect();
    let seen: Vec<_> =
        signals.iter().map(|it| (it["value"].as_f64(), it["unit"].as_str(), it["label"].as_str())).collect();
    let unit = Some("%");
    // 250 × 0.5 % = 125 %; 2 × 0.5 % = 1 %.
    let expected = [
        (Some(0.0), unit, Some("Empty")),
        (Some(125.0), unit, Some("Full")),
        (None, unit, Some("Not available")),
        (Some(1.0), unit, None),
    ];
    assert_eq!(seen, expected);
    let ends: Vec<_> = rows.iter().map(|row| row.split_once("Level,").unwrap().1).collect();
    assert_eq!(ends, [",0,%,Empty,0", ",125,%,Full,250", ",,%,Not available,255", ",1,%,,2"]);
}

/// Objects of CiA 301 whose numbers are composed: 1003 (§7.5.2.4), 1010 (§7.5.2.13), 1016 (§7.5.2.19), 1600
/// (figure 70).
#[test]
fn composed_objects_have_a_label() {
    let capture = "(1.0) can0 605#4003100100000000\n(1.1) can0 585#430310011023 0A00\n\
        (1.2) can0 605#4010100100000000\n(1.3) can0 585#4310100101000000\n\
        (1.4) can0 605#23161001F4010500\n(1.5) can0 585#6016100100000000\n\
        (1.6) can0 605#2300160110004060\n(1.7) can0 585#6000160100000000\n\
        (1.8) can0 605#2316100200000600\n(1.9) can0 585#6016100200000000\n\
        (2.0) can0 605#2310100101000000\n(2.1) can0 585#6010100100000000\n"
        .replace("1023 0A00", "10230A00");
    let (lines, rows) = both(&capture, SessionOptions::default());
    let transfers: Vec<_> = lines.iter().filter(|line| line["kind"] == "sdo-transfer").collect();
    let labels: Vec<_> = transfers.iter().map(|it| it["label"].as_str()).collect();
    let expected = [
        // 2310: class 23xx "current, output side" of CiA 301 table 26; 000A is manufacturer-specific.
        transfers[0]["label"].as_str(),
        Some("saves on command"),
        Some("node 5, 500 ms"),
        Some("6040:00/16 bit"),
        // Time 0: the entry is not used.
        Some("unused"),
        // A write is a signature, even if it is not printable.
        None,
    ];
    assert_eq!(labels, expected);
    assert!(labels[0].is_some_and(|text| text.to_lowercase().contains("output")), "{labels:?}");
    assert_eq!(transfers[1]["value"], 1);
    assert_eq!(transfers[2]["value"], 0x0005_01F4);
    assert!(
        rows.iter()
            .any(|row| row.contains(",node/5/sdo-write,") && row.contains(",\"node 5, 500 ms\",328180"))
    );
    assert!(
        rows.iter().any(|row| row.contains(",node/5/sdo-read,") && row.contains(",1,,saves on command,1"))
    );
}
