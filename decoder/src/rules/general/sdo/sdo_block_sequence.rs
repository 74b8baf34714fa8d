//! Sequence numbers and sizes of SDO blocks.

use crate::event::{Event, EventKind, Mode, Outcome, SdoIrregularityKind};
use crate::rules::general::facts::about;
use crate::rules::rule::declare_rule;
use crate::rules::{Context, Policy, Rule};

declare_rule! {
    /// # What it checks
    /// A block has 1 to 127 segments, as many as its receiver said; no segment has a higher number, none is
    /// acknowledged that cannot have been sent.
    ///
    /// # Why it matters
    /// The sides no longer agree on what was transferred: firmware and parameter sets arrive broken.
    ///
    /// # Source
    /// CiA 301 §7.2.4.3.9 to §7.2.4.3.15 (block transfer)
    ///
    /// # What to look at first
    /// Which side is named, and whether frames were lost in the recording.
    ///
    /// # Mutation
    /// acknowledge a block with sequence number 128
    "sdo-block-sequence", Warning, "a sequence number or size of an SDO block is wrong",
    kinds: ["sdo-transfer"],
    cases: &["2.19", "2.20", "2.21", "2.22", "2.23", "2.24", "2.25", "2.26", "2.27"],
    word: "SDO",
}

struct SdoBlockSequence;

fn new(_policy: &Policy) -> SdoBlockSequence {
    SdoBlockSequence
}

impl Rule for SdoBlockSequence {
    fn event(&mut self, event: &Event, context: &mut Context<'_>) {
        let EventKind::SdoTransfer(transfer) = &event.kind else { return };
        if transfer.mode != Some(Mode::Block) || transfer.cut_start {
            return;
        }
        let Some(wrong) = transfer.irregularity else {
            if transfer.outcome == Outcome::Complete {
                context.pass();
            }
            return;
        };
        // A test tool does it on purpose: right is who aborts then.
        if wrong.by_client && context.is_tested {
            if transfer.outcome == Outcome::Aborted {
                context.pass();
            }
            return;
        }
        let what = match wrong.what {
            SdoIrregularityKind::BlockSize => "block size is not 1 to 127",
            SdoIrregularityKind::Sequence => "sequence number is beyond the block",
            SdoIrregularityKind::Toggle => return,
        };
        let side = if wrong.by_client { "client" } else { "server" };
        let alarm = context.fail(event).about(about(transfer));
        alarm.say(|| format!("the {side}'s {what} {{{}}}, {}", wrong.frame, transfer.outcome.name()));
    }
}
