//! Conditions about values are looked at again only once a value changed, and rules that wait for such a condition
//! rest until then.

use std::cell::Cell;

use super::conditions::{Proof, Scene};
use super::plan::Plan;
use crate::profile::device::{Condition, DeviceRule, RuleKind};

/// What was found of the conditions of each rule.
#[derive(Debug)]
pub(super) struct Proofs(Vec<Found>);

/// What was found of the conditions of a rule.
#[derive(Debug)]
struct Found {
    needs: Part,
    during: Part,
    /// It does nothing with a value or PDO while its conditions do not hold.
    may_rest: bool,
    /// Its statement is that `needs` hold, and these are lasting values.
    is_told_by_needs: bool,
}

/// The conditions of a list that are about lasting values.
#[derive(Debug)]
struct Part {
    /// Which, as bits.
    lasting: u64,
    are_all: bool,
    /// Whether they hold, and after which changes that was found: of values in PDOs and messages, and of those in the
    /// node's store.
    proof: Cell<Option<(u64, u64, Proof)>>,
}

impl Proofs {
    /// Nothing was looked at yet.
    pub(super) fn new(plan: &Plan) -> Self {
        Self(plan.device.rules.iter().map(|rule| Found::new(rule, plan)).collect())
    }
}

impl Found {
    fn new(rule: &DeviceRule, plan: &Plan) -> Self {
        let (needs, during) = (Part::new(&rule.needs.0, plan), Part::new(&rule.during.0, plan));
        let remembers = match rule.kind {
            RuleKind::Limit
            | RuleKind::Forbidden
            | RuleKind::Permitted
            | RuleKind::Ascending
            | RuleKind::Never
            | RuleKind::Precondition
            | RuleKind::MaxCount => false,
            RuleKind::Order
            | RuleKind::MinInterval
            | RuleKind::MaxInterval
            | RuleKind::Follow
            | RuleKind::ReservedId
            | RuleKind::Expedited
            | RuleKind::RemoteLength => true,
        };
        let is_told_by_needs = rule.kind == RuleKind::Precondition && needs.are_all;
        Self {
            may_rest: !remembers && (during.lasting != 0 || is_told_by_needs),
            is_told_by_needs,
            needs,
            during,
        }
    }
}

impl Part {
    fn new(conditions: &[Condition], plan: &Plan) -> Self {
        let lasting = (0..u64::BITS).zip(conditions).filter(|(_, condition)| plan.is_lasting(condition));
        let lasting = lasting.fold(0_u64, |all, (place, _)| all | 1 << place);
        let are_all = usize::try_from(lasting.count_ones()).is_ok_and(|count| count == conditions.len());
        Self { lasting, are_all: are_all && lasting != 0, proof: Cell::new(None) }
    }
}

impl Scene<'_> {
    /// Whether all of `needs` hold.
    pub(super) fn needs(&self, rule: &DeviceRule, number: usize) -> Proof {
        match self.own.proofs.0.get(number) {
            Some(Found { needs, .. }) if needs.are_all => self.lasting(needs, &rule.needs.0, rule.channel),
            _ => self.all(&rule.needs.0, rule.channel),
        }
    }

    /// Whether `while` is proven.
    pub(super) fn holds_while(&self, rule: &DeviceRule, number: usize) -> bool {
        let conditions = &rule.during.0;
        if conditions.is_empty() {
            return true;
        }
        let Some(Found { during, .. }) = self.own.proofs.0.get(number) else { return false };
        (during.lasting == 0 || self.lasting(during, conditions, rule.channel) == Proof::Holds)
            && (during.are_all || self.all(conditions, rule.channel) == Proof::Holds)
    }

    /// Whether a rule does nothing with a value or PDO, as its conditions are.
    #[inline]
    pub(super) fn rests(&self, number: usize) -> bool {
        self.own.proofs.0.get(number).is_some_and(|found| found.may_rest && self.is_at_rest(found, number))
    }

    #[inline]
    fn is_at_rest(&self, found: &Found, number: usize) -> bool {
        let proof = |part: &Part, of: fn(&DeviceRule) -> &[Condition]| {
            self.known(part).or_else(|| {
                let (rule, _) = self.own.plan.rule(number)?;
                Some(self.lasting(part, of(rule), rule.channel))
            })
        };
        found.during.lasting != 0 && proof(&found.during, |rule| &rule.during.0) != Some(Proof::Holds)
            || found.is_told_by_needs && proof(&found.needs, |rule| &rule.needs.0) == Some(Proof::Unknown)
    }

    /// What was found of lasting conditions, where nothing changed since.
    #[inline]
    fn known(&self, part: &Part) -> Option<Proof> {
        let (seen, stored, proof) = part.proof.get()?;
        (seen == self.own.seen.changes && stored == self.node.store().changes()).then_some(proof)
    }

    /// Whether the lasting ones of some conditions hold.
    fn lasting(&self, part: &Part, conditions: &[Condition], channel: Option<u8>) -> Proof {
        if let Some(known) = self.known(part) {
            return known;
        }
        let lasting = (0..u64::BITS).zip(conditions).filter(|(place, _)| part.lasting >> place & 1 == 1);
        let proof = self.of(lasting.map(|(_, condition)| condition), channel);
        part.proof.set(Some((self.own.seen.changes, self.node.store().changes(), proof)));
        proof
    }
}
