//! Holes: the timestamps of clean captures are shifted after a frame. A gap that all periodic messages share is one
//! statement about the capture, and no finding.

use std::fmt::Write as _;
use std::fs;
use std::sync::Arc;

use cobscope_decoder::Reading;
use cobscope_decoder::capture::{Batch, CaptureReader, Notice, ReadOptions};
use cobscope_decoder::event::{Event, EventKind};
use cobscope_decoder::finding::{CaptureFindings, FindingGroup};
use cobscope_decoder::frame::BusIndex;
use cobscope_decoder::session::{Bus, SessionOptions};
use proptest::prelude::*;

use crate::mutator::{Line, lines, text};
use crate::rules::{Annotated, judge, parse, plain_setup};
use crate::support::workspace;

/// Frames of a clean capture, with its options.
fn clean(name: &str) -> (Vec<Line>, String) {
    let all = fs::read_to_string(workspace().join("fixtures/rules/clean").join(name)).unwrap();
    let options = all.lines().filter(|line| line.starts_with("#!") || line.starts_with("#|"));
    (lines(&all), options.flat_map(|line| [line, "\n"]).collect())
}

/// Longest interval before frame `at`, in µs.
fn longest(frames: &[Line], at: usize) -> i64 {
    frames[..at].windows(2).map(|pair| pair[1].time - pair[0].time).max().unwrap_or(0)
}

/// Findings of the capture with all timestamps from frame `at` on shifted by `delay` µs.
fn shifted(name: &str, at: usize, delay: i64) -> CaptureFindings {
    let (mut frames, options) = clean(name);
    for line in &mut frames[at..] {
        line.time += delay;
    }
    judged(name, &frames, &options)
}

fn judged(name: &str, frames: &[Line], options: &str) -> CaptureFindings {
    let Annotated { frames, options, setup, .. } = parse(name, &format!("{options}{}", text(frames)));
    judge(&frames, &options, setup).1
}

fn rules(findings: &CaptureFindings) -> String {
    findings.groups.iter().fold(String::new(), |mut all, group| {
        writeln!(all, "{} {:?}", group.rule, group.key.node).unwrap();
        all
    })
}

fn statements(findings: &CaptureFindings) -> Vec<&String> {
    findings.quality.iter().filter(|note| note.starts_with("no frame for")).collect()
}

/// Heartbeats of node 5 every 100 ms, its producer time being read; from the 20th on one hour later.
fn heartbeats() -> String {
    let mut log =
        "(1700000000.000000) can0 605#4017100000000000\n(1700000000.001000) can0 585#4B17100064000000\n"
            .to_owned();
    for number in 1..40 {
        let hour = if number < 20 { 0 } else { 3_600 };
        let (second, tenth) = (1_700_000_000 + hour + number / 10, number % 10);
        writeln!(log, "({second}.{tenth}00{:03}) can0 705#05", number * 7 % 90).unwrap();
    }
    log
}

/// Findings of the heartbeats, and the steps of the clock; with the notice of a live source that the clock was set.
fn judged_live(is_noticed: bool) -> (Vec<String>, Vec<i64>) {
    let log = heartbeats();
    let mut reader = CaptureReader::open(log.as_bytes(), &ReadOptions::default()).unwrap();
    let mut batch = Batch::new();
    let mut steps = Vec::new();
    let mut last = None;
    let add_step = |event: &Event, _: &Bus| {
        if let EventKind::ClockStep { step } = event.kind {
            steps.push(step);
        }
    };
    let setup = Some(Arc::new(plain_setup()));
    let mut reading = Reading::of_options(SessionOptions::default(), setup, add_step);
    while reader.read(&mut batch).unwrap() {
        reading.set_buses(reader.buses().clone());
        for frame in batch.frames() {
            let time = frame.time.unwrap();
            let step = last.map_or(0, |last| time.since(last));
            if is_noticed && step > 3_000_000_000_000 {
                reading.notice(&Notice::ClockSet { bus: BusIndex(0), time, step });
            }
            last = Some(time);
            reading.push(frame);
        }
    }
    let findings = reading.finish().findings;
    (findings.reported_groups().map(|group| group.rule.to_string()).collect(), steps)
}

/// The source reports that the clock was set by an hour: one event, and no heartbeat is late. Without the report,
/// one producer alone may as well have been silent.
#[test]
fn a_clock_set_during_a_live_capture_is_an_event_and_no_finding() {
    let (rules, steps) = judged_live(true);
    assert_eq!((rules, steps.len()), (Vec::<String>::new(), 1));
    assert!((3_599_000_000_000..3_601_000_000_000).contains(&steps[0]), "{steps:?}");
    assert_eq!(judged_live(false), (vec!["node-lost".to_owned()], Vec::new()));
}

/// Frames after which three producers, two with heartbeats and one of SYNC, have sent three messages each.
const KNOWN: f64 = 0.4;

#[expect(
    clippy::cast_possible_truncation,
    clippy::cast_sign_loss,
    clippy::cast_precision_loss,
    reason = "a place in a capture of some hundred frames"
)]
fn index(frames: &[Line], place: f64) -> usize {
    (frames.len() as f64 * place) as usize
}

fn check_one_statement(findings: &CaptureFindings) -> Result<(), TestCaseError> {
    prop_assert_eq!(rules(findings), "");
    prop_assert_eq!(statements(findings).len(), 1, "{:?}", findings.quality);
    Ok(())
}

/// Captures of failing devices, below `fixtures/`.
const FAULTY: [&str; 8] = [
    "stories/wandfluh-md2/fault-reset-held",
    "stories/danfoss-pve-ci/enable-in-fault-hold",
    "stories/rexroth-vpcd/settings-lost",
    "diagnosis/wrong-remap",
    "diagnosis/enable-wrong-order",
    "diagnosis/eeprom-wear",
    "diagnosis/sync-producer-twice",
    "diagnosis/mode-write-ignored",
];

/// Frames and options of a capture of a failing device.
fn faulty(name: &str) -> (Vec<Line>, String) {
    let path = workspace().join("fixtures").join(name);
    let table = fs::read_to_string(path.with_extension("toml")).unwrap();
    let table: toml::Table = toml::from_str(&table).unwrap();
    let nodes = table["node"].as_array().unwrap().iter().filter_map(toml::Value::as_str);
    let nodes: Vec<String> = nodes.map(|node| format!("#! --node {node}\n")).collect();
    let bus_file = table.get("bus_file").and_then(toml::Value::as_str).unwrap_or_default();
    let bus_file: Vec<String> = bus_file.lines().map(|line| format!("#| {line}\n")).collect();
    let log = fs::read_to_string(path.with_extension("log")).unwrap();
    (lines(&log), [nodes.concat(), bus_file.concat()].concat())
}

/// Whether the frames of a finding, or of one of its causes, are on both sides of a frame.
fn spans(findings: &CaptureFindings, group: &FindingGroup, at: u64) -> bool {
    let is_across = |group: &FindingGroup| {
        group.first_occurrence().frames.first <= at && group.last_occurrence().frames.last > at
    };
    is_across(group) || findings.causes_of(group).into_iter().any(is_across)
}

proptest! {
    #![proptest_config(ProptestConfig { cases: 60, failure_persistence: None, ..ProptestConfig::default() })]

    #[test]
    fn a_shift_of_all_timestamps_is_one_statement_and_no_finding(
        place in KNOWN..0.95_f64,
        factor in 11_i64..10_000,
    ) {
        let (frames, _) = clean("canopen.log");
        let at = index(&frames, place);
        check_one_statement(&shifted("canopen.log", at, longest(&frames, at) * factor))?;
    }

    /// Messages in the second half of the capture are periodic: a cut of them is a hole, which has no counter.
    #[test]
    fn missing_frames_are_one_statement_and_no_finding(place in 0.5..0.6_f64) {
        let (mut frames, options) = clean("canopen.log");
        let at = index(&frames, place);
        let from = frames[at].time;
        let until = from + longest(&frames, at) * 11;
        frames.retain(|line| line.time <= from || line.time > until);
        check_one_statement(&judged("canopen.log", &frames, &options))?;
    }

    /// Before three producers are known, a gap may as well be the absence of the few nodes: findings name both.
    #[test]
    fn findings_of_an_unclear_gap_name_both_causes(place in 0.05..KNOWN, factor in 11_i64..10_000) {
        let (frames, _) = clean("canopen.log");
        let at = index(&frames, place);
        let longest = longest(&frames, at);
        let findings = shifted("canopen.log", at, longest * factor);
        // A time limit that expires earlier does not depend on the gap being unusual.
        let unusual = (frames[at - 1].time + longest * 10) * 1_000;
        let is_late = |group: &&FindingGroup| group.first[0].time.is_some_and(|time| time.0 > unusual);
        for group in findings.groups.iter().filter(is_late) {
            prop_assert!(group.text.contains("or a hole in the capture"), "{}: {}", group.rule, group.text);
        }
    }

    /// A shift takes no finding away whose evidence is on one side of it.
    #[test]
    fn no_finding_disappears_beside_a_shift(
        name in proptest::sample::select(&FAULTY[..]),
        place in 0.05..0.95_f64,
        factor in 11_i64..10_000,
    ) {
        let (mut frames, options) = faulty(name);
        let before = judged(name, &frames, &options);
        let at = index(&frames, place);
        let delay = longest(&frames, at) * factor;
        for line in &mut frames[at..] {
            line.time += delay;
        }
        let after = judged(name, &frames, &options);
        let at = u64::try_from(at).unwrap();
        for group in before.reported_groups().filter(|group| !spans(&before, group, at)) {
            let is_there = after.reported_groups().any(|other| other.fingerprint() == group.fingerprint());
            prop_assert!(is_there, "{}: {} is gone", name, group.fingerprint());
        }
    }
}
