//! Error indicators instead of values in J1939 messages.

use std::sync::Arc;

use crate::event::{Event, EventKind, J1939Message, Kind};
use crate::finding::{FindingSubject, Severity};
use crate::frame::low_bits;
use crate::profile::{
    BitOrder, DecodedValue, IndicatorCode, IndicatorCoding, ParameterIndicators, SignalField,
};
use crate::rules::rule::declare_rule;
use crate::rules::{FrameNeed, Rule, RuleContext, RulePolicy};
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
    kinds: [Kind::J1939Message],
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

fn new(_policy: &RulePolicy) -> SpnNotAvailable {
    SpnNotAvailable::default()
}

/// Name of a parameter.
fn parameter_name(field: &SignalField) -> Arc<str> {
    let id = field.id.to_string();
    let name = field.meaning.as_deref().map_or("", |meaning| meaning.name.as_str());
    match (id.is_empty(), name.is_empty()) {
        (true, _) => name.into(),
        (false, true) => id.into(),
        (false, false) => format!("{id} {name}").into(),
    }
}

/// Parameters of a message that may have an error indicator: index, field, codes, raw value.
fn error_parameters(
    message: &J1939Message,
) -> impl Iterator<Item = (usize, &SignalField, ParameterIndicators, u64)> {
    // A table of a standard does not state which parameters the device has.
    let layout = message.layout.as_deref().filter(|layout| !layout.origin.is_standard_table());
    let fields = layout.into_iter().flat_map(|layout| layout.fields.iter().enumerate());
    fields.filter_map(|(place, field)| {
        let indicators = field.meaning.as_deref()?.indicators;
        // NMEA 2000 does not state that its code is an error of the sensor.
        let indicators = indicators.filter(|it| it.coding == IndicatorCoding::J1939)?;
        let raw = field.extract_bits(message.payload())?;
        // A multiplexed field may contain another parameter.
        let is_number =
            field.present.is_none() && matches!(field.convert_raw(raw), DecodedValue::Unsigned(_));
        is_number.then_some((place, field, indicators, raw))
    })
}

/// Payload bits of a field; all bits if they are not known.
fn bits_of(field: &SignalField) -> u64 {
    let is_within = field.order == BitOrder::LittleEndian && field.bit.saturating_add(field.bits) <= 64;
    let mask = low_bits(u32::from(field.bits)).checked_shl(u32::from(field.bit));
    mask.filter(|_| is_within).unwrap_or(u64::MAX)
}

impl SpnNotAvailable {
    fn on_message(
        &mut self,
        event: &Event,
        node: NodeId,
        message: &J1939Message,
        context: &mut RuleContext<'_>,
    ) {
        let pgn = message.id.pgn.number();
        let mut judged = false;
        let had_errors = !self.bad.is_empty();
        for (place, field, indicators, raw) in error_parameters(message) {
            judged = true;
            let known = self.bad.iter().position(|bad| *bad == (node, pgn, place));
            match (indicators.code(raw), known) {
                (Some(IndicatorCode::Error), None) if self.bad.len() < BAD_LIMIT => {
                    self.bad.push((node, pgn, place));
                    let about = FindingSubject::Name(parameter_name(field));
                    let alarm = context
                        .start_finding(event)
                        .with_subject(about)
                        .with_severity(Severity::Note)
                        .mark_ongoing();
                    alarm.report_finding(|| format!("error indicator {raw:X} in PGN {}", message.id.pgn));
                }
                (Some(IndicatorCode::Error), _) | (_, None) => {}
                (_, Some(known)) => {
                    self.bad.swap_remove(known);
                    context.close_condition(Some(node), FindingSubject::Name(parameter_name(field)));
                }
            }
        }
        if judged && self.bad.is_empty() {
            context.count_pass();
        }
        if had_errors == self.bad.is_empty() {
            context.ask_again();
        }
    }
}

impl Rule for SpnNotAvailable {
    /// Messages without an error indicator, while no parameter has one.
    fn frame_need(&self, event: &Event, _context: &RuleContext<'_>) -> FrameNeed {
        let EventKind::J1939Message(message) = &event.kind else { return FrameNeed::EACH };
        let mut need = FrameNeed::NOTHING;
        for (_, field, indicators, _) in error_parameters(message) {
            need.is_passed_if_changed = true;
            let has_error = matches!(indicators.bits, 2..=7) || indicators.bits.is_multiple_of(8);
            let is_simple = field.order == BitOrder::LittleEndian && field.bits == indicators.bits;
            if has_error && !(is_simple && need.codes.add_parameter(field.bit, field.bits)) {
                need.bits |= bits_of(field);
            }
        }
        if need.is_passed_if_changed && !self.bad.is_empty() {
            need.bits = u64::MAX;
        }
        need
    }

    fn on_event(&mut self, event: &Event, context: &mut RuleContext<'_>) {
        // Repeated messages were checked at their first occurrence.
        if let (EventKind::J1939Message(message), Some(node), false) =
            (&event.kind, event.node, event.routine)
        {
            self.on_message(event, node, message, context);
        }
    }
}
