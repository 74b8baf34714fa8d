//! Devices that stay active although the control word or an EMCY demands another state.

use std::sync::Arc;

use super::machines::{about, commanded, machine};
use crate::event::{
    DeviceCause, DeviceState, Direction, EmcyAction, Emergency, Event, EventKind, FrameRange, Kind, Outcome,
    Pdo,
};
use crate::frame::CanId;
use crate::profile::device::Machine;
use crate::profile::{Layout, SignalId};
use crate::rules::context::pdo_slot::PdoSlot;
use crate::rules::context::traffic::BySlot;
use crate::rules::rule::{declare_rule, tolerance};
use crate::rules::{Context, PdoSubset, Policy, Rule};
use crate::session::Node;
use crate::wire::canopen::NmtState;
use crate::wire::{NodeId, NodeMap};

declare_rule! {
    /// # What it checks
    /// A device reports its active state in the second TPDO after a control word commanded another one, or
    /// after an EMCY for which the manual demands a fault state. It must have followed a control word since
    /// its last boot-up and download. Transitions in which the device may first slow down are exempt.
    ///
    /// # Why it matters
    /// The outputs stay active although the controller switched them off, or although the device reported a
    /// fault.
    ///
    /// # Source
    /// State machine in the device manual; for fluid power CiA 408, for drives CiA 402.
    ///
    /// # What to look at first
    /// Check for a second master that sends control words, and whether the device is operated locally.
    ///
    /// # Mutation
    /// let the status word stay active after the control word commanded another state
    "active-not-ended", Error, "device active against its command or fault",
    kinds: [Kind::Pdo, Kind::DeviceState, Kind::Emcy, Kind::BootUp, Kind::NmtCommand, Kind::SdoTransfer],
    pdos: PdoSubset::ReceivedChanged,
    needs: "a control word that ends the active state, or an EMCY that demands a fault state",
    word: "STATE",
    tolerances: &[tolerance("time-ms", 20.0, "ms", "minimum time before the second TPDO: frames may be queued")],
}

/// Time in ns between two checks of a device whose second TPDO is missing.
const AGAIN: i64 = 100_000_000;

/// Maximum time in ns for the second TPDO; a later one is not judged.
const LAPSE: i64 = 5_000_000_000;

/// Reason for another state.
enum Reason {
    /// EMCY code for which the manual demands a fault state.
    Emcy(u16),
    /// Control word, and the state that it commands.
    Control(u64, String),
}

/// Demand of another state.
struct Demand {
    reason: Reason,
    frame: u64,
    time: i64,
    /// Number of TPDOs with the status word, and of SYNCs, at that time.
    count: u64,
    syncs: u64,
}

/// State machine of a node.
#[derive(Default)]
struct Watch {
    /// Name of the active state, while it is reported.
    active: Option<String>,
    /// Identifier of the TPDO with the status word.
    status: Option<CanId>,
    /// The device followed a control word.
    has_followed: bool,
    demand: Option<Demand>,
    is_told: bool,
}

/// Control words in a layout: index of the machine, and of the field.
#[derive(Default)]
struct ControlFields {
    layout: Option<Arc<Layout>>,
    fields: Vec<(usize, usize)>,
}

struct ActiveNotEnded {
    time: i64,
    nodes: NodeMap<Vec<Watch>>,
    controls: BySlot<ControlFields>,
    /// Number of machines in their active state; without one, PDOs are skipped.
    active: usize,
}

fn new(policy: &Policy) -> ActiveNotEnded {
    ActiveNotEnded {
        time: policy.nanoseconds(&DECLARATION, "time-ms"),
        nodes: NodeMap::default(),
        controls: BySlot::default(),
        active: 0,
    }
}

impl Demand {
    const fn is_command(&self) -> bool {
        matches!(self.reason, Reason::Control(..))
    }

    /// Whether the state was reported again in the second TPDO. `later` TPDOs report another state.
    fn is_ignored(&self, status: &PdoSlot, later: u64, time: i64, context: &Context<'_>) -> bool {
        let count = status.count.saturating_sub(later).saturating_sub(self.count);
        // A synchronous control word takes effect at the next SYNC, and appears in the TPDO after it.
        let is_synchronous = context.traffic.syncs() > 0 && status.since_sync <= 1;
        let syncs = context.traffic.syncs().saturating_sub(self.syncs).saturating_sub(later);
        count >= 2 && (!is_synchronous || syncs >= 2) && context.now.saturating_sub(self.time) >= time
    }
}

impl ActiveNotEnded {
    fn watch(&mut self, node: NodeId, place: usize) -> Option<&mut Watch> {
        let all = self.nodes.entry(node)?;
        if all.len() <= place {
            all.resize_with(place + 1, Watch::default);
        }
        all.get_mut(place)
    }

    fn count_active(&mut self) {
        let all = self.nodes.iter().flat_map(|(_, all)| all);
        self.active = all.filter(|watch| watch.active.is_some()).count();
    }

    fn state(&mut self, event: &Event, id: NodeId, state: &DeviceState, context: &mut Context<'_>) {
        let Some((place, machine)) = context.node(event).and_then(|node| machine(node, state)) else {
            return;
        };
        let slot = context.traffic.current().filter(|slot| slot.frames.0 == event.frames.last);
        let time = self.time;
        let Some(watch) = self.watch(id, place) else { return };
        if let (Some(demand), Some(slot)) = (watch.demand.take(), slot) {
            if demand.is_ignored(slot, 1, time, context) {
                watch.report(&demand, slot.frames.1, (id, machine), context);
            } else if !watch.is_told {
                context.pass();
            }
        }
        if std::mem::take(&mut watch.is_told) {
            context.close(Some(id), about(machine.channel));
        }
        watch.status = slot.map(|slot| slot.id).or(watch.status);
        watch.has_followed |= state.cause == DeviceCause::ControlWord;
        let is_active = machine.states.iter().any(|known| known.active && known.name == state.to);
        watch.active = is_active.then(|| state.to.clone());
        self.count_active();
    }

    #[cold]
    fn control(&mut self, event: &Event, id: NodeId, pdo: &Pdo, context: &mut Context<'_>) {
        let least = self.time;
        let (Some(layout), Some(slot)) = (&pdo.layout, context.traffic.current()) else { return };
        let Some(node) = context.node(event) else { return };
        let Some(known) = self.controls.of(slot) else { return };
        if !known.layout.as_ref().is_some_and(|known| Arc::ptr_eq(known, layout)) {
            known.learn(layout, node);
        }
        for (place, field) in &known.fields {
            let machine = node.device().machines.get(*place);
            let raw = layout.fields.get(*field).and_then(|field| field.extract(pdo.payload()));
            let watch = self.nodes.get_mut(id).and_then(|all| all.get_mut(*place));
            if let (Some(machine), Some(raw), Some(watch)) = (machine, raw, watch) {
                watch.on_control(event, (id, *place, least), (machine, raw), context);
            }
        }
    }

    fn on_emergency(&mut self, event: &Event, id: NodeId, emergency: &Emergency, context: &mut Context<'_>) {
        let (Some(node), least) = (context.node(event), self.time) else { return };
        for (place, machine) in node.device().machines.iter().enumerate() {
            let Some(watch) = self.nodes.get_mut(id).and_then(|all| all.get_mut(place)) else { continue };
            if emergency.action != EmcyAction::Raised {
                watch.demand = watch.demand.take().filter(Demand::is_command);
            } else if let (Some(code), Some(active)) = (emergency.code, &watch.active)
                && demands_fault(node, machine, active, code)
            {
                watch.demand(event, (id, place, least), Reason::Emcy(code), context);
            }
        }
    }

    /// Forgets what a device was commanded: it restarted, or its communication state changed.
    fn forget(&mut self, node: Option<NodeId>, is_restart: bool) {
        for id in NodeId::all().filter(|id| node.is_none_or(|node| node == *id)) {
            for watch in self.nodes.get_mut(id).into_iter().flatten() {
                watch.demand = None;
                if is_restart {
                    (watch.has_followed, watch.active) = (false, None);
                }
            }
        }
        self.count_active();
    }
}

/// Whether the profile demands a fault state after an EMCY.
fn demands_fault(node: &Node, machine: &Machine, active: &str, code: u16) -> bool {
    let is_fault = |to: &str| machine.states.iter().any(|state| state.fault && state.name == to);
    let known = node.device().emcy.code.iter().find(|known| known.code == code);
    let reaction = known.and_then(|known| known.reaction.as_deref());
    machine.forced.iter().any(|forced| {
        is_fault(&forced.to)
            && forced.emcy.as_ref().is_some_and(|codes| codes.contains(code))
            && (forced.from.0.is_empty() || forced.from.0.iter().any(|from| from == active))
    }) && reaction.is_none_or(is_fault)
}

impl ControlFields {
    #[cold]
    fn learn(&mut self, layout: &Arc<Layout>, node: &Node) {
        self.layout = Some(Arc::clone(layout));
        let machines = node.device().machines.iter().enumerate();
        let fields = machines.filter_map(|(place, machine)| {
            let control = SignalId::Object(machine.control.object.object);
            Some((place, layout.fields.iter().position(|field| field.id == control)?))
        });
        self.fields = fields.collect();
    }
}

impl Watch {
    fn on_control(
        &mut self,
        event: &Event,
        (id, place, least): (NodeId, usize, i64),
        (machine, control): (&Machine, u64),
        context: &mut Context<'_>,
    ) {
        let Some(active) = self.active.as_deref() else { return };
        let to = commanded(machine, active, control).filter(|to| *to != active);
        let Some(to) = to.map(str::to_owned) else {
            // The present state is commanded again.
            self.demand = self.demand.take().filter(|demand| !demand.is_command());
            return;
        };
        let is_operational = context.confirmed_state(id).is_none_or(|state| state == NmtState::Operational);
        if self.has_followed && is_operational {
            self.demand(event, (id, place, least), Reason::Control(control, to), context);
        }
    }

    fn demand(
        &mut self,
        event: &Event,
        (id, place, least): (NodeId, usize, i64),
        reason: Reason,
        context: &mut Context<'_>,
    ) {
        let status = self.status.and_then(|id| context.pdos_of(id));
        if self.demand.is_some() || self.is_told || !context.has_time {
            return;
        }
        let Some(count) = status.map(|status| status.count) else { return };
        let (frame, time, syncs) = (event.frames.last, context.now, context.traffic.syncs());
        self.demand = Some(Demand { reason, frame, time, count, syncs });
        context.wake_at(time.saturating_add(least), token(id, place));
    }

    fn report(
        &mut self,
        demand: &Demand,
        frame: u64,
        (id, machine): (NodeId, &Machine),
        context: &mut Context<'_>,
    ) {
        self.is_told = true;
        let active = self.active.as_deref().unwrap_or_default();
        let since = context.timestamp_of(demand.time);
        let alarm = context.fail_at(context.now, Some(id), FrameRange { first: demand.frame, last: frame });
        alarm.about(about(machine.channel)).since(since).report(|| {
            let first = demand.frame;
            match &demand.reason {
                Reason::Emcy(code) => format!("{active} in the second TPDO after EMCY {code:04X} {{{first}}} (fault state required)"),
                Reason::Control(control, to) => {
                    format!("{active} in the second TPDO after control word {control:02X} {{{first}}} commanded {to}")
                }
            }
        });
    }
}

fn token(id: NodeId, place: usize) -> u64 {
    (place as u64) << 8 | u64::from(id.number())
}

impl Rule for ActiveNotEnded {
    fn wants_pdos(&self) -> bool {
        self.active > 0
    }

    #[inline]
    fn event(&mut self, event: &Event, context: &mut Context<'_>) {
        match (&event.kind, event.node) {
            (EventKind::Pdo(pdo), Some(node)) if self.active > 0 => self.control(event, node, pdo, context),
            (EventKind::DeviceState(state), Some(node)) => self.state(event, node, state, context),
            (EventKind::BootUp { .. }, node) => self.forget(node, true),
            (EventKind::NmtCommand { target, .. }, _) => {
                self.forget(Some(NodeId::Canopen(*target)).filter(|_| *target != 0), false);
            }
            (EventKind::Emcy(emergency), node) if emergency.boot.is_some() => self.forget(node, true),
            (EventKind::Emcy(emergency), Some(node)) => self.on_emergency(event, node, emergency, context),
            (EventKind::SdoTransfer(transfer), Some(node))
                if transfer.direction == Some(Direction::Download)
                    && transfer.outcome == Outcome::Complete =>
            {
                // The download may select another source of commands.
                for watch in self.nodes.get_mut(node).into_iter().flatten() {
                    watch.has_followed = false;
                    watch.demand = watch.demand.take().filter(|demand| !demand.is_command());
                }
            }
            _ => {}
        }
    }

    fn wake(&mut self, wanted: u64, context: &mut Context<'_>) {
        let time = self.time;
        let Some(id) = u8::try_from(wanted & 0xFF).ok().map(NodeId::Canopen) else { return };
        let Some(place) = usize::try_from(wanted >> 8).ok() else { return };
        let Some(machine) = context.bus.node(id).and_then(|node| node.device().machines.get(place)) else {
            return;
        };
        let Some(watch) = self.nodes.get_mut(id).and_then(|all| all.get_mut(place)) else { return };
        let Some(demand) = watch.demand.take() else { return };
        let status = watch.status.and_then(|id| context.pdos_of(id));
        let lapsed = context.now.saturating_sub(demand.time) > LAPSE || context.is_across_hole(demand.frame);
        let Some(status) = status.filter(|_| !lapsed) else { return };
        if demand.is_ignored(status, 0, time, context) {
            return watch.report(&demand, status.frames.0, (id, machine), context);
        }
        let due = demand.time.saturating_add(time);
        let due = if due > context.now { due } else { context.now.saturating_add(AGAIN) };
        watch.demand = Some(demand);
        context.wake_at(due, wanted);
    }
}
