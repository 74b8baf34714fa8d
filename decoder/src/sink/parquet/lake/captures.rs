//! The row of a capture.

use std::io;

use super::capture::{LakeCapture, LakeResults};
use super::partitions::PushRow;
use crate::finding::Severity;
use crate::session::Bus;
use crate::sink::parquet::table::{Cell, Heading, Kind, always, maybe};
use crate::sink::parquet::time::{micros_of_date, nanos};

/// Columns of the table of captures.
pub(super) const HEADINGS: &[Heading] = &[
    maybe("time", Kind::Time),
    maybe("time_ns", Kind::Number),
    maybe("until", Kind::Time),
    always("capture", Kind::Name),
    maybe("format", Kind::Name),
    always("size", Kind::Number),
    always("parts", Kind::Number),
    always("frames", Kind::Number),
    maybe("duration", Kind::Real),
    maybe("buses", Kind::Name),
    always("nodes", Kind::Number),
    maybe("profiles", Kind::Name),
    always("verdict", Kind::Name),
    maybe("failure", Kind::Text),
    always("errors", Kind::Number),
    always("warnings", Kind::Number),
    always("notes", Kind::Number),
    always("stories", Kind::Number),
    maybe("first_story", Kind::Text),
    always("error_frames", Kind::Number),
    always("lost_frames", Kind::Number),
    always("unreadable", Kind::Number),
    always("clock_steps", Kind::Number),
    maybe("quality", Kind::Text),
    always("events", Kind::Number),
    always("signals", Kind::Number),
    always("cobscope", Kind::Name),
];

/// Numbers of rows in other tables.
#[derive(Clone, Copy)]
pub(super) struct RowCounts {
    pub(super) events: u64,
    pub(super) signals: u64,
}

/// Passes the row to `push`, with the time of the first frame.
///
/// # Errors
/// If the row cannot be written.
#[expect(clippy::cast_precision_loss, reason = "a fraction of a second does not matter in a hundred days")]
pub(super) fn row(
    capture: &LakeCapture,
    results: &LakeResults<'_>,
    counts: RowCounts,
    push: PushRow<'_>,
) -> io::Result<()> {
    let LakeResults { judged, diagnosis, quality, buses, format, .. } = results;
    let names: Vec<&str> = buses.iter().map(Bus::name).collect();
    let nodes = || buses.iter().flat_map(Bus::nodes).filter(|node| node.last_seen().0 > 0);
    let mut profiles: Vec<_> = nodes()
        .filter_map(|node| Some(format!("{}={}", node.id(), node.assigned().and(node.device_id())?)))
        .collect();
    profiles.sort_unstable();
    profiles.dedup();
    let (names, profiles) = (names.join(" "), profiles.join(" "));
    let limits = judged.findings.quality.join("; ");
    let duration = judged.first.zip(judged.last).map(|(first, last)| last.since(first) as f64 / 1e9);
    let of = |severity| number(judged.number(severity) as u64);
    let outcome = judged.outcome(results.least);
    push(
        judged.first,
        &[
            micros_of_date(judged.first),
            nanos(judged.first),
            micros_of_date(judged.last),
            Cell::Text(&judged.capture),
            Cell::text(*format),
            number(capture.size),
            number(capture.parts as u64),
            number(judged.frames),
            duration.map_or(Cell::Null, Cell::Real),
            Cell::text(Some(names.as_str()).filter(|names| !names.is_empty())),
            number(nodes().count() as u64),
            Cell::text(Some(profiles.as_str()).filter(|profiles| !profiles.is_empty())),
            Cell::Text(outcome.name()),
            Cell::text(judged.failure.as_deref()),
            of(Severity::Error),
            of(Severity::Warning),
            of(Severity::Note),
            number(diagnosis.stories.len() as u64),
            Cell::text(diagnosis.stories.first().map(|story| story.title.as_str())),
            number(quality.error_frames),
            number(quality.lost),
            number(quality.unreadable),
            number(quality.clock_steps.0),
            Cell::text(Some(limits.as_str()).filter(|limits| !limits.is_empty())),
            number(counts.events),
            number(counts.signals),
            Cell::Text(env!("CARGO_PKG_VERSION")),
        ],
    )
}

fn number(number: u64) -> Cell<'static> {
    Cell::Number(i64::try_from(number).unwrap_or(i64::MAX))
}
