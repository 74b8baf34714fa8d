//! A J1939 device sends an error instead of a value.

use std::sync::Arc;

use crate::event::{Event, EventKind, J1939Message};
use crate::finding::{About, Severity};
use crate::profile::{Field, Value};
use crate::rules::rule::declare_rule;
use crate::rules::{Context, Policy, Rule};
use crate::wire::NodeId;

declare_rule! {
    /// # What it checks
    /// A parameter takes a code of the error range (FE, FE00 to FEFF, for two bits 10). It needs a database or profile
    /// that describes the message. One finding a parameter, until a value comes again. Not available (FF) is none: most
    /// devices fill with it what they do not have.
    ///
    /// # Why it matters
    /// The device has a sensor or function for the value and it fails; who controls by the value has none.
    ///
    /// # Source
    /// SAE J1939-71 §5.1.4, tables 1 and 2 (ranges of the codes)
    ///
    /// # What to look at first
    /// DM1 of the device in that moment; the sensor and its cable.
    ///
    /// # Mutation
    /// set a parameter to FE
    "spn-not-available", Note, "a parameter has no value: error",
    kinds: ["j1939-message"],
    word: "SPN",
}

/// Parameters in error at once.
const BAD_LIMIT: usize = 1024;

/// A parameter in error: its device, its group, its place in the layout.
type Bad = (NodeId, u32, usize);

#[derive(Default)]
struct SpnNotAvailable {
    bad: Vec<Bad>,
}

fn new(_policy: &Policy) -> SpnNotAvailable {
    SpnNotAvailable::default()
}

/// What a parameter is called.
fn name(field: &Field) -> Arc<str> {
    let id = field.id.to_string();
    let name = field.meaning.as_deref().map_or("", |meaning| meaning.name.as_str());
    match (id.is_empty(), name.is_empty()) {
        (true, _) => name.into(),
        (false, true) => id.into(),
        (false, false) => format!("{id} {name}").into(),
    }
}

impl SpnNotAvailable {
    fn message(&mut self, event: &Event, node: NodeId, message: &J1939Message, context: &mut Context<'_>) {
        let Some(layout) = message.layout.as_deref() else { return };
        let pgn = message.id.pgn.number();
        let mut judged = false;
        for (place, field) in layout.fields.iter().enumerate() {
            let indicators = field.meaning.as_deref().and_then(|meaning| meaning.indicators);
            let (Some(indicators), Some(raw)) = (indicators, field.extract(message.payload())) else {
                continue;
            };
            // A multiplexed one may be another parameter now.
            if field.present.is_some() || !matches!(field.value(raw), Value::Unsigned(_)) {
                continue;
            }
            judged = true;
            let known = self.bad.iter().position(|bad| *bad == (node, pgn, place));
            match (indicators.label(raw), known) {
                (Some("error"), None) if self.bad.len() < BAD_LIMIT => {
                    self.bad.push((node, pgn, place));
                    let about = About::Name(name(field));
                    let alarm = context.fail(event).about(about).severity(Severity::Note).ongoing();
                    alarm.say(|| {
                        format!("sends {raw:X}, error, instead of a value in group {}", message.id.pgn)
                    });
                }
                (Some("error"), _) | (_, None) => {}
                (_, Some(known)) => {
                    self.bad.swap_remove(known);
                    context.close(Some(node), About::Name(name(field)));
                }
            }
        }
        if judged && self.bad.is_empty() {
            context.pass();
        }
    }
}

impl Rule for SpnNotAvailable {
    fn event(&mut self, event: &Event, context: &mut Context<'_>) {
        // What repeats itself was looked at when it came first.
        if let (EventKind::J1939Message(message), Some(node), false) =
            (&event.kind, event.node, event.routine)
        {
            self.message(event, node, message, context);
        }
    }
}
