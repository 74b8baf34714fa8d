//! SDO clients that send a request before the response to the one before.

use crate::event::{Event, EventKind, Kind, SdoOutcome};
use crate::rules::rule::declare_rule;
use crate::rules::{Rule, RuleContext, RulePolicy};

declare_rule! {
    /// # What it checks
    /// The client sends an SDO request within 50 ms of the one before, although that one has no response. A request
    /// after a longer time is a retry or a new attempt, and exempt. There is one finding per client and server.
    ///
    /// # Why it matters
    /// A server processes one transfer at a time. It may ignore requests, or the client assigns a response to the
    /// wrong request.
    ///
    /// # Source
    /// CiA 301 §7.2.4.2 (confirmed service: the client waits for the response), §7.2.4.3.17
    ///
    /// # What to look at first
    /// Check whether two clients use the same SDO channel. If not, let the master wait for each response.
    ///
    /// # Mutation
    /// send a second request before the response to the first
    "sdo-client-does-not-wait", Warning, "SDO client does not wait for the response",
    kinds: [Kind::SdoTransfer],
    needs: "an SDO transfer",
    skips_holes: true,
    word: "SDO",
}

struct SdoClientDoesNotWait;

fn new(_policy: &RulePolicy) -> SdoClientDoesNotWait {
    SdoClientDoesNotWait
}

impl Rule for SdoClientDoesNotWait {
    fn on_event(&mut self, event: &Event, context: &mut RuleContext<'_>) {
        let EventKind::SdoTransfer(transfer) = &event.kind else { return };
        // Without timestamps, the client may have waited.
        if !context.has_time || context.is_tested || transfer.cut_start || transfer.is_unrequested {
            return;
        }
        let Some(overlap) = transfer.overlap else {
            if transfer.outcome == SdoOutcome::Complete {
                context.count_pass();
            }
            return;
        };
        #[expect(clippy::cast_precision_loss, reason = "a measure to compare")]
        let alarm = context.start_finding(event).with_measure(-(overlap as f64));
        let request = transfer.request;
        let (whole, tenth) = (overlap / 1_000_000, overlap / 100_000 % 10);
        alarm.report_finding(|| {
            format!("client on {request} sent its next request after {whole}.{tenth} ms, without a response")
        });
    }
}
