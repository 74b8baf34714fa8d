//! Toggle bits of SDO segments.

use crate::event::{Event, EventKind, Kind, SdoIrregularityKind, SdoMode, SdoOutcome};
use crate::rules::general::facts::transfer_subject;
use crate::rules::rule::declare_rule;
use crate::rules::{Rule, RuleContext, RulePolicy};

declare_rule! {
    /// # What it checks
    /// The toggle bit of a segmented transfer must start at 0 and alternate. The server must repeat the
    /// toggle bit of the client.
    ///
    /// # Why it matters
    /// Only the toggle bit distinguishes a repeated segment from the next one. Data is lost or duplicated
    /// without notice.
    ///
    /// # Source
    /// CiA 301 §7.2.4.3.5, §7.2.4.3.8 (download and upload of segments)
    ///
    /// # What to look at first
    /// Check whether two clients use the same SDO channel. If not, the SDO stack of the named side is wrong.
    ///
    /// # Mutation
    /// flip bit 4 of the first byte of a segment
    "sdo-toggle", Warning, "wrong toggle bit in SDO segment",
    kinds: [Kind::SdoTransfer],
    needs: "a segmented transfer",
    skips_holes: true,
    cases: &["2.13", "2.14", "2.15", "2.16", "2.17", "2.18", "4.1", "4.7", "4.9"],
    word: "SDO",
}

struct SdoToggle;

fn new(_policy: &RulePolicy) -> SdoToggle {
    SdoToggle
}

impl Rule for SdoToggle {
    fn on_event(&mut self, event: &Event, context: &mut RuleContext<'_>) {
        let EventKind::SdoTransfer(transfer) = &event.kind else { return };
        // Only segments have a toggle bit.
        let is_segmented = transfer.mode == Some(SdoMode::Segmented);
        let toggle =
            transfer.irregularity.filter(|it| it.what == SdoIrregularityKind::Toggle && is_segmented);
        let Some(wrong) = toggle else {
            if transfer.mode == Some(SdoMode::Segmented)
                && transfer.outcome == SdoOutcome::Complete
                && !transfer.cut_start
            {
                context.count_pass();
            }
            return;
        };
        // A test tool provokes this on purpose; the correct reaction is an abort.
        if wrong.by_client && context.is_tested {
            if transfer.outcome == SdoOutcome::Aborted {
                context.count_pass();
            }
            return;
        }
        let side = if wrong.by_client { "client" } else { "server" };
        let outcome = transfer.outcome.name();
        let alarm = context.start_finding(event).with_subject(transfer_subject(transfer));
        alarm.report_finding(|| format!("wrong {side} toggle bit {{{}}} (transfer {outcome})", wrong.frame));
    }
}
