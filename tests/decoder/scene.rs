//! Captures and the expected events next to them, in the notation of `fixtures/README.md`.

use std::collections::BTreeMap;
use std::fmt::Write as _;
use std::fs;
use std::path::{Path, PathBuf};

use cobscope_decoder::capture::{Batch, BatchItem, CaptureReader, ReadOptions};
use cobscope_decoder::decoder::Decoder;
use cobscope_decoder::event::{DecodedPdo, Event, EventKind};
use cobscope_decoder::frame::Frame;
use cobscope_decoder::query::record::{FieldConsumer, FieldValue, visit_event};
use cobscope_decoder::session::{Bus, SessionOptions};

/// Keys of an event in the notation.
pub type Keys = BTreeMap<String, String>;

/// An event as flat keys; nested keys joined by a dot, lists by a comma.
#[derive(Default)]
struct Flat {
    keys: Keys,
    path: Vec<&'static str>,
    lists: usize,
}

impl FieldConsumer for Flat {
    fn add_field(&mut self, key: &'static str, value: FieldValue<'_>) {
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

    fn open_group(&mut self, key: &'static str) {
        self.path.push(key);
    }

    fn close_group(&mut self) {
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

/// The formatted values of a PDO: `5001:00=49.4%`, with `?` after values that depend on an assumption.
fn values(pdo: &DecodedPdo) -> String {
    let Some(layout) = &pdo.layout else { return String::new() };
    let values = layout.decode_signals(pdo.payload()).map(|signal| {
        let meaning = signal.field.meaning.as_deref();
        let number = match meaning.and_then(|meaning| Some((meaning, meaning.scaled_value(&signal.value)?))) {
            Some((meaning, scaled)) => format!("{scaled:.*}", usize::from(meaning.decimals)),
            None => match (
                meaning.filter(|it| it.scale.is_some()).and_then(|it| it.value_label(&signal.value)),
                &signal.value,
            ) {
                (Some(special), _) => special.to_owned(),
                (None, value) => value.to_string(),
            },
        };
        let unit = meaning.map_or("", |meaning| meaning.unit.as_str());
        let unit = if number.parse::<f64>().is_ok() { unit } else { "" };
        let assumed = layout.assumed || meaning.is_some_and(|meaning| meaning.assumed);
        let doubt = if assumed { "?" } else { "" };
        format!("{}={number}{unit}{doubt}", signal.field.id)
    });
    values.collect::<Vec<_>>().join(",")
}

/// Raw values of a PDO: `0x2001:00=200`.
fn signals(pdo: &DecodedPdo) -> String {
    let Some(layout) = &pdo.layout else { return String::new() };
    let signals = layout.decode_signals(pdo.payload()).map(|it| format!("0x{}={}", it.field.id, it.raw));
    signals.collect::<Vec<_>>().join(",")
}

/// All keys of an event.
pub fn keys(event: &Event, bus: &Bus) -> Keys {
    let mut flat = Flat::default();
    visit_event(event, bus, None, &mut flat);
    let mut keys = flat.keys;
    if let EventKind::Pdo(pdo) = &event.kind {
        keys.insert("values".into(), values(pdo));
        keys.insert("signals".into(), signals(pdo));
    }
    keys
}

/// All events of a capture from frame `first` on; that frame is number 1.
pub fn events(path: &Path, options: SessionOptions, first: u64) -> Vec<Keys> {
    let bytes = fs::read(path).unwrap();
    let mut reader = CaptureReader::open(&bytes[..], &ReadOptions::default()).unwrap();
    let mut decoder = Decoder::new(options);
    let mut batch = Batch::new();
    let mut all = Vec::new();
    let mut observer = |event: &Event, bus: &Bus| all.push(keys(event, bus));
    while reader.read(&mut batch).unwrap() {
        for item in batch.items() {
            match item {
                BatchItem::Frame(frame) if frame.number >= first => {
                    let frame = Frame { number: frame.number - first + 1, ..*frame };
                    decoder.push(&frame, reader.buses(), &mut observer);
                }
                BatchItem::Frame(_) => {}
                BatchItem::Notice(notice) => decoder.on_notice(notice, reader.buses(), &mut observer),
            }
        }
    }
    decoder.finish_capture(reader.buses(), &mut observer);
    all
}

/// Max printed differences per capture.
const SHOWN: usize = 5;

/// One expected event.
struct Line {
    text: String,
    frames: String,
    kind: String,
    keys: Vec<(String, String)>,
}

/// Contents of a file with expected events.
pub struct Expected {
    kinds: Vec<String>,
    /// Remarks, without their `# `.
    pub remarks: Vec<String>,
    lines: Vec<Line>,
}

impl Expected {
    /// Reads a file in the notation.
    pub fn read(path: &Path) -> Self {
        let text = fs::read_to_string(path).unwrap();
        let mut lines = text.lines();
        let kinds = lines.next().unwrap().strip_prefix("# kinds:").unwrap();
        let kinds = kinds.split_whitespace().map(str::to_owned).collect();
        let (remarks, lines): (Vec<&str>, Vec<&str>) =
            lines.filter(|line| !line.trim().is_empty()).partition(|line| line.starts_with('#'));
        let line = |text: &str| {
            let mut words = text.split(' ');
            let frames = words.next().unwrap().to_owned();
            let kind = words.next().unwrap().to_owned();
            let pairs = words.map(|word| word.split_once('=').unwrap());
            let keys = pairs.map(|(key, value)| (key.to_owned(), value.to_owned())).collect();
            Line { text: text.to_owned(), frames, kind, keys }
        };
        Self {
            kinds,
            remarks: remarks.iter().map(|remark| remark[1..].trim().to_owned()).collect(),
            lines: lines.into_iter().map(line).collect(),
        }
    }

    /// Compares with events in order; events with the same last frame may be in any order.
    pub fn compare(&self, name: &str, events: &[Keys], report: &mut String) {
        let mut open: Vec<_> = events.iter().filter(|event| self.kinds.contains(&event["kind"])).collect();
        let mut wrong = Vec::new();
        for line in &self.lines {
            // Events before the line were not expected.
            while let Some(first) = open.first().filter(|first| is_before(first, line)) {
                wrong.push(format!("not expected: {first:?}"));
                open.remove(0);
            }
            let alike =
                open.first().map_or(0, |first| open.iter().take_while(|it| last(it) == last(first)).count());
            let reach = alike.max(2).min(open.len());
            if let Some(place) = open[..reach].iter().position(|event| difference(event, line).is_none()) {
                open.remove(place);
                continue;
            }
            let near = (0..reach).min_by_key(|place| unlike(open[*place], line));
            let why = near.map_or("no event is left".into(), |place| {
                let event = open[place];
                let why = format!("{}\n  in {event:?}", difference(event, line).unwrap_or_default());
                if is_meant(event, line) {
                    open.remove(place);
                }
                why
            });
            wrong.push(format!("expected {}\n  but {why}", line.text));
        }
        wrong.extend(open.iter().map(|event| format!("not expected: {event:?}")));
        for difference in wrong.iter().take(SHOWN) {
            writeln!(report, "{name}: {difference}").unwrap();
        }
        if wrong.len() > SHOWN {
            writeln!(report, "{name}: {} differences in all", wrong.len()).unwrap();
        }
    }
}

/// Whether a line refers to an event, although a key differs.
fn is_meant(event: &Keys, line: &Line) -> bool {
    event["kind"] == line.kind && line.frames.rsplit('-').next() == Some(last(event))
}

/// Whether the last frame of an event is before that of a line.
fn is_before(event: &Keys, line: &Line) -> bool {
    let frame = line.frames.rsplit('-').next().unwrap().parse::<u64>();
    frame.is_ok_and(|frame| last(event).parse::<u64>().unwrap() < frame) && event["frames"] != "0,0"
}

fn last(event: &Keys) -> &str {
    event["frames"].rsplit(',').next().unwrap()
}

/// Distance between an event and a line, to find the most similar one.
fn unlike(event: &Keys, line: &Line) -> (bool, usize) {
    let wrong = line.keys.iter().filter(|(key, value)| !same(key, value, &actual(event, key)));
    (event["kind"] != line.kind, wrong.count())
}

/// The first difference between an event and a line.
fn difference(event: &Keys, line: &Line) -> Option<String> {
    if event["kind"] != line.kind {
        return Some(format!("kind is {}", event["kind"]));
    }
    let frames = match event["frames"].split_once(',').unwrap() {
        (first, last) if first == last => first.to_owned(),
        (first, last) => format!("{first}-{last}"),
    };
    // An event with one expected frame may also contain preceding frames.
    let last_frame = line.frames.rsplit('-').next().unwrap();
    if line.frames != "-" && frames != line.frames && last_frame != frames {
        return Some(format!("frames are {frames}"));
    }
    let wrong = line.keys.iter().find(|(key, value)| !same(key, value, &actual(event, key)))?;
    Some(format!("{} is {}", wrong.0, actual(event, &wrong.0)))
}

/// Value of an event for an expected key; spaces are written `_`.
fn actual(event: &Keys, key: &str) -> String {
    event.get(key).map(|value| value.replace(' ', "_")).unwrap_or_default()
}

/// Whether a value equals the expected one; numbers are compared to half of the last digit.
fn same(key: &str, expected: &str, found: &str) -> bool {
    let is_unknown = matches!(key, "effective" | "persists") && found.is_empty() && expected == "unknown";
    if expected == found || is_unknown {
        return true;
    }
    if !matches!(key, "value" | "duration" | "latency") {
        return false;
    }
    let (Ok(wanted), Ok(is)) = (expected.parse::<f64>(), found.parse::<f64>()) else { return false };
    let digits = expected.split_once('.').map_or(0, |(_, digits)| digits.len());
    let half = 0.5 / 10_f64.powi(i32::try_from(digits).unwrap());
    (wanted - is).abs() <= half * (1.0 + 1e-6)
}

/// Captures of a folder of `fixtures/` with the suffix `.log`, without that suffix.
pub fn captures(folder: &str) -> Vec<PathBuf> {
    let folder = crate::support::workspace().join("fixtures").join(folder);
    let all = fs::read_dir(folder).unwrap().map(|entry| entry.unwrap().path());
    let logs = all.filter(|path| path.extension().is_some_and(|extension| extension == "log"));
    let mut names: Vec<PathBuf> = logs.map(|path| path.with_extension("")).collect();
    names.sort();
    names
}
