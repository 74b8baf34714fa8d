//! Services used in NMT state stopped.

use std::sync::Arc;

use crate::event::{Event, EventKind, Kind, SdoOutcome, StateCertainty};
use crate::finding::{FindingSubject, Severity};
use crate::profile::device::NmtName;
use crate::rules::rule::{declare_rule, define_tolerance};
use crate::rules::{Rule, RuleContext, RulePolicy};
use crate::wire::canopen::NmtState;

declare_rule! {
    /// # What it checks
    /// A node that reports stopped, or received the stop command more than `command-ms` ago, must not respond
    /// to SDO requests. An EMCY in this state is a note. `pdo-outside-operational` checks PDOs.
    ///
    /// # Why it matters
    /// A stopped node must not communicate except for NMT and error control. The master cannot rely on a node
    /// that does.
    ///
    /// # Source
    /// CiA 301 §7.3.2.2.5, table 38 (services by NMT state)
    ///
    /// # What to look at first
    /// Check in the manual whether the device supports state stopped.
    ///
    /// # Mutation
    /// insert a command that stops a node while it responds to SDO requests
    "service-in-stopped", Warning, "SDO or EMCY in NMT state stopped",
    kinds: [Kind::SdoTransfer, Kind::Emcy],
    needs: "a node in NMT state stopped",
    cases: &["9.4", "10.4"],
    word: "NMT",
    tolerances: &[define_tolerance("command-ms", 100.0, "ms", "after the command, in which responses are permitted")],
}

struct ServiceInStopped {
    command: i64,
}

fn new(policy: &RulePolicy) -> ServiceInStopped {
    ServiceInStopped { command: policy.tolerance_ns(&DECLARATION, "command-ms") }
}

impl ServiceInStopped {
    /// Whether the node must be stopped by now.
    fn is_stopped(&self, event: &Event, context: &RuleContext<'_>) -> bool {
        let Some(node) = context.event_node(event) else { return false };
        let Some(status) = node.nmt().filter(|status| status.state == NmtState::Stopped) else {
            return false;
        };
        let all = &node.device().nmt.states;
        let since = context.bus.now().saturating_sub(status.changed_at());
        let has_state = all.is_empty() || all.contains(&NmtName::Stopped);
        has_state
            && (since > self.command || !context.has_time && status.certainty == StateCertainty::Confirmed)
    }
}

impl Rule for ServiceInStopped {
    fn on_event(&mut self, event: &Event, context: &mut RuleContext<'_>) {
        match &event.kind {
            EventKind::SdoTransfer(transfer) if self.is_stopped(event, context) => {
                let is_answered = match transfer.outcome {
                    SdoOutcome::Complete => true,
                    SdoOutcome::Aborted => transfer.abort.is_some_and(|abort| !abort.by_client),
                    SdoOutcome::Timeout => false,
                    _ => return,
                };
                if !is_answered {
                    return context.count_pass();
                }
                let object = transfer.object.map_or_else(String::new, |object| format!(" for {object}"));
                let alarm = context.start_finding(event).with_subject(FindingSubject::Name(Arc::from("SDO")));
                alarm.report_finding(|| format!("SDO response{object} in NMT state stopped"));
            }
            EventKind::Emcy(_) if self.is_stopped(event, context) => {
                let alarm = context
                    .start_finding(event)
                    .with_subject(FindingSubject::Name(Arc::from("EMCY")))
                    .with_severity(Severity::Note);
                alarm.report_finding(|| "EMCY in NMT state stopped".to_owned());
            }
            _ => {}
        }
    }
}
