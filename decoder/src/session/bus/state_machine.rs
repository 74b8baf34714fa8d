//! State machines of a device as far as they are known, and where a control word leads.

use crate::profile::device::{Machine, Transition};

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
