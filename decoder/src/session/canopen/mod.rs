//! CANopen services: what each message does to what is known, and which events follow.

mod boot;
mod emcy;
mod error_control;
mod lss;
mod nmt;
mod pdo;
mod sdo;
mod sync;

pub(in crate::session) use emcy::Emcy;
pub(in crate::session) use error_control::ErrorControl;
pub(in crate::session) use lss::Lss;
pub(in crate::session) use nmt::Nmt;
pub(in crate::session) use pdo::Pdo;
pub(in crate::session) use sdo::Sdo;
pub(in crate::session) use sync::{ConformanceMarks, Sync, TimeStamps};
