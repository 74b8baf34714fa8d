//! Fields of a PDO that concern the device's state. The plan is made once per layout, so that most PDOs need
//! no further work.

use std::sync::Arc;

use crate::profile::device::{DeviceCondition, DeviceProcedure, PdoSpec, PdoTrigger, ProfileTrigger};
use crate::profile::{DeviceProfile, ObjectRole, PayloadLayout, PdoDirection, SignalField, ValueCarrier};
use crate::wire::canopen::ObjectAddress;

/// One watched field.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(in crate::session) struct WatchedField {
    /// Index in the layout.
    pub(in crate::session) place: usize,
    /// Object in the field.
    pub(in crate::session) object: ObjectAddress,
    /// A gate depends on the object.
    pub(in crate::session) is_gate: bool,
    /// Other objects are decoded by this value.
    pub(in crate::session) decides: bool,
}

/// Watched fields in the PDOs of one layout.
#[derive(Debug, Clone, Default, PartialEq, Eq)]
pub(in crate::session) struct WatchPlan {
    /// Watched fields in the order of the layout.
    pub(in crate::session) fields: Vec<WatchedField>,
    /// Bits of these fields in the first eight bytes.
    pub(in crate::session) mask: u64,
    /// Bits of the fields that decide how others are decoded.
    pub(in crate::session) deciding: u64,
    /// Evaluated even without a change: a procedure waits for this PDO.
    pub(in crate::session) triggers: bool,
    /// Sent once per occurrence: equal bits mean that it occurred again.
    pub(in crate::session) once_an_occasion: bool,
    /// Contains a control word: its frames are stored.
    pub(in crate::session) commands: bool,
}

/// Plan of an identifier, and its last frames.
#[derive(Debug, Clone)]
pub(in crate::session) struct IdentifierPlan {
    pub(in crate::session) plan: Arc<WatchPlan>,
    /// Last frames, if they contain a control word.
    pub(in crate::session) recent: RecentFrames,
}

/// Last frames with a control word, latest first.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq)]
pub(in crate::session) struct RecentFrames {
    frames: [(u64, i64); 4],
}

impl RecentFrames {
    /// Adds a frame.
    #[inline]
    pub(in crate::session) fn push(&mut self, frame: u64, time: i64) {
        let [first, second, third, _] = self.frames;
        self.frames = [(frame, time), first, second, third];
    }

    /// Frame and monotonic time of the latest PDO.
    pub(in crate::session) fn latest_pdo(&self) -> Option<(u64, i64)> {
        let [latest, ..] = self.frames;
        (latest.0 != 0).then_some(latest)
    }
}

impl WatchPlan {
    /// Plan for a layout; `None` if it has no watched field and no procedure waits for the PDO.
    pub(in crate::session) fn plan_for(
        device: &DeviceProfile,
        carrier: &ValueCarrier,
        direction: PdoDirection,
        layout: &PayloadLayout,
    ) -> Option<Self> {
        let mut plan = Self::default();
        for (place, field) in layout.fields.iter().enumerate() {
            let Some(object) = field.object() else { continue };
            let role = field.meaning.as_deref().and_then(|meaning| meaning.role);
            let has_bits = field.meaning.as_deref().is_some_and(|meaning| meaning.bits.is_some());
            let matters = matches!(
                role,
                Some(ObjectRole::Control | ObjectRole::Status | ObjectRole::SetPoint | ObjectRole::Mode)
            );
            if matters || has_bits || device.decides_meaning(object) || device.watches_object(object) {
                let (is_gate, decides) = (device.gates_on(object), device.decides_meaning(object));
                plan.fields.push(WatchedField { place, object, is_gate, decides });
                plan.mask |= field.payload_bits();
                if decides {
                    plan.deciding |= field.payload_bits();
                }
            }
            plan.commands |= device.machines.iter().any(|it| it.control.object.object == object);
        }
        let waits = |trigger: &ProfileTrigger| trigger.is_met_by(&carrier.into());
        plan.triggers = device.procedures.iter().flat_map(DeviceProcedure::all_triggers).any(waits);
        let spec = device.pdos.iter().find(|spec| ValueCarrier::Pdo(spec.pdo) == *carrier);
        let trigger = spec.and_then(PdoSpec::trigger);
        let is_event = matches!(trigger, Some(PdoTrigger::Event | PdoTrigger::Rpdo));
        let starts = |object: ObjectAddress| {
            device
                .procedures
                .iter()
                .any(|it| matches!(&it.start, ProfileTrigger::Bit(bit, _) if bit.object.object == object))
        };
        plan.once_an_occasion = is_event
            && direction == PdoDirection::Transmit
            && layout.fields.iter().filter_map(SignalField::object).any(starts);
        plan.triggers |= plan.once_an_occasion;
        plan.commands &= direction == PdoDirection::Receive;
        (!plan.fields.is_empty() || plan.triggers).then_some(plan)
    }

    /// Plan of a message in which these bits decide how the rest is decoded; `None` without such bits.
    pub(in crate::session) fn plan_deciding(deciding: u64) -> Option<Self> {
        (deciding != 0).then(|| Self { deciding, ..Self::default() })
    }

    /// Payload bits that the session needs; `None` if it needs each frame.
    pub(in crate::session) fn needed_bits(&self) -> Option<u64> {
        (!self.triggers).then_some(self.mask | self.deciding)
    }
}

impl DeviceProfile {
    /// Whether other objects are decoded by the value of this one.
    pub(in crate::session) fn decides_meaning(&self, object: ObjectAddress) -> bool {
        self.deciding.contains(&object)
    }

    /// Whether a machine, a procedure or a gate depends on an object.
    pub(in crate::session) fn watches_object(&self, object: ObjectAddress) -> bool {
        let machine = self
            .machines
            .iter()
            .any(|machine| machine.status.object.object == object || machine.control.object.object == object);
        let bit = |trigger: &ProfileTrigger| matches!(trigger, ProfileTrigger::Bit(bit, _) if bit.object.object == object);
        let on = |open: &DeviceCondition| open.object() == Some(object);
        let when = |trigger: &ProfileTrigger| bit(trigger) || trigger.trigger_conditions().iter().any(on);
        machine
            || self.gates_on(object)
            || self.procedures.iter().flat_map(DeviceProcedure::all_triggers).any(when)
    }

    /// Whether a gate depends on an object.
    pub(in crate::session) fn gates_on(&self, object: ObjectAddress) -> bool {
        let on = |open: &DeviceCondition| open.object() == Some(object);
        self.gates.iter().any(|gate| gate.open.0.iter().any(on))
    }
}
