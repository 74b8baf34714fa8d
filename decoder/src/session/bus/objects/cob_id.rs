//! Identifiers in COB-ID objects and in the predefined connection set.

use crate::frame::CanId;
use crate::profile::{PdoDirection, PdoName};
use crate::wire::NodeId;

/// Bit 31 of a COB-ID: the object is not valid. Bit 29: the identifier has 29 bits.
pub(in crate::session) const INVALID: u64 = 1 << 31;

const EXTENDED: u64 = 1 << 29;

/// Identifier in a COB-ID object; `None` if bit 31 marks it as not valid.
#[expect(clippy::cast_possible_truncation, reason = "masked to the identifier's width")]
pub(in crate::session) fn cob_identifier(cob_id: u64) -> Option<CanId> {
    if cob_id & INVALID != 0 {
        return None;
    }
    Some(if cob_id & EXTENDED != 0 {
        CanId::from_extended(cob_id as u32)
    } else {
        CanId::from_standard(cob_id as u16)
    })
}

/// Identifier in a COB-ID object; `None` if it is 0 or marked as not valid.
pub(in crate::session) fn nonzero_identifier(cob_id: u64) -> Option<CanId> {
    if cob_id & INVALID != 0 {
        return None;
    }
    let number = u32::try_from(cob_id & 0x1FFF_FFFF).ok().filter(|number| *number != 0)?;
    let standard = u16::try_from(number).ok().filter(|number| *number <= 0x7FF && cob_id & EXTENDED == 0);
    Some(standard.map_or(CanId::from_extended(number), CanId::from_standard))
}

/// Identifier of a PDO in the predefined connection set (CiA 301 §7.3.3, table 39); `None` for PDO 5 and up.
pub(in crate::session) fn predefined_identifier(name: PdoName, node: NodeId) -> Option<CanId> {
    let base = match name.direction {
        PdoDirection::Transmit => 0x180,
        PdoDirection::Receive => 0x200,
    };
    let step = name.number.checked_sub(1).filter(|step| *step < 4)?;
    Some(CanId::from_standard(base + 0x100 * step + u16::from(node.number())))
}
