//! Set points: range of values, and whether the device acts on them.

use super::alignment::NodePair;
use super::difference::{
    CaptureComparison, ComparedSide, DifferenceKind, DifferenceSection, Observation, SubjectNoun,
};
use super::record::{EvidenceMark, PointRecord};
use super::scope::ComparisonScope;
use crate::words::count_noun;

const SECTION: DifferenceSection = DifferenceSection::SetPoints;

/// Compares the set points of all nodes.
pub(super) fn compare_points(scope: &ComparisonScope<'_>, out: &mut CaptureComparison) {
    for pair in scope.alignment.buses.iter().flat_map(|bus| &bus.nodes) {
        for (key, good) in &pair.good.points {
            let aspect = point_aspect(*key, good);
            match pair.bad.points.get(key) {
                Some(bad) => compare_point((pair, &aspect), (good, bad), scope, out),
                None => {
                    out.add_not_seen(
                        (SECTION, SubjectNoun::SetPoint),
                        ComparedSide::Bad,
                        (&pair.label, aspect),
                        good.extreme,
                    );
                }
            }
        }
        for (key, bad) in pair.bad.points.iter().filter(|(key, _)| !pair.good.points.contains_key(key)) {
            let aspect = point_aspect(*key, bad);
            out.add_not_seen(
                (SECTION, SubjectNoun::SetPoint),
                ComparedSide::Good,
                (&pair.label, aspect),
                bad.extreme,
            );
        }
    }
}

fn point_aspect(key: (crate::wire::canopen::ObjectAddress, Option<u8>), point: &PointRecord) -> String {
    let channel = key.1.map_or(String::new(), |channel| format!(" c{channel}"));
    format!("{} {}{channel}", key.0, point.signal)
}

fn compare_point(
    (pair, aspect): (&NodePair<'_>, &str),
    (good, bad): (&PointRecord, &PointRecord),
    scope: &ComparisonScope<'_>,
    out: &mut CaptureComparison,
) {
    let before = out.differences.len();
    let label = pair.label.as_str();
    if is_ineffective(good) != is_ineffective(bad) {
        let value = |it: &PointRecord| {
            let text = match (is_ineffective(it), it.effective.count) {
                (true, _) => format!("not effective {}", count_noun(it.ineffective.count, "time")),
                (false, 0) => "effect unknown".to_owned(),
                (false, _) => "effective".to_owned(),
            };
            let mark = if is_ineffective(it) { it.ineffective.first } else { it.effective.first };
            Some(Observation::new(text, mark))
        };
        let gates = if is_ineffective(bad) { &bad.gates } else { &good.gates };
        let note = if gates.is_empty() { String::new() } else { format!("closed: {}", gates.join(", ")) };
        out.add_difference(
            (SECTION, DifferenceKind::Effect),
            (label, aspect),
            (value(good), value(bad)),
            note,
        );
    }
    if let (Some(one), Some(other)) = (good.range, bad.range) {
        let span = (one.1 - one.0).max(one.0.abs()).max(one.1.abs());
        let limit = span * scope.tolerances.set_point / 100.0;
        if (one.0 - other.0).abs() > limit || (one.1 - other.1).abs() > limit {
            let value = |it: &PointRecord| {
                let mark = if it.is_assumed { "?" } else { "" };
                let text = match &it.texts {
                    [low, high] if low == high => format!("{low}{mark}"),
                    [low, high] => format!("{low} to {high}{mark}"),
                };
                Some(Observation::new(text, it.extreme))
            };
            let values = (value(good), value(bad));
            out.add_difference(
                (SECTION, DifferenceKind::SetPoint),
                (label, format!("{aspect} range")),
                values,
                "",
            );
        }
    }
    compare_following((label, aspect), (good, bad), scope, out);
    if before == out.differences.len() {
        out.add_equal(SECTION, SubjectNoun::SetPoint);
    }
}

/// Median deviation of the measured value from set points that were held, relative to the range of the set point.
#[expect(clippy::cast_precision_loss, reason = "a tolerance needs few digits")]
fn compare_following(
    (label, aspect): (&str, &str),
    (good, bad): (&PointRecord, &PointRecord),
    scope: &ComparisonScope<'_>,
    out: &mut CaptureComparison,
) {
    let median = |it: &PointRecord| it.deviations.percentile(50).map(|thousandths| thousandths as f64 / 1e3);
    let (Some(one), Some(other), Some(range)) = (median(good), median(bad), good.range) else { return };
    let span = range.0.abs().max(range.1.abs());
    if (one - other).abs() <= span * scope.tolerances.set_point / 100.0 {
        return;
    }
    let value = |it: &PointRecord, deviation: f64| {
        Some(Observation::new(format!("{deviation:.1} {}", it.unit).trim_end(), EvidenceMark::default()))
    };
    let values = (value(good, one), value(bad, other));
    let aspect = format!("{aspect} deviation of the measured value");
    out.add_difference((SECTION, DifferenceKind::Following), (label, aspect), values, "median");
}

/// Whether most values other than 0 had no effect.
fn is_ineffective(point: &PointRecord) -> bool {
    point.ineffective.count > point.effective.count
}
