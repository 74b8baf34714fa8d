//! State machines: reported state, commanded state, and cause of a change.

use super::changed::FieldChange;
use super::procedure::advance_procedures;
use super::set_point::reassess_set_points;
use crate::event::{DeviceCause, DeviceState, EventKind, StatePath};
use crate::frame::Frame;
use crate::profile::DeviceProfile;
use crate::profile::device::{ForcingEvent, StateDefinition, StateMachine, TriggerEvent};
use crate::session::bus::{
    Bus, CommandStep, FrameMoment, MachineState, Node, is_triggered_by, leads_further, leads_to, leave_text,
};
use crate::session::context::MachineContext;
use crate::wire::NodeId;
use crate::wire::canopen::ObjectAddress;
use crate::wire::canopen::nmt::NmtService;

/// Time in ns within which a command or an error can be the cause of a state change.
const WINDOW: i64 = 1_000_000_000;

/// Max steps stored on the path to a commanded state.
const STEPS: usize = 8;

/// Cause of a state change.
struct StateReason {
    cause: DeviceCause,
    frame: u64,
    emcy: Option<u16>,
    control: Option<u64>,
    /// Monotonic time of the control word.
    time: i64,
}

impl StateReason {
    const fn plain_reason(cause: DeviceCause, frame: u64) -> Self {
        Self { cause, frame, emcy: None, control: None, time: 0 }
    }
}

/// Stores the slot of the PDO with the control word of a machine.
pub(in crate::session) fn assign_control_slot(
    bus: &mut Bus,
    id: NodeId,
    device: &DeviceProfile,
    object: ObjectAddress,
    slot: usize,
) {
    for (place, machine) in device.machines.iter().enumerate() {
        if machine.control.object.object == object
            && let Some(state) = machine_mut(bus, id, place)
        {
            state.slot = Some(slot);
        }
    }
}

/// Applies a changed control word.
pub(in crate::session) fn control_changed(bus: &mut Bus, changed: &FieldChange<'_>) {
    let now = bus.clock.now();
    for (place, machine) in changed.device.machines.iter().enumerate() {
        if machine.control.object.object != changed.object {
            continue;
        }
        let Some(state) = machine_mut(bus, changed.id, place) else { continue };
        state.rising |= changed.raw & !state.control.unwrap_or(0);
        state.control = Some(changed.raw);
        state.control_since = now;
    }
}

/// Applies a changed status word.
pub(in crate::session) fn status_changed(
    changed: &FieldChange<'_>,
    frame: &Frame,
    cx: &mut MachineContext<'_>,
) {
    for (place, machine) in changed.device.machines.iter().enumerate() {
        if machine.status.object.object == changed.object {
            on_reported_state(changed, place, machine, frame, cx);
        }
    }
}

fn on_reported_state(
    changed: &FieldChange<'_>,
    place: usize,
    machine: &StateMachine,
    frame: &Frame,
    cx: &mut MachineContext<'_>,
) {
    let Some(to) = machine.reported_state(changed.raw) else {
        if let Some(known) = machine_mut(&mut cx.bus, changed.id, place) {
            known.undefined.get_or_insert((changed.raw & machine.status.mask, frame.number));
        }
        return;
    };
    let number = machine.states.iter().position(|state| state.name == to.name);
    let number = number.and_then(|number| u8::try_from(number).ok());
    let now = cx.bus.clock.now();
    let Some(known) = machine_mut(&mut cx.bus, changed.id, place) else { return };
    let was_old = std::mem::take(&mut known.is_old);
    if known.state == number {
        if was_old {
            reassess_set_points(changed.id, frame, cx);
        }
        return;
    }
    let known = known.clone();
    let from = known.state.and_then(|state| machine.states.get(usize::from(state)));
    let slot = known.slot.and_then(|slot| cx.bus.routes.slot(slot));
    let latest = slot.and_then(|slot| slot.plan.as_deref()?.recent.latest_pdo());
    let Some(node) = cx.bus.node(changed.id) else { return };
    let why = find_cause(node, machine, &known, (from, to), latest, now);
    let path = record_step(&mut cx.bus, changed.id, place, machine, number, &why);
    let event = DeviceState {
        machine: machine.name.clone(),
        channel: machine.channel,
        from: from.map(|from| from.name.clone()),
        to: to.name.clone(),
        fault: to.fault,
        cause: why.cause,
        cause_frame: why.frame,
        emcy: why.emcy,
        leave: to.fault.then(|| leave_text(machine, &to.name)).flatten(),
        control: why.control,
        path,
    };
    if let Some(known) = machine_mut(&mut cx.bus, changed.id, place) {
        known.state = number;
        (known.frame, known.since) = (frame.number, now);
        known.rising = 0;
    }
    cx.emit_event(frame, changed.id, false, EventKind::DeviceState(Box::new(event)));
    let reported = TriggerEvent::State(machine.channel, &to.name);
    advance_procedures(changed.id, &reported, frame, cx);
    reassess_set_points(changed.id, frame, cx);
}

/// Adds a step to a commanded state; returns the path when a state is reached in several steps.
fn record_step(
    bus: &mut Bus,
    id: NodeId,
    place: usize,
    machine: &StateMachine,
    to: Option<u8>,
    why: &StateReason,
) -> Option<Box<StatePath>> {
    let known = machine_mut(bus, id, place)?;
    let control = why.control.filter(|_| why.cause == DeviceCause::ControlWord);
    let (Some(control), Some(to), Some(from)) = (control, to, known.state) else {
        known.steps.clear();
        return None;
    };
    let is_old = known.steps.last().is_some_and(|last| why.time.saturating_sub(last.time) > WINDOW);
    if is_old {
        known.steps.clear();
    }
    if known.steps.is_empty() {
        known.steps.push(CommandStep { state: from, frame: 0, time: why.time });
    }
    if known.steps.len() < STEPS {
        known.steps.push(CommandStep { state: to, frame: why.frame, time: why.time });
    }
    let name = &machine.states.get(usize::from(to))?.name;
    if leads_further(machine, name, control) {
        return None;
    }
    let steps = std::mem::take(&mut known.steps);
    let (first, rest) = steps.split_first()?;
    let (second, last) = (rest.first().filter(|_| rest.len() > 1)?, rest.last()?);
    let title =
        |step: &CommandStep| machine.states.get(usize::from(step.state)).map(|state| state.name.clone());
    let states = std::iter::once(first).chain(rest).filter_map(title).collect();
    let mut frames: Vec<u64> = rest.iter().map(|step| step.frame).collect();
    frames.dedup();
    let duration = last.time.saturating_sub(second.time);
    Some(Box::new(StatePath { states, frames, duration: bus.clock.has_timestamps().then_some(duration) }))
}

fn machine_mut(bus: &mut Bus, id: NodeId, place: usize) -> Option<&mut MachineState> {
    let machines = &mut bus.nodes.node_mut(id)?.behaviour.machines;
    if machines.len() <= place {
        machines.resize(place + 1, MachineState::default());
    }
    machines.get_mut(place)
}

/// Cause of the present state change.
fn find_cause(
    node: &Node,
    machine: &StateMachine,
    known: &MachineState,
    (from, to): (Option<&StateDefinition>, &StateDefinition),
    latest: Option<(u64, i64)>,
    now: i64,
) -> StateReason {
    if let Some(why) = forced_cause(node, machine, known, (from, to), now) {
        return why;
    }
    if let Some(control) = known.control {
        let leads = match from {
            Some(from) => leads_to(machine, &from.name, &to.name, control, known.rising),
            None => machine
                .transitions
                .iter()
                .any(|it| it.to == to.name && is_triggered_by(it, control, known.rising)),
        };
        if leads {
            let (frame, time) = latest.unwrap_or((0, now));
            return StateReason {
                control: Some(control),
                time,
                ..StateReason::plain_reason(DeviceCause::ControlWord, frame)
            };
        }
    }
    let boot = node.behaviour.boot.filter(|it| is_recent(it, known, now));
    let emcy = node.behaviour.emcy.filter(|it| to.fault && is_recent(it, known, now));
    let leads =
        |(spn, fmi)| node.device.trouble_code_entry(spn, fmi).is_some_and(|own| own.reaction == to.name);
    let dtc = node.behaviour.dtc.filter(|it| (to.fault || leads(it.what)) && is_recent(it, known, now));
    match (emcy, dtc, boot) {
        (Some(emcy), ..) => {
            StateReason { emcy: Some(emcy.what), ..StateReason::plain_reason(DeviceCause::Emcy, emcy.frame) }
        }
        (None, Some(dtc), _) => StateReason::plain_reason(DeviceCause::Dtc, dtc.frame),
        (None, None, Some(boot)) => StateReason::plain_reason(DeviceCause::BootUp, boot.frame),
        (None, None, None) => StateReason::plain_reason(DeviceCause::NotOnTheBus, 0),
    }
}

/// Cause listed in the profile for this change.
fn forced_cause(
    node: &Node,
    machine: &StateMachine,
    known: &MachineState,
    (from, to): (Option<&StateDefinition>, &StateDefinition),
    now: i64,
) -> Option<StateReason> {
    let behaviour = &node.behaviour;
    let life_guard = node.device.monitoring.life_guard_emcy;
    let fitting = machine.forced.iter().filter(|it| {
        let from = from.map_or("", |from| from.name.as_str());
        it.to == to.name && (it.from.0.is_empty() || it.from.0.iter().any(|own| own == from))
    });
    for it in fitting {
        let mut commands = behaviour.nmt.iter().flatten();
        let meant = |nmt: &&FrameMoment<NmtService>| {
            it.nmt.as_deref() == Some(nmt.what.name()) && is_recent(nmt, known, now)
        };
        if let Some(nmt) = commands.find(meant) {
            return Some(StateReason::plain_reason(DeviceCause::NmtCommand, nmt.frame));
        }
        let emcy = behaviour.emcy.filter(|emcy| is_recent(emcy, known, now));
        let meant = |code: u16| it.emcy.as_ref().is_some_and(|codes| codes.contains(code));
        if let Some(emcy) = emcy.filter(|emcy| meant(emcy.what)) {
            return Some(StateReason {
                emcy: Some(emcy.what),
                ..StateReason::plain_reason(DeviceCause::Emcy, emcy.frame)
            });
        }
        let is_expiry = it.event == Some(ForcingEvent::LifeGuard);
        if let Some(emcy) = emcy.filter(|it| is_expiry && Some(it.what) == life_guard) {
            return Some(StateReason::plain_reason(DeviceCause::LifeGuard, emcy.frame));
        }
        let is_boot = it.event == Some(ForcingEvent::BootUp);
        let boot = behaviour.boot.filter(|boot| is_boot && is_recent(boot, known, now));
        if let Some(boot) = boot {
            return Some(StateReason::plain_reason(DeviceCause::BootUp, boot.frame));
        }
    }
    None
}

/// Whether it occurred after the last change of state, and within the time window.
fn is_recent<T>(moment: &FrameMoment<T>, known: &MachineState, now: i64) -> bool {
    moment.frame >= known.frame && now.saturating_sub(moment.time) <= WINDOW
}
