//! A UDS server does not answer.

use super::uds_negative::{service_name, subject};
use crate::event::{Ends, Event, EventKind, ExchangeOutcome, UdsExchange};
use crate::finding::{About, Severity};
use crate::frame::CanId;
use crate::rules::rule::declare_rule;
use crate::rules::{Context, Policy, Rule};

declare_rule! {
    /// # What it checks
    /// A request has no final response: within 5 s, or before the client asks the same again, and in any case after a
    /// response that said it takes longer (78). Requests that ask for no positive response, and requests to a server of
    /// which no answer was seen so far, are not judged: a tester looks for servers that way.
    ///
    /// # Why it matters
    /// What was written or started may have happened or not; a server that stops answering has restarted or is stuck.
    ///
    /// # Source
    /// ISO 14229-2 §7.2 (P2, P2*); ISO 14229-1 §8.7
    ///
    /// # What to look at first
    /// Whether the device restarted, the request arrived whole (ISO-TP), another tester talks to it.
    ///
    /// # Mutation
    /// drop the answer of a server
    "uds-no-response", Warning, "a UDS request has no answer",
    kinds: ["uds-exchange"],
    is_timing: true,
    word: "UDS",
}

/// Servers remembered.
const SERVER_LIMIT: usize = 256;

#[derive(Default)]
struct UdsNoResponse {
    /// Servers that answered: address, name by the bus file, identifier of the requests.
    heard: Vec<Server>,
}

#[derive(PartialEq)]
struct Server {
    ends: (Option<u16>, Option<u16>),
    id: Option<CanId>,
}

impl Server {
    fn of(exchange: &UdsExchange) -> Self {
        let Ends { source, target, .. } = exchange.ends;
        let id = exchange.request.as_ref().map(|request| request.id).filter(|_| target.is_none());
        Self { ends: (source, target), id }
    }
}

fn new(_policy: &Policy) -> UdsNoResponse {
    UdsNoResponse::default()
}

impl UdsNoResponse {
    fn silent(&self, event: &Event, exchange: &UdsExchange, context: &mut Context<'_>) {
        let is_known = self.heard.contains(&Server::of(exchange));
        if exchange.ends.functional || !(is_known || exchange.pending > 0) {
            return;
        }
        let about = About::Name(subject(event, exchange));
        let severity = if exchange.pending > 0 { Severity::Error } else { Severity::Warning };
        let alarm = context.fail(event).about(about).severity(severity);
        let pending = exchange.pending;
        let name = service_name(exchange.service);
        alarm.say(|| match pending {
            0 => format!("no answer to {name}"),
            pending => format!("no answer to {name} after {pending} × response pending"),
        });
    }
}

impl Rule for UdsNoResponse {
    fn event(&mut self, event: &Event, context: &mut Context<'_>) {
        let EventKind::UdsExchange(exchange) = &event.kind else { return };
        match exchange.outcome {
            ExchangeOutcome::Positive | ExchangeOutcome::Negative => {
                context.pass();
                let server = Server::of(exchange);
                if self.heard.len() < SERVER_LIMIT && !self.heard.contains(&server) {
                    self.heard.push(server);
                }
            }
            ExchangeOutcome::NoAnswer => self.silent(event, exchange, context),
            ExchangeOutcome::Unsolicited | ExchangeOutcome::Suppressed | ExchangeOutcome::Unfinished => {}
        }
    }
}
