//! Text on the network behaviour in a profile: identification, boot-up, monitoring.

use std::fmt::Write as _;

use cobscope_decoder::profile::DeviceProfile;
use cobscope_decoder::profile::device::{
    AtBoot, BootSign, ClearMeaning, DeviceIdentity, ErrorCodeOrder, Monitoring, OrderName,
};

use super::object::object_title;
use super::{behaviour, j1939, spaced_name, uds};

/// A property with its heading and section.
pub struct NetworkProperty {
    pub heading: &'static str,
    pub text: String,
    pub source: String,
}

/// All properties in a fixed order.
pub fn network_facts(device: &DeviceProfile) -> Vec<NetworkProperty> {
    let fact =
        |heading, text: String, source: &str| NetworkProperty { heading, text, source: source.to_owned() };
    let mut facts = vec![fact("recognised by", recognition_text(device), "")];
    facts.extend(device.hints.iter().map(|hint| fact("suggested by", hint.text.clone(), "")));
    facts.push(fact("starts with", start_text(device), &device.nmt.source));
    facts.push(fact("NMT", nmt_text(device), &device.nmt.source));
    facts.push(fact("monitoring", monitoring_text(&device.monitoring), &device.monitoring.source));
    facts.push(fact("EMCY", emcy_text(device), &device.emcy.source));
    facts.push(fact("J1939", j1939::j1939_facts(device), &device.j1939.source));
    if !device.uds.is_empty() {
        let note = if device.uds.note.is_empty() { String::new() } else { format!("; {}", device.uds.note) };
        facts.push(fact("UDS", format!("{}{note}", uds::byte_order(device)), &device.uds.source));
    }
    facts.push(fact("new node-ID", node_id(device), &device.identity_change.source));
    facts.retain(|fact| !fact.text.is_empty());
    facts
}

fn recognition_text(device: &DeviceProfile) -> String {
    let all: Vec<_> = device.identities.iter().map(identity_text).collect();
    if all.is_empty() { "none; assign it in the bus file or with --node".into() } else { all.join("; or ") }
}

/// `1018:01 = 01000019, 1018:02 = 53360000`.
fn identity_text(identity: &DeviceIdentity) -> String {
    let numbers = [
        ("1018:01", identity.vendor_id),
        ("1018:02", identity.product_code),
        ("1018:03", identity.revision),
        ("1000:00", identity.device_type),
    ];
    let numbers =
        numbers.iter().filter_map(|(object, number)| Some(format!("{object} = {:08X}", (*number)?)));
    let name = identity.device_name.iter().map(|name| format!("1008:00 starts with \"{name}\""));
    let variant = identity.variant.iter().map(|variant| format!("as {variant}"));
    numbers.chain(name).chain(variant).collect::<Vec<_>>().join(", ")
}

fn start_text(device: &DeviceProfile) -> String {
    let boot = match device.nmt.boot {
        BootSign::BootUp => "a boot-up message",
        BootSign::BootUpAfterPowerOn => "a boot-up message, specified after power-on only",
        BootSign::ReadyTelegram => "an EMCY message: empty without error, else with the error code",
    };
    let zero = if device.emcy.at_boot == AtBoot::NoError { ", and EMCY 0000" } else { "" };
    format!("{boot}{zero}")
}

fn nmt_text(device: &DeviceProfile) -> String {
    let states: Vec<_> = device.nmt.states.iter().map(|state| behaviour::nmt_name(*state)).collect();
    let mut parts = Vec::new();
    if !states.is_empty() {
        parts.push(format!("states {}", states.join(", ")));
    }
    if !device.nmt.commands.is_empty() {
        parts.push(format!("commands {}", device.nmt.commands.join(", ")));
    }
    parts.extend(Some(device.nmt.note.clone()).filter(|note| !note.is_empty()));
    parts.join("; ")
}

fn monitoring_text(monitoring: &Monitoring) -> String {
    let mut parts = Vec::new();
    if let Some(guarding) = monitoring.guarding {
        parts.push(match guarding.time {
            0 => "guarding, off as delivered".into(),
            time => format!("guarding, {time} ms × {} as delivered", guarding.factor),
        });
    }
    if let Some(heartbeat) = monitoring.heartbeat {
        let mut text = match heartbeat.default {
            0 => "heartbeat, off as delivered".to_owned(),
            time => format!("heartbeat, {time} ms as delivered"),
        };
        if let Some(step) = heartbeat.step {
            let _ = write!(text, ", in steps of {step} ms");
        }
        parts.push(text);
    }
    if let Some(wins) = &monitoring.wins {
        parts.push(format!("{} takes precedence if both are on", wins.name()));
    }
    if let Some(code) = monitoring.life_guard_emcy {
        parts.push(format!("EMCY {code:04X} if the master stops guarding"));
    }
    if monitoring.consumer {
        parts.push("heartbeat consumer".into());
    }
    parts.extend(Some(monitoring.note.clone()).filter(|note| !note.is_empty()));
    parts.join("; ")
}

fn emcy_text(device: &DeviceProfile) -> String {
    let order = |order: OrderName| match order {
        OrderName::LsbFirst => "least significant byte first",
        OrderName::MsbFirst => "most significant byte first",
    };
    let mut parts = Vec::new();
    match &device.emcy.byte_order {
        None => {}
        Some(ErrorCodeOrder::Fixed(name)) => parts.push(format!("code {}", order(*name))),
        Some(ErrorCodeOrder::ByObject { object, equals, default }) => {
            let list: Vec<_> =
                equals.iter().map(|(value, name)| format!("{value} = {}", order(*name))).collect();
            let by = object_title(device, object.object);
            parts.push(format!("code {} as delivered ({by}: {})", order(*default), list.join(", ")));
        }
    }
    parts.push(match device.emcy.cleared {
        ClearMeaning::Each => "0000 for each error that is cleared".into(),
        ClearMeaning::AllGone => "0000 only after all errors are cleared".into(),
    });
    let fields = device.emcy.vendor.iter().map(|field| {
        let last = field.byte.saturating_add(field.bytes.saturating_sub(1));
        let bytes = if last == field.byte { last.to_string() } else { format!("{}-{last}", field.byte) };
        format!("byte {bytes} {}", spaced_name(&field.name))
    });
    parts.extend(fields);
    if device.emcy.code.is_empty() { String::new() } else { parts.join("; ") }
}

fn node_id(device: &DeviceProfile) -> String {
    let change = &device.identity_change;
    let mut parts = Vec::new();
    if !change.cob_ids_stay.is_empty() {
        parts.push(format!("{} keep their identifiers", change.cob_ids_stay.join(", ")));
    }
    if !change.resets.is_empty() {
        let resets: Vec<_> = change.resets.iter().map(ToString::to_string).collect();
        parts.push(format!("{} return to their defaults", resets.join(", ")));
    }
    parts.join("; ")
}
