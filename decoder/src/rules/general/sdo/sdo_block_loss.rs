//! Segments of SDO blocks that are lost on the bus.

use crate::event::{Event, EventKind, Kind, Mode, Outcome};
use crate::rules::general::facts::about;
use crate::rules::rule::declare_rule;
use crate::rules::{Context, Policy, Rule};
use crate::words::plural;

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

fn new(_policy: &Policy) -> SdoBlockLoss {
    SdoBlockLoss
}

impl Rule for SdoBlockLoss {
    fn event(&mut self, event: &Event, context: &mut Context<'_>) {
        let EventKind::SdoTransfer(transfer) = &event.kind else { return };
        if transfer.mode != Some(Mode::Block) || context.is_tested {
            return;
        }
        let Some((sequence, frame)) = transfer.first_loss else {
            if transfer.outcome == Outcome::Complete && !transfer.cut_start {
                context.pass();
            }
            return;
        };
        #[expect(clippy::cast_precision_loss, reason = "a measure to compare")]
        let alarm = context.fail(event).about(about(transfer)).measure(transfer.losses as f64);
        alarm.report(|| {
            let at = frame.map_or(String::new(), |frame| format!(" {{{frame}}}"));
            let blocks = plural(transfer.losses, "block");
            format!("segment {sequence} not acknowledged{at} and sent again ({blocks} of the transfer)")
        });
    }
}
