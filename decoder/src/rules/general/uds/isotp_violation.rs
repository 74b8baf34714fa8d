//! Incomplete or irregular ISO-TP messages.

use crate::event::{
    Event, EventKind, Irregularity, IrregularityKind, IsoTpTransfer, Kind, MessageOutcome, Protocol,
};
use crate::finding::{About, Severity};
use crate::rules::rule::{declare_rule, tolerance};
use crate::rules::{Context, Policy, Rule};

declare_rule! {
    /// # What it checks
    /// A segmented ISO-TP message lacks or repeats frames, receives no flow control (N_Bs), is not continued
    /// (N_Cr), or overflows its receiver. Flow control without an open message is reported too. Messages that
    /// began before the capture are exempt.
    ///
    /// # Why it matters
    /// The diagnostic request or its response is lost. The tester repeats the request or aborts.
    ///
    /// # Source
    /// ISO 15765-2 §9.6.5 (flow control), §9.7 (N_Bs, N_Cr), §9.8 (unexpected frames)
    ///
    /// # What to look at first
    /// Check which side stopped sending. Check whether other devices use the same identifier.
    ///
    /// # Mutation
    /// drop a consecutive frame
    "isotp-violation", Warning, "ISO-TP message incomplete or unexpected",
    kinds: [Kind::IsoTpTransfer, Kind::TransportIrregularity],
    needs: "a segmented ISO-TP message",
    skips_holes: true,
    word: "ISOTP",
    tolerances: &[tolerance(
        "grace-ms", 1_000.0, "ms", "after the start of the capture, in which messages may have begun earlier",
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
        MessageOutcome::Incomplete => ("frames missing", Severity::Warning),
        MessageOutcome::NoFlowControl => ("no flow control within 1000 ms (N_Bs)", Severity::Warning),
        MessageOutcome::Timeout => ("no consecutive frame within 1000 ms (N_Cr)", Severity::Warning),
        MessageOutcome::Overflow => ("receiver overflow", Severity::Warning),
        MessageOutcome::Superseded => ("sender started another message", Severity::Note),
    };
    let (size, announced) = (transfer.size, transfer.announced);
    let alarm = context.fail(event).about(About::Id(transfer.id)).severity(severity);
    alarm.report(|| format!("{size} of {announced} bytes received: {what}"));
}

fn irregular(event: &Event, odd: &Irregularity, is_early: bool, context: &mut Context<'_>) {
    let severity = match odd.what {
        // The outcome of the message includes the gap.
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
    alarm.report(|| match (odd.what, odd.packet) {
        (IrregularityKind::Duplicate, Some(number)) => {
            format!("{message} {number} received twice")
        }
        _ => format!("{message} without an open message"),
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
