//! Rules about UDS and ISO-TP.

pub(super) mod isotp_violation;
pub(super) mod uds_negative;
pub(super) mod uds_no_response;
