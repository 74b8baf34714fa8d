//! The general rules: one file each.

mod emcy_raised;
mod fault_reset_without_edge;
mod node_lost;
mod sdo_no_response;
mod setpoint_not_effective;
mod state_lost;
mod unexpected_boot;

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
    entry!(state_lost),
    entry!(fault_reset_without_edge),
    entry!(setpoint_not_effective),
];
