//! State machines of a device, and the states that a control word reaches.

use crate::profile::device::{StateMachine, StateTransition};

/// State of one machine of a node.
#[derive(Debug, Clone, Default)]
pub(in crate::session) struct MachineState {
    /// Index of the reported state.
    pub(in crate::session) state: Option<u8>,
    /// The state was reported before the last boot of the node.
    pub(in crate::session) is_old: bool,
    /// First status word without a defined state, and its frame.
    pub(in crate::session) undefined: Option<(u64, u64)>,
    /// Frame of the last change of state.
    pub(in crate::session) frame: u64,
    /// Slot of the RPDO with the control word.
    pub(in crate::session) slot: Option<usize>,
    /// Monotonic time of that change.
    pub(in crate::session) since: i64,
    /// Last control word.
    pub(in crate::session) control: Option<u64>,
    /// Monotonic time of the last change of the control word.
    pub(in crate::session) control_since: i64,
    /// Bits of the control word with a 0 → 1 edge since the last change of state.
    pub(in crate::session) rising: u64,
    /// States on the path to the commanded state.
    pub(in crate::session) steps: Vec<CommandStep>,
}

#[derive(Debug, Clone)]
pub(in crate::session) struct CommandStep {
    pub(in crate::session) state: u8,
    pub(in crate::session) frame: u64,
    pub(in crate::session) time: i64,
}

/// Text of the profile on the control word that leaves a state.
pub(in crate::session) fn leave_text(machine: &StateMachine, state: &str) -> Option<String> {
    let mut out = machine.transitions.iter().filter(|it| it.from.0.iter().any(|from| from == state));
    out.find_map(|it| it.text.clone())
}

/// Whether a control word triggers a transition.
pub(in crate::session) fn is_triggered_by(transition: &StateTransition, control: u64, rising: u64) -> bool {
    control & transition.mask == transition.value & transition.mask
        && rising & transition.edge == transition.edge
}

/// Whether a control word leads from one state to another, also over intermediate states.
pub(in crate::session) fn leads_to(
    machine: &StateMachine,
    from: &str,
    to: &str,
    control: u64,
    rising: u64,
) -> bool {
    let mut reached = vec![from];
    let mut next = 0;
    while let Some(state) = reached.get(next).copied() {
        next += 1;
        for it in machine.transitions.iter().filter(|it| it.from.0.iter().any(|own| own == state)) {
            if is_triggered_by(it, control, rising) && !reached.contains(&it.to.as_str()) {
                if it.to == to {
                    return true;
                }
                reached.push(&it.to);
            }
        }
    }
    false
}

/// Whether the control word leads to a further state without an edge.
pub(in crate::session) fn leads_further(machine: &StateMachine, from: &str, control: u64) -> bool {
    let mut out = machine.transitions.iter().filter(|it| it.from.0.iter().any(|own| own == from));
    out.any(|it| it.to != from && it.edge == 0 && is_triggered_by(it, control, 0))
}
