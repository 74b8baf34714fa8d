//! Times between events: minimum, maximum and response time.

use crate::event::FrameRange;
use crate::profile::PdoDirection;
use crate::profile::device::{Trigger, TriggerEvent};
use crate::rules::Context;
use crate::rules::device::case::{RuleCase, counted_object, waits_for_pdo};
use crate::rules::device::describe::{about_first, with_details};
use crate::rules::device::progress::{FrameTime, RuleProgress};

fn milliseconds(nanoseconds: i64) -> f64 {
    #[expect(clippy::cast_precision_loss, reason = "shown with a digit or two")]
    let milliseconds = nanoseconds as f64 / 1e6;
    milliseconds
}

/// Time as text: `1.71 ms`, `312 ms`, `12.5 s`.
fn shown(nanoseconds: i64) -> String {
    let milliseconds = milliseconds(nanoseconds);
    if milliseconds >= 10_000.0 {
        let digits = usize::from(nanoseconds % 1_000_000_000 != 0);
        return format!("{:.digits$} s", milliseconds / 1_000.0);
    }
    let digits = if milliseconds < 10.0 && nanoseconds % 1_000_000 != 0 { 2 } else { 0 };
    format!("{milliseconds:.digits$} ms")
}

/// Text of a rule with a measured time. The limit is added unless the text contains it.
fn with_time(text: &str, time: &str, limit: i64) -> String {
    let limit = shown(limit);
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
    context: &mut Context<'_>,
) {
    let after = &case.rule.after.0;
    let moment = FrameTime { time: context.now, frame: case.frames.last };
    if let Some(trigger) = case.on(event) {
        let before = if after.is_empty() {
            let Some(recent) = progress.recent(counted_object(event, trigger)) else { return };
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
    context: &mut Context<'_>,
) {
    let Some(limit) = case.limit() else { return };
    let interval = context.now.saturating_sub(before.time);
    if interval.saturating_add(context.granularity) >= limit {
        return context.pass();
    }
    let frames = FrameRange { first: before.frame, last: case.frames.last };
    let alarm = case.fail(event, context).frames(frames).measure(-milliseconds(interval));
    let text = &case.rule.text;
    alarm.report(|| with_time(text, &shown(interval), limit));
}

/// `on` must not occur too late after the previous one.
pub(super) fn judge_max_interval(
    case: &RuleCase<'_>,
    progress: &mut RuleProgress,
    event: &TriggerEvent<'_>,
    context: &mut Context<'_>,
) {
    if case.on(event).is_none() {
        return;
    }
    progress.is_counting = true;
    if !context.has_time || !case.is_due() || !may_be_missed(case, progress, &case.rule.on.0) {
        progress.last = None;
        return;
    }
    let moment = FrameTime { time: context.now, frame: case.frames.last };
    let (Some(last), Some(limit)) = (progress.last.replace(moment), case.limit()) else { return };
    let interval = context.now.saturating_sub(last.time);
    if interval.saturating_sub(context.granularity) <= limit {
        return context.pass();
    }
    let frames = FrameRange { first: last.frame, last: moment.frame };
    let alarm = case.fail(event, context).frames(frames).measure(milliseconds(interval));
    let text = &case.rule.text;
    alarm.report(|| with_time(text, &shown(interval), limit));
}

/// Reason for a lower severity.
const DEFAULT_ID: &str = "COB-ID assumed: factory setting";

/// Evidence that the absence of events is a defect.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum Absence {
    /// The events are not expected, or their identifier is unknown.
    Unknown,
    /// The device sends the PDO itself, but its identifier is only the factory setting.
    Assumed,
    Proven,
}

impl Absence {
    fn assumption(self) -> Option<&'static str> {
        (self == Self::Assumed).then_some(DEFAULT_ID)
    }
}

/// Evidence that the absence of these events is a defect.
fn absence(case: &RuleCase<'_>, progress: &RuleProgress, triggers: &[Trigger]) -> Absence {
    let facts = &case.facts;
    let evidence = |trigger: &Trigger| {
        let Trigger::Pdo(name) = trigger else { return Absence::Proven };
        match facts.bus.pdo_identifier(facts.id, *name).filter(|_| facts.is_operational()) {
            Some((_, is_told)) if is_told || progress.is_counting => Absence::Proven,
            Some(_) if name.direction == PdoDirection::Transmit => Absence::Assumed,
            _ => Absence::Unknown,
        }
    };
    let all: Vec<Absence> = triggers.iter().map(evidence).collect();
    if all.contains(&Absence::Unknown) {
        Absence::Unknown
    } else if all.contains(&Absence::Assumed) {
        Absence::Assumed
    } else {
        Absence::Proven
    }
}

/// Whether the absence of these events is a defect, at least with factory settings.
fn may_be_missed(case: &RuleCase<'_>, progress: &RuleProgress, triggers: &[Trigger]) -> bool {
    absence(case, progress, triggers) != Absence::Unknown
}

/// The interval starts and ends with `while`, and ends when the node stops its PDOs.
pub(super) fn follow_stretch(
    case: &RuleCase<'_>,
    progress: &mut RuleProgress,
    held: bool,
    context: &mut Context<'_>,
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
pub(super) fn judge_end(case: &RuleCase<'_>, progress: &mut RuleProgress, context: &mut Context<'_>) {
    let Some(last) = progress.last.take() else { return };
    let absence = absence(case, progress, &case.rule.on.0);
    if case.is_due() && absence != Absence::Unknown {
        report_overdue(case, (last, absence.assumption()), context);
    }
}

fn report_overdue(
    case: &RuleCase<'_>,
    (last, assumption): (FrameTime, Option<&'static str>),
    context: &mut Context<'_>,
) {
    let (Some(heard), Some(limit)) = (case.facts.own.heard, case.limit()) else { return };
    let interval = heard.saturating_sub(last.time);
    if interval.saturating_sub(context.granularity) <= limit {
        return;
    }
    let frames = FrameRange { first: last.frame, last: case.frames.last.max(last.frame) };
    let alarm = context.fail_at(heard, Some(case.facts.id), frames).about(about_first(&case.rule.on.0));
    let text = &case.rule.text;
    let alarm = alarm.measure(milliseconds(interval)).assumed(assumption);
    alarm.report(|| with_time(text, &format!("missing for {}", shown(interval)), limit));
}

/// `then` occurs; whether `on` occurred before it.
#[inline]
pub(in crate::rules::device) fn answer(progress: &mut RuleProgress) -> bool {
    progress.is_counting = true;
    progress.deadline = None;
    progress.last.take().is_some()
}

/// `then` occurs in time after `on`.
pub(super) fn judge_follow(
    case: &RuleCase<'_>,
    progress: &mut RuleProgress,
    event: &TriggerEvent<'_>,
    context: &mut Context<'_>,
) {
    if case.rule.then.0.iter().any(|trigger| trigger.is_met_by(event)) {
        if answer(progress) {
            context.pass();
        }
    } else if matches!(event, TriggerEvent::Boot { .. }) {
        (progress.last, progress.deadline) = (None, None);
    }
    if case.on(event).is_none() || !context.has_time || !case.is_due() {
        return;
    }
    let Some(limit) = case.limit() else { return };
    // Repetitions do not extend the time: events at a shorter interval than the limit may never be followed.
    if progress.last.is_some() {
        return;
    }
    let deadline = context.now.saturating_add(limit).saturating_add(context.granularity);
    progress.holds = true;
    progress.last = Some(FrameTime { time: context.now, frame: case.frames.last });
    case.wait(progress, deadline, context);
}

/// The time for `then` has passed.
pub(super) fn judge_missing(
    case: &RuleCase<'_>,
    progress: &mut RuleProgress,
    deadline: i64,
    context: &mut Context<'_>,
) {
    let Some(on) = progress.last.take() else { return };
    let absence = absence(case, progress, &case.rule.then.0);
    if !case.is_due() || absence == Absence::Unknown {
        return;
    }
    let Some(limit) = case.limit() else { return };
    let frames = FrameRange { first: on.frame, last: case.frames.last.max(on.frame) };
    let alarm = context.fail_at(deadline, Some(case.facts.id), frames);
    let text = &case.rule.text;
    let alarm = alarm.about(about_first(&case.rule.on.0)).assumed(absence.assumption());
    alarm.report(|| with_time(text, "", limit));
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
