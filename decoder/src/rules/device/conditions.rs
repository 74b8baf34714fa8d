//! Evaluation of the conditions of rules.

use super::facts::ProvenFacts;
use super::proofs::{LastingConditions, ProofAge, RuleProof};
use crate::profile::device::{DeviceCondition, DeviceRule, GateStatus, evaluate_all};
use crate::wire::canopen::ObjectAddress;

impl ProvenFacts<'_> {
    /// Status of `needs`.
    pub(super) fn needs_status(&self, rule: &DeviceRule, number: usize) -> GateStatus {
        match self.own.proofs.get(number) {
            Some(RuleProof { needs, .. }) if needs.are_all => {
                self.lasting_status(needs, &rule.needs.0, rule.channel)
            }
            _ => evaluate_all(&rule.needs.0, self, rule.channel),
        }
    }

    /// Whether `while` is proven.
    pub(super) fn holds_while(&self, rule: &DeviceRule, number: usize) -> bool {
        let conditions = &rule.during.0;
        if conditions.is_empty() {
            return true;
        }
        let Some(RuleProof { during, .. }) = self.own.proofs.get(number) else { return false };
        (during.is_empty() || self.lasting_status(during, conditions, rule.channel) == GateStatus::Open)
            && (during.are_all || evaluate_all(conditions, self, rule.channel) == GateStatus::Open)
    }

    /// Whether a rule can skip a value or PDO, because its conditions do not hold.
    #[inline]
    pub(super) fn can_rest(&self, number: usize) -> bool {
        self.own.proofs.get(number).is_some_and(|proof| proof.may_rest && self.is_at_rest(proof, number))
    }

    #[inline]
    fn is_at_rest(&self, proof: &RuleProof, number: usize) -> bool {
        let status = |part: &LastingConditions, of: fn(&DeviceRule) -> &[DeviceCondition]| {
            part.cached_status(self.proof_age()).or_else(|| {
                let (rule, _) = self.own.plan.active_rule(number)?;
                Some(self.lasting_status(part, of(rule), rule.channel))
            })
        };
        !proof.during.is_empty() && status(&proof.during, |rule| &rule.during.0) != Some(GateStatus::Open)
            || proof.judges_needs && status(&proof.needs, |rule| &rule.needs.0) == Some(GateStatus::Unknown)
    }

    #[inline]
    pub(super) fn proof_age(&self) -> ProofAge {
        (self.own.last.changes, self.node.store().change_count())
    }

    /// Status of the conditions on lasting values, cached.
    fn lasting_status(
        &self,
        part: &LastingConditions,
        conditions: &[DeviceCondition],
        channel: Option<u8>,
    ) -> GateStatus {
        if let Some(known) = part.cached_status(self.proof_age()) {
            return known;
        }
        let status = evaluate_all(part.lasting_of(conditions), self, channel);
        part.put_status(self.proof_age(), status);
        status
    }

    /// First condition that is proven not to hold: its object, and the actual fact as text.
    pub(super) fn first_unmet(
        &self,
        conditions: &[DeviceCondition],
        channel: Option<u8>,
    ) -> Option<(Option<ObjectAddress>, String)> {
        let is_unmet =
            |condition: &&DeviceCondition| condition.evaluate_condition(self, channel) == GateStatus::Closed;
        let unmet = conditions.iter().find(is_unmet)?;
        Some((unmet.object(), self.fact_text(unmet, channel)))
    }

    /// Actual fact for a condition that does not hold.
    fn fact_text(&self, condition: &DeviceCondition, channel: Option<u8>) -> String {
        if let Some(object) = condition.object() {
            return self.value_text(object);
        }
        match condition {
            DeviceCondition::Nmt(_) => self.node.nmt().map_or("", |nmt| nmt.state.name()).to_owned(),
            DeviceCondition::State(_) => {
                let mut states = self.node.device_states();
                let own = states.find(|(of, _)| channel.is_none() || of.is_none() || *of == channel);
                own.map_or_else(String::new, |(_, state)| format!("state {}", state.name))
            }
            DeviceCondition::Sync => "no SYNC".to_owned(),
            DeviceCondition::NoError => {
                let codes: Vec<_> =
                    self.node.active_errors().iter().map(|code| format!("EMCY {code:04X}")).collect();
                codes.join(", ")
            }
            DeviceCondition::NoProcedure => {
                let names: Vec<_> = self.node.procedures().map(|it| it.name.as_str()).collect();
                format!("procedure running: {}", names.join(", "))
            }
            DeviceCondition::Other(_) => "no other device is ready".to_owned(),
            DeviceCondition::Alone => "other nodes on the bus".to_owned(),
            _ => String::new(),
        }
    }
}
