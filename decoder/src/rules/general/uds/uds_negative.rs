//! Negative responses of a UDS server.

use std::collections::HashMap;
use std::fmt::Write as _;
use std::sync::Arc;

use crate::event::{Event, EventKind, ExchangeOutcome, Kind, UdsExchange};
use crate::finding::{FindingSubject, Severity};
use crate::profile::uds_names;
use crate::query::record;
use crate::rules::rule::declare_rule;
use crate::rules::{Rule, RuleContext, RulePolicy};

declare_rule! {
    /// # What it checks
    /// A server sends a negative response. It is a warning if the request writes, starts, transfers, clears
    /// or resets something, or if the server refuses a session or security access twice in a row, otherwise a
    /// note. A read of a service, sub-function or identifier that the server does not support is exempt, and so
    /// is "response pending" (78).
    ///
    /// # Why it matters
    /// The setting, routine or download has no effect, regardless of the display of the tester.
    ///
    /// # Source
    /// ISO 14229-1 §8.7 and Annex A.1 (negative response codes)
    ///
    /// # What to look at first
    /// Check session and security access before the request. Check the length of the request and the
    /// conditions in the device manual.
    ///
    /// # Mutation
    /// replace the response to a write by a negative response
    "uds-negative", Warning, "UDS request refused",
    kinds: [Kind::UdsExchange],
    needs: "a UDS request with a response",
    word: "UDS",
}

/// Codes for an unsupported service, sub-function or identifier, in general or in this session.
const NOT_THERE: [u8; 5] = [0x11, 0x12, 0x31, 0x7E, 0x7F];

/// Code for an unsupported service; exempt also for services that change something.
const NO_SERVICE: u8 = 0x11;

/// Services that change something: reset, clear, write, control, routine and transfer services.
const CHANGES: [u8; 10] = [0x11, 0x14, 0x2E, 0x2F, 0x31, 0x34, 0x36, 0x37, 0x38, 0x3D];

/// Services that all later steps of a tester need: diagnostic session control, security access.
const PREREQUISITES: [u8; 2] = [0x10, 0x27];

/// Security access.
const SECURITY: u8 = 0x27;

/// Refusals in a row of such a service after which a tester does not get on.
const REPEATED: u32 = 2;

/// Most servers whose refusals are counted.
const COUNTED: usize = 256;

#[derive(Default)]
struct UdsNegative {
    /// Refusals in a row of a service by a server.
    refusals: HashMap<Arc<str>, u32>,
}

fn new(_policy: &RulePolicy) -> UdsNegative {
    UdsNegative::default()
}

impl UdsNegative {
    /// Counts a response to a service that later steps need; whether the server refuses it again and again.
    fn is_refused_again(&mut self, event: &Event, exchange: &UdsExchange, is_refused: bool) -> bool {
        if !PREREQUISITES.contains(&exchange.service) {
            return false;
        }
        let subject = exchange_subject(event, exchange);
        if !is_refused {
            // A seed (odd sub-function of security access) does not open anything yet.
            let is_seed = exchange.service == SECURITY
                && exchange.sub_function.as_ref().is_some_and(|sub| sub.value % 2 == 1);
            if !is_seed {
                self.refusals.remove(&subject);
            }
            return false;
        }
        if self.refusals.len() >= COUNTED && !self.refusals.contains_key(&subject) {
            return false;
        }
        let count = self.refusals.entry(subject).or_default();
        *count = count.saturating_add(1);
        *count >= REPEATED
    }
}

/// `20: 2E 0102`: server, service, identifier. The server is omitted if the finding has a node.
pub(in crate::rules::general) fn exchange_subject(event: &Event, exchange: &UdsExchange) -> Arc<str> {
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

/// Name of a service, or `service` if unknown.
pub(super) fn service_name(service: u8) -> &'static str {
    uds_names().service_by_id(service).map_or("service", |known| known.name.as_str())
}

impl Rule for UdsNegative {
    fn on_event(&mut self, event: &Event, context: &mut RuleContext<'_>) {
        let EventKind::UdsExchange(exchange) = &event.kind else { return };
        let code = match (exchange.outcome, exchange.nrc) {
            (ExchangeOutcome::Positive, _) => {
                self.is_refused_again(event, exchange, false);
                return context.count_pass();
            }
            (ExchangeOutcome::Negative, Some(code)) => code,
            _ => return,
        };
        let is_again = self.is_refused_again(event, exchange, true);
        let changes = CHANGES.contains(&exchange.service) || is_again;
        if code == NO_SERVICE || !changes && NOT_THERE.contains(&code) {
            return;
        }
        let severity = if changes { Severity::Warning } else { Severity::Note };
        let own = record::event_device(event, context.bus).uds.response_code_entry(
            code,
            exchange.service,
            exchange.identifier,
        );
        let own = own.map(|own| own.text.clone());
        let about = FindingSubject::Name(exchange_subject(event, exchange));
        let alarm = context.start_finding(event).with_subject(about).with_severity(severity);
        alarm.report_finding(|| {
            let text = uds_names().code_entry(code).map_or("unknown code", |known| known.text.as_str());
            format!(
                "{} refused: {code:02X} {}",
                service_name(exchange.service),
                own.as_deref().unwrap_or(text)
            )
        });
    }
}
