//! Rules about NMT boot-ups, commands and states.

pub(super) mod boot_up_missing;
pub(super) mod late_start;
pub(super) mod nmt_command_ignored;
pub(super) mod nmt_command_invalid;
pub(super) mod operational_lost;
pub(super) mod service_in_stopped;
pub(super) mod traffic_before_boot;
pub(super) mod unexpected_boot;
