//! Captures in `fixtures/canopen/` against the events written beside them by hand.
//!
//! The notation is described in `fixtures/README.md`.

use std::collections::BTreeMap;
use std::fmt::Write as _;
use std::fs;
use std::path::{Path, PathBuf};

use cobscope_decoder::capture::{Batch, Item, ReadOptions, Reader};
use cobscope_decoder::decoder::Decoder;
use cobscope_decoder::event::Event;
use cobscope_decoder::query::record::{FieldValue, Fields, visit};
use cobscope_decoder::session::{Bus, SessionOptions};

/// An event as flat keys; nested keys joined by a dot, lists by a comma.
#[derive(Default)]
struct Flat {
    keys: BTreeMap<String, String>,
    path: Vec<&'static str>,
    lists: usize,
}

impl Fields for Flat {
    fn field(&mut self, key: &'static str, value: FieldValue<'_>) {
        let text = match value {
            FieldValue::Null => "null".into(),
            FieldValue::Bool(value) => value.to_string(),
            FieldValue::Unsigned(value) => value.to_string(),
            FieldValue::Integer(value) => value.to_string(),
            FieldValue::Real(value) => value.to_string(),
            FieldValue::Text(text) => text.into(),
            FieldValue::Seconds(value) => cobscope_decoder::frame::Timestamp(value).to_string(),
            FieldValue::Code(value, digits) => format!("0x{value:0width$X}", width = usize::from(digits)),
            FieldValue::Id(id) => format!("0x{id}"),
            FieldValue::Object(object) => format!("0x{object}"),
            FieldValue::Bytes(bytes) => bytes.iter().fold(String::new(), |mut text, byte| {
                write!(text, "{byte:02X}").unwrap();
                text
            }),
        };
        let mut path: Vec<&str> = self.path.iter().copied().filter(|part| !part.is_empty()).collect();
        if !key.is_empty() {
            path.push(key);
        }
        let slot = self.keys.entry(path.join(".")).or_default();
        if self.lists > 0 && !slot.is_empty() {
            slot.push(',');
        }
        slot.push_str(&text);
    }

    fn open(&mut self, key: &'static str) {
        self.path.push(key);
    }

    fn close(&mut self) {
        self.path.pop();
    }

    fn open_list(&mut self, key: &'static str) {
        self.path.push(key);
        self.lists += 1;
    }

    fn close_list(&mut self) {
        self.path.pop();
        self.lists -= 1;
    }
}

/// All events of a capture, flat.
fn events(path: &Path) -> Vec<BTreeMap<String, String>> {
    let bytes = fs::read(path).unwrap();
    let mut reader = Reader::open(&bytes[..], &ReadOptions::default()).unwrap();
    let mut decoder = Decoder::new(SessionOptions::default());
    let mut batch = Batch::new();
    let mut all = Vec::new();
    let mut observer = |event: &Event, bus: &Bus| {
        let mut flat = Flat::default();
        visit(event, bus, None, &mut flat);
        all.push(flat.keys);
    };
    while reader.read(&mut batch).unwrap() {
        for item in batch.items() {
            match item {
                Item::Frame(frame) => decoder.push(frame, reader.buses(), &mut observer),
                Item::Notice(notice) => decoder.notice(notice, reader.buses(), &mut observer),
            }
        }
    }
    decoder.finish(reader.buses(), &mut observer);
    all
}

/// One expected line.
struct Expected {
    frames: String,
    kind: String,
    keys: Vec<(String, String)>,
}

/// The kinds a file speaks of, and its lines.
fn expectations(path: &Path) -> (Vec<String>, Vec<Expected>) {
    let text = fs::read_to_string(path).unwrap();
    let mut lines = text.lines();
    let kinds = lines.next().unwrap().strip_prefix("# kinds:").unwrap();
    let kinds = kinds.split_whitespace().map(str::to_owned).collect();
    let expected = lines.filter(|line| !line.starts_with('#') && !line.trim().is_empty()).map(|line| {
        let mut words = line.split(' ');
        let frames = words.next().unwrap().to_owned();
        let kind = words.next().unwrap().to_owned();
        let keys = words.map(|word| word.split_once('=').unwrap()).map(|(k, v)| (k.to_owned(), v.to_owned()));
        Expected { frames, kind, keys: keys.collect() }
    });
    (kinds, expected.collect())
}

/// The value an event has for an expected key, in the notation's form.
fn actual(event: &BTreeMap<String, String>, key: &str) -> String {
    let get = |key: &str| event.get(key).cloned().unwrap_or_default();
    if key != "signals" {
        return get(key);
    }
    let (ids, raws) = (get("signals.id"), get("signals.raw"));
    ids.split(',').zip(raws.split(',')).map(|(id, raw)| format!("{id}={raw}")).collect::<Vec<_>>().join(",")
}

/// What speaks against `event` being `expected`.
fn difference(event: &BTreeMap<String, String>, expected: &Expected) -> Option<String> {
    if event["kind"] != expected.kind {
        return Some(format!("kind is {}", event["kind"]));
    }
    let frames = match event["frames"].split_once(',').unwrap() {
        (first, last) if first == last => first.to_owned(),
        (first, last) => format!("{first}-{last}"),
    };
    if expected.frames != "-" && frames != expected.frames && last_frame(&expected.frames) != frames {
        return Some(format!("frames are {frames}"));
    }
    let wrong = expected.keys.iter().find(|(key, value)| &actual(event, key) != value)?;
    Some(format!("{} is {}", wrong.0, actual(event, &wrong.0)))
}

/// An event about one frame may name the frames before it too.
fn last_frame(frames: &str) -> &str {
    frames.rsplit('-').next().unwrap()
}

/// Compares in order; events of the same last frame in either order.
fn compare(name: &Path, report: &mut String) {
    let (kinds, expected) = expectations(&name.with_extension("expected.txt"));
    let found: Vec<_> =
        events(&name.with_extension("log")).into_iter().filter(|e| kinds.contains(&e["kind"])).collect();
    let mut open: Vec<_> = found.iter().collect();
    let short = name.file_name().unwrap().to_string_lossy();
    for line in &expected {
        let reach = open.iter().take(2).position(|event| difference(event, line).is_none());
        if let Some(place) = reach {
            open.remove(place);
            continue;
        }
        let (why, event) = match open.first() {
            Some(event) => (difference(event, line).unwrap_or_default(), format!("{event:?}")),
            None => ("no event left".into(), String::new()),
        };
        writeln!(
            report,
            "{short}: expected {} {} {:?}\n  but {why}\n  in {event}",
            line.frames, line.kind, line.keys
        )
        .unwrap();
        return;
    }
    if let Some(event) = open.first() {
        writeln!(report, "{short}: {} events too many, first {event:?}", open.len()).unwrap();
    }
}

#[test]
fn every_capture_gives_the_events_written_beside_it() {
    let folder = Path::new(env!("CARGO_MANIFEST_DIR")).join("../fixtures/canopen");
    let mut names: Vec<PathBuf> = fs::read_dir(folder)
        .unwrap()
        .map(|entry| entry.unwrap().path())
        .filter(|path| path.extension().is_some_and(|extension| extension == "log"))
        .map(|path| path.with_extension(""))
        .collect();
    names.sort();
    assert!(names.len() >= 20);
    let mut report = String::new();
    for name in &names {
        compare(name, &mut report);
    }
    assert!(report.is_empty(), "\n{report}");
}
