//! Times between events: minimum, maximum and response time.

use crate::event::FrameRange;
use crate::profile::PdoDirection;
use crate::profile::device::{ProfileTrigger, TriggerEvent};
use crate::rules::RuleContext;
use crate::rules::device::case::{RuleCase, counted_object, waits_for_pdo};
use crate::rules::device::describe::{about_first, with_details};
use crate::rules::device::progress::{FrameTime, RuleProgress};

fn to_milliseconds(nanoseconds: i64) -> f64 {
    #[expect(clippy::cast_precision_loss, reason = "shown with a digit or two")]
    let milliseconds = nanoseconds as f64 / 1e6;
    milliseconds
}

/// Time as text: `1.71 ms`, `312 ms`, `12.5 s`.
fn time_text(nanoseconds: i64) -> String {
    let milliseconds = to_milliseconds(nanoseconds);
    if milliseconds >= 10_000.0 {
        let digits = usize::from(nanoseconds % 1_000_000_000 != 0);
        return format!("{:.digits$} s", milliseconds / 1_000.0);
    }
    let digits = if milliseconds < 10.0 && nanoseconds % 1_000_000 != 0 { 2 } else { 0 };
    format!("{milliseconds:.digits$} ms")
}

/// Text of a rule with a measured time. The limit is added unless the text contains it.
fn with_time(text: &str, time: &str, limit: i64) -> String {
    let limit = time_text(limit);
    let names_limit = text.match_indices(limit.as_str()).any(|(at, _)| {
        let before = text.get(..at).and_then(|before| before.chars().next_back());
        before.is_none_or(|character| !character.is_ascii_digit() && character != '.')
    });
    let added = if names_limit { String::new() } else { format!("limit {limit}") };
    let details: Vec<_> = [time, added.as_str()].into_iter().filter(|detail| !detail.is_empty()).collect();
    with_details(text, &details.join(", "))
}

/// `on` must not occur too soon after the previous `on`, or after `after`.
pub(super) fn judge_min_interval(
    case: &RuleCase<'_>,
    progress: &mut RuleProgress,
    event: &TriggerEvent<'_>,
    context: &mut RuleContext<'_>,
) {
    let after = &case.rule.after.0;
    let moment = FrameTime { time: context.now, frame: case.frames.last };
    if let Some(trigger) = case.matching_trigger(event) {
        let before = if after.is_empty() {
            let Some(recent) = progress.recent_events(counted_object(event, trigger)) else { return };
            recent.push_back(moment);
            if recent.len() > 1 { recent.pop_front() } else { None }
        } else {
            progress.last
        };
        if let (Some(before), true) = (before, context.has_time && case.is_due()) {
            judge_interval(case, before, event, context);
        }
    }
    if after.iter().any(|trigger| trigger.is_met_by(event)) {
        progress.last = Some(moment);
    }
}

fn judge_interval(
    case: &RuleCase<'_>,
    before: FrameTime,
    event: &TriggerEvent<'_>,
    context: &mut RuleContext<'_>,
) {
    let Some(limit) = case.time_limit() else { return };
    let interval = context.now.saturating_sub(before.time);
    if interval.saturating_add(context.granularity) >= limit {
        return context.count_pass();
    }
    let frames = FrameRange { first: before.frame, last: case.frames.last };
    let alarm =
        case.start_finding(event, context).with_frames(frames).with_measure(-to_milliseconds(interval));
    let text = &case.rule.text;
    alarm.report_finding(|| with_time(text, &time_text(interval), limit));
}

/// `on` must not occur too late after the previous one.
pub(super) fn judge_max_interval(
    case: &RuleCase<'_>,
    progress: &mut RuleProgress,
    event: &TriggerEvent<'_>,
    context: &mut RuleContext<'_>,
) {
    if case.matching_trigger(event).is_none() {
        return;
    }
    progress.is_counting = true;
    if !context.has_time || !case.is_due() || !may_be_missed(case, progress, &case.rule.on.0) {
        progress.last = None;
        return;
    }
    let moment = FrameTime { time: context.now, frame: case.frames.last };
    let (Some(last), Some(limit)) = (progress.last.replace(moment), case.time_limit()) else { return };
    let interval = context.now.saturating_sub(last.time);
    if interval.saturating_sub(context.granularity) <= limit {
        return context.count_pass();
    }
    let frames = FrameRange { first: last.frame, last: moment.frame };
    let alarm =
        case.start_finding(event, context).with_frames(frames).with_measure(to_milliseconds(interval));
    let text = &case.rule.text;
    alarm.report_finding(|| with_time(text, &time_text(interval), limit));
}

/// Reason for a lower severity.
const DEFAULT_ID: &str = "COB-ID assumed: factory setting";

/// Evidence that the absence of events is a defect.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum AbsenceEvidence {
    /// The events are not expected, or their identifier is unknown.
    Unknown,
    /// The device sends the PDO itself, but its identifier is only the factory setting.
    Assumed,
    Proven,
}

impl AbsenceEvidence {
    fn assumption(self) -> Option<&'static str> {
        (self == Self::Assumed).then_some(DEFAULT_ID)
    }
}

/// Evidence that the absence of these events is a defect.
fn absence_evidence(
    case: &RuleCase<'_>,
    progress: &RuleProgress,
    triggers: &[ProfileTrigger],
) -> AbsenceEvidence {
    let facts = &case.facts;
    let evidence = |trigger: &ProfileTrigger| {
        let ProfileTrigger::Pdo(name) = trigger else { return AbsenceEvidence::Proven };
        match facts.bus.pdo_identifier(facts.id, *name).filter(|_| facts.is_operational()) {
            Some((_, is_reported)) if is_reported || progress.is_counting => AbsenceEvidence::Proven,
            Some(_) if name.direction == PdoDirection::Transmit => AbsenceEvidence::Assumed,
            _ => AbsenceEvidence::Unknown,
        }
    };
    let all: Vec<AbsenceEvidence> = triggers.iter().map(evidence).collect();
    if all.contains(&AbsenceEvidence::Unknown) {
        AbsenceEvidence::Unknown
    } else if all.contains(&AbsenceEvidence::Assumed) {
        AbsenceEvidence::Assumed
    } else {
        AbsenceEvidence::Proven
    }
}

/// Whether the absence of these events is a defect, at least with factory settings.
fn may_be_missed(case: &RuleCase<'_>, progress: &RuleProgress, triggers: &[ProfileTrigger]) -> bool {
    absence_evidence(case, progress, triggers) != AbsenceEvidence::Unknown
}

/// The interval starts and ends with `while`, and ends when the node stops its PDOs.
pub(super) fn follow_stretch(
    case: &RuleCase<'_>,
    progress: &mut RuleProgress,
    held: bool,
    context: &mut RuleContext<'_>,
) {
    let is_open = progress.holds && (!waits_for_pdo(&case.rule.on.0) || case.facts.is_operational());
    if is_open {
        let begins = !held && !case.rule.during.0.is_empty() && progress.last.is_none();
        if begins && may_be_missed(case, progress, &case.rule.on.0) {
            progress.last = Some(FrameTime { time: context.now, frame: case.frames.last });
        }
        return;
    }
    let Some(last) = progress.last.take() else { return };
    // The gap ends with the node's last frame before the change.
    if held && progress.is_counting {
        report_overdue(case, (last, None), context);
    }
}

/// At the end of the capture: reports events that were missing up to the node's last frame.
pub(super) fn judge_end(case: &RuleCase<'_>, progress: &mut RuleProgress, context: &mut RuleContext<'_>) {
    let Some(last) = progress.last.take() else { return };
    let absence = absence_evidence(case, progress, &case.rule.on.0);
    if case.is_due() && absence != AbsenceEvidence::Unknown {
        report_overdue(case, (last, absence.assumption()), context);
    }
}

fn report_overdue(
    case: &RuleCase<'_>,
    (last, assumption): (FrameTime, Option<&'static str>),
    context: &mut RuleContext<'_>,
) {
    let (Some(received), Some(limit)) = (case.facts.own.received, case.time_limit()) else { return };
    let interval = received.saturating_sub(last.time);
    if interval.saturating_sub(context.granularity) <= limit {
        return;
    }
    let frames = FrameRange { first: last.frame, last: case.frames.last.max(last.frame) };
    let alarm =
        context.fail_at(received, Some(case.facts.id), frames).with_subject(about_first(&case.rule.on.0));
    let text = &case.rule.text;
    let alarm = alarm.with_measure(to_milliseconds(interval)).with_assumption(assumption);
    alarm.report_finding(|| with_time(text, &format!("missing for {}", time_text(interval)), limit));
}

/// `then` occurs; whether `on` occurred before it.
#[inline]
pub(in crate::rules::device) fn on_answer(progress: &mut RuleProgress) -> bool {
    progress.is_counting = true;
    progress.deadline = None;
    progress.last.take().is_some()
}

/// `then` occurs in time after `on`.
pub(super) fn judge_follow(
    case: &RuleCase<'_>,
    progress: &mut RuleProgress,
    event: &TriggerEvent<'_>,
    context: &mut RuleContext<'_>,
) {
    if case.rule.then.0.iter().any(|trigger| trigger.is_met_by(event)) {
        if on_answer(progress) {
            context.count_pass();
        }
    } else if matches!(event, TriggerEvent::Boot { .. }) {
        (progress.last, progress.deadline) = (None, None);
    }
    if case.matching_trigger(event).is_none() || !context.has_time || !case.is_due() {
        return;
    }
    let Some(limit) = case.time_limit() else { return };
    // Repetitions do not extend the time: events at a shorter interval than the limit may never be followed.
    if progress.last.is_some() {
        return;
    }
    let deadline = context.now.saturating_add(limit).saturating_add(context.granularity);
    progress.holds = true;
    progress.last = Some(FrameTime { time: context.now, frame: case.frames.last });
    case.wait_until(progress, deadline, context);
}

/// The time for `then` has passed.
pub(super) fn judge_missing(
    case: &RuleCase<'_>,
    progress: &mut RuleProgress,
    deadline: i64,
    context: &mut RuleContext<'_>,
) {
    let Some(on) = progress.last.take() else { return };
    let absence = absence_evidence(case, progress, &case.rule.then.0);
    if !case.is_due() || absence == AbsenceEvidence::Unknown {
        return;
    }
    let Some(limit) = case.time_limit() else { return };
    let frames = FrameRange { first: on.frame, last: case.frames.last.max(on.frame) };
    let alarm = context.fail_at(deadline, Some(case.facts.id), frames);
    let text = &case.rule.text;
    let alarm = alarm.with_subject(about_first(&case.rule.on.0)).with_assumption(absence.assumption());
    alarm.report_finding(|| with_time(text, "", limit));
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_limit_is_added_where_the_text_has_another_one() {
        let limit = 2_000_000;
        let text = "SYNC period below the 2 ms minimum";
        assert_eq!(with_time(text, "1.71 ms", limit), format!("{text} (1.71 ms)"));
        assert_eq!(with_time(text, "1.71 ms", 3_000_000), format!("{text} (1.71 ms, limit 3 ms)"));
        assert_eq!(with_time("gap above 12 ms", "15 ms", limit), "gap above 12 ms (15 ms, limit 2 ms)");
        assert_eq!(with_time("no reset within 60 s", "", 60_000_000_000), "no reset within 60 s");
    }
}
