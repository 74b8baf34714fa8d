//! The general rules: one file each.

mod command_gap;
mod config_lost;
mod eeprom_wear;
mod emcy_raised;
mod fault_reset_without_edge;
mod node_lost;
mod sdo_no_response;
mod setpoint_not_effective;
mod state_lost;
mod sync_period;
mod unexpected_boot;
mod value_out_of_range;

use super::{Entry, Rule, Setup};

/// A line of the registry: the rule's file has `DECLARATION` and `new`.
macro_rules! entry {
    ($file:ident) => {
        Entry {
            declaration: &$file::DECLARATION,
            make: |setup: &Setup| -> Box<dyn Rule> { Box::new($file::new(setup)) },
        }
    };
}

/// All of them, in the order they are asked: those that explain others before those.
pub static REGISTRY: &[Entry] = &[
    entry!(node_lost),
    entry!(unexpected_boot),
    entry!(emcy_raised),
    entry!(sdo_no_response),
    entry!(config_lost),
    entry!(command_gap),
    entry!(sync_period),
    entry!(state_lost),
    entry!(fault_reset_without_edge),
    entry!(setpoint_not_effective),
    entry!(eeprom_wear),
    entry!(value_out_of_range),
];
