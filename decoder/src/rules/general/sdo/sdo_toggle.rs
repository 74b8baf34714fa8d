//! Toggle bits of SDO segments.

use crate::event::{Event, EventKind, Mode, Outcome, SdoIrregularityKind};
use crate::rules::general::facts::about;
use crate::rules::rule::declare_rule;
use crate::rules::{Context, Policy, Rule};

declare_rule! {
    /// # What it checks
    /// The toggle bit of a segmented transfer begins with 0 and alternates; the server answers with the bit that the
    /// client sent.
    ///
    /// # Why it matters
    /// It is all that tells a segment sent again from the next one: data is lost or doubled without a sign.
    ///
    /// # Source
    /// CiA 301 §7.2.4.3.5, §7.2.4.3.8 (download and upload of segments)
    ///
    /// # What to look at first
    /// Which side is named; its SDO stack, and whether two clients share the channel.
    ///
    /// # Mutation
    /// flip bit 4 of the first byte of a segment
    "sdo-toggle", Warning, "a toggle bit of an SDO segment is wrong",
    kinds: ["sdo-transfer"],
    cases: &["2.13", "2.14", "2.15", "2.16", "2.17", "2.18", "4.1", "4.7", "4.9"],
    word: "SDO",
}

struct SdoToggle;

fn new(_policy: &Policy) -> SdoToggle {
    SdoToggle
}

impl Rule for SdoToggle {
    fn event(&mut self, event: &Event, context: &mut Context<'_>) {
        let EventKind::SdoTransfer(transfer) = &event.kind else { return };
        let Some(wrong) = transfer.irregularity.filter(|it| it.what == SdoIrregularityKind::Toggle) else {
            if transfer.mode == Some(Mode::Segmented)
                && transfer.outcome == Outcome::Complete
                && !transfer.cut_start
            {
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
        let side = if wrong.by_client { "client" } else { "server" };
        let outcome = transfer.outcome.name();
        let alarm = context.fail(event).about(about(transfer));
        alarm.say(|| format!("the {side}'s toggle bit is wrong {{{}}}, {outcome}", wrong.frame));
    }
}
