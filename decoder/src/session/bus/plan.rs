//! What of a PDO matters to the device's doings: worked out once a layout, so that most PDOs cost nothing.

use std::sync::Arc;

use crate::profile::device::{Condition, Procedure, Trigger};
use crate::profile::{Carrier, Device, Field, Layout, PdoDirection, Role};
use crate::wire::canopen::ObjectAddress;

/// One field that is looked at.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(in crate::session) struct Watched {
    /// Place in the layout.
    pub(in crate::session) place: usize,
    /// Its object.
    pub(in crate::session) object: ObjectAddress,
    /// A gate looks at its object.
    pub(in crate::session) is_gate: bool,
    /// Its value decides how others are read.
    pub(in crate::session) decides: bool,
}

/// What is looked at in the PDOs of one layout.
#[derive(Debug, Clone, Default, PartialEq, Eq)]
pub(in crate::session) struct Plan {
    /// The fields.
    pub(in crate::session) fields: Vec<Watched>,
    /// Bits of these fields in the first eight bytes.
    pub(in crate::session) mask: u64,
    /// Those of fields whose value decides how others are read.
    pub(in crate::session) deciding: u64,
    /// Looked at even if nothing changed: a procedure waits for this PDO.
    pub(in crate::session) triggers: bool,
    /// Sent once an occasion, so the same bits mean that it happened again.
    pub(in crate::session) once_an_occasion: bool,
    /// Commands a state machine: its frames are remembered.
    pub(in crate::session) commands: bool,
}

/// The plan of an identifier, and what came by it.
#[derive(Debug, Clone)]
pub(in crate::session) struct Planned {
    pub(in crate::session) plan: Arc<Plan>,
    /// Frames of the last ones, where they command a state machine.
    pub(in crate::session) recent: Recent,
}

/// Frames of the last PDOs that command a state machine, latest first.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq)]
pub(in crate::session) struct Recent {
    frames: [(u64, i64); 4],
}

impl Recent {
    /// Another one came.
    #[inline]
    pub(in crate::session) fn push(&mut self, frame: u64, time: i64) {
        let [first, second, third, _] = self.frames;
        self.frames = [(frame, time), first, second, third];
    }

    /// The latest: frame and monotonic time.
    pub(in crate::session) fn latest(&self) -> Option<(u64, i64)> {
        let [latest, ..] = self.frames;
        (latest.0 != 0).then_some(latest)
    }
}

impl Plan {
    /// The plan of a layout; `None` where nothing in it matters.
    pub(in crate::session) fn of(
        device: &Device,
        carrier: &Carrier,
        direction: PdoDirection,
        layout: &Layout,
    ) -> Option<Self> {
        let mut plan = Self::default();
        for (place, field) in layout.fields.iter().enumerate() {
            let Some(object) = field.object() else { continue };
            let role = field.meaning.as_deref().and_then(|meaning| meaning.role);
            let has_bits = field.meaning.as_deref().is_some_and(|meaning| meaning.bits.is_some());
            let matters = matches!(role, Some(Role::Control | Role::Status | Role::SetPoint | Role::Mode));
            if matters || has_bits || device.decides(object) || device.watches(object) {
                let (is_gate, decides) = (device.gates_on(object), device.decides(object));
                plan.fields.push(Watched { place, object, is_gate, decides });
                plan.mask |= bits(field.bit, field.bits);
                if decides {
                    plan.deciding |= bits(field.bit, field.bits);
                }
            }
            plan.commands |= device.machines.iter().any(|it| it.control.object.object == object);
        }
        let waits = |trigger: &Trigger| trigger.is_met_by(&carrier.into());
        plan.triggers = device.procedures.iter().flat_map(Procedure::triggers).any(waits);
        let spec = device.pdos.iter().find(|spec| Carrier::Pdo(spec.pdo) == *carrier);
        let is_event =
            spec.and_then(|spec| spec.trigger.as_deref()).is_some_and(|by| by == "event" || by == "rpdo");
        let starts = |object: ObjectAddress| {
            device
                .procedures
                .iter()
                .any(|it| matches!(&it.start, Trigger::Bit(bit, _) if bit.object.object == object))
        };
        plan.once_an_occasion = is_event
            && direction == PdoDirection::Transmit
            && layout.fields.iter().filter_map(Field::object).any(starts);
        plan.triggers |= plan.once_an_occasion;
        plan.commands &= direction == PdoDirection::Receive;
        (!plan.fields.is_empty() || plan.triggers).then_some(plan)
    }
}

/// The bits of a field as a mask over eight bytes.
fn bits(first: u16, width: u16) -> u64 {
    let field = if width >= 64 { u64::MAX } else { (1 << width) - 1 };
    field.checked_shl(u32::from(first)).unwrap_or(0)
}

impl Device {
    /// Whether an object's value decides how others are read.
    pub(in crate::session) fn decides(&self, object: ObjectAddress) -> bool {
        self.deciding.contains(&object)
    }

    /// Whether a machine, a procedure or a gate looks at an object.
    pub(in crate::session) fn watches(&self, object: ObjectAddress) -> bool {
        let machine = self
            .machines
            .iter()
            .any(|machine| machine.status.object.object == object || machine.control.object.object == object);
        let bit = |trigger: &Trigger| matches!(trigger, Trigger::Bit(bit, _) if bit.object.object == object);
        let on = |open: &Condition| open.object() == Some(object);
        let when = |trigger: &Trigger| bit(trigger) || trigger.when().iter().any(on);
        machine || self.gates_on(object) || self.procedures.iter().flat_map(Procedure::triggers).any(when)
    }

    /// Whether a gate looks at an object.
    pub(in crate::session) fn gates_on(&self, object: ObjectAddress) -> bool {
        let on = |open: &Condition| open.object() == Some(object);
        self.gates.iter().any(|gate| gate.open.0.iter().any(on))
    }
}
