//! Search for the cause of a finding: earlier findings and events, and at the end of the capture also later
//! ones.

use std::sync::Arc;

use super::causes::{CauseEntry, Effect, Explanation, causes};
use super::{Claim, Ledger};
use crate::finding::{Cause, Group, RuleInfo, Severity};
use crate::frame::Timestamp;
use crate::rules::conformance::Standing;

/// Reason for a lower severity while the protocol of the bus is only presumed.
pub(super) const PRESUMED: &str = "protocol only presumed";

impl Ledger {
    /// Effective severity, the reason if it is lower than that of the rule, and the cause.
    pub(super) fn severity(
        &self,
        claim: &Claim,
        opens: bool,
    ) -> (Severity, Option<String>, Option<Explanation>) {
        let Some(rule) = self.rules.get(usize::from(claim.key.rule)) else {
            return (Severity::Note, None, None);
        };
        let configured = self.policy.severity(&rule.name);
        let mut severity = configured.unwrap_or(claim.severity.unwrap_or(rule.severity));
        let mut reason = None;
        let explained = opens.then(|| self.explanation(rule, claim)).flatten();
        if let Some(Explanation { effect: Effect::Quality, by: Cause::Quality(text) }) = &explained {
            severity = Severity::Note;
            reason = Some(format!("{text} may be the cause"));
        }
        if self.run.standing(&rule.name) == Standing::Beside {
            severity = Severity::Note;
            let case = self.run.case().unwrap_or_default();
            reason.get_or_insert_with(|| {
                format!("inside conformance test {case}, which does not cover this rule")
            });
        }
        if let Some(setting) = claim.assumed {
            severity = severity.lowered();
            reason.get_or_insert_with(|| setting.to_owned());
        }
        if claim.is_presumed {
            severity = severity.lowered();
            reason.get_or_insert_with(|| PRESUMED.to_owned());
        }
        (severity, reason, explained)
    }

    /// Cause of a finding of this rule.
    fn explanation(&self, rule: &RuleInfo, claim: &Claim) -> Option<Explanation> {
        if let Some(by) = self.taken_in_by(rule, claim) {
            return Some(Explanation { effect: Effect::Same, by: Cause::Group(by) });
        }
        for cause in causes().of(rule, self.absorbed_by(claim.key.rule)) {
            let from = claim.now.saturating_sub(cause.within);
            // If a rule and an event kind share a name (node-lost), the rule takes precedence.
            let by = self.rules.iter().position(|known| *known.name == *cause.by);
            let Some(by) = by.and_then(|by| u16::try_from(by).ok()) else {
                if self.kinds.get(&(cause.by.as_str(), claim.key.bus)).is_some_and(|seen| *seen >= from) {
                    let by = Cause::Quality(Arc::clone(&cause.text));
                    return Some(Explanation { effect: cause.effect, by });
                }
                continue;
            };
            let node = if cause.is_on_node { claim.key.node } else { None };
            if let Some((place, seen)) = self.latest.get(&(by, claim.key.bus, node))
                && let Some(group) = self.groups.get(*place)
                && (*seen >= from || cause.effect == Effect::Same && self.is_ongoing(*place))
            {
                return Some(Explanation { effect: cause.effect, by: Cause::Group(group.id) });
            }
        }
        None
    }

    /// Links findings to causes that were reported after them, by the times of their first occurrences.
    pub(super) fn link_late_causes(&mut self) {
        let mut links = Vec::new();
        for (place, group) in self.groups.iter().enumerate().filter(|(_, group)| group.cause.is_none()) {
            let Some(rule) = self.rules.get(usize::from(group.key.rule)) else { continue };
            if let Some(by) = self.taken_in_late(rule, group) {
                links.push((place, by, Effect::Same));
                continue;
            }
            let causes = causes().of(rule, self.absorbed_by(group.key.rule));
            for cause in causes.filter(|cause| cause.effect != Effect::Quality) {
                let found = self
                    .latest_of(&cause.by, group, cause.is_on_node)
                    .filter(|by| by.id != group.id && explains(by, group.began().time, cause));
                if let Some(by) = found {
                    links.push((place, by.id, cause.effect));
                    break;
                }
            }
        }
        for (place, by, effect) in links {
            if let Some(group) = self.groups.get_mut(place) {
                group.cause = Some(Cause::Group(by));
                group.is_absorbed |= effect == Effect::Same;
            }
        }
    }

    /// Whether the condition of a finding still holds.
    fn is_ongoing(&self, place: usize) -> bool {
        let is_open = self.groups.get(place).is_some_and(|group| group.is_open);
        is_open && self.courses.get(place).is_some_and(|course| course.is_ongoing)
    }

    fn latest_of(&self, rule: &str, effect: &Group, is_on_node: bool) -> Option<&Group> {
        let place = self.rules.iter().position(|known| *known.name == *rule)?;
        let node = if is_on_node { effect.key.node } else { None };
        let (place, _) = self.latest.get(&(u16::try_from(place).ok()?, effect.key.bus, node))?;
        self.groups.get(*place)
    }
}

/// A finding reported late, at a deadline, may start up to this long after its effect, in ns.
const TOLD_LATE: i64 = 500_000_000;

/// Whether a finding may explain a finding that started at `effect`.
fn explains(cause: &Group, effect: Option<Timestamp>, entry: &CauseEntry) -> bool {
    let (Some(began), Some(effect)) = (cause.began().time, effect) else { return false };
    let after = effect.since(began);
    // Two reports of the same fault may occur in either order, the second one until the first has ended.
    let (earliest, lasted) = if entry.effect == Effect::Same {
        (entry.within, cause.lasted.unwrap_or(0))
    } else {
        (TOLD_LATE.min(entry.within), 0)
    };
    (-earliest..=entry.within.saturating_add(lasted)).contains(&after)
}
