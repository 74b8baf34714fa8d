//! Explains COB-IDs.

use std::fmt::Write as _;

use cobscope_decoder::profile::{self, IdentifierOwner, PdoDirection};
use cobscope_decoder::wire::canopen::sdo::SdoSide;

/// Use of an 11-bit identifier in the predefined connection set.
pub(super) fn explain_identifier(id: u16) -> String {
    let set = profile::connection_set();
    let node = |node: u8| format!("node {node}/{node:02X}");
    let what = match set.owner_of(id) {
        IdentifierOwner::Unclassified => "no default use in CANopen".into(),
        IdentifierOwner::Named(name) => format!("{name} (not decoded)"),
        IdentifierOwner::Nmt => "NMT command, from the NMT master".into(),
        IdentifierOwner::Sync => "SYNC".into(),
        IdentifierOwner::Time => "TIME".into(),
        IdentifierOwner::Emcy(id) => format!("EMCY of {}", node(id)),
        IdentifierOwner::Pdo(name, id) => {
            let verb = if name.direction == PdoDirection::Transmit { "sent" } else { "received" };
            format!("{name}, {verb} by {}", node(id))
        }
        IdentifierOwner::Sdo(SdoSide::Server, id) => {
            format!("SDO response of {} (server to client)", node(id))
        }
        IdentifierOwner::Sdo(SdoSide::Client, id) => {
            format!("SDO request to {} (client to server)", node(id))
        }
        IdentifierOwner::ErrorControl(id) => {
            format!("NMT error control of {} (heartbeat, boot-up or guarding)", node(id))
        }
        IdentifierOwner::TestMarker => "marks of the CiA conformance test tool".into(),
        IdentifierOwner::Lss(true) => "LSS, from the master".into(),
        IdentifierOwner::Lss(false) => "LSS, from a slave".into(),
    };
    let mut text = format!("{id:03X}  COB-ID in the predefined connection set: {what}\n");
    let is_free = matches!(set.owner_of(id), IdentifierOwner::Unclassified | IdentifierOwner::Named(_));
    if let Some(why) = set.restriction_reason(id).filter(|_| is_free) {
        let _ = writeln!(text, "     restricted ({why}): must not be configured for another service");
    }
    text
}
