//! A run of CiA's conformance test tool: each case it marks is judged by our rules too, beside its own verdict.
//!
//! Within a case the rules it names judge as ever. What others find there the test provoked: in a case whose
//! stimulus is negative it is a fact and no finding, elsewhere a note.

mod cases;

pub use cases::{Case, Class, cases};

use std::sync::Arc;

use crate::event::FrameRange;
use crate::finding::{CaseVerdict, RuleInfo, Tally, Verdict};
use crate::wire::canopen::test_marker::{TestMarker, TestResult};

/// Cases of one capture that are kept; a run has 127.
const CASE_LIMIT: usize = 4096;

/// The segment that is open.
#[derive(Debug)]
struct Segment {
    marker: TestMarker,
    case: Option<&'static Case>,
    first: u64,
    before: Vec<Tally>,
}

/// What a finding is within a case.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum Standing {
    /// Nothing special: the rule judges the case, or there is none.
    Judged,
    /// Provoked by a negative test.
    Fact,
    /// Beside what the case is about.
    Beside,
}

/// Cases so far.
#[derive(Debug, Default)]
pub(super) struct Run {
    open: Option<Segment>,
    /// Frame of the last mark and the tallies then: where a begin was not seen, its case begins there.
    last: Option<(u64, Vec<Tally>)>,
    pub(super) verdicts: Vec<CaseVerdict>,
}

impl Run {
    /// The tool marks a case.
    pub(super) fn mark(&mut self, marker: TestMarker, frame: u64, rules: &[RuleInfo], tallies: &[Tally]) {
        match marker.result {
            None => {
                let case = cases().find(marker.group, marker.case);
                self.open = Some(Segment { marker, case, first: frame, before: tallies.to_vec() });
            }
            Some(result) => self.end(marker, result, frame, rules, tallies),
        }
        self.last = Some((frame, tallies.to_vec()));
    }

    fn end(
        &mut self,
        marker: TestMarker,
        result: TestResult,
        frame: u64,
        rules: &[RuleInfo],
        tallies: &[Tally],
    ) {
        let same = |open: &Segment| (open.marker.group, open.marker.case) == (marker.group, marker.case);
        let open = self.open.take().filter(same);
        let has_begin = open.is_some();
        let segment = open.unwrap_or_else(|| {
            let (first, before) = self.last.take().unwrap_or((0, vec![Tally::default(); tallies.len()]));
            Segment { marker, case: cases().find(marker.group, marker.case), first, before }
        });
        if self.verdicts.len() >= CASE_LIMIT {
            return;
        }
        let named = segment.case.map_or(&[][..], |case| &case.rules);
        let mut judged: Vec<(Arc<str>, Tally)> = Vec::new();
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

    /// What a finding of this rule is now.
    pub(super) fn standing(&self, rule: &str) -> Standing {
        match &self.open {
            None => Standing::Judged,
            Some(segment) => match segment.case {
                Some(case) if case.rules.iter().any(|named| named == rule) => Standing::Judged,
                Some(case) if case.is_negative() => Standing::Fact,
                _ => Standing::Beside,
            },
        }
    }

    /// Number of the case that is open.
    pub(super) fn case(&self) -> Option<String> {
        self.open.as_ref().map(|open| format!("{}.{}", open.marker.group, open.marker.case))
    }

    /// All verdicts; those of rules about times do not count where times say nothing.
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
    /// What our rules come to.
    pub fn ours(&self) -> Verdict {
        let mut all = Tally::default();
        for (_, tally) in &self.judged {
            all.add(*tally);
        }
        all.verdict()
    }

    /// Whether both have a verdict and they differ.
    pub fn disagrees(&self) -> bool {
        match (self.tool, self.ours()) {
            (TestResult::Passed, ours) => ours == Verdict::Fail,
            // A warning or failure nobody here could judge is worth a line too.
            (TestResult::Failed | TestResult::Warning, ours) => ours != Verdict::Fail,
            (TestResult::Skipped, ours) => ours != Verdict::NotExercised,
            (TestResult::Other(_), _) => false,
        }
    }
}
