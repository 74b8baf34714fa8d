//! Rules about SDO transfers.

mod abort_codes;
pub(super) mod sdo_abort_code;
pub(super) mod sdo_answer_mismatch;
pub(super) mod sdo_block_crc;
pub(super) mod sdo_block_loss;
pub(super) mod sdo_block_sequence;
pub(super) mod sdo_client_does_not_wait;
pub(super) mod sdo_download_refused;
pub(super) mod sdo_no_response;
pub(super) mod sdo_situation;
pub(super) mod sdo_size;
pub(super) mod sdo_toggle;
pub(super) mod sdo_unrequested_response;
pub(super) mod sdo_upload_refused;
