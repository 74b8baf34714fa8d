//! State machines: what the device reports, what the control word commands, and why a state changed.

use super::behaviour::{Changed, Moment};
use crate::event::{DeviceCause, DeviceState, EventKind, Path};
use crate::frame::Frame;
use crate::profile::Device;
use crate::profile::device::{Machine, State, Transition, TriggerEvent};
use crate::session::node::Node;
use crate::session::{Bus, Observer};
use crate::wire::NodeId;
use crate::wire::canopen::ObjectAddress;
use crate::wire::canopen::nmt::NmtService;

/// A command or error this long ago still explains a state, in nanoseconds.
const WINDOW: i64 = 1_000_000_000;

/// A reset bit that is 1 for so long in a fault is held, in nanoseconds.
const HELD: i64 = 300_000_000;

/// Steps remembered on the way to a commanded state.
const STEPS: usize = 8;

/// What is known of one machine of a node.
#[derive(Debug, Clone, Default)]
pub(in crate::session) struct MachineState {
    /// Place of the reported state.
    state: Option<u8>,
    /// Reported before the node's last start.
    pub(super) is_old: bool,
    /// Frame of the last change of state.
    frame: u64,
    /// Slot of the RPDO that carries its control word.
    slot: Option<usize>,
    /// Monotonic time of that change.
    since: i64,
    /// Control word as sent last.
    control: Option<u64>,
    /// Monotonic time since which it is that.
    control_since: i64,
    /// Bits of it that went from 0 to 1 since the last change of state.
    rising: u64,
    /// The way to the commanded state.
    steps: Vec<Step>,
}

#[derive(Debug, Clone)]
struct Step {
    state: u8,
    frame: u64,
    time: i64,
}

/// Why a state changed.
struct Why {
    cause: DeviceCause,
    frame: u64,
    emcy: Option<u16>,
    control: Option<u64>,
    /// Monotonic time of the control word.
    time: i64,
}

impl Why {
    const fn plain(cause: DeviceCause, frame: u64) -> Self {
        Self { cause, frame, emcy: None, control: None, time: 0 }
    }
}

impl Bus {
    /// The control word of a machine travels in the PDO of this slot.
    pub(super) fn commanded_by(&mut self, id: NodeId, device: &Device, object: ObjectAddress, slot: usize) {
        for (place, machine) in device.machines.iter().enumerate() {
            if machine.control.object.object == object
                && let Some(state) = self.machine_mut(id, place)
            {
                state.slot = Some(slot);
            }
        }
    }

    /// A control word changed.
    pub(super) fn control_changed(&mut self, changed: &Changed<'_>) {
        let now = self.clock.now();
        for (place, machine) in changed.device.machines.iter().enumerate() {
            if machine.control.object.object != changed.object {
                continue;
            }
            let Some(state) = self.machine_mut(changed.id, place) else { continue };
            state.rising |= changed.raw & !state.control.unwrap_or(0);
            state.control = Some(changed.raw);
            state.control_since = now;
        }
    }

    /// A status word changed.
    pub(super) fn status_changed(&mut self, changed: &Changed<'_>, frame: &Frame, out: &mut dyn Observer) {
        for (place, machine) in changed.device.machines.iter().enumerate() {
            if machine.status.object.object == changed.object {
                self.reported(changed, place, machine, frame, out);
            }
        }
    }

    fn reported(
        &mut self,
        changed: &Changed<'_>,
        place: usize,
        machine: &Machine,
        frame: &Frame,
        out: &mut dyn Observer,
    ) {
        let Some(to) = machine.state(changed.raw) else { return };
        let number = machine.states.iter().position(|state| state.name == to.name);
        let number = number.and_then(|number| u8::try_from(number).ok());
        let now = self.clock.now();
        let Some(known) = self.machine_mut(changed.id, place) else { return };
        let was_old = std::mem::take(&mut known.is_old);
        if known.state == number {
            if was_old {
                self.reassess(changed.id, frame, out);
            }
            return;
        }
        let known = known.clone();
        let from = known.state.and_then(|state| machine.states.get(usize::from(state)));
        let slot = known.slot.and_then(|slot| self.routes.slot(slot));
        let latest = slot.and_then(|slot| slot.plan.as_deref()?.recent.latest());
        let Some(node) = self.node(changed.id) else { return };
        let why = why(node, machine, &known, (from, to), latest, now);
        let path = self.step(changed.id, place, machine, number, &why);
        let event = DeviceState {
            machine: machine.name.clone(),
            channel: machine.channel,
            from: from.map(|from| from.name.clone()),
            to: to.name.clone(),
            fault: to.fault,
            cause: why.cause,
            cause_frame: why.frame,
            emcy: why.emcy,
            leave: to.fault.then(|| leave(machine, &to.name)).flatten(),
            control: why.control,
            path,
        };
        if let Some(known) = self.machine_mut(changed.id, place) {
            known.state = number;
            (known.frame, known.since) = (frame.number, now);
            known.rising = 0;
        }
        self.emit(frame, changed.id, false, EventKind::DeviceState(Box::new(event)), out);
        let reported = TriggerEvent::State(machine.channel, &to.name);
        self.procedures_saw(changed.id, &reported, frame, out);
        self.reassess(changed.id, frame, out);
    }

    /// Remembers a step to a commanded state; tells the way when that is reached in more than one.
    fn step(
        &mut self,
        id: NodeId,
        place: usize,
        machine: &Machine,
        to: Option<u8>,
        why: &Why,
    ) -> Option<Box<Path>> {
        let known = self.machine_mut(id, place)?;
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
            known.steps.push(Step { state: from, frame: 0, time: why.time });
        }
        if known.steps.len() < STEPS {
            known.steps.push(Step { state: to, frame: why.frame, time: why.time });
        }
        let name = &machine.states.get(usize::from(to))?.name;
        if goes_on(machine, name, control) {
            return None;
        }
        let steps = std::mem::take(&mut known.steps);
        let (first, rest) = steps.split_first()?;
        let (second, last) = (rest.first().filter(|_| rest.len() > 1)?, rest.last()?);
        let title = |step: &Step| machine.states.get(usize::from(step.state)).map(|state| state.name.clone());
        let states = std::iter::once(first).chain(rest).filter_map(title).collect();
        let mut frames: Vec<u64> = rest.iter().map(|step| step.frame).collect();
        frames.dedup();
        let duration = last.time.saturating_sub(second.time);
        Some(Box::new(Path { states, frames, duration: self.clock.runs().then_some(duration) }))
    }

    fn machine_mut(&mut self, id: NodeId, place: usize) -> Option<&mut MachineState> {
        let machines = &mut self.node_mut(id)?.behaviour.machines;
        if machines.len() <= place {
            machines.resize(place + 1, MachineState::default());
        }
        machines.get_mut(place)
    }
}

impl Node {
    /// The state a machine reports.
    pub fn reported_state(&self, place: usize) -> Option<&State> {
        let known = self.behaviour.machines.get(place).filter(|known| !known.is_old)?;
        let state = known.state?;
        self.device.machines.get(place)?.states.get(usize::from(state))
    }

    /// Whether the control word in force leads from the reported state to one of `states`.
    pub(super) fn is_commanded(&self, place: usize, states: &[String]) -> bool {
        let (Some(known), Some(machine)) =
            (self.behaviour.machines.get(place), self.device.machines.get(place))
        else {
            return false;
        };
        let Some(from) = self.reported_state(place) else { return false };
        let control = known.control.unwrap_or(0);
        states.iter().any(|to| leads(machine, &from.name, to, control, known.rising))
    }

    /// The control word of a machine as sent last on the bus; `None` if none was seen.
    pub fn control_word(&self, machine: usize) -> Option<u64> {
        self.behaviour.machines.get(machine)?.control
    }

    /// Where the control word sent last leads from the reported state, as far as no bit must go from 0 to 1 for it.
    pub fn commanded_state(&self, place: usize) -> Option<&State> {
        let control = self.control_word(place)?;
        let machine = self.device.machines.get(place)?;
        let mut state = self.reported_state(place)?;
        // Bounded, for the transitions of a file may lead in a circle.
        for _ in 0..machine.states.len() {
            let mut out = machine.transitions.iter().filter(|it| it.from.0.contains(&state.name));
            let Some(next) = out.find(|it| it.edge == 0 && fits(it, control, 0)) else { break };
            state = machine.states.iter().find(|state| state.name == next.to)?;
        }
        Some(state)
    }

    /// Whether a fault is not left because a bit that must go from 0 to 1 is held at 1.
    pub fn is_reset_held(&self, place: usize, now: i64) -> bool {
        let known = self.behaviour.machines.get(place);
        let Some((known, machine)) = known.zip(self.device.machines.get(place)) else { return false };
        let (Some(control), Some(state)) = (known.control, self.reported_state(place)) else { return false };
        let mut out = machine.transitions.iter().filter(|it| it.from.0.contains(&state.name));
        let rests = now.saturating_sub(known.since.max(known.control_since));
        state.fault && rests >= HELD && out.any(|it| it.edge != 0 && control & it.edge == it.edge)
    }

    /// What the control word must do to leave the fault a machine reports, where the profile says it in words.
    pub fn way_out(&self, place: usize) -> Option<String> {
        let state = self.reported_state(place).filter(|state| state.fault)?;
        leave(self.device.machines.get(place)?, &state.name)
    }

    /// State names of all machines: channel, state, whether it is a fault, whether set points act in it.
    pub fn device_states(&self) -> impl Iterator<Item = (Option<u8>, &State)> {
        let machines = self.device.machines.iter().enumerate();
        machines.filter_map(|(place, machine)| Some((machine.channel, self.reported_state(place)?)))
    }
}

/// What the control word must do to leave a state, where the profile says it in words.
fn leave(machine: &Machine, state: &str) -> Option<String> {
    let mut out = machine.transitions.iter().filter(|it| it.from.0.iter().any(|from| from == state));
    out.find_map(|it| it.text.clone())
}

/// Why a machine is in another state now.
fn why(
    node: &Node,
    machine: &Machine,
    known: &MachineState,
    (from, to): (Option<&State>, &State),
    latest: Option<(u64, i64)>,
    now: i64,
) -> Why {
    if let Some(why) = forced(node, machine, known, (from, to), now) {
        return why;
    }
    if let Some(control) = known.control {
        let leads = match from {
            Some(from) => leads(machine, &from.name, &to.name, control, known.rising),
            None => machine.transitions.iter().any(|it| it.to == to.name && fits(it, control, known.rising)),
        };
        if leads {
            let (frame, time) = latest.unwrap_or((0, now));
            return Why { control: Some(control), time, ..Why::plain(DeviceCause::ControlWord, frame) };
        }
    }
    let boot = node.behaviour.boot.filter(|it| is_recent(it, known, now));
    let emcy = node.behaviour.emcy.filter(|it| to.fault && is_recent(it, known, now));
    let leads = |(spn, fmi)| node.device.dtc(spn, fmi).is_some_and(|own| own.reaction == to.name);
    let dtc = node.behaviour.dtc.filter(|it| (to.fault || leads(it.what)) && is_recent(it, known, now));
    match (emcy, dtc, boot) {
        (Some(emcy), ..) => Why { emcy: Some(emcy.what), ..Why::plain(DeviceCause::Emcy, emcy.frame) },
        (None, Some(dtc), _) => Why::plain(DeviceCause::Dtc, dtc.frame),
        (None, None, Some(boot)) => Why::plain(DeviceCause::BootUp, boot.frame),
        (None, None, None) => Why::plain(DeviceCause::NotOnTheBus, 0),
    }
}

/// A cause the machine's description names.
fn forced(
    node: &Node,
    machine: &Machine,
    known: &MachineState,
    (from, to): (Option<&State>, &State),
    now: i64,
) -> Option<Why> {
    let behaviour = &node.behaviour;
    let life_guard = node.device.monitoring.life_guard_emcy;
    let fitting = machine.forced.iter().filter(|it| {
        let from = from.map_or("", |from| from.name.as_str());
        it.to == to.name && (it.from.0.is_empty() || it.from.0.iter().any(|own| own == from))
    });
    for it in fitting {
        let mut commands = behaviour.nmt.iter().flatten();
        let meant = |nmt: &&Moment<NmtService>| {
            it.nmt.as_deref() == Some(nmt.what.name()) && is_recent(nmt, known, now)
        };
        if let Some(nmt) = commands.find(meant) {
            return Some(Why::plain(DeviceCause::NmtCommand, nmt.frame));
        }
        let emcy = behaviour.emcy.filter(|emcy| is_recent(emcy, known, now));
        let meant = |code: u16| it.emcy.as_ref().is_some_and(|codes| codes.contains(code));
        if let Some(emcy) = emcy.filter(|emcy| meant(emcy.what)) {
            return Some(Why { emcy: Some(emcy.what), ..Why::plain(DeviceCause::Emcy, emcy.frame) });
        }
        let event = it.event.as_deref();
        if let Some(emcy) = emcy.filter(|it| event == Some("life-guard") && Some(it.what) == life_guard) {
            return Some(Why::plain(DeviceCause::LifeGuard, emcy.frame));
        }
        let boot = behaviour.boot.filter(|boot| event == Some("boot-up") && is_recent(boot, known, now));
        if let Some(boot) = boot {
            return Some(Why::plain(DeviceCause::BootUp, boot.frame));
        }
    }
    None
}

/// Whether something happened since the last change of state, and not long ago.
fn is_recent<T>(moment: &Moment<T>, known: &MachineState, now: i64) -> bool {
    moment.frame >= known.frame && now.saturating_sub(moment.time) <= WINDOW
}

/// Whether a control word brings a transition about.
fn fits(transition: &Transition, control: u64, rising: u64) -> bool {
    control & transition.mask == transition.value & transition.mask
        && rising & transition.edge == transition.edge
}

/// Whether a control word leads from one state to another, over others too.
fn leads(machine: &Machine, from: &str, to: &str, control: u64, rising: u64) -> bool {
    let mut reached = vec![from];
    let mut next = 0;
    while let Some(state) = reached.get(next).copied() {
        next += 1;
        for it in machine.transitions.iter().filter(|it| it.from.0.iter().any(|own| own == state)) {
            if fits(it, control, rising) && !reached.contains(&it.to.as_str()) {
                if it.to == to {
                    return true;
                }
                reached.push(&it.to);
            }
        }
    }
    false
}

/// Whether the control word leads further from a state, without an edge.
fn goes_on(machine: &Machine, from: &str, control: u64) -> bool {
    let mut out = machine.transitions.iter().filter(|it| it.from.0.iter().any(|own| own == from));
    out.any(|it| it.to != from && it.edge == 0 && fits(it, control, 0))
}
