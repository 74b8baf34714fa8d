//! Object values after transfers and restarts or as delivered, and the effect of communication parameters.

mod conflict;
mod delivered;
mod parameters;
mod restart;
mod values;

pub(in crate::session) use delivered::{move_delivered, take_delivered};
pub(in crate::session) use parameters::{apply_object, revert_object};
pub(in crate::session) use restart::{count_lost_settings, emit_restart_changes, restart_values};
pub(in crate::session) use values::{
    ObjectTransfer, apply_transfer, mark_stale, mark_value_stale, set_fallback,
};
