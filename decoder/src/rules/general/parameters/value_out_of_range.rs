//! Values outside the range that the manual permits.

use std::sync::Arc;

use crate::event::{
    DecodedPdo, Event, EventKind, ExchangeOutcome, Kind, SdoDirection, SdoOutcome, SdoTransfer, UdsExchange,
};
use crate::finding::FindingSubject;
use crate::profile::{
    DecodedValue, IntegerPosition, LayoutOrigin, ObjectMeaning, ObjectRole, PayloadLayout, SignalField,
    SignalId,
};
use crate::rules::context::MAPPING_ASSUMED;
use crate::rules::general::uds::uds_negative::exchange_subject;
use crate::rules::rule::declare_rule;
use crate::rules::{BySlot, FrameNeed, PdoSubset, Rule, RuleContext, RulePolicy};
use crate::session::Node;
use crate::wire::canopen::ObjectAddress;

declare_rule! {
    /// # What it checks
    /// A value accepted or sent by SDO or UDS, or sent in a PDO, is outside the range in the device manual. PDO
    /// values are checked when the payload changes. With the default mapping of the profile, if the length fits
    /// it, set points and states are checked with a lower severity. Values that depend on an assumed scale or
    /// mode are exempt, and so are counts of the error history (1003:00), whose range applies to writes only.
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
    pdos: PdoSubset::Changed,
    needs: "a value of an object with a range in the profile or EDS",
    word: "RANGE",
}

/// Fields of a layout with a range.
#[derive(Default)]
struct RangedFields {
    layout: Option<Arc<PayloadLayout>>,
    fields: Vec<FieldRange>,
    /// Bits of these fields in the first eight bytes.
    bits: u64,
    /// One of them is a measured value, which changes all the time.
    is_measured: bool,
    /// All values of the last PDO were in range.
    is_right: bool,
    /// Assumption on which the mapping depends.
    assumed: Option<&'static str>,
}

/// Field with a range.
struct FieldRange {
    /// Index of the field in the layout.
    field: usize,
    /// Position of the raw number, and its permitted range.
    inside: Option<(IntegerPosition, [i64; 2])>,
}

#[derive(Default)]
struct ValueOutOfRange {
    checked: BySlot<RangedFields>,
}

fn new(_policy: &RulePolicy) -> ValueOutOfRange {
    ValueOutOfRange::default()
}

impl ValueOutOfRange {
    fn on_pdo(&mut self, event: &Event, pdo: &DecodedPdo, context: &mut RuleContext<'_>) {
        let (Some(layout), Some(slot)) = (&pdo.layout, context.traffic.current_slot()) else { return };
        let Some(checked) = self.checked.entry_of(slot) else { return };
        if checked.layout.as_ref().is_none_or(|known| !Arc::ptr_eq(known, layout)) {
            checked.learn_ranges(layout, pdo.length, context.event_node(event));
            context.ask_again();
        }
        if checked.fields.is_empty() {
            return;
        }
        let payload = pdo.payload();
        let mut is_right = true;
        let word = pdo.first_word();
        for range in &checked.fields {
            if range.has_number(word, payload.len()) {
                continue;
            }
            let Some(field) = layout.fields.get(range.field) else { continue };
            let (Some(meaning), Some(raw)) = (&field.meaning, field.extract_bits(payload)) else { continue };
            let value = field.convert_raw(raw);
            if meaning.is_outside(&value) {
                is_right = false;
                report_value(event, (meaning, &value), (&pdo.name.to_string(), checked.assumed), context);
            }
        }
        if std::mem::replace(&mut checked.is_right, is_right) != is_right {
            context.ask_again();
        }
        if is_right {
            context.count_pass();
        }
    }
}

impl FieldRange {
    fn new(place: usize, field: &SignalField) -> Self {
        let inside = field.meaning.as_deref().and_then(ObjectMeaning::permitted_range);
        Self { field: place, inside: IntegerPosition::position_of(field).zip(inside) }
    }

    /// Whether the raw number in a payload is within the range; false if unknown.
    #[inline]
    fn has_number(&self, word: u64, length: usize) -> bool {
        self.inside.is_some_and(|(cut, [least, most])| {
            cut.number(word, length).is_some_and(|number| (least..=most).contains(&number))
        })
    }
}

impl RangedFields {
    #[cold]
    fn learn_ranges(&mut self, layout: &Arc<PayloadLayout>, length: u8, node: Option<&Node>) {
        // Another length disproves a default mapping.
        let is_default = layout.origin == LayoutOrigin::Profile && layout.bits == u16::from(length) * 8;
        self.assumed = layout.assumed.then_some(MAPPING_ASSUMED);
        let is_measured = |field: &SignalField| {
            field.meaning.as_ref().is_some_and(|it| it.role == Some(ObjectRole::Actual))
        };
        let fields = layout.fields.iter().enumerate().filter(|(_, field)| {
            (!layout.assumed || is_default && !is_measured(field))
                && matches!(field.id, SignalId::Object(_))
                && field.meaning.as_deref().is_some_and(|meaning| has_confirmed_range(meaning, node))
        });
        self.fields = fields.map(|(place, field)| FieldRange::new(place, field)).collect();
        let ranged = self.fields.iter().filter_map(|range| layout.fields.get(range.field));
        self.is_measured = ranged.clone().any(is_measured);
        self.bits = ranged.fold(0, |bits, field| bits | field.payload_bits());
        self.layout = Some(Arc::clone(layout));
    }
}

/// Whether a field has a range without assumptions. A raw range is independent of the scale, but not of the
/// mode.
fn has_confirmed_range(meaning: &ObjectMeaning, node: Option<&Node>) -> bool {
    if !meaning.assumed || !has_range(meaning) {
        return has_range(meaning);
    }
    let found = node.and_then(|node| node.device().dictionary.find_object(meaning.object));
    let entry = found.and_then(|found| found.entry);
    meaning.limits.is_none() && entry.is_some_and(|entry| entry.modes.is_empty())
}

fn has_range(meaning: &ObjectMeaning) -> bool {
    meaning.range.is_some() || meaning.limits.is_some()
}

/// Whether a range limits only what may be written: 0 to 1003:00 clears the history (CiA 301 §7.5.2.4).
fn is_for_writes(object: ObjectAddress) -> bool {
    object == ObjectAddress::new(0x1003, 0)
}

fn on_transfer(event: &Event, transfer: &SdoTransfer, context: &mut RuleContext<'_>) {
    let (Some(direction), Some(object)) = (transfer.direction, transfer.object) else { return };
    let is_read = direction == SdoDirection::Upload;
    let is_whole = transfer.outcome == SdoOutcome::Complete && !transfer.truncated;
    if !is_whole || is_read && (transfer.cut_start || is_for_writes(object)) {
        return;
    }
    let node = context.event_node(event);
    let meaning = transfer.meaning.as_ref().filter(|meaning| has_confirmed_range(meaning, node));
    let Some(meaning) = meaning else { return };
    let value = meaning.decode(&transfer.data);
    if meaning.is_outside(&value) {
        let by = if is_read { "SDO upload" } else { "SDO" };
        report_value(event, (meaning, &value), (by, None), context);
    } else {
        context.count_pass();
    }
}

fn on_exchange(event: &Event, exchange: &UdsExchange, context: &mut RuleContext<'_>) {
    let meaning = exchange.meaning.as_ref().filter(|meaning| !meaning.assumed && has_range(meaning));
    let is_positive = exchange.outcome == ExchangeOutcome::Positive;
    let (Some(meaning), Some(value), true) = (meaning, exchange.decoded_value(), is_positive) else { return };
    if !meaning.is_outside(&value) {
        return context.count_pass();
    }
    let alarm =
        context.start_finding(event).with_subject(FindingSubject::Name(exchange_subject(event, exchange)));
    alarm.report_finding(|| out_of_range(meaning, &value, "UDS"));
}

#[cold]
fn report_value(
    event: &Event,
    (meaning, value): (&ObjectMeaning, &DecodedValue),
    (by, assumed): (&str, Option<&'static str>),
    context: &mut RuleContext<'_>,
) {
    let alarm = context.start_finding(event).with_subject(FindingSubject::Object(meaning.object));
    alarm.with_assumption(assumed).report_finding(|| out_of_range(meaning, value, by));
}

/// `500 bar by SDO out of range 1 to 450 bar (raw 500)`
fn out_of_range(meaning: &ObjectMeaning, value: &DecodedValue, by: &str) -> String {
    let permitted = match (meaning.range, meaning.limits) {
        (_, Some([least, most])) => format!("{least} to {most} {}", meaning.unit),
        (Some([least, most]), None) => format!("{least} to {most} raw"),
        (None, None) => String::new(),
    };
    let (shown, permitted) = (meaning.format_value(value), permitted.trim_end());
    format!("{shown} by {by} out of range {permitted} (raw {value})")
}

impl Rule for ValueOutOfRange {
    fn frame_need(&self, event: &Event, context: &RuleContext<'_>) -> FrameNeed {
        let EventKind::Pdo(pdo) = &event.kind else { return FrameNeed::EACH };
        if pdo.layout.is_none() {
            return FrameNeed::NOTHING;
        }
        let checked = context.traffic.current_slot().and_then(|slot| self.checked.get(slot.place));
        match checked {
            Some(checked) if checked.layout.is_none() => FrameNeed::EACH,
            Some(checked) if checked.fields.is_empty() => FrameNeed::NOTHING,
            // The events alone cost less than the other rules at most of them.
            Some(checked) if checked.is_measured => FrameNeed::EACH,
            Some(checked) if checked.is_right => FrameNeed { bits: checked.bits, ..FrameNeed::PASSED },
            _ => FrameNeed::EACH,
        }
    }

    #[inline]
    fn on_event(&mut self, event: &Event, context: &mut RuleContext<'_>) {
        match &event.kind {
            EventKind::Pdo(pdo) => self.on_pdo(event, pdo, context),
            EventKind::SdoTransfer(transfer) => on_transfer(event, transfer, context),
            EventKind::UdsExchange(exchange) => on_exchange(event, exchange, context),
            _ => {}
        }
    }
}
