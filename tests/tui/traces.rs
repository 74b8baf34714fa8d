//! Signals over time against values by hand, and against what `decode` prints.
#![expect(clippy::indexing_slicing, reason = "a test that cannot go on has failed")]

use std::collections::BTreeMap;
use std::process::Command;
use std::sync::Arc;
use std::sync::mpsc::{Receiver, channel};

use cobscope::app::SignalKey;
use cobscope::timeline::{Captures, MOST_SIGNALS, News, Timeline, Traces};
use cobscope::widgets::plot::Bucket;
use cobscope_decoder::capture::ReadOptions;
use cobscope_decoder::frame::{CanId, Timestamp};
use cobscope_decoder::profile::Catalogue;
use cobscope_decoder::rules::Setup;
use cobscope_decoder::session::{AssignedBy, Assignment, SessionOptions};

use crate::support::workspace;

const MILLISECOND: i64 = 1_000_000;

/// A capture that is read to its end.
fn open(capture: &str, node: u8, device: &str) -> (Timeline, Receiver<News>) {
    let catalogue = Catalogue::default();
    let device = catalogue.device(device).unwrap();
    let assignment = Assignment { bus: None, node: node.into(), device, by: AssignedBy::Option };
    let (sender, news) = channel();
    let captures = Captures {
        paths: vec![workspace().join(capture)],
        align: false,
        read: ReadOptions::default(),
        session: SessionOptions { assignments: vec![assignment], ..SessionOptions::default() },
        rules: Arc::new(Setup::default()),
    };
    let timeline = Timeline::open(captures, sender).unwrap();
    while timeline.end().is_none() || !timeline.progress().is_complete() {
        news.recv().unwrap();
    }
    (timeline, news)
}

/// All signals known at the end.
fn signals(timeline: &Timeline) -> Vec<SignalKey> {
    let end = timeline.end().unwrap();
    let rows = end.identifiers().rows().iter().filter(|row| !row.is_remote);
    rows.flat_map(|row| row.layout.iter().flat_map(|layout| SignalKey::all(row.bus, row.id, layout)))
        .collect()
}

fn wait(traces: &Traces, news: &Receiver<News>) {
    while !traces.is_complete() {
        news.recv().unwrap();
    }
}

/// Milliseconds from the first frame, and the value there.
fn values(timeline: &Timeline, traces: &Traces, key: &SignalKey) -> Vec<(i64, f64)> {
    let zero = timeline.first().unwrap();
    let points = traces.points(key).unwrap();
    assert!(points.is_exact);
    let value = |bucket: &Bucket| ((bucket.t - zero.0) / MILLISECOND, (bucket.last * 10.0).round() / 10.0);
    points.buckets.iter().map(value).collect()
}

#[test]
fn a_value_is_scaled_as_it_was_at_its_time() {
    let (timeline, news) = open("fixtures/devices/sydfec_nominal_pressure.log", 2, "rexroth-sydfec");
    let zero = timeline.first().unwrap();
    let keys = signals(&timeline);
    // The actual pressure: 16384 are the nominal pressure, 5208:02.
    let key = keys.iter().find(|key| key.id == CanId::standard(0x182) && key.unit == "bar").unwrap();
    let whole = timeline.trace(vec![key.clone()], zero, None);
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
    // A part of it begins with the value that holds there from before.
    let (from, to) = (zero.plus(200 * MILLISECOND), zero.plus(250 * MILLISECOND));
    let part = timeline.trace(vec![key.clone()], from, Some(to));
    wait(&part, &news);
    assert_eq!(values(&timeline, &part, key), expected[4..8]);
    assert!(part.covers(from.0, to.0) && !part.covers(zero.0, to.0));
    assert!(!timeline.is_tracing());
}

#[test]
fn a_trace_that_nobody_wants_ends_and_there_are_never_too_many() {
    let (timeline, news) = open("fixtures/devices/pve.log", 32, "danfoss-pve-ci");
    let keys = signals(&timeline);
    let many: Vec<_> = keys.iter().cycle().take(MOST_SIGNALS * 2).cloned().collect();
    let traces = timeline.trace(many, timeline.first().unwrap(), None);
    traces.stop();
    wait(&traces, &news);
    assert_eq!(traces.signals().len(), MOST_SIGNALS);
}

/// Lowest and highest value `decode` gives of each signal of a PDO, by identifier and place in the list.
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
            let traces = timeline.trace(part.to_vec(), timeline.first().unwrap(), None);
            wait(&traces, &news);
            for key in part {
                let Some((low, high)) = expected.get(&(key.id.number(), key.field)) else { continue };
                let points = traces.points(key).unwrap();
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

#[test]
fn a_range_that_ends_before_it_begins_has_nothing_in_it() {
    let (timeline, news) = open("fixtures/devices/pve.log", 32, "danfoss-pve-ci");
    let zero = timeline.first().unwrap();
    let traces = timeline.trace(signals(&timeline), zero, Some(Timestamp(zero.0 - 1)));
    wait(&traces, &news);
    assert!(traces.points(&traces.signals()[0]).unwrap().buckets.is_empty());
}
