//! Running procedures of a device.

use super::moment::FrameMoment;
use crate::profile::device::ProcedureStatus;

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
