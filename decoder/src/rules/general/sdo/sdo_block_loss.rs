//! Segments of SDO blocks that are lost on the bus.

use crate::event::{Event, EventKind, Kind, SdoMode, SdoOutcome};
use crate::rules::general::facts::transfer_subject;
use crate::rules::rule::declare_rule;
use crate::rules::{Rule, RuleContext, RulePolicy};
use crate::words::count_noun;

declare_rule! {
    /// # What it checks
    /// The receiver of a block acknowledges fewer segments than were sent, so the sender repeats the others. A
    /// segment that the receiver acknowledged, but that is missing in the capture, is a property of the capture and
    /// exempt.
    ///
    /// # Why it matters
    /// Frames are lost between sender and receiver. The transfer takes longer, and other services have no
    /// repetition.
    ///
    /// # Source
    /// CiA 301 §7.2.4.3.9, §7.2.4.3.14 (ackseq)
    ///
    /// # What to look at first
    /// Check the bus for errors, and the receive buffer of the receiver. Reduce its block size.
    ///
    /// # Mutation
    /// acknowledge a block with a lower sequence number
    "sdo-block-loss", Warning, "SDO block segments lost on the bus",
    kinds: [Kind::SdoTransfer],
    needs: "a block transfer",
    skips_holes: true,
    word: "SDO",
}

struct SdoBlockLoss;

fn new(_policy: &RulePolicy) -> SdoBlockLoss {
    SdoBlockLoss
}

impl Rule for SdoBlockLoss {
    fn on_event(&mut self, event: &Event, context: &mut RuleContext<'_>) {
        let EventKind::SdoTransfer(transfer) = &event.kind else { return };
        if transfer.mode != Some(SdoMode::Block) || context.is_tested {
            return;
        }
        let Some((sequence, frame)) = transfer.first_loss else {
            if transfer.outcome == SdoOutcome::Complete && !transfer.cut_start {
                context.count_pass();
            }
            return;
        };
        #[expect(clippy::cast_precision_loss, reason = "a measure to compare")]
        let alarm = context
            .start_finding(event)
            .with_subject(transfer_subject(transfer))
            .with_measure(transfer.losses as f64);
        alarm.report_finding(|| {
            let at = frame.map_or(String::new(), |frame| format!(" {{{frame}}}"));
            let blocks = count_noun(transfer.losses, "block");
            format!("segment {sequence} not acknowledged{at} and sent again ({blocks} of the transfer)")
        });
    }
}
