//! PDOs of nodes that are not operational.

use crate::event::{Event, EventKind, FrameRange, Kind, Pdo};
use crate::finding::{About, Severity};
use crate::frame::CanId;
use crate::profile::{PdoDirection, PdoName};
use crate::rules::rule::{declare_rule, tolerance};
use crate::rules::{Context, Need, Policy, Rule};
use crate::wire::canopen::NmtState;
use crate::wire::{NodeId, NodeMap, NodeSet};

declare_rule! {
    /// # What it checks
    /// A node sends a TPDO more than `command-ms` after a command to leave operational, or between two of its
    /// own reports of another state. RPDOs to a node that has reported another state for more than
    /// `receive-ms` are a warning. A node that starts by itself between two heartbeats is exempt.
    ///
    /// # Why it matters
    /// Values of such a node are unreliable, and the node may ignore NMT commands. RPDOs
    /// to such a node have no effect.
    ///
    /// # Source
    /// CiA 301 §7.3.2.2.4, table 38 (services by NMT state)
    ///
    /// # What to look at first
    /// Find the cause of the state change (command, EMCY, guarding). Check whether a second device uses the
    /// identifier.
    ///
    /// # Mutation
    /// insert a command that stops the node while it still sends PDOs
    "pdo-outside-operational", Error, "PDO outside NMT state operational",
    kinds: [Kind::NmtCommand, Kind::Heartbeat, Kind::GuardReply, Kind::BootUp, Kind::Pdo],
    needs: "a PDO of a node with a known NMT state",
    cases: &[
        "3.4", "3.5", "3.6", "3.7", "3.9", "3.10", "3.11", "3.12", "3.13", "3.14", "3.15", "3.16", "3.17", "3.18",
        "3.19", "3.20", "9.2", "9.4", "10.2",
    ],
    word: "PDO",
    tolerances: &[
        tolerance("command-ms", 100.0, "ms", "from the command to the last TPDO"),
        tolerance("receive-ms", 1_000.0, "ms", "after the report of another state, in which RPDOs are permitted"),
    ],
}

/// PDO that the next state report of the node decides on.
#[derive(Clone, Copy)]
struct Pending {
    name: PdoName,
    id: CanId,
    frame: u64,
}

/// State information about a node.
#[derive(Default)]
struct Watch {
    /// Latest reported state, time and frame of its first report.
    told: Option<(NmtState, i64, u64)>,
    /// Command to leave operational, its time and frame; `None` after a report of the state.
    commanded: Option<(NmtState, i64, u64)>,
    sent: Option<Pending>,
    received: Option<Pending>,
}

struct PdoOutsideOperational {
    command: i64,
    receive: i64,
    watches: NodeMap<Watch>,
    /// Nodes that must not send PDOs.
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
    fn commanded(&mut self, event: &Event, node: NodeId, to: NmtState, context: &mut Context<'_>) {
        let Some(watch) = self.watches.entry(node) else { return };
        *watch = Watch::default();
        self.silent.remove(node);
        self.operational.remove(node);
        context.ask_again();
        if matches!(to, NmtState::Stopped | NmtState::PreOperational) {
            watch.commanded = Some((to, context.now, event.frames.first));
            self.silent.insert(node);
        }
    }

    fn on_state(&mut self, event: &Event, node: NodeId, state: NmtState, context: &mut Context<'_>) {
        let Some(watch) = self.watches.entry(node) else { return };
        let (sent, received) = (watch.sent.take(), watch.received.take());
        if state == NmtState::Operational {
            *watch = Watch::default();
            if !self.operational.contains(node) {
                context.ask_again();
            }
            self.silent.remove(node);
            self.operational.insert(node);
            return context.pass();
        }
        context.ask_again();
        self.operational.remove(node);
        self.silent.insert(node);
        let same = watch.told.filter(|(before, ..)| *before == state);
        let Some((.., frame)) = same else {
            watch.told = Some((state, context.now, event.frames.first));
            return;
        };
        for (pending, severity) in [(sent, Severity::Error), (received, Severity::Warning)] {
            let Some(Pending { name, id, frame: pdo }) = pending else { continue };
            let frames = FrameRange { first: frame, last: event.frames.last };
            let alarm = context.fail(event).about(About::Id(id)).severity(severity).frames(frames);
            let verb = if severity == Severity::Error { "sent" } else { "received" };
            alarm.report(|| format!("{name} {verb} in NMT state {} {{{pdo}}}", state.name()));
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
            // A conformance test sends such RPDOs on purpose.
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
            let name = pdo.name;
            let [after, limit] = [now.saturating_sub(at), self.command].map(|time| time / 1_000_000);
            let frames = FrameRange { first: frame, last: event.frames.last };
            let alarm = context.fail(event).about(About::Id(pdo.cob_id)).frames(frames);
            alarm.report(|| {
                let state = state.name();
                format!("{name} sent {after} ms after the command for state {state} (limit {limit} ms)")
            });
        }
    }
}

impl Rule for PdoOutsideOperational {
    fn need(&self, event: &Event, _context: &Context<'_>) -> Need {
        match event.node {
            Some(node) if self.silent.contains(node) => Need::EACH,
            Some(node) if self.operational.contains(node) => Need::PASSED,
            _ => Need::NOTHING,
        }
    }

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
                    self.commanded(event, node, *to, context);
                }
            }
            (EventKind::NmtCommand { to: Some(to), .. }, Some(node)) => {
                self.commanded(event, node, *to, context);
            }
            (
                EventKind::Heartbeat { state: Some(state), .. }
                | EventKind::GuardReply { state: Some(state), .. },
                Some(node),
            ) => {
                self.on_state(event, node, *state, context);
            }
            (EventKind::BootUp { .. }, Some(node)) => {
                self.watches.remove(node);
                self.silent.remove(node);
                self.operational.remove(node);
                context.ask_again();
            }
            _ => {}
        }
    }
}
