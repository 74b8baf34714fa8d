//! Errors that a device reports by EMCY.

use std::collections::BTreeMap;

use crate::event::{EmcyAction, Event, EventKind, Kind, StateCertainty};
use crate::finding::FindingSubject;
use crate::profile::suggested_error_text;
use crate::query::record;
use crate::rules::rule::declare_rule;
use crate::rules::{Rule, RuleContext, RulePolicy};
use crate::wire::canopen::NmtState;
use crate::wire::{NodeId, NodeSet};
use crate::words::count_noun;

declare_rule! {
    /// # What it checks
    /// A device sends an EMCY with a code other than 0000. There is one finding per code, open until EMCY
    /// 0000. A device that starts has 5 s after its boot to clear an error, at most until it is operational, and
    /// without timestamps until the end of the capture, if a heartbeat follows the error.
    ///
    /// # Why it matters
    /// The device itself reports an error.
    ///
    /// # Source
    /// CiA 301 §7.2.7 (emergency object); error codes: manual of the device.
    ///
    /// # What to look at first
    /// Look up the error code in the device manual. `cobscope explain` shows its meaning, and `cobscope why`
    /// the events before it.
    ///
    /// # Mutation
    /// insert an EMCY with a generic error
    "emcy-raised", Warning, "error reported by EMCY",
    kinds: [Kind::Emcy, Kind::NmtState, Kind::BootUp, Kind::Heartbeat],
    needs: "an EMCY",
    word: "EMCY",
}

/// Maximum number of open error codes of all nodes; the findings of further codes stay open.
const OPEN_LIMIT: usize = 4096;

/// Time in ns after its boot in which a device may clear an error that it reported at power-on.
const START: i64 = 5_000_000_000;

/// An error reported before its node was operational. An EMCY is sent once (CiA 301 §7.2.7.1), so it is not
/// reported again.
struct EarlyError {
    node: NodeId,
    code: u16,
    due: i64,
    event: Event,
    /// Heartbeats of the node since then: the clock of a capture without timestamps.
    heartbeats: u32,
}

/// Event that shows a finding.
#[derive(Clone, Copy)]
enum ShownEvent<'a> {
    /// The EMCY itself.
    Directly,
    /// The state operational, while the error is active.
    Operational(&'a Event),
    /// No event: [`START`] has passed.
    Late,
    /// The end of a capture without timestamps, after this number of heartbeats.
    End(u32),
}

#[derive(Default)]
struct EmcyRaised {
    was_operational: NodeSet,
    /// Time of the first event of a node, in the clock of the bus: the boot may be before the capture.
    first: BTreeMap<NodeId, i64>,
    open: Vec<(NodeId, u16)>,
    early: Vec<EarlyError>,
}

fn new(_policy: &RulePolicy) -> EmcyRaised {
    EmcyRaised::default()
}

impl EmcyRaised {
    fn on_raised(&mut self, event: &Event, node: NodeId, code: u16, context: &mut RuleContext<'_>) {
        if self.early.iter().any(|early| (early.node, early.code) == (node, code)) {
            return;
        }
        match self.rest_of_start(event, node, context).filter(|rest| *rest > 0) {
            Some(rest) => self.wait_for_operational(event, (node, code), rest, context),
            None => self.report_error(event, ShownEvent::Directly, (node, code), context),
        }
    }

    /// Rest of [`START`] in ns; `None` for a node that was operational, or whose state is unknown.
    fn rest_of_start(&self, event: &Event, node: NodeId, context: &RuleContext<'_>) -> Option<i64> {
        let known = context.event_node(event).filter(|known| known.nmt().is_some())?;
        if self.was_operational.contains(node) {
            return None;
        }
        let boot = known.last_boot().map(|(_, boot)| boot).or_else(|| self.first.get(&node).copied());
        let age = boot.map_or(0, |boot| context.bus.now().saturating_sub(boot));
        Some(START.saturating_sub(age))
    }

    /// Waits until the node is operational or the rest of [`START`] has passed.
    fn wait_for_operational(
        &mut self,
        event: &Event,
        (node, code): (NodeId, u16),
        rest: i64,
        context: &mut RuleContext<'_>,
    ) {
        if self.early.len() >= OPEN_LIMIT {
            return;
        }
        let due = context.now.saturating_add(rest);
        self.early.push(EarlyError { node, code, due, event: event.clone(), heartbeats: 0 });
        context.wake_at(due, 0);
    }

    /// Reports errors of a starting node that were not cleared.
    fn report_early(
        &mut self,
        shown: ShownEvent<'_>,
        is_due: impl Fn(&EarlyError) -> bool,
        context: &mut RuleContext<'_>,
    ) {
        let due: Vec<EarlyError> = self.early.extract_if(.., |early| is_due(early)).collect();
        for early in due {
            self.report_error(&early.event, shown, (early.node, early.code), context);
        }
    }

    /// Reports an error at the time of its EMCY: the duration and the frame of the finding are those of this time.
    fn report_error(
        &mut self,
        event: &Event,
        shown: ShownEvent<'_>,
        (node, code): (NodeId, u16),
        context: &mut RuleContext<'_>,
    ) {
        if self.open.len() < OPEN_LIMIT && !self.open.contains(&(node, code)) {
            self.open.push((node, code));
        }
        let device = record::event_device(event, context.bus);
        let is_open = !context.bus.protocols().is_settled(Some(node));
        let (is_presumed, until) = match shown {
            ShownEvent::Directly => (event.presumed, String::new()),
            ShownEvent::Operational(shown) => {
                (shown.presumed, "; reported before the node was operational, not cleared since".into())
            }
            ShownEvent::Late => (is_open, "; reported at power-on, not cleared within 5 s".into()),
            ShownEvent::End(heartbeats) => {
                let count = count_noun(heartbeats, "heartbeat");
                (is_open, format!("; reported at power-on, not cleared in the {count} after it"))
            }
        };
        let alarm = context
            .start_finding(event)
            .with_presumption(is_presumed)
            .mark_ongoing()
            .with_subject(FindingSubject::Code(code));
        alarm.report_finding(|| {
            match suggested_error_text(code).filter(|_| device.error_entry(code).is_none()) {
                Some((profile, text)) => {
                    format!("EMCY {code:04X} {}; {profile}: {text}?{until}", device.error_text(code))
                }
                None => format!("EMCY {code:04X} {}{until}", device.error_text(code)),
            }
        });
    }

    fn all_gone(&mut self, node: NodeId, context: &mut RuleContext<'_>) {
        self.early.retain(|early| early.node != node);
        for (_, code) in self.open.extract_if(.., |(of, _)| *of == node) {
            context.close_condition(Some(node), FindingSubject::Code(code));
        }
    }
}

impl Rule for EmcyRaised {
    fn on_event(&mut self, event: &Event, context: &mut RuleContext<'_>) {
        let Some(node) = event.node else { return };
        self.first.entry(node).or_insert(context.bus.now());
        match &event.kind {
            EventKind::NmtState(change) if change.to == NmtState::Operational => {
                self.was_operational.insert(node);
                if change.certainty == StateCertainty::Confirmed {
                    self.report_early(ShownEvent::Operational(event), |early| early.node == node, context);
                }
            }
            EventKind::Heartbeat { .. } => {
                for early in self.early.iter_mut().filter(|early| early.node == node) {
                    early.heartbeats = early.heartbeats.saturating_add(1);
                }
            }
            // A restart ends the errors of the time before it.
            EventKind::BootUp { .. } => self.early.retain(|early| early.node != node),
            EventKind::Emcy(emergency) => match (emergency.action, emergency.code) {
                (EmcyAction::Raised, Some(code)) => self.on_raised(event, node, code, context),
                (EmcyAction::Cleared, _) => context.count_pass(),
                _ => {
                    context.count_pass();
                    self.all_gone(node, context);
                }
            },
            _ => {}
        }
    }

    /// Without timestamps, the heartbeats of the node are the clock.
    fn on_end(&mut self, context: &mut RuleContext<'_>) {
        if context.has_time {
            return;
        }
        for early in std::mem::take(&mut self.early).into_iter().filter(|early| early.heartbeats > 0) {
            let shown = ShownEvent::End(early.heartbeats);
            self.report_error(&early.event, shown, (early.node, early.code), context);
        }
    }

    fn on_wake(&mut self, _token: u64, context: &mut RuleContext<'_>) {
        let now = context.now;
        self.report_early(ShownEvent::Late, |early| early.due <= now, context);
    }
}
