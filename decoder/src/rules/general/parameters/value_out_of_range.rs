//! Values outside the range that the manual permits.

use std::sync::Arc;

use crate::event::{
    Direction, Event, EventKind, ExchangeOutcome, Kind, Outcome, Pdo, SdoTransfer, UdsExchange,
};
use crate::finding::About;
use crate::profile::{Field, IntegerPosition, Layout, Meaning, Role, SignalId, Value};
use crate::rules::general::uds::uds_negative::subject;
use crate::rules::rule::declare_rule;
use crate::rules::{BySlot, Context, Need, PdoSubset, Policy, Rule};
use crate::session::Node;
use crate::wire::canopen::ObjectAddress;

declare_rule! {
    /// # What it checks
    /// A value accepted or sent by SDO or UDS, or sent in a PDO, is outside the range in the device manual. PDO
    /// values are checked when the payload changes. Values that depend on an assumed mapping, scale or mode are
    /// exempt, and so are counts of the error history (1003:00), whose range applies to writes only.
    ///
    /// # Why it matters
    /// Devices clip such values, ignore them or report an error later.
    ///
    /// # Source
    /// Ranges: device manual or device file.
    ///
    /// # What to look at first
    /// Check scale and byte order of the value in the controller. Check the mode of the device.
    ///
    /// # Mutation
    /// set the first set point of an RPDO to its largest raw number
    "value-out-of-range", Warning, "value outside the permitted range",
    kinds: [Kind::Pdo, Kind::SdoTransfer, Kind::UdsExchange],
    pdos: PdoSubset::MappedChanged,
    needs: "a value of an object with a range in the profile or EDS",
    word: "RANGE",
}

/// Fields of a layout with a range.
#[derive(Default)]
struct RangedFields {
    layout: Option<Arc<Layout>>,
    fields: Vec<Range>,
    /// Bits of these fields in the first eight bytes.
    bits: u64,
    /// One of them is a measured value, which changes all the time.
    is_measured: bool,
    /// All values of the last PDO were in range.
    is_right: bool,
}

/// Field with a range.
struct Range {
    /// Index of the field in the layout.
    field: usize,
    /// Position of the raw number, and its permitted range.
    inside: Option<(IntegerPosition, [i64; 2])>,
}

#[derive(Default)]
struct ValueOutOfRange {
    checked: BySlot<RangedFields>,
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
            context.ask_again();
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
                report_value(event, meaning, &value, &pdo.name.to_string(), context);
            }
        }
        if std::mem::replace(&mut checked.is_right, is_right) != is_right {
            context.ask_again();
        }
        if is_right {
            context.pass();
        }
    }
}

impl Range {
    fn new(place: usize, field: &Field) -> Self {
        let inside = field.meaning.as_deref().and_then(Meaning::inside);
        Self { field: place, inside: IntegerPosition::of(field).zip(inside) }
    }

    /// Whether the raw number in a payload is within the range; false if unknown.
    #[inline]
    fn has(&self, word: u64, length: usize) -> bool {
        self.inside.is_some_and(|(cut, [least, most])| {
            cut.number(word, length).is_some_and(|number| (least..=most).contains(&number))
        })
    }
}

impl RangedFields {
    #[cold]
    fn learn(&mut self, layout: &Arc<Layout>, node: Option<&Node>) {
        let fields = layout.fields.iter().enumerate().filter(|(_, field)| {
            !layout.assumed
                && matches!(field.id, SignalId::Object(_))
                && field.meaning.as_deref().is_some_and(|meaning| has_confirmed_range(meaning, node))
        });
        self.fields = fields.map(|(place, field)| Range::new(place, field)).collect();
        let ranged = self.fields.iter().filter_map(|range| layout.fields.get(range.field));
        let is_measured =
            |field: &Field| field.meaning.as_ref().is_some_and(|it| it.role == Some(Role::Actual));
        self.is_measured = ranged.clone().any(is_measured);
        self.bits = ranged.fold(0, |bits, field| bits | field.payload_bits());
        self.layout = Some(Arc::clone(layout));
    }
}

/// Whether a field has a range without assumptions. A raw range is independent of the scale, but not of the
/// mode.
fn has_confirmed_range(meaning: &Meaning, node: Option<&Node>) -> bool {
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

/// Whether a range limits only what may be written: 0 to 1003:00 clears the history (CiA 301 §7.5.2.4).
fn is_for_writes(object: ObjectAddress) -> bool {
    object == ObjectAddress::new(0x1003, 0)
}

fn transferred(event: &Event, transfer: &SdoTransfer, context: &mut Context<'_>) {
    let (Some(direction), Some(object)) = (transfer.direction, transfer.object) else { return };
    let is_read = direction == Direction::Upload;
    let is_whole = transfer.outcome == Outcome::Complete && !transfer.truncated;
    if !is_whole || is_read && (transfer.cut_start || is_for_writes(object)) {
        return;
    }
    let node = context.node(event);
    let meaning = transfer.meaning.as_ref().filter(|meaning| has_confirmed_range(meaning, node));
    let Some(meaning) = meaning else { return };
    let value = meaning.decode(&transfer.data);
    if meaning.is_outside(&value) {
        let by = if is_read { "SDO upload" } else { "SDO" };
        report_value(event, meaning, &value, by, context);
    } else {
        context.pass();
    }
}

fn exchanged(event: &Event, exchange: &UdsExchange, context: &mut Context<'_>) {
    let meaning = exchange.meaning.as_ref().filter(|meaning| !meaning.assumed && has_range(meaning));
    let is_positive = exchange.outcome == ExchangeOutcome::Positive;
    let (Some(meaning), Some(value), true) = (meaning, exchange.decoded(), is_positive) else { return };
    if !meaning.is_outside(&value) {
        return context.pass();
    }
    let alarm = context.fail(event).about(About::Name(subject(event, exchange)));
    alarm.report(|| out_of_range(meaning, &value, "UDS"));
}

#[cold]
fn report_value(event: &Event, meaning: &Meaning, value: &Value, by: &str, context: &mut Context<'_>) {
    let alarm = context.fail(event).about(About::Object(meaning.object));
    alarm.report(|| out_of_range(meaning, value, by));
}

/// `500 bar by SDO out of range 1 to 450 bar (raw 500)`
fn out_of_range(meaning: &Meaning, value: &Value, by: &str) -> String {
    let permitted = match (meaning.range, meaning.limits) {
        (_, Some([least, most])) => format!("{least} to {most} {}", meaning.unit),
        (Some([least, most]), None) => format!("{least} to {most} raw"),
        (None, None) => String::new(),
    };
    let (shown, permitted) = (meaning.show(value), permitted.trim_end());
    format!("{shown} by {by} out of range {permitted} (raw {value})")
}

impl Rule for ValueOutOfRange {
    fn need(&self, event: &Event, context: &Context<'_>) -> Need {
        let EventKind::Pdo(_) = &event.kind else { return Need::EACH };
        let checked = context.traffic.current().and_then(|slot| self.checked.get(slot.place));
        match checked {
            Some(checked) if checked.layout.is_none() => Need::EACH,
            Some(checked) if checked.fields.is_empty() => Need::NOTHING,
            // The events alone cost less than the other rules at most of them.
            Some(checked) if checked.is_measured => Need::EACH,
            Some(checked) if checked.is_right => Need { bits: checked.bits, ..Need::PASSED },
            _ => Need::EACH,
        }
    }

    #[inline]
    fn event(&mut self, event: &Event, context: &mut Context<'_>) {
        match &event.kind {
            EventKind::Pdo(pdo) => self.pdo(event, pdo, context),
            EventKind::SdoTransfer(transfer) => transferred(event, transfer, context),
            EventKind::UdsExchange(exchange) => exchanged(event, exchange, context),
            _ => {}
        }
    }
}
