//! What a device is doing: its procedures, and when its set points act.

use super::node::Node;
use super::procedures::Running;
use crate::profile::Carrier;
use crate::profile::device::{PdoEffect, Procedure};
use crate::wire::canopen::ObjectAddress;

/// Transmission types up to this one wait for SYNC (CiA 301 §7.5.2.35).
const LAST_SYNCHRONOUS: u64 = 240;

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

impl Node {
    /// Whether an RPDO acts at the next SYNC: as the device says, else by its transmission type.
    pub(in crate::session) fn waits_for_sync(&self, carrier: &Carrier) -> bool {
        let Carrier::Pdo(name) = *carrier else { return false };
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
