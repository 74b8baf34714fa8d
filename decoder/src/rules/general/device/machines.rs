//! State machines of devices as rules see them: which one an event is about, and what the control word wants.

use std::sync::Arc;

use crate::event::DeviceState;
use crate::finding::About;
use crate::profile::device::{Machine, Transition};
use crate::session::Node;

/// The machine a state is of, and its place in the device.
pub(super) fn machine<'a>(node: &'a Node, state: &DeviceState) -> Option<(usize, &'a Machine)> {
    let mut machines = node.device().machines.iter().enumerate();
    machines.find(|(_, machine)| machine.name == state.machine && machine.channel == state.channel)
}

/// What a finding about a machine is about: its output, where there are several.
pub(super) fn about(channel: Option<u8>) -> About {
    channel.map_or(About::Whole, |channel| About::Name(Arc::from(format!("channel {channel}"))))
}

/// The ways out of a state.
pub(super) fn ways_out<'a>(machine: &'a Machine, state: &'a str) -> impl Iterator<Item = &'a Transition> {
    machine.transitions.iter().filter(move |way| way.from.0.iter().any(|from| from == state))
}

/// Whether a control word commands to stay in a state: no way out of it, edges apart, is open.
pub(super) fn stays(machine: &Machine, state: &str, control: u64) -> bool {
    ways_out(machine, state).all(|way| control & way.mask != way.value & way.mask)
}

/// Bits of the control word that must rise for a state to be left; 0 where a level does.
pub(super) fn edges_out(machine: &Machine, state: &str) -> u64 {
    let by_level = ways_out(machine, state).any(|way| way.edge == 0);
    if by_level { 0 } else { ways_out(machine, state).fold(0, |bits, way| bits | way.edge) }
}
