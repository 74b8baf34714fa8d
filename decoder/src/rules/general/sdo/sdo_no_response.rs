//! An SDO server does not answer, or takes long.

use crate::event::{Certainty, Event, EventKind, Mode, Outcome, SdoTransfer, StateChange};
use crate::finding::Severity;
use crate::rules::general::facts::about;
use crate::rules::rule::{declare_rule, tolerance};
use crate::rules::{Context, NodeMap, NodeSet, Policy, Rule};
use crate::wire::NodeId;
use crate::wire::canopen::NmtState;

declare_rule! {
    /// # What it checks
    /// An SDO request has no response within the time the recording allows for, or the server takes long to answer
    /// an expedited transfer. A client that gives up, or asks again after more than `warning-ms`, got no answer too.
    /// Storing and restoring parameters (1010, 1011) may take longer. A node that says it is
    /// stopped serves no SDO.
    ///
    /// # Why it matters
    /// The configuration of the node is not what the master believes, and a master that waits is a machine that waits.
    ///
    /// # Source
    /// CiA 301 §7.2.4 (SDO); it names no time, masters commonly give up after a second. §7.3.2.2.4, table 38 (services by
    /// NMT state).
    ///
    /// # What to look at first
    /// Whether the node is on the bus at all (heartbeat, boot-up), in state stopped, or without that SDO server.
    ///
    /// # Mutation
    /// drop the SDO responses of a node
    "sdo-no-response", Error, "an SDO request has no answer in time",
    kinds: ["sdo-transfer", "nmt-state"],
    is_timing: true,
    word: "SDO",
    tolerances: &[
        tolerance("warning-ms", 200.0, "ms", "to the answer, a warning"),
        tolerance("error-ms", 1_000.0, "ms", "to the answer, an error"),
        tolerance("store-ms", 5_000.0, "ms", "to the answer of 1010 and 1011"),
    ],
}

struct SdoNoResponse {
    warning: i64,
    error: i64,
    store: i64,
    /// Nodes that said they are stopped.
    stopped: NodeSet,
    /// Frame at which a node left stopped.
    left: NodeMap<u64>,
}

fn new(policy: &Policy) -> SdoNoResponse {
    let time = |key| policy.nanoseconds(&DECLARATION, key);
    SdoNoResponse {
        warning: time("warning-ms"),
        error: time("error-ms"),
        store: time("store-ms"),
        stopped: NodeSet::default(),
        left: NodeMap::default(),
    }
}

impl SdoNoResponse {
    fn state(&mut self, event: &Event, node: NodeId, change: &StateChange) {
        if change.to == NmtState::Stopped && change.certainty == Certainty::Confirmed {
            self.stopped.insert(node);
        } else if change.to != NmtState::Stopped && self.stopped.remove(node) {
            self.left.insert(node, event.frames.last);
        }
    }

    /// Whether a node was stopped when it was asked, or is since.
    fn serves_none(&self, event: &Event) -> bool {
        event.node.is_some_and(|node| {
            let has_left = self.left.get(node).is_some_and(|left| *left > event.frames.last);
            has_left || self.stopped.contains(node)
        })
    }

    /// The client gave up, after so many nanoseconds without a word of the server.
    fn given_up(
        &self,
        event: &Event,
        transfer: &SdoTransfer,
        (outcome, waited): (Outcome, i64),
        context: &mut Context<'_>,
    ) {
        let is_early = waited <= self.warning;
        let what = match outcome {
            // Who asks again at once did not wait for an answer.
            Outcome::Superseded if is_early => return,
            Outcome::Superseded => "the client began another transfer",
            _ => "the client gave up",
        };
        let severity = if is_early { Severity::Warning } else { Severity::Error };
        let alarm = context.fail(event).about(about(transfer)).severity(severity).measure(f64::MAX);
        let milliseconds = waited / 1_000_000;
        alarm.say(|| format!("no answer{}; {what} after {milliseconds} ms", of(transfer)));
    }

    fn slow(&self, event: &Event, transfer: &SdoTransfer, context: &mut Context<'_>) {
        let is_store = transfer.object.is_some_and(|object| matches!(object.index, 0x1010 | 0x1011));
        let (warning, error) = if is_store { (self.store, self.store) } else { (self.warning, self.error) };
        let is_single = transfer.mode == Some(Mode::Expedited) || transfer.outcome == Outcome::Aborted;
        let Some(duration) = transfer.duration.filter(|_| is_single && !transfer.cut_start) else { return };
        if duration <= warning {
            return context.pass();
        }
        let severity = if duration > error { Severity::Error } else { Severity::Warning };
        let milliseconds = duration / 1_000_000;
        let alarm = context.fail(event).about(about(transfer)).severity(severity);
        #[expect(clippy::cast_precision_loss, reason = "a measure to compare")]
        let alarm = alarm.measure(duration as f64);
        alarm.say(|| format!("answered after {milliseconds} ms"));
    }
}

impl Rule for SdoNoResponse {
    fn event(&mut self, event: &Event, context: &mut Context<'_>) {
        let transfer = match (&event.kind, event.node) {
            (EventKind::SdoTransfer(transfer), _) => transfer,
            (EventKind::NmtState(change), Some(node)) => return self.state(event, node, change),
            _ => return,
        };
        match (transfer.outcome, transfer.waited) {
            (Outcome::Timeout, _) | (_, Some(_)) if self.serves_none(event) => {}
            (Outcome::Timeout, _) => {
                let alarm = context.fail(event).about(about(transfer)).measure(f64::MAX);
                alarm.say(|| format!("no answer{}", of(transfer)));
            }
            (outcome, Some(waited)) => self.given_up(event, transfer, (outcome, waited), context),
            (Outcome::Complete | Outcome::Aborted, None) => self.slow(event, transfer, context),
            _ => {}
        }
    }
}

/// ` to the request of 1018:01`.
fn of(transfer: &SdoTransfer) -> String {
    transfer.object.map_or_else(String::new, |object| format!(" to the request of {object}"))
}
