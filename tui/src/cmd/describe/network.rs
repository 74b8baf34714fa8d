//! Text on the network behaviour in a profile: identification, boot-up, monitoring.

use std::fmt::Write as _;

use cobscope_decoder::profile::Device;
use cobscope_decoder::profile::device::{AtBoot, Boot, ClearMeaning, Identity, Monitoring, Order, OrderName};

use super::object::named;
use super::{behaviour, j1939, spaced, uds};

/// A property with its heading and section.
pub(in crate::cmd) struct Fact {
    pub heading: &'static str,
    pub text: String,
    pub source: String,
}

/// All properties in a fixed order.
pub(in crate::cmd) fn facts(device: &Device) -> Vec<Fact> {
    let fact = |heading, text: String, source: &str| Fact { heading, text, source: source.to_owned() };
    let mut facts = vec![fact("recognised by", recognised(device), "")];
    facts.extend(device.hints.iter().map(|hint| fact("suggested by", hint.text.clone(), "")));
    facts.push(fact("starts with", start(device), &device.nmt.source));
    facts.push(fact("NMT", nmt(device), &device.nmt.source));
    facts.push(fact("monitoring", watched(&device.monitoring), &device.monitoring.source));
    facts.push(fact("EMCY", emcy(device), &device.emcy.source));
    facts.push(fact("J1939", j1939::facts(device), &device.j1939.source));
    if !device.uds.is_empty() {
        let note = if device.uds.note.is_empty() { String::new() } else { format!("; {}", device.uds.note) };
        facts.push(fact("UDS", format!("{}{note}", uds::order(device)), &device.uds.source));
    }
    facts.push(fact("new node-ID", node_id(device), &device.identity_change.source));
    facts.retain(|fact| !fact.text.is_empty());
    facts
}

fn recognised(device: &Device) -> String {
    let all: Vec<_> = device.identities.iter().map(identity).collect();
    if all.is_empty() { "none; assign it in the bus file or with --node".into() } else { all.join("; or ") }
}

/// `1018:01 = 01000019, 1018:02 = 53360000`.
fn identity(identity: &Identity) -> String {
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

fn start(device: &Device) -> String {
    let boot = match device.nmt.boot {
        Boot::BootUp => "a boot-up message",
        Boot::BootUpAfterPowerOn => "a boot-up message, specified after power-on only",
        Boot::ReadyTelegram => "an EMCY message: empty without error, else with the error code",
    };
    let zero = if device.emcy.at_boot == AtBoot::NoError { ", and EMCY 0000" } else { "" };
    format!("{boot}{zero}")
}

fn nmt(device: &Device) -> String {
    let states: Vec<_> = device.nmt.states.iter().map(|state| behaviour::nmt(*state)).collect();
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

fn watched(monitoring: &Monitoring) -> String {
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

fn emcy(device: &Device) -> String {
    let order = |order: OrderName| match order {
        OrderName::LsbFirst => "least significant byte first",
        OrderName::MsbFirst => "most significant byte first",
    };
    let mut parts = Vec::new();
    match &device.emcy.byte_order {
        None => {}
        Some(Order::Fixed(name)) => parts.push(format!("code {}", order(*name))),
        Some(Order::ByObject { object, equals, default }) => {
            let list: Vec<_> =
                equals.iter().map(|(value, name)| format!("{value} = {}", order(*name))).collect();
            let by = named(device, object.object);
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
        format!("byte {bytes} {}", spaced(&field.name))
    });
    parts.extend(fields);
    if device.emcy.code.is_empty() { String::new() } else { parts.join("; ") }
}

fn node_id(device: &Device) -> String {
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
