//! Objects of nodes: values as transfers, restarts and deliveries leave them, and what communication parameters bring about.

mod conflict;
mod delivered;
mod parameters;
mod restart;
mod values;

pub(in crate::session) use delivered::{move_delivered, take_delivered};
pub(in crate::session) use parameters::{apply_object, revert_object};
pub(in crate::session) use restart::{count_lost_settings, emit_restart_changes, restart_values};
pub(in crate::session) use values::{ObjectTransfer, apply_transfer, mark_stale, set_fallback};
