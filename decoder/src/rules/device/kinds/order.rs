//! Events that are forbidden, have a precondition, or require an earlier event.

use crate::event::FrameRange;
use crate::profile::device::{GateStatus, ProfileTrigger, RuleKind, TriggerEvent};
use crate::rules::RuleContext;
use crate::rules::device::case::RuleCase;
use crate::rules::device::describe::{is_value_of, show_event, with_details};
use crate::rules::device::progress::{FrameTime, RuleProgress};

/// `on` must not occur.
pub(super) fn judge_never(case: &RuleCase<'_>, event: &TriggerEvent<'_>, context: &mut RuleContext<'_>) {
    if case.matching_trigger(event).is_some() && !is_foreign(case, event) && case.is_due() {
        let text = &case.rule.text;
        case.start_finding(event, context).report_finding(|| with_details(text, &show_event(event)));
    }
}

/// Counts a forbidden event that has not occurred: once, and once per interval in which the rule applies. The first event
/// that is compared with `on` counts, or a value that is known when the interval begins.
pub(in crate::rules::device) fn exercise_never(
    case: &RuleCase<'_>,
    progress: &mut RuleProgress,
    event: &TriggerEvent<'_>,
    context: &mut RuleContext<'_>,
) {
    let rule = case.rule;
    let is_compared = !progress.is_exercised
        && rule.on.0.iter().any(|trigger| trigger.is_compared_with(event))
        && (!rule.is_scoped() || progress.is_prepared == Some(true))
        && case.is_due();
    if is_compared {
        progress.is_exercised = true;
        if case.matching_trigger(event).is_none() {
            context.count_pass();
        }
    }
}

/// Begins an interval in which a forbidden event must not occur.
pub(super) fn begin_never(case: &RuleCase<'_>, progress: &mut RuleProgress, context: &mut RuleContext<'_>) {
    let is_known = |trigger: &ProfileTrigger| match trigger {
        ProfileTrigger::Set(set) | ProfileTrigger::Shows(set) if !set.changed => {
            case.facts.proven_value(set.object.object).is_some()
        }
        _ => false,
    };
    progress.is_exercised = case.rule.on.0.iter().any(is_known);
    if progress.is_exercised {
        context.count_pass();
    }
}

/// Follows the interval in which a rule applies; returns whether the event is inside. The events that begin
/// and end it are not.
pub(super) fn follow_scope(
    case: &RuleCase<'_>,
    progress: &mut RuleProgress,
    event: &TriggerEvent<'_>,
    context: &mut RuleContext<'_>,
) -> bool {
    let was_open = progress.is_prepared == Some(true);
    let meets = |triggers: &[ProfileTrigger]| triggers.iter().any(|trigger| trigger.is_met_by(event));
    if matches!(event, TriggerEvent::Boot { .. }) || meets(&case.rule.until.0) {
        progress.is_prepared = Some(false);
    } else if meets(&case.rule.since.0) {
        progress.is_prepared = Some(true);
        if !was_open && case.rule.kind == RuleKind::Never {
            begin_never(case, progress, context);
        }
    }
    was_open && progress.is_prepared == Some(true)
}

/// Whether a PDO belongs to another node: its identifier is only presumed to be one of this node.
fn is_foreign(case: &RuleCase<'_>, event: &TriggerEvent<'_>) -> bool {
    matches!(event, TriggerEvent::Pdo(_)) && case.event.is_some_and(|of| of.node != Some(case.facts.id))
}

/// When `on` occurs, none of `needs` may be proven false; with `ms`, not for this time.
pub(super) fn judge_precondition(
    case: &RuleCase<'_>,
    progress: &mut RuleProgress,
    event: &TriggerEvent<'_>,
    context: &mut RuleContext<'_>,
) {
    if case.matching_trigger(event).is_none() || !case.is_due() {
        return;
    }
    let (needs, channel) = (&case.rule.needs.0, case.rule.channel);
    let status = case.facts.needs_status(case.rule, case.number);
    if status != GateStatus::Closed {
        progress.last = None;
    }
    match status {
        GateStatus::Open => context.count_pass(),
        GateStatus::Unknown | GateStatus::Invisible => {}
        GateStatus::Closed => {
            let frames = match lasting_violation(case, progress, context) {
                Some(first) => FrameRange { first, last: case.frames.last },
                None => return,
            };
            let (facts, text) = (case.facts, &case.rule.text);
            case.start_finding(event, context).with_frames(frames).report_finding(|| {
                let instead =
                    facts.first_unmet(needs, channel).filter(|(object, _)| !is_value_of(event, *object));
                let instead = instead.map_or_else(String::new, |(_, instead)| format!(", {instead}"));
                with_details(text, &format!("{}{instead}", show_event(event)))
            });
        }
    }
}

/// First frame of the violation, if it lasts for `ms`.
fn lasting_violation(
    case: &RuleCase<'_>,
    progress: &mut RuleProgress,
    context: &RuleContext<'_>,
) -> Option<u64> {
    if case.rule.ms.is_none() && case.rule.ms_of.is_none() {
        return Some(case.frames.first);
    }
    let now = FrameTime { time: context.now, frame: case.frames.first };
    let first = *progress.last.get_or_insert(now);
    let lasts = context.now.saturating_sub(first.time).saturating_sub(context.granularity);
    (context.has_time && lasts >= case.time_limit()?).then_some(first.frame)
}

/// The first occurrences of the steps must have the given order.
pub(super) fn judge_sequence(
    case: &RuleCase<'_>,
    progress: &mut RuleProgress,
    event: &TriggerEvent<'_>,
    context: &mut RuleContext<'_>,
) {
    if matches!(event, TriggerEvent::Boot { .. }) {
        (progress.is_prepared, progress.done) = (Some(true), 0);
    }
    for (place, step) in (0..u64::BITS).zip(&case.rule.steps) {
        if !step.0.iter().any(|trigger| trigger.is_met_by(event)) {
            continue;
        }
        let (own, before) = (1 << place, progress.done);
        progress.done |= own;
        if progress.is_prepared != Some(true) || before & own != 0 || !case.is_due() {
            continue;
        }
        if before & (u64::MAX << place) != 0 {
            let text = &case.rule.text;
            case.start_finding(event, context).report_finding(|| with_details(text, &show_event(event)));
        } else if before != 0 {
            context.count_pass();
        }
    }
}

/// `on` must occur after `before`; `since` invalidates an earlier `before`.
pub(super) fn judge_order(
    case: &RuleCase<'_>,
    progress: &mut RuleProgress,
    event: &TriggerEvent<'_>,
    context: &mut RuleContext<'_>,
) {
    if case.matching_trigger(event).is_some() && case.is_due() {
        let text = &case.rule.text;
        let is_early = progress.voided.zip(case.time_limit()).is_some_and(|(since, grace)| {
            context.now.saturating_sub(since) < grace.saturating_add(context.granularity)
        });
        match progress.is_prepared {
            Some(true) => context.count_pass(),
            Some(false) if is_early => {}
            Some(false) => {
                case.start_finding(event, context).report_finding(|| with_details(text, &show_event(event)));
            }
            None => {}
        }
    }
    let is_start = matches!(event, TriggerEvent::Boot { .. });
    let since = &case.rule.since.0;
    let is_void = if since.is_empty() { is_start } else { since.iter().any(|it| it.is_met_by(event)) };
    if case.rule.before.0.iter().any(|it| it.is_met_by(event)) {
        progress.is_prepared = Some(true);
    } else if is_void {
        progress.is_prepared = Some(false);
        // After a boot-up, nothing from the time before it is received.
        progress.voided = (!is_start).then_some(context.now);
    } else if is_start {
        // A restart makes the order unknown.
        progress.is_prepared = None;
    }
}
