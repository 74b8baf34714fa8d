//! Facts about a node, on which the conditions of its profile are evaluated.

use super::node::Node;
use super::set_point::Subject;
use crate::profile::device::{Condition, DeviceFacts, GateStatus, State};
use crate::profile::{Carrier, Number};
use crate::wire::canopen::{NmtState, ObjectAddress};

/// State of a node at one time, for set points and procedures. Values may be assumed, an NMT state presumed.
#[derive(Clone, Copy)]
pub(crate) struct NodeFacts<'a> {
    node: &'a Node,
    /// PDO or message that carries the set point.
    carrier: Option<&'a Carrier>,
    now: i64,
}

impl Node {
    /// Facts at a monotonic time, for conditions that are not about a set point.
    pub(crate) fn facts(&self, now: i64) -> NodeFacts<'_> {
        NodeFacts { node: self, carrier: None, now }
    }

    /// Facts at a monotonic time, for conditions about a set point.
    pub(in crate::session) fn facts_of<'a>(&'a self, subject: Subject<'a>, now: i64) -> NodeFacts<'a> {
        NodeFacts { node: self, carrier: Some(subject.carrier), now }
    }
}

impl<'a> NodeFacts<'a> {
    /// Index of the machine of a channel.
    fn machine(&self, channel: Option<u8>) -> Option<usize> {
        let mut machines = self.node.device.machines.iter();
        machines.position(|it| it.channel.is_none() || channel.is_none() || it.channel == channel)
    }

    /// State that the machine of a channel reports.
    pub(crate) fn state(&self, channel: Option<u8>) -> Option<&'a State> {
        self.node.reported_state(self.machine(channel)?)
    }

    /// Name of a running procedure that takes control of the set points.
    fn procedure_in_control(&self) -> Option<&'a str> {
        self.node.behaviour.running.iter().find_map(|running| self.node.takes_over(running))
    }

    /// Name of the message that carries the set point, if that message is overdue.
    fn overdue_message(&self) -> Option<&'a str> {
        match self.carrier {
            Some(Carrier::Message(name)) if self.node.behaviour.overdue.contains(name) => Some(name),
            _ => None,
        }
    }

    /// The fact that decided a condition, as text: `state FAULT HOLD`, `5208:01 = 1`.
    pub(in crate::session) fn detail(
        &self,
        condition: &Condition,
        channel: Option<u8>,
        status: GateStatus,
    ) -> String {
        if let Some(object) = condition.object() {
            return match self.number(object) {
                Some(Number { raw, assumed }) => {
                    format!("{object} = {raw}{}", if assumed { "?" } else { "" })
                }
                None => format!("{object} not seen"),
            };
        }
        match condition {
            Condition::Nmt(_) => self.nmt_state().map_or("NMT state not seen", NmtState::name).to_owned(),
            Condition::State(_) => match self.reported_state(channel) {
                Some(state) if status == GateStatus::Unknown => format!("{state}, transition commanded"),
                Some(state) => state.to_owned(),
                None if self.machine(channel).is_none() => "no state machine".to_owned(),
                None => "state not reported yet".to_owned(),
            },
            Condition::Sync => "SYNC".to_owned(),
            Condition::NoError => self.node.errors().collect::<Vec<_>>().join(", "),
            Condition::NoProcedure => self.procedure_in_control().unwrap_or_default().to_owned(),
            Condition::Younger(_) => {
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
    fn number(&self, object: ObjectAddress) -> Option<Number> {
        let seen = self.node.behaviour.word(object);
        seen.map(|word| Number { raw: word.cast_signed(), assumed: false })
            .or_else(|| self.node.resolver().number(object))
    }

    fn reported_state(&self, channel: Option<u8>) -> Option<&str> {
        self.state(channel).map(|state| state.name.as_str())
    }

    fn is_commanded(&self, channel: Option<u8>, states: &[String]) -> bool {
        self.machine(channel).is_some_and(|place| self.node.is_commanded(place, states, self.now))
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
    fn others(&self) -> Option<impl Iterator<Item = Self>> {
        None::<std::iter::Empty<Self>>
    }

    fn is_alone(&self) -> Option<bool> {
        None
    }
}
