//! `max-count`: number of events.

use crate::event::FrameRange;
use crate::profile::device::{
    CountWindow, DeviceRule, ProfileTrigger, RuleKind, TriggerEvent, VariableWindow,
};
use crate::rules::RuleContext;
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
    context: &mut RuleContext<'_>,
) {
    match case.rule.per {
        Some(SYNC) => judge_per_sync(case, progress, event, context),
        Some(CountWindow::Variable(VariableWindow::While)) => judge_per_while(case, progress, event, context),
        Some(CountWindow::Seconds(seconds)) => judge_per_seconds(case, progress, event, seconds, context),
        None => {}
    }
}

fn max_count(rule: &DeviceRule) -> u32 {
    rule.count.unwrap_or(u32::MAX)
}

fn judge_per_sync(
    case: &RuleCase<'_>,
    progress: &mut RuleProgress,
    event: &TriggerEvent<'_>,
    context: &mut RuleContext<'_>,
) {
    let is_received = || !waits_for_pdo(&case.rule.on.0) || case.facts.is_operational();
    if progress.is_counting && case.matching_trigger(event).is_some() && is_received() && case.is_due() {
        count_moment(progress, FrameTime { time: context.now, frame: case.frames.last });
    }
    if !matches!(event, TriggerEvent::Sync) {
        return;
    }
    let most = max_count(case.rule);
    let (count, was_counting) = take_count(progress, context.now);
    if count == 0 || !was_counting {
        return;
    }
    if count <= most {
        return context.count_pass();
    }
    let last = progress.last.map_or(progress.first, |last| last.frame);
    let text = &case.rule.text;
    let alarm = case.start_finding(event, context).with_subject(about_first(&case.rule.on.0));
    let frames = FrameRange { first: progress.first, last };
    let alarm = alarm.with_frames(frames).with_measure(f64::from(count));
    alarm.report_finding(|| with_details(text, &format!("count {count}, limit {most}")));
}

fn count_moment(progress: &mut RuleProgress, moment: FrameTime) {
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
        count_moment(progress, moment);
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
    if !is_counted || progress.count > max_count(rule) || rule.on.0.contains(&ProfileTrigger::Sync) {
        return None;
    }
    let (count, was_counting) = take_count(progress, now);
    Some(count > 0 && was_counting)
}

fn judge_per_while(
    case: &RuleCase<'_>,
    progress: &mut RuleProgress,
    event: &TriggerEvent<'_>,
    context: &mut RuleContext<'_>,
) {
    if case.matching_trigger(event).is_none() || !case.is_due() {
        return;
    }
    if !std::mem::replace(&mut progress.holds, true) {
        progress.count = 0;
    }
    progress.count = progress.count.saturating_add(1);
    let (count, most, text) = (progress.count, max_count(case.rule), &case.rule.text);
    if count > most {
        let alarm = case.start_finding(event, context).with_measure(f64::from(count));
        alarm.report_finding(|| {
            let event = show_event(event);
            with_details(text, &format!("{event}, count {count}, limit {most}"))
        });
    }
}

/// Ends the counted interval.
pub(super) fn end_stretch(case: &RuleCase<'_>, progress: &mut RuleProgress, context: &mut RuleContext<'_>) {
    let count = std::mem::take(&mut progress.count);
    if (1..=max_count(case.rule)).contains(&count) {
        context.count_pass();
    }
}

fn judge_per_seconds(
    case: &RuleCase<'_>,
    progress: &mut RuleProgress,
    event: &TriggerEvent<'_>,
    seconds: f64,
    context: &mut RuleContext<'_>,
) {
    let Some(trigger) = case.matching_trigger(event) else { return };
    if !context.has_time || !case.is_due() {
        return;
    }
    let most = usize::try_from(max_count(case.rule)).unwrap_or(ROW_LIMIT).min(ROW_LIMIT);
    let moment = FrameTime { time: context.now, frame: case.frames.last };
    let Some(recent) = progress.recent_events(counted_object(event, trigger)) else { return };
    recent.push_back(moment);
    if recent.len() > most + 1 {
        recent.pop_front();
    }
    let oldest = recent.front().copied().unwrap_or(moment);
    let span = moment.time.saturating_sub(oldest.time).saturating_add(context.granularity);
    #[expect(clippy::cast_precision_loss, reason = "a span of seconds")]
    let is_within = span as f64 / 1e9 <= seconds;
    if recent.len() <= most || !is_within {
        return context.count_pass();
    }
    let (count, text) = (recent.len(), &case.rule.text);
    let frames = FrameRange { first: oldest.frame, last: moment.frame };
    let alarm = case.start_finding(event, context).with_frames(frames);
    alarm.report_finding(|| with_details(text, &format!("count {count} in {seconds} s, limit {most}")));
}
