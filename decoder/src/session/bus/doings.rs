//! Activity of a device: procedures, and the moment at which set points take effect.

use super::node::Node;
use super::procedures::RunningProcedure;
use crate::profile::ValueCarrier;
use crate::profile::device::{DeviceProcedure, PdoEffect};
use crate::wire::canopen::ObjectAddress;

/// Highest transmission type that waits for SYNC (CiA 301 §7.5.2.35).
const LAST_SYNCHRONOUS: u64 = 240;

impl Node {
    /// Name of the running procedure, if it takes control of the set points.
    pub(in crate::session) fn takes_over(&self, running: &RunningProcedure) -> Option<&str> {
        let procedure = self.device.procedures.get(running.place)?;
        procedure.takes_over.then_some(procedure.name.as_str())
    }

    /// Running procedures.
    pub fn procedures(&self) -> impl Iterator<Item = &DeviceProcedure> {
        self.behaviour.running.iter().filter_map(|running| self.device.procedures.get(running.place))
    }
}

impl Node {
    /// Whether an RPDO takes effect at the next SYNC; the profile overrides the transmission type.
    pub(in crate::session) fn waits_for_sync(&self, carrier: &ValueCarrier) -> bool {
        let ValueCarrier::Pdo(name) = *carrier else { return false };
        let spec = self.device.pdos.iter().find(|spec| spec.pdo == name);
        match spec.map(|spec| spec.effect).unwrap_or_default() {
            PdoEffect::AtSync => true,
            PdoEffect::AtOnce => false,
            PdoEffect::ByType => {
                let kind = self.store.number(ObjectAddress::new(name.communication_index(), 2));
                kind.is_some_and(|kind| kind <= LAST_SYNCHRONOUS)
            }
        }
    }
}
