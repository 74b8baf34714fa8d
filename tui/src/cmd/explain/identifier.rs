//! Explains COB-IDs.

use std::fmt::Write as _;

use cobscope_decoder::profile::{self, Owner, PdoDirection};
use cobscope_decoder::wire::canopen::sdo::Side;

/// Use of an 11-bit identifier in the predefined connection set.
pub(super) fn identifier(id: u16) -> String {
    let set = profile::connection_set();
    let node = |node: u8| format!("node {node}/{node:02X}");
    let what = match set.owner(id) {
        Owner::Unclassified => "no default use in CANopen".into(),
        Owner::Named(name) => format!("{name} (not decoded)"),
        Owner::Nmt => "NMT command, from the NMT master".into(),
        Owner::Sync => "SYNC".into(),
        Owner::Time => "TIME".into(),
        Owner::Emcy(id) => format!("EMCY of {}", node(id)),
        Owner::Pdo(name, id) => {
            let verb = if name.direction == PdoDirection::Transmit { "sent" } else { "received" };
            format!("{name}, {verb} by {}", node(id))
        }
        Owner::Sdo(Side::Server, id) => format!("SDO response of {} (server to client)", node(id)),
        Owner::Sdo(Side::Client, id) => format!("SDO request to {} (client to server)", node(id)),
        Owner::ErrorControl(id) => {
            format!("NMT error control of {} (heartbeat, boot-up or guarding)", node(id))
        }
        Owner::TestMarker => "marks of the CiA conformance test tool".into(),
        Owner::Lss(true) => "LSS, from the master".into(),
        Owner::Lss(false) => "LSS, from a slave".into(),
    };
    let mut text = format!("{id:03X}  COB-ID in the predefined connection set: {what}\n");
    let is_free = matches!(set.owner(id), Owner::Unclassified | Owner::Named(_));
    if let Some(why) = set.restriction(id).filter(|_| is_free) {
        let _ = writeln!(text, "     restricted ({why}): must not be configured for another service");
    }
    text
}
