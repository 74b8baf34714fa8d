//! CANopen services: what each message does to what is known, and which events that makes.

mod emcy;
mod error_control;
mod layout;
mod learn;
mod lss;
mod nmt;
mod pdo;
mod sdo;
mod sync;

pub(super) use layout::{layout, of_profile as layout_of_profile};
pub(super) use lss::LssState;
pub(super) use sdo::Channels;
pub(super) use sync::SyncState;
