//! A mode of operation is written and does not change.

use crate::event::{Direction, Event, EventKind, Outcome, SdoTransfer};
use crate::finding::{About, Severity};
use crate::profile::{Effect, Role, abort_codes};
use crate::rules::rule::declare_rule;
use crate::rules::{Context, Policy, Rule};
use crate::wire::canopen::ObjectAddress;

declare_rule! {
    /// # What it checks
    /// A download of an object that selects a mode of operation is refused by the device, or accepted although by
    /// its manual such a write has no effect.
    ///
    /// # Why it matters
    /// The controller scales and sends for a mode the device is not in: a number means something else.
    ///
    /// # Source
    /// Which object selects a mode, and when it may be written: the device's manual.
    ///
    /// # What to look at first
    /// The state the device was in: many take another mode only while they are not active.
    ///
    /// # Mutation
    /// answer the download of a mode with an abort
    "mode-change-refused-or-ignored", Error, "a mode of operation is written and does not change",
    kinds: ["sdo-transfer"],
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
                alarm.say(|| {
                    format!("{shown} accepted without effect: this device takes no mode by this object")
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
    context.fail(event).about(About::Object(object)).say(|| {
        let own = device.as_ref().and_then(|device| device.abort(abort.code, Some(object)));
        let text = own.map_or_else(|| abort_codes().text(abort.code).to_owned(), |own| own.text.clone());
        format!("{what} refused: {:08X} {text}", abort.code)
    });
}
