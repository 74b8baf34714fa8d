//! Permitted values, and values that must ascend from one object to the next.

use crate::event::FrameRange;
use crate::finding::FindingSubject;
use crate::profile::ObjectMeaning;
use crate::profile::device::{RuleKind, TriggerEvent, UpdateSource, ValueUpdate};
use crate::rules::RuleContext;
use crate::rules::device::case::RuleCase;
use crate::rules::device::describe::{show_event, show_number, with_details};
use crate::rules::device::progress::RuleProgress;
use crate::wire::canopen::ObjectAddress;

/// Time after the last write until a series of objects counts as complete, in ns.
const WRITTEN: i64 = 1_000_000_000;

/// Tolerance of limits, relative to their span: manuals print rounded values.
const ROUNDED: f64 = 0.001;

/// New value of an object of the rule.
fn subject_value<'a>(case: &RuleCase<'_>, event: &TriggerEvent<'a>) -> Option<ValueUpdate<'a>> {
    match event {
        TriggerEvent::Value(value) if case.rule.rule_objects().any(|of| of.object == value.object) => {
            Some(*value)
        }
        _ => None,
    }
}

/// A value must be inside the limits, from any source.
pub(super) fn judge_limit(case: &RuleCase<'_>, event: &TriggerEvent<'_>, context: &mut RuleContext<'_>) {
    let Some(value) = subject_value(case, event) else { return };
    let Some(raw) = value.raw.filter(|_| case.is_due()) else { return };
    let special = value.meaning.and_then(|meaning| meaning.special.as_deref());
    if special.is_some_and(|names| names.get(raw).is_some()) {
        return;
    }
    #[expect(clippy::cast_precision_loss, reason = "compared with limits of few digits")]
    let plain = raw as f64;
    let within = case.rule.within.and_then(|of| case.scaled_value(of.object));
    #[expect(clippy::cast_precision_loss, reason = "limits of few digits")]
    let (number, [least, most], slack, unit) = match (case.rule.range, case.rule.limits, value.meaning) {
        (Some([least, most]), _, _) => (plain, [least as f64, most as f64], 0.0, ""),
        (None, Some(limits), Some(meaning)) if !meaning.assumed => {
            let scaled = meaning.scaled_value(&meaning.convert_raw(raw)).unwrap_or(plain);
            (scaled, limits, (limits[1] - limits[0]).abs() * ROUNDED, meaning.unit.as_str())
        }
        (None, None, Some(meaning)) if !meaning.assumed => {
            let Some(most) = within else { return };
            let scaled = meaning.scaled_value(&meaning.convert_raw(raw)).unwrap_or(plain);
            (scaled, [-most, most], most.abs() * ROUNDED, meaning.unit.as_str())
        }
        _ => return,
    };
    let beyond = (least - number).max(number - most);
    if beyond <= slack {
        return context.count_pass();
    }
    let (text, space) = (&case.rule.text, if unit.is_empty() { "" } else { " " });
    let alarm = case.start_finding(event, context).with_measure(beyond);
    alarm.report_finding(|| {
        let limits = match (case.rule.range, value.meaning) {
            (Some(range), Some(meaning)) => permitted_text(range, meaning),
            _ => format!("permitted {least} to {most}{space}{unit}"),
        };
        with_details(text, &format!("{}, {limits}", show_event(event)))
    });
}

/// Raw limits in the notation of the value.
fn permitted_text([least, most]: [i64; 2], meaning: &ObjectMeaning) -> String {
    let (low, high) = (show_number(meaning, least), show_number(meaning, most));
    if least == most { format!("expected {low}") } else { format!("permitted {low} to {high}") }
}

/// A value sent to the device must be permitted, or not forbidden.
pub(super) fn judge_values(case: &RuleCase<'_>, event: &TriggerEvent<'_>, context: &mut RuleContext<'_>) {
    let Some(value) = subject_value(case, event).filter(|value| value.source.is_command()) else { return };
    let Some(raw) = value.raw.filter(|_| case.is_due()) else { return };
    let is_listed = case.rule.values.as_ref().is_some_and(|values| values.contains(raw));
    let is_step = case.rule.step.is_some_and(|step| raw.checked_rem(i64::from(step)) == Some(0));
    let is_wrong = if case.rule.kind == RuleKind::Forbidden { is_listed } else { !is_listed && !is_step };
    if !is_wrong {
        return context.count_pass();
    }
    let text = &case.rule.text;
    case.start_finding(event, context).report_finding(|| with_details(text, &show_event(event)));
}

/// Values must ascend: checked when `on` occurs, else [`WRITTEN`] after the last write.
pub(super) fn judge_ascent(
    case: &RuleCase<'_>,
    progress: &mut RuleProgress,
    event: &TriggerEvent<'_>,
    context: &mut RuleContext<'_>,
) {
    if case.rule.on.0.is_empty() {
        if subject_value(case, event).is_some_and(|value| value.source == UpdateSource::Written)
            && context.has_time
        {
            let deadline = context.now.saturating_add(WRITTEN);
            case.wait_until(progress, deadline, context);
        }
    } else if case.matching_trigger(event).is_some() && case.is_due() {
        match check_ascent(case) {
            AscentCheck::Broken(object, text) => {
                let alarm = case.start_finding(event, context).with_subject(FindingSubject::Object(object));
                alarm.report_finding(|| text);
            }
            AscentCheck::Rising => context.count_pass(),
            AscentCheck::Unknown => {}
        }
    }
}

/// Checks a series of objects after the last write.
pub(super) fn judge_written_row(case: &RuleCase<'_>, context: &mut RuleContext<'_>) {
    if !case.is_due() {
        return;
    }
    match check_ascent(case) {
        AscentCheck::Broken(object, text) => {
            let frames = FrameRange::one(case.frames.last);
            let alarm = context.fail_at(context.now, Some(case.facts.id), frames);
            alarm.with_subject(FindingSubject::Object(object)).report_finding(|| text);
        }
        AscentCheck::Rising => context.count_pass(),
        AscentCheck::Unknown => {}
    }
}

/// Result of an ascent check.
enum AscentCheck {
    Rising,
    /// The first object that does not ascend, and the text of the finding.
    Broken(ObjectAddress, String),
    /// No two neighbouring values are known.
    Unknown,
}

fn check_ascent(case: &RuleCase<'_>) -> AscentCheck {
    let mut found = AscentCheck::Unknown;
    for pair in case.rule.objects.windows(2) {
        let [lower, upper] = pair else { continue };
        let (lower, upper) = (lower.object, upper.object);
        let (Some(low), Some(high)) = (case.scaled_value(lower), case.scaled_value(upper)) else { continue };
        let rises = if case.rule.or_equal { low <= high } else { low < high };
        if !rises {
            let facts = &case.facts;
            let details = format!("{}, {}", facts.value_text(lower), facts.value_text(upper));
            let text = with_details(&case.rule.text, &details);
            return AscentCheck::Broken(upper, text);
        }
        found = AscentCheck::Rising;
    }
    found
}
