//! Nodes that leave the operational state without a command.

use crate::event::{BootCause, EmcyAction, Event, EventKind, FrameRange, Kind};
use crate::rules::rule::declare_rule;
use crate::rules::{Rule, RuleContext, RulePolicy};
use crate::wire::canopen::NmtState;
use crate::wire::canopen::nmt::NmtService;
use crate::wire::{NodeId, NodeMap};

declare_rule! {
    /// # What it checks
    /// A node reports pre-operational or stopped by heartbeat or guarding, although its last report was
    /// operational, and since then neither an NMT command nor a boot sign explains the change. An EMCY up to
    /// 2 s before or 100 ms after it is named as the cause. Exempt are reports within 2 s after a command or
    /// after a silence of 5 s, and nodes that restart or report operational again without a command.
    ///
    /// # Why it matters
    /// The node ignores RPDOs and sends no TPDOs, while the master assumes that it runs.
    ///
    /// # Source
    /// CiA 301 §7.3.2.2 (NMT state machine); §7.5.2.32 (error behaviour, 1029) permits the change after
    /// communication errors only.
    ///
    /// # What to look at first
    /// Look for an EMCY of the node, and read 1029:01 and 1016 of the node. Check the load of the bus.
    ///
    /// # Mutation
    /// let one heartbeat of an operational node report pre-operational
    "operational-lost", Warning, "node left operational without a command",
    kinds: [Kind::NmtCommand, Kind::Heartbeat, Kind::GuardReply, Kind::BootUp, Kind::Emcy],
    needs: "two heartbeats or guarding responses, the first of them operational",
    word: "NMT",
}

/// Time in ns after a command in which the node may still report queued states, and after an EMCY in which it
/// is the cause.
const WINDOW: i64 = 2_000_000_000;

/// Time in ns in which a later EMCY is the cause.
const CAUSE_DELAY: i64 = 100_000_000;

/// Maximum silence in ns before the report; after a longer one a command or a restart may be missing.
const SILENCE: i64 = 5_000_000_000;

/// A report of another state, until a later cause is excluded.
struct StateFall {
    state: NmtState,
    time: i64,
    frame: u64,
}

#[derive(Default)]
struct NodeReports {
    /// Time of the last report of operational.
    operational: Option<i64>,
    commanded: Option<i64>,
    /// Time, code and frame of the last EMCY.
    emergency: Option<(i64, u16, u64)>,
    fall: Option<StateFall>,
    /// The last change was to another state, without a command; operational again shows a second device.
    has_fallen: bool,
    /// Two devices report different states.
    is_contradictory: bool,
}

impl NodeReports {
    /// The node restarted, or a command was sent to it.
    fn forget_reports(&mut self) {
        (self.operational, self.fall) = (None, None);
        (self.has_fallen, self.is_contradictory) = (false, false);
    }

    /// Handles a report of operational; whether it continues the state.
    fn is_steady(&mut self, now: i64) -> bool {
        if std::mem::take(&mut self.has_fallen) {
            (self.is_contradictory, self.fall) = (true, None);
        }
        self.operational.replace(now).is_some() && !self.is_contradictory
    }

    /// Handles a report of another state; whether the node left operational by itself.
    fn on_other_state(&mut self, now: i64, all_commanded: Option<i64>) -> bool {
        let Some(last) = self.operational.take().filter(|_| !self.is_contradictory) else { return false };
        let is_commanded = |time: i64| time >= last || now.saturating_sub(time) <= WINDOW;
        now.saturating_sub(last) <= SILENCE && !self.commanded.max(all_commanded).is_some_and(is_commanded)
    }
}

#[derive(Default)]
struct OperationalLost {
    nodes: NodeMap<NodeReports>,
    all_commanded: Option<i64>,
}

fn new(_policy: &RulePolicy) -> OperationalLost {
    OperationalLost::default()
}

impl OperationalLost {
    fn on_state(&mut self, event: &Event, node: NodeId, state: NmtState, context: &mut RuleContext<'_>) {
        let (now, all_commanded) = (context.now, self.all_commanded);
        let Some(known) = self.nodes.entry(node) else { return };
        if state == NmtState::Operational {
            if known.is_steady(now) {
                context.count_pass();
            }
        } else if known.on_other_state(now, all_commanded) && context.has_time {
            known.has_fallen = true;
            known.fall = Some(StateFall { state, time: now, frame: event.frames.last });
            context.wake_at(now.saturating_add(CAUSE_DELAY), u64::from(node.number()));
        }
    }

    fn on_command(&mut self, target: u8, service: NmtService, now: i64) {
        let is_start = service == NmtService::Start;
        let nodes = if target == 0 { 1..=127 } else { target..=target };
        for node in nodes.map(NodeId::Canopen) {
            let Some(known) = self.nodes.get_mut(node) else { continue };
            (known.has_fallen, known.is_contradictory) = (false, false);
            if !is_start {
                known.commanded = Some(now);
            }
        }
        if target == 0 && !is_start {
            self.all_commanded = Some(now);
        }
    }

    /// A restart without a command is reported as such; a commanded one is the reaction of the master.
    fn on_boot(&mut self, node: NodeId, is_commanded: bool) {
        if let Some(known) = self.nodes.get_mut(node) {
            let fall = known.fall.take().filter(|_| is_commanded);
            known.forget_reports();
            known.fall = fall;
        }
    }

    fn on_emergency(&mut self, event: &Event, node: NodeId, code: u16, now: i64) {
        if let Some(known) = self.nodes.entry(node) {
            known.emergency = Some((now, code, event.frames.last));
        }
    }

    fn report_fall(&mut self, node: NodeId, context: &mut RuleContext<'_>) {
        let Some(known) = self.nodes.get_mut(node) else { return };
        let Some(StateFall { state, time, frame }) = known.fall.take() else { return };
        let is_cause = |emergency: &(i64, u16, u64)| time.saturating_sub(emergency.0) <= WINDOW;
        let cause = known.emergency.filter(is_cause);
        context.fail_at(time, Some(node), FrameRange::one(frame)).report_finding(|| {
            let cause = cause.map_or_else(
                || "not on the bus".to_owned(),
                |(_, code, frame)| format!("EMCY {code:04X} {{{frame}}}"),
            );
            format!("operational → {} without an NMT command (cause: {cause})", state.name())
        });
    }
}

impl Rule for OperationalLost {
    fn on_event(&mut self, event: &Event, context: &mut RuleContext<'_>) {
        match (&event.kind, event.node) {
            (EventKind::NmtCommand { service, target, .. }, _) => {
                self.on_command(*target, *service, context.now);
            }
            (
                EventKind::Heartbeat { state: Some(state), .. }
                | EventKind::GuardReply { state: Some(state), .. },
                Some(node),
            ) => self.on_state(event, node, *state, context),
            (EventKind::BootUp { cause, .. }, Some(node)) => {
                self.on_boot(node, matches!(cause, BootCause::Commanded { .. }));
            }
            (EventKind::Emcy(emergency), Some(node)) if emergency.boot.is_some() => self.on_boot(node, false),
            (EventKind::Emcy(emergency), Some(node)) => {
                if let (EmcyAction::Raised, Some(code)) = (emergency.action, emergency.code) {
                    self.on_emergency(event, node, code, context.now);
                }
            }
            _ => {}
        }
    }

    fn on_wake(&mut self, token: u64, context: &mut RuleContext<'_>) {
        let Some(node) = u8::try_from(token).ok().map(NodeId::Canopen) else { return };
        let due = self.nodes.get(node).and_then(|known| known.fall.as_ref());
        if due.is_some_and(|fall| context.now >= fall.time.saturating_add(CAUSE_DELAY)) {
            self.report_fall(node, context);
        }
    }

    fn on_end(&mut self, context: &mut RuleContext<'_>) {
        for node in NodeId::all_ids() {
            self.report_fall(node, context);
        }
    }
}
