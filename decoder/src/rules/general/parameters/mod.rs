//! Rules about objects: access, values, storage, COB-IDs.

pub(super) mod access_type;
pub(super) mod cob_id_mismatch;
pub(super) mod cob_id_restricted;
pub(super) mod config_lost;
pub(super) mod eeprom_wear;
pub(super) mod identity_mismatch;
pub(super) mod node_id_unchanged;
pub(super) mod object_default;
pub(super) mod parameter_locked;
pub(super) mod read_back;
pub(super) mod store_not_effective;
pub(super) mod store_signature;
mod stored;
pub(super) mod unsaved_change;
pub(super) mod value_out_of_range;
