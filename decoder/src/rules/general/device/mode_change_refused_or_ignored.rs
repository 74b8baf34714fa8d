//! Writes of a mode of operation without effect.

use crate::event::{Event, EventKind, Kind, SdoDirection, SdoOutcome, SdoTransfer};
use crate::finding::{FindingSubject, Severity};
use crate::profile::{ObjectRole, WriteEffect, abort_codes};
use crate::rules::rule::declare_rule;
use crate::rules::{Rule, RuleContext, RulePolicy};
use crate::wire::canopen::ObjectAddress;

declare_rule! {
    /// # What it checks
    /// A device refuses a download that selects a mode of operation, or accepts it although the write has no
    /// effect according to its manual.
    ///
    /// # Why it matters
    /// The controller scales its values for an inactive mode, so numbers have another meaning.
    ///
    /// # Source
    /// Object for the mode, and states in which it may be written: device manual.
    ///
    /// # What to look at first
    /// Check the device state before the write of the mode. Many devices change the mode only while they are
    /// not active.
    ///
    /// # Mutation
    /// respond to the download of a mode with an abort
    "mode-change-refused-or-ignored", Error, "mode change refused or ignored",
    kinds: [Kind::SdoTransfer],
    needs: "a write to the mode of operation of the profile",
    word: "MODE",
}

struct PendingModeChange;

fn new(_policy: &RulePolicy) -> PendingModeChange {
    PendingModeChange
}

impl Rule for PendingModeChange {
    fn on_event(&mut self, event: &Event, context: &mut RuleContext<'_>) {
        let EventKind::SdoTransfer(transfer) = &event.kind else { return };
        let (Some(SdoDirection::Download), Some(object)) = (transfer.direction, transfer.object) else {
            return;
        };
        let Some(node) = context.event_node(event) else { return };
        let meaning = node.meaning(object).filter(|meaning| meaning.role == Some(ObjectRole::Mode));
        let Some(meaning) = meaning else { return };
        let entry = node.device().dictionary.find_object(object).and_then(|found| found.entry);
        let is_ignored = entry.is_some_and(|entry| entry.effect == WriteEffect::Never);
        let shown = meaning.format_value(&meaning.decode(&transfer.data));
        let states: Vec<_> = node
            .device_states()
            .filter(|(channel, _)| channel.is_none() || *channel == meaning.channel)
            .map(|(_, state)| state.name.as_str())
            .collect();
        let state = if states.is_empty() { String::new() } else { format!(" in {}", states.join(", ")) };
        match (transfer.outcome, is_ignored) {
            (SdoOutcome::Aborted, _) => {
                report_refused(event, transfer, object, &format!("{shown}{state}"), context);
            }
            (SdoOutcome::Complete, true) => {
                let alarm = context
                    .start_finding(event)
                    .with_subject(FindingSubject::Object(object))
                    .with_severity(Severity::Warning);
                alarm.report_finding(|| {
                    format!("{shown} accepted without effect (the object does not select a mode)")
                });
            }
            (SdoOutcome::Complete, false) => context.count_pass(),
            _ => {}
        }
    }
}

fn report_refused(
    event: &Event,
    transfer: &SdoTransfer,
    object: ObjectAddress,
    what: &str,
    context: &mut RuleContext<'_>,
) {
    let Some(abort) = transfer.abort.filter(|abort| !abort.by_client) else { return };
    let device = context.event_node(event).map(|node| node.device().clone());
    context.start_finding(event).with_subject(FindingSubject::Object(object)).report_finding(|| {
        let own = device.as_ref().and_then(|device| device.abort_entry(abort.code, Some(object)));
        let text = own.map_or_else(|| abort_codes().code_text(abort.code).to_owned(), |own| own.text.clone());
        format!("{what} refused: {:08X} {text}", abort.code)
    });
}
