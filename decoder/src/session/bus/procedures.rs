//! Procedures of a device that run.

use super::moment::Moment;

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
