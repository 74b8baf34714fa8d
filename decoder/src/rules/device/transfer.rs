//! SDO transfers as updates of values.

use crate::event::{SdoAbort, SdoDirection, SdoOutcome, SdoTransfer};
use crate::profile::device::{UpdateSource, ValueUpdate};
use crate::profile::{DataType, DecodedValue, as_integer, little_endian};

/// Update from a transfer that the server confirmed or refused; None for other transfers.
pub(super) fn update_of(transfer: &SdoTransfer, before: Option<i64>) -> Option<ValueUpdate<'_>> {
    let is_confirmed = match (transfer.outcome, transfer.abort) {
        (SdoOutcome::Complete, _) => true,
        (SdoOutcome::Aborted, Some(SdoAbort { by_client: false, .. })) => false,
        _ => return None,
    };
    let source = match (transfer.direction?, is_confirmed) {
        (SdoDirection::Download, true) => UpdateSource::Written,
        (SdoDirection::Download, false) => UpdateSource::Refused,
        (SdoDirection::Upload, true) => UpdateSource::Read,
        (SdoDirection::Upload, false) => return None,
    };
    let is_complete = !transfer.truncated
        && transfer.announced.is_none_or(|size| u64::from(size) == transfer.size)
        && (!transfer.cut_start || source == UpdateSource::Read);
    let bytes = if is_complete { transfer.data.as_slice() } else { &[] };
    let meaning = transfer.meaning.as_deref();
    let raw =
        bytes_as_number(bytes, meaning.and_then(|meaning| meaning.data_type)).and_then(|it| as_integer(&it));
    Some(ValueUpdate { object: transfer.object?, source, raw, before, bytes, meaning, is_fresh: false })
}

/// Bytes as a number. An expedited transfer without a size has more bytes than the data type.
fn bytes_as_number(bytes: &[u8], data_type: Option<DataType>) -> Option<DecodedValue> {
    let width = data_type.and_then(DataType::bits).map(|bits| usize::from(bits.div_ceil(8)));
    match (data_type, width.and_then(|width| bytes.get(..width))) {
        (Some(data_type), Some(bytes)) if bytes.len() <= 8 => {
            Some(data_type.decode_raw(little_endian(bytes)))
        }
        _ if bytes.is_empty() || bytes.len() > 8 => None,
        _ => Some(DecodedValue::Unsigned(little_endian(bytes))),
    }
}
