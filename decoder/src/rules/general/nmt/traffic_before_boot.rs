//! Traffic between an NMT reset and the boot-up.

use crate::event::{Event, EventKind, FrameRange, Kind};
use crate::observation::is_controller;
use crate::profile::device::BootSign;
use crate::rules::rule::{declare_rule, define_tolerance};
use crate::rules::{PdoSubset, Rule, RuleContext, RulePolicy};
use crate::session::Node;
use crate::wire::canopen::NmtState;
use crate::wire::{NodeId, NodeMap, NodeSet};

declare_rule! {
    /// # What it checks
    /// Between an NMT reset and its boot-up message, a node must not send anything except queued frames. A reset of all
    /// nodes does not concern the controller, a node that sends only heartbeats.
    ///
    /// # Why it matters
    /// The node did not execute the reset, or its application runs before the node is configured.
    ///
    /// # Source
    /// CiA 301 §7.3.2.2.1 (initialisation ends with the boot-up message)
    ///
    /// # What to look at first
    /// Check whether the node sends a boot-up message at all. Compare the delay after the reset with its
    /// start-up time.
    ///
    /// # Mutation
    /// insert a heartbeat between a reset and the boot-up
    "traffic-before-boot", Note, "traffic before the boot-up",
    kinds: [Kind::NmtCommand, Kind::BootUp, Kind::Heartbeat, Kind::GuardReply, Kind::Emcy, Kind::Pdo],
    pdos: PdoSubset::Transmitted,
    needs: "an NMT reset of a node that is heard afterwards",
    word: "BOOT",
    tolerances: &[define_tolerance("queued-ms", 100.0, "ms", "after the reset, in which queued frames are permitted")],
}

struct TrafficBeforeBoot {
    queued: i64,
    /// Time and frame of the latest reset.
    resets: NodeMap<(i64, u64)>,
    starting: NodeSet,
    /// Nodes whose latest reset was one of all nodes.
    of_all: NodeSet,
}

fn new(policy: &RulePolicy) -> TrafficBeforeBoot {
    TrafficBeforeBoot {
        queued: policy.tolerance_ns(&DECLARATION, "queued-ms"),
        resets: NodeMap::default(),
        starting: NodeSet::default(),
        of_all: NodeSet::default(),
    }
}

impl TrafficBeforeBoot {
    fn on_reset(&mut self, event: &Event, node: NodeId, context: &RuleContext<'_>) {
        let promises = |boot| matches!(boot, BootSign::BootUp | BootSign::ReadyTelegram);
        let has_sign = context.bus.node(node).is_some_and(|node| promises(node.device().nmt.boot));
        if let Some(reset) = self.resets.entry(node).filter(|_| has_sign) {
            *reset = (context.now, event.frames.last);
            self.starting.insert(node);
            if event.node.is_some() {
                self.of_all.remove(node);
            } else {
                self.of_all.insert(node);
            }
        }
    }

    #[cold]
    fn on_sent(&mut self, event: &Event, node: NodeId, what: &str, context: &mut RuleContext<'_>) {
        let Some((at, frame)) = self.resets.get(node).copied() else { return };
        let after = context.now.saturating_sub(at);
        if after <= self.queued {
            return;
        }
        self.starting.remove(node);
        if self.of_all.contains(node) && is_controller(context.bus, node) {
            return;
        }
        let frames = FrameRange { first: frame, last: event.frames.last };
        let (after, limit) = (after / 1_000_000, self.queued / 1_000_000);
        context.start_finding(event).with_frames(frames).report_finding(|| {
            format!("{what} {after} ms after the NMT reset without a boot-up (limit {limit} ms)")
        });
    }

    fn on_boot(&mut self, node: NodeId, context: &mut RuleContext<'_>) {
        if self.starting.remove(node) {
            context.count_pass();
        }
    }
}

impl Rule for TrafficBeforeBoot {
    fn wants_pdos(&self) -> bool {
        !self.starting.is_empty()
    }

    #[inline]
    fn on_event(&mut self, event: &Event, context: &mut RuleContext<'_>) {
        let Some(node) = event.node else {
            if let EventKind::NmtCommand { to: Some(NmtState::Initialising), target: 0, .. } = event.kind {
                let known: Vec<NodeId> = context.bus.nodes().map(Node::id).collect();
                for node in known {
                    self.on_reset(event, node, context);
                }
            }
            return;
        };
        match &event.kind {
            EventKind::Pdo(_) | EventKind::Heartbeat { .. } if !self.starting.contains(node) => {}
            EventKind::Pdo(_) => self.on_sent(event, node, "TPDO", context),
            EventKind::NmtCommand { to: Some(NmtState::Initialising), .. } => {
                self.on_reset(event, node, context);
            }
            EventKind::BootUp { .. } => self.on_boot(node, context),
            EventKind::Emcy(emergency) if emergency.boot.is_some() => self.on_boot(node, context),
            EventKind::Emcy(_) if self.starting.contains(node) => self.on_sent(event, node, "EMCY", context),
            EventKind::Heartbeat { .. } => self.on_sent(event, node, "heartbeat", context),
            EventKind::GuardReply { .. } if self.starting.contains(node) => {
                self.on_sent(event, node, "guarding response", context);
            }
            _ => {}
        }
    }
}
