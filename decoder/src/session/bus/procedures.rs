//! Procedures of a device that run.

use super::behaviour::Moment;
use super::node::Node;
use crate::profile::device::Procedure;

/// A procedure that runs.
#[derive(Debug, Clone)]
pub(in crate::session) struct Running {
    /// Place in the device's list.
    pub(in crate::session) place: usize,
    pub(in crate::session) started: Moment<()>,
    /// The step told last.
    pub(in crate::session) step: Option<usize>,
    /// Messages in a row that met the conditions of what it waits for.
    pub(in crate::session) streak: u8,
}

impl Node {
    /// Name of a running procedure that takes the set points over.
    pub(in crate::session) fn takes_over(&self, running: &Running) -> Option<&str> {
        let procedure = self.device.procedures.get(running.place)?;
        procedure.takes_over.then_some(procedure.name.as_str())
    }

    /// Procedures that run.
    pub fn procedures(&self) -> impl Iterator<Item = &Procedure> {
        self.behaviour.running.iter().filter_map(|running| self.device.procedures.get(running.place))
    }
}
