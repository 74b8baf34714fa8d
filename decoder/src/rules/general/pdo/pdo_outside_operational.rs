//! PDOs of nodes that are not operational.

use crate::event::{DecodedPdo, Event, EventKind, FrameRange, Kind};
use crate::finding::{FindingSubject, Severity};
use crate::frame::CanId;
use crate::profile::{PdoDirection, PdoName};
use crate::rules::rule::{declare_rule, define_tolerance};
use crate::rules::{FrameNeed, Rule, RuleContext, RulePolicy};
use crate::wire::canopen::NmtState;
use crate::wire::{NodeId, NodeMap, NodeSet};

declare_rule! {
    /// # What it checks
    /// A node sends a TPDO more than `command-ms` after a command to leave operational, or between two of its
    /// own reports of another state; a boot-up reports pre-operational. RPDOs to a node that has reported
    /// another state for more than `receive-ms` are a warning, without timestamps after two of its reports. A
    /// node that starts by itself between two heartbeats is exempt.
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
        define_tolerance("command-ms", 100.0, "ms", "from the command to the last TPDO"),
        define_tolerance("receive-ms", 1_000.0, "ms", "after the report of another state, in which RPDOs are permitted"),
    ],
}

/// Number of reports of a state that replace `receive-ms` without timestamps.
const REPORTS: u32 = 2;

/// PDO that the next state report of the node decides on.
#[derive(Clone, Copy)]
struct PendingPdo {
    name: PdoName,
    id: CanId,
    frame: u64,
}

/// State information about a node.
#[derive(Default)]
struct StateWatch {
    /// Latest reported state, time and frame of its first report.
    reported: Option<(NmtState, i64, u64)>,
    /// Number of reports of this state.
    reports: u32,
    /// Command to leave operational, its time and frame; `None` after a report of the state.
    commanded: Option<(NmtState, i64, u64)>,
    sent: Option<PendingPdo>,
    received: Option<PendingPdo>,
}

struct PdoOutsideOperational {
    command: i64,
    receive: i64,
    watches: NodeMap<StateWatch>,
    /// Nodes that must not send PDOs.
    silent: NodeSet,
    operational: NodeSet,
}

fn new(policy: &RulePolicy) -> PdoOutsideOperational {
    PdoOutsideOperational {
        command: policy.tolerance_ns(&DECLARATION, "command-ms"),
        receive: policy.tolerance_ns(&DECLARATION, "receive-ms"),
        watches: NodeMap::default(),
        silent: NodeSet::default(),
        operational: NodeSet::default(),
    }
}

impl PdoOutsideOperational {
    fn on_command(&mut self, event: &Event, node: NodeId, to: NmtState, context: &mut RuleContext<'_>) {
        let Some(watch) = self.watches.entry(node) else { return };
        *watch = StateWatch::default();
        self.silent.remove(node);
        self.operational.remove(node);
        context.ask_again();
        if matches!(to, NmtState::Stopped | NmtState::PreOperational) {
            watch.commanded = Some((to, context.now, event.frames.first));
            self.silent.insert(node);
        }
    }

    fn on_state(&mut self, event: &Event, node: NodeId, state: NmtState, context: &mut RuleContext<'_>) {
        let Some(watch) = self.watches.entry(node) else { return };
        let (sent, received) = (watch.sent.take(), watch.received.take());
        if state == NmtState::Operational {
            *watch = StateWatch::default();
            if !self.operational.contains(node) {
                context.ask_again();
            }
            self.silent.remove(node);
            self.operational.insert(node);
            return context.count_pass();
        }
        context.ask_again();
        self.operational.remove(node);
        self.silent.insert(node);
        let same = watch.reported.filter(|(before, ..)| *before == state);
        let Some((.., frame)) = same else {
            watch.reported = Some((state, context.now, event.frames.first));
            watch.reports = 1;
            return;
        };
        watch.reports = watch.reports.saturating_add(1);
        let reports = watch.reports;
        let context_has_time = context.has_time;
        for (pending, severity) in [(sent, Severity::Error), (received, Severity::Warning)] {
            let Some(PendingPdo { name, id, frame: pdo }) = pending else { continue };
            let frames = FrameRange { first: frame, last: event.frames.last };
            let alarm = context
                .start_finding(event)
                .with_subject(FindingSubject::Id(id))
                .with_severity(severity)
                .with_frames(frames);
            let verb = if severity == Severity::Error { "sent" } else { "received" };
            // Without timestamps, the reports of the node are the clock.
            let clock = if context_has_time { String::new() } else { format!(", {reports} reports of it") };
            alarm.report_finding(|| format!("{name} {verb} in NMT state {} {{{pdo}}}{clock}", state.name()));
        }
        if sent.is_none() {
            context.count_pass();
        }
    }

    /// After its boot-up, a node is pre-operational (CiA 301 §7.3.2.2.1).
    fn on_boot_up(&mut self, event: &Event, node: NodeId, context: &mut RuleContext<'_>) {
        context.ask_again();
        self.operational.remove(node);
        let Some(watch) = self.watches.entry(node) else { return };
        let reported = Some((NmtState::PreOperational, context.now, event.frames.first));
        *watch = StateWatch { reported, reports: 1, ..StateWatch::default() };
        self.silent.insert(node);
    }

    #[cold]
    fn looked_at(&mut self, event: &Event, node: NodeId, pdo: &DecodedPdo, context: &mut RuleContext<'_>) {
        let Some(watch) = self.watches.entry(node) else { return };
        let pending = PendingPdo { name: pdo.name, id: pdo.cob_id, frame: event.frames.last };
        let now = context.now;
        if pdo.name.direction == PdoDirection::Receive {
            let is_long = if context.has_time {
                watch.reported.is_some_and(|(_, since, _)| now.saturating_sub(since) > self.receive)
            } else {
                watch.reports >= REPORTS
            };
            // A conformance test sends such RPDOs on purpose.
            if is_long && !context.is_tested {
                watch.received.get_or_insert(pending);
            }
            return;
        }
        if watch.reported.is_some() {
            watch.sent.get_or_insert(pending);
        } else if let Some((state, at, frame)) = watch.commanded
            && now.saturating_sub(at) > self.command
        {
            let name = pdo.name;
            let [after, limit] = [now.saturating_sub(at), self.command].map(|time| time / 1_000_000);
            let frames = FrameRange { first: frame, last: event.frames.last };
            let alarm =
                context.start_finding(event).with_subject(FindingSubject::Id(pdo.cob_id)).with_frames(frames);
            alarm.report_finding(|| {
                let state = state.name();
                format!("{name} sent {after} ms after the command for state {state} (limit {limit} ms)")
            });
        }
    }
}

impl Rule for PdoOutsideOperational {
    fn frame_need(&self, event: &Event, _context: &RuleContext<'_>) -> FrameNeed {
        match event.node {
            Some(node) if self.silent.contains(node) => FrameNeed::EACH,
            Some(node) if self.operational.contains(node) => FrameNeed::PASSED,
            _ => FrameNeed::NOTHING,
        }
    }

    #[inline]
    fn on_event(&mut self, event: &Event, context: &mut RuleContext<'_>) {
        if let EventKind::Pdo(pdo) = &event.kind {
            let Some(node) = event.node.filter(|_| !pdo.is_request) else { return };
            if self.silent.contains(node) {
                self.looked_at(event, node, pdo, context);
            } else if self.operational.contains(node) {
                context.count_pass();
            }
            return;
        }
        self.on_other(event, context);
    }
}

impl PdoOutsideOperational {
    #[cold]
    fn on_other(&mut self, event: &Event, context: &mut RuleContext<'_>) {
        match (&event.kind, event.node) {
            (EventKind::NmtCommand { target: 0, to: Some(to), .. }, _) => {
                let known: Vec<NodeId> = self.watches.iter().map(|(node, _)| node).collect();
                for node in known {
                    self.on_command(event, node, *to, context);
                }
            }
            (EventKind::NmtCommand { to: Some(to), .. }, Some(node)) => {
                self.on_command(event, node, *to, context);
            }
            (
                EventKind::Heartbeat { state: Some(state), .. }
                | EventKind::GuardReply { state: Some(state), .. },
                Some(node),
            ) => {
                self.on_state(event, node, *state, context);
            }
            (EventKind::BootUp { .. }, Some(node)) => self.on_boot_up(event, node, context),
            _ => {}
        }
    }
}
