//! A node does not say that it started.

use crate::event::{Event, EventKind, FrameRange};
use crate::finding::Severity;
use crate::profile::device::Boot;
use crate::rules::rule::{declare_rule, tolerance};
use crate::rules::{Context, NodeMap, NodeSet, Policy, Rule};
use crate::session::Node;
use crate::wire::NodeId;
use crate::wire::canopen::NmtState;

declare_rule! {
    /// # What it checks
    /// After an NMT reset a node that was heard before sends its boot-up message, or what its manual promises
    /// instead, in time, unless one with another node-ID starts in its place. A note where nothing tells that it has one: no boot-up was seen, no device is known.
    ///
    /// # Why it matters
    /// The master waits for it before it configures the node; a node that does not come back is out of service.
    ///
    /// # Source
    /// CiA 301 §7.3.2.2.1 (boot-up after initialisation), §7.2.8.3.3
    ///
    /// # What to look at first
    /// Whether the node is heard again at all; how long it takes to start.
    ///
    /// # Mutation
    /// drop the boot-up message behind a reset
    "boot-up-missing", Warning, "a node does not say that it started",
    kinds: ["nmt-command", "boot-up", "emcy", "node-id-change"],
    cases: &["9.1", "10.1"],
    shows: &["10.1"],
    word: "BOOT",
    tolerances: &[tolerance("error-ms", 2_000.0, "ms", "from the reset to the boot-up message")],
}

/// A node that was silent for longer before the reset may not be there.
const HEARD: i64 = 10_000_000_000;

struct BootUpMissing {
    limit: i64,
    /// Frame of the reset, and when its time is over.
    waiting: NodeMap<(u64, i64)>,
    booted: NodeSet,
}

fn new(policy: &Policy) -> BootUpMissing {
    BootUpMissing {
        limit: policy.nanoseconds(&DECLARATION, "error-ms"),
        waiting: NodeMap::default(),
        booted: NodeSet::default(),
    }
}

impl BootUpMissing {
    fn reset(&mut self, event: &Event, node: NodeId, context: &mut Context<'_>) {
        let Some(known) = context.bus.node(node) else { return };
        let stamp = known.last_seen().1;
        let age =
            stamp.map_or(i64::MAX, |stamp| context.bus.now().saturating_sub(context.bus.monotonic(stamp)));
        let has_sign = known.device().nmt.boot != Boot::BootUpAfterPowerOn;
        if age > HEARD || !has_sign || !context.has_time {
            return;
        }
        let due = context.now.saturating_add(self.limit);
        if let Some(waiting) = self.waiting.entry(node) {
            *waiting = (event.frames.last, due);
            context.wake_at(due, node.place() as u64);
        }
    }

    fn booted(&mut self, node: NodeId, context: &mut Context<'_>) {
        if self.booted.insert(node) && self.waiting.get(node).is_none() {
            // One that was reset may have another node-ID now.
            self.waiting = NodeMap::default();
        }
        if self.waiting.remove(node).is_some() {
            context.pass();
        }
    }
}

impl Rule for BootUpMissing {
    fn event(&mut self, event: &Event, context: &mut Context<'_>) {
        match (&event.kind, event.node) {
            (EventKind::NmtCommand { to: Some(NmtState::Initialising), target: 0, .. }, _) => {
                let known: Vec<NodeId> = context.bus.nodes().map(Node::id).collect();
                for node in known.into_iter().filter(|node| node.canopen().is_some()) {
                    self.reset(event, node, context);
                }
            }
            (EventKind::NmtCommand { to: Some(NmtState::Initialising), .. }, Some(node)) => {
                self.reset(event, node, context);
            }
            (EventKind::BootUp { .. }, Some(node)) => self.booted(node, context),
            (EventKind::NodeIdChange { from: Some(from), .. }, _) => {
                self.waiting.remove(NodeId::Canopen(*from));
            }
            (EventKind::Emcy(emergency), Some(node)) if emergency.boot.is_some() => {
                self.booted(node, context);
            }
            _ => {}
        }
    }

    fn wake(&mut self, token: u64, context: &mut Context<'_>) {
        let Some(node) = NodeId::all().find(|node| node.place() as u64 == token) else { return };
        let Some((frame, due)) = self.waiting.get(node).copied().filter(|(_, due)| *due <= context.now)
        else {
            return;
        };
        self.waiting.remove(node);
        let is_known = context.bus.node(node).is_some_and(|node| node.assigned().is_some());
        let severity =
            if is_known || self.booted.contains(node) { Severity::Warning } else { Severity::Note };
        let limit = self.limit / 1_000_000;
        let alarm = context.fail_at(due, Some(node), FrameRange::one(frame)).severity(severity);
        alarm.say(|| format!("no boot-up within {limit} ms of the reset {{{frame}}}"));
    }
}
