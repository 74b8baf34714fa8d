//! Runs of CiA's conformance test tool: for each marked case, the verdict of our rules is shown next to the
//! tool's own.
//!
//! Within a case, the rules listed for it apply as usual. The test provokes the findings of all other rules:
//! they are dropped in a case with a negative stimulus, and reduced to notes in the other cases.

mod cases;

pub use cases::{CaseClass, TestCase, test_cases};

use std::sync::Arc;

use crate::event::FrameRange;
use crate::finding::{CaseVerdict, CheckTally, RuleInfo, RuleOutcome};
use crate::wire::canopen::test_marker::{TestMarker, TestResult};

/// Maximum number of cases of one capture; a full run has 127.
const CASE_LIMIT: usize = 4096;

/// The open test case.
#[derive(Debug, Clone)]
struct OpenCase {
    marker: TestMarker,
    case: Option<&'static TestCase>,
    first: u64,
    before: Vec<CheckTally>,
}

/// Treatment of a finding within a case.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum CaseStanding {
    /// Normal finding: the rule is listed for the case, or no case is open.
    Judged,
    /// Provoked by a negative test: dropped.
    Fact,
    /// The case is not about this rule: a note.
    Beside,
}

/// Verdicts so far and the open case.
#[derive(Debug, Clone, Default)]
pub(super) struct ConformanceRun {
    open: Option<OpenCase>,
    /// Frame and verdict counts at the last marker; a case without a start marker starts there.
    last: Option<(u64, Vec<CheckTally>)>,
    pub(super) verdicts: Vec<CaseVerdict>,
}

impl ConformanceRun {
    /// Handles a marker of the test tool.
    pub(super) fn on_marker(
        &mut self,
        marker: TestMarker,
        frame: u64,
        rules: &[RuleInfo],
        tallies: &[CheckTally],
    ) {
        match marker.result {
            None => {
                let case = test_cases().find_case(marker.group, marker.case);
                self.open = Some(OpenCase { marker, case, first: frame, before: tallies.to_vec() });
            }
            Some(result) => self.end_case(marker, result, frame, rules, tallies),
        }
        self.last = Some((frame, tallies.to_vec()));
    }

    fn end_case(
        &mut self,
        marker: TestMarker,
        result: TestResult,
        frame: u64,
        rules: &[RuleInfo],
        tallies: &[CheckTally],
    ) {
        let same = |open: &OpenCase| (open.marker.group, open.marker.case) == (marker.group, marker.case);
        let open = self.open.take().filter(same);
        let has_begin = open.is_some();
        let segment = open.unwrap_or_else(|| {
            let (first, before) = self.last.take().unwrap_or((0, vec![CheckTally::default(); tallies.len()]));
            OpenCase { marker, case: test_cases().find_case(marker.group, marker.case), first, before }
        });
        if self.verdicts.len() >= CASE_LIMIT {
            return;
        }
        let named = segment.case.map_or(&[][..], |case| &case.rules);
        let mut judged: Vec<(Arc<str>, CheckTally)> = Vec::new();
        for (place, rule) in
            rules.iter().enumerate().filter(|(_, rule)| named.iter().any(|it| **it == *rule.name))
        {
            let before = segment.before.get(place).copied().unwrap_or_default();
            let during = tallies.get(place).copied().unwrap_or_default().since(before);
            judged.push((Arc::clone(&rule.name), during));
        }
        self.verdicts.push(CaseVerdict {
            id: format!("{}.{}", marker.group, marker.case).into(),
            name: segment.case.map_or("", |case| &case.name).into(),
            tool: result,
            judged,
            frames: FrameRange { first: segment.first, last: frame },
            has_begin,
        });
    }

    /// Treatment of findings of this rule in the open case.
    pub(super) fn standing_of(&self, rule: &str) -> CaseStanding {
        match &self.open {
            None => CaseStanding::Judged,
            Some(segment) => match segment.case {
                Some(case) if case.rules.iter().any(|named| named == rule) => CaseStanding::Judged,
                Some(case) if case.is_negative() => CaseStanding::Fact,
                _ => CaseStanding::Beside,
            },
        }
    }

    /// Number of the open case.
    pub(super) fn open_case(&self) -> Option<String> {
        self.open.as_ref().map(|open| format!("{}.{}", open.marker.group, open.marker.case))
    }

    /// All verdicts. Without usable timestamps, timing rules are left out.
    pub(super) fn into_verdicts(mut self, is_timed: bool, rules: &[RuleInfo]) -> Vec<CaseVerdict> {
        if !is_timed {
            let judges_time = |name: &str| rules.iter().any(|rule| rule.is_timing && *rule.name == *name);
            for verdict in &mut self.verdicts {
                verdict.judged.retain(|(rule, _)| !judges_time(rule));
            }
        }
        self.verdicts
    }
}

impl CaseVerdict {
    /// Combined verdict of our rules.
    pub fn own_verdict(&self) -> RuleOutcome {
        let mut all = CheckTally::default();
        for (_, tally) in &self.judged {
            all.add_tally(*tally);
        }
        all.verdict()
    }

    /// Whether the verdict of the tool and ours contradict each other.
    pub fn contradicts_tool(&self) -> bool {
        match (self.tool, self.own_verdict()) {
            (TestResult::Passed, ours) => ours == RuleOutcome::Fail,
            // Also listed: a warning or failure of the tool that no rule of ours could check.
            (TestResult::Failed | TestResult::Warning, ours) => ours != RuleOutcome::Fail,
            (TestResult::Skipped, ours) => ours != RuleOutcome::NotExercised,
            (TestResult::Other(_), _) => false,
        }
    }
}
