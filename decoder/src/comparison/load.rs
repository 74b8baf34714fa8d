//! Bus load and error frames.

use super::difference::{
    CaptureComparison, ComparedSide, DifferenceKind, DifferenceSection, Observation, SubjectNoun,
};
use super::ranking::load_ranking;
use super::record::{BusRecord, CaptureRecord, EvidenceMark};
use super::scope::ComparisonScope;

const SECTION: DifferenceSection = DifferenceSection::Load;

/// Minimum duration of a capture for its load, in seconds.
const SHORTEST: f64 = 1.0;

/// Compares the load of all buses, and the error frames.
pub(super) fn compare_load(scope: &ComparisonScope<'_>, out: &mut CaptureComparison) {
    error_frames(scope, out);
    let (one, other) = scope.seconds();
    if !scope.is_timed() || one.min(other) < SHORTEST {
        return;
    }
    for bus in &scope.alignment.buses {
        let (good, bad) = (bit_rate(bus.good, one), bit_rate(bus.bad, other));
        if (good - bad).abs() <= good.min(bad) * scope.tolerances.load / 100.0 {
            out.add_equal(SECTION, SubjectNoun::BusLoad);
            continue;
        }
        let bit_rate = bus.good.bit_rate.or(bus.bad.bit_rate);
        let value = |rate: f64| {
            let text = match bit_rate.filter(|rate| *rate > 0) {
                Some(bit_rate) => format!("{:.1} %", rate * 100.0 / f64::from(bit_rate)),
                None => format!("{:.1} kbit/s", rate / 1e3),
            };
            Some(Observation::new(text, EvidenceMark::default()))
        };
        let name = if bus.prefix.is_empty() { "bus".to_owned() } else { bus.prefix.trim_end().to_owned() };
        out.add_difference(
            (SECTION, DifferenceKind::Load),
            (name, "load"),
            (value(good), value(bad)),
            "mean",
        );
    }
}

/// Bits per second.
#[expect(clippy::cast_precision_loss, reason = "a rate needs few digits")]
fn bit_rate(bus: &BusRecord, seconds: f64) -> f64 {
    bus.bits as f64 / seconds
}

/// No format states whether error frames were recorded, so a capture without any shows nothing.
fn error_frames(scope: &ComparisonScope<'_>, out: &mut CaptureComparison) {
    let (good, bad) = (scope.good.error_frames, scope.bad.error_frames);
    let text = |count| crate::words::count_noun(count, "error frame");
    match (good, bad) {
        (0, 0) => {}
        (0, bad) => {
            out.add_not_seen(
                (SECTION, SubjectNoun::ErrorFrame),
                ComparedSide::Good,
                (text(bad), ""),
                EvidenceMark::default(),
            );
            // A finding that reports them is printed instead.
            if !scope.bad.findings.iter().any(|it| load_ranking().needs_error_frames(&it.rule)) {
                out.raise_not_seen(load_ranking().difference_weight(DifferenceKind::ErrorFrames.name()));
            }
        }
        (good, 0) => {
            out.add_not_seen(
                (SECTION, SubjectNoun::ErrorFrame),
                ComparedSide::Bad,
                (text(good), ""),
                EvidenceMark::default(),
            );
        }
        (good, bad) if scope.counts_differ(good, bad) => {
            let value = |record: &CaptureRecord| {
                Some(Observation::new(text(record.error_frames), EvidenceMark::default()))
            };
            let values = (value(scope.good), value(scope.bad));
            out.add_difference(
                (SECTION, DifferenceKind::ErrorFrames),
                ("bus", "error frames"),
                values,
                "compared as rates",
            );
        }
        _ => out.add_equal(SECTION, SubjectNoun::ErrorFrameRate),
    }
}
