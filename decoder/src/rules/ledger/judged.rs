//! Final results of a ledger.

use std::sync::Arc;

use super::FindingLedger;
use super::explained::PRESUMED;
use crate::finding::{CaptureFindings, CheckTally, FindingGroup, RuleOrigin, RuleOutcome};

impl FindingLedger {
    /// All results. Without usable timestamps (`is_timed` false), results of timing rules are discarded.
    pub(in crate::rules) fn into_findings(
        mut self,
        is_timed: bool,
        mut quality: Vec<String>,
    ) -> CaptureFindings {
        self.link_late_causes();
        self.note_missing(&mut quality);
        self.forget_presumed();
        if !is_timed {
            let judges_time =
                |rule: u16| self.rules.get(usize::from(rule)).is_some_and(|rule| rule.is_timing);
            let is_by_order = |group: &FindingGroup| {
                // Groups are numbered from 1 in the order of `courses`; some may have been removed.
                let place = usize::try_from(group.id).ok().and_then(|id| id.checked_sub(1));
                place.and_then(|place| self.courses.get(place)).is_some_and(|course| course.is_by_order)
            };
            self.groups.retain(|group| !judges_time(group.key.rule) || is_by_order(group));
            for (place, (tally, rule)) in self.tallies.iter_mut().zip(&mut self.rules).enumerate() {
                if rule.is_timing {
                    let own = self.groups.iter().filter(|group| usize::from(group.key.rule) == place);
                    let failed = own.map(|group| group.count).sum();
                    *tally = CheckTally { failed, ..CheckTally::default() };
                    if failed > 0 {
                        continue;
                    }
                    rule.needs = "usable timestamps".into();
                    for case in &rule.cases {
                        self.cases.remove(case);
                    }
                }
            }
        }
        let mut cases = std::mem::take(&mut self.cases);
        for (rule, tally) in self.rules.iter().zip(&self.tallies) {
            for case in &rule.cases {
                cases.entry(Arc::clone(case)).or_default();
            }
            for case in &rule.shows {
                cases.entry(Arc::clone(case)).or_default().add_tally(*tally);
            }
        }
        let suppressions = self.policy.count_suppressions(&self.groups);
        let conformance = self.run.into_verdicts(is_timed, &self.rules);
        CaptureFindings {
            rules: self.rules,
            tallies: self.tallies,
            cases,
            groups: self.groups,
            ungrouped: self.ungrouped,
            quality,
            suppressions,
            conformance,
            error_frames: 0,
        }
    }

    /// Removes findings that presumed CANopen on a bus that does not use it.
    fn forget_presumed(&mut self) {
        let Self { groups, tallies, doubted, .. } = self;
        groups.retain(|group| {
            let is_one = doubted.contains(&group.key.bus) && group.downgraded.as_deref() == Some(PRESUMED);
            if is_one && let Some(tally) = tallies.get_mut(usize::from(group.key.rule)) {
                tally.failed = tally.failed.saturating_sub(group.count);
            }
            !is_one
        });
    }

    /// Notes what was missing for rules that were not exercised. For expectations of the user it is also a limit
    /// of the verdict.
    fn note_missing(&mut self, quality: &mut Vec<String>) {
        for (rule, why) in &self.unexercised {
            let place = usize::from(*rule);
            if let (Some(info), Some(tally)) = (self.rules.get_mut(place), self.tallies.get(place))
                && tally.verdict() == RuleOutcome::NotExercised
            {
                match info.origin {
                    RuleOrigin::Expectation => {
                        quality.push(format!("{} is not exercised: {why}", info.name));
                    }
                    RuleOrigin::General | RuleOrigin::Device | RuleOrigin::Conclusion => {
                        info.needs = why.as_str().into()
                    }
                }
            }
        }
    }
}
