//! LSS: the order of its messages, and refused settings.

use std::sync::Arc;

use crate::event::{Event, EventKind};
use crate::finding::About;
use crate::profile::lss;
use crate::rules::rule::declare_rule;
use crate::rules::{Context, Policy, Rule};
use crate::wire::canopen::lss::Content;

declare_rule! {
    /// # What it checks
    /// The four numbers of switch state selective come in order: vendor, product, revision, serial number. A device
    /// does what it is told: node-ID, bit timing, store (result 0).
    ///
    /// # Why it matters
    /// The device keeps its old node-ID or bit rate, or has the new one only until it is switched off.
    ///
    /// # Source
    /// CiA 305 §3.9.2.1 (switch state selective), §3.9.3 (configuration)
    ///
    /// # What to look at first
    /// The result's meaning; whether the device can store.
    ///
    /// # Mutation
    /// change the result of a configuration
    "lss-sequence", Warning, "LSS out of order, or refused",
    kinds: ["lss"],
    word: "LSS",
}

/// First and last number of switch state selective.
const VENDOR: u8 = 0x40;
const SERIAL: u8 = 0x43;

#[derive(Default)]
struct LssSequence {
    /// Next number of switch state selective.
    next: Option<u8>,
}

fn new(_policy: &Policy) -> LssSequence {
    LssSequence::default()
}

impl Rule for LssSequence {
    fn event(&mut self, event: &Event, context: &mut Context<'_>) {
        let EventKind::Lss { command, from_master, content } = &event.kind else { return };
        let command = *command;
        match (*from_master, content) {
            (true, _) if (VENDOR..=SERIAL).contains(&command) => {
                let wanted = self.next.replace(command + 1);
                // A capture may begin within.
                let Some(wanted) = wanted.or_else(|| (command == VENDOR).then_some(VENDOR)) else { return };
                if command == wanted || command == VENDOR {
                    return context.pass();
                }
                let alarm = context.fail(event).about(About::Name(Arc::from("selective")));
                let names = [command, wanted].map(|command| lss().title(command).to_owned());
                alarm.say(|| format!("{} comes, {} is due", names[0], names[1]));
            }
            (true, _) => self.next = None,
            (false, Content::Result { code: 0, .. }) => context.pass(),
            (false, Content::Result { code, specific }) => {
                let alarm = context.fail(event).about(About::Name(Arc::from(lss().service(command))));
                alarm.say(|| {
                    let text = lss().result(command, *code);
                    format!("{}: result {code} {text} ({specific:02X}h)", lss().title(command))
                });
            }
            _ => {}
        }
    }
}
