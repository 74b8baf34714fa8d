//! No boot-up message after an NMT reset.

use crate::event::{Event, EventKind, FrameRange, Kind};
use crate::finding::Severity;
use crate::observation::is_controller;
use crate::profile::device::BootSign;
use crate::rules::rule::{declare_rule, define_tolerance};
use crate::rules::{Rule, RuleContext, RulePolicy};
use crate::session::Node;
use crate::wire::canopen::NmtState;
use crate::wire::{NodeId, NodeMap, NodeSet};

declare_rule! {
    /// # What it checks
    /// After an NMT reset, a known node must send its boot-up message, or the boot sign that its manual
    /// states, within `error-ms`. A boot-up under another node-ID also counts, and so does an EMCY with an
    /// error from a device whose boot sign is an empty EMCY; a boot-up message in its place does not. It is a
    /// note for an unknown device without an earlier boot-up. A reset of all nodes does not concern the controller, a
    /// node that sends only heartbeats and continues.
    ///
    /// # Why it matters
    /// The master waits for the boot-up before it configures the node. A node that does not return is out of
    /// service.
    ///
    /// # Source
    /// CiA 301 §7.3.2.2.1 (boot-up after initialisation), §7.2.8.3.3
    ///
    /// # What to look at first
    /// Check whether the node sends anything after the reset. Compare its start-up time with the limit.
    ///
    /// # Mutation
    /// drop the boot-up message after a reset
    "boot-up-missing", Warning, "no boot-up after an NMT reset",
    kinds: [Kind::NmtCommand, Kind::BootUp, Kind::Emcy, Kind::NodeIdChange],
    needs: "an NMT reset of a known node",
    cases: &["9.1", "10.1"],
    shows: &["10.1"],
    word: "BOOT",
    tolerances: &[define_tolerance("error-ms", 2_000.0, "ms", "from the NMT reset to the boot-up")],
}

/// Maximum silence before the reset, in nanoseconds; a node that was silent for longer may be absent.
const RECEIVED: i64 = 10_000_000_000;

#[derive(Clone, Copy, Default)]
struct PendingBoot {
    /// Frame of the reset, and end of the waiting time.
    frame: u64,
    due: i64,
    is_reset_of_all: bool,
}

struct BootUpMissing {
    limit: i64,
    waiting: NodeMap<PendingBoot>,
    booted: NodeSet,
}

fn new(policy: &RulePolicy) -> BootUpMissing {
    BootUpMissing {
        limit: policy.tolerance_ns(&DECLARATION, "error-ms"),
        waiting: NodeMap::default(),
        booted: NodeSet::default(),
    }
}

impl BootUpMissing {
    fn on_reset(&mut self, event: &Event, node: NodeId, context: &mut RuleContext<'_>) {
        let Some(known) = context.bus.node(node) else { return };
        let stamp = known.last_seen().1;
        let age =
            stamp.map_or(i64::MAX, |stamp| context.bus.now().saturating_sub(context.bus.monotonic(stamp)));
        let has_sign = known.device().nmt.boot != BootSign::BootUpAfterPowerOn;
        if age > RECEIVED || !has_sign || !context.has_time {
            return;
        }
        let due = context.now.saturating_add(self.limit);
        if let Some(waiting) = self.waiting.entry(node) {
            let is_reset_of_all = matches!(event.kind, EventKind::NmtCommand { target: 0, .. });
            *waiting = PendingBoot { frame: event.frames.last, due, is_reset_of_all };
            context.wake_at(due, node.table_place() as u64);
        }
    }

    /// Whether the node was reset, and its EMCY shows an error in place of the ready message.
    fn is_started_with_error(&self, node: NodeId, context: &RuleContext<'_>) -> bool {
        self.waiting.get(node).is_some() && reports_its_start_by_emcy(node, context)
    }

    fn on_boot(&mut self, node: NodeId, context: &mut RuleContext<'_>) {
        if self.booted.insert(node) && self.waiting.get(node).is_none() {
            // The node that was reset may use another node-ID now.
            self.waiting = NodeMap::default();
        }
        if self.waiting.remove(node).is_some() {
            context.count_pass();
        }
    }
}

/// Whether the device reports its start by EMCY: by an empty one, or by an error.
fn reports_its_start_by_emcy(node: NodeId, context: &RuleContext<'_>) -> bool {
    context.bus.node(node).is_some_and(|node| node.device().nmt.boot == BootSign::ReadyTelegram)
}

impl Rule for BootUpMissing {
    fn on_event(&mut self, event: &Event, context: &mut RuleContext<'_>) {
        match (&event.kind, event.node) {
            (EventKind::NmtCommand { to: Some(NmtState::Initialising), target: 0, .. }, _) => {
                let known: Vec<NodeId> = context.bus.nodes().map(Node::id).collect();
                for node in known.into_iter().filter(|node| node.canopen().is_some()) {
                    self.on_reset(event, node, context);
                }
            }
            (EventKind::NmtCommand { to: Some(NmtState::Initialising), .. }, Some(node)) => {
                self.on_reset(event, node, context);
            }
            // The boot sign may follow the boot-up message.
            (EventKind::BootUp { .. }, Some(node)) if reports_its_start_by_emcy(node, context) => {
                self.booted.insert(node);
            }
            (EventKind::BootUp { .. }, Some(node)) => self.on_boot(node, context),
            (EventKind::NodeIdChange { from: Some(from), .. }, _) => {
                self.waiting.remove(NodeId::Canopen(*from));
            }
            (EventKind::Emcy(emergency), Some(node))
                if emergency.boot.is_some() || self.is_started_with_error(node, context) =>
            {
                self.on_boot(node, context);
            }
            _ => {}
        }
    }

    fn on_wake(&mut self, token: u64, context: &mut RuleContext<'_>) {
        let Some(node) = NodeId::all_ids().find(|node| node.table_place() as u64 == token) else { return };
        let Some(reset) = self.waiting.get(node).copied().filter(|reset| reset.due <= context.now) else {
            return;
        };
        self.waiting.remove(node);
        let continues = context.bus.node(node).is_some_and(|node| node.last_seen().0 > reset.frame);
        if reset.is_reset_of_all && continues && is_controller(context.bus, node) {
            return;
        }
        let PendingBoot { frame, due, .. } = reset;
        let is_known = context.bus.node(node).is_some_and(|node| node.assigned_by().is_some());
        let severity =
            if is_known || self.booted.contains(node) { Severity::Warning } else { Severity::Note };
        let limit = self.limit / 1_000_000;
        let has_emcy = reports_its_start_by_emcy(node, context);
        let alarm = context.fail_at(due, Some(node), FrameRange::one(frame)).with_severity(severity);
        let sign = if has_emcy { "ready message or EMCY" } else { "boot-up" };
        alarm.report_finding(|| format!("no {sign} within {limit} ms after the NMT reset {{{frame}}}"));
    }
}
