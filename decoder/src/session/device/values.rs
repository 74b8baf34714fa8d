//! Values of objects as transfers confirm them: what acts now, what waits, what is kept, what is void.

use std::sync::Arc;

use crate::bus_file::encode;
use crate::event::{EventKind, ObjectChange};
use crate::frame::Frame;
use crate::profile::device::Device;
use crate::profile::object::Format;
use crate::profile::{DataType, Effect, Entry, Found, Storage};
use crate::session::node::Node;
use crate::session::store::{Origin, OriginKind, Waiting};
use crate::session::{Bus, Observer};
use crate::wire::NodeId;
use crate::wire::canopen::ObjectAddress;

/// Store parameters and restore default parameters (CiA 301 §7.5.2.13, §7.5.2.14).
const STORE: u16 = 0x1010;
const RESTORE: u16 = 0x1011;

/// Serial number (CiA 301 §7.5.2.19).
const SERIAL_NUMBER: ObjectAddress = ObjectAddress::new(0x1018, 4);

/// One value of one object in one transfer.
#[derive(Clone, Copy)]
struct Learnt<'a> {
    object: ObjectAddress,
    value: &'a [u8],
    origin: Origin,
}

impl Bus {
    /// Puts a value seen in a confirmed transfer into the store and lets it take effect.
    pub(in crate::session) fn learn_object(
        &mut self,
        id: NodeId,
        object: ObjectAddress,
        value: &[u8],
        kind: OriginKind,
        frame: &Frame,
        out: &mut dyn Observer,
    ) {
        let Some(node) = self.node_mut(id) else { return };
        let device = Arc::clone(&node.device);
        let found = device.dictionary.find(object);
        let entry = found.and_then(|found| found.entry);
        let value = unpadded(value, entry.and_then(|entry| entry.data_type));
        let learnt = Learnt { object, value, origin: Origin { kind, frame: frame.number, time: frame.time } };
        self.contradict(id, object, value, kind, frame, out);
        match kind {
            OriginKind::Download => self.written(id, learnt, &device, found, frame, out),
            _ => self.read(id, learnt, entry, frame, out),
        }
        self.introduce(id, object, frame, out);
        if object == SERIAL_NUMBER {
            self.join_by_serial(id, frame, out);
        }
        self.device_saw_object(id, object, value, kind, frame, out);
        self.say_refused(frame, out);
    }

    fn written(
        &mut self,
        id: NodeId,
        learnt: Learnt<'_>,
        device: &Device,
        found: Option<Found<'_>>,
        frame: &Frame,
        out: &mut dyn Observer,
    ) {
        let entry = found.and_then(|found| found.entry);
        let effect = entry.map_or(Effect::Unknown, |entry| entry.effect);
        self.stored(id, learnt.object, learnt.value, device);
        if effect == Effect::Never {
            return;
        }
        // A signature is a command: it is no value that could wait.
        let is_command = entry.is_some_and(|entry| entry.format == Format::Ascii);
        if effect.waits() && !is_command {
            self.waits(id, learnt, entry, frame, out);
        } else {
            self.set(id, learnt, entry, frame, out);
        }
        if let Some(found) = found.filter(|_| !effect.waits()) {
            self.void(id, found);
        }
    }

    /// A value that acts from a restart on.
    fn waits(
        &mut self,
        id: NodeId,
        learnt: Learnt<'_>,
        entry: Option<&Entry>,
        frame: &Frame,
        out: &mut dyn Observer,
    ) {
        let Some(node) = self.node_mut(id) else { return };
        let effect = entry.map_or(Effect::Unknown, |entry| entry.effect);
        let from = node.store.seen(learnt.object).map(|entry| entry.value.clone());
        let waiting = Waiting { value: learnt.value.to_vec(), effect, origin: learnt.origin };
        Arc::make_mut(&mut node.store).wait(learnt.object, waiting);
        if from.as_deref() != Some(learnt.value) {
            self.tell_change(id, learnt, from, entry, frame, out);
        }
    }

    fn read(
        &mut self,
        id: NodeId,
        learnt: Learnt<'_>,
        entry: Option<&Entry>,
        frame: &Frame,
        out: &mut dyn Observer,
    ) {
        // What waits for a restart may be read back before it acts.
        let waits = self.node(id).and_then(|node| node.store.waiting(learnt.object));
        if waits.is_some_and(|waiting| waiting.value == learnt.value) {
            return;
        }
        self.set(id, learnt, entry, frame, out);
    }

    fn set(
        &mut self,
        id: NodeId,
        learnt: Learnt<'_>,
        entry: Option<&Entry>,
        frame: &Frame,
        out: &mut dyn Observer,
    ) {
        let Some(node) = self.node_mut(id) else { return };
        let Ok(before) = Arc::make_mut(&mut node.store).set(learnt.object, learnt.value, learnt.origin)
        else {
            let kind = EventKind::Evicted { what: "object", count: 1 };
            return self.emit(frame, id, false, kind, out);
        };
        let was_sure = before.as_ref().is_some_and(|before| !before.stale);
        let from = before.map(|before| before.value);
        let changed = from.as_deref() != Some(learnt.value);
        if changed && learnt.origin.kind == OriginKind::Download {
            self.tell_change(id, learnt, from, entry, frame, out);
        }
        if changed || !was_sure {
            self.routes.refresh_dependents(id, learnt.object);
        }
        self.take_effect(id, learnt.object);
    }

    fn tell_change(
        &mut self,
        id: NodeId,
        learnt: Learnt<'_>,
        from: Option<Vec<u8>>,
        entry: Option<&Entry>,
        frame: &Frame,
        out: &mut dyn Observer,
    ) {
        let (effect, persists) = entry.map_or((None, None), Entry::consequence);
        let change = ObjectChange {
            object: learnt.object,
            from,
            to: Some(learnt.value.to_vec()),
            origin: learnt.origin.kind.name(),
            effect,
            persists,
        };
        self.emit(frame, id, true, EventKind::ObjectChange(Box::new(change)), out);
    }

    /// "save" keeps values over a restart, "load" voids what is kept.
    fn stored(&mut self, id: NodeId, object: ObjectAddress, value: &[u8], device: &Device) {
        let Some(node) = self.node_mut(id) else { return };
        let is_save = object.index == STORE && value == b"save";
        // Without a word of the device: any later write is unsaved again.
        node.saved = is_save;
        let covers = |kept: ObjectAddress| covers(device, object.sub, kept);
        if is_save {
            Arc::make_mut(&mut node.store).keep(covers);
        } else if object.index == RESTORE && value == b"load" {
            Arc::make_mut(&mut node.store).forget_kept(covers);
        }
    }

    /// Objects whose known value is void after a write.
    fn void(&mut self, id: NodeId, found: Found<'_>) {
        let Some(entry) = found.entry.filter(|entry| !entry.invalidates.is_empty()) else { return };
        let stride = found.object.repeat.stride;
        let covers = |object: ObjectAddress| {
            object != found.address
                && entry.invalidates.iter().any(|range| range.covers(object, found.nth, stride))
        };
        self.doubt_values(id, covers);
    }

    /// Values of these objects may be others now.
    pub(in crate::session) fn doubt_values(&mut self, id: NodeId, covers: impl Fn(ObjectAddress) -> bool) {
        let Some(node) = self.node_mut(id) else { return };
        for object in Arc::make_mut(&mut node.store).doubt_all(covers) {
            self.routes.refresh_dependents(id, object);
        }
    }

    /// A device put a value of its own: as its manual says, so it is assumed.
    pub(in crate::session) fn fell_back_to(
        &mut self,
        id: NodeId,
        object: ObjectAddress,
        value: i64,
        frame: &Frame,
    ) {
        let Some(node) = self.node_mut(id) else { return };
        let data_type = node.device.dictionary.data_type(object);
        let Ok(bytes) = encode(value, data_type) else { return };
        let origin = Origin { kind: OriginKind::Upload, frame: frame.number, time: frame.time };
        let store = Arc::make_mut(&mut node.store);
        if store.set(object, &bytes, origin).is_ok() {
            store.doubt(object);
            self.routes.refresh_dependents(id, object);
        }
    }

    /// A node booted: what it was told and did not save may be gone, where the device does not tell.
    pub(in crate::session) fn forget_unsaved(&mut self, id: NodeId) {
        let Some(node) = self.node_mut(id) else { return };
        if node.saved || node.store().is_empty() {
            return;
        }
        let device = Arc::clone(&node.device);
        let untold = |object: ObjectAddress| {
            let entry = device.dictionary.find(object).and_then(|found| found.entry);
            entry.is_none_or(|entry| entry.storage == Storage::Unknown)
        };
        Arc::make_mut(&mut node.store).doubt_all(untold);
        self.routes.refresh_pdos_of(id);
    }
}

/// A value without the padding of an expedited transfer that does not tell its size.
fn unpadded(value: &[u8], data_type: Option<DataType>) -> &[u8] {
    let length = data_type.and_then(DataType::bits).map(|bits| usize::from(bits.div_ceil(8)));
    match length.and_then(|length| value.split_at_checked(length)) {
        Some((value, padding)) if padding.iter().all(|byte| *byte == 0) => value,
        _ => value,
    }
}

impl Node {
    /// Whether the present value of an object outlives a restart, as far as the device's profile tells:
    /// `yes`, `no`, `not-stored` (its store object was not written since).
    pub fn persists(&self, object: ObjectAddress) -> Option<&'static str> {
        let entry = self.device.dictionary.find(object)?.entry.filter(|it| it.format != Format::Ascii)?;
        let value = self.store.get(object)?;
        match entry.storage {
            Storage::EachWrite | Storage::Fixed => Some("yes"),
            Storage::Volatile => Some("no"),
            Storage::Save if self.store.kept(object) == Some(value.value.as_slice()) => Some("yes"),
            // What was read and never written is what the device had stored.
            Storage::Save if value.origin.kind == OriginKind::Upload => Some("yes"),
            Storage::Save => Some("not-stored"),
            Storage::Unknown => None,
        }
    }
}

/// Whether a store or restore object concerns an object: as the device says, else by CiA 301 (1: all,
/// 2: communication, 3: application).
fn covers(device: &Device, sub: u8, object: ObjectAddress) -> bool {
    let found = device.dictionary.find(object);
    let entry = found.and_then(|found| found.entry);
    if entry.is_some_and(|entry| !matches!(entry.storage, Storage::Save | Storage::Unknown)) {
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
