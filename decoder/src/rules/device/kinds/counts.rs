//! `max-count`: number of events.

use crate::event::FrameRange;
use crate::profile::device::{CountWindow, DeviceRule, RuleKind, Trigger, TriggerEvent, VariableWindow};
use crate::rules::Context;
use crate::rules::device::case::{RuleCase, counted_object, waits_for_pdo};
use crate::rules::device::describe::{about_first, show_event, with_details};
use crate::rules::device::progress::{FrameTime, RuleProgress};

/// Maximum number of stored events; a rule with a higher count uses this number.
const ROW_LIMIT: usize = 1024;

/// Maximum SYNC period in ns; above it, SYNC counts as stopped.
const ALIVE: i64 = 1_000_000_000;

/// Window from one SYNC to the next.
const SYNC: CountWindow = CountWindow::Variable(VariableWindow::Sync);

/// `on` must occur at most `count` times.
pub(super) fn judge_count(
    case: &RuleCase<'_>,
    progress: &mut RuleProgress,
    event: &TriggerEvent<'_>,
    context: &mut Context<'_>,
) {
    match case.rule.per {
        Some(SYNC) => judge_per_sync(case, progress, event, context),
        Some(CountWindow::Variable(VariableWindow::While)) => judge_per_while(case, progress, event, context),
        Some(CountWindow::Seconds(seconds)) => judge_per_seconds(case, progress, event, seconds, context),
        None => {}
    }
}

fn most(rule: &DeviceRule) -> u32 {
    rule.count.unwrap_or(u32::MAX)
}

fn judge_per_sync(
    case: &RuleCase<'_>,
    progress: &mut RuleProgress,
    event: &TriggerEvent<'_>,
    context: &mut Context<'_>,
) {
    let is_heard = || !waits_for_pdo(&case.rule.on.0) || case.facts.is_operational();
    if progress.is_counting && case.on(event).is_some() && is_heard() && case.is_due() {
        count(progress, FrameTime { time: context.now, frame: case.frames.last });
    }
    if !matches!(event, TriggerEvent::Sync) {
        return;
    }
    let most = most(case.rule);
    let (count, was_counting) = take_count(progress, context.now);
    if count == 0 || !was_counting {
        return;
    }
    if count <= most {
        return context.pass();
    }
    let last = progress.last.map_or(progress.first, |last| last.frame);
    let text = &case.rule.text;
    let alarm = case.fail(event, context).about(about_first(&case.rule.on.0));
    let frames = FrameRange { first: progress.first, last };
    let alarm = alarm.frames(frames).measure(f64::from(count));
    alarm.report(|| with_details(text, &format!("count {count}, limit {most}")));
}

fn count(progress: &mut RuleProgress, moment: FrameTime) {
    progress.count = progress.count.saturating_add(1);
    if progress.count == 1 {
        progress.first = moment.frame;
    }
    progress.last = Some(moment);
}

/// Counts a PDO of an operational node for a rule that applies, see [`is_per_sync`].
#[inline]
pub(in crate::rules::device) fn count_pdo(progress: &mut RuleProgress, moment: FrameTime) {
    if progress.is_counting {
        count(progress, moment);
    }
}

/// Whether a rule counts events between SYNCs.
pub(super) fn is_per_sync(rule: &DeviceRule) -> bool {
    rule.per == Some(SYNC)
}

/// At SYNC: the number of events since the last one, and whether they were counted from there.
#[inline]
fn take_count(progress: &mut RuleProgress, now: i64) -> (u32, bool) {
    let count = std::mem::take(&mut progress.count);
    let before = progress.since.replace(now);
    // A stopped SYNC is reported by other rules.
    let is_alive = before.is_some_and(|before| now.saturating_sub(before) <= ALIVE);
    (count, std::mem::replace(&mut progress.is_counting, true) && is_alive)
}

/// At SYNC: ends a count that is within the limit of the rule; whether there was one. `None`, without any effect, for a
/// higher count, for other rules, and if SYNC itself is counted.
#[inline]
pub(in crate::rules::device) fn end_count(
    rule: &DeviceRule,
    progress: &mut RuleProgress,
    now: i64,
) -> Option<bool> {
    let is_counted = rule.kind == RuleKind::MaxCount && is_per_sync(rule);
    if !is_counted || progress.count > most(rule) || rule.on.0.contains(&Trigger::Sync) {
        return None;
    }
    let (count, was_counting) = take_count(progress, now);
    Some(count > 0 && was_counting)
}

fn judge_per_while(
    case: &RuleCase<'_>,
    progress: &mut RuleProgress,
    event: &TriggerEvent<'_>,
    context: &mut Context<'_>,
) {
    if case.on(event).is_none() || !case.is_due() {
        return;
    }
    if !std::mem::replace(&mut progress.holds, true) {
        progress.count = 0;
    }
    progress.count = progress.count.saturating_add(1);
    let (count, most, text) = (progress.count, most(case.rule), &case.rule.text);
    if count > most {
        let alarm = case.fail(event, context).measure(f64::from(count));
        alarm.report(|| {
            let event = show_event(event);
            with_details(text, &format!("{event}, count {count}, limit {most}"))
        });
    }
}

/// Ends the counted interval.
pub(super) fn end_stretch(case: &RuleCase<'_>, progress: &mut RuleProgress, context: &mut Context<'_>) {
    let count = std::mem::take(&mut progress.count);
    if (1..=most(case.rule)).contains(&count) {
        context.pass();
    }
}

fn judge_per_seconds(
    case: &RuleCase<'_>,
    progress: &mut RuleProgress,
    event: &TriggerEvent<'_>,
    seconds: f64,
    context: &mut Context<'_>,
) {
    let Some(trigger) = case.on(event) else { return };
    if !context.has_time || !case.is_due() {
        return;
    }
    let most = usize::try_from(most(case.rule)).unwrap_or(ROW_LIMIT).min(ROW_LIMIT);
    let moment = FrameTime { time: context.now, frame: case.frames.last };
    let Some(recent) = progress.recent(counted_object(event, trigger)) else { return };
    recent.push_back(moment);
    if recent.len() > most + 1 {
        recent.pop_front();
    }
    let oldest = recent.front().copied().unwrap_or(moment);
    let span = moment.time.saturating_sub(oldest.time).saturating_add(context.granularity);
    #[expect(clippy::cast_precision_loss, reason = "a span of seconds")]
    let is_within = span as f64 / 1e9 <= seconds;
    if recent.len() <= most || !is_within {
        return context.pass();
    }
    let (count, text) = (recent.len(), &case.rule.text);
    let frames = FrameRange { first: oldest.frame, last: moment.frame };
    let alarm = case.fail(event, context).frames(frames);
    alarm.report(|| with_details(text, &format!("count {count} in {seconds} s, limit {most}")));
}
