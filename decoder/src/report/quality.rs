//! Quality of the capture, and what it cannot show.

use super::model::{CaptureFacts, VerdictCoverage};
use crate::diagnosis::{LineLabel, Story, WIRING};
use crate::finding::{CaptureFindings, RuleOutcome};
use crate::statistics::{BusStatistics, Statistics};
use crate::words::count_noun;

/// Measured properties of the capture.
pub(super) fn quality_facts(
    capture: &CaptureFacts,
    statistics: &Statistics,
    findings: &CaptureFindings,
) -> Vec<String> {
    let quality = &statistics.quality;
    let duration = match &capture.duration {
        Some(duration) => format!(" in {duration}"),
        None => ", no timestamps".to_owned(),
    };
    let mut all = vec![format!("{}{duration}", count_noun(capture.frames, "frame"))];
    all.extend(capture.failure.iter().map(|reason| format!("incomplete: {reason}")));
    all.extend(quality.limit_texts());
    for limit in &findings.quality {
        if !all.contains(limit) {
            all.push(limit.clone());
        }
    }
    if all.len() == 1 {
        all.push("no loss, no step of the clock and no unreadable record found".to_owned());
    }
    all
}

/// What the capture cannot show: for the stories, and in general.
pub(super) fn blind_spots(
    stories: &[&Story],
    statistics: &Statistics,
    findings: &CaptureFindings,
) -> Vec<String> {
    let mut all: Vec<String> = Vec::new();
    let lines = stories.iter().flat_map(|story| &story.lines);
    for line in lines.filter(|line| line.label == LineLabel::Unjudged) {
        for part in line.text.split("; ").filter(|part| !part.is_empty()) {
            if !all.iter().any(|known| known == part) {
                all.push(part.to_owned());
            }
        }
    }
    if statistics.quality.error_frames == 0 && !all.iter().any(|text| text == WIRING) {
        all.push(WIRING.to_owned());
    }
    if statistics.buses.iter().filter_map(BusStatistics::capture_beginning).any(|it| !it.running.is_empty()) {
        all.push("everything before the first frame: nodes were already running".to_owned());
    }
    if !statistics.quality.is_timed() {
        all.push("intervals and delays: no usable timestamps".to_owned());
    }
    let timing = findings.rules.iter().zip(&findings.tallies);
    let idle =
        timing.filter(|(rule, tally)| rule.is_on && tally.verdict() == RuleOutcome::NotExercised).count();
    if idle > 0 {
        all.push(format!("{}: not exercised, see the list of rules", count_noun(idle, "rule")));
    }
    all
}

/// Verdicts of all active rules.
pub(super) fn verdict_coverage(findings: &CaptureFindings) -> VerdictCoverage {
    let mut coverage = VerdictCoverage::default();
    for (rule, tally) in findings.rules.iter().zip(&findings.tallies).filter(|(rule, _)| rule.is_on) {
        let name = rule.name.to_string();
        match tally.verdict() {
            RuleOutcome::Pass => coverage.passed.push((name, tally.passed.saturating_add(tally.waived))),
            RuleOutcome::Fail => coverage.failed.push((name, tally.failed)),
            RuleOutcome::NotExercised => coverage.not_exercised.push((name, rule.needs.to_string())),
        }
    }
    coverage
}
