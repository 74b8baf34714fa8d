//! Sequences: the first step that differs after an event.

use super::difference::{CaptureComparison, DifferenceKind, DifferenceSection, Observation, SubjectNoun};
use super::record::{CaptureRecord, EventSequence, SequenceStep};
use super::scope::ComparisonScope;
use crate::words::count_noun;

/// Compares the steps after the requested event.
pub(super) fn compare_sequence(scope: &ComparisonScope<'_>, out: &mut CaptureComparison) {
    let (Some(good), Some(bad)) = (&scope.good.sequence, &scope.bad.sequence) else { return };
    for (sequence, side) in [(good, "GOOD"), (bad, "BAD")] {
        if sequence.start.is_none() {
            let text = format!("{side}: no event matches --at-event; steps not compared");
            out.limits.push((DifferenceSection::Sequence, text));
        }
    }
    if good.start.is_none() || bad.start.is_none() {
        return;
    }
    let equal = good.steps.iter().zip(&bad.steps).take_while(|(one, other)| one.text == other.text).count();
    for _ in 0..equal {
        out.add_equal(DifferenceSection::Sequence, SubjectNoun::Step);
    }
    let (one, other) = (good.steps.get(equal), bad.steps.get(equal));
    let is_shown = match (one, other) {
        (Some(_), Some(_)) => true,
        (Some(step), None) => has_lasted(scope.bad, (good, step), bad),
        (None, Some(step)) => has_lasted(scope.good, (bad, step), good),
        (None, None) => return,
    };
    if !is_shown {
        let text = |sequence: &EventSequence| count_noun(sequence.steps.len(), "step");
        let (good, bad) = (text(good), text(bad));
        let text = format!("sequence: GOOD {good}, BAD {bad}; the common ones are equal");
        out.limits.push((DifferenceSection::Sequence, text));
        return;
    }
    let value = |step: Option<&SequenceStep>| step.map(|step| Observation::new(&*step.text, step.mark));
    let before = equal.checked_sub(1).and_then(|at| good.steps.get(at));
    let before = before.map_or(String::new(), |step| format!(" up to {}", step.text));
    let note = format!("{} equal{before}", count_noun(equal, "step"));
    let aspect = format!("step {}", equal + 1);
    let place = ("first difference", aspect);
    out.add_difference(
        (DifferenceSection::Sequence, DifferenceKind::Sequence),
        place,
        (value(one), value(other)),
        note,
    );
}

/// Whether a capture lasts long enough to show a step of the other one: a capture that ends earlier shows fewer steps.
fn has_lasted(
    record: &CaptureRecord,
    (other, step): (&EventSequence, &SequenceStep),
    own: &EventSequence,
) -> bool {
    const MARGIN: i64 = 1_000_000_000;
    let offset = step.mark.time.zip(other.start.and_then(|start| start.time));
    let rest = record.end.time.zip(own.start.and_then(|start| start.time));
    let (Some((at, began)), Some((end, start))) = (offset, rest) else { return false };
    end.saturating_sub(start) > at.saturating_sub(began).saturating_mul(2).saturating_add(MARGIN)
}
