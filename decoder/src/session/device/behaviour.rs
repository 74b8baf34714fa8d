//! What a device does by its manual: the memory behind its states, set points and procedures, and the way
//! of a PDO through them.
//!
//! ```text
//! PDO ─plan─▶ fields that matter ─changed?─▶ control, status, bits, modes ─▶ set points, procedures
//! ```

use std::sync::Arc;

use super::machine::MachineState;
use super::plan::Plan;
use super::procedure::Running;
use super::set_point::SetPointState;
use crate::event::{EventKind, J1939Message, Pdo};
use crate::frame::Frame;
use crate::profile::device::TriggerEvent;
use crate::profile::{Carrier, Device, Field, Layout, Meaning, PdoDirection, Role};
use crate::session::store::{Origin, OriginKind};
use crate::session::{Bus, Observer};
use crate::wire::NodeId;
use crate::wire::canopen::ObjectAddress;
use crate::wire::canopen::nmt::NmtService;

/// Something that happened: what, when, in which frame.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(in crate::session) struct Moment<T> {
    pub(in crate::session) what: T,
    pub(in crate::session) frame: u64,
    /// Monotonic time in nanoseconds.
    pub(in crate::session) time: i64,
}

/// What is remembered of a device's doings.
#[derive(Debug, Clone, Default)]
pub(in crate::session) struct Behaviour {
    /// Last raw value of objects that matter and travel in PDOs.
    words: Vec<(ObjectAddress, u64)>,
    pub(super) machines: Vec<MachineState>,
    pub(super) set_points: Vec<SetPointState>,
    pub(super) running: Vec<Running>,
    /// Modes told last.
    pub(super) modes: Vec<(ObjectAddress, i64)>,
    /// The last commands, latest first.
    pub(super) nmt: [Option<Moment<NmtService>>; 3],
    pub(super) emcy: Option<Moment<u16>>,
    /// The last fault reported by DM1: SPN and FMI.
    pub(super) dtc: Option<Moment<(u32, u8)>>,
    /// Messages that did not come within the time the manual gives.
    pub(in crate::session) overdue: Vec<Arc<str>>,
    pub(super) boot: Option<Moment<()>>,
    pub(super) sync: Option<Moment<()>>,
    /// A deadline of set points that wait for SYNC is queued.
    pub(super) sync_queued: bool,
}

impl Behaviour {
    /// Last raw value of an object in a PDO.
    pub(super) fn word(&self, object: ObjectAddress) -> Option<u64> {
        self.words.iter().find(|(known, _)| *known == object).map(|(_, raw)| *raw)
    }

    /// Notes a raw value; gives the one before.
    fn note(&mut self, object: ObjectAddress, raw: u64) -> Option<u64> {
        if let Some((_, known)) = self.words.iter_mut().find(|(known, _)| *known == object) {
            return Some(std::mem::replace(known, raw));
        }
        self.words.push((object, raw));
        None
    }

    /// All traffic stopped for so long.
    pub(in crate::session) fn postpone(&mut self, delay: i64) {
        for point in &mut self.set_points {
            point.postpone(delay);
        }
    }

    /// Bytes held.
    pub(in crate::session) fn footprint(&self) -> usize {
        self.words.capacity() * size_of::<(ObjectAddress, u64)>()
            + self.machines.capacity() * size_of::<MachineState>()
            + self.set_points.capacity() * size_of::<SetPointState>()
            + self.running.capacity() * size_of::<Running>()
    }
}

/// One field of a PDO that changed.
pub(super) struct Changed<'a> {
    pub(super) id: NodeId,
    pub(super) device: &'a Device,
    pub(super) field: &'a Field,
    pub(super) object: ObjectAddress,
    pub(super) meaning: &'a Arc<Meaning>,
    pub(super) before: Option<u64>,
    pub(super) raw: u64,
}

impl Bus {
    /// A PDO or message came that may tell something of the device.
    #[cold]
    pub(in crate::session) fn device_saw(
        &mut self,
        slot: usize,
        (carrier, direction): (&Carrier, PdoDirection),
        id: NodeId,
        frame: &Frame,
        out: &mut dyn Observer,
    ) {
        let Some(entry) = self.routes.slot(slot) else { return };
        let (Some(event), Some(planned)) = (entry.prepared.as_deref(), &entry.plan) else { return };
        let plan = Arc::clone(&planned.plan);
        let layout = match &event.kind {
            EventKind::Pdo(Pdo { layout: Some(layout), is_request: false, .. })
            | EventKind::J1939Message(J1939Message { layout: Some(layout), .. }) => Arc::clone(layout),
            _ => return,
        };
        let Some(device) = self.node(id).map(|node| Arc::clone(&node.device)) else { return };
        let (mut set_points, mut gates) = (false, false);
        for watched in &plan.fields {
            let Some(field) = layout.fields.get(watched.place) else { continue };
            let (Some(meaning), Some(raw)) = (&field.meaning, field.extract(frame.data())) else { continue };
            if plan.commands {
                self.commanded_by(id, &device, watched.object, slot);
            }
            let Some(node) = self.node_mut(id) else { return };
            let before = node.behaviour.note(watched.object, raw);
            if before == Some(raw) {
                continue;
            }
            let decides = watched.decides && matches!(carrier, Carrier::Message(_));
            let is_set_point = meaning.role == Some(Role::SetPoint) || decides;
            set_points |= is_set_point && direction == PdoDirection::Receive;
            gates |= watched.is_gate;
            let object = watched.object;
            let changed = Changed { id, device: &device, field, object, meaning, before, raw };
            if watched.decides {
                self.sampled(&changed, frame);
            }
            self.field_changed(&changed, frame, out);
        }
        if set_points {
            self.set_points_changed(id, carrier, &layout, &plan, frame, out);
        }
        if gates {
            self.reassess(id, frame, out);
        }
        if plan.triggers {
            self.procedures_saw_carrier(id, carrier, frame, out);
            self.repeated_bits(id, &layout, &plan, frame, out);
        }
    }

    fn field_changed(&mut self, changed: &Changed<'_>, frame: &Frame, out: &mut dyn Observer) {
        let object = changed.object;
        self.control_changed(changed);
        if changed.meaning.role == Some(Role::Mode) {
            self.mode_seen(changed.id, object, frame, out);
        }
        let bits_before = changed.before;
        self.bits_changed(changed, frame, out);
        self.status_changed(changed, frame, out);
        self.bits_trigger(changed.id, object, bits_before, changed.raw, frame, out);
    }

    /// A value in a PDO that decides how others are read enters the object store.
    fn sampled(&mut self, changed: &Changed<'_>, frame: &Frame) {
        let length = usize::from(changed.field.bits.div_ceil(8));
        let bytes = changed.raw.to_le_bytes();
        let Some(node) = self.node_mut(changed.id) else { return };
        let origin = Origin { kind: OriginKind::Pdo, frame: frame.number, time: frame.time };
        let bytes = bytes.get(..length).unwrap_or(&bytes);
        if Arc::make_mut(&mut node.store).set(changed.object, bytes, origin).is_ok() {
            self.routes.refresh_dependents(changed.id, changed.object);
        }
    }

    /// A procedure may begin with a bit that is set again without having been clear: its PDO is sent once
    /// an occasion.
    fn repeated_bits(
        &mut self,
        id: NodeId,
        layout: &Layout,
        plan: &Plan,
        frame: &Frame,
        out: &mut dyn Observer,
    ) {
        if !plan.once_an_occasion {
            return;
        }
        for watched in &plan.fields {
            let Some(field) = layout.fields.get(watched.place) else { continue };
            let Some(raw) = field.extract(frame.data()) else { continue };
            self.bits_trigger(id, watched.object, Some(0), raw, frame, out);
        }
    }

    /// An EMCY came; it may explain a state or change what set points do.
    pub(in crate::session) fn device_saw_emcy(
        &mut self,
        id: NodeId,
        code: u16,
        frame: &Frame,
        out: &mut dyn Observer,
    ) {
        let time = self.clock.now();
        let Some(node) = self.node_mut(id) else { return };
        if code != 0 {
            node.behaviour.emcy = Some(Moment { what: code, frame: frame.number, time });
        }
        self.procedures_saw(id, &TriggerEvent::Emcy(code), frame, out);
        self.reassess(id, frame, out);
    }

    /// A trouble code was raised, or came again.
    pub(in crate::session) fn device_saw_dtc(
        &mut self,
        id: NodeId,
        code: (u32, u8),
        frame: &Frame,
        out: &mut dyn Observer,
    ) {
        let time = self.clock.now();
        let Some(node) = self.node_mut(id) else { return };
        node.behaviour.dtc = Some(Moment { what: code, frame: frame.number, time });
        self.procedures_saw(id, &TriggerEvent::Dtc(code.0, code.1), frame, out);
        self.reassess(id, frame, out);
    }

    /// An NMT command was given.
    pub(in crate::session) fn device_saw_nmt(
        &mut self,
        id: NodeId,
        service: NmtService,
        frame: &Frame,
        out: &mut dyn Observer,
    ) {
        let time = self.clock.now();
        let Some(node) = self.node_mut(id) else { return };
        let [first, second, _] = node.behaviour.nmt;
        node.behaviour.nmt = [Some(Moment { what: service, frame: frame.number, time }), first, second];
        self.procedures_saw(id, &TriggerEvent::Nmt(service.name()), frame, out);
    }

    /// A node started: procedures are over, set points are gone.
    pub(in crate::session) fn device_restarted(&mut self, id: NodeId, frame: &Frame) {
        let time = self.clock.now();
        let Some(node) = self.node_mut(id) else { return };
        node.behaviour.boot = Some(Moment { what: (), frame: frame.number, time });
        node.behaviour.running.clear();
        node.behaviour.set_points.clear();
        node.behaviour.sync_queued = false;
        node.behaviour.words.clear();
        for machine in &mut node.behaviour.machines {
            machine.is_old = true;
        }
    }

    /// A transfer of an object is complete.
    pub(in crate::session) fn device_saw_object(
        &mut self,
        id: NodeId,
        object: ObjectAddress,
        value: &[u8],
        kind: OriginKind,
        frame: &Frame,
        out: &mut dyn Observer,
    ) {
        let Some(node) = self.node(id).filter(|node| node.assigned.is_some()) else { return };
        let is_mode = node.meaning(object).is_some_and(|meaning| meaning.role == Some(Role::Mode));
        if is_mode {
            self.mode_seen(id, object, frame, out);
        }
        self.announced(id, object, value, kind, frame, out);
        self.procedures_saw_object(id, object, value, kind, frame, out);
        let decides = self.node(id).is_some_and(|node| node.device.gates_on(object));
        if decides {
            self.reassess(id, frame, out);
        }
    }
}
