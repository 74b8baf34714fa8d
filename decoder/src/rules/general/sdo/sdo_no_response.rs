//! Missing and late SDO responses.

use crate::event::{Event, EventKind, Kind, SdoMode, SdoOutcome, SdoTransfer, StateCertainty, StateChange};
use crate::finding::{MergedFindings, Severity};
use crate::rules::general::facts::transfer_subject;
use crate::rules::rule::{declare_rule, define_tolerance};
use crate::rules::{Rule, RuleContext, RulePolicy};
use crate::wire::canopen::NmtState;
use crate::wire::{NodeId, NodeMap, NodeSet};
use crate::words::count_noun;

declare_rule! {
    /// # What it checks
    /// An SDO request has no response, or the response to an expedited transfer is later than `warning-ms`. A
    /// client that aborts, or repeats its request after more than `warning-ms`, also had no response; without
    /// timestamps, a client repeating its request after frames of others. Store and restore commands (1010, 1011)
    /// have their own limit, and stopped nodes are exempt.
    ///
    /// # Why it matters
    /// The configuration of the node may be incomplete. A master that waits for the response delays the
    /// machine.
    ///
    /// # Source
    /// CiA 301 §7.2.4 (SDO), which states no time-out; 1 s is common in masters. §7.3.2.2.4, table 38
    /// (services by NMT state)
    ///
    /// # What to look at first
    /// Check whether the node is on the bus (heartbeat, boot-up). Check whether it is stopped, or lacks this
    /// SDO server.
    ///
    /// # Mutation
    /// drop the SDO responses of a node
    "sdo-no-response", Error, "no SDO response in time",
    kinds: [Kind::SdoTransfer, Kind::NmtState],
    needs: "an SDO transfer",
    merge: MergedFindings::Node,
    is_timing: true,
    word: "SDO",
    tolerances: &[
        define_tolerance("warning-ms", 200.0, "ms", "to the response, a warning"),
        define_tolerance("error-ms", 1_000.0, "ms", "to the response, an error"),
        define_tolerance("store-ms", 5_000.0, "ms", "to the response for 1010 and 1011"),
    ],
}

struct SdoNoResponse {
    warning: i64,
    error: i64,
    store: i64,
    /// Nodes that reported stopped.
    stopped: NodeSet,
    /// Frame at which a node left state stopped.
    left: NodeMap<u64>,
}

fn new(policy: &RulePolicy) -> SdoNoResponse {
    let time = |key| policy.tolerance_ns(&DECLARATION, key);
    SdoNoResponse {
        warning: time("warning-ms"),
        error: time("error-ms"),
        store: time("store-ms"),
        stopped: NodeSet::default(),
        left: NodeMap::default(),
    }
}

/// Whether a transfer is a store or restore command.
fn is_store(transfer: &SdoTransfer) -> bool {
    transfer.object.is_some_and(|object| matches!(object.index, 0x1010 | 0x1011))
}

impl SdoNoResponse {
    fn on_state(&mut self, event: &Event, node: NodeId, change: &StateChange) {
        if change.to == NmtState::Stopped && change.certainty == StateCertainty::Confirmed {
            self.stopped.insert(node);
        } else if change.to != NmtState::Stopped && self.stopped.remove(node) {
            self.left.insert(node, event.frames.last);
        }
    }

    /// Whether the node was stopped at the request or later.
    fn serves_none(&self, event: &Event) -> bool {
        event.node.is_some_and(|node| {
            let has_left = self.left.get(node).is_some_and(|left| *left > event.frames.last);
            has_left || self.stopped.contains(node)
        })
    }

    /// Reports a transfer that the client ended; the server had not responded for `waited` nanoseconds.
    fn given_up(
        &self,
        event: &Event,
        transfer: &SdoTransfer,
        (outcome, waited): (SdoOutcome, i64),
        context: &mut RuleContext<'_>,
    ) {
        let is_early = waited <= self.warning;
        if !context.has_time {
            return Self::on_repeated(event, transfer, outcome, context);
        }
        let what = match outcome {
            // A client that repeats the request at once did not wait for a response.
            SdoOutcome::Superseded if is_early => return,
            SdoOutcome::Superseded => "client started another transfer",
            _ => "client aborted",
        };
        let severity = if is_early { Severity::Warning } else { Severity::Error };
        let alarm = context
            .start_finding(event)
            .with_subject(transfer_subject(transfer))
            .with_severity(severity)
            .with_measure(f64::MAX);
        let requested = event.time.map(|time| time.plus(waited.saturating_neg()));
        let alarm = alarm.reported_by_device().requested_at_timestamp(requested);
        let milliseconds = waited / 1_000_000;
        alarm.report_finding(|| format!("no SDO response ({what} after {milliseconds} ms)"));
    }

    /// Without timestamps, frames of others between two requests are the clock.
    fn on_repeated(
        event: &Event,
        transfer: &SdoTransfer,
        outcome: SdoOutcome,
        context: &mut RuleContext<'_>,
    ) {
        let own = u64::from(transfer.retries).saturating_add(1);
        let others =
            event.frames.last.saturating_add(1).saturating_sub(event.frames.first).saturating_sub(own);
        if outcome != SdoOutcome::Superseded || transfer.retries == 0 || others == 0 {
            return;
        }
        let alarm = context.start_finding(event).with_subject(transfer_subject(transfer)).shown_by_order();
        alarm.report_finding(|| {
            let others = count_noun(others, "other frame");
            format!("no SDO response (same request repeated after {others}; no timestamps)")
        });
    }

    fn on_slow_response(&self, event: &Event, transfer: &SdoTransfer, context: &mut RuleContext<'_>) {
        let (warning, error) =
            if is_store(transfer) { (self.store, self.store) } else { (self.warning, self.error) };
        let is_refused = transfer.abort.is_some_and(|abort| !abort.by_client)
            && transfer.frame_count <= u64::from(transfer.retries).saturating_add(2);
        let is_single = is_refused || transfer.mode == Some(SdoMode::Expedited) && transfer.abort.is_none();
        let Some(duration) = transfer.duration.filter(|_| is_single && !transfer.cut_start) else { return };
        if duration <= warning {
            return context.count_pass();
        }
        let (severity, limit) =
            if duration > error { (Severity::Error, error) } else { (Severity::Warning, warning) };
        let [milliseconds, limit] = [duration, limit].map(|time| time / 1_000_000);
        let alarm = context
            .start_finding(event)
            .with_subject(transfer_subject(transfer))
            .with_severity(severity)
            .with_reason("late");
        #[expect(clippy::cast_precision_loss, reason = "a measure to compare")]
        let alarm = alarm.with_measure(duration as f64);
        alarm.report_finding(|| format!("SDO response after {milliseconds} ms > {limit} ms"));
    }
}

impl Rule for SdoNoResponse {
    fn on_event(&mut self, event: &Event, context: &mut RuleContext<'_>) {
        // Frames may be missing in the hole, or the clock was set.
        if matches!(event.kind, EventKind::SdoTransfer(_)) && context.is_across_hole(event.frames.first) {
            return;
        }
        let transfer = match (&event.kind, event.node) {
            (EventKind::SdoTransfer(transfer), _) => transfer,
            (EventKind::NmtState(change), Some(node)) => return self.on_state(event, node, change),
            _ => return,
        };
        match (transfer.outcome, transfer.waited) {
            (SdoOutcome::Timeout, _) | (_, Some(_)) if self.serves_none(event) => {}
            // The server responded on another identifier, which another rule reports.
            _ if transfer.misplaced.is_some() => {}
            // The client did not continue the transfer, or did not start it.
            (SdoOutcome::Timeout, _) if transfer.awaits_client => {}
            (SdoOutcome::Timeout, _) => {
                let waited = transfer.waited.filter(|_| is_store(transfer));
                let silence = waited.unwrap_or_else(|| context.bus.sdo_silence());
                let requested = event.time.map(|time| time.plus(silence.saturating_neg()));
                let alarm = context
                    .start_finding(event)
                    .with_subject(transfer_subject(transfer))
                    .with_measure(f64::MAX)
                    .requested_at_timestamp(requested);
                alarm.report_finding(|| "no SDO response".to_owned());
            }
            (outcome, Some(waited)) => self.given_up(event, transfer, (outcome, waited), context),
            (SdoOutcome::Complete | SdoOutcome::Aborted, None) => {
                self.on_slow_response(event, transfer, context);
            }
            _ => {}
        }
    }
}
