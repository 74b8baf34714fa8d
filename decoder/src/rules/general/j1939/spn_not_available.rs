//! Error indicators instead of values in J1939 messages.

use std::sync::Arc;

use crate::event::{Event, EventKind, J1939Message};
use crate::finding::{About, Severity};
use crate::profile::{Field, IndicatorCoding, Value};
use crate::rules::rule::declare_rule;
use crate::rules::{Context, Need, Policy, Rule};
use crate::wire::NodeId;

declare_rule! {
    /// # What it checks
    /// A parameter of a message in a database or profile has the value of the error indicator (FE, FE00 to
    /// FEFF, 10 for two bits). There is one finding per parameter, open until the next valid value. Not
    /// available (FF) is exempt.
    ///
    /// # Why it matters
    /// A sensor or function of the device has failed. Controllers that depend on the value have no input.
    ///
    /// # Source
    /// SAE J1939-71 §5.1.4, tables 1 and 2 (ranges of the codes)
    ///
    /// # What to look at first
    /// Check the sensor and its cable. Look at DM1 of the device at that time.
    ///
    /// # Mutation
    /// set a parameter to FE
    "spn-not-available", Note, "error indicator instead of a value",
    kinds: ["j1939-message"],
    needs: "a message of a database or profile",
    word: "SPN",
}

/// Maximum number of parameters with an error.
const BAD_LIMIT: usize = 1024;

/// Parameter with an error: device, group, index in the layout.
type ParameterKey = (NodeId, u32, usize);

#[derive(Default)]
struct SpnNotAvailable {
    bad: Vec<ParameterKey>,
}

fn new(_policy: &Policy) -> SpnNotAvailable {
    SpnNotAvailable::default()
}

/// Name of a parameter.
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
            // NMEA 2000 does not state that its code is an error of the sensor.
            let indicators = indicators.filter(|it| it.coding == IndicatorCoding::J1939);
            let (Some(indicators), Some(raw)) = (indicators, field.extract(message.payload())) else {
                continue;
            };
            // A multiplexed field may contain another parameter.
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
                    alarm.report(|| format!("error indicator {raw:X} in PGN {}", message.id.pgn));
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
    fn need(&self, _event: &Event, _context: &Context<'_>) -> Need {
        Need { bits: u64::MAX, ..Need::NOTHING }
    }

    fn event(&mut self, event: &Event, context: &mut Context<'_>) {
        // Repeated messages were checked at their first occurrence.
        if let (EventKind::J1939Message(message), Some(node), false) =
            (&event.kind, event.node, event.routine)
        {
            self.message(event, node, message, context);
        }
    }
}
