//! States of NMT and of devices: fault states, the state with most of the time, the last state.

use super::alignment::NodePair;
use super::difference::{
    CaptureComparison, ComparedSide, DifferenceKind, DifferenceSection, Observation, SubjectNoun,
};
use super::record::{StateRecord, StateTime};
use super::scope::ComparisonScope;
use super::times::format_duration;
use crate::words::count_noun;

const SECTION: DifferenceSection = DifferenceSection::States;

/// Compares the state machines of all nodes.
pub(super) fn compare_states(scope: &ComparisonScope<'_>, out: &mut CaptureComparison) {
    let pairs = scope.alignment.buses.iter().flat_map(|bus| &bus.nodes);
    for pair in pairs.filter(|pair| pair.good.is_present || pair.bad.is_present) {
        for (name, good) in &pair.good.machines {
            match pair.bad.machines.get(name) {
                Some(bad) => compare_machine((pair, name), (good, bad), scope, out),
                None => not_seen((pair, name), good, ComparedSide::Bad, out),
            }
        }
        for (name, bad) in &pair.bad.machines {
            if !pair.good.machines.contains_key(name) {
                report_lone_machine((pair, name), bad, scope, out);
            }
        }
    }
}

fn not_seen(
    (pair, name): (&NodePair<'_>, &str),
    record: &StateRecord,
    by: ComparedSide,
    out: &mut CaptureComparison,
) {
    let aspect = format!("{name} {}", record.last);
    out.add_not_seen((SECTION, SubjectNoun::StateMachine), by, (&pair.label, aspect), record.since);
}

/// A state machine that only the second capture shows: its fault states count.
fn report_lone_machine(
    (pair, name): (&NodePair<'_>, &str),
    bad: &StateRecord,
    scope: &ComparisonScope<'_>,
    out: &mut CaptureComparison,
) {
    let has_fault = bad.states.values().any(|state| state.is_fault);
    if has_fault && pair.good.was_operational {
        return compare_faults((pair, name), (&StateRecord::default(), bad), scope, out);
    }
    not_seen((pair, name), bad, ComparedSide::Good, out);
}

fn compare_machine(
    place: (&NodePair<'_>, &str),
    (good, bad): (&StateRecord, &StateRecord),
    scope: &ComparisonScope<'_>,
    out: &mut CaptureComparison,
) {
    let before = out.differences.len();
    compare_faults(place, (good, bad), scope, out);
    let (pair, name) = place;
    if let (Some(one), Some(other)) = (main_state(good, scope.is_timed()), main_state(bad, scope.is_timed()))
        && (one.0 != other.0 || good.last != bad.last)
        && before == out.differences.len()
    {
        let value = |record: &StateRecord, main: (&String, &StateTime)| {
            let last =
                if record.last == *main.0 { String::new() } else { format!(", {} at the end", record.last) };
            let time =
                if scope.is_timed() { format!(" {}", format_duration(main.1.time)) } else { String::new() };
            Some(Observation::new(format!("{}{time}{last}", main.0), record.since))
        };
        let values = (value(good, one), value(bad, other));
        out.add_difference((SECTION, DifferenceKind::State), (&pair.label, name), values, "");
    }
    if before == out.differences.len() {
        out.add_equal(SECTION, SubjectNoun::StateMachine);
    }
}

/// State with most of the time; without times the last state.
fn main_state(record: &StateRecord, is_timed: bool) -> Option<(&String, &StateTime)> {
    let last = || record.states.get_key_value(&record.last);
    let longest = || record.states.iter().max_by_key(|(name, state)| (state.time, **name == record.last));
    if is_timed { longest() } else { last() }
}

fn compare_faults(
    (pair, name): (&NodePair<'_>, &str),
    (good, bad): (&StateRecord, &StateRecord),
    scope: &ComparisonScope<'_>,
    out: &mut CaptureComparison,
) {
    let none = StateTime::default();
    let all = good.states.iter().chain(&bad.states).filter(|(_, state)| state.is_fault);
    let mut names: Vec<_> = all.map(|(state, _)| state).collect();
    names.sort();
    names.dedup();
    for state in names {
        let (one, other) = (good.states.get(state).unwrap_or(&none), bad.states.get(state).unwrap_or(&none));
        if !scope.counts_differ(one.at.count, other.at.count) {
            continue;
        }
        let value = |it: &StateTime| {
            let text = match it.at.count {
                0 => "never".to_owned(),
                count if scope.is_timed() => {
                    format!("{}, {}", count_noun(count, "time"), format_duration(it.time))
                }
                count => count_noun(count, "time"),
            };
            Some(Observation::new(text, it.at.first))
        };
        let aspect = format!("{name} {state}");
        out.add_difference(
            (SECTION, DifferenceKind::FaultState),
            (&pair.label, aspect),
            (value(one), value(other)),
            "",
        );
    }
}
