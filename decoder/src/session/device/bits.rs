//! Named bits and modes of operation.

use super::changed::FieldChange;
use crate::event::{BitsChanged, EventKind, ModeChange};
use crate::frame::Frame;
use crate::profile::BitName;
use crate::profile::device::StateMachine;
use crate::profile::{DeviceProfile, ObjectRole, PdoDirection, PdoName};
use crate::session::bus::Bus;
use crate::session::bus::pdo_layout;
use crate::session::context::MachineContext;
use crate::wire::NodeId;
use crate::wire::canopen::ObjectAddress;

/// Emits changed bits of a word, except those of a state machine.
pub(in crate::session) fn bits_changed(
    changed: &FieldChange<'_>,
    frame: &Frame,
    cx: &mut MachineContext<'_>,
) {
    let Some(bits) = changed.meaning.bits.as_deref() else { return };
    let own = machine_bits(changed.device, changed.object);
    let mut event = BitsChanged {
        object: changed.object,
        name: changed.meaning.short.clone().unwrap_or_else(|| changed.meaning.name.clone()),
        channel: changed.meaning.channel,
        set: Vec::new(),
        cleared: Vec::new(),
        words: Vec::new(),
    };
    for bit in bits.list.iter().filter(|bit| !bit.reserved && own >> bit.bit & 1 == 0) {
        let now = bit.bits_of(changed.raw);
        // Before its first value, a bit is treated as clear.
        if now != changed.before.map_or(0, |before| bit.bits_of(before)) {
            add_bit(bit, now, &mut event);
        }
    }
    if !event.set.is_empty() || !event.cleared.is_empty() {
        cx.emit_event(frame, changed.id, false, EventKind::BitsChanged(Box::new(event)));
    }
}

/// Emits a changed mode of operation.
pub(in crate::session) fn update_mode(
    id: NodeId,
    object: ObjectAddress,
    frame: &Frame,
    cx: &mut MachineContext<'_>,
) {
    let Some(node) = cx.bus.node(id) else { return };
    let Some(meaning) = node.meaning(object) else { return };
    let Some(entry) = node.store.get(object) else { return };
    let value = meaning.decode(&entry.value);
    let Some(number) = crate::profile::as_integer(&value) else { return };
    let known = node.behaviour.modes.iter().find(|(known, _)| *known == object).map(|(_, mode)| *mode);
    if known == Some(number) {
        return;
    }
    let title = |number: i64| {
        let name = meaning.values.as_deref().and_then(|values| values.get(number));
        name.map_or_else(|| number.to_string(), |name| format!("{number} {name}"))
    };
    let event = ModeChange {
        object,
        name: meaning.name.clone(),
        channel: meaning.channel,
        from: known.map(title),
        to: title(number),
        consequence: set_points_under_mode(&cx.bus, id, object),
    };
    if let Some(node) = cx.bus.nodes.node_mut(id) {
        node.behaviour.modes.retain(|(known, _)| *known != object);
        node.behaviour.modes.push((object, number));
    }
    cx.emit_event(frame, id, false, EventKind::Mode(Box::new(event)));
}

/// Set points of the first RPDO in the present mode: `word 2 Q in l/min, word 3 p in bar`.
fn set_points_under_mode(bus: &Bus, id: NodeId, mode: ObjectAddress) -> String {
    const FIRST: PdoName = PdoName { direction: PdoDirection::Receive, number: 1 };
    let Some(node) = bus.node(id) else { return String::new() };
    let Some(layout) = pdo_layout(node, FIRST) else { return String::new() };
    if !layout.depends.contains(&mode) {
        return String::new();
    }
    let mut resolver = node.resolver();
    let words = layout.fields.iter().filter_map(|field| {
        let meaning =
            resolver.resolve_meaning(field.object()?).filter(|it| it.role == Some(ObjectRole::SetPoint))?;
        let unit = if meaning.unit.is_empty() { "raw" } else { &meaning.unit };
        let name = meaning.short.as_ref().unwrap_or(&meaning.name);
        Some(format!("word {} {name} in {unit}", field.bit / 16 + 1))
    });
    words.collect::<Vec<_>>().join(", ")
}

/// Bits of an object that belong to a state machine.
fn machine_bits(device: &DeviceProfile, object: ObjectAddress) -> u64 {
    let of = |machine: &StateMachine| {
        let status = Some(machine.status).filter(|it| it.object.object == object);
        let control = Some(machine.control).filter(|it| it.object.object == object);
        status.map_or(0, |it| it.mask) | control.map_or(0, |it| it.mask)
    };
    device.machines.iter().fold(0, |bits, machine| bits | of(machine))
}

fn add_bit(bit: &BitName, now: u64, event: &mut BitsChanged) {
    let title = bit.text.as_ref().unwrap_or(&bit.name);
    if bit.width > 1 {
        let words = bit.bit_word(now).unwrap_or_else(|| format!("{title} 0"));
        event.set.push(format!("{} {now}", bit.name));
        event.words.push(words);
    } else if now == 1 {
        event.set.push(bit.name.clone());
        event.words.push(title.clone());
    } else {
        event.cleared.push(bit.name.clone());
        event.words.push(bit.off.clone().unwrap_or_else(|| format!("no longer {title}")));
    }
}
