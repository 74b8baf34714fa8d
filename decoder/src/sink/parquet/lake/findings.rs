//! Rows of the table of findings, with the stories that contain them.

use std::collections::BTreeMap;
use std::io;

use super::partitions::PushRow;
use crate::diagnosis::Diagnosis;
use crate::finding::{About, Cause, Group};
use crate::session::Buses;
use crate::sink::findings::{CaptureResult, jsonl};
use crate::sink::parquet::table::{Cell, Heading, Kind, always, maybe};
use crate::sink::parquet::time::{micros_of_date, nanos, node_number};

/// Columns of the table of findings.
pub(super) const HEADINGS: &[Heading] = &[
    maybe("time", Kind::Time),
    maybe("time_ns", Kind::Number),
    maybe("until", Kind::Time),
    always("capture", Kind::Name),
    always("bus", Kind::Name),
    always("first_frame", Kind::Number),
    always("last_frame", Kind::Number),
    maybe("node", Kind::Number),
    maybe("node_name", Kind::Name),
    maybe("device", Kind::Name),
    always("finding", Kind::Number),
    always("fingerprint", Kind::Text),
    always("rule", Kind::Name),
    always("title", Kind::Name),
    always("severity", Kind::Name),
    always("standing", Kind::Name),
    maybe("about", Kind::Name),
    maybe("object", Kind::Name),
    always("text", Kind::Text),
    always("count", Kind::Number),
    maybe("duration", Kind::Real),
    always("lasts", Kind::Truth),
    maybe("cause_finding", Kind::Number),
    maybe("member_of", Kind::Number),
    maybe("story", Kind::Number),
    maybe("story_place", Kind::Number),
    maybe("story_title", Kind::Text),
    maybe("next_step", Kind::Text),
    always("json", Kind::Json),
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
struct Stories<'a>(BTreeMap<u64, StoryPart<'a>>);

impl<'a> Stories<'a> {
    fn of(diagnosis: &'a Diagnosis) -> Self {
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
pub(super) fn rows(
    judged: &CaptureResult,
    diagnosis: &Diagnosis,
    buses: Buses<'_>,
    push: PushRow<'_>,
) -> io::Result<()> {
    let stories = Stories::of(diagnosis);
    for group in &judged.findings.groups {
        row(group, judged, &stories, buses, push)?;
    }
    Ok(())
}

#[expect(
    clippy::cast_precision_loss,
    reason = "durations are below 2^53 ns, or a fraction of a second does not matter"
)]
fn row(
    group: &Group,
    judged: &CaptureResult,
    stories: &Stories<'_>,
    buses: Buses<'_>,
    push: PushRow<'_>,
) -> io::Result<()> {
    let (began, ended) = (group.began(), group.ended());
    let bus = buses.iter().find(|bus| bus.index() == group.key.bus);
    let node = bus.zip(group.key.node).and_then(|(bus, node)| bus.node(node));
    let rule = judged.findings.rules.get(usize::from(group.key.rule));
    let about = group.key.about.to_string();
    let object = matches!(group.key.about, About::Object(_)).then_some(about.as_str());
    let cause = match group.cause {
        Some(Cause::Group(id)) => number(id),
        Some(Cause::Quality(_) | Cause::Fact(_)) | None => Cell::Null,
    };
    let story = stories.0.get(&group.id);
    let line = jsonl::finding(group, judged);
    push(
        began.time,
        &[
            micros_of_date(began.time),
            nanos(began.time),
            micros_of_date(ended.time),
            Cell::Text(&judged.capture),
            Cell::Text(&group.bus),
            number(began.frames.first),
            number(ended.frames.last),
            node_number(group.key.node),
            Cell::text(group.node_name.as_deref()),
            Cell::text(node.and_then(|node| node.device_id())),
            number(group.id),
            Cell::Text(&group.fingerprint()),
            Cell::Text(&group.rule),
            Cell::Text(rule.map_or("", |rule| &rule.title)),
            Cell::Text(group.severity.name()),
            Cell::Text(judged.standing(group).name()),
            Cell::text(Some(about.as_str()).filter(|about| !about.is_empty())),
            Cell::text(object),
            Cell::Text(&group.text),
            number(group.count),
            group.duration().map_or(Cell::Null, |duration| Cell::Real(duration as f64 / 1e9)),
            Cell::Truth(group.lasts_to_end),
            cause,
            group.member_of.map_or(Cell::Null, number),
            story.map_or(Cell::Null, |part| Cell::Number(part.story)),
            story.map_or(Cell::Null, |part| Cell::Number(part.place)),
            Cell::text(story.map(|part| part.title)),
            Cell::text(group.next_step.as_deref()),
            Cell::Text(&line),
        ],
    )
}

fn number(number: u64) -> Cell<'static> {
    Cell::Number(i64::try_from(number).unwrap_or(i64::MAX))
}
