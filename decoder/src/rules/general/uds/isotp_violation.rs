//! An ISO-TP message does not arrive.

use crate::event::{
    Event, EventKind, Irregularity, IrregularityKind, IsoTpTransfer, MessageOutcome, Protocol,
};
use crate::finding::{About, Severity};
use crate::rules::rule::{declare_rule, tolerance};
use crate::rules::{Context, Policy, Rule};

declare_rule! {
    /// # What it checks
    /// A message of several frames: frames are missing or come twice, no flow control comes (N_Bs), the sender does not go
    /// on (N_Cr), the receiver has no room, or flow control comes where nobody waits for it. What began before the capture
    /// is not judged.
    ///
    /// # Why it matters
    /// The diagnostic request or its answer is lost, and the tester asks again or gives up.
    ///
    /// # Source
    /// ISO 15765-2 §9.6.5 (flow control), §9.7 (N_Bs, N_Cr), §9.8 (unexpected frames)
    ///
    /// # What to look at first
    /// Which side stopped, its address, whether frames of others carry the same identifier.
    ///
    /// # Mutation
    /// drop a consecutive frame
    "isotp-violation", Warning, "an ISO-TP message does not arrive whole",
    kinds: ["isotp-transfer", "transport-irregularity"],
    word: "ISOTP",
    tolerances: &[tolerance(
        "grace-ms", 1_000.0, "ms", "from the beginning of the capture, in which messages may have begun before it",
    )],
}

struct IsotpViolation {
    grace: i64,
    began: i64,
}

fn new(policy: &Policy) -> IsotpViolation {
    IsotpViolation { grace: policy.nanoseconds(&DECLARATION, "grace-ms"), began: 0 }
}

fn message(event: &Event, transfer: &IsoTpTransfer, context: &mut Context<'_>) {
    let (what, severity) = match transfer.outcome {
        MessageOutcome::Complete if transfer.is_single => return,
        MessageOutcome::Complete => return context.pass(),
        MessageOutcome::Unfinished => return,
        MessageOutcome::Incomplete => ("frames in between are missing", Severity::Warning),
        MessageOutcome::NoFlowControl => ("no flow control came within 1,000 ms (N_Bs)", Severity::Warning),
        MessageOutcome::Timeout => ("the sender did not go on within 1,000 ms (N_Cr)", Severity::Warning),
        MessageOutcome::Overflow => ("the receiver has no room for it", Severity::Warning),
        MessageOutcome::Superseded => ("the sender began another message", Severity::Note),
    };
    let (size, announced) = (transfer.size, transfer.announced);
    let alarm = context.fail(event).about(About::Id(transfer.id)).severity(severity);
    alarm.say(|| format!("{size} of {announced} bytes: {what}"));
}

fn irregular(event: &Event, odd: &Irregularity, is_early: bool, context: &mut Context<'_>) {
    let severity = match odd.what {
        // What a gap comes to the end of the message tells.
        IrregularityKind::Gap => return,
        IrregularityKind::Unexpected if is_early => return,
        _ => Severity::Note,
    };
    let path = match (odd.source, odd.destination) {
        (Some(source), Some(destination)) => format!("{source:02X} to {destination:02X}"),
        _ => "frames".to_owned(),
    };
    let alarm = context.fail(event).about(About::Name(path.into())).severity(severity);
    let message = odd.message;
    alarm.say(|| match (odd.what, odd.packet) {
        (IrregularityKind::Duplicate, Some(number)) => {
            format!("{message} with number {number} came twice")
        }
        _ => format!("{message} that no message explains"),
    });
}

impl Rule for IsotpViolation {
    fn begin(&mut self, context: &mut Context<'_>) {
        self.began = context.now;
    }

    fn event(&mut self, event: &Event, context: &mut Context<'_>) {
        match &event.kind {
            EventKind::IsoTpTransfer(transfer) => message(event, transfer, context),
            EventKind::TransportIrregularity(odd) if event.protocol == Protocol::Uds => {
                let is_early = context.now.saturating_sub(self.began) < self.grace;
                irregular(event, odd, is_early, context);
            }
            _ => {}
        }
    }
}
