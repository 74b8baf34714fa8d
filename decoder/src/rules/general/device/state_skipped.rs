//! Device states reached with fewer control words than transitions.

use super::machines::{is_control, machine_subject, state_machine, steps_between};
use crate::event::{DeviceCause, DeviceState, Event, EventKind, Kind};
use crate::rules::rule::declare_rule;
use crate::rules::{Rule, RuleContext, RulePolicy};
use crate::wire::{NodeId, NodeMap};

declare_rule! {
    /// # What it checks
    /// Within two intervals of its TPDO, a device executed more transitions than control words were sent. Applies
    /// only to devices whose manual allows one transition per control word. Changes with another cause, control
    /// words by SDO and more than three transitions are exempt.
    ///
    /// # Why it matters
    /// The device does not execute its state machine: outputs may be active earlier than commanded.
    ///
    /// # Source
    /// State machine in the device manual.
    ///
    /// # What to look at first
    /// Check for a second master that sends control words, also on another identifier or by SDO.
    ///
    /// # Mutation
    /// drop the TPDOs with the intermediate states and all control words but one
    "state-skipped", Warning, "device state skipped",
    kinds: [Kind::DeviceState, Kind::SdoTransfer],
    needs: "a profile with one transition per control word, and a commanded transition",
    word: "STATE",
}

/// Last change of state of a machine: frame of its TPDO, and number of transitions.
#[derive(Default, Clone, Copy)]
struct LastChange {
    frame: u64,
    steps: usize,
}

#[derive(Default)]
struct StateSkipped {
    /// Frame of the last control word by SDO.
    written: NodeMap<u64>,
    changes: NodeMap<Vec<LastChange>>,
}

fn new(_policy: &RulePolicy) -> StateSkipped {
    StateSkipped::default()
}

impl StateSkipped {
    /// Number of transitions since the TPDO before the previous one. A control word just before the previous
    /// TPDO may take effect after it, so the check covers two intervals.
    fn steps_in_two_intervals(&mut self, id: NodeId, place: usize, now: LastChange, previous: u64) -> usize {
        let Some(all) = self.changes.entry(id) else { return 0 };
        if all.len() <= place {
            all.resize(place + 1, LastChange::default());
        }
        let Some(known) = all.get_mut(place) else { return 0 };
        let before = std::mem::replace(known, now);
        now.steps + if before.frame == previous { before.steps } else { 0 }
    }

    fn on_state(&mut self, event: &Event, id: NodeId, state: &DeviceState, context: &mut RuleContext<'_>) {
        let Some(node) = context.event_node(event) else { return };
        let Some((place, machine)) = state_machine(node, state).filter(|(_, machine)| machine.single_step)
        else {
            return;
        };
        let frame = event.frames.last;
        let Some(status) = context.traffic.current_slot().filter(|slot| slot.frames.0 == frame) else {
            return;
        };
        let own = state.from.as_deref().and_then(|from| steps_between(machine, from, &state.to));
        let change = LastChange { frame, steps: own.unwrap_or(0) };
        let steps = self.steps_in_two_intervals(id, place, change, status.frames.1);
        let since = status.earlier;
        let is_complete = since > 0 || node.boot_count() > 0;
        let is_written = self.written.get(id).is_some_and(|frame| *frame > since);
        let is_commanded = state.cause == DeviceCause::ControlWord && own.is_some();
        if !is_commanded || !is_complete || is_written || context.is_across_hole(since) {
            return;
        }
        let control = context.bus.control_identifier(id, place).and_then(|id| context.pdos_of(id));
        let Some(control) = control else { return };
        let frames = [control.frames.0, control.frames.1, control.earlier];
        let words = frames.iter().filter(|frame| **frame > since).count();
        // Further control words are not counted. A single transition is late, not skipped.
        if words >= steps || words == frames.len() || own == Some(1) {
            return context.count_pass();
        }
        context.start_finding(event).with_subject(machine_subject(state.channel)).report_finding(|| {
            let (from, to) = (state.from.as_deref().unwrap_or_default(), &state.to);
            let since = if since > 0 { format!("since {{{since}}}") } else { "since the boot-up".to_owned() };
            format!("{from} → {to}: {steps} transitions with {words} × control word {since} (max one transition each)")
        });
    }
}

impl Rule for StateSkipped {
    fn on_event(&mut self, event: &Event, context: &mut RuleContext<'_>) {
        match (&event.kind, event.node) {
            (EventKind::DeviceState(state), Some(node)) => self.on_state(event, node, state, context),
            (EventKind::SdoTransfer(transfer), Some(node)) if is_control(event, transfer, context) => {
                self.written.insert(node, event.frames.last);
            }
            _ => {}
        }
    }
}
