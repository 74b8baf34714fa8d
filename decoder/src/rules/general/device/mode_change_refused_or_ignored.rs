//! Writes of a mode of operation without effect.

use crate::event::{Direction, Event, EventKind, Kind, Outcome, SdoTransfer};
use crate::finding::{About, Severity};
use crate::profile::{Effect, Role, abort_codes};
use crate::rules::rule::declare_rule;
use crate::rules::{Context, Policy, Rule};
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

struct ModeChange;

fn new(_policy: &Policy) -> ModeChange {
    ModeChange
}

impl Rule for ModeChange {
    fn event(&mut self, event: &Event, context: &mut Context<'_>) {
        let EventKind::SdoTransfer(transfer) = &event.kind else { return };
        let (Some(Direction::Download), Some(object)) = (transfer.direction, transfer.object) else { return };
        let Some(node) = context.node(event) else { return };
        let meaning = node.meaning(object).filter(|meaning| meaning.role == Some(Role::Mode));
        let Some(meaning) = meaning else { return };
        let entry = node.device().dictionary.find(object).and_then(|found| found.entry);
        let is_ignored = entry.is_some_and(|entry| entry.effect == Effect::Never);
        let shown = meaning.show(&meaning.decode(&transfer.data));
        let states: Vec<_> = node
            .device_states()
            .filter(|(channel, _)| channel.is_none() || *channel == meaning.channel)
            .map(|(_, state)| state.name.as_str())
            .collect();
        let state = if states.is_empty() { String::new() } else { format!(" in {}", states.join(", ")) };
        match (transfer.outcome, is_ignored) {
            (Outcome::Aborted, _) => refused(event, transfer, object, &format!("{shown}{state}"), context),
            (Outcome::Complete, true) => {
                let alarm = context.fail(event).about(About::Object(object)).severity(Severity::Warning);
                alarm.report(|| {
                    format!("{shown} accepted without effect (the object does not select a mode)")
                });
            }
            (Outcome::Complete, false) => context.pass(),
            _ => {}
        }
    }
}

fn refused(
    event: &Event,
    transfer: &SdoTransfer,
    object: ObjectAddress,
    what: &str,
    context: &mut Context<'_>,
) {
    let Some(abort) = transfer.abort.filter(|abort| !abort.by_client) else { return };
    let device = context.node(event).map(|node| node.device().clone());
    context.fail(event).about(About::Object(object)).report(|| {
        let own = device.as_ref().and_then(|device| device.abort(abort.code, Some(object)));
        let text = own.map_or_else(|| abort_codes().text(abort.code).to_owned(), |own| own.text.clone());
        format!("{what} refused: {:08X} {text}", abort.code)
    });
}
