//! States of a device: what its machines report, and where its control words lead.

use super::node::Node;
use super::state_machine::{fits, leads, leave};
use crate::profile::device::State;

/// A reset bit that is 1 for so long in a fault is held, in nanoseconds.
const HELD: i64 = 300_000_000;

impl Node {
    /// The state a machine reports.
    pub fn reported_state(&self, place: usize) -> Option<&State> {
        let known = self.behaviour.machines.get(place).filter(|known| !known.is_old)?;
        let state = known.state?;
        self.device.machines.get(place)?.states.get(usize::from(state))
    }

    /// Whether the control word in force leads from the reported state to one of `states`.
    pub(in crate::session) fn is_commanded(&self, place: usize, states: &[String]) -> bool {
        let (Some(known), Some(machine)) =
            (self.behaviour.machines.get(place), self.device.machines.get(place))
        else {
            return false;
        };
        let Some(from) = self.reported_state(place) else { return false };
        let control = known.control.unwrap_or(0);
        states.iter().any(|to| leads(machine, &from.name, to, control, known.rising))
    }

    /// The control word of a machine as sent last on the bus; `None` if none was seen.
    pub fn control_word(&self, machine: usize) -> Option<u64> {
        self.behaviour.machines.get(machine)?.control
    }

    /// Where the control word sent last leads from the reported state, as far as no bit must go from 0 to 1 for it.
    pub fn commanded_state(&self, place: usize) -> Option<&State> {
        let control = self.control_word(place)?;
        let machine = self.device.machines.get(place)?;
        let mut state = self.reported_state(place)?;
        // Bounded, for the transitions of a file may lead in a circle.
        for _ in 0..machine.states.len() {
            let mut out = machine.transitions.iter().filter(|it| it.from.0.contains(&state.name));
            let Some(next) = out.find(|it| it.edge == 0 && fits(it, control, 0)) else { break };
            state = machine.states.iter().find(|state| state.name == next.to)?;
        }
        Some(state)
    }

    /// Whether a fault is not left because a bit that must go from 0 to 1 is held at 1.
    pub fn is_reset_held(&self, place: usize, now: i64) -> bool {
        let known = self.behaviour.machines.get(place);
        let Some((known, machine)) = known.zip(self.device.machines.get(place)) else { return false };
        let (Some(control), Some(state)) = (known.control, self.reported_state(place)) else { return false };
        let mut out = machine.transitions.iter().filter(|it| it.from.0.contains(&state.name));
        let rests = now.saturating_sub(known.since.max(known.control_since));
        state.fault && rests >= HELD && out.any(|it| it.edge != 0 && control & it.edge == it.edge)
    }

    /// What the control word must do to leave the fault a machine reports, where the profile says it in words.
    pub fn way_out(&self, place: usize) -> Option<String> {
        let state = self.reported_state(place).filter(|state| state.fault)?;
        leave(self.device.machines.get(place)?, &state.name)
    }

    /// State names of all machines: channel, state, whether it is a fault, whether set points act in it.
    pub fn device_states(&self) -> impl Iterator<Item = (Option<u8>, &State)> {
        let machines = self.device.machines.iter().enumerate();
        machines.filter_map(|(place, machine)| Some((machine.channel, self.reported_state(place)?)))
    }
}
