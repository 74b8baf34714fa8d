//! Changes of a node-ID that had no effect.

use crate::event::{Event, EventKind, FrameRange, Kind};
use crate::rules::general::nmt::unexpected_boot::boot_cause;
use crate::rules::rule::{declare_rule, define_tolerance};
use crate::rules::{Rule, RuleContext, RulePolicy};
use crate::session::PendingNodeId;
use crate::wire::NodeId;

declare_rule! {
    /// # What it checks
    /// A device accepts a new node-ID by LSS, UDS or SDO, and boots with the old one: no boot sign of the new
    /// node-ID follows within `wait-ms`. Restarts that do not activate the change are exempt: a power-on
    /// without storage, and changes whose previous node-ID is unknown.
    ///
    /// # Why it matters
    /// The master expects the device under the new node-ID. Another device that already has the old node-ID
    /// collides with it.
    ///
    /// # Source
    /// CiA 305 §3.9.3 (configure node-ID): effective at the next NMT reset communication; manual of the device
    ///
    /// # What to look at first
    /// Check whether the new node-ID was stored, and whether a switch of the device overrides it.
    ///
    /// # Mutation
    /// the boot-up after a change by LSS comes from the old node-ID
    "node-id-unchanged", Warning, "node-ID change without effect",
    kinds: [Kind::BootUp, Kind::Emcy, Kind::NodeIdChange],
    needs: "an accepted change of the node-ID, then a restart",
    is_timing: true,
    word: "IDENT",
    tolerances: &[define_tolerance(
        "wait-ms", 2_000.0, "ms", "from the boot sign of the old node-ID to that of the new one",
    )],
}

/// Maximum number of restarts that are judged at the same time.
const OPEN_LIMIT: usize = 128;

/// A boot sign with the old node-ID.
struct OldBoot {
    node: NodeId,
    pending: PendingNodeId,
    frame: u64,
}

struct NodeIdUnchanged {
    wait: i64,
    open: Vec<OldBoot>,
}

fn new(policy: &RulePolicy) -> NodeIdUnchanged {
    NodeIdUnchanged { wait: policy.tolerance_ns(&DECLARATION, "wait-ms"), open: Vec::new() }
}

impl Rule for NodeIdUnchanged {
    fn on_event(&mut self, event: &Event, context: &mut RuleContext<'_>) {
        if let EventKind::NodeIdChange { to, by, .. } = &event.kind {
            self.open.retain(|open| open.pending.to != *to);
            if by.service().is_some() {
                context.count_pass();
            }
            return;
        }
        let (Some(node), Some(_)) = (event.node, boot_cause(event)) else { return };
        let Some(pending) = context.bus.pending_node_id(node) else { return };
        if self.open.len() < OPEN_LIMIT && !self.open.iter().any(|open| open.node == node) {
            self.open.push(OldBoot { node, pending, frame: event.frames.last });
            context.wake_at(context.now.saturating_add(self.wait), node.table_place() as u64);
        }
    }

    fn on_wake(&mut self, token: u64, context: &mut RuleContext<'_>) {
        let Some(place) = self.open.iter().position(|open| open.node.table_place() as u64 == token) else {
            return;
        };
        let OldBoot { node, pending, frame } = self.open.swap_remove(place);
        let alarm = context.fail_at(context.now, Some(node), FrameRange::one(frame));
        alarm.report_finding(|| {
            let (to, service) = (pending.to, pending.by.service().unwrap_or_default());
            format!("boots as node-ID {}, although {to} was accepted by {service}", node.number())
        });
    }
}
