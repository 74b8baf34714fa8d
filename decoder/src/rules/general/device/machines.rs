//! Look-ups in the state machines of devices.

use std::sync::Arc;

use crate::event::{DeviceState, Event, SdoDirection, SdoTransfer};
use crate::finding::FindingSubject;
use crate::profile::device::{StateMachine, StateTransition};
use crate::rules::RuleContext;
use crate::session::Node;

/// State machine of a state, and its index in the device.
pub(super) fn state_machine<'a>(node: &'a Node, state: &DeviceState) -> Option<(usize, &'a StateMachine)> {
    let mut machines = node.device().machines.iter().enumerate();
    machines.find(|(_, machine)| machine.name == state.machine && machine.channel == state.channel)
}

/// Subject of a finding about a state machine: its channel, if there are several.
pub(super) fn machine_subject(channel: Option<u8>) -> FindingSubject {
    channel.map_or(FindingSubject::Whole, |channel| {
        FindingSubject::Name(Arc::from(format!("channel {channel}")))
    })
}

/// Transitions from a state.
pub(super) fn ways_out<'a>(
    machine: &'a StateMachine,
    state: &'a str,
) -> impl Iterator<Item = &'a StateTransition> {
    machine.transitions.iter().filter(move |way| way.from.0.iter().any(|from| from == state))
}

/// Whether a control word keeps a state: no level-triggered transition is active.
pub(super) fn keeps_state(machine: &StateMachine, state: &str, control: u64) -> bool {
    ways_out(machine, state).all(|way| control & way.mask != way.value & way.mask)
}

/// Control word bits whose edge leaves a state; 0 if a level also leaves it.
pub(super) fn edges_out(machine: &StateMachine, state: &str) -> u64 {
    let by_level = ways_out(machine, state).any(|way| way.edge == 0);
    if by_level { 0 } else { ways_out(machine, state).fold(0, |bits, way| bits | way.edge) }
}

/// Least number of transitions from a state to another; `None` without a path.
pub(super) fn steps_between(machine: &StateMachine, from: &str, to: &str) -> Option<usize> {
    let mut reached = vec![(from, 0_usize)];
    let mut next = 0;
    while let Some((state, steps)) = reached.get(next).copied() {
        if state == to {
            return Some(steps);
        }
        next += 1;
        for way in ways_out(machine, state) {
            if reached.iter().all(|(known, _)| *known != way.to) {
                reached.push((&way.to, steps + 1));
            }
        }
    }
    None
}

/// State to which a control word leads from a state without any edge; `None` if the device may first slow
/// down.
pub(super) fn commanded_state<'a>(machine: &'a StateMachine, from: &'a str, control: u64) -> Option<&'a str> {
    let mut state = from;
    // The number of steps is limited, because the transitions of a profile may form a loop.
    for _ in 0..machine.states.len() {
        let leads = |way: &&StateTransition| way.edge == 0 && control & way.mask == way.value & way.mask;
        let Some(way) = ways_out(machine, state).find(leads) else { break };
        if way.slow {
            return None;
        }
        state = &way.to;
    }
    Some(state)
}

/// Whether a transfer writes a control word.
pub(super) fn is_control(event: &Event, transfer: &SdoTransfer, context: &RuleContext<'_>) -> bool {
    transfer.direction == Some(SdoDirection::Download)
        && context.event_node(event).is_some_and(|node| {
            let mut machines = node.device().machines.iter();
            machines.any(|machine| transfer.object == Some(machine.control.object.object))
        })
}
