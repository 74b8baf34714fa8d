//! Things to check: first those from the device manual, then those of code tables, then general ones.

use super::fault::FaultKind;
use super::state::NodeState;
use crate::finding::{Advice, AdviceSource};
use crate::profile::{self, DeviceProfile};
use crate::wire::canopen::NmtState;

/// Maximum number of things to check.
const COUNT: usize = 3;

/// Input for the list of checks.
pub(super) struct FaultContext<'a> {
    /// Faults in order of time.
    pub(super) kinds: &'a [FaultKind],
    /// The device, if known.
    pub(super) device: Option<&'a DeviceProfile>,
    /// Whether volatile settings were lost at a boot-up.
    pub(super) lost_settings: bool,
    /// State of the node.
    pub(super) state: Option<&'a NodeState>,
    /// Whether closed gates take precedence, because the report is for a moment other than that of the fault.
    pub(super) gates_first: bool,
}

/// At most [`COUNT`] checks, most likely cause first.
pub(super) fn propose_checks(ground: &FaultContext<'_>) -> Vec<Advice> {
    let mut all = Vec::new();
    let whole_node = ground.kinds.first().is_some_and(|kind| kind.is_of_the_whole_node());
    if ground.gates_first {
        add_gates(ground, &mut all);
    }
    add_causes(ground, &mut all);
    if ground.lost_settings {
        add_hints("config-lost", &mut all);
    }
    if whole_node {
        add_general(ground, &mut all);
    }
    add_gates(ground, &mut all);
    ways_out(ground, &mut all);
    add_codes(ground, &mut all);
    add_general(ground, &mut all);
    all.truncate(COUNT);
    all
}

fn add_check(all: &mut Vec<Advice>, text: &str, section: &str, by: AdviceSource) {
    if !text.is_empty() && !all.iter().any(|known| known.text == text) {
        all.push(Advice { text: text.to_owned(), section: section.to_owned(), by });
    }
}

/// Adds causes that the device manual lists for the code.
fn add_causes(ground: &FaultContext<'_>, all: &mut Vec<Advice>) {
    let Some(device) = ground.device else { return };
    for kind in ground.kinds {
        let known = match kind {
            FaultKind::Emcy(code) => {
                device.error_entry(*code).map(|error| (&error.causes, &error.source, AdviceSource::Emcy))
            }
            FaultKind::Dtc(spn, fmi) => {
                device.trouble_code_entry(*spn, *fmi).map(|own| (&own.causes, &own.source, AdviceSource::Dtc))
            }
            _ => None,
        };
        let Some((causes, source, by)) = known else { continue };
        for cause in causes {
            add_check(all, cause, source, by);
        }
    }
}

/// Adds the conditions of closed gates.
fn add_gates(ground: &FaultContext<'_>, all: &mut Vec<Advice>) {
    for gate in ground.state.into_iter().flat_map(NodeState::closed_gates) {
        add_check(all, &gate.gate_advice(), &gate.source, AdviceSource::Gate);
    }
}

/// Adds transitions out of a fault state, from the device manual.
fn ways_out(ground: &FaultContext<'_>, all: &mut Vec<Advice>) {
    let (Some(device), Some(state)) = (ground.device, ground.state) else { return };
    // Control words have no effect outside operational.
    if state.nmt.is_some_and(|nmt| nmt.state != NmtState::Operational) {
        return;
    }
    for (channel, name) in &state.states {
        let machines = device.machines.iter().filter(|machine| machine.channel == *channel);
        for machine in machines {
            let is_fault = machine.states.iter().any(|state| state.name == *name && state.fault);
            let from = machine.transitions.iter().filter(|it| it.from.0.contains(name) && it.to != *name);
            for (it, text) in from.filter_map(|it| Some((it, it.text.as_deref()?))).filter(|_| is_fault) {
                let text = format!("from {name} to {}: {text}", it.to);
                add_check(all, &text, &machine.source, AdviceSource::State);
            }
        }
    }
}

/// Adds hints of the code tables.
fn add_codes(ground: &FaultContext<'_>, all: &mut Vec<Advice>) {
    for kind in ground.kinds {
        let entry = match kind {
            FaultKind::Emcy(code) => profile::emcy_codes().find_code(u32::from(*code)),
            FaultKind::Dtc(_, fmi) => profile::failure_modes().find_code(u32::from(*fmi)),
            FaultKind::Refused(code) => profile::abort_codes().find_code(*code),
            _ => None,
        };
        add_check(all, entry.map_or("", |entry| &entry.hint), "", AdviceSource::Code);
    }
}

fn add_general(ground: &FaultContext<'_>, all: &mut Vec<Advice>) {
    for kind in ground.kinds {
        add_hints(kind.rule(), all);
    }
}

fn add_hints(rule: &str, all: &mut Vec<Advice>) {
    for text in profile::fault_hints(rule) {
        add_check(all, text, "", AdviceSource::General);
    }
}
