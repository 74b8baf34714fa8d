//! Search for the cause of a finding: earlier findings and events, and at the end of the capture also later
//! ones.

use std::sync::Arc;

use super::causes::{CauseEffect, CauseEntry, CauseExplanation, DEVICE_WRITE, cause_table};
use super::{DefectClaim, FindingLedger};
use crate::finding::{
    FactCause, FindingCause, FindingGroup, FindingSubject, GroupKey, RuleInfo, RuleOrigin, Severity,
};
use crate::frame::Timestamp;
use crate::rules::conformance::CaseStanding;
use crate::wire::NodeId;

/// Reason for a lower severity while the protocol of the bus is only presumed.
pub(super) const PRESUMED: &str = "protocol only presumed";

impl FindingLedger {
    /// Effective severity, the reason if it is lower than that of the rule, and the cause.
    pub(super) fn effective_severity(
        &self,
        claim: &DefectClaim,
        opens: bool,
    ) -> (Severity, Option<String>, Option<CauseExplanation>) {
        let Some(rule) = self.rules.get(usize::from(claim.key.rule)) else {
            return (Severity::Note, None, None);
        };
        let configured = self.policy.severity_of(&rule.name);
        let mut severity = configured.unwrap_or(claim.severity.unwrap_or(rule.severity));
        let mut reason = None;
        let explained = opens.then(|| self.find_explanation(rule, claim)).flatten();
        if let Some(CauseExplanation { effect: CauseEffect::Quality, by: FindingCause::Quality(text) }) =
            &explained
        {
            severity = Severity::Note;
            reason = Some(format!("{text} may be the cause"));
        }
        if self.run.standing_of(&rule.name) == CaseStanding::Beside {
            severity = Severity::Note;
            let case = self.run.open_case().unwrap_or_default();
            reason.get_or_insert_with(|| {
                format!("inside conformance test {case}, which does not cover this rule")
            });
        }
        if let Some(setting) = claim.assumed {
            severity = severity.next_lower();
            reason.get_or_insert_with(|| setting.to_owned());
        }
        if claim.is_presumed {
            severity = severity.next_lower();
            reason.get_or_insert_with(|| PRESUMED.to_owned());
        }
        (severity, reason, explained)
    }

    /// Cause of a finding of this rule.
    fn find_explanation(&self, rule: &RuleInfo, claim: &DefectClaim) -> Option<CauseExplanation> {
        if let Some(by) = self.taken_in_by(rule, claim) {
            return Some(CauseExplanation { effect: CauseEffect::Same, by: FindingCause::Group(by) });
        }
        if let Some(by) = self.followed_cause(claim) {
            return Some(CauseExplanation { effect: CauseEffect::Follows, by });
        }
        for cause in
            cause_table().causes_of(rule, self.absorbed_by(claim.key.rule)).filter(|it| it.applies_to(claim))
        {
            let from = claim.now.saturating_sub(cause.within);
            // If a rule and an event kind share a name (node-lost), the rule takes precedence.
            let by = self.rules.iter().position(|known| *known.name == *cause.by);
            let Some(by) = by.and_then(|by| u16::try_from(by).ok()) else {
                if let Some(fact) = self.explaining_fact(cause, claim, from) {
                    return Some(CauseExplanation { effect: cause.effect, by: FindingCause::Fact(fact) });
                }
                if cause.by == DEVICE_WRITE
                    && let Some(by) = self.write_of_device(claim, from)
                {
                    return Some(CauseExplanation { effect: cause.effect, by: FindingCause::Group(by) });
                }
                let seen = cause.kind.and_then(|kind| self.kinds.get(&(kind, claim.key.bus)));
                if seen.is_some_and(|seen| *seen >= from) {
                    let by = FindingCause::Quality(Arc::clone(&cause.text));
                    return Some(CauseExplanation { effect: cause.effect, by });
                }
                continue;
            };
            let node = if cause.is_on_node { claim.key.node } else { None };
            let holds = cause.lasts || cause.effect == CauseEffect::Same;
            let is_in_time = |(place, seen): &(usize, i64)| {
                (*seen >= from || holds && self.is_ongoing(*place)) && self.precedes_claim(*place, claim)
            };
            if let Some((place, _)) = self.seen_of(by, claim, node).into_iter().flatten().find(is_in_time)
                && let Some(group) = self.groups.get(place)
            {
                return Some(CauseExplanation { effect: cause.effect, by: FindingCause::Group(group.id) });
            }
        }
        None
    }

    /// Fact that explains a finding.
    fn explaining_fact(&self, cause: &CauseEntry, claim: &DefectClaim, from: i64) -> Option<Arc<FactCause>> {
        let row = cause_table().facts.iter().find(|row| row.name == cause.by)?;
        if row.is_no_consumer() {
            let fact = FactCause { next: row.next.as_str().into(), ..claim.no_consumer.as_deref()?.clone() };
            return Some(Arc::new(fact));
        }
        let node = if cause.is_on_node { claim.key.node } else { None };
        self.facts.find_fact(&cause.by, claim.key.bus, node, from)
    }

    /// The last finding of a device rule about a parameter of the device, at the node of a claim.
    fn write_of_device(&self, claim: &DefectClaim, from: i64) -> Option<u64> {
        let is_recent = |place: usize| self.courses.get(place).is_some_and(|course| course.last >= from);
        let is_of_device = |group: &FindingGroup| {
            let rule = self.rules.get(usize::from(group.key.rule));
            rule.is_some_and(|rule| rule.origin == RuleOrigin::Device)
        };
        let mut all = self.groups.iter().enumerate().rev().filter(|(place, group)| {
            (group.key.bus, group.key.node) == (claim.key.bus, claim.key.node)
                && is_parameter(&group.key.about)
                && is_of_device(group)
                && is_recent(*place)
        });
        all.next().map(|(_, group)| group.id)
    }

    /// Whether the condition of a group had begun when the request of a claim was sent.
    fn precedes_claim(&self, place: usize, claim: &DefectClaim) -> bool {
        let start = self.courses.get(place).and_then(|course| course.last_start);
        start.zip(claim.requested).is_none_or(|(start, requested)| start <= requested)
    }

    /// Groups of a rule with the times of their last occurrences: about the same subject, then the latest one.
    fn seen_of(&self, rule: u16, claim: &DefectClaim, node: Option<NodeId>) -> [Option<(usize, i64)>; 2] {
        let same = self.by_key.get(&GroupKey { rule, ..claim.key.clone() });
        let same = same.and_then(|place| Some((*place, self.courses.get(*place)?.last)));
        [same, self.latest.get(&(rule, claim.key.bus, node)).copied()]
    }

    /// Links findings to causes that were reported after them, by the times of their first occurrences.
    pub(super) fn link_late_causes(&mut self) {
        let mut links = Vec::new();
        for (place, group) in self.groups.iter().enumerate().filter(|(_, group)| !has_group(group)) {
            let Some(rule) = self.rules.get(usize::from(group.key.rule)) else { continue };
            if let Some(by) = self.taken_in_late(rule, group) {
                links.push((place, by, CauseEffect::Same));
                continue;
            }
            let requested = self.courses.get(place).and_then(|course| course.requested);
            let causes = cause_table().causes_of(rule, self.absorbed_by(group.key.rule));
            for cause in causes.filter(|cause| cause.effect != CauseEffect::Quality) {
                let found = self.latest_of(&cause.by, group, cause.is_on_node).filter(|(by, start)| {
                    by.id != group.id
                        && explains_effect((by, *start), (group.first_occurrence().time, requested), cause)
                });
                if let Some((by, _)) = found {
                    links.push((place, by.id, cause.effect));
                    break;
                }
            }
        }
        self.link_late_facts();
        for (place, by, effect) in links {
            if let Some(group) = self.groups.get_mut(place) {
                group.cause = Some(FindingCause::Group(by));
                group.is_absorbed |= effect == CauseEffect::Same;
            }
        }
    }

    /// Links findings to facts that were reported shortly after them.
    fn link_late_facts(&mut self) {
        let mut links = Vec::new();
        for (place, group) in self.groups.iter().enumerate().filter(|(_, group)| group.cause.is_none()) {
            let (Some(rule), Some(began)) =
                (self.rules.get(usize::from(group.key.rule)), group.first_occurrence().time)
            else {
                continue;
            };
            let follows = self
                .followed_names(group.key.rule)
                .iter()
                .map(|name| (&**name, cause_table().follows.before, false));
            let rows =
                cause_table().causes_of(rule, &[]).map(|row| (row.by.as_str(), row.before, row.is_on_node));
            let found = follows.chain(rows).find_map(|(name, before, is_on_node)| {
                let node = if is_on_node { group.key.node } else { None };
                self.facts.find_later(name, group.key.bus, node, (began, before))
            });
            links.extend(found.map(|fact| (place, fact)));
        }
        for (place, fact) in links {
            if let Some(group) = self.groups.get_mut(place) {
                group.cause = Some(FindingCause::Fact(fact));
            }
        }
    }

    /// Whether the condition of a finding still holds.
    pub(super) fn is_ongoing(&self, place: usize) -> bool {
        let is_open = self.groups.get(place).is_some_and(|group| group.is_open);
        is_open && self.courses.get(place).is_some_and(|course| course.is_ongoing)
    }

    /// The latest group of a rule that may explain `effect`, with the start of its condition.
    fn latest_of(
        &self,
        rule: &str,
        effect: &FindingGroup,
        is_on_node: bool,
    ) -> Option<(&FindingGroup, Option<Timestamp>)> {
        let place = self.rules.iter().position(|known| *known.name == *rule)?;
        let node = if is_on_node { effect.key.node } else { None };
        let (place, _) = self.latest.get(&(u16::try_from(place).ok()?, effect.key.bus, node))?;
        Some((self.groups.get(*place)?, self.courses.get(*place)?.first_start))
    }
}

/// Whether a finding is about a parameter of the device: not a communication object other than a PDO.
const fn is_parameter(about: &FindingSubject) -> bool {
    match about {
        FindingSubject::Object(object) => !matches!(object.index, 0x1000..=0x13FF | 0x1C00..=0x1FFF),
        _ => false,
    }
}

/// Whether the cause of a group is another group; a fact is only the nearest explanation.
fn has_group(group: &FindingGroup) -> bool {
    matches!(group.cause, Some(FindingCause::Group(_) | FindingCause::Quality(_)))
}

impl CauseEntry {
    /// Whether the row is about the reason and the EMCY code of a finding.
    fn applies_to(&self, claim: &DefectClaim) -> bool {
        let has_code = |[first, last]: [u16; 2]| match claim.key.about {
            FindingSubject::Code(code) => (first..=last).contains(&code),
            _ => true,
        };
        (!self.is_of_parameter || is_parameter(&claim.key.about))
            && self.codes.is_none_or(has_code)
            && self.reason.as_ref().is_none_or(|reason| claim.reason.as_ref() == Some(reason))
    }
}

/// Whether a finding, whose condition started at `start`, may explain a finding that began at `effect`, about a request
/// sent at `requested`.
fn explains_effect(
    (cause, start): (&FindingGroup, Option<Timestamp>),
    (effect, requested): (Option<Timestamp>, Option<Timestamp>),
    entry: &CauseEntry,
) -> bool {
    let (Some(began), Some(effect)) = (cause.first_occurrence().time, effect) else { return false };
    // A deadline passes before a silence is reported, but the last frame of a node proves that it was alive until then.
    if start.is_some_and(|start| start < began && requested.unwrap_or(effect) < start) {
        return false;
    }
    let holds = entry.lasts || entry.effect == CauseEffect::Same;
    let lasted = cause.lasted.filter(|_| holds).unwrap_or(0);
    (-entry.before..=entry.within.saturating_add(lasted)).contains(&effect.since(began))
}
