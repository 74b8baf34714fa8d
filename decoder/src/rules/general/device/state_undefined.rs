//! Status words without a state in the state machine of the device.

use super::machines::machine_subject;
use crate::event::{Event, EventKind, FrameRange, Kind};
use crate::rules::rule::declare_rule;
use crate::rules::{Rule, RuleContext, RulePolicy};
use crate::session::Node;
use crate::wire::{NodeId, NodeMap};

declare_rule! {
    /// # What it checks
    /// The state bits of a status word match no state of the profile. Reported once per node.
    ///
    /// # Why it matters
    /// The meaning of the state is unknown: neither set points nor faults can be judged in it.
    ///
    /// # Source
    /// State machine in the device manual; for fluid power CiA 408, for drives CiA 402.
    ///
    /// # What to look at first
    /// Compare the mapping of the TPDO with the profile. A newer firmware may define further states.
    ///
    /// # Mutation
    /// set state bits that the manual does not define
    "state-undefined", Note, "undefined device state",
    kinds: [Kind::DeviceState, Kind::BootUp],
    needs: "a status word of the profile",
    word: "STATE",
}

#[derive(Default)]
struct StateUndefined {
    reported: NodeMap<bool>,
}

fn new(_policy: &RulePolicy) -> StateUndefined {
    StateUndefined::default()
}

impl StateUndefined {
    fn check_state(&mut self, id: NodeId, node: &Node, context: &mut RuleContext<'_>) {
        if self.reported.get(id).is_some() {
            return;
        }
        for (place, machine) in node.device().machines.iter().enumerate() {
            let Some((raw, frame)) = node.undefined_state(place) else { continue };
            self.reported.insert(id, true);
            let alarm = context.fail_at(context.now, Some(id), FrameRange::one(frame));
            return alarm.with_subject(machine_subject(machine.channel)).report_finding(|| {
                let (object, mask) = (machine.status.object.object, machine.status.mask);
                format!(
                    "{object} = {raw:02X}h (mask {mask:02X}h): undefined state of machine {}",
                    machine.name
                )
            });
        }
    }
}

impl Rule for StateUndefined {
    fn on_event(&mut self, event: &Event, context: &mut RuleContext<'_>) {
        if let (EventKind::DeviceState(_), Some(id)) = (&event.kind, event.node)
            && let Some(node) = context.event_node(event)
        {
            self.check_state(id, node, context);
            if self.reported.get(id).is_none() {
                context.count_pass();
            }
        }
    }

    fn on_second(&mut self, context: &mut RuleContext<'_>) {
        for node in context.bus.nodes().filter(|node| !node.device().machines.is_empty()) {
            self.check_state(node.id(), node, context);
        }
    }

    fn on_end(&mut self, context: &mut RuleContext<'_>) {
        self.on_second(context);
    }
}
