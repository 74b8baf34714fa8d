//! PDOs while a node is not operational.

use crate::event::{Event, EventKind, FrameRange, Pdo};
use crate::finding::{About, Severity};
use crate::frame::CanId;
use crate::profile::{PdoDirection, PdoName};
use crate::rules::rule::{declare_rule, tolerance};
use crate::rules::{Context, NodeMap, NodeSet, Policy, Rule};
use crate::wire::NodeId;
use crate::wire::canopen::NmtState;

declare_rule! {
    /// # What it checks
    /// A node sends a TPDO although it was told to leave operational a while ago, or although it says itself,
    /// before and after, that it is not operational. RPDOs to a node that says so for more than a second are a
    /// warning. A node that starts by itself between two of its heartbeats is none.
    ///
    /// # Why it matters
    /// Values of a node that is not operational are not to be relied on; one that does not obey the command is
    /// worse. RPDOs to it have no effect: the machine does not do what the master believes.
    ///
    /// # Source
    /// CiA 301 §7.3.2.2.4, table 38 (services by NMT state)
    ///
    /// # What to look at first
    /// What brought the state (command, life guarding, EMCY), and whether a second device sends on the identifier.
    ///
    /// # Mutation
    /// insert a command that stops the node, while its PDOs go on
    "pdo-outside-operational", Error, "PDOs while a node is not operational",
    kinds: ["nmt-command", "heartbeat", "guard-reply", "boot-up", "pdo"],
    cases: &[
        "3.4", "3.5", "3.6", "3.7", "3.9", "3.10", "3.11", "3.12", "3.13", "3.14", "3.15", "3.16", "3.17", "3.18",
        "3.19", "3.20", "9.2", "9.4", "10.2",
    ],
    word: "PDO",
    tolerances: &[
        tolerance("command-ms", 100.0, "ms", "from the command until the last TPDO"),
        tolerance("receive-ms", 1_000.0, "ms", "in another state, in which RPDOs may still come"),
    ],
}

/// A PDO that waits for what the node says next.
#[derive(Clone, Copy)]
struct Pending {
    name: PdoName,
    id: CanId,
    frame: u64,
}

/// What is known of a node.
#[derive(Default)]
struct Watch {
    /// The state it told last, since when, and its first frame that did.
    told: Option<(NmtState, i64, u64)>,
    /// A command to leave operational, when, and its frame; nothing told otherwise since.
    commanded: Option<(NmtState, i64, u64)>,
    sent: Option<Pending>,
    received: Option<Pending>,
}

struct PdoOutsideOperational {
    command: i64,
    receive: i64,
    watches: NodeMap<Watch>,
    /// Nodes whose PDOs need a look.
    silent: NodeSet,
    operational: NodeSet,
}

fn new(policy: &Policy) -> PdoOutsideOperational {
    PdoOutsideOperational {
        command: policy.nanoseconds(&DECLARATION, "command-ms"),
        receive: policy.nanoseconds(&DECLARATION, "receive-ms"),
        watches: NodeMap::default(),
        silent: NodeSet::default(),
        operational: NodeSet::default(),
    }
}

impl PdoOutsideOperational {
    fn commanded(&mut self, event: &Event, node: NodeId, to: NmtState, now: i64) {
        let Some(watch) = self.watches.entry(node) else { return };
        *watch = Watch::default();
        self.silent.remove(node);
        self.operational.remove(node);
        if matches!(to, NmtState::Stopped | NmtState::PreOperational) {
            watch.commanded = Some((to, now, event.frames.first));
            self.silent.insert(node);
        }
    }

    fn told(&mut self, event: &Event, node: NodeId, state: NmtState, context: &mut Context<'_>) {
        let Some(watch) = self.watches.entry(node) else { return };
        let (sent, received) = (watch.sent.take(), watch.received.take());
        if state == NmtState::Operational {
            *watch = Watch::default();
            self.silent.remove(node);
            self.operational.insert(node);
            return context.pass();
        }
        self.operational.remove(node);
        self.silent.insert(node);
        let same = watch.told.filter(|(before, ..)| *before == state);
        let Some((_, since, frame)) = same else {
            watch.told = Some((state, context.now, event.frames.first));
            return;
        };
        for (pending, severity) in [(sent, Severity::Error), (received, Severity::Warning)] {
            let Some(Pending { name, id, frame: pdo }) = pending else { continue };
            let frames = FrameRange { first: frame, last: event.frames.last };
            let seconds = context.now.saturating_sub(since) / 1_000_000_000;
            let alarm = context.fail(event).about(About::Id(id)).severity(severity).frames(frames);
            let verb = if severity == Severity::Error { "sent" } else { "sent to it" };
            alarm.say(|| {
                format!("{name} {verb} {{{pdo}}} while the node says it is {} ({seconds} s)", state.name())
            });
        }
        if sent.is_none() {
            context.pass();
        }
    }

    #[cold]
    fn looked_at(&mut self, event: &Event, node: NodeId, pdo: &Pdo, context: &mut Context<'_>) {
        let Some(watch) = self.watches.entry(node) else { return };
        let pending = Pending { name: pdo.name, id: pdo.cob_id, frame: event.frames.last };
        let now = context.now;
        if pdo.name.direction == PdoDirection::Receive {
            let is_long = watch.told.is_some_and(|(_, since, _)| now.saturating_sub(since) > self.receive);
            // Only where nothing is being done about it.
            if is_long && !context.is_tested {
                watch.received.get_or_insert(pending);
            }
            return;
        }
        if watch.told.is_some() {
            watch.sent.get_or_insert(pending);
        } else if let Some((state, at, frame)) = watch.commanded
            && now.saturating_sub(at) > self.command
        {
            let (name, after) = (pdo.name, now.saturating_sub(at) / 1_000_000);
            let frames = FrameRange { first: frame, last: event.frames.last };
            let alarm = context.fail(event).about(About::Id(pdo.cob_id)).frames(frames);
            alarm.say(|| format!("{name} sent {after} ms after the command to be {}", state.name()));
        }
    }
}

impl Rule for PdoOutsideOperational {
    #[inline]
    fn event(&mut self, event: &Event, context: &mut Context<'_>) {
        if let EventKind::Pdo(pdo) = &event.kind {
            let Some(node) = event.node.filter(|_| !pdo.is_request) else { return };
            if self.silent.contains(node) {
                self.looked_at(event, node, pdo, context);
            } else if self.operational.contains(node) {
                context.pass();
            }
            return;
        }
        self.other(event, context);
    }
}

impl PdoOutsideOperational {
    #[cold]
    fn other(&mut self, event: &Event, context: &mut Context<'_>) {
        match (&event.kind, event.node) {
            (EventKind::NmtCommand { target: 0, to: Some(to), .. }, _) => {
                let known: Vec<NodeId> = self.watches.iter().map(|(node, _)| node).collect();
                for node in known {
                    self.commanded(event, node, *to, context.now);
                }
            }
            (EventKind::NmtCommand { to: Some(to), .. }, Some(node)) => {
                self.commanded(event, node, *to, context.now);
            }
            (
                EventKind::Heartbeat { state: Some(state), .. }
                | EventKind::GuardReply { state: Some(state), .. },
                Some(node),
            ) => {
                self.told(event, node, *state, context);
            }
            (EventKind::BootUp { .. }, Some(node)) => {
                self.watches.remove(node);
                self.silent.remove(node);
                self.operational.remove(node);
            }
            _ => {}
        }
    }
}
