//! Incomplete or irregular ISO-TP messages.

use crate::event::{
    Event, EventKind, EventProtocol, IrregularityKind, IsoTpTransfer, Kind, MessageOutcome,
    TransferIrregularity,
};
use crate::finding::{FindingSubject, Severity};
use crate::rules::rule::{declare_rule, define_tolerance};
use crate::rules::{Rule, RuleContext, RulePolicy};

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
    tolerances: &[define_tolerance(
        "grace-ms", 1_000.0, "ms", "after the start of the capture, in which messages may have begun earlier",
    )],
}

struct IsotpViolation {
    grace: i64,
    began: i64,
}

fn new(policy: &RulePolicy) -> IsotpViolation {
    IsotpViolation { grace: policy.tolerance_ns(&DECLARATION, "grace-ms"), began: 0 }
}

fn on_message(event: &Event, transfer: &IsoTpTransfer, context: &mut RuleContext<'_>) {
    let (what, severity) = match transfer.outcome {
        MessageOutcome::Complete if transfer.is_single => return,
        MessageOutcome::Complete => return context.count_pass(),
        MessageOutcome::Unfinished => return,
        MessageOutcome::Incomplete => ("frames missing", Severity::Warning),
        MessageOutcome::NoFlowControl => ("no flow control within 1000 ms (N_Bs)", Severity::Warning),
        MessageOutcome::Timeout => ("no consecutive frame within 1000 ms (N_Cr)", Severity::Warning),
        MessageOutcome::Overflow => ("receiver overflow", Severity::Warning),
        MessageOutcome::Superseded => ("sender started another message", Severity::Note),
    };
    let (size, announced) = (transfer.size, transfer.announced);
    let alarm =
        context.start_finding(event).with_subject(FindingSubject::Id(transfer.id)).with_severity(severity);
    alarm.report_finding(|| format!("{size} of {announced} bytes received: {what}"));
}

fn on_irregularity(event: &Event, odd: &TransferIrregularity, is_early: bool, context: &mut RuleContext<'_>) {
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
    let alarm =
        context.start_finding(event).with_subject(FindingSubject::Name(path.into())).with_severity(severity);
    let message = odd.message;
    alarm.report_finding(|| match (odd.what, odd.packet) {
        (IrregularityKind::Duplicate, Some(number)) => {
            format!("{message} {number} received twice")
        }
        _ => format!("{message} without an open message"),
    });
}

impl Rule for IsotpViolation {
    fn begin_bus(&mut self, context: &mut RuleContext<'_>) {
        self.began = context.now;
    }

    fn on_event(&mut self, event: &Event, context: &mut RuleContext<'_>) {
        match &event.kind {
            EventKind::IsoTpTransfer(transfer) => on_message(event, transfer, context),
            EventKind::TransportIrregularity(odd) if event.protocol == EventProtocol::Uds => {
                let is_early = context.now.saturating_sub(self.began) < self.grace;
                on_irregularity(event, odd, is_early, context);
            }
            _ => {}
        }
    }
}
