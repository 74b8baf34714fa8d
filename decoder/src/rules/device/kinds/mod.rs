//! Kinds of rules: each kind of statement is judged in one of these files.

pub(super) mod frames;

mod counts;
mod order;
mod times;
mod values;

use super::case::RuleCase;
use super::progress::RuleProgress;
use crate::profile::device::{RuleKind, TriggerEvent};
use crate::rules::Context;

/// Judges an event at a node by one rule.
pub(super) fn judge_event(
    case: &RuleCase<'_>,
    progress: &mut RuleProgress,
    event: &TriggerEvent<'_>,
    context: &mut Context<'_>,
) {
    if let (TriggerEvent::State(Some(channel), _), Some(own)) = (event, case.rule.channel)
        && *channel != own
    {
        return;
    }
    match case.rule.kind {
        RuleKind::Limit => values::judge_limit(case, event, context),
        RuleKind::Forbidden | RuleKind::Permitted => values::judge_values(case, event, context),
        RuleKind::Ascending => values::judge_ascent(case, progress, event, context),
        RuleKind::Never => order::judge_never(case, event, context),
        RuleKind::Precondition => order::judge_precondition(case, event, context),
        RuleKind::Order => order::judge_order(case, progress, event, context),
        RuleKind::MinInterval => times::judge_min_interval(case, progress, event, context),
        RuleKind::MaxInterval => times::judge_max_interval(case, progress, event, context),
        RuleKind::Follow => times::judge_follow(case, progress, event, context),
        RuleKind::MaxCount => counts::judge_count(case, progress, event, context),
        RuleKind::ReservedId | RuleKind::Expedited | RuleKind::RemoteLength => {}
    }
}

/// An event may begin or end a stretch in which the rule is judged.
pub(super) fn follow_while(case: &RuleCase<'_>, progress: &mut RuleProgress, context: &mut Context<'_>) {
    let held = std::mem::replace(&mut progress.holds, case.is_due());
    match case.rule.kind {
        RuleKind::MaxInterval => times::follow_stretch(case, progress, held, context),
        RuleKind::Follow if !progress.holds => (progress.last, progress.deadline) = (None, None),
        // An event that never occurs passes in each stretch.
        RuleKind::Never if progress.holds && !held => context.pass(),
        RuleKind::MaxCount if held && !progress.holds => counts::end_stretch(case, progress, context),
        _ => {}
    }
}

/// A deadline of the rule may have passed.
pub(super) fn on_deadline(case: &RuleCase<'_>, progress: &mut RuleProgress, context: &mut Context<'_>) {
    progress.wake.take_if(|wake| *wake <= context.now);
    let Some(deadline) = progress.deadline else { return };
    if deadline > context.now {
        return case.wait(progress, deadline, context);
    }
    progress.deadline = None;
    match case.rule.kind {
        RuleKind::Follow => times::judge_missing(case, progress, deadline, context),
        RuleKind::Ascending => values::judge_written_row(case, context),
        _ => {}
    }
}

/// The capture ends.
pub(super) fn on_end(case: &RuleCase<'_>, progress: &mut RuleProgress, context: &mut Context<'_>) {
    if case.rule.kind == RuleKind::MaxInterval {
        times::judge_end(case, progress, context);
    }
}
