//! The general rules: one file each.

mod address_contention;
mod bus_health;
mod cannot_claim;
mod dm1_period;
mod emcy_raised;
mod identity_move;
mod isotp_violation;
mod malformed_message;
mod node_lost;
mod request_unanswered;
mod sdo_no_response;
mod spn_not_available;
mod transport_violation;
mod trouble_code;
mod uds_negative;
mod uds_no_response;
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
    entry!(bus_health),
    entry!(node_lost),
    entry!(unexpected_boot),
    entry!(emcy_raised),
    entry!(address_contention),
    entry!(cannot_claim),
    entry!(identity_move),
    entry!(trouble_code),
    entry!(dm1_period),
    entry!(transport_violation),
    entry!(isotp_violation),
    entry!(sdo_no_response),
    entry!(request_unanswered),
    entry!(uds_no_response),
    entry!(uds_negative),
    entry!(spn_not_available),
    entry!(malformed_message),
];
