//! Facts about a node, on which the conditions of its profile are evaluated.

use super::node::Node;
use super::set_point::GatedSetPoint;
use crate::profile::device::{DeviceCondition, DeviceFacts, DeviceProcedure, GateStatus, StateDefinition};
use crate::profile::{DecidingNumber, ValueCarrier};
use crate::wire::canopen::{NmtState, ObjectAddress};

/// State of a node at one time, for set points and procedures. Values may be assumed, an NMT state presumed.
#[derive(Clone, Copy)]
pub(crate) struct NodeFacts<'a> {
    node: &'a Node,
    /// PDO or message that carries the set point.
    carrier: Option<&'a ValueCarrier>,
    now: i64,
}

impl Node {
    /// Running procedures.
    pub fn procedures(&self) -> impl Iterator<Item = &DeviceProcedure> {
        self.behaviour.running.iter().filter_map(|running| self.device.procedures.get(running.place))
    }

    /// Facts at a monotonic time, for conditions that are not about a set point.
    pub(crate) fn node_facts(&self, now: i64) -> NodeFacts<'_> {
        NodeFacts { node: self, carrier: None, now }
    }

    /// Facts at a monotonic time, for conditions about a set point.
    pub(in crate::session) fn facts_of<'a>(&'a self, subject: GatedSetPoint<'a>, now: i64) -> NodeFacts<'a> {
        NodeFacts { node: self, carrier: Some(subject.carrier), now }
    }
}

impl<'a> NodeFacts<'a> {
    /// Index of the machine of a channel.
    fn machine_index(&self, channel: Option<u8>) -> Option<usize> {
        let mut machines = self.node.device.machines.iter();
        machines.position(|it| it.channel.is_none() || channel.is_none() || it.channel == channel)
    }

    /// State that the machine of a channel reports.
    pub(crate) fn machine_state(&self, channel: Option<u8>) -> Option<&'a StateDefinition> {
        self.node.reported_state(self.machine_index(channel)?)
    }

    /// Name of a running procedure that takes control of the set points.
    fn procedure_in_control(&self) -> Option<&'a str> {
        self.node.procedures().find(|it| it.takes_over).map(|it| it.name.as_str())
    }

    /// Name of the message that carries the set point, if that message is overdue.
    fn overdue_message(&self) -> Option<&'a str> {
        match self.carrier {
            Some(ValueCarrier::Message(name)) if self.node.behaviour.overdue.contains(name) => Some(name),
            _ => None,
        }
    }

    /// The fact that decided a condition, as text: `state FAULT HOLD`, `5208:01 = 1`.
    pub(in crate::session) fn deciding_fact(
        &self,
        condition: &DeviceCondition,
        channel: Option<u8>,
        status: GateStatus,
    ) -> String {
        if let Some(object) = condition.object() {
            return match self.object_number(object) {
                Some(DecidingNumber { raw, assumed }) => {
                    format!("{object} = {raw}{}", if assumed { "?" } else { "" })
                }
                // Its gate is named after the object.
                None if matches!(condition, DeviceCondition::Known(_)) => String::new(),
                None => format!("{object} not seen"),
            };
        }
        match condition {
            DeviceCondition::Nmt(_) => {
                self.nmt_state().map_or("NMT state not seen", NmtState::name).to_owned()
            }
            DeviceCondition::State(_) => match self.reported_state(channel) {
                Some(state) if status == GateStatus::Unknown => format!("{state}, transition commanded"),
                Some(state) => state.to_owned(),
                None if self.machine_index(channel).is_none() => "no state machine".to_owned(),
                None => "state not reported yet".to_owned(),
            },
            DeviceCondition::Sync => "SYNC".to_owned(),
            DeviceCondition::NoError => self.node.error_texts().collect::<Vec<_>>().join(", "),
            DeviceCondition::NoProcedure => self.procedure_in_control().unwrap_or_default().to_owned(),
            DeviceCondition::Younger(_) => {
                self.overdue_message().map_or_else(String::new, |name| format!("{name} overdue"))
            }
            _ => String::new(),
        }
    }
}

impl DeviceFacts for NodeFacts<'_> {
    fn nmt_state(&self) -> Option<NmtState> {
        self.node.nmt.map(|nmt| nmt.state)
    }

    /// Value from a PDO, else from the store, else the delivered value.
    fn object_number(&self, object: ObjectAddress) -> Option<DecidingNumber> {
        let seen = self.node.behaviour.last_word(object);
        seen.map(|word| DecidingNumber { raw: word.cast_signed(), assumed: false })
            .or_else(|| self.node.resolver().resolve_number(object))
    }

    fn reported_state(&self, channel: Option<u8>) -> Option<&str> {
        self.machine_state(channel).map(|state| state.name.as_str())
    }

    fn is_commanded(&self, channel: Option<u8>, states: &[String]) -> bool {
        self.machine_index(channel).is_some_and(|place| self.node.is_commanded(place, states, self.now))
    }

    fn sync_age(&self) -> Option<i64> {
        self.node.behaviour.sync.map(|sync| self.now.saturating_sub(sync.time))
    }

    fn has_error(&self) -> bool {
        !self.node.active_errors().is_empty() || self.node.active_dtcs().next().is_some()
    }

    fn is_taken_over(&self) -> bool {
        self.procedure_in_control().is_some()
    }

    fn is_overdue(&self) -> bool {
        self.overdue_message().is_some()
    }

    /// `None`: only rules evaluate other nodes.
    fn other_nodes(&self) -> Option<impl Iterator<Item = Self>> {
        None::<std::iter::Empty<Self>>
    }

    fn is_alone(&self) -> Option<bool> {
        None
    }
}
