//! Conclusions as findings, with the findings that they explain.

use std::collections::VecDeque;
use std::sync::Arc;

use super::{FindingLedger, GroupChange, GroupState, LedgerNews, RuleRelations, build_occurrence};
use crate::conclusion::{Conclusion, ExplainedFindings, conclude, find_hypothesis};
use crate::event::FrameRange;
use crate::finding::{
    FindingCause, FindingGroup, FindingSubject, GROUP_LIMIT, GroupKey, Occurrence, RuleInfo, Severity,
};
use crate::frame::Timestamp;
use crate::session::{Bus, Node};
use crate::wire::NodeId;

/// Rule about boot-ups.
const RESTART: &str = "unexpected-boot";

/// Time from the end of a failure to its last consequences, in ns: a node starts again, its controller configures it.
const AFTER: i64 = 5_000_000_000;

/// Time from a consequence to the last element before the failure, in ns: several messages end one after the other.
const BEFORE: i64 = 200_000_000;

/// Reason for the lower severity of a long silence after which a node continues.
const SWITCHED_OFF: &str = "it may be intended";

/// Reason for the lower severity of findings while the machine was switched off and on.
const POWER_CYCLE: &str = "the machine was switched off and on";

/// Lowers the severity of findings that the restart of the whole machine explains: silences before it, boot-ups, late messages
/// until the controller runs again.
pub(in crate::rules) fn lower_power_cycles(ledger: &mut FindingLedger, bus: &Bus) {
    let nodes: Vec<NodeId> = bus.nodes().map(Node::id).collect();
    for (from, to) in ledger.moments.machine_starts(bus.index(), &nodes) {
        let (from, to) = (bus.stamp_of(from), bus.stamp_of(to.min(bus.now())));
        let is_meant = |group: &FindingGroup, rules: &[RuleInfo]| {
            let rule = rules.get(usize::from(group.key.rule));
            let is_of_start = rule.is_some_and(|rule| rule.is_timing || &*rule.name == RESTART);
            let mut times = group.first.iter().chain(&group.last).map(|at| at.time);
            let is_in = |time: Option<Timestamp>| {
                time.zip(from).zip(to).is_some_and(|((time, from), to)| from <= time && time <= to)
            };
            group.key.bus == bus.index() && is_of_start && !group.lasts_to_end && times.all(is_in)
        };
        for group in &mut ledger.groups {
            if group.severity > Severity::Note && is_meant(group, &ledger.rules) {
                group.severity = Severity::Note;
                group.downgraded.get_or_insert_with(|| POWER_CYCLE.to_owned());
            }
        }
    }
}

/// Adds what fails on a bus as findings. A failure of one node or message that a rule reports already is that finding.
pub(in crate::rules) fn add_conclusions(ledger: &mut FindingLedger, bus: &Bus) {
    for conclusion in conclude(bus, &ledger.moments, &ledger.groups) {
        let Some(row) = find_hypothesis(conclusion.hypothesis) else { continue };
        let explained = explained_by(ledger, &conclusion, row.explains, bus);
        let reports: Vec<&FindingGroup> = explained
            .iter()
            .filter_map(|place| ledger.groups.get(*place).filter(|group| group.severity > Severity::Note))
            .collect();
        // A command that a rule names already, as the cause of its findings.
        let is_named = reports.iter().any(|group| is_caused_by(group, conclusion.began.1));
        let is_stated = reports.iter().any(|group| row.stated_by.iter().any(|rule| **rule == *group.rule));
        let is_reported = row.explains == ExplainedFindings::Same && !reports.is_empty();
        if !is_reported && !is_stated && !is_named {
            add_conclusion(ledger, &conclusion, &explained, bus);
        }
    }
}

/// Places of the findings that are consequences of a failure.
fn explained_by(
    ledger: &FindingLedger,
    conclusion: &Conclusion,
    explains: ExplainedFindings,
    bus: &Bus,
) -> Vec<usize> {
    let from = bus.stamp_of(conclusion.began.0.saturating_sub(BEFORE));
    let to = conclusion.ended.map_or(i64::MAX, |ended| ended.0).saturating_add(AFTER);
    let to = bus.stamp_of(to.min(bus.now()));
    let is_meant = |group: &FindingGroup| {
        let is_own = group
            .key
            .node
            .is_some_and(|node| conclusion.nodes.contains(&node) || conclusion.node == Some(node));
        let is_of_bus = explains == ExplainedFindings::Bus && is_communication(ledger, group, conclusion);
        let time = group.first_occurrence().time;
        let is_in_time = time.zip(from).zip(to).is_some_and(|((time, from), to)| from <= time && time <= to);
        group.key.bus == bus.index() && (is_own || is_of_bus) && is_in_time && group.is_reported()
    };
    let all = ledger.groups.iter().enumerate().filter(|(_, group)| is_meant(group));
    all.map(|(place, _)| place).collect()
}

/// Whether a finding is about the bus, about times, or an EMCY about communication (CiA 301 table 26: 81xx, 82xx), or follows
/// the same fact as a failure.
fn is_communication(ledger: &FindingLedger, group: &FindingGroup, conclusion: &Conclusion) -> bool {
    if group.key.node.is_none() || is_caused_by(group, conclusion.began.1) {
        return true;
    }
    match group.key.about {
        FindingSubject::Code(code) => (0x8100..=0x82FF).contains(&code),
        _ => ledger.rules.get(usize::from(group.key.rule)).is_some_and(|rule| rule.is_timing),
    }
}

fn add_conclusion(ledger: &mut FindingLedger, conclusion: &Conclusion, explained: &[usize], bus: &Bus) {
    let Some(row) = find_hypothesis(conclusion.hypothesis) else { return };
    if ledger.groups.len() >= GROUP_LIMIT {
        return;
    }
    let Some(rule) = ledger.add_rule(row.rule_info(), RuleRelations::default()) else { return };
    let key = GroupKey { rule, bus: bus.index(), node: conclusion.node, about: conclusion.about.clone() };
    let Some(place) = push_conclusion(ledger, key, conclusion, bus) else { return };
    let id = ledger.groups.get(place).map_or(0, |group| group.id);
    for effect in explained {
        if let Some(group) = ledger.groups.get_mut(*effect).filter(|group| group.cause.is_none()) {
            group.cause = Some(FindingCause::Group(id));
        }
    }
    let at = ledger.groups.get(place).map_or(NOWHERE, FindingGroup::first_occurrence);
    ledger.news.push(LedgerNews { group: place, what: GroupChange::Opened, at });
}

/// Adds the group of a conclusion; its place, or `None` for one that is known.
fn push_conclusion(
    ledger: &mut FindingLedger,
    key: GroupKey,
    conclusion: &Conclusion,
    bus: &Bus,
) -> Option<usize> {
    if ledger.has_group(&key) {
        return None;
    }
    let info = ledger.rules.get(usize::from(key.rule))?;
    let place = ledger.groups.len();
    let node = key.node.and_then(|node| bus.node(node));
    let (began, ended) = (conclusion.began, conclusion.ended);
    let end = ended.map_or(bus.now(), |ended| ended.0);
    let at = build_occurrence(bus.stamp_of(began.0), FrameRange::one(began.1));
    let mut group = FindingGroup {
        id: place as u64 + 1,
        rule: Arc::clone(&info.name),
        bus: bus.name().into(),
        node_name: node.and_then(Node::name).map(Arc::from),
        object_name: None,
        next_step: info.next_step.clone(),
        manual: None,
        severity: if conclusion.is_note { Severity::Note } else { info.severity },
        text: conclusion.text.clone(),
        worst: None,
        count: 1,
        lasted: Some(end.saturating_sub(began.0)),
        lasts_to_end: ended.is_none(),
        first: vec![at],
        last: VecDeque::new(),
        cause: None,
        is_absorbed: false,
        member_of: None,
        scene: None,
        downgraded: conclusion.is_note.then(|| SWITCHED_OFF.to_owned()),
        suppressed: None,
        is_open: false,
        nodes: conclusion.nodes.clone(),
        key: key.clone(),
    };
    group.suppressed = ledger.policy.suppression_reason(&group);
    if let Some(tally) = ledger.tallies.get_mut(usize::from(key.rule)) {
        tally.failed += 1;
    }
    ledger.groups.push(group);
    ledger.courses.push(GroupState { since_open: 1, ..GroupState::default() });
    ledger.by_key.insert(key, place);
    Some(place)
}

/// Whether a fact of this frame is the cause of a finding.
fn is_caused_by(group: &FindingGroup, frame: u64) -> bool {
    matches!(&group.cause, Some(FindingCause::Fact(fact)) if fact.at.frames.first == frame)
}

const NOWHERE: Occurrence = Occurrence { time: None, frames: FrameRange::one(0) };
