//! Rules of devices: they become known while a capture is judged, and take in findings that have the same cause.

use std::sync::Arc;

use super::{Claim, Ledger};
use crate::finding::{About, Cause, Group, Key, RuleInfo, RuleOrigin, Tally};

/// Rules of all devices of a capture, beside the general ones.
const DEVICE_RULE_LIMIT: usize = 4096;

/// What is taken in comes so long before or after, in nanoseconds: how a calibration ended may be told a minute behind
/// what was wrong at its start.
const WINDOW: i64 = 60_000_000_000;

impl Ledger {
    /// The place of a rule of a device, known from now on; `None` where it is switched off, or finds no room.
    pub(in crate::rules) fn add_rule(&mut self, mut info: RuleInfo, takes_in: Vec<Arc<str>>) -> Option<u16> {
        if let Some(place) = self.rules.iter().position(|known| known.name == info.name) {
            let is_on = self.rules.get(place).is_some_and(|rule| rule.is_on);
            return u16::try_from(place).ok().filter(|_| is_on);
        }
        let own = self.rules.iter().filter(|rule| rule.origin == RuleOrigin::Device).count();
        let place = u16::try_from(self.rules.len()).ok().filter(|_| own < DEVICE_RULE_LIMIT)?;
        info.is_on = !self.policy.is_off(&info.name);
        info.severity = self.policy.severity(&info.name).unwrap_or(info.severity);
        let is_on = info.is_on;
        self.rules.push(info);
        self.tallies.push(Tally::default());
        if !is_on {
            return None;
        }
        for effect in &takes_in {
            self.taken.by_effect.entry(Arc::clone(effect)).or_default().push(place);
        }
        self.taken.by_rule.insert(place, takes_in);
        Some(place)
    }

    /// The finding of a device's rule that takes in one of this rule, as it is seen now.
    pub(super) fn taken_in_by(&self, rule: &RuleInfo, claim: &Claim) -> Option<u64> {
        let place = self.taker(rule, &claim.key)?;
        let seen = self.courses.get(place)?.last;
        (seen >= claim.now.saturating_sub(WINDOW)).then(|| self.groups.get(place).map(|group| group.id))?
    }

    /// The same at the end: the one that takes in may have come later.
    pub(super) fn taken_in_late(&self, rule: &RuleInfo, group: &Group) -> Option<u64> {
        let by = self.groups.get(self.taker(rule, &group.key)?)?;
        let (one, other) = group.began().time.zip(by.began().time)?;
        (one.since(other).unsigned_abs() <= WINDOW.unsigned_abs()).then_some(by.id)
    }

    /// Place of the finding at the same node that has the same cause.
    fn taker(&self, rule: &RuleInfo, key: &Key) -> Option<usize> {
        self.taken.by_effect.get(&rule.name)?.iter().find_map(|by| self.of_same_matter(*by, key))
    }

    /// Place of a finding of a rule at the same node: about the same, else about what is no other object.
    fn of_same_matter(&self, rule: u16, key: &Key) -> Option<usize> {
        let latest = self.latest.get(&(rule, key.bus, key.node)).map(|(place, _)| *place);
        let place = self.by_key.get(&Key { rule, ..key.clone() }).copied().or(latest)?;
        let about = &self.groups.get(place)?.key.about;
        // What concerns another object is another matter.
        let is_other =
            matches!((about, &key.about), (About::Object(one), About::Object(other)) if one != other);
        (!is_other).then_some(place)
    }

    /// A finding opens whose rule takes in others: those that came before it belong to it from now on.
    pub(super) fn take_in(&mut self, claim: &Claim) {
        let Some(effects) = self.taken.by_rule.get(&claim.key.rule).filter(|effects| !effects.is_empty())
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
                group.cause = Some(Cause::Group(id));
                group.is_absorbed = true;
            }
        }
    }
}
