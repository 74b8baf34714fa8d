//! Devices that stay active although the control word or an EMCY demands another state.

use std::sync::Arc;

use super::machines::{commanded_state, machine_subject, state_machine};
use crate::event::{
    DecodedPdo, DeviceCause, DeviceState, EmcyAction, Emergency, Event, EventKind, FrameRange, Kind,
    SdoDirection, SdoOutcome,
};
use crate::frame::CanId;
use crate::profile::device::StateMachine;
use crate::profile::{PayloadLayout, SignalId};
use crate::rules::context::pdo_slot::PdoSlot;
use crate::rules::context::traffic::BySlot;
use crate::rules::rule::{declare_rule, define_tolerance};
use crate::rules::{PdoSubset, Rule, RuleContext, RulePolicy};
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
    tolerances: &[define_tolerance("time-ms", 20.0, "ms", "minimum time before the second TPDO: frames may be queued")],
}

/// Time in ns between two checks of a device whose second TPDO is missing.
const AGAIN: i64 = 100_000_000;

/// Maximum time in ns for the second TPDO; a later one is not judged.
const LAPSE: i64 = 5_000_000_000;

/// Reason for another state.
enum DemandReason {
    /// EMCY code for which the manual demands a fault state.
    Emcy(u16),
    /// Control word, and the state that it commands.
    Control(u64, String),
}

/// Demand of another state.
struct StateDemand {
    reason: DemandReason,
    frame: u64,
    time: i64,
    /// Number of TPDOs with the status word, and of SYNCs, at that time.
    count: u64,
    syncs: u64,
}

/// State machine of a node.
#[derive(Default)]
struct MachineWatch {
    /// Name of the active state, while it is reported.
    active: Option<String>,
    /// Identifier of the TPDO with the status word.
    status: Option<CanId>,
    /// The device followed a control word.
    has_followed: bool,
    demand: Option<StateDemand>,
    is_reported: bool,
}

/// Control words in a layout: index of the machine, and of the field.
#[derive(Default)]
struct ControlFields {
    layout: Option<Arc<PayloadLayout>>,
    fields: Vec<(usize, usize)>,
}

struct ActiveNotEnded {
    time: i64,
    nodes: NodeMap<Vec<MachineWatch>>,
    controls: BySlot<ControlFields>,
    /// Number of machines in their active state; without one, PDOs are skipped.
    active: usize,
}

fn new(policy: &RulePolicy) -> ActiveNotEnded {
    ActiveNotEnded {
        time: policy.tolerance_ns(&DECLARATION, "time-ms"),
        nodes: NodeMap::default(),
        controls: BySlot::default(),
        active: 0,
    }
}

impl StateDemand {
    const fn is_command(&self) -> bool {
        matches!(self.reason, DemandReason::Control(..))
    }

    /// Whether the state was reported again in the second TPDO. `later` TPDOs report another state.
    fn is_ignored(&self, status: &PdoSlot, later: u64, time: i64, context: &RuleContext<'_>) -> bool {
        let count = status.count.saturating_sub(later).saturating_sub(self.count);
        // A synchronous control word takes effect at the next SYNC, and appears in the TPDO after it.
        let is_synchronous = context.traffic.sync_count() > 0 && status.since_sync <= 1;
        let syncs = context.traffic.sync_count().saturating_sub(self.syncs).saturating_sub(later);
        count >= 2 && (!is_synchronous || syncs >= 2) && context.now.saturating_sub(self.time) >= time
    }
}

impl ActiveNotEnded {
    fn machine_watch(&mut self, node: NodeId, place: usize) -> Option<&mut MachineWatch> {
        let all = self.nodes.entry(node)?;
        if all.len() <= place {
            all.resize_with(place + 1, MachineWatch::default);
        }
        all.get_mut(place)
    }

    fn count_active(&mut self) {
        let all = self.nodes.iter().flat_map(|(_, all)| all);
        self.active = all.filter(|watch| watch.active.is_some()).count();
    }

    fn on_state(&mut self, event: &Event, id: NodeId, state: &DeviceState, context: &mut RuleContext<'_>) {
        let Some((place, machine)) = context.event_node(event).and_then(|node| state_machine(node, state))
        else {
            return;
        };
        let slot = context.traffic.current_slot().filter(|slot| slot.frames.0 == event.frames.last);
        let time = self.time;
        let Some(watch) = self.machine_watch(id, place) else { return };
        if let (Some(demand), Some(slot)) = (watch.demand.take(), slot) {
            if demand.is_ignored(slot, 1, time, context) {
                watch.report_demand(&demand, slot.frames.1, (id, machine), context);
            } else if !watch.is_reported {
                context.count_pass();
            }
        }
        if std::mem::take(&mut watch.is_reported) {
            context.close_condition(Some(id), machine_subject(machine.channel));
        }
        watch.status = slot.map(|slot| slot.id).or(watch.status);
        watch.has_followed |= state.cause == DeviceCause::ControlWord;
        let is_active = machine.states.iter().any(|known| known.active && known.name == state.to);
        watch.active = is_active.then(|| state.to.clone());
        self.count_active();
    }

    #[cold]
    fn on_control(&mut self, event: &Event, id: NodeId, pdo: &DecodedPdo, context: &mut RuleContext<'_>) {
        let least = self.time;
        let (Some(layout), Some(slot)) = (&pdo.layout, context.traffic.current_slot()) else { return };
        let Some(node) = context.event_node(event) else { return };
        let Some(known) = self.controls.entry_of(slot) else { return };
        if !known.layout.as_ref().is_some_and(|known| Arc::ptr_eq(known, layout)) {
            known.learn_fields(layout, node);
        }
        for (place, field) in &known.fields {
            let machine = node.device().machines.get(*place);
            let raw = layout.fields.get(*field).and_then(|field| field.extract_bits(pdo.payload()));
            let watch = self.nodes.get_mut(id).and_then(|all| all.get_mut(*place));
            if let (Some(machine), Some(raw), Some(watch)) = (machine, raw, watch) {
                watch.on_control(event, (id, *place, least), (machine, raw), context);
            }
        }
    }

    fn on_emergency(
        &mut self,
        event: &Event,
        id: NodeId,
        emergency: &Emergency,
        context: &mut RuleContext<'_>,
    ) {
        let (Some(node), least) = (context.event_node(event), self.time) else { return };
        for (place, machine) in node.device().machines.iter().enumerate() {
            let Some(watch) = self.nodes.get_mut(id).and_then(|all| all.get_mut(place)) else { continue };
            if emergency.action != EmcyAction::Raised {
                watch.demand = watch.demand.take().filter(StateDemand::is_command);
            } else if let (Some(code), Some(active)) = (emergency.code, &watch.active)
                && demands_fault(node, machine, active, code)
            {
                watch.set_demand(event, (id, place, least), DemandReason::Emcy(code), context);
            }
        }
    }

    /// Forgets what a device was commanded: it restarted, or its communication state changed.
    fn forget_commands(&mut self, node: Option<NodeId>, is_restart: bool) {
        for id in NodeId::all_ids().filter(|id| node.is_none_or(|node| node == *id)) {
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
fn demands_fault(node: &Node, machine: &StateMachine, active: &str, code: u16) -> bool {
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
    fn learn_fields(&mut self, layout: &Arc<PayloadLayout>, node: &Node) {
        self.layout = Some(Arc::clone(layout));
        let machines = node.device().machines.iter().enumerate();
        let fields = machines.filter_map(|(place, machine)| {
            let control = SignalId::Object(machine.control.object.object);
            Some((place, layout.fields.iter().position(|field| field.id == control)?))
        });
        self.fields = fields.collect();
    }
}

impl MachineWatch {
    fn on_control(
        &mut self,
        event: &Event,
        (id, place, least): (NodeId, usize, i64),
        (machine, control): (&StateMachine, u64),
        context: &mut RuleContext<'_>,
    ) {
        let Some(active) = self.active.as_deref() else { return };
        let to = commanded_state(machine, active, control).filter(|to| *to != active);
        let Some(to) = to.map(str::to_owned) else {
            // The present state is commanded again.
            self.demand = self.demand.take().filter(|demand| !demand.is_command());
            return;
        };
        let is_operational = context.confirmed_state(id).is_none_or(|state| state == NmtState::Operational);
        if self.has_followed && is_operational {
            self.set_demand(event, (id, place, least), DemandReason::Control(control, to), context);
        }
    }

    fn set_demand(
        &mut self,
        event: &Event,
        (id, place, least): (NodeId, usize, i64),
        reason: DemandReason,
        context: &mut RuleContext<'_>,
    ) {
        let status = self.status.and_then(|id| context.pdos_of(id));
        if self.demand.is_some() || self.is_reported || !context.has_time {
            return;
        }
        let Some(count) = status.map(|status| status.count) else { return };
        let (frame, time, syncs) = (event.frames.last, context.now, context.traffic.sync_count());
        self.demand = Some(StateDemand { reason, frame, time, count, syncs });
        context.wake_at(time.saturating_add(least), wake_token(id, place));
    }

    fn report_demand(
        &mut self,
        demand: &StateDemand,
        frame: u64,
        (id, machine): (NodeId, &StateMachine),
        context: &mut RuleContext<'_>,
    ) {
        self.is_reported = true;
        let active = self.active.as_deref().unwrap_or_default();
        let since = context.timestamp_of(demand.time);
        let alarm = context.fail_at(context.now, Some(id), FrameRange { first: demand.frame, last: frame });
        alarm.with_subject(machine_subject(machine.channel)).started_at(since).report_finding(|| {
            let first = demand.frame;
            match &demand.reason {
                DemandReason::Emcy(code) => format!("{active} in the second TPDO after EMCY {code:04X} {{{first}}} (fault state required)"),
                DemandReason::Control(control, to) => {
                    format!("{active} in the second TPDO after control word {control:02X} {{{first}}} commanded {to}")
                }
            }
        });
    }
}

fn wake_token(id: NodeId, place: usize) -> u64 {
    (place as u64) << 8 | u64::from(id.number())
}

impl Rule for ActiveNotEnded {
    fn wants_pdos(&self) -> bool {
        self.active > 0
    }

    #[inline]
    fn on_event(&mut self, event: &Event, context: &mut RuleContext<'_>) {
        match (&event.kind, event.node) {
            (EventKind::Pdo(pdo), Some(node)) if self.active > 0 => {
                self.on_control(event, node, pdo, context);
            }
            (EventKind::DeviceState(state), Some(node)) => self.on_state(event, node, state, context),
            (EventKind::BootUp { .. }, node) => self.forget_commands(node, true),
            (EventKind::NmtCommand { target, .. }, _) => {
                self.forget_commands(Some(NodeId::Canopen(*target)).filter(|_| *target != 0), false);
            }
            (EventKind::Emcy(emergency), node) if emergency.boot.is_some() => {
                self.forget_commands(node, true);
            }
            (EventKind::Emcy(emergency), Some(node)) => self.on_emergency(event, node, emergency, context),
            (EventKind::SdoTransfer(transfer), Some(node))
                if transfer.direction == Some(SdoDirection::Download)
                    && transfer.outcome == SdoOutcome::Complete =>
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

    fn on_wake(&mut self, wanted: u64, context: &mut RuleContext<'_>) {
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
            return watch.report_demand(&demand, status.frames.0, (id, machine), context);
        }
        let due = demand.time.saturating_add(time);
        let due = if due > context.now { due } else { context.now.saturating_add(AGAIN) };
        watch.demand = Some(demand);
        context.wake_at(due, wanted);
    }
}
