//! Times between events: shortest, longest, and that of a response.

use crate::event::FrameRange;
use crate::profile::device::{Trigger, TriggerEvent};
use crate::rules::Context;
use crate::rules::device::case::{RuleCase, counted_object, waits_for_pdo};
use crate::rules::device::describe::about_first;
use crate::rules::device::progress::{FrameTime, RuleProgress};

fn milliseconds(nanoseconds: i64) -> f64 {
    #[expect(clippy::cast_precision_loss, reason = "shown with a digit or two")]
    let milliseconds = nanoseconds as f64 / 1e6;
    milliseconds
}

/// A time as text: whole milliseconds from ten on.
fn shown(nanoseconds: i64) -> String {
    let milliseconds = milliseconds(nanoseconds);
    let digits = if milliseconds < 10.0 && nanoseconds % 1_000_000 != 0 { 2 } else { 0 };
    format!("{milliseconds:.digits$} ms")
}

/// `on` does not occur too soon after the one before, or after `after`.
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
    let (text, frame) = (&case.rule.text, before.frame);
    alarm.say(|| format!("{} after {{{frame}}}, at least {}: {text}", shown(interval), shown(limit)));
}

/// `on` does not occur too late after the one before.
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
    alarm.say(|| format!("{} after {{{}}}, at most {}: {text}", shown(interval), last.frame, shown(limit)));
}

/// Whether the absence of these events would prove something.
fn may_be_missed(case: &RuleCase<'_>, progress: &RuleProgress, triggers: &[Trigger]) -> bool {
    let facts = &case.facts;
    let is_sure = |trigger: &Trigger| match trigger {
        Trigger::Pdo(name) => {
            let id = facts.bus.pdo_identifier(facts.id, *name);
            facts.is_operational() && id.is_some_and(|(_, is_told)| is_told || progress.is_counting)
        }
        _ => true,
    };
    triggers.iter().all(is_sure)
}

/// The wait begins and ends with `while`, and ends when the node no longer takes part.
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
    // A gap lasts up to the node's last frame before the change.
    if held && progress.is_counting {
        report_overdue(case, last, context);
    }
}

/// The capture ends: events still missing, up to the node's last frame.
pub(super) fn judge_end(case: &RuleCase<'_>, progress: &mut RuleProgress, context: &mut Context<'_>) {
    let Some(last) = progress.last.take() else { return };
    if case.is_due() && may_be_missed(case, progress, &case.rule.on.0) {
        report_overdue(case, last, context);
    }
}

fn report_overdue(case: &RuleCase<'_>, last: FrameTime, context: &mut Context<'_>) {
    let (Some(heard), Some(limit)) = (case.facts.own.heard, case.limit()) else { return };
    let interval = heard.saturating_sub(last.time);
    if interval.saturating_sub(context.granularity) <= limit {
        return;
    }
    let frames = FrameRange { first: last.frame, last: case.frames.last.max(last.frame) };
    let alarm = context.fail_at(heard, Some(case.facts.id), frames).about(about_first(&case.rule.on.0));
    let text = &case.rule.text;
    let alarm = alarm.measure(milliseconds(interval));
    alarm.say(|| {
        format!("missing for {} since {{{}}}, at most {}: {text}", shown(interval), last.frame, shown(limit))
    });
}

/// `then` occurs in time after `on`.
pub(super) fn judge_follow(
    case: &RuleCase<'_>,
    progress: &mut RuleProgress,
    event: &TriggerEvent<'_>,
    context: &mut Context<'_>,
) {
    if case.rule.then.0.iter().any(|trigger| trigger.is_met_by(event)) {
        progress.is_counting = true;
        progress.deadline = None;
        if progress.last.take().is_some() {
            context.pass();
        }
    } else if matches!(event, TriggerEvent::Boot) {
        (progress.last, progress.deadline) = (None, None);
    }
    if case.on(event).is_none() || !context.has_time || !case.is_due() {
        return;
    }
    let Some(limit) = case.limit() else { return };
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
    if !case.is_due() || !may_be_missed(case, progress, &case.rule.then.0) {
        return;
    }
    let Some(limit) = case.limit() else { return };
    let frames = FrameRange { first: on.frame, last: case.frames.last.max(on.frame) };
    let alarm = context.fail_at(deadline, Some(case.facts.id), frames);
    let text = &case.rule.text;
    alarm
        .about(about_first(&case.rule.on.0))
        .say(|| format!("not within {} of {{{}}}: {text}", shown(limit), on.frame));
}
