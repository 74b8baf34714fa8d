//! Kinds of device rules; each family of kinds has its own file.

pub(super) mod address;
pub(super) mod frames;
pub(super) mod messages;
pub(super) mod reports;

mod counts;
mod order;
mod times;
mod values;

pub(super) use self::counts::{count_pdo, end_count};
pub(super) use self::order::exercise_never;
pub(super) use self::times::on_answer;
use super::case::RuleCase;
use super::progress::{PdoTask, RuleProgress};
use crate::profile::PdoName;
use crate::profile::device::{DeviceRule, ProfileTrigger, ProfileTriggers, RuleKind, TriggerEvent};
use crate::rules::RuleContext;

/// Runs one rule on an event at a node.
pub(super) fn judge_event(
    case: &RuleCase<'_>,
    progress: &mut RuleProgress,
    event: &TriggerEvent<'_>,
    context: &mut RuleContext<'_>,
) {
    if let (TriggerEvent::State(Some(channel), _), Some(own)) = (event, case.rule.channel)
        && *channel != own
    {
        return;
    }
    progress.has_begun |= !progress.has_begun && case.matching_trigger(event).is_some();
    if case.rule.is_scoped() && !order::follow_scope(case, progress, event, context) {
        return;
    }
    match case.rule.kind {
        RuleKind::Limit => values::judge_limit(case, event, context),
        RuleKind::Forbidden | RuleKind::Permitted => values::judge_values(case, event, context),
        RuleKind::Ascending => values::judge_ascent(case, progress, event, context),
        RuleKind::Never => order::judge_never(case, event, context),
        RuleKind::Precondition => order::judge_precondition(case, progress, event, context),
        RuleKind::Order => order::judge_order(case, progress, event, context),
        RuleKind::Sequence => order::judge_sequence(case, progress, event, context),
        RuleKind::MinInterval => times::judge_min_interval(case, progress, event, context),
        RuleKind::MaxInterval => times::judge_max_interval(case, progress, event, context),
        RuleKind::Follow => times::judge_follow(case, progress, event, context),
        RuleKind::MaxCount => counts::judge_count(case, progress, event, context),
        RuleKind::MessageLength => messages::judge_length(case, event, context),
        RuleKind::ReservedId
        | RuleKind::Expedited
        | RuleKind::RemoteLength
        | RuleKind::EmcyLength
        | RuleKind::EmcyCode
        | RuleKind::EmcyRegister
        | RuleKind::AbortCode
        | RuleKind::NodeId
        | RuleKind::SourceAddress
        | RuleKind::OnRequest
        | RuleKind::Constant
        | RuleKind::UdsServices => {}
    }
}

/// What a PDO does to a rule about it; a count only if its `while` holds until a value changes.
pub(super) fn task_of(rule: &DeviceRule, name: PdoName) -> PdoTask {
    let has = |triggers: &ProfileTriggers| triggers.0.contains(&ProfileTrigger::Pdo(name));
    match rule.kind {
        RuleKind::MaxCount if has(&rule.on) && counts::is_per_sync(rule) => PdoTask::Count,
        RuleKind::Follow if has(&rule.then) && !has(&rule.on) => PdoTask::Answer,
        _ => PdoTask::Evaluate,
    }
}

/// Updates `while`, which an event may start or end.
pub(super) fn follow_while(case: &RuleCase<'_>, progress: &mut RuleProgress, context: &mut RuleContext<'_>) {
    let held = std::mem::replace(&mut progress.holds, case.is_due());
    match case.rule.kind {
        RuleKind::MaxInterval => times::follow_stretch(case, progress, held, context),
        RuleKind::Follow if !progress.holds => (progress.last, progress.deadline) = (None, None),
        RuleKind::Precondition if !progress.holds => progress.last = None,
        RuleKind::Never if progress.holds && !held => order::begin_never(case, progress, context),
        RuleKind::MaxCount if held && !progress.holds => counts::end_stretch(case, progress, context),
        _ => {}
    }
}

/// Handles a wake-up for the deadline of the rule.
pub(super) fn on_deadline(case: &RuleCase<'_>, progress: &mut RuleProgress, context: &mut RuleContext<'_>) {
    progress.wake.take_if(|wake| *wake <= context.now);
    let Some(deadline) = progress.deadline else { return };
    if deadline > context.now {
        return case.wait_until(progress, deadline, context);
    }
    progress.deadline = None;
    match case.rule.kind {
        RuleKind::Follow => times::judge_missing(case, progress, deadline, context),
        RuleKind::Ascending => values::judge_written_row(case, context),
        _ => {}
    }
}

/// Handles the end of the capture.
pub(super) fn on_end(case: &RuleCase<'_>, progress: &mut RuleProgress, context: &mut RuleContext<'_>) {
    if case.rule.kind == RuleKind::MaxInterval {
        times::judge_end(case, progress, context);
    }
    if progress.has_begun && !case.rule.during.0.is_empty() {
        context.note_unexercised(format!("proof of {}", case.rule.during));
    }
}
