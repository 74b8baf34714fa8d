//! State of a device: state machines, set points, procedures, and possible causes of a change.

use std::sync::Arc;

use super::set_point::SetPointState;
use super::state_machine::MachineState;
use crate::profile::ValueCarrier;
use crate::profile::device::ProcedureStatus;
use crate::session::bus::time::FrameMoment;
use crate::wire::canopen::ObjectAddress;
use crate::wire::canopen::nmt::NmtService;

/// State of a running procedure.
#[derive(Debug, Clone)]
pub(in crate::session) struct RunningProcedure {
    /// Index in the procedure list of the device.
    pub(in crate::session) place: usize,
    pub(in crate::session) started: FrameMoment<()>,
    /// Step emitted last.
    pub(in crate::session) step: Option<usize>,
    /// Consecutive messages that met the conditions of the pending trigger.
    pub(in crate::session) streak: u8,
}

/// End of a procedure with a status object, until its next start.
#[derive(Debug, Clone)]
pub(in crate::session) struct ProcedureResult {
    /// Index in the procedure list of the device.
    pub(in crate::session) place: usize,
    /// Start; None before the capture.
    pub(in crate::session) started: Option<FrameMoment<()>>,
    /// Frame with the end, or with the first status.
    pub(in crate::session) ended: u64,
    pub(in crate::session) outcome: ProcedureStatus,
    /// The status object was read since the end; otherwise the outcome is derived from bits or a restart.
    pub(in crate::session) is_read: bool,
}

/// Device state of one node.
#[derive(Debug, Clone, Default)]
pub(in crate::session) struct DeviceBehaviour {
    /// Last raw values of the objects in PDOs that a plan watches.
    pub(in crate::session) words: Vec<(ObjectAddress, u64)>,
    pub(in crate::session) machines: Vec<MachineState>,
    pub(in crate::session) set_points: Vec<SetPointState>,
    pub(in crate::session) running: Vec<RunningProcedure>,
    /// Procedures that ended; at most one per procedure of the profile.
    pub(in crate::session) results: Vec<ProcedureResult>,
    /// Modes emitted last.
    pub(in crate::session) modes: Vec<(ObjectAddress, i64)>,
    /// Last NMT commands, latest first.
    pub(in crate::session) nmt: [Option<FrameMoment<NmtService>>; 3],
    pub(in crate::session) emcy: Option<FrameMoment<u16>>,
    /// Last fault reported by DM1: SPN and FMI.
    pub(in crate::session) dtc: Option<FrameMoment<(u32, u8)>>,
    /// Messages not received within the time in the manual.
    pub(in crate::session) overdue: Vec<Arc<str>>,
    pub(in crate::session) boot: Option<FrameMoment<()>>,
    pub(in crate::session) sync: Option<FrameMoment<()>>,
    /// A SYNC deadline of set points is in the timer queue.
    pub(in crate::session) sync_queued: bool,
}

impl DeviceBehaviour {
    /// Last raw value of a watched object in a PDO.
    pub(in crate::session) fn last_word(&self, object: ObjectAddress) -> Option<u64> {
        self.words.iter().find(|(known, _)| *known == object).map(|(_, raw)| *raw)
    }

    /// Whether a set point of this carrier came with less data than its mapping.
    pub(in crate::session) fn has_short_payload(&self, carrier: &ValueCarrier) -> bool {
        self.set_points.iter().any(|point| point.short.is_some() && point.carrier == *carrier)
    }

    /// Stores a raw value and returns the previous one.
    pub(in crate::session) fn note_value(&mut self, object: ObjectAddress, raw: u64) -> Option<u64> {
        if let Some((_, known)) = self.words.iter_mut().find(|(known, _)| *known == object) {
            return Some(std::mem::replace(known, raw));
        }
        self.words.push((object, raw));
        None
    }

    /// Ends all procedures at a restart; a later status contains their outcome.
    pub(in crate::session) fn interrupt_procedures(&mut self, frame: u64) {
        for running in std::mem::take(&mut self.running) {
            self.set_result(ProcedureResult {
                place: running.place,
                started: Some(running.started),
                ended: frame,
                outcome: ProcedureStatus::Ended,
                is_read: false,
            });
        }
    }

    /// Replaces the result of a procedure.
    pub(in crate::session) fn set_result(&mut self, result: ProcedureResult) {
        self.results.retain(|known| known.place != result.place);
        self.results.push(result);
    }

    /// Moves deadlines by `delay` ns, during which all traffic stopped.
    pub(in crate::session) fn postpone_deadlines(&mut self, delay: i64) {
        for point in &mut self.set_points {
            point.postpone_value(delay);
        }
    }

    /// Bytes held by the lists.
    pub(in crate::session) fn footprint(&self) -> usize {
        self.words.capacity() * size_of::<(ObjectAddress, u64)>()
            + self.machines.capacity() * size_of::<MachineState>()
            + self.set_points.capacity() * size_of::<SetPointState>()
            + self.running.capacity() * size_of::<RunningProcedure>()
            + self.results.capacity() * size_of::<ProcedureResult>()
    }
}
