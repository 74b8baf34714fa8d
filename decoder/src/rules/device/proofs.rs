//! Cached results of conditions on lasting values: they are evaluated again only after a value changed.

use std::cell::Cell;

use super::plan::RulePlan;
use crate::profile::device::{DeviceCondition, DeviceRule, GateStatus, RuleKind};

/// Cached results by rule, in profile order.
#[derive(Debug)]
pub(super) struct RuleProofs(Vec<RuleProof>);

/// Cached results for the conditions of one rule.
#[derive(Debug)]
pub(super) struct RuleProof {
    pub(super) needs: LastingConditions,
    pub(super) during: LastingConditions,
    /// The rule can skip values and PDOs while its conditions do not hold.
    pub(super) may_rest: bool,
    /// The rule checks `needs`, and all of them are on lasting values.
    pub(super) judges_needs: bool,
}

/// The conditions of a list that are on lasting values.
#[derive(Debug)]
pub(super) struct LastingConditions {
    /// Bit mask of their indices in the list.
    places: u64,
    pub(super) are_all: bool,
    /// Last result.
    proof: Cell<Option<(ProofAge, GateStatus)>>,
}

/// Age of a result: change counts of values in PDOs and messages, and of the node's store.
pub(super) type ProofAge = (u64, u64);

impl RuleProofs {
    pub(super) fn new(plan: &RulePlan) -> Self {
        Self(plan.all_rules().map(|rule| RuleProof::new(rule, plan)).collect())
    }

    #[inline]
    pub(super) fn get(&self, number: usize) -> Option<&RuleProof> {
        self.0.get(number)
    }
}

impl RuleProof {
    fn new(rule: &DeviceRule, plan: &RulePlan) -> Self {
        let needs = LastingConditions::new(&rule.needs.0, plan);
        let during = LastingConditions::new(&rule.during.0, plan);
        let remembers = match rule.kind {
            RuleKind::Limit
            | RuleKind::Forbidden
            | RuleKind::Permitted
            | RuleKind::Ascending
            | RuleKind::Never
            | RuleKind::Precondition
            | RuleKind::MessageLength
            | RuleKind::MaxCount => rule.is_scoped(),
            RuleKind::Order
            | RuleKind::Sequence
            | RuleKind::MinInterval
            | RuleKind::MaxInterval
            | RuleKind::Follow
            | RuleKind::ReservedId
            | RuleKind::Expedited
            | RuleKind::RemoteLength
            | RuleKind::EmcyLength
            | RuleKind::EmcyCode
            | RuleKind::EmcyRegister
            | RuleKind::AbortCode
            | RuleKind::NodeId
            | RuleKind::SourceAddress
            | RuleKind::OnRequest
            | RuleKind::Constant
            | RuleKind::UdsServices => true,
        };
        let judges_needs = rule.kind == RuleKind::Precondition && needs.are_all;
        Self { may_rest: !remembers && (!during.is_empty() || judges_needs), judges_needs, needs, during }
    }
}

impl LastingConditions {
    fn new(conditions: &[DeviceCondition], plan: &RulePlan) -> Self {
        let lasting = (0..u64::BITS).zip(conditions).filter(|(_, condition)| plan.is_lasting(condition));
        let places = lasting.fold(0_u64, |all, (place, _)| all | 1 << place);
        let are_all = usize::try_from(places.count_ones()).is_ok_and(|count| count == conditions.len());
        Self { places, are_all: are_all && places != 0, proof: Cell::new(None) }
    }

    #[inline]
    pub(super) const fn is_empty(&self) -> bool {
        self.places == 0
    }

    /// The conditions of the list that are on lasting values.
    pub(super) fn lasting_of<'c>(
        &self,
        conditions: &'c [DeviceCondition],
    ) -> impl Iterator<Item = &'c DeviceCondition> {
        let numbered = (0..u64::BITS).zip(conditions);
        numbered.filter(|(place, _)| self.places >> place & 1 == 1).map(|(_, condition)| condition)
    }

    /// Last result, if no value has changed since.
    #[inline]
    pub(super) fn cached_status(&self, age: ProofAge) -> Option<GateStatus> {
        self.proof.get().filter(|(known, _)| *known == age).map(|(_, proof)| proof)
    }

    pub(super) fn put_status(&self, age: ProofAge, proof: GateStatus) {
        self.proof.set(Some((age, proof)));
    }
}
