//! General rules, one file per rule, grouped in families.

mod bus;
mod device;
mod emcy;
mod error_control;
mod facts;
mod j1939;
mod nmt;
mod parameters;
mod pdo;
mod sdo;
mod sync;
mod uds;

use super::{Declaration, RegistryEntry};
pub(super) use bus::duplicate_producer::longest_period;

/// All general rules in evaluation order: a rule that explains other findings precedes the rules that report
/// them.
pub static REGISTRY: &[RegistryEntry] = &[
    bus::bus_health::ENTRY,
    bus::duplicate_node_id::ENTRY,
    bus::duplicate_producer::ENTRY,
    error_control::node_lost::ENTRY,
    nmt::unexpected_boot::ENTRY,
    nmt::late_start::ENTRY,
    emcy::emcy_raised::ENTRY,
    pdo::pdo_lost::ENTRY,
    sdo::sdo_answer_mismatch::ENTRY,
    sdo::sdo_no_response::ENTRY,
    sdo::sdo_client_does_not_wait::ENTRY,
    sdo::sdo_unrequested_response::ENTRY,
    parameters::config_lost::ENTRY,
    device::command_gap::ENTRY,
    error_control::guard_late::ENTRY,
    error_control::guard_no_answer::ENTRY,
    sync::sync_period::ENTRY,
    sync::sync_producer::ENTRY,
    device::commands_per_sync::ENTRY,
    device::mode_change_refused_or_ignored::ENTRY,
    pdo::mapping_procedure::ENTRY,
    pdo::mapping_invalid::ENTRY,
    parameters::parameter_locked::ENTRY,
    parameters::store_signature::ENTRY,
    parameters::store_not_effective::ENTRY,
    parameters::node_id_unchanged::ENTRY,
    parameters::identity_mismatch::ENTRY,
    parameters::object_default::ENTRY,
    device::calibration::ENTRY,
    device::active_not_ended::ENTRY,
    device::state_skipped::ENTRY,
    device::state_undefined::ENTRY,
    device::state_lost::ENTRY,
    device::fault_reset_without_edge::ENTRY,
    device::setpoint_not_effective::ENTRY,
    device::not_following::ENTRY,
    parameters::eeprom_wear::ENTRY,
    parameters::value_out_of_range::ENTRY,
    parameters::unsaved_change::ENTRY,
    j1939::address_contention::ENTRY,
    j1939::cannot_claim::ENTRY,
    j1939::identity_move::ENTRY,
    j1939::trouble_code::ENTRY,
    j1939::dm1_period::ENTRY,
    j1939::transport_violation::ENTRY,
    uds::isotp_violation::ENTRY,
    j1939::request_unanswered::ENTRY,
    uds::uds_no_response::ENTRY,
    uds::uds_negative::ENTRY,
    j1939::spn_not_available::ENTRY,
    bus::malformed_message::ENTRY,
    sdo::sdo_download_refused::ENTRY,
    sdo::sdo_abort_code::ENTRY,
    sdo::sdo_block_crc::ENTRY,
    sdo::sdo_block_sequence::ENTRY,
    sdo::sdo_block_loss::ENTRY,
    sdo::sdo_size::ENTRY,
    sdo::sdo_toggle::ENTRY,
    sdo::sdo_upload_refused::ENTRY,
    parameters::access_type::ENTRY,
    parameters::read_back::ENTRY,
    parameters::cob_id_mismatch::ENTRY,
    parameters::cob_id_restricted::ENTRY,
    nmt::boot_up_missing::ENTRY,
    nmt::traffic_before_boot::ENTRY,
    nmt::nmt_command_invalid::ENTRY,
    nmt::nmt_command_ignored::ENTRY,
    nmt::operational_lost::ENTRY,
    nmt::service_in_stopped::ENTRY,
    error_control::guard_toggle::ENTRY,
    error_control::guard_with_heartbeat::ENTRY,
    error_control::heartbeat_period::ENTRY,
    error_control::heartbeat_consumer::ENTRY,
    emcy::emcy_register::ENTRY,
    emcy::emcy_history::ENTRY,
    emcy::emcy_repeated::ENTRY,
    emcy::emcy_missing::ENTRY,
    pdo::pdo_outside_operational::ENTRY,
    pdo::pdo_invalid::ENTRY,
    pdo::pdo_short::ENTRY,
    pdo::pdo_long::ENTRY,
    sync::sync_counter::ENTRY,
    pdo::pdo_sync_cyclic::ENTRY,
    pdo::pdo_sync_acyclic::ENTRY,
    pdo::pdo_event_timer::ENTRY,
    pdo::pdo_inhibit_time::ENTRY,
    pdo::pdo_rtr::ENTRY,
    bus::lss_sequence::ENTRY,
    bus::time_not_monotonic::ENTRY,
];

/// Declarations of all general rules, in evaluation order.
pub fn all_declarations() -> impl Iterator<Item = &'static Declaration> {
    REGISTRY.iter().map(|entry| entry.declaration)
}
