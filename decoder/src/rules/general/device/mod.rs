//! Rules about device functions: states, set points, commands, calibrations.

pub(super) mod active_not_ended;
pub(super) mod calibration;
pub(super) mod command_gap;
pub(super) mod commands_per_sync;
pub(super) mod fault_reset_without_edge;
mod followed_messages;
mod machines;
pub(super) mod mode_change_refused_or_ignored;
pub(super) mod not_following;
pub(super) mod setpoint_not_effective;
pub(super) mod state_lost;
pub(super) mod state_skipped;
pub(super) mod state_undefined;
