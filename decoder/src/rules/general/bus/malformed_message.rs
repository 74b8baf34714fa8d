//! Bytes that are no message of their service.

use crate::event::{Event, EventKind};
use crate::finding::About;
use crate::rules::general::j1939::transport_violation::is_transport;
use crate::rules::rule::declare_rule;
use crate::rules::{Context, Policy, Rule};

declare_rule! {
    /// # What it checks
    /// A frame has too few bytes for the service its identifier belongs to, or a command that does not exist. A note where
    /// the protocol of the bus is presumed only.
    ///
    /// # Why it matters
    /// Who receives it ignores it or reads nonsense; or the identifier is used for something else.
    ///
    /// # Source
    /// The service's own clause: CiA 301 §7.2, CiA 305 §3.9, SAE J1939-21 §5.4, §5.10, J1939-73 §5.7, ISO 15765-2 §9.4
    ///
    /// # What to look at first
    /// Who sends it, and whether the identifier was given to two services.
    ///
    /// # Mutation
    /// insert a request for a J1939 group of two bytes
    "malformed-message", Warning, "bytes that are no message of their service",
    kinds: ["malformed", "lss", "boot-up", "sdo-transfer", "address-claim", "j1939-request", "uds-exchange"],
    word: "BYTES",
}

struct MalformedMessage;

fn new(_policy: &Policy) -> MalformedMessage {
    MalformedMessage
}

impl Rule for MalformedMessage {
    fn event(&mut self, event: &Event, context: &mut Context<'_>) {
        let EventKind::Malformed { error, reason } = &event.kind else { return context.pass() };
        // Transfers whose sizes contradict each other have a rule of their own.
        if error.needed == 0 && is_transport(error.layer) {
            return;
        }
        let alarm = context.fail(event).about(About::Name(error.layer.into()));
        alarm.say(|| match error.needed {
            0 => (*reason).to_owned(),
            needed => format!("{reason}: {} bytes, {needed} needed", error.available),
        });
    }
}
