//! What is remembered of a device's doings: states, set points, procedures, and what may explain them.

use std::sync::Arc;

use super::moment::Moment;
use super::procedures::Running;
use super::set_point::SetPointState;
use super::state_machine::MachineState;
use crate::wire::canopen::ObjectAddress;
use crate::wire::canopen::nmt::NmtService;

/// What is remembered of a device's doings.
#[derive(Debug, Clone, Default)]
pub(in crate::session) struct Behaviour {
    /// Last raw value of objects that matter and travel in PDOs.
    pub(in crate::session) words: Vec<(ObjectAddress, u64)>,
    pub(in crate::session) machines: Vec<MachineState>,
    pub(in crate::session) set_points: Vec<SetPointState>,
    pub(in crate::session) running: Vec<Running>,
    /// Modes told last.
    pub(in crate::session) modes: Vec<(ObjectAddress, i64)>,
    /// The last commands, latest first.
    pub(in crate::session) nmt: [Option<Moment<NmtService>>; 3],
    pub(in crate::session) emcy: Option<Moment<u16>>,
    /// The last fault reported by DM1: SPN and FMI.
    pub(in crate::session) dtc: Option<Moment<(u32, u8)>>,
    /// Messages that did not come within the time the manual gives.
    pub(in crate::session) overdue: Vec<Arc<str>>,
    pub(in crate::session) boot: Option<Moment<()>>,
    pub(in crate::session) sync: Option<Moment<()>>,
    /// A deadline of set points that wait for SYNC is queued.
    pub(in crate::session) sync_queued: bool,
}

impl Behaviour {
    /// Last raw value of an object in a PDO.
    pub(in crate::session) fn word(&self, object: ObjectAddress) -> Option<u64> {
        self.words.iter().find(|(known, _)| *known == object).map(|(_, raw)| *raw)
    }

    /// Notes a raw value; gives the one before.
    pub(in crate::session) fn note(&mut self, object: ObjectAddress, raw: u64) -> Option<u64> {
        if let Some((_, known)) = self.words.iter_mut().find(|(known, _)| *known == object) {
            return Some(std::mem::replace(known, raw));
        }
        self.words.push((object, raw));
        None
    }

    /// All traffic stopped for so long.
    pub(in crate::session) fn postpone(&mut self, delay: i64) {
        for point in &mut self.set_points {
            point.postpone(delay);
        }
    }

    /// Bytes held.
    pub(in crate::session) fn footprint(&self) -> usize {
        self.words.capacity() * size_of::<(ObjectAddress, u64)>()
            + self.machines.capacity() * size_of::<MachineState>()
            + self.set_points.capacity() * size_of::<SetPointState>()
            + self.running.capacity() * size_of::<Running>()
    }
}
