//! CANopen services: effect of each message on the state of the bus, and the events it causes.

mod boot;
mod emcy;
mod error_control;
mod evidence;
mod lss;
mod nmt;
mod pdo;
mod sdo;
mod sync;
#[cfg(test)]
mod tests;
mod time_stamps;

pub(in crate::session) use emcy::EmcyMachine;
pub(in crate::session) use error_control::ErrorControlMachine;
pub(in crate::session) use evidence::proves_canopen;
pub(in crate::session) use lss::LssMachine;
pub(in crate::session) use nmt::NmtMachine;
pub(in crate::session) use pdo::{PdoMachine, copy_payload};
pub(in crate::session) use sdo::SdoMachine;
pub(in crate::session) use sync::{ConformanceMarks, SyncMachine};
pub(in crate::session) use time_stamps::TimeStamps;
