//! Payloads that are not valid for their service.

use crate::event::{Event, EventKind, Kind};
use crate::finding::FindingSubject;
use crate::rules::rule::declare_rule;
use crate::rules::{Rule, RuleContext, RulePolicy};
use crate::words::count_noun;

declare_rule! {
    /// # What it checks
    /// A frame is too short for the service of its identifier, or contains an undefined command. It is a note
    /// if the protocol of the bus is only presumed.
    ///
    /// # Why it matters
    /// Receivers ignore the message or misread it. The identifier may also be in use for another purpose.
    ///
    /// # Source
    /// Clause of the service: CiA 301 §7.2, CiA 305 §3.9, SAE J1939-21 §5.4, §5.10, J1939-73 §5.7, ISO
    /// 15765-2 §9.4
    ///
    /// # What to look at first
    /// Find the device that sends this identifier. Check whether the identifier is assigned to two services.
    ///
    /// # Mutation
    /// insert a 2-byte request for a J1939 group
    "malformed-message", Warning, "payload not valid for its service",
    kinds: [
        Kind::Malformed, Kind::Lss, Kind::BootUp, Kind::SdoTransfer, Kind::AddressClaim, Kind::J1939Request,
        Kind::UdsExchange,
    ],
    needs: "a service with a fixed length",
    word: "BYTES",
}

struct MalformedMessage;

fn new(_policy: &RulePolicy) -> MalformedMessage {
    MalformedMessage
}

impl Rule for MalformedMessage {
    fn on_event(&mut self, event: &Event, context: &mut RuleContext<'_>) {
        let EventKind::Malformed { error, reason } = &event.kind else { return context.count_pass() };
        // Contradictory transfer sizes are reported by `transport-violation`.
        if error.needed == 0 && error.is_of_connection_management() {
            return;
        }
        let alarm = context.start_finding(event).with_subject(FindingSubject::Name(error.layer.into()));
        alarm.report_finding(|| match error.needed {
            0 => (*reason).to_owned(),
            needed => format!("{reason}: {} (min {needed})", count_noun(error.available, "byte")),
        });
    }
}
