//! Text on J1939 in a profile: addresses, messages, faults.

use cobscope_decoder::profile::DeviceProfile;
use cobscope_decoder::profile::device::{DeviceTroubleCode, MessageDirection, MessageSpec};

use super::object::object_title;

/// `addresses 80 to 8F; DM1 every 1000 ms, with the most urgent fault only`.
pub fn j1939_facts(device: &DeviceProfile) -> String {
    let spec = &device.j1939;
    let addresses = spec.addresses.map(|[first, last]| format!("addresses {first:02X} to {last:02X}"));
    let period = (spec.dm1_period > 0).then(|| format!(" every {} ms", spec.dm1_period));
    let only = if spec.highest_only { ", with the most urgent fault only" } else { "" };
    let dm1 = (!spec.dtc.is_empty()).then(|| format!("DM1{}{only}", period.unwrap_or_default()));
    addresses.into_iter().chain(dm1).collect::<Vec<_>>().join("; ")
}

/// `AVC valve n, received, FE30 to FE3F, n = address − 0x80`.
pub fn message_name(message: &MessageSpec) -> String {
    let title = if message.title.is_empty() { &message.name } else { &message.title };
    let title = title.replace("{n}", "n");
    let last = message.pgn.saturating_add(u32::from(message.count).saturating_sub(1));
    let groups = if last > message.pgn {
        format!("{:04X} to {last:04X}", message.pgn)
    } else {
        format!("{:04X}", message.pgn)
    };
    let way = match message.direction {
        MessageDirection::Transmit => "sent",
        MessageDirection::Receive => "received",
    };
    let number = message.number.as_ref().map_or(String::new(), |number| {
        format!(", n = {}", number.replace("$NODEID", "address ").replace('-', "− "))
    });
    format!("{title}, {way}, {groups}{number}")
}

/// `every 100 ms; timeout 250 ms; FE30:01 Port flow command (8 bit), …`.
pub fn message_contents(device: &DeviceProfile, message: &MessageSpec) -> String {
    let period = message.period.map(|period| format!("every {period} ms"));
    let timeout = message.timeout.map(|timeout| format!("timeout {timeout} ms"));
    let fields = message.fields.iter().filter_map(|field| {
        let object = field.object?;
        Some(format!("{} ({} bit)", object_title(device, object.object), field.bits))
    });
    let fields = fields.collect::<Vec<_>>().join(", ");
    period.into_iter().chain(timeout).chain([fields]).collect::<Vec<_>>().join("; ")
}

/// `298985/19`.
pub fn dtc_code(dtc: &DeviceTroubleCode) -> String {
    format!("{}/{}", dtc.spn, dtc.fmi)
}

/// `time guarding, warning, external → BLOCKED; needs 2 neutral AVC and spool neutral`.
pub fn dtc_text(dtc: &DeviceTroubleCode) -> String {
    let words = [&dtc.text, &dtc.severity, &dtc.origin].map(String::as_str);
    let mut text = words.into_iter().filter(|word| !word.is_empty()).collect::<Vec<_>>().join(", ");
    if !dtc.reaction.is_empty() {
        text.push_str(" → ");
        text.push_str(&dtc.reaction);
    }
    if !dtc.recovery.is_empty() {
        text.push_str("; needs ");
        text.push_str(&dtc.recovery);
    }
    text
}
