//! CANopen services: effect of each message on the state of the bus, and the events it causes.

mod boot;
mod emcy;
mod error_control;
mod lss;
mod nmt;
mod pdo;
mod sdo;
mod sync;
mod time_stamps;

pub(in crate::session) use emcy::Emcy;
pub(in crate::session) use error_control::ErrorControl;
pub(in crate::session) use lss::Lss;
pub(in crate::session) use nmt::Nmt;
pub(in crate::session) use pdo::{Pdo, copy_payload};
pub(in crate::session) use sdo::Sdo;
pub(in crate::session) use sync::{ConformanceMarks, Sync};
pub(in crate::session) use time_stamps::TimeStamps;
