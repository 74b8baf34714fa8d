//! The words of a PDO: most lines are one, so they are written without the formatting machinery where
//! nothing but numbers is known.

use std::io::Write as _;

use super::parts::push_bytes;
use crate::ascii::{push_code, push_decimal, push_integer};
use crate::event::{Event, Pdo};
use crate::profile::device::Mapping;
use crate::profile::{Device, Field, Layout, Meaning, PdoDirection, Signal, Value};
use crate::words::plural;

/// Appends `TPDO1 37 06: 6041:00=1591`, `TPDO1 08 A0 1F 00 20: status 08h pressure control, p 157.5 bar of 315`.
pub(super) fn push_words(pdo: &Pdo, out: &mut Vec<u8>) {
    out.extend_from_slice(match pdo.name.direction {
        PdoDirection::Transmit => b"TPDO",
        PdoDirection::Receive => b"RPDO",
    });
    push_decimal(out, u64::from(pdo.name.number));
    if pdo.is_request {
        return out.extend_from_slice(b" requested by remote frame");
    }
    out.push(b' ');
    let payload = pdo.payload();
    push_bytes(out, payload);
    if let Some(layout) = &pdo.layout {
        push_signals(layout, payload, out);
    }
}

/// Appends `: p 157.5 bar of 315, angle 49.4 %`.
pub(super) fn push_signals(layout: &Layout, payload: &[u8], out: &mut Vec<u8>) {
    let mut separator = b": ";
    let has_channels = has_several_channels(layout);
    for signal in layout.signals(payload) {
        out.extend_from_slice(separator);
        if let Some(channel) = channel_of(signal.field).filter(|_| has_channels) {
            out.push(b'c');
            push_decimal(out, u64::from(channel));
            out.push(b' ');
        }
        push_signal(&signal, layout.assumed, out);
        separator = b", ";
    }
    let needed = usize::from(layout.bits.div_ceil(8));
    if needed > payload.len() {
        push_absent(layout, payload, needed, out);
    }
}

/// Whether signals of several outputs or axes stand side by side, which are named alike.
fn has_several_channels(layout: &Layout) -> bool {
    let mut channels = layout.fields.iter().filter_map(channel_of);
    channels.next().is_some_and(|first| channels.any(|other| other != first))
}

fn channel_of(field: &Field) -> Option<u8> {
    field.meaning.as_deref()?.channel
}

/// ` (mapping needs 5 bytes: p missing)`.
fn push_absent(layout: &Layout, payload: &[u8], needed: usize, out: &mut Vec<u8>) {
    // Writing to a vector cannot fail.
    let _ = write!(out, " (mapping needs {}", plural(needed, "byte"));
    let mut separator = ": ";
    for field in layout.missing(payload) {
        let short = field.meaning.as_deref().map(|meaning| meaning.short.as_ref().unwrap_or(&meaning.name));
        let _ = match short {
            Some(name) => write!(out, "{separator}{name}"),
            None => write!(out, "{separator}{}", field.id),
        };
        separator = ", ";
    }
    out.extend_from_slice(b" missing)");
}

/// Appends what would tell the contents of a PDO that the maker's tool decides.
pub(super) fn push_missing(pdo: &Pdo, event: &Event, device: &Device, out: &mut Vec<u8>) {
    let asks = device.pdos.iter().any(|spec| spec.pdo == pdo.name && spec.mapping == Mapping::BusFile);
    let name = pdo.name.to_string();
    let area = device.areas.iter().find(|area| area.pdos.contains(&name)).filter(|_| asks);
    if let (Some(area), Some(node)) = (area, event.node) {
        // Writing to a vector cannot fail.
        let _ = write!(out, ": mapping unknown; give [node.{node}] {} in the bus file", area.name);
    }
}

fn push_signal(signal: &Signal<'_>, assumed: bool, out: &mut Vec<u8>) {
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
fn push_meant(meaning: &Meaning, value: &Value, out: &mut Vec<u8>) {
    let name = meaning.short.as_ref().unwrap_or(&meaning.name);
    out.extend_from_slice(name.as_bytes());
    out.push(b' ');
    out.extend_from_slice(meaning.show(value).as_bytes());
    if let Some((_, full)) = meaning.scale.and_then(|scale| scale.full_scale) {
        // Writing to a vector cannot fail.
        let _ = write!(out, " of {full}");
    }
    if meaning.is_outside(value) {
        out.extend_from_slice(b" (outside)");
    }
}

fn push_plain(signal: &Signal<'_>, out: &mut Vec<u8>) {
    if let Some(object) = signal.field.object() {
        push_code(out, u32::from(object.index), 4);
        out.push(b':');
        push_code(out, u32::from(object.sub), 2);
    } else {
        // Writing to a vector cannot fail.
        let _ = write!(out, "{}", signal.field.id);
    }
    out.push(b'=');
    match signal.value {
        Value::Unsigned(value) => push_decimal(out, value),
        Value::Integer(value) => push_integer(out, value),
        _ => {
            // Writing to a vector cannot fail.
            let _ = write!(out, "{}", signal.value);
        }
    }
}
