//! Rules about J1939.

pub(super) mod address_contention;
pub(super) mod cannot_claim;
pub(super) mod dm1_period;
pub(super) mod identity_move;
pub(super) mod request_unanswered;
pub(super) mod spn_not_available;
pub(super) mod transport_violation;
pub(super) mod trouble_code;
