//! NMT commands that a node does not execute.

use std::sync::Arc;

use crate::event::{Event, EventKind, FrameRange, Kind, StateCause};
use crate::finding::FindingSubject;
use crate::observation::is_controller;
use crate::rules::rule::{declare_rule, define_tolerance};
use crate::rules::{Rule, RuleContext, RulePolicy};
use crate::session::Node;
use crate::wire::canopen::NmtState;
use crate::wire::canopen::nmt::NmtService;
use crate::wire::{NodeId, NodeMap};

declare_rule! {
    /// # What it checks
    /// After an NMT command, two heartbeats or guarding responses must not report another state than the
    /// commanded one once `error-ms` have passed. States that the device does not support, and changes after
    /// the state was reached, are exempt. So is the controller, a node that sends only heartbeats, from commands to all
    /// nodes.
    ///
    /// # Why it matters
    /// NMT commands are not confirmed. The master assumes that the node runs or is stopped.
    ///
    /// # Source
    /// CiA 301 §7.2.8.2.1, §7.3.2.2 (state machine)
    ///
    /// # What to look at first
    /// Check the EMCY messages of the node. Check whether the command was meant for another node-ID.
    ///
    /// # Mutation
    /// drop nothing, insert a stop command while heartbeats still report operational
    "nmt-command-ignored", Warning, "NMT command without effect on the node",
    kinds: [Kind::NmtCommand, Kind::NmtState, Kind::Heartbeat, Kind::GuardReply, Kind::BootUp],
    needs: "an NMT command, then heartbeats or guarding responses",
    cases: &["9.2", "9.3", "9.4", "10.1", "10.2", "10.3", "10.4"],
    word: "NMT",
    tolerances: &[define_tolerance("error-ms", 1_000.0, "ms", "from the command to the report of the state")],
}

struct PendingCommand {
    service: NmtService,
    to: NmtState,
    at: i64,
    frame: u64,
    /// Number of reports of another state.
    other: u32,
    is_for_all: bool,
}

struct NmtCommandIgnored {
    limit: i64,
    commands: NodeMap<Option<PendingCommand>>,
}

fn new(policy: &RulePolicy) -> NmtCommandIgnored {
    NmtCommandIgnored { limit: policy.tolerance_ns(&DECLARATION, "error-ms"), commands: NodeMap::default() }
}

impl NmtCommandIgnored {
    fn on_command(
        &mut self,
        event: &Event,
        node: NodeId,
        service: NmtService,
        to: NmtState,
        context: &RuleContext<'_>,
    ) {
        let Some(known) = context.bus.node(node) else { return };
        let obeyed = &known.device().nmt.commands;
        let is_obeyed = obeyed.is_empty() || obeyed.iter().any(|name| name == service.name());
        let Some(command) = self.commands.entry(node) else { return };
        // A reset is confirmed by the boot-up.
        *command = (is_obeyed && to != NmtState::Initialising).then_some(PendingCommand {
            service,
            to,
            at: context.now,
            frame: event.frames.last,
            other: 0,
            is_for_all: matches!(event.kind, EventKind::NmtCommand { target: 0, .. }),
        });
    }

    fn on_state(&mut self, event: &Event, node: NodeId, state: NmtState, context: &mut RuleContext<'_>) {
        let Some(known) = self.commands.get_mut(node) else { return };
        let Some(command) = known else { return };
        if state == command.to {
            *known = None;
            return context.count_pass();
        }
        command.other += 1;
        let after = context.now.saturating_sub(command.at);
        if command.other < 2 || after < self.limit {
            return;
        }
        let (service, frame, is_for_all) = (command.service.name(), command.frame, command.is_for_all);
        *known = None;
        if is_for_all && is_controller(context.bus, node) {
            return;
        }
        let frames = FrameRange { first: frame, last: event.frames.last };
        let (after, limit) = (after / 1_000_000, self.limit / 1_000_000);
        let alarm = context
            .start_finding(event)
            .with_subject(FindingSubject::Name(Arc::from(service)))
            .with_frames(frames);
        alarm.report_finding(|| {
            format!(
                "NMT state still {} {after} ms after the command {{{frame}}} (limit {limit} ms)",
                state.name()
            )
        });
    }
}

impl Rule for NmtCommandIgnored {
    fn on_event(&mut self, event: &Event, context: &mut RuleContext<'_>) {
        match (&event.kind, event.node) {
            (EventKind::NmtCommand { service, to: Some(to), target: 0, .. }, _) => {
                let known: Vec<NodeId> = context.bus.nodes().map(Node::id).collect();
                for node in known {
                    self.on_command(event, node, *service, *to, context);
                }
            }
            (EventKind::NmtCommand { service, to: Some(to), .. }, Some(node)) => {
                self.on_command(event, node, *service, *to, context);
            }
            (
                EventKind::Heartbeat { state: Some(state), .. }
                | EventKind::GuardReply { state: Some(state), .. },
                Some(node),
            ) => {
                self.on_state(event, node, *state, context);
            }
            // A PDO confirms that the command was executed.
            (EventKind::NmtState(change), Some(node)) if change.cause == StateCause::Pdo => {
                if let Some(known) = self.commands.get_mut(node) {
                    known.take_if(|command| command.to == change.to);
                }
            }
            (EventKind::BootUp { .. }, Some(node)) => {
                self.commands.remove(node);
            }
            _ => {}
        }
    }
}
