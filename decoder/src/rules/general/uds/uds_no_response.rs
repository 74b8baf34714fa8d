//! UDS requests without a response.

use super::uds_negative::{exchange_subject, service_name};
use crate::event::{Event, EventKind, ExchangeOutcome, Kind, UdsEndpoints, UdsExchange};
use crate::finding::{FindingSubject, Severity};
use crate::frame::CanId;
use crate::rules::rule::declare_rule;
use crate::rules::{Rule, RuleContext, RulePolicy};

declare_rule! {
    /// # What it checks
    /// A request has no final response within 5 s or before the client repeats it. A missing response after
    /// "response pending" (78) is an error. Requests that suppress the positive response, and requests to a
    /// server without any earlier response, are exempt: testers search for servers that way.
    ///
    /// # Why it matters
    /// The write or routine may or may not have taken effect. A server that stops responding has restarted or
    /// is stuck.
    ///
    /// # Source
    /// ISO 14229-2 §7.2 (P2, P2*); ISO 14229-1 §8.7
    ///
    /// # What to look at first
    /// Check whether the device restarted. Check whether the request was complete (ISO-TP), and whether a
    /// second tester is active.
    ///
    /// # Mutation
    /// drop the response of a server
    "uds-no-response", Warning, "UDS request without response",
    kinds: [Kind::UdsExchange],
    needs: "a UDS request to a server that has responded",
    skips_holes: true,
    is_timing: true,
    word: "UDS",
}

/// Maximum number of servers.
const SERVER_LIMIT: usize = 256;

#[derive(Default)]
struct UdsNoResponse {
    /// Servers that have responded: addresses, or the identifier of the requests.
    received: Vec<UdsServer>,
}

#[derive(PartialEq)]
struct UdsServer {
    ends: (Option<u16>, Option<u16>),
    id: Option<CanId>,
}

impl UdsServer {
    fn server_of(exchange: &UdsExchange) -> Self {
        let UdsEndpoints { source, target, .. } = exchange.ends;
        let id = exchange.request.as_ref().map(|request| request.id).filter(|_| target.is_none());
        Self { ends: (source, target), id }
    }
}

fn new(_policy: &RulePolicy) -> UdsNoResponse {
    UdsNoResponse::default()
}

impl UdsNoResponse {
    fn on_silent(&self, event: &Event, exchange: &UdsExchange, context: &mut RuleContext<'_>) {
        let is_known = self.received.contains(&UdsServer::server_of(exchange));
        if exchange.ends.functional || !(is_known || exchange.pending > 0) {
            return;
        }
        let about = FindingSubject::Name(exchange_subject(event, exchange));
        let severity = if exchange.pending > 0 { Severity::Error } else { Severity::Warning };
        let alarm = context.start_finding(event).with_subject(about).with_severity(severity);
        let pending = exchange.pending;
        let name = service_name(exchange.service);
        alarm.report_finding(|| match pending {
            0 => format!("no response to {name}"),
            pending => format!("no final response to {name} after {pending} × response pending"),
        });
    }
}

impl Rule for UdsNoResponse {
    fn on_event(&mut self, event: &Event, context: &mut RuleContext<'_>) {
        let EventKind::UdsExchange(exchange) = &event.kind else { return };
        match exchange.outcome {
            ExchangeOutcome::Positive | ExchangeOutcome::Negative => {
                context.count_pass();
                let server = UdsServer::server_of(exchange);
                if self.received.len() < SERVER_LIMIT && !self.received.contains(&server) {
                    self.received.push(server);
                }
            }
            ExchangeOutcome::NoAnswer => self.on_silent(event, exchange, context),
            ExchangeOutcome::Unsolicited | ExchangeOutcome::Suppressed | ExchangeOutcome::Unfinished => {}
        }
    }
}
