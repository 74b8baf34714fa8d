//! The general rules: one file each.

mod access_type;
mod boot_up_missing;
mod cob_id_mismatch;
mod cob_id_restricted;
mod duplicate_node_id;
mod duplicate_producer;
mod emcy_history;
mod emcy_missing;
mod emcy_raised;
mod emcy_register;
mod emcy_repeated;
mod facts;
mod guard_toggle;
mod guard_with_heartbeat;
mod heartbeat_consumer;
mod heartbeat_period;
mod lss_sequence;
mod nmt_command_ignored;
mod nmt_command_invalid;
mod node_lost;
mod pdo_event_timer;
mod pdo_inhibit_time;
mod pdo_long;
mod pdo_outside_operational;
mod pdo_parameter;
mod pdo_rtr;
mod pdo_short;
mod pdo_sync_acyclic;
mod pdo_sync_cyclic;
mod read_back;
mod sdo_abort_code;
mod sdo_block_crc;
mod sdo_block_sequence;
mod sdo_download_refused;
mod sdo_no_response;
mod sdo_situation;
mod sdo_size;
mod sdo_toggle;
mod sdo_upload_refused;
mod service_in_stopped;
mod sync_counter;
mod time_not_monotonic;
mod traffic_before_boot;
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
    entry!(duplicate_node_id),
    entry!(duplicate_producer),
    entry!(node_lost),
    entry!(unexpected_boot),
    entry!(emcy_raised),
    entry!(sdo_no_response),
    entry!(sdo_download_refused),
    entry!(sdo_abort_code),
    entry!(sdo_block_crc),
    entry!(sdo_block_sequence),
    entry!(sdo_size),
    entry!(sdo_toggle),
    entry!(sdo_upload_refused),
    entry!(access_type),
    entry!(read_back),
    entry!(cob_id_mismatch),
    entry!(cob_id_restricted),
    entry!(boot_up_missing),
    entry!(traffic_before_boot),
    entry!(nmt_command_invalid),
    entry!(nmt_command_ignored),
    entry!(service_in_stopped),
    entry!(guard_toggle),
    entry!(guard_with_heartbeat),
    entry!(heartbeat_period),
    entry!(heartbeat_consumer),
    entry!(emcy_register),
    entry!(emcy_history),
    entry!(emcy_repeated),
    entry!(emcy_missing),
    entry!(pdo_outside_operational),
    entry!(pdo_short),
    entry!(pdo_long),
    entry!(sync_counter),
    entry!(pdo_sync_cyclic),
    entry!(pdo_sync_acyclic),
    entry!(pdo_event_timer),
    entry!(pdo_inhibit_time),
    entry!(pdo_rtr),
    entry!(lss_sequence),
    entry!(time_not_monotonic),
];
