//! Rules about PDOs and their mapping.

pub(super) mod mapping_invalid;
pub(super) mod mapping_procedure;
pub(super) mod pdo_event_timer;
pub(super) mod pdo_inhibit_time;
pub(super) mod pdo_invalid;
pub(super) mod pdo_long;
pub(super) mod pdo_lost;
pub(super) mod pdo_outside_operational;
mod pdo_parameter;
mod pdo_period;
pub(super) mod pdo_rtr;
pub(super) mod pdo_short;
pub(super) mod pdo_sync_acyclic;
pub(super) mod pdo_sync_cyclic;
