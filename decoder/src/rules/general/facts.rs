//! What several rules look up.

use crate::event::{Outcome, Pdo, SdoTransfer};
use crate::finding::About;
use crate::frame::CanId;
use crate::profile::{PdoName, little_endian};
use crate::session::{Node, OriginKind};
use crate::wire::canopen::ObjectAddress;

/// Bit 31 of a COB-ID: the service does not exist. Bit 30 of one of SYNC or TIME: the device produces it.
/// Bit 29: the identifier has 29 bits (CiA 301 §7.5.2.5, §7.5.2.35).
pub(super) const INVALID: u64 = 1 << 31;
pub(super) const PRODUCES: u64 = 1 << 30;
const EXTENDED: u64 = 1 << 29;

/// What a finding about a transfer is about.
pub(super) fn about(transfer: &SdoTransfer) -> About {
    transfer.object.map_or(About::Whole, About::Object)
}

/// A number a node surely has, by index and sub-index.
pub(super) fn sure(node: &Node, index: u16, sub: u8) -> Option<u64> {
    sure_of(node, ObjectAddress::new(index, sub))
}

/// A number a node surely has: written, read or given, and no restart since that may have changed it.
pub(super) fn sure_of(node: &Node, address: ObjectAddress) -> Option<u64> {
    let entry = node.store().seen(address)?;
    let is_sure = !entry.stale && entry.origin.kind != OriginKind::Pdo;
    is_sure.then(|| node.store().number(address)).flatten()
}

/// The number a transfer carried to its end, all of it seen.
pub(super) fn number(transfer: &SdoTransfer) -> Option<u64> {
    let is_whole = transfer.outcome == Outcome::Complete && !transfer.truncated && !transfer.data.is_empty();
    (is_whole && transfer.data.len() <= 8).then(|| little_endian(&transfer.data))
}

/// The identifier in a COB-ID; `None` where it is marked invalid.
#[expect(clippy::cast_possible_truncation, reason = "masked to the identifier's width")]
pub(super) fn identifier(cob_id: u64) -> Option<CanId> {
    if cob_id & INVALID != 0 {
        return None;
    }
    Some(if cob_id & EXTENDED != 0 { CanId::extended(cob_id as u32) } else { CanId::standard(cob_id as u16) })
}

/// Whether CiA 301 keeps an identifier for others.
fn is_restricted(id: CanId) -> bool {
    let CanId::Standard(id) = id else { return false };
    matches!(id, 0x001..=0x07F | 0x101..=0x180 | 0x581..=0x5FF | 0x601..=0x67F | 0x6E0..=0x6FF | 0x701..=0x7FF)
}

/// Whether an identifier is written that CiA 301 keeps for others.
pub(super) fn is_restricted_write(object: ObjectAddress, number: u64) -> bool {
    let holds_id = match (object.index, object.sub) {
        (0x1005 | 0x1012 | 0x1014, 0) | (0x1280..=0x12FF, 1 | 2) => true,
        (index, 1) => PdoName::of_parameter(index).is_some_and(|name| name.communication_index() == index),
        _ => false,
    };
    holds_id && identifier(number & !of_use(object.index)).is_some_and(is_restricted)
}

/// Bits of a COB-ID that do not say whether it is valid.
const fn of_use(index: u16) -> u64 {
    match index {
        0x1005 | 0x1012 => 3 << 30,
        _ => 1 << 30,
    }
}

/// Bytes a PDO has by its mapping, where that is sure; not of remote frames.
#[inline]
pub(super) fn mapped_bytes(pdo: &Pdo) -> Option<u16> {
    let layout = pdo.layout.as_deref()?;
    let is_sure =
        !layout.assumed && !pdo.is_request && layout.bits > 0 && !matches!(layout.origin, "dbc" | "json");
    is_sure.then(|| layout.bits.div_ceil(8))
}

/// A time as milliseconds, for texts.
pub(super) const fn milliseconds(nanoseconds: i64) -> i64 {
    nanoseconds / 1_000_000
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn identifiers_of_cob_ids() {
        assert_eq!(identifier(0x185), Some(CanId::standard(0x185)));
        assert_eq!(identifier(0x8000_0185), None);
        assert_eq!(identifier(0x4000_0080), Some(CanId::standard(0x80)));
        assert_eq!(identifier(0x2123_4567), Some(CanId::extended(0x0123_4567)));
    }

    #[test]
    fn identifiers_that_the_standard_keeps_for_others() {
        for (id, expected) in
            [(0x80, false), (0x180, true), (0x181, false), (0x6DF, false), (0x6E0, true), (0x0, false)]
        {
            assert_eq!(is_restricted(CanId::standard(id)), expected, "{id:03X}");
        }
        assert!(!is_restricted(CanId::extended(0x601)));
    }
}
