//! Conditions of CiA 301 for the processing of an RPDO, which every device has: its COB-ID, its length, its SYNC.

use super::node::Node;
use super::set_point::{GatedSetPoint, ShortPayload};
use crate::frame::CanId;
use crate::profile::device::{GateStatus, PdoEffect};
use crate::profile::{PdoName, ValueCarrier};
use crate::session::bus::objects::{INVALID, OriginKind, nonzero_identifier};
use crate::wire::canopen::ObjectAddress;

/// Name of the gate of the SYNC after a synchronous RPDO.
pub(in crate::session) const SYNC_GATE: &str = "SYNC";

/// Reason for which a device does not process the RPDO with a set point.
#[derive(Debug)]
pub(in crate::session) struct ReceptionObstacle {
    /// Name of the gate.
    pub(in crate::session) gate: &'static str,
    /// `Closed`, or `Unknown` if it depends on an assumption.
    pub(in crate::session) status: GateStatus,
    /// The fact that decided.
    pub(in crate::session) detail: String,
    /// Identifier on which the commands arrive, if it contradicts the configured one.
    pub(in crate::session) id: Option<CanId>,
    /// What to do.
    pub(in crate::session) check: &'static str,
    /// Clause.
    pub(in crate::session) source: &'static str,
}

/// All reasons for which the RPDO with a set point is not processed.
pub(in crate::session) fn reception_obstacles(
    node: &Node,
    subject: GatedSetPoint<'_>,
) -> Vec<ReceptionObstacle> {
    let ValueCarrier::Pdo(name) = *subject.carrier else { return Vec::new() };
    let found =
        [other_cob_id(node, name, subject), missing_sync(node, name, subject), short_payload(subject)];
    found.into_iter().flatten().collect()
}

/// Contradiction between the configured COB-ID of an RPDO and the identifier on which it arrives; bit 31
/// marks a PDO that is not valid. A set point received before the COB-ID was written remains in force.
fn other_cob_id(node: &Node, name: PdoName, subject: GatedSetPoint<'_>) -> Option<ReceptionObstacle> {
    let (id, frame) = subject.id?;
    let cob_id = node.configured_cob_id(name)?;
    let object = ObjectAddress::new(name.communication_index(), 1);
    let detail = if cob_id & INVALID != 0 {
        format!("{object} = {cob_id:X}h (bit 31: not valid)")
    } else {
        let origin = node.store.seen_value(object)?.origin;
        let is_later = origin.kind != OriginKind::Download || frame > origin.frame;
        if !is_later || nonzero_identifier(cob_id) == Some(id) {
            return None;
        }
        format!("{object} = {cob_id:X}h")
    };
    Some(ReceptionObstacle {
        gate: "RPDO COB-ID",
        status: GateStatus::Closed,
        detail,
        id: Some(id),
        check: "send the commands on the configured COB-ID, or configure the COB-ID of the commands",
        source: "CiA 301 §7.5.2.35",
    })
}

/// A synchronous RPDO without a SYNC after it.
fn missing_sync(node: &Node, name: PdoName, subject: GatedSetPoint<'_>) -> Option<ReceptionObstacle> {
    if !subject.late {
        return None;
    }
    let kind = ObjectAddress::new(name.communication_index(), 2);
    let spec = node.device.pdos.iter().find(|spec| spec.pdo == name);
    let is_fixed = spec.is_some_and(|spec| spec.effect == PdoEffect::AtSync);
    let is_seen = node.store.seen_value(kind).is_some_and(|value| !value.stale);
    let number = node.store.number(kind);
    Some(ReceptionObstacle {
        gate: SYNC_GATE,
        status: if is_fixed || is_seen { GateStatus::Closed } else { GateStatus::Unknown },
        detail: number.map_or("no SYNC after the RPDO".to_owned(), |number| {
            format!("{kind} = {number} (synchronous), no SYNC after the RPDO")
        }),
        id: None,
        check: "send SYNC with the COB-ID in 1005:00, or set the transmission type to 254 or 255",
        source: "CiA 301 §7.5.2.35",
    })
}

/// A device does not process an RPDO with less data than its mapping.
fn short_payload(subject: GatedSetPoint<'_>) -> Option<ReceptionObstacle> {
    let ShortPayload { bytes, needed, assumed } = subject.short?;
    Some(ReceptionObstacle {
        gate: "RPDO length",
        status: if assumed { GateStatus::Unknown } else { GateStatus::Closed },
        detail: format!("{bytes} bytes, the mapping needs {needed}"),
        id: None,
        check: "send all bytes of the mapping",
        source: "CiA 301 §7.2.2.3, table 26 (8210)",
    })
}
