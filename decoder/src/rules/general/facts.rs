//! Object look-ups shared by several rules.

use crate::event::{DecodedPdo, SdoOutcome, SdoTransfer};
use crate::finding::FindingSubject;
use crate::frame::CanId;
use crate::profile::{PdoName, connection_set, little_endian};
use crate::rules::{PdoSlot, RuleContext};
use crate::session::{Node, OriginKind};
use crate::wire::canopen::ObjectAddress;

/// Bits of a COB-ID (CiA 301 §7.5.2.5, §7.5.2.35). Bit 31: the service does not exist. Bit 30 (SYNC, TIME):
/// the device is the producer. Bit 29: 29-bit identifier.
pub(super) const INVALID: u64 = 1 << 31;
pub(super) const PRODUCES: u64 = 1 << 30;
const EXTENDED: u64 = 1 << 29;

/// Subject of a finding about an SDO transfer.
pub(super) fn transfer_subject(transfer: &SdoTransfer) -> FindingSubject {
    transfer.object.map_or(FindingSubject::Whole, FindingSubject::Object)
}

/// Confirmed value of an object; see [`confirmed_value`].
pub(super) fn confirmed_number(node: &Node, index: u16, sub: u8) -> Option<u64> {
    confirmed_value(node, ObjectAddress::new(index, sub))
}

/// Value that was written, read or given and not invalidated by a restart since; `None` for PDO contents.
pub(super) fn confirmed_value(node: &Node, address: ObjectAddress) -> Option<u64> {
    let entry = node.store().seen_value(address)?;
    let is_certain = !entry.stale && entry.origin.kind != OriginKind::Pdo;
    is_certain.then(|| node.store().number(address)).flatten()
}

/// Value of an object, with its certainty.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) struct SettingValue {
    pub(super) value: u64,
    /// Factory setting of the assigned device; the object was neither written nor read.
    pub(super) is_default: bool,
}

/// Confirmed value, else the factory setting of the assigned device. `None` also for a value that a restart
/// may have replaced by a stored one.
pub(super) fn value_or_default(node: &Node, address: ObjectAddress) -> Option<SettingValue> {
    if let Some(value) = confirmed_value(node, address) {
        return Some(SettingValue { value, is_default: false });
    }
    node.assigned_by().filter(|_| node.store().get(address).is_none())?;
    let entry = node.device().dictionary.find_object(address)?.entry?;
    let value = u64::try_from(entry.default_number(Some(node.id().number()))?).ok()?;
    Some(SettingValue { value, is_default: true })
}

/// Value of a complete transfer of at most 8 bytes.
pub(super) fn transfer_number(transfer: &SdoTransfer) -> Option<u64> {
    let is_whole =
        transfer.outcome == SdoOutcome::Complete && !transfer.truncated && !transfer.data.is_empty();
    (is_whole && transfer.data.len() <= 8).then(|| little_endian(&transfer.data))
}

/// Identifier in a COB-ID; `None` if bit 31 marks it invalid.
#[expect(clippy::cast_possible_truncation, reason = "masked to the identifier's width")]
pub(super) fn cob_identifier(cob_id: u64) -> Option<CanId> {
    if cob_id & INVALID != 0 {
        return None;
    }
    Some(if cob_id & EXTENDED != 0 {
        CanId::from_extended(cob_id as u32)
    } else {
        CanId::from_standard(cob_id as u16)
    })
}

/// Whether an identifier is restricted by CiA 301 table 40.
fn is_restricted(id: CanId) -> bool {
    matches!(id, CanId::Standard(id) if connection_set().restriction_reason(id).is_some())
}

/// Whether a write sets a restricted identifier.
pub(super) fn is_restricted_write(object: ObjectAddress, number: u64) -> bool {
    let holds_id = match (object.index, object.sub) {
        (0x1005 | 0x1012 | 0x1014, 0) | (0x1280..=0x12FF, 1 | 2) => true,
        (index, 1) => PdoName::of_parameter(index).is_some_and(|name| name.communication_index() == index),
        _ => false,
    };
    holds_id && cob_identifier(number & !of_use(object.index)).is_some_and(is_restricted)
}

/// Flag bits of a COB-ID that do not affect its validity.
const fn of_use(index: u16) -> u64 {
    match index {
        0x1005 | 0x1012 => 3 << 30,
        _ => 1 << 30,
    }
}

/// Length of a PDO in bytes according to its confirmed mapping; `None` for remote frames.
#[inline]
pub(super) fn mapped_bytes(pdo: &DecodedPdo) -> Option<u16> {
    let layout = pdo.layout.as_deref()?;
    let is_certain = !layout.assumed && !pdo.is_request && layout.bits > 0 && !layout.origin.is_database();
    is_certain.then(|| layout.bits.div_ceil(8))
}

/// Whether a TPDO is sent on change only: event-driven without an event timer (CiA 301 §7.5.2.37), and never
/// repeated with unchanged content.
pub(super) fn is_sent_on_change(slot: &PdoSlot, context: &RuleContext<'_>) -> bool {
    let sent = context
        .bus
        .identifiers()
        .pdo_on(slot.id)
        .and_then(|(name, node)| Some((name, context.bus.node(node)?)));
    let is_configured = sent.is_some_and(|(name, node)| {
        let parameter = |sub| confirmed_number(node, name.communication_index(), sub);
        matches!(parameter(2), Some(254 | 255)) && parameter(5) == Some(0)
    });
    is_configured && slot.period_since(i64::MIN).is_none()
}

/// Converts nanoseconds to milliseconds.
pub(super) const fn to_milliseconds(nanoseconds: i64) -> i64 {
    nanoseconds / 1_000_000
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn identifiers_of_cob_ids() {
        assert_eq!(cob_identifier(0x185), Some(CanId::from_standard(0x185)));
        assert_eq!(cob_identifier(0x8000_0185), None);
        assert_eq!(cob_identifier(0x4000_0080), Some(CanId::from_standard(0x80)));
        assert_eq!(cob_identifier(0x2123_4567), Some(CanId::from_extended(0x0123_4567)));
    }

    #[test]
    fn identifiers_that_the_standard_keeps_for_others() {
        // CiA 301 §7.3.5, table 40; both ends of each range.
        for (first, last) in
            [(0x000, 0x07F), (0x101, 0x180), (0x581, 0x5FF), (0x601, 0x67F), (0x6E0, 0x6FF), (0x701, 0x7FF)]
        {
            let inside = [first, last].map(|id| is_restricted(CanId::from_standard(id)));
            let outside = [first.wrapping_sub(1), last + 1]
                .map(|id| id < 0x800 && is_restricted(CanId::from_standard(id)));
            assert_eq!((inside, outside), ([true; 2], [false; 2]), "{first:03X} to {last:03X}");
        }
        for (id, expected) in [(0x80, false), (0x100, false), (0x181, false), (0x6DF, false)] {
            assert_eq!(is_restricted(CanId::from_standard(id)), expected, "{id:03X}");
        }
        assert!(!is_restricted(CanId::from_extended(0x601)));
    }
}
