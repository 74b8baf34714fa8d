//! Text on UDS in a profile.

use cobscope_decoder::profile::device::{UdsIdentifier, UdsNrc};
use cobscope_decoder::profile::object::ObjectRole;
use cobscope_decoder::profile::{DataType, DeviceProfile, WriteEffect};
use cobscope_decoder::wire::canopen::emcy::EmcyByteOrder;

/// Byte order of identifiers and numbers.
pub fn byte_order(device: &DeviceProfile) -> &'static str {
    match device.uds.order() {
        EmcyByteOrder::LsbFirst => "identifiers least significant byte first",
        EmcyByteOrder::MsbFirst => "identifiers most significant byte first",
    }
}

/// `rw UNSIGNED8, 1 to 127, 32 as delivered, the node-ID, active after reset node`.
pub fn identifier_text(identifier: &UdsIdentifier) -> String {
    let access = identifier.access.map_or("", |access| access.name());
    let kind = identifier.data_type.map_or(String::new(), DataType::name);
    let unit = if identifier.unit.is_empty() { String::new() } else { format!(" {}", identifier.unit) };
    let role = match identifier.role {
        Some(ObjectRole::NodeId) => "the node-ID".to_owned(),
        Some(role) => role.name().to_owned(),
        None => String::new(),
    };
    let effect = match identifier.effect {
        WriteEffect::Unknown => String::new(),
        WriteEffect::AtOnce => "active at once".into(),
        WriteEffect::Never => "accepted without effect".into(),
        effect => format!("active {}", effect.time_text()),
    };
    let parts = [
        format!("{access} {kind}").trim().to_owned(),
        identifier.range.map_or(String::new(), |[least, most]| format!("{least} to {most}{unit}")),
        identifier.default.map_or(String::new(), |default| format!("{default}{unit} as delivered")),
        role,
        effect,
    ];
    parts.into_iter().filter(|part| !part.is_empty()).collect::<Vec<_>>().join(", ")
}

/// `service 2E, identifier 1001`; empty if the text applies to all.
pub fn scope_text(nrc: &UdsNrc) -> String {
    let services = nrc.services.iter().map(|service| format!("service {service:02X}"));
    let identifiers = nrc.identifiers.iter().map(|id| format!("identifier {id:04X}"));
    services.chain(identifiers).collect::<Vec<_>>().join(", ")
}
