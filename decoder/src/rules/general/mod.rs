//! The general rules: one file each.

mod access_type;
mod address_contention;
mod boot_up_missing;
mod bus_health;
mod calibration;
mod cannot_claim;
mod cob_id_mismatch;
mod cob_id_restricted;
mod command_gap;
mod commands_per_sync;
mod config_lost;
mod dm1_period;
mod duplicate_node_id;
mod duplicate_producer;
mod eeprom_wear;
mod emcy_history;
mod emcy_missing;
mod emcy_raised;
mod emcy_register;
mod emcy_repeated;
mod facts;
mod fault_reset_without_edge;
mod guard_late;
mod guard_no_answer;
mod guard_toggle;
mod guard_with_heartbeat;
mod heartbeat_consumer;
mod heartbeat_period;
mod identity_move;
mod isotp_violation;
mod lss_sequence;
mod malformed_message;
mod mapping_invalid;
mod mapping_procedure;
mod mode_change_refused_or_ignored;
mod nmt_command_ignored;
mod nmt_command_invalid;
mod node_lost;
mod not_following;
mod object_default;
mod parameter_locked;
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
mod request_unanswered;
mod sdo_abort_code;
mod sdo_answer_mismatch;
mod sdo_block_crc;
mod sdo_block_sequence;
mod sdo_download_refused;
mod sdo_no_response;
mod sdo_situation;
mod sdo_size;
mod sdo_toggle;
mod sdo_upload_refused;
mod service_in_stopped;
mod setpoint_not_effective;
mod spn_not_available;
mod state_lost;
mod store_not_effective;
mod store_signature;
mod stored;
mod sync_counter;
mod sync_period;
mod sync_producer;
mod time_not_monotonic;
mod traffic_before_boot;
mod transport_violation;
mod trouble_code;
mod uds_negative;
mod uds_no_response;
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
    entry!(bus_health),
    entry!(duplicate_node_id),
    entry!(duplicate_producer),
    entry!(node_lost),
    entry!(unexpected_boot),
    entry!(emcy_raised),
    entry!(sdo_answer_mismatch),
    entry!(sdo_no_response),
    entry!(config_lost),
    entry!(command_gap),
    entry!(guard_late),
    entry!(guard_no_answer),
    entry!(sync_period),
    entry!(sync_producer),
    entry!(commands_per_sync),
    entry!(mode_change_refused_or_ignored),
    entry!(mapping_procedure),
    entry!(mapping_invalid),
    entry!(parameter_locked),
    entry!(store_signature),
    entry!(store_not_effective),
    entry!(object_default),
    entry!(calibration),
    entry!(state_lost),
    entry!(fault_reset_without_edge),
    entry!(setpoint_not_effective),
    entry!(not_following),
    entry!(eeprom_wear),
    entry!(value_out_of_range),
    entry!(unsaved_change),
    entry!(address_contention),
    entry!(cannot_claim),
    entry!(identity_move),
    entry!(trouble_code),
    entry!(dm1_period),
    entry!(transport_violation),
    entry!(isotp_violation),
    entry!(request_unanswered),
    entry!(uds_no_response),
    entry!(uds_negative),
    entry!(spn_not_available),
    entry!(malformed_message),
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
