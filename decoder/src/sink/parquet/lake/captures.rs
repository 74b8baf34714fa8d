//! The row of a capture.

use std::io;

use super::capture::{LakeCapture, LakeResults};
use super::partitions::PushRow;
use crate::finding::Severity;
use crate::session::Bus;
use crate::sink::parquet::table::{ColumnHeading, ColumnType, RowCell, optional_column, required_column};
use crate::sink::parquet::time::{micros_of_date, nanos_cell};

/// Columns of the table of captures.
pub(super) const HEADINGS: &[ColumnHeading] = &[
    optional_column("time", ColumnType::Time),
    optional_column("time_ns", ColumnType::Number),
    optional_column("until", ColumnType::Time),
    required_column("capture", ColumnType::Name),
    optional_column("format", ColumnType::Name),
    required_column("size", ColumnType::Number),
    required_column("parts", ColumnType::Number),
    required_column("frames", ColumnType::Number),
    optional_column("duration", ColumnType::Real),
    optional_column("buses", ColumnType::Name),
    required_column("nodes", ColumnType::Number),
    optional_column("profiles", ColumnType::Name),
    required_column("verdict", ColumnType::Name),
    optional_column("failure", ColumnType::Text),
    required_column("errors", ColumnType::Number),
    required_column("warnings", ColumnType::Number),
    required_column("notes", ColumnType::Number),
    required_column("stories", ColumnType::Number),
    optional_column("first_story", ColumnType::Text),
    required_column("error_frames", ColumnType::Number),
    required_column("lost_frames", ColumnType::Number),
    required_column("unreadable", ColumnType::Number),
    required_column("clock_steps", ColumnType::Number),
    optional_column("quality", ColumnType::Text),
    required_column("events", ColumnType::Number),
    required_column("signals", ColumnType::Number),
    required_column("cobscope", ColumnType::Name),
];

/// Numbers of rows in other tables.
#[derive(Clone, Copy)]
pub(super) struct TableRowCounts {
    pub(super) events: u64,
    pub(super) signals: u64,
}

/// Passes the row to `push`, with the time of the first frame.
///
/// # Errors
/// If the row cannot be written.
#[expect(clippy::cast_precision_loss, reason = "a fraction of a second does not matter in a hundred days")]
pub(super) fn push_row(
    capture: &LakeCapture,
    results: &LakeResults<'_>,
    counts: TableRowCounts,
    push: PushRow<'_>,
) -> io::Result<()> {
    let LakeResults { judged, diagnosis, quality, buses, format, .. } = results;
    let names: Vec<&str> = buses.iter().map(Bus::name).collect();
    let nodes = || buses.iter().flat_map(Bus::nodes).filter(|node| node.last_seen().0 > 0);
    let mut profiles: Vec<_> = nodes()
        .filter_map(|node| Some(format!("{}={}", node.id(), node.assigned_by().and(node.device_id())?)))
        .collect();
    profiles.sort_unstable();
    profiles.dedup();
    let (names, profiles) = (names.join(" "), profiles.join(" "));
    let limits = judged.findings.quality.join("; ");
    let duration = judged.first.zip(judged.last).map(|(first, last)| last.since(first) as f64 / 1e9);
    let of = |severity| number_cell(judged.printed_count(severity) as u64);
    let outcome = judged.overall_outcome(results.least);
    push(
        judged.first,
        &[
            micros_of_date(judged.first),
            nanos_cell(judged.first),
            micros_of_date(judged.last),
            RowCell::Text(&judged.capture),
            RowCell::text_or_null(*format),
            number_cell(capture.size),
            number_cell(capture.parts as u64),
            number_cell(judged.frames),
            duration.map_or(RowCell::Null, RowCell::Real),
            RowCell::text_or_null(Some(names.as_str()).filter(|names| !names.is_empty())),
            number_cell(nodes().count() as u64),
            RowCell::text_or_null(Some(profiles.as_str()).filter(|profiles| !profiles.is_empty())),
            RowCell::Text(outcome.name()),
            RowCell::text_or_null(judged.failure.as_deref()),
            of(Severity::Error),
            of(Severity::Warning),
            of(Severity::Note),
            number_cell(diagnosis.stories.len() as u64),
            RowCell::text_or_null(diagnosis.stories.first().map(|story| story.title.as_str())),
            number_cell(quality.error_frames),
            number_cell(quality.lost),
            number_cell(quality.unreadable),
            number_cell(quality.clock_steps.0),
            RowCell::text_or_null(Some(limits.as_str()).filter(|limits| !limits.is_empty())),
            number_cell(counts.events),
            number_cell(counts.signals),
            RowCell::Text(env!("CARGO_PKG_VERSION")),
        ],
    )
}

fn number_cell(number: u64) -> RowCell<'static> {
    RowCell::Number(i64::try_from(number).unwrap_or(i64::MAX))
}
