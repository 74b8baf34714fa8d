//! The general rules: one file each.

mod access_type;
mod calibration;
mod cob_id_mismatch;
mod cob_id_restricted;
mod command_gap;
mod commands_per_sync;
mod config_lost;
mod duplicate_node_id;
mod duplicate_producer;
mod eeprom_wear;
mod emcy_raised;
mod facts;
mod fault_reset_without_edge;
mod guard_late;
mod mapping_procedure;
mod mode_change_refused_or_ignored;
mod node_lost;
mod not_following;
mod pdo_long;
mod pdo_outside_operational;
mod pdo_short;
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
mod setpoint_not_effective;
mod state_lost;
mod sync_period;
mod unexpected_boot;
mod unsaved_change;
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
    entry!(duplicate_node_id),
    entry!(duplicate_producer),
    entry!(node_lost),
    entry!(unexpected_boot),
    entry!(emcy_raised),
    entry!(sdo_no_response),
    entry!(config_lost),
    entry!(command_gap),
    entry!(guard_late),
    entry!(sync_period),
    entry!(commands_per_sync),
    entry!(mode_change_refused_or_ignored),
    entry!(mapping_procedure),
    entry!(calibration),
    entry!(state_lost),
    entry!(fault_reset_without_edge),
    entry!(setpoint_not_effective),
    entry!(not_following),
    entry!(eeprom_wear),
    entry!(value_out_of_range),
    entry!(unsaved_change),
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
    entry!(pdo_outside_operational),
    entry!(pdo_short),
    entry!(pdo_long),
];
