//! Both sides of limits: `fixtures/rules/limits/*.toml` has a scenario within and a scenario beyond each limit that
//! a rule judges, a finding prints, the session decides by or a comparison permits. The keys are described in the README there.

#![expect(clippy::panic, reason = "a test that cannot go on has failed")]

use std::fmt::Write as _;
use std::fs;
use std::sync::Arc;

use cobscope_decoder::capture::{Batch, BatchItem, CaptureReader, ReadOptions};
use cobscope_decoder::comparison::{
    BehaviourRecorder, CaptureEnding, CaptureRecord, Observation, compare_captures,
};
use cobscope_decoder::decoder::Decoder;
use cobscope_decoder::event::Event;
use cobscope_decoder::query::Filter;
use cobscope_decoder::reading::{Reading, Summary, diagnosis_of};
use cobscope_decoder::session::Bus;
use serde::Deserialize;

use crate::mutator::{Line, apply, text};
use crate::rules::{Annotated, judge, parse};
use crate::support::workspace;

#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
struct LimitTable {
    limit: Vec<Limit>,
}

#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
struct Limit {
    /// The limit with its source.
    of: String,
    /// Rule or expectation that fires beyond the limit only.
    #[serde(default)]
    rule: String,
    /// Filter that matches an event beyond the limit only.
    #[serde(default)]
    event: String,
    /// Kind of difference to a first capture, which has the steps of `good`, beyond the limit only.
    #[serde(default)]
    difference: String,
    #[serde(default)]
    good: Vec<String>,
    /// Text of the finding beyond the limit.
    #[serde(default)]
    text: String,
    /// Text of a finding of the rule within the limit, if it fires there too.
    #[serde(default)]
    otherwise: String,
    /// Options and bus file lines.
    #[serde(default)]
    lines: Vec<String>,
    /// First frame, at 0 s.
    #[serde(default = "heartbeat")]
    first: String,
    /// Time in ms up to which the first frame is repeated every 100 ms.
    #[serde(default)]
    until: i64,
    /// Operators of the mutator, applied on both sides.
    #[serde(default)]
    before: Vec<String>,
    silent: Vec<String>,
    fires: Vec<String>,
}

/// Heartbeat of node 5, operational.
fn heartbeat() -> String {
    "705#05".into()
}

/// Texts of the findings of a rule.
fn finding_texts(limit: &Limit, capture: Annotated) -> Vec<String> {
    let (_, findings) = judge(&capture.frames, &capture.options, capture.setup);
    let known = findings.rules.iter().any(|rule| *rule.name == limit.rule);
    assert!(known, "{}: unknown rule {}", limit.of, limit.rule);
    let own = findings.groups.iter().filter(|group| *group.rule == limit.rule);
    own.map(|group| group.text.clone()).collect()
}

/// Number of events that match the filter of a limit.
fn event_count(limit: &Limit, capture: Annotated) -> usize {
    let filter: Filter = limit.event.parse().unwrap_or_else(|error| panic!("{}: {error}", limit.of));
    let mut reader = CaptureReader::open(capture.frames.as_bytes(), &ReadOptions::default()).unwrap();
    let mut decoder = Decoder::new(capture.options);
    let (mut batch, mut count) = (Batch::new(), 0);
    let mut observer =
        |event: &Event, bus: &Bus| count += usize::from(filter.matches_event(event, bus, None));
    while reader.read(&mut batch).unwrap() {
        for item in batch.items() {
            if let BatchItem::Frame(frame) = item {
                decoder.push(frame, reader.buses(), &mut observer);
            }
        }
    }
    decoder.finish_capture(reader.buses(), &mut observer);
    count
}

/// What `cobscope diff` compares of a capture.
fn record(capture: Annotated) -> CaptureRecord {
    let setup = Some(Arc::new(capture.setup));
    let mut reading = Reading::of_options(capture.options, setup, BehaviourRecorder::new(None));
    reading.run(capture.frames.as_bytes()).unwrap();
    let Summary { findings, part: recorder, decoder, first } = reading.finish();
    let counting = findings.groups.iter().filter(|group| group.is_reported());
    let diagnosis = diagnosis_of(&findings, counting, first.and_then(|first| first.time));
    recorder.finish_record(&CaptureEnding {
        name: "",
        buses: decoder.buses(),
        findings: &findings,
        diagnosis: &diagnosis,
    })
}

/// Differences of one kind to the first capture: both values.
fn difference_texts(limit: &Limit, capture: Annotated) -> Vec<String> {
    let tolerances = capture.options.bus_file.diff;
    let (good, bad) = (record(scenario(limit, &limit.good)), record(capture));
    let compared = compare_captures(&good, &bad, &tolerances);
    let own = compared.differences.iter().filter(|it| it.kind.name() == limit.difference);
    let text = |it: &Option<Observation>| it.as_ref().map_or_else(|| "-".into(), |value| value.text.clone());
    own.map(|it| format!("{} → {}", text(&it.good), text(&it.bad))).collect()
}

/// Capture of one side: the first frame with its repetitions, then the operators.
fn scenario(limit: &Limit, steps: &[String]) -> Annotated {
    let (id, body) = limit.first.split_once('#').unwrap();
    let line = |time: i64| Line {
        time: (1_700_000_000_000 + time) * 1_000,
        bus: "can0".into(),
        id: id.into(),
        body: body.into(),
    };
    let mut frames: Vec<_> = (0..=limit.until / 100).map(|number| line(number * 100)).collect();
    limit.before.iter().chain(steps).for_each(|step| apply(step, &mut frames));
    let lines: String = limit.lines.iter().flat_map(|line| [line.as_str(), "\n"]).collect();
    parse(&limit.of, &format!("{lines}{}", text(&frames)))
}

/// Checks one side; `wanted` is the text of a finding that is required, if it is known.
fn check(limit: &Limit, steps: &[String], (is_found, wanted): (bool, &str), report: &mut String) {
    let capture = scenario(limit, steps);
    let side = if steps == limit.fires { "beyond" } else { "within" };
    if !limit.event.is_empty() {
        let count = event_count(limit, capture);
        if is_found != (count > 0) {
            writeln!(report, "{side} {}: {count} events match {}", limit.of, limit.event).unwrap();
        }
        return;
    }
    let is_finding = limit.difference.is_empty();
    let texts = if is_finding { finding_texts(limit, capture) } else { difference_texts(limit, capture) };
    let is_there =
        if wanted.is_empty() { !texts.is_empty() } else { texts.iter().any(|text| text == wanted) };
    if is_found != is_there {
        writeln!(report, "{side} {}: {}{}: {texts:?}", limit.of, limit.rule, limit.difference).unwrap();
    }
}

/// Checks the tables of one file.
fn check_file(name: &str) {
    let path = workspace().join("fixtures/rules/limits").join(name);
    let table: LimitTable = toml::from_str(&fs::read_to_string(&path).unwrap())
        .unwrap_or_else(|error| panic!("{}: {error}", path.display()));
    let mut report = String::new();
    for limit in &table.limit {
        check(limit, &limit.silent, (!limit.otherwise.is_empty(), &limit.otherwise), &mut report);
        check(limit, &limit.fires, (true, &limit.text), &mut report);
    }
    assert!(report.is_empty(), "\n{report}");
}

/// One test per file of the folder.
macro_rules! files {
    ($($name:ident)*) => {
        $(#[test]
        fn $name() {
            check_file(concat!(stringify!($name), ".toml"));
        })*

        #[test]
        fn each_file_has_a_test() {
            let folder = workspace().join("fixtures/rules/limits");
            let names = fs::read_dir(folder).unwrap().map(|entry| entry.unwrap().file_name().into_string().unwrap());
            let mut files: Vec<_> = names.filter_map(|name| Some(name.strip_suffix(".toml")?.to_owned())).collect();
            files.sort();
            assert_eq!(files, [$(stringify!($name)),*]);
        }
    };
}

files! { bus comparison error_control expectations j1939 nmt pdo sdo }
