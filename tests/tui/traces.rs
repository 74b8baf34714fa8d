//! Signals over time, compared with values derived by hand and with the output of `decode`.
#![expect(clippy::indexing_slicing, reason = "a test that cannot go on has failed")]

use std::collections::BTreeMap;
use std::fs;
use std::path::PathBuf;
use std::process::Command;
use std::sync::Arc;
use std::sync::mpsc::{Receiver, channel};

use cobscope::timeline::{
    JoinOptions, MOST_SIGNALS, SampleBucket, SignalKey, SignalTraces, Timeline, TimelineCaptures,
    TimelineNews,
};
use cobscope_decoder::capture::ReadOptions;
use cobscope_decoder::frame::{CanId, Timestamp};
use cobscope_decoder::profile::Catalogue;
use cobscope_decoder::profile::dbc::{self, Database};
use cobscope_decoder::rules::RuleSetup;
use cobscope_decoder::session::{AssignedBy, Assignment, SessionOptions};

use crate::support::workspace;

const MILLISECOND: i64 = 1_000_000;

/// A capture that is completely read.
fn open(capture: &str, node: u8, device: &str) -> (Timeline, Receiver<TimelineNews>) {
    let catalogue = Catalogue::default();
    let device = catalogue.device(device).unwrap();
    let assignment = Assignment { bus: None, node: node.into(), device, by: AssignedBy::Option };
    let session = SessionOptions { assignments: vec![assignment], ..SessionOptions::default() };
    read(workspace().join(capture), session)
}

fn read(path: PathBuf, session: SessionOptions) -> (Timeline, Receiver<TimelineNews>) {
    let (sender, news) = channel();
    let rules = Arc::new(RuleSetup::default());
    let captures = TimelineCaptures {
        paths: vec![path],
        align: false,
        join: JoinOptions::OFF,
        read: ReadOptions::default(),
        session,
        rules,
        live: None,
    };
    let timeline = Timeline::open(captures, sender).unwrap();
    while timeline.end_state().is_none() || !timeline.progress().is_complete() {
        news.recv().unwrap();
    }
    (timeline, news)
}

/// All signals known at the end.
fn signals(timeline: &Timeline) -> Vec<SignalKey> {
    let end = timeline.end_state().unwrap();
    let rows = end.identifiers().rows().iter().filter(|row| !row.is_remote);
    rows.flat_map(|row| row.layout.iter().flat_map(|layout| SignalKey::signals_of(row.bus, row.id, layout)))
        .collect()
}

fn wait(traces: &SignalTraces, news: &Receiver<TimelineNews>) {
    while !traces.is_complete() {
        news.recv().unwrap();
    }
}

/// Milliseconds from the first frame, with the value at that time.
fn values(timeline: &Timeline, traces: &SignalTraces, key: &SignalKey) -> Vec<(i64, f64)> {
    let zero = timeline.first_time().unwrap();
    let points = traces.signal_points(key).unwrap();
    assert!(points.is_exact);
    let value =
        |bucket: &SampleBucket| ((bucket.t - zero.0) / MILLISECOND, (bucket.last * 10.0).round() / 10.0);
    points.buckets.iter().map(value).collect()
}

#[test]
fn a_value_is_scaled_as_it_was_at_its_time() {
    let (timeline, news) = open("fixtures/devices/sydfec_nominal_pressure.log", 2, "rexroth-sydfec");
    let zero = timeline.first_time().unwrap();
    let keys = signals(&timeline);
    // The actual pressure: 16384 is the nominal pressure, 5208:02.
    let key = keys.iter().find(|key| key.id == CanId::from_standard(0x182) && key.unit == "bar").unwrap();
    let whole = timeline.start_sampling(vec![key.clone()], zero, None);
    wait(&whole, &news);
    let found = values(&timeline, &whole, key);
    let expected = [
        // FFF0, 0FFC and 1FF9 of 315 bar, up to the write at 191 ms …
        (106, -0.3),
        (126, 78.7),
        (146, 157.4),
        (166, 78.7),
        (187, 157.4),
        // … and of 250 bar.
        (206, 124.9),
        (226, 62.4),
        (246, -0.2),
        (286, 62.4),
        (306, 124.9),
    ];
    assert_eq!(found.get(..expected.len()).unwrap(), expected);
    // A section starts with the value that is valid at its start.
    let (from, to) = (zero.plus(200 * MILLISECOND), zero.plus(250 * MILLISECOND));
    let part = timeline.start_sampling(vec![key.clone()], from, Some(to));
    wait(&part, &news);
    assert_eq!(values(&timeline, &part, key), expected[4..8]);
    assert!(part.covers_range(from.0, to.0) && !part.covers_range(zero.0, to.0));
    assert!(!timeline.is_tracing());
}

#[test]
fn an_unused_trace_ends_and_their_number_is_limited() {
    let (timeline, news) = open("fixtures/devices/pve.log", 32, "danfoss-pve-ci");
    let keys = signals(&timeline);
    let many: Vec<_> = keys.iter().cycle().take(MOST_SIGNALS * 2).cloned().collect();
    let traces = timeline.start_sampling(many, timeline.first_time().unwrap(), None);
    traces.stop_sampling();
    wait(&traces, &news);
    assert_eq!(traces.signals().len(), MOST_SIGNALS);
}

/// Min and max value of each signal of a PDO in `decode`, by identifier and position in the list.
fn decoded(capture: &str, node: &str) -> BTreeMap<(u32, usize), (f64, f64)> {
    let mut command = Command::new(env!("CARGO_BIN_EXE_cobscope"));
    let arguments = ["decode", "-f", "jsonl", "--node", node, "--filter", "kind == \"pdo\""];
    let output = command.current_dir(workspace()).args(arguments).arg(capture).output().unwrap();
    let mut ranges = BTreeMap::new();
    for line in String::from_utf8(output.stdout).unwrap().lines() {
        let event: serde_json::Value = serde_json::from_str(line).unwrap();
        let Some(id) = event["cob_id"].as_str() else { continue };
        for (place, signal) in event["signals"].as_array().into_iter().flatten().enumerate() {
            let Some(value) = signal["value"].as_f64() else { continue };
            let range = ranges.entry((u32::from_str_radix(id, 16).unwrap(), place)).or_insert((value, value));
            *range = (range.0.min(value), range.1.max(value));
        }
    }
    ranges
}

#[test]
fn ranges_are_those_of_decode() {
    let captures = [
        ("fixtures/devices/sydfec_nominal_pressure.log", 2, "rexroth-sydfec"),
        ("fixtures/devices/pve.log", 32, "danfoss-pve-ci"),
        ("fixtures/devices/md2.log", 1, "wandfluh-md2"),
    ];
    for (capture, node, device) in captures {
        let (timeline, news) = open(capture, node, device);
        let expected = decoded(capture, &format!("{node}={device}"));
        let keys = signals(&timeline);
        let mut compared = 0;
        for part in keys.chunks(MOST_SIGNALS) {
            let traces = timeline.start_sampling(part.to_vec(), timeline.first_time().unwrap(), None);
            wait(&traces, &news);
            for key in part {
                let Some((low, high)) = expected.get(&(key.id.number(), key.field)) else { continue };
                let points = traces.signal_points(key).unwrap();
                let numbers = || points.buckets.iter().filter(|bucket| !bucket.last.is_nan());
                let least = numbers().map(|bucket| bucket.min).fold(f64::INFINITY, f64::min);
                let most = numbers().map(|bucket| bucket.max).fold(f64::NEG_INFINITY, f64::max);
                let is_near = (least - low).abs() < 1e-5 && (most - high).abs() < 1e-5;
                assert!(is_near, "{capture} {} {}: {least}..{most}, not {low}..{high}", key.id, key.name);
                compared += 1;
            }
        }
        assert!(compared >= 3, "{capture}: {compared}");
    }
}

/// A selector, a value of one of its two pages, and a value that is always present.
const DBC: &str = "VERSION \"\"\nBO_ 100 MOTION: 3 N\n SG_ Page M : 0|8@1+ (1,0) [0|0] \"\" N\n \
                   SG_ Speed m1 : 8|8@1+ (0.5,0) [0|0] \"km/h\" N\n SG_ Level : 16|8@1- (1,-10) [0|0] \"mm\" N\n";

#[test]
fn messages_of_a_database_are_traced_and_a_page_that_is_not_there_says_nothing() {
    let folder = PathBuf::from(env!("CARGO_TARGET_TMPDIR")).join("traces");
    fs::create_dir_all(&folder).unwrap();
    let path = folder.join("motion.log");
    let frames = ["064#01FF05", "064#0210FE", "064#010A00", "065#010A00", "064#01"];
    let line = |(at, frame): (usize, &&str)| format!("(1700000000.{at}) can0 {frame}\n");
    fs::write(&path, frames.iter().enumerate().map(line).collect::<String>()).unwrap();
    let mut database = Database::default();
    database.add_file(dbc::parse_database(DBC.as_bytes()).unwrap());
    let session = SessionOptions { database: Arc::new(database), ..SessionOptions::default() };
    let (timeline, news) = read(path, session);
    let keys = signals(&timeline);
    let names: Vec<_> = keys.iter().map(|key| (key.name.as_str(), key.unit.as_str())).collect();
    assert_eq!(names, [("Page", ""), ("Speed", "km/h"), ("Level", "mm")]);
    let traces = timeline.start_sampling(keys.clone(), timeline.first_time().unwrap(), None);
    wait(&traces, &news);
    assert_eq!(values(&timeline, &traces, &keys[0]), [(0, 1.0), (100, 2.0), (200, 1.0), (400, 1.0)]);
    assert_eq!(values(&timeline, &traces, &keys[1]), [(0, 127.5), (200, 5.0)]);
    // Signed, with an offset of -10.
    assert_eq!(values(&timeline, &traces, &keys[2]), [(0, -5.0), (100, -12.0), (200, -10.0)]);
}

#[test]
fn a_range_that_ends_before_it_begins_has_nothing_in_it() {
    let (timeline, news) = open("fixtures/devices/pve.log", 32, "danfoss-pve-ci");
    let zero = timeline.first_time().unwrap();
    let traces = timeline.start_sampling(signals(&timeline), zero, Some(Timestamp(zero.0 - 1)));
    wait(&traces, &news);
    assert!(traces.signal_points(&traces.signals()[0]).unwrap().buckets.is_empty());
}
