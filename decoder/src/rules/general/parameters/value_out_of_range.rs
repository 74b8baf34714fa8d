//! A value lies outside what the manual permits.

use std::sync::Arc;

use crate::event::{Direction, Event, EventKind, Outcome, Pdo, SdoTransfer};
use crate::finding::About;
use crate::profile::{Cut, Field, Layout, Meaning, SignalId, Value};
use crate::rules::rule::declare_rule;
use crate::rules::{BySlot, Context, Policy, Rule};
use crate::session::Node;

declare_rule! {
    /// # What it checks
    /// A value written by SDO and accepted, or sent in a PDO, lies outside the range the device's manual gives. Values
    /// in PDOs are looked at when the payload changes. What rests on an assumption (a mapping, a scale or a mode that
    /// was not seen) is not judged.
    ///
    /// # Why it matters
    /// Devices clip such values, ignore them, or report an error later: none of it is what was meant.
    ///
    /// # Source
    /// Ranges of the device's manual, or of its device file.
    ///
    /// # What to look at first
    /// Scale and byte order of the value in the controller; which mode the device is in.
    ///
    /// # Mutation
    /// set the first set point of an RPDO to its largest raw number
    "value-out-of-range", Warning, "a value lies outside what the manual permits",
    kinds: ["pdo-mapped-changed", "sdo-transfer"],
    word: "RANGE",
}

/// Fields of a layout that have a range.
#[derive(Default)]
struct Checked {
    layout: Option<Arc<Layout>>,
    fields: Vec<Range>,
}

/// A field with a range.
struct Range {
    /// Its place in the layout.
    field: usize,
    /// Where its number lies, and between which numbers nothing is wrong.
    inside: Option<(Cut, [i64; 2])>,
}

#[derive(Default)]
struct ValueOutOfRange {
    checked: BySlot<Checked>,
}

fn new(_policy: &Policy) -> ValueOutOfRange {
    ValueOutOfRange::default()
}

impl ValueOutOfRange {
    fn pdo(&mut self, event: &Event, pdo: &Pdo, context: &mut Context<'_>) {
        let (Some(layout), Some(slot)) = (&pdo.layout, context.traffic.current()) else { return };
        let Some(checked) = self.checked.of(slot) else { return };
        if checked.layout.as_ref().is_none_or(|known| !Arc::ptr_eq(known, layout)) {
            checked.learn(layout, context.node(event));
        }
        if checked.fields.is_empty() {
            return;
        }
        let payload = pdo.payload();
        let mut is_right = true;
        let word = pdo.word();
        for range in &checked.fields {
            if range.has(word, payload.len()) {
                continue;
            }
            let Some(field) = layout.fields.get(range.field) else { continue };
            let (Some(meaning), Some(raw)) = (&field.meaning, field.extract(payload)) else { continue };
            let value = field.value(raw);
            if meaning.is_outside(&value) {
                is_right = false;
                tell(event, meaning, &value, &pdo.name.to_string(), context);
            }
        }
        if is_right {
            context.pass();
        }
    }
}

impl Range {
    fn new(place: usize, field: &Field) -> Self {
        let inside = field.meaning.as_deref().and_then(Meaning::inside);
        Self { field: place, inside: Cut::of(field).zip(inside) }
    }

    /// Whether the number in a payload surely is inside.
    #[inline]
    fn has(&self, word: u64, length: usize) -> bool {
        self.inside.is_some_and(|(cut, [least, most])| {
            cut.number(word, length).is_some_and(|number| (least..=most).contains(&number))
        })
    }
}

impl Checked {
    #[cold]
    fn learn(&mut self, layout: &Arc<Layout>, node: Option<&Node>) {
        let fields = layout.fields.iter().enumerate().filter(|(_, field)| {
            !layout.assumed
                && matches!(field.id, SignalId::Object(_))
                && field.meaning.as_deref().is_some_and(|meaning| is_sure(meaning, node))
        });
        self.fields = fields.map(|(place, field)| Range::new(place, field)).collect();
        self.layout = Some(Arc::clone(layout));
    }
}

/// Whether it has a range that rests on nothing assumed: a range of raw numbers holds under any scale, but not
/// in any mode.
fn is_sure(meaning: &Meaning, node: Option<&Node>) -> bool {
    if !meaning.assumed || !has_range(meaning) {
        return has_range(meaning);
    }
    let found = node.and_then(|node| node.device().dictionary.find(meaning.object));
    let entry = found.and_then(|found| found.entry);
    meaning.limits.is_none() && entry.is_some_and(|entry| entry.modes.is_empty())
}

fn has_range(meaning: &Meaning) -> bool {
    meaning.range.is_some() || meaning.limits.is_some()
}

fn written(event: &Event, transfer: &SdoTransfer, context: &mut Context<'_>) {
    let SdoTransfer { direction: Some(Direction::Download), outcome: Outcome::Complete, .. } = transfer
    else {
        return;
    };
    let node = context.node(event);
    let meaning = transfer.meaning.as_ref().filter(|meaning| is_sure(meaning, node) && !transfer.truncated);
    let Some(meaning) = meaning else { return };
    let value = meaning.decode(&transfer.data);
    if meaning.is_outside(&value) {
        tell(event, meaning, &value, "SDO", context);
    } else {
        context.pass();
    }
}

#[cold]
fn tell(event: &Event, meaning: &Meaning, value: &Value, by: &str, context: &mut Context<'_>) {
    let alarm = context.fail(event).about(About::Object(meaning.object));
    alarm.say(|| {
        let permitted = match (meaning.range, meaning.limits) {
            (_, Some([least, most])) => format!("{least} to {most} {}", meaning.unit),
            (Some([least, most]), None) => format!("{least} to {most} raw"),
            (None, None) => String::new(),
        };
        let (name, shown, permitted) = (&meaning.name, meaning.show(value), permitted.trim_end());
        format!("{name} {shown} (raw {value}) by {by}, permitted {permitted}")
    });
}

impl Rule for ValueOutOfRange {
    #[inline]
    fn event(&mut self, event: &Event, context: &mut Context<'_>) {
        match &event.kind {
            EventKind::Pdo(pdo) => self.pdo(event, pdo, context),
            EventKind::SdoTransfer(transfer) => written(event, transfer, context),
            _ => {}
        }
    }
}
