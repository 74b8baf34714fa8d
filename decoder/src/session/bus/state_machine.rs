//! State machines of a device as far as they are known, and where a control word leads.

use super::node::Node;
use crate::profile::device::{Machine, State, Transition};

/// A reset bit that is 1 for so long in a fault is held, in nanoseconds.
const HELD: i64 = 300_000_000;

/// What is known of one machine of a node.
#[derive(Debug, Clone, Default)]
pub(in crate::session) struct MachineState {
    /// Place of the reported state.
    pub(in crate::session) state: Option<u8>,
    /// Reported before the node's last start.
    pub(in crate::session) is_old: bool,
    /// Frame of the last change of state.
    pub(in crate::session) frame: u64,
    /// Slot of the RPDO that carries its control word.
    pub(in crate::session) slot: Option<usize>,
    /// Monotonic time of that change.
    pub(in crate::session) since: i64,
    /// Control word as sent last.
    pub(in crate::session) control: Option<u64>,
    /// Monotonic time since which it is that.
    pub(in crate::session) control_since: i64,
    /// Bits of it that went from 0 to 1 since the last change of state.
    pub(in crate::session) rising: u64,
    /// The way to the commanded state.
    pub(in crate::session) steps: Vec<Step>,
}

#[derive(Debug, Clone)]
pub(in crate::session) struct Step {
    pub(in crate::session) state: u8,
    pub(in crate::session) frame: u64,
    pub(in crate::session) time: i64,
}

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

/// What the control word must do to leave a state, where the profile says it in words.
pub(in crate::session) fn leave(machine: &Machine, state: &str) -> Option<String> {
    let mut out = machine.transitions.iter().filter(|it| it.from.0.iter().any(|from| from == state));
    out.find_map(|it| it.text.clone())
}

/// Whether a control word brings a transition about.
pub(in crate::session) fn fits(transition: &Transition, control: u64, rising: u64) -> bool {
    control & transition.mask == transition.value & transition.mask
        && rising & transition.edge == transition.edge
}

/// Whether a control word leads from one state to another, over others too.
pub(in crate::session) fn leads(machine: &Machine, from: &str, to: &str, control: u64, rising: u64) -> bool {
    let mut reached = vec![from];
    let mut next = 0;
    while let Some(state) = reached.get(next).copied() {
        next += 1;
        for it in machine.transitions.iter().filter(|it| it.from.0.iter().any(|own| own == state)) {
            if fits(it, control, rising) && !reached.contains(&it.to.as_str()) {
                if it.to == to {
                    return true;
                }
                reached.push(&it.to);
            }
        }
    }
    false
}

/// Whether the control word leads further from a state, without an edge.
pub(in crate::session) fn goes_on(machine: &Machine, from: &str, control: u64) -> bool {
    let mut out = machine.transitions.iter().filter(|it| it.from.0.iter().any(|own| own == from));
    out.any(|it| it.to != from && it.edge == 0 && fits(it, control, 0))
}
