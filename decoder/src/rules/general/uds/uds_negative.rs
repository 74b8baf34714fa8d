//! A UDS server refuses a request.

use std::fmt::Write as _;
use std::sync::Arc;

use crate::event::{Event, EventKind, ExchangeOutcome, UdsExchange};
use crate::finding::{About, Severity};
use crate::profile::uds;
use crate::query::record;
use crate::rules::rule::declare_rule;
use crate::rules::{Context, Policy, Rule};

declare_rule! {
    /// # What it checks
    /// A server answers with a negative response: a warning where something was to be written, started, transferred,
    /// cleared or reset, else a note. That a server does not have a service, sub-function or identifier is how testers find
    /// out what it has: nothing where something was only read. "Response pending" (78) is no refusal.
    ///
    /// # Why it matters
    /// The setting, routine or download did not happen, whatever the tester shows.
    ///
    /// # Source
    /// ISO 14229-1 §8.7 and Annex A.1 (negative response codes)
    ///
    /// # What to look at first
    /// The session and security access before it, the length of the request, conditions in the device's manual.
    ///
    /// # Mutation
    /// replace the answer of a write by a refusal
    "uds-negative", Warning, "a UDS server refuses a request",
    kinds: ["uds-exchange"],
    word: "UDS",
}

/// Codes that say only that there is no such thing (here): service, sub-function, identifier, in this session.
const NOT_THERE: [u8; 5] = [0x11, 0x12, 0x31, 0x7E, 0x7F];

/// There is no such service at all: also of a service that changes something.
const NO_SERVICE: u8 = 0x11;

/// Services that change something: reset, clear, write, control, routine, transfer.
const CHANGES: [u8; 10] = [0x11, 0x14, 0x2E, 0x2F, 0x31, 0x34, 0x36, 0x37, 0x38, 0x3D];

struct UdsNegative;

fn new(_policy: &Policy) -> UdsNegative {
    UdsNegative
}

/// `20: 2E 0102`: server, service, identifier; the server is left out where a node stands for it.
pub(super) fn subject(event: &Event, exchange: &UdsExchange) -> Arc<str> {
    let mut text = String::new();
    if event.node.is_none() {
        let _ = match (&exchange.ends.server, exchange.ends.target) {
            (Some(server), _) => write!(text, "{server}: "),
            (None, Some(target)) => write!(text, "{target:02X}: "),
            (None, None) => Ok(()),
        };
    }
    let _ = write!(text, "{:02X}", exchange.service);
    if let Some(identifier) = exchange.identifier {
        let _ = write!(text, " {identifier:04X}");
    }
    text.into()
}

/// What a service is called.
pub(super) fn service_name(service: u8) -> &'static str {
    uds().service(service).map_or("service", |known| known.name.as_str())
}

impl Rule for UdsNegative {
    fn event(&mut self, event: &Event, context: &mut Context<'_>) {
        let EventKind::UdsExchange(exchange) = &event.kind else { return };
        let code = match (exchange.outcome, exchange.nrc) {
            (ExchangeOutcome::Positive, _) => return context.pass(),
            (ExchangeOutcome::Negative, Some(code)) => code,
            _ => return,
        };
        let changes = CHANGES.contains(&exchange.service);
        if code == NO_SERVICE || !changes && NOT_THERE.contains(&code) {
            return;
        }
        let severity = if changes { Severity::Warning } else { Severity::Note };
        let own = record::device(event, context.bus).uds.nrc(code, exchange.service, exchange.identifier);
        let own = own.map(|own| own.text.clone());
        let about = About::Name(subject(event, exchange));
        let alarm = context.fail(event).about(about).severity(severity);
        alarm.say(|| {
            let text = uds().code(code).map_or("unknown code", |known| known.text.as_str());
            format!(
                "{} refused with {code:02X}: {}",
                service_name(exchange.service),
                own.as_deref().unwrap_or(text)
            )
        });
    }
}
