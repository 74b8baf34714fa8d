//! Times that captures cannot exceed: of findings, and of statistics on a clock that was set back.

use std::fmt::Write as _;
use std::fs;

use cobscope_decoder::Reading;
use cobscope_decoder::answers::statistics::CaptureStatistics;
use cobscope_decoder::session::Bus;
use cobscope_decoder::statistics::Statistics;
use cobscope_decoder::{CaptureFindings, Event};

use crate::support::{captures_below, step};

/// Findings of a capture, and the times of its first and last frame in ns.
fn judge_capture(capture: &[u8]) -> Option<(CaptureFindings, i64, i64)> {
    let mut reading = Reading::new(|_: &Event, _: &Bus| {});
    // A capture that is damaged at its end has findings, too.
    let _ = reading.run(capture);
    let summary = reading.finish();
    let (first, last) = (summary.first_time()?, summary.last_time()?);
    Some((summary.findings, first.0, last.0))
}

/// 1,000 PDOs from 1 s on, every 10 ms; error frames of class 88h at these times in ms.
fn disturbed(errors: &[u64]) -> String {
    let mut all: Vec<(u64, &str)> = errors.iter().map(|at| (*at, "20000088#0000000000000000")).collect();
    all.extend((0..1_000).map(|number| (1_000 + 10 * number, "185#0000")));
    all.sort_unstable();
    let mut text = String::from("(1700000000.500000) can0 705#00\n");
    for (at, frame) in all {
        writeln!(text, "(17000000{:02}.{:03}000) can0 {frame}", at / 1_000, at % 1_000).unwrap();
    }
    text
}

#[test]
fn error_frames_end_with_the_last_one() {
    // Twelve in 0.88 s: more than 10/s, and 1.2 % of 1,013 frames.
    let errors: Vec<u64> = (0..12).map(|number| 2_950 + 80 * number).collect();
    let (findings, ..) = judge_capture(disturbed(&errors).as_bytes()).unwrap();
    let group = findings.groups.iter().find(|group| &*group.rule == "bus-health").unwrap();
    let last = group.last_occurrence().time.unwrap();
    assert_eq!(last.0, 1_700_000_003_830_000_000, "{}", group.text);
    assert_eq!(group.duration().unwrap_or(0), 0);
}

#[test]
fn a_silence_does_not_move_error_frames_before_it() {
    // Twelve error frames from 2.95 to 3.83 s; three periodic PDOs, silent from 6 to 16 s.
    let mut all: Vec<(u64, &str)> =
        (0..12).map(|number| (2_950 + 80 * number, "20000088#0000000000000000")).collect();
    for at in (1_000..6_000).chain(16_000..21_000).step_by(10) {
        all.extend(["185#0000", "186#0000", "187#0000"].map(|frame| (at, frame)));
    }
    all.sort_unstable();
    let mut text = String::new();
    for (at, frame) in all {
        writeln!(text, "({}.{:03}000) can0 {frame}", 1_700_000_000 + at / 1_000, at % 1_000).unwrap();
    }
    let (findings, ..) = judge_capture(text.as_bytes()).unwrap();
    let group = findings.groups.iter().find(|group| &*group.rule == "bus-health").unwrap();
    assert_eq!(group.last_occurrence().time.unwrap().0, 1_700_000_003_830_000_000, "{}", group.text);
}

#[test]
fn no_finding_is_outside_of_its_capture_or_longer() {
    let mut judged = 0;
    for path in captures_below("fixtures").iter().step_by(step(3)) {
        let Some((findings, first, last)) = judge_capture(&fs::read(path).unwrap()) else { continue };
        // The clock of some was set back.
        let (first, last) = (first.min(last), first.max(last));
        for group in findings.reported_groups() {
            judged += 1;
            let duration = group.duration().unwrap_or(0);
            assert!(duration <= last - first, "{path}: {} for {duration} ns of {}", group.rule, last - first);
            for at in group.first.iter().chain(&group.last).filter_map(|at| at.time) {
                assert!(at.0 <= last, "{path}: {} {} ns after the end", group.rule, at.0 - last);
            }
        }
    }
    assert!(judged > 100, "{judged}");
}

/// Statistics of heartbeats at these times in ms.
fn statistics_of(milliseconds: &[u64]) -> CaptureStatistics {
    let mut text = String::new();
    for at in milliseconds {
        writeln!(text, "({}.{:03}000) can0 701#05", at / 1_000, at % 1_000).unwrap();
    }
    let mut reading = Reading::new(Statistics::default());
    reading.run(text.as_bytes()).unwrap();
    let summary = reading.finish();
    CaptureStatistics::new(("set back", "log"), &summary.part, summary.buses(), Bus::bit_rate)
}

#[test]
fn a_clock_that_was_set_back_does_not_lengthen_the_capture() {
    let heartbeat = |statistics: &CaptureStatistics| {
        let period = statistics.buses[0].nodes[0].heartbeat_ms.as_ref().unwrap();
        (period.min, period.max)
    };
    // Set back by 990 s, and set right 1 s later; or never. No interval across a step is known.
    let restored = statistics_of(&[1_000_000, 1_000_500, 10_500, 11_000, 1_001_500, 1_002_000]);
    assert_eq!(restored.duration, Some(2.0));
    assert_eq!(heartbeat(&restored), (500.0, 500.0));
    let set_back = statistics_of(&[1_000_000, 1_000_500, 10_000, 10_500, 11_000]);
    assert_eq!(set_back.duration, Some(1.5));
    assert_eq!(heartbeat(&set_back), (500.0, 500.0));
    // A recorder that stood still is not set back.
    assert_eq!(statistics_of(&[1_000_000, 1_000_500, 1_990_500]).duration, Some(990.5));
}
