//! State machines of a device: the reported state, and the state that the control word commands.

use super::node::Node;
use super::state_machine::{is_triggered_by, leads_to, leave_text};
use crate::profile::device::StateDefinition;

/// Time in ns after which a fault reset bit that stays 1 is reported as held.
const HELD: i64 = 300_000_000;

/// Max time in ns from a control word to the transition that it commands. A device that still reports its state
/// later does not execute the command.
const TRANSITION: i64 = 1_000_000_000;

impl Node {
    /// State reported by the machine `place`.
    pub fn reported_state(&self, place: usize) -> Option<&StateDefinition> {
        let known = self.behaviour.machines.get(place).filter(|known| !known.is_old)?;
        let state = known.state?;
        self.device.machines.get(place)?.states.get(usize::from(state))
    }

    /// First status word of the machine `place` without a defined state, masked, and its frame.
    pub fn undefined_state(&self, place: usize) -> Option<(u64, u64)> {
        self.behaviour.machines.get(place)?.undefined
    }

    /// Whether the present control word leads from the reported state to one of `states`, and the device may still
    /// be on its way there.
    pub(in crate::session) fn is_commanded(&self, place: usize, states: &[String], now: i64) -> bool {
        let (Some(known), Some(machine)) =
            (self.behaviour.machines.get(place), self.device.machines.get(place))
        else {
            return false;
        };
        let Some(from) = self.reported_state(place) else { return false };
        if now.saturating_sub(known.since.max(known.control_since)) > TRANSITION {
            return false;
        }
        let control = known.control.unwrap_or(0);
        states.iter().any(|to| leads_to(machine, &from.name, to, control, known.rising))
    }

    /// Last control word sent to a machine; `None` if none was seen.
    pub fn control_word(&self, machine: usize) -> Option<u64> {
        self.behaviour.machines.get(machine)?.control
    }

    /// State reached from the reported one with the last control word, without a 0 → 1 edge of any bit.
    pub fn commanded_state(&self, place: usize) -> Option<&StateDefinition> {
        let control = self.control_word(place)?;
        let machine = self.device.machines.get(place)?;
        let mut state = self.reported_state(place)?;
        // The number of steps is limited, because the transitions of a profile may form a loop.
        for _ in 0..machine.states.len() {
            let mut out = machine.transitions.iter().filter(|it| it.from.0.contains(&state.name));
            let Some(next) = out.find(|it| it.edge == 0 && is_triggered_by(it, control, 0)) else { break };
            state = machine.states.iter().find(|state| state.name == next.to)?;
        }
        Some(state)
    }

    /// Whether a fault persists because the reset bit, which needs a 0 → 1 edge, is held at 1.
    pub fn is_reset_held(&self, place: usize, now: i64) -> bool {
        let known = self.behaviour.machines.get(place);
        let Some((known, machine)) = known.zip(self.device.machines.get(place)) else { return false };
        let (Some(control), Some(state)) = (known.control, self.reported_state(place)) else { return false };
        let mut out = machine.transitions.iter().filter(|it| it.from.0.contains(&state.name));
        let rests = now.saturating_sub(known.since.max(known.control_since));
        state.fault && rests >= HELD && out.any(|it| it.edge != 0 && control & it.edge == it.edge)
    }

    /// Text of the profile on the control word that leaves the reported fault; `None` without fault or text.
    pub fn way_out(&self, place: usize) -> Option<String> {
        let state = self.reported_state(place).filter(|state| state.fault)?;
        leave_text(self.device.machines.get(place)?, &state.name)
    }

    /// Reported states of all machines, each with its channel.
    pub fn device_states(&self) -> impl Iterator<Item = (Option<u8>, &StateDefinition)> {
        let machines = self.device.machines.iter().enumerate();
        machines.filter_map(|(place, machine)| Some((machine.channel, self.reported_state(place)?)))
    }
}
