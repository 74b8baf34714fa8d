//! Object values from transfers: in effect, waiting for a restart, stored, or invalidated.

use std::sync::Arc;

use super::conflict::check_device_file;
use super::parameters::apply_object;
use crate::bus_file::encode_number;
use crate::event::{ChangeOrigin, EventKind, EvictedState, ObjectChange};
use crate::frame::Frame;
use crate::profile::device::DeviceProfile;
use crate::profile::object::NumberFormat;
use crate::profile::{DataType, Persistence, ResolvedObject, SubEntry, ValueStorage, WriteEffect};
use crate::session::bus::PendingValue;
use crate::session::bus::{Bus, Node, OriginKind, StoredOrigin};
use crate::session::context::MachineContext;
use crate::wire::NodeId;
use crate::wire::canopen::ObjectAddress;

/// Store parameters and restore default parameters (CiA 301 §7.5.2.13, §7.5.2.14).
const STORE: u16 = 0x1010;
const RESTORE: u16 = 0x1011;

/// Object value confirmed by a transfer.
#[derive(Debug, Clone)]
pub(in crate::session) struct ObjectTransfer {
    pub(in crate::session) node: NodeId,
    pub(in crate::session) object: ObjectAddress,
    pub(in crate::session) value: Vec<u8>,
    /// Download or upload.
    pub(in crate::session) kind: OriginKind,
}

/// Object value from one transfer.
#[derive(Clone, Copy)]
struct LearntValue<'a> {
    object: ObjectAddress,
    value: &'a [u8],
    origin: StoredOrigin,
}

/// Stores and applies the value of a confirmed transfer; removes the padding of an expedited transfer without
/// indicated size.
pub(in crate::session) fn apply_transfer(
    transfer: &mut ObjectTransfer,
    frame: &Frame,
    cx: &mut MachineContext<'_>,
) {
    let (id, object, kind) = (transfer.node, transfer.object, transfer.kind);
    let Some(node) = cx.bus.nodes.node_mut(id) else { return };
    let device = Arc::clone(&node.device);
    let found = device.dictionary.find_object(object);
    let entry = found.and_then(|found| found.entry);
    let origin = StoredOrigin { kind, frame: frame.number, time: frame.time };
    transfer.value.truncate(strip_padding(&transfer.value, entry.and_then(|entry| entry.data_type)).len());
    let learnt = LearntValue { object, value: &transfer.value, origin };
    check_device_file(id, object, learnt.value, kind, frame, cx);
    match kind {
        OriginKind::Download => apply_download(id, learnt, &device, found, frame, cx),
        _ => apply_upload(id, learnt, entry, frame, cx),
    }
}

fn apply_download(
    id: NodeId,
    learnt: LearntValue<'_>,
    device: &DeviceProfile,
    found: Option<ResolvedObject<'_>>,
    frame: &Frame,
    cx: &mut MachineContext<'_>,
) {
    let entry = found.and_then(|found| found.entry);
    let effect = entry.map_or(WriteEffect::Unknown, |entry| entry.effect);
    note_store_command(&mut cx.bus, id, learnt.object, learnt.value, device);
    if effect == WriteEffect::Never {
        return;
    }
    // A signature is a command and cannot wait for a restart.
    let is_command = entry.is_some_and(|entry| entry.format == NumberFormat::Ascii);
    if effect.needs_restart() && !is_command {
        defer_download(id, learnt, entry, frame, cx);
    } else {
        set_value(id, learnt, entry, frame, cx);
    }
    if let Some(found) = found.filter(|_| !effect.needs_restart()) {
        invalidate_dependents(&mut cx.bus, id, found);
    }
}

/// Adds a value that takes effect at a restart.
fn defer_download(
    id: NodeId,
    learnt: LearntValue<'_>,
    entry: Option<&SubEntry>,
    frame: &Frame,
    cx: &mut MachineContext<'_>,
) {
    let Some(node) = cx.bus.nodes.node_mut(id) else { return };
    let effect = entry.map_or(WriteEffect::Unknown, |entry| entry.effect);
    let from = node.store.seen_value(learnt.object).map(|entry| entry.value.clone());
    let waiting = PendingValue { value: learnt.value.to_vec(), effect, origin: learnt.origin };
    Arc::make_mut(&mut node.store).add_waiting(learnt.object, waiting);
    if from.as_deref() != Some(learnt.value) {
        emit_object_change(id, learnt, from, entry, frame, cx);
    }
}

fn apply_upload(
    id: NodeId,
    learnt: LearntValue<'_>,
    entry: Option<&SubEntry>,
    frame: &Frame,
    cx: &mut MachineContext<'_>,
) {
    // A waiting value can be read back before it takes effect.
    let waits = cx.bus.node(id).and_then(|node| node.store.waiting_value(learnt.object));
    if waits.is_some_and(|waiting| waiting.value == learnt.value) {
        return;
    }
    set_value(id, learnt, entry, frame, cx);
}

fn set_value(
    id: NodeId,
    learnt: LearntValue<'_>,
    entry: Option<&SubEntry>,
    frame: &Frame,
    cx: &mut MachineContext<'_>,
) {
    let Some(node) = cx.bus.nodes.node_mut(id) else { return };
    let store = Arc::make_mut(&mut node.store);
    if let Some(was_stale) = store.confirm_value(learnt.object, learnt.value, learnt.origin) {
        if was_stale {
            cx.bus.routes.refresh_dependents(id, learnt.object);
        }
        return apply_object(&mut cx.bus, id, learnt.object);
    }
    let Ok(before) = store.set(learnt.object, learnt.value, learnt.origin) else {
        let kind = EventKind::Evicted { what: EvictedState::Object, count: 1 };
        return cx.emit_event(frame, id, false, kind);
    };
    let was_certain = before.as_ref().is_some_and(|before| !before.stale);
    let from = before.map(|before| before.value);
    let changed = from.as_deref() != Some(learnt.value);
    if changed && learnt.origin.kind == OriginKind::Download {
        emit_object_change(id, learnt, from, entry, frame, cx);
    }
    if changed || !was_certain {
        cx.bus.routes.refresh_dependents(id, learnt.object);
    }
    apply_object(&mut cx.bus, id, learnt.object);
}

fn emit_object_change(
    id: NodeId,
    learnt: LearntValue<'_>,
    from: Option<Vec<u8>>,
    entry: Option<&SubEntry>,
    frame: &Frame,
    cx: &mut MachineContext<'_>,
) {
    let (effect, persists) = entry.map_or((None, None), SubEntry::write_consequence);
    let change = ObjectChange {
        object: learnt.object,
        from,
        to: Some(learnt.value.to_vec()),
        origin: ChangeOrigin::Download,
        effect,
        persists,
    };
    cx.emit_event(frame, id, true, EventKind::ObjectChange(Box::new(change)));
}

/// Applies store and restore: "save" makes values non-volatile, "load" invalidates the stored ones.
fn note_store_command(
    bus: &mut Bus,
    id: NodeId,
    object: ObjectAddress,
    value: &[u8],
    device: &DeviceProfile,
) {
    let Some(node) = bus.nodes.node_mut(id) else { return };
    let is_save = object.index == STORE && value == b"save";
    // Any later write makes the parameters unsaved again.
    node.saved = is_save;
    let covers = |kept: ObjectAddress| covers_object(device, object.sub, kept);
    if is_save {
        Arc::make_mut(&mut node.store).mark_stored(covers);
    } else if object.index == RESTORE && value == b"load" {
        Arc::make_mut(&mut node.store).forget_kept(covers);
    }
}

/// Marks values as doubtful that a write made void.
fn invalidate_dependents(bus: &mut Bus, id: NodeId, found: ResolvedObject<'_>) {
    let Some(entry) = found.entry.filter(|entry| !entry.invalidates.is_empty()) else { return };
    let stride = found.object.repeat.stride;
    let covers = |object: ObjectAddress| {
        object != found.address
            && entry.invalidates.iter().any(|range| range.covers(object, found.nth, stride))
    };
    mark_stale(bus, id, covers);
}

/// Marks values as doubtful and refreshes the PDOs that depend on them.
pub(in crate::session) fn mark_stale(bus: &mut Bus, id: NodeId, covers: impl Fn(ObjectAddress) -> bool) {
    let Some(node) = bus.nodes.node_mut(id) else { return };
    for object in Arc::make_mut(&mut node.store).doubt_all(covers) {
        bus.routes.refresh_dependents(id, object);
    }
}

/// Marks one value as doubtful, except one that the bus file states, and refreshes the PDOs that depend on it.
pub(in crate::session) fn mark_value_stale(bus: &mut Bus, id: NodeId, object: ObjectAddress) {
    let Some(node) = bus.nodes.node_mut(id) else { return };
    let known = node.store().seen_value(object);
    if known.is_some_and(|entry| entry.origin.kind != OriginKind::BusFile && !entry.stale) {
        Arc::make_mut(&mut node.store).mark_doubtful(object);
        bus.routes.refresh_dependents(id, object);
    }
}

/// Sets a value that the device sets by itself, as its manual states; the value is assumed.
pub(in crate::session) fn set_fallback(
    bus: &mut Bus,
    id: NodeId,
    object: ObjectAddress,
    value: i64,
    frame: &Frame,
) {
    let Some(node) = bus.nodes.node_mut(id) else { return };
    let data_type = node.device.dictionary.data_type(object);
    let Ok(bytes) = encode_number(value, data_type) else { return };
    let origin = StoredOrigin { kind: OriginKind::Upload, frame: frame.number, time: frame.time };
    let store = Arc::make_mut(&mut node.store);
    if store.set(object, &bytes, origin).is_ok() {
        store.mark_doubtful(object);
        bus.routes.refresh_dependents(id, object);
    }
}

/// Marks unsaved values as doubtful after a boot, if the profile does not define their storage.
pub(in crate::session) fn mark_unsaved_stale(bus: &mut Bus, id: NodeId) {
    let Some(node) = bus.nodes.node_mut(id) else { return };
    if node.saved || node.store().is_empty() {
        return;
    }
    let device = Arc::clone(&node.device);
    let untold = |object: ObjectAddress| {
        let entry = device.dictionary.find_object(object).and_then(|found| found.entry);
        entry.is_none_or(|entry| entry.storage == ValueStorage::Unknown)
    };
    Arc::make_mut(&mut node.store).doubt_all(untold);
    bus.routes.refresh_pdos_of(id);
}

/// Removes the padding of an expedited transfer without indicated size.
fn strip_padding(value: &[u8], data_type: Option<DataType>) -> &[u8] {
    let length = data_type.and_then(DataType::bits).map(|bits| usize::from(bits.div_ceil(8)));
    match length.and_then(|length| value.split_at_checked(length)) {
        Some((value, padding)) if padding.iter().all(|byte| *byte == 0) => value,
        _ => value,
    }
}

impl Node {
    /// Whether the value of an object survives a restart, from the profile; `None` if unknown.
    pub fn persistence_text(&self, object: ObjectAddress) -> Option<Persistence> {
        let entry = self
            .device
            .dictionary
            .find_object(object)?
            .entry
            .filter(|it| it.format != NumberFormat::Ascii)?;
        let value = self.store.get(object)?;
        match entry.storage {
            ValueStorage::EachWrite | ValueStorage::Fixed => Some(Persistence::Yes),
            ValueStorage::Volatile => Some(Persistence::No),
            ValueStorage::Save if self.store.stored_value(object) == Some(value.value.as_slice()) => {
                Some(Persistence::Yes)
            }
            // A value that was read and never written is the stored one.
            ValueStorage::Save if value.origin.kind == OriginKind::Upload => Some(Persistence::Yes),
            ValueStorage::Save => Some(Persistence::NotStored),
            ValueStorage::Unknown => None,
        }
    }
}

/// Whether a sub-index of store or restore covers an object, from the profile or else CiA 301 (1: all,
/// 2: communication, 3: application).
fn covers_object(device: &DeviceProfile, sub: u8, object: ObjectAddress) -> bool {
    let found = device.dictionary.find_object(object);
    let entry = found.and_then(|found| found.entry);
    if entry.is_some_and(|entry| !matches!(entry.storage, ValueStorage::Save | ValueStorage::Unknown)) {
        return false;
    }
    match (sub, entry.and_then(|entry| entry.save)) {
        (1, _) => true,
        (sub, Some(save)) => save.object.sub == sub,
        (2, None) => (0x1000..=0x1FFF).contains(&object.index),
        (3, None) => (0x6000..=0x9FFF).contains(&object.index),
        _ => false,
    }
}
