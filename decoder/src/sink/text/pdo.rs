//! Text of PDOs. They are the most frequent lines, so payload and plain numbers are written without `fmt`.

use std::io::Write as _;

use super::parts::{push_bytes, push_object};
use crate::ascii::{push_decimal, push_integer, push_spaced_word};
use crate::event::{DecodedPdo, Event};
use crate::profile::device::MappingSource;
use crate::profile::{
    DecodedSignal, DecodedValue, DeviceProfile, ObjectMeaning, PayloadLayout, PdoDirection, PdoName,
    SignalField,
};
use crate::query::record::event_device as device_of;
use crate::session::Bus;
use crate::wire::NodeId;
use crate::words::count_noun;

/// Appends `TPDO1`.
pub(super) fn push_name(name: PdoName, out: &mut Vec<u8>) {
    out.extend_from_slice(match name.direction {
        PdoDirection::Transmit => b"TPDO",
        PdoDirection::Receive => b"RPDO",
    });
    push_decimal(out, u64::from(name.number));
}

/// Appends ` 08 A0 1F 00 20`.
#[inline]
pub(super) fn push_payload(pdo: &DecodedPdo, out: &mut Vec<u8>) {
    if pdo.is_request {
        return out.extend_from_slice(b" requested by remote frame");
    }
    match pdo.bytes.first_chunk() {
        Some(bytes) if (1..=8).contains(&pdo.length) => {
            push_spaced_word(out, *bytes, usize::from(pdo.length));
        }
        _ => {
            out.push(b' ');
            push_bytes(out, pdo.payload());
        }
    }
}

/// Appends signals, other users of the identifier, and the key of a missing mapping if `asks_mapping`:
/// `: 6041:00=1591`, `: status 08h pressure control, p 157.5 bar of 315`.
#[inline]
pub(super) fn push_text(pdo: &DecodedPdo, event: &Event, bus: &Bus, asks_mapping: bool, out: &mut Vec<u8>) {
    if let Some(layout) = pdo.layout.as_deref().filter(|_| !pdo.is_request) {
        push_signals(layout, pdo.payload(), out);
    }
    if let Some(users) = bus.node_table().other_users(pdo.cob_id) {
        push_users(pdo, event, users, bus, out);
    }
    if asks_mapping {
        push_missing(pdo, event, device_of(event, bus), out);
    }
}

/// Appends `: p 157.5 bar of 315, angle 49.4 %`.
pub(super) fn push_signals(layout: &PayloadLayout, payload: &[u8], out: &mut Vec<u8>) {
    let mut separator = b": ";
    let has_channels = has_several_channels(layout);
    for signal in layout.decode_signals(payload) {
        out.extend_from_slice(separator);
        if let Some(channel) = channel_of(signal.field).filter(|_| has_channels) {
            out.push(b'c');
            push_decimal(out, u64::from(channel));
            out.push(b' ');
        }
        push_signal(&signal, layout.assumed, out);
        separator = b", ";
    }
    push_absent_signals(layout, payload, out);
}

/// Appends the signals that the payload is too short for.
pub(super) fn push_absent_signals(layout: &PayloadLayout, payload: &[u8], out: &mut Vec<u8>) {
    let needed = usize::from(layout.bits.div_ceil(8));
    if needed > payload.len() {
        push_absent(layout, payload, needed, out);
    }
}

/// Whether the layout contains signals of several channels, which have equal names.
pub(super) fn has_several_channels(layout: &PayloadLayout) -> bool {
    let mut channels = layout.fields.iter().filter_map(channel_of);
    channels.next().is_some_and(|first| channels.any(|other| other != first))
}

fn channel_of(field: &SignalField) -> Option<u8> {
    field.meaning.as_deref()?.channel
}

/// ` (mapping needs 5 bytes: p missing)`.
fn push_absent(layout: &PayloadLayout, payload: &[u8], needed: usize, out: &mut Vec<u8>) {
    // Writing to a vector cannot fail.
    let _ = write!(out, " (mapping needs {}", count_noun(needed, "byte"));
    if layout.missing_fields(payload).next().is_none() {
        // Only bits without an object are missing.
        let _ = write!(out, ": unused bytes");
    }
    let mut separator = ": ";
    for field in layout.missing_fields(payload) {
        let short = field.meaning.as_deref().map(|meaning| meaning.short.as_ref().unwrap_or(&meaning.name));
        let _ = match short {
            Some(name) => write!(out, "{separator}{name}"),
            None => write!(out, "{separator}{}", field.id),
        };
        separator = ", ";
    }
    out.extend_from_slice(b" missing)");
}

/// Appends the configured producer and the consumers of the identifier: ` (from TPDO3 of 2/02)`, ` (1400:01 =
/// 20Ah; no known consumer)`.
#[cold]
pub(super) fn push_users(
    pdo: &DecodedPdo,
    event: &Event,
    users: &[(PdoName, NodeId)],
    bus: &Bus,
    out: &mut Vec<u8>,
) {
    let own = event.node.and_then(|node| bus.node(node)).and_then(|node| node.configured_cob_id(pdo.name));
    let is_user = users.iter().any(|(name, node)| *name == pdo.name && Some(*node) == event.node);
    let mut parts = Vec::new();
    if let Some(cob_id) = own.filter(|_| !is_user) {
        parts.push(format!("{:04X}:01 = {cob_id:X}h", pdo.name.communication_index()));
    }
    let list = |is_sent: bool| {
        let others = users.iter().filter(|(name, node)| {
            name.is_sent() == is_sent && (*name != pdo.name || Some(*node) != event.node)
        });
        others.map(|(name, node)| format!("{name} of {}", node.label())).collect::<Vec<_>>().join(", ")
    };
    let is_sent = pdo.name.is_sent();
    match list(true) {
        producers if !producers.is_empty() => parts.push(format!("from {producers}")),
        _ if is_sent && !is_user => parts.push("no known producer".to_owned()),
        _ => {}
    }
    match list(false) {
        consumers if !consumers.is_empty() => parts.push(format!("to {consumers}")),
        _ if !is_sent && !is_user => parts.push("no known consumer".to_owned()),
        _ => {}
    }
    if !parts.is_empty() {
        // Writing to a vector cannot fail.
        let _ = write!(out, " ({})", parts.join("; "));
    }
}

/// Appends the bus file key to set for a PDO whose mapping is set in the manufacturer's tool.
pub(super) fn push_missing(pdo: &DecodedPdo, event: &Event, device: &DeviceProfile, out: &mut Vec<u8>) {
    let asks = device.pdos.iter().any(|spec| spec.pdo == pdo.name && spec.mapping == MappingSource::BusFile);
    let name = pdo.name.to_string();
    let area = device.areas.iter().find(|area| area.pdos.contains(&name)).filter(|_| asks);
    if let (Some(area), Some(node)) = (area, event.node) {
        // Writing to a vector cannot fail.
        let _ = write!(out, ": mapping unknown; set [node.{node}] {} in the bus file", area.name);
    }
}

fn push_signal(signal: &DecodedSignal<'_>, assumed: bool, out: &mut Vec<u8>) {
    let mut assumed = assumed;
    if let Some(meaning) = signal.field.meaning.as_deref() {
        push_meant(meaning, &signal.value, out);
        assumed |= meaning.assumed;
    } else {
        push_plain(signal, out);
    }
    if assumed {
        out.push(b'?');
    }
}

/// `p 157.5 bar of 315`, `angle 120.0 % (outside)`.
fn push_meant(meaning: &ObjectMeaning, value: &DecodedValue, out: &mut Vec<u8>) {
    let name = meaning.short.as_ref().unwrap_or(&meaning.name);
    out.extend_from_slice(name.as_bytes());
    out.push(b' ');
    out.extend_from_slice(meaning.format_value(value).as_bytes());
    if let Some((_, full)) = meaning.scale.and_then(|scale| scale.full_scale) {
        // Writing to a vector cannot fail.
        let _ = write!(out, " of {full}");
    }
    if meaning.is_outside(value) {
        out.extend_from_slice(b" (outside)");
    }
}

fn push_plain(signal: &DecodedSignal<'_>, out: &mut Vec<u8>) {
    if let Some(object) = signal.field.object() {
        push_object(object, out);
    } else {
        // Writing to a vector cannot fail.
        let _ = write!(out, "{}", signal.field.id);
    }
    out.push(b'=');
    match signal.value {
        DecodedValue::Unsigned(value) => push_decimal(out, value),
        DecodedValue::Integer(value) => push_integer(out, value),
        _ => {
            // Writing to a vector cannot fail.
            let _ = write!(out, "{}", signal.value);
        }
    }
}
