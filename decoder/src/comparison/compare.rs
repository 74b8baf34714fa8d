//! Comparison of two records.

use super::alignment::align_captures;
use super::difference::CaptureComparison;
use super::record::CaptureRecord;
use super::scope::ComparisonScope;
use super::{configuration, faults, load, nodes, points, sequence, states, timing};
use crate::bus_file::DiffTolerances;

/// Compares the behaviour in two captures, by role and not by time.
pub fn compare_captures(
    good: &CaptureRecord,
    bad: &CaptureRecord,
    tolerances: &DiffTolerances,
) -> CaptureComparison {
    let scope = ComparisonScope { good, bad, alignment: align_captures(good, bad), tolerances };
    let mut comparison = CaptureComparison::default();
    for section in [
        sequence::compare_sequence,
        faults::compare_faults,
        configuration::compare_configuration,
        nodes::compare_nodes,
        states::compare_states,
        points::compare_points,
        timing::compare_timing,
        load::compare_load,
    ] {
        section(&scope, &mut comparison);
    }
    comparison.sort_by_weight();
    comparison
}
