//! Comparison of two records.

use super::alignment::align;
use super::difference::Comparison;
use super::record::CaptureRecord;
use super::scope::Scope;
use super::{configuration, faults, load, nodes, points, sequence, states, timing};
use crate::bus_file::DiffTolerances;

/// Compares the behaviour in two captures, by role and not by time.
pub fn compare(good: &CaptureRecord, bad: &CaptureRecord, tolerances: &DiffTolerances) -> Comparison {
    let scope = Scope { good, bad, alignment: align(good, bad), tolerances };
    let mut comparison = Comparison::default();
    for section in [
        sequence::compare,
        faults::compare,
        configuration::compare,
        nodes::compare,
        states::compare,
        points::compare,
        timing::compare,
        load::compare,
    ] {
        section(&scope, &mut comparison);
    }
    comparison.sort();
    comparison
}
