//! SDO servers that send responses without a request.

use crate::event::{Event, EventKind, Kind, SdoOutcome};
use crate::rules::rule::{declare_rule, define_tolerance};
use crate::rules::{Rule, RuleContext, RulePolicy};
use crate::wire::NodeMap;
use crate::words::count_noun;

declare_rule! {
    /// # What it checks
    /// A server sends `responses` or more SDO responses in sequence without a request, also during a transfer of its
    /// client that they contradict. A single one may be late, or its request may be missing in the capture.
    ///
    /// # Why it matters
    /// The responses load the bus, and a client may assign them to its next request.
    ///
    /// # Source
    /// CiA 301 §7.2.4.3 (each response follows a request)
    ///
    /// # What to look at first
    /// Check whether the capture contains the requests at all. If it does, the SDO server of the firmware is wrong.
    ///
    /// # Mutation
    /// repeat a response
    "sdo-unrequested-response", Warning, "SDO responses without a request",
    kinds: [Kind::SdoTransfer],
    needs: "an SDO transfer",
    word: "SDO",
    tolerances: &[define_tolerance("responses", 3.0, "", "responses in sequence without a request")],
}

/// Number of responses of one event; enough for each limit.
fn counted(responses: u64) -> f64 {
    f64::from(u32::try_from(responses).unwrap_or(u32::MAX))
}

struct SdoUnrequestedResponse {
    least: f64,
    /// Responses of a server without a request, since the last exchange.
    counts: NodeMap<f64>,
}

fn new(policy: &RulePolicy) -> SdoUnrequestedResponse {
    SdoUnrequestedResponse {
        least: policy.tolerance_value(&DECLARATION, "responses"),
        counts: NodeMap::default(),
    }
}

impl Rule for SdoUnrequestedResponse {
    fn on_event(&mut self, event: &Event, context: &mut RuleContext<'_>) {
        let (EventKind::SdoTransfer(transfer), Some(node)) = (&event.kind, event.node) else { return };
        let Some(count) = self.counts.entry(node) else { return };
        let within = transfer.unrequested_responses;
        if !transfer.is_unrequested && within > 0 {
            *count = counted(within);
        } else if !transfer.is_unrequested || transfer.abort.is_some() {
            // The first response without a request is marked as one without start.
            *count = if transfer.cut_start && transfer.frame_count == 1 { 1.0 } else { 0.0 };
            if transfer.outcome == SdoOutcome::Complete && !transfer.cut_start {
                context.count_pass();
            }
            return;
        } else {
            *count += counted(transfer.frame_count);
        }
        let count = *count;
        if count >= self.least {
            #[expect(clippy::cast_possible_truncation, clippy::cast_sign_loss, reason = "a count of events")]
            let responses = count_noun(count as u64, "response");
            let response = transfer.response;
            let alarm = context.start_finding(event).with_measure(count);
            alarm.report_finding(|| format!("{responses} on {response} in sequence without a request"));
        }
    }
}
