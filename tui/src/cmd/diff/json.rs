//! The comparison as one JSON object; see `docs/diff.schema.json`.

use cobscope_decoder::bus_file::DiffTolerances;
use cobscope_decoder::comparison::{
    CaptureRecord, Comparison, Difference, Mark, Observation, Side, UnobservedSubject,
};
use cobscope_decoder::sink::escape_json;
use serde_json::{Value, json};

/// Writes the report and a line end.
pub(super) fn write(
    comparison: &Comparison,
    (good, bad): (&CaptureRecord, &CaptureRecord),
    tolerances: &DiffTolerances,
    output: &mut String,
) {
    let equal = comparison.equal.iter().map(
        |((section, noun), count)| json!({"section": section.name(), "subject": noun.name(), "count": count}),
    );
    let report = json!({
        "good": capture(good),
        "bad": capture(bad),
        "equal": comparison.is_equal(),
        "differences": comparison.differences.iter().map(difference).collect::<Vec<_>>(),
        "not_seen": comparison.not_seen.iter().map(not_seen).collect::<Vec<_>>(),
        "equal_counts": equal.collect::<Vec<_>>(),
        "not_compared": comparison.limits.iter().map(|(_, text)| text).collect::<Vec<_>>(),
        "tolerances": {
            "period_percent": tolerances.period,
            "gap_percent": tolerances.gap,
            "longest_gap_percent": tolerances.longest_gap,
            "latency_percent": tolerances.latency,
            "count_percent": tolerances.count,
            "load_percent": tolerances.load,
            "set_point_percent": tolerances.set_point,
            "time_ms": tolerances.time_ms,
        },
    });
    output.push_str(&escape_json(&report.to_string()));
    output.push('\n');
}

fn capture(record: &CaptureRecord) -> Value {
    json!({
        "capture": record.name,
        "seconds": record.duration.map(seconds),
        "frames": record.frames,
        "error_frames": record.error_frames,
        "buses": record.buses.iter().map(|bus| &bus.name).collect::<Vec<_>>(),
        "timed": record.is_timed,
    })
}

fn difference(difference: &Difference) -> Value {
    json!({
        "section": difference.section.name(),
        "kind": difference.kind.name(),
        "subject": difference.subject,
        "aspect": difference.aspect,
        "good": difference.good.as_ref().map(observation),
        "bad": difference.bad.as_ref().map(observation),
        "note": difference.note,
        "weight": difference.weight,
    })
}

fn observation(value: &Observation) -> Value {
    let (frame, seconds) = place(value.mark);
    json!({"text": value.text, "frame": frame, "seconds": seconds})
}

fn not_seen(it: &UnobservedSubject) -> Value {
    let (frame, seconds) = place(it.mark);
    json!({
        "section": it.section.name(),
        "by": if it.by == Side::Good { "good" } else { "bad" },
        "kind": it.noun.name(),
        "subject": it.subject,
        "aspect": it.aspect,
        "weight": it.weight,
        "frame": frame,
        "seconds": seconds,
    })
}

fn place(mark: Mark) -> (Option<u64>, Option<f64>) {
    (Some(mark.frame).filter(|frame| *frame > 0), mark.time.map(seconds))
}

#[expect(clippy::cast_precision_loss, reason = "only for display")]
fn seconds(nanoseconds: i64) -> f64 {
    nanoseconds as f64 / 1e9
}
