//! Holes: the timestamps of clean captures are shifted after a frame. A gap that all periodic messages share is one
//! statement about the capture, and no finding.

use std::fmt::Write as _;
use std::fs;

use cobscope_decoder::finding::{Findings, Group};
use proptest::prelude::*;

use crate::mutator::{Line, lines, text};
use crate::rules::{Annotated, judge, parse};
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
fn shifted(name: &str, at: usize, delay: i64) -> Findings {
    let (mut frames, options) = clean(name);
    for line in &mut frames[at..] {
        line.time += delay;
    }
    judged(name, &frames, &options)
}

fn judged(name: &str, frames: &[Line], options: &str) -> Findings {
    let Annotated { frames, options, setup, .. } = parse(name, &format!("{options}{}", text(frames)));
    judge(&frames, &options, setup).1
}

fn rules(findings: &Findings) -> String {
    findings.groups.iter().fold(String::new(), |mut all, group| {
        writeln!(all, "{} {:?}", group.rule, group.key.node).unwrap();
        all
    })
}

fn statements(findings: &Findings) -> Vec<&String> {
    findings.quality.iter().filter(|note| note.starts_with("no frame for")).collect()
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

fn check_one_statement(findings: &Findings) -> Result<(), TestCaseError> {
    prop_assert_eq!(rules(findings), "");
    prop_assert_eq!(statements(findings).len(), 1, "{:?}", findings.quality);
    Ok(())
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
        let is_late = |group: &&Group| group.first[0].time.is_some_and(|time| time.0 > unusual);
        for group in findings.groups.iter().filter(is_late) {
            prop_assert!(group.text.contains("or a hole in the capture"), "{}: {}", group.rule, group.text);
        }
    }
}
