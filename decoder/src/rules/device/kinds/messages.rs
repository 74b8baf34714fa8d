//! Rules about whole messages: length of J1939 messages, groups sent on request only, UDS services, fixed bits.

use crate::event::{Event, EventKind, UdsExchange};
use crate::finding::FindingSubject;
use crate::profile::PdoName;
use crate::profile::device::TriggerEvent;
use crate::rules::RuleContext;
use crate::rules::device::case::RuleCase;
use crate::rules::device::describe::with_details;
use crate::rules::device::progress::RuleProgress;
use crate::wire::j1939::Pgn;
use crate::words::count_noun;

/// A message of `on` has `bytes` bytes.
pub(super) fn judge_length(case: &RuleCase<'_>, event: &TriggerEvent<'_>, context: &mut RuleContext<'_>) {
    let (Some(bytes), Some(Event { kind: EventKind::J1939Message(message), .. })) =
        (case.rule.bytes, case.event)
    else {
        return;
    };
    if case.matching_trigger(event).is_none() || !case.is_due() {
        return;
    }
    if message.length == bytes {
        return context.count_pass();
    }
    let (text, length) = (&case.rule.text, message.length);
    case.start_finding(event, context).report_finding(|| with_details(text, &count_noun(length, "byte")));
}

/// A group is sent only after a request. A request before the first frame of the node may not be in the capture.
pub(in crate::rules::device) fn judge_group(
    case: &RuleCase<'_>,
    progress: &RuleProgress,
    pgn: Pgn,
    context: &mut RuleContext<'_>,
) {
    let Some(limit) = case.time_limit().filter(|_| context.has_time) else { return };
    let age = |time: i64| context.now.saturating_sub(time);
    let is_new = case.facts.own.present.is_none_or(|since| age(since) <= limit);
    if progress.last.is_some_and(|last| age(last.time) <= limit) {
        return context.count_pass();
    }
    let Some(event) = case.event.filter(|_| !is_new && case.is_due()) else { return };
    let alarm = context
        .start_finding(event)
        .at_node(Some(case.facts.id))
        .with_subject(FindingSubject::Pgn(pgn.number()));
    alarm.report_finding(|| with_details(&case.rule.text, ""));
}

/// A UDS request has one of the services in `values`.
pub(in crate::rules::device) fn judge_service(
    case: &RuleCase<'_>,
    exchange: &UdsExchange,
    context: &mut RuleContext<'_>,
) {
    let Some(event) = case.event.filter(|_| case.is_due()) else { return };
    let service = exchange.service;
    if case.rule.values.as_ref().is_some_and(|values| values.contains(i64::from(service))) {
        return context.count_pass();
    }
    let about = FindingSubject::Name(format!("{service:02X}").into());
    let alarm = context.start_finding(event).at_node(Some(case.facts.id)).with_subject(about);
    alarm.report_finding(|| with_details(&case.rule.text, &format!("service {service:02X}")));
}

/// The fixed bits of a PDO have their content.
pub(in crate::rules::device) fn judge_fixed_bits(
    case: &RuleCase<'_>,
    name: PdoName,
    differing: u64,
    context: &mut RuleContext<'_>,
) {
    if differing == 0 {
        return context.count_pass();
    }
    let Some(event) = case.event.filter(|_| case.is_due()) else { return };
    let byte = differing.trailing_zeros() / 8 + 1;
    let alarm = context
        .start_finding(event)
        .at_node(Some(case.facts.id))
        .with_subject(FindingSubject::Name(name.to_string().into()))
        .with_assumption(case.assumed);
    alarm.report_finding(|| with_details(&case.rule.text, &format!("{name}, byte {byte}")));
}
