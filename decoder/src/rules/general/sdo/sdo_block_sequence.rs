//! Sequence numbers and sizes of SDO blocks.

use crate::event::{Event, EventKind, Kind, SdoIrregularityKind, SdoMode, SdoOutcome};
use crate::rules::general::facts::transfer_subject;
use crate::rules::rule::declare_rule;
use crate::rules::{Rule, RuleContext, RulePolicy};

declare_rule! {
    /// # What it checks
    /// The block size must be 1 to 127 segments. Segments and acknowledgements must not have a sequence
    /// number beyond the block size that the receiver requested.
    ///
    /// # Why it matters
    /// Client and server disagree about the transferred data, so firmware or parameter sets are corrupt.
    ///
    /// # Source
    /// CiA 301 §7.2.4.3.9 to §7.2.4.3.15 (block transfer)
    ///
    /// # What to look at first
    /// Check the capture for lost frames. If there are none, the named side (client or server) is wrong.
    ///
    /// # Mutation
    /// acknowledge a block with sequence number 128
    "sdo-block-sequence", Warning, "wrong sequence number or size in SDO block",
    kinds: [Kind::SdoTransfer],
    needs: "a block transfer",
    skips_holes: true,
    cases: &["2.19", "2.20", "2.21", "2.22", "2.23", "2.24", "2.25", "2.26", "2.27"],
    word: "SDO",
}

struct SdoBlockSequence;

fn new(_policy: &RulePolicy) -> SdoBlockSequence {
    SdoBlockSequence
}

impl Rule for SdoBlockSequence {
    fn on_event(&mut self, event: &Event, context: &mut RuleContext<'_>) {
        let EventKind::SdoTransfer(transfer) = &event.kind else { return };
        if transfer.mode != Some(SdoMode::Block) || transfer.cut_start {
            return;
        }
        let Some(wrong) = transfer.irregularity else {
            if transfer.outcome == SdoOutcome::Complete {
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
        let what = match wrong.what {
            SdoIrregularityKind::BlockSize => "block size out of range (1 to 127)",
            SdoIrregularityKind::Sequence => "sequence number beyond the block",
            SdoIrregularityKind::Toggle => return,
        };
        let side = if wrong.by_client { "client" } else { "server" };
        let alarm = context.start_finding(event).with_subject(transfer_subject(transfer));
        alarm.report_finding(|| {
            format!("{side} {what} {{{}}} (transfer {})", wrong.frame, transfer.outcome.name())
        });
    }
}
