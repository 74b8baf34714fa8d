//! Events that are forbidden, have a precondition, or need another event first.

use crate::profile::device::{GateStatus, TriggerEvent};
use crate::rules::Context;
use crate::rules::device::case::RuleCase;
use crate::rules::device::describe::{is_value_of, show_event};
use crate::rules::device::progress::RuleProgress;

/// `on` does not happen.
pub(super) fn judge_never(case: &RuleCase<'_>, event: &TriggerEvent<'_>, context: &mut Context<'_>) {
    if case.on(event).is_some() && case.is_due() {
        let text = &case.rule.text;
        case.fail(event, context).say(|| format!("{}: {text}", show_event(event)));
    }
}

/// When `on` happens, nothing of `needs` is proven to be missing.
pub(super) fn judge_precondition(case: &RuleCase<'_>, event: &TriggerEvent<'_>, context: &mut Context<'_>) {
    if case.on(event).is_none() || !case.is_due() {
        return;
    }
    let (needs, channel) = (&case.rule.needs.0, case.rule.channel);
    match case.facts.needs(case.rule, case.number) {
        GateStatus::Open => context.pass(),
        GateStatus::Unknown | GateStatus::Invisible => {}
        GateStatus::Closed => {
            let (facts, text) = (case.facts, &case.rule.text);
            case.fail(event, context).say(|| {
                let instead = facts.unmet(needs, channel).filter(|(object, _)| !is_value_of(event, *object));
                let instead = instead.map_or_else(String::new, |(_, instead)| format!(", {instead}"));
                format!("{}{instead}: {text}", show_event(event))
            });
        }
    }
}

/// `on` occurs only after `before`; `since` makes an earlier `before` void.
pub(super) fn judge_order(
    case: &RuleCase<'_>,
    progress: &mut RuleProgress,
    event: &TriggerEvent<'_>,
    context: &mut Context<'_>,
) {
    if case.on(event).is_some() && case.is_due() {
        let text = &case.rule.text;
        match progress.is_prepared {
            Some(true) => context.pass(),
            Some(false) => case.fail(event, context).say(|| format!("{}: {text}", show_event(event))),
            None => {}
        }
    }
    let is_start = matches!(event, TriggerEvent::Boot);
    let since = &case.rule.since.0;
    let is_void = if since.is_empty() { is_start } else { since.iter().any(|it| it.is_met_by(event)) };
    if case.rule.before.0.iter().any(|it| it.is_met_by(event)) {
        progress.is_prepared = Some(true);
    } else if is_void {
        progress.is_prepared = Some(false);
    } else if is_start {
        // A restart makes the order unknown.
        progress.is_prepared = None;
    }
}
