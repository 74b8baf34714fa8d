//! Rules about a bus as a whole: health, duplicate producers, invalid messages.

pub(super) mod bus_health;
pub(super) mod duplicate_node_id;
pub(super) mod duplicate_producer;
pub(super) mod lss_sequence;
pub(super) mod malformed_message;
pub(super) mod time_not_monotonic;
