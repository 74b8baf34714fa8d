//! Rules about SYNC.

pub(super) mod sync_counter;
pub(super) mod sync_period;
pub(super) mod sync_producer;
