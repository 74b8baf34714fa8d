//! Rows of the table of findings, with the stories that contain them.

use std::collections::BTreeMap;
use std::io;

use super::partitions::PushRow;
use crate::diagnosis::Diagnosis;
use crate::finding::{FindingCause, FindingGroup, FindingSubject};
use crate::session::Buses;
use crate::sink::escape_json;
use crate::sink::findings::CaptureResult;
use crate::sink::findings::records::GroupRecord;
use crate::sink::parquet::table::{ColumnHeading, ColumnType, RowCell, optional_column, required_column};
use crate::sink::parquet::time::{micros_of_date, nanos_cell, node_number};

/// Columns of the table of findings.
pub(super) const HEADINGS: &[ColumnHeading] = &[
    optional_column("time", ColumnType::Time),
    optional_column("time_ns", ColumnType::Number),
    optional_column("until", ColumnType::Time),
    required_column("capture", ColumnType::Name),
    required_column("bus", ColumnType::Name),
    required_column("first_frame", ColumnType::Number),
    required_column("last_frame", ColumnType::Number),
    optional_column("node", ColumnType::Number),
    optional_column("node_name", ColumnType::Name),
    optional_column("device", ColumnType::Name),
    required_column("finding", ColumnType::Number),
    required_column("fingerprint", ColumnType::Text),
    required_column("rule", ColumnType::Name),
    required_column("title", ColumnType::Name),
    required_column("severity", ColumnType::Name),
    required_column("standing", ColumnType::Name),
    optional_column("about", ColumnType::Name),
    optional_column("object", ColumnType::Name),
    required_column("text", ColumnType::Text),
    required_column("count", ColumnType::Number),
    optional_column("duration", ColumnType::Real),
    required_column("lasts", ColumnType::Truth),
    optional_column("cause_finding", ColumnType::Number),
    optional_column("member_of", ColumnType::Number),
    optional_column("story", ColumnType::Number),
    optional_column("story_place", ColumnType::Number),
    optional_column("story_title", ColumnType::Text),
    optional_column("next_step", ColumnType::Text),
    required_column("json", ColumnType::Json),
];

/// Story of a finding.
#[derive(Clone, Copy)]
struct StoryPart<'a> {
    /// Number of the story, most important first, from 1.
    story: i64,
    /// Place of the finding in the story, from 1.
    place: i64,
    title: &'a str,
}

/// Stories by finding; `None` for a finding that is only a note.
struct FindingStories<'a>(BTreeMap<u64, StoryPart<'a>>);

impl<'a> FindingStories<'a> {
    fn stories_of(diagnosis: &'a Diagnosis) -> Self {
        let mut parts = BTreeMap::new();
        for (story, number) in diagnosis.stories.iter().zip(1..) {
            for (id, place) in story.findings.iter().zip(1..) {
                let part = StoryPart { story: number, place, title: &story.title };
                parts.entry(*id).or_insert(part);
            }
        }
        Self(parts)
    }
}

/// Passes the row of each finding to `push`, with the time of its first occurrence.
///
/// # Errors
/// If a row cannot be written.
pub(super) fn push_rows(
    judged: &CaptureResult,
    diagnosis: &Diagnosis,
    buses: Buses<'_>,
    push: PushRow<'_>,
) -> io::Result<()> {
    let stories = FindingStories::stories_of(diagnosis);
    for group in &judged.findings.groups {
        push_row(group, judged, &stories, buses, push)?;
    }
    Ok(())
}

#[expect(
    clippy::cast_precision_loss,
    reason = "durations are below 2^53 ns, or a fraction of a second does not matter"
)]
fn push_row(
    group: &FindingGroup,
    judged: &CaptureResult,
    stories: &FindingStories<'_>,
    buses: Buses<'_>,
    push: PushRow<'_>,
) -> io::Result<()> {
    let (began, ended) = (group.first_occurrence(), group.last_occurrence());
    let bus = buses.iter().find(|bus| bus.index() == group.key.bus);
    let node = bus.zip(group.key.node).and_then(|(bus, node)| bus.node(node));
    let rule = judged.findings.rules.get(usize::from(group.key.rule));
    let about = group.key.about.to_string();
    let object = matches!(group.key.about, FindingSubject::Object(_)).then_some(about.as_str());
    let cause = match group.cause {
        Some(FindingCause::Group(id)) => number_cell(id),
        Some(FindingCause::Quality(_) | FindingCause::Fact(_)) | None => RowCell::Null,
    };
    let story = stories.0.get(&group.id);
    // All keys are strings, the only reason for which a record could not be serialized.
    let line = serde_json::to_string(&GroupRecord::new(group, judged)).unwrap_or_default();
    let line = escape_json(&line).into_owned();
    push(
        began.time,
        &[
            micros_of_date(began.time),
            nanos_cell(began.time),
            micros_of_date(ended.time),
            RowCell::Text(&judged.capture),
            RowCell::Text(&group.bus),
            number_cell(began.frames.first),
            number_cell(ended.frames.last),
            node_number(group.key.node),
            RowCell::text_or_null(group.node_name.as_deref()),
            RowCell::text_or_null(node.and_then(|node| node.device_id())),
            number_cell(group.id),
            RowCell::Text(&group.fingerprint()),
            RowCell::Text(&group.rule),
            RowCell::Text(rule.map_or("", |rule| &rule.title)),
            RowCell::Text(group.severity.name()),
            RowCell::Text(judged.standing_of(group).name()),
            RowCell::text_or_null(Some(about.as_str()).filter(|about| !about.is_empty())),
            RowCell::text_or_null(object),
            RowCell::Text(&group.text),
            number_cell(group.count),
            group.duration().map_or(RowCell::Null, |duration| RowCell::Real(duration as f64 / 1e9)),
            RowCell::Truth(group.lasts_to_end),
            cause,
            group.member_of.map_or(RowCell::Null, number_cell),
            story.map_or(RowCell::Null, |part| RowCell::Number(part.story)),
            story.map_or(RowCell::Null, |part| RowCell::Number(part.place)),
            RowCell::text_or_null(story.map(|part| part.title)),
            RowCell::text_or_null(group.next_step.as_deref()),
            RowCell::Text(&line),
        ],
    )
}

fn number_cell(number: u64) -> RowCell<'static> {
    RowCell::Number(i64::try_from(number).unwrap_or(i64::MAX))
}
