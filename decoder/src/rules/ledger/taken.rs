//! Rules of devices: registered when a device is identified; they absorb findings that have the same cause.

use std::sync::Arc;

use super::causes::cause_table;
use super::{DefectClaim, FindingLedger, RuleRelations};
use crate::bus_file::NodeRule;
use crate::finding::{
    CheckTally, FindingCause, FindingGroup, FindingSubject, GroupKey, RuleInfo, RuleOrigin,
};
use crate::profile::device::DeviceRule;
use crate::wire::NodeId;

/// Maximum number of device rules of a capture.
const DEVICE_RULE_LIMIT: usize = 4096;

/// Maximum time between a finding and its absorbing finding, in ns. The result of a calibration may be
/// reported a minute after a fault at its start.
const WINDOW: i64 = 60_000_000_000;

impl FindingLedger {
    /// Registers a device rule and returns its index; None if it is switched off or [`DEVICE_RULE_LIMIT`] is
    /// reached.
    pub(in crate::rules) fn add_rule(&mut self, mut info: RuleInfo, relations: RuleRelations) -> Option<u16> {
        if let Some(place) = self.rules.iter().position(|known| known.name == info.name) {
            let is_on = self.rules.get(place).is_some_and(|rule| rule.is_on);
            let place = u16::try_from(place).ok().filter(|_| is_on)?;
            // A rule of the bus file is known before its node.
            if !self.taken.by_rule.contains_key(&place) {
                self.relate_rule(place, relations);
            }
            return Some(place);
        }
        let own = self.rules.iter().filter(|rule| rule.origin == RuleOrigin::Device).count();
        let place = u16::try_from(self.rules.len()).ok().filter(|_| own < DEVICE_RULE_LIMIT)?;
        info.is_on = !self.policy.is_off(&info.name);
        info.severity = self.policy.severity_of(&info.name).unwrap_or(info.severity);
        let is_on = info.is_on;
        self.rules.push(info);
        self.tallies.push(CheckTally::default());
        if !is_on {
            return None;
        }
        self.relate_rule(place, relations);
        Some(place)
    }

    fn relate_rule(&mut self, place: u16, relations: RuleRelations) {
        for effect in &relations.takes_in {
            self.taken.by_effect.entry(Arc::clone(effect)).or_default().push(place);
        }
        self.taken.by_rule.insert(place, relations);
    }

    /// Rules of the bus file for a node.
    pub(in crate::rules) fn node_rules(&self, bus: &str, node: NodeId) -> Vec<Arc<DeviceRule>> {
        let is_meant =
            |rule: &&NodeRule| rule.node == node && rule.bus.as_deref().is_none_or(|own| own == bus);
        self.policy.node_rules.iter().filter(is_meant).map(|rule| Arc::clone(&rule.rule)).collect()
    }

    /// Rules whose findings a device rule absorbs.
    pub(super) fn absorbed_by(&self, rule: u16) -> &[Arc<str>] {
        self.taken.by_rule.get(&rule).map_or(&[], |it| it.takes_in.as_slice())
    }

    /// Finding of a device rule that absorbs this defect at its time.
    pub(super) fn taken_in_by(&self, rule: &RuleInfo, claim: &DefectClaim) -> Option<u64> {
        let place = self.absorbing_group(rule, &claim.key)?;
        let seen = self.courses.get(place)?.last;
        (seen >= claim.now.saturating_sub(WINDOW)).then(|| self.groups.get(place).map(|group| group.id))?
    }

    /// Like [`Self::taken_in_by`] at the end of the capture: the absorbing finding may have been reported
    /// later.
    pub(super) fn taken_in_late(&self, rule: &RuleInfo, group: &FindingGroup) -> Option<u64> {
        let by = self.groups.get(self.absorbing_group(rule, &group.key)?)?;
        let (one, other) = group.first_occurrence().time.zip(by.first_occurrence().time)?;
        (one.since(other).unsigned_abs() <= WINDOW.unsigned_abs()).then_some(by.id)
    }

    /// Names in `follows` of a device rule.
    pub(super) fn followed_names(&self, rule: u16) -> &[Arc<str>] {
        self.taken.by_rule.get(&rule).map_or(&[], |it| it.follows.as_slice())
    }

    /// Finding or fact in `follows` of a device rule that explains this defect: it lasts, or was recent.
    pub(super) fn followed_cause(&self, claim: &DefectClaim) -> Option<FindingCause> {
        let follows = &self.taken.by_rule.get(&claim.key.rule)?.follows;
        let from = claim.now.saturating_sub(cause_table().follows.within);
        follows.iter().find_map(|name| {
            let Some(rule) = self.rules.iter().position(|rule| rule.name == *name) else {
                return self.facts.find_fact(name, claim.key.bus, None, from).map(FindingCause::Fact);
            };
            let key = (u16::try_from(rule).ok()?, claim.key.bus, claim.key.node);
            let (place, seen) = *self.latest.get(&key)?;
            let group = self.groups.get(place)?;
            (seen >= from || self.is_ongoing(place)).then_some(FindingCause::Group(group.id))
        })
    }

    /// Index of the absorbing finding at the same node.
    fn absorbing_group(&self, rule: &RuleInfo, key: &GroupKey) -> Option<usize> {
        self.taken.by_effect.get(&rule.name)?.iter().find_map(|by| self.of_same_matter(*by, key))
    }

    /// Index of a finding of a rule at the same node: about the same subject, else not about a different
    /// object.
    fn of_same_matter(&self, rule: u16, key: &GroupKey) -> Option<usize> {
        let latest = self.latest.get(&(rule, key.bus, key.node)).map(|(place, _)| *place);
        let place = self.by_key.get(&GroupKey { rule, ..key.clone() }).copied().or(latest)?;
        let about = &self.groups.get(place)?.key.about;
        // A finding about another object has another cause.
        let is_other = matches!((about, &key.about), (FindingSubject::Object(one), FindingSubject::Object(other)) if one != other);
        (!is_other).then_some(place)
    }

    /// Absorbs earlier findings when a finding of a rule with `takes_in` opens.
    pub(super) fn take_in(&mut self, claim: &DefectClaim) {
        let Some(effects) =
            self.taken.by_rule.get(&claim.key.rule).map(|it| &it.takes_in).filter(|it| !it.is_empty())
        else {
            return;
        };
        let Some(id) =
            self.by_key.get(&claim.key).and_then(|place| self.groups.get(*place)).map(|group| group.id)
        else {
            return;
        };
        let known = |effect: &Arc<str>| self.rules.iter().position(|rule| rule.name == *effect);
        let rules = effects.iter().filter_map(known).filter_map(|rule| u16::try_from(rule).ok());
        let places: Vec<_> = rules.filter_map(|rule| self.of_same_matter(rule, &claim.key)).collect();
        for place in places {
            let is_recent =
                self.courses.get(place).is_some_and(|course| course.last >= claim.now.saturating_sub(WINDOW));
            if let Some(group) = self.groups.get_mut(place).filter(|group| is_recent && group.cause.is_none())
            {
                group.cause = Some(FindingCause::Group(id));
                group.is_absorbed = true;
            }
        }
    }
}
