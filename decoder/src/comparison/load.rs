//! Bus load and error frames.

use super::difference::{Comparison, Kind, Observation, Section, Side, SubjectNoun};
use super::ranking::ranking;
use super::record::{BusRecord, CaptureRecord, Mark};
use super::scope::Scope;

const SECTION: Section = Section::Load;

/// Minimum duration of a capture for its load, in seconds.
const SHORTEST: f64 = 1.0;

/// Compares the load of all buses, and the error frames.
pub(super) fn compare(scope: &Scope<'_>, out: &mut Comparison) {
    error_frames(scope, out);
    let (one, other) = scope.seconds();
    if !scope.is_timed() || one.min(other) < SHORTEST {
        return;
    }
    for bus in &scope.alignment.buses {
        let (good, bad) = (rate(bus.good, one), rate(bus.bad, other));
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
            Some(Observation::new(text, Mark::default()))
        };
        let name = if bus.prefix.is_empty() { "bus".to_owned() } else { bus.prefix.trim_end().to_owned() };
        out.add((SECTION, Kind::Load), (name, "load"), (value(good), value(bad)), "mean");
    }
}

/// Bits per second.
#[expect(clippy::cast_precision_loss, reason = "a rate needs few digits")]
fn rate(bus: &BusRecord, seconds: f64) -> f64 {
    bus.bits as f64 / seconds
}

/// No format states whether error frames were recorded, so a capture without any shows nothing.
fn error_frames(scope: &Scope<'_>, out: &mut Comparison) {
    let (good, bad) = (scope.good.error_frames, scope.bad.error_frames);
    let text = |count| crate::words::plural(count, "error frame");
    match (good, bad) {
        (0, 0) => {}
        (0, bad) => {
            out.add_not_seen(
                (SECTION, SubjectNoun::ErrorFrame),
                Side::Good,
                (text(bad), ""),
                Mark::default(),
            );
            // A finding that reports them is printed instead.
            if !scope.bad.findings.iter().any(|it| ranking().needs_error_frames(&it.rule)) {
                out.raise_not_seen(ranking().weight(Kind::ErrorFrames.name()));
            }
        }
        (good, 0) => {
            out.add_not_seen(
                (SECTION, SubjectNoun::ErrorFrame),
                Side::Bad,
                (text(good), ""),
                Mark::default(),
            );
        }
        (good, bad) if scope.counts_differ(good, bad) => {
            let value =
                |record: &CaptureRecord| Some(Observation::new(text(record.error_frames), Mark::default()));
            let values = (value(scope.good), value(scope.bad));
            out.add((SECTION, Kind::ErrorFrames), ("bus", "error frames"), values, "compared as rates");
        }
        _ => out.add_equal(SECTION, SubjectNoun::ErrorFrameRate),
    }
}
