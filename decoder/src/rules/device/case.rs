//! One rule at one node, with functions shared by all kinds of rules.

use super::describe::about_event;
use super::facts::ProvenFacts;
use super::progress::RuleProgress;
use crate::event::{Event, FrameRange};
use crate::profile::device::{DeviceRule, ProfileTrigger, TriggerEvent};
use crate::rules::RuleContext;
use crate::rules::context::FindingAlarm;
use crate::wire::canopen::ObjectAddress;

/// One rule at one node with the event to check.
#[derive(Clone, Copy)]
pub(super) struct RuleCase<'a> {
    pub(super) facts: ProvenFacts<'a>,
    pub(super) rule: &'a DeviceRule,
    /// Index of the rule in the device profile.
    pub(super) number: usize,
    /// Event to check; None at a deadline.
    pub(super) event: Option<&'a Event>,
    pub(super) frames: FrameRange,
    /// Assumption on which the value to check depends.
    pub(super) assumed: Option<&'static str>,
}

impl RuleCase<'_> {
    /// Whether the rule applies now: `while` is proven.
    pub(super) fn is_due(&self) -> bool {
        self.facts.holds_while(self.rule, self.number)
    }

    /// Trigger of `on` that the event matches.
    pub(super) fn matching_trigger(&self, event: &TriggerEvent<'_>) -> Option<&ProfileTrigger> {
        self.rule.on.0.iter().find(|trigger| trigger.is_attempted_by(event))
    }

    /// Time limit of the rule in ns; None if it is unknown or 0.
    pub(super) fn time_limit(&self) -> Option<i64> {
        let milliseconds = match self.rule.ms_of {
            None => self.rule.ms?,
            Some(of) => self.scaled_value(of.object)? * self.rule.times,
        };
        #[expect(clippy::cast_possible_truncation, reason = "saturates")]
        let nanoseconds = (milliseconds * 1e6) as i64;
        (nanoseconds > 0).then_some(nanoseconds)
    }

    /// Proven value of an object in its unit.
    pub(super) fn scaled_value(&self, object: ObjectAddress) -> Option<f64> {
        let raw = self.facts.proven_value(object)?;
        let meaning = self.facts.node.meaning(object);
        if meaning.as_ref().is_some_and(|meaning| meaning.assumed) {
            return None;
        }
        let scaled = meaning.and_then(|meaning| meaning.scaled_value(&meaning.convert_raw(raw)));
        #[expect(clippy::cast_precision_loss, reason = "numbers of few digits")]
        let plain = raw as f64;
        Some(scaled.unwrap_or(plain))
    }

    /// Starts a finding about the event at this node.
    pub(super) fn start_finding<'b, 'c>(
        &self,
        event: &TriggerEvent<'_>,
        context: &'b mut RuleContext<'c>,
    ) -> FindingAlarm<'b, 'c> {
        let node = Some(self.facts.id);
        let alarm = match self.event {
            Some(event) => context.start_finding(event).at_node(node),
            None => context.fail_at(context.now, node, self.frames),
        };
        alarm.with_subject(about_event(event, self.event)).with_assumption(self.assumed)
    }

    /// Sets the deadline and requests a wake-up.
    pub(super) fn wait_until(
        &self,
        progress: &mut RuleProgress,
        deadline: i64,
        context: &mut RuleContext<'_>,
    ) {
        progress.deadline = Some(deadline);
        if progress.wake.is_none_or(|wake| deadline < wake) {
            progress.wake = Some(deadline);
            let token = (self.facts.id.table_place() as u64) << 16 | self.number as u64;
            context.wake_at(deadline, token);
        }
    }
}

/// Object with its own count, if the trigger covers several objects.
pub(super) fn counted_object(event: &TriggerEvent<'_>, trigger: &ProfileTrigger) -> Option<ObjectAddress> {
    match (event, trigger) {
        (TriggerEvent::Value(update), ProfileTrigger::Writes(_)) => Some(update.object),
        _ => None,
    }
}

/// Whether a trigger is a PDO; its absence is proven only while the node sends PDOs.
pub(super) fn waits_for_pdo(triggers: &[ProfileTrigger]) -> bool {
    triggers.iter().any(|trigger| matches!(trigger, ProfileTrigger::Pdo(_)))
}
