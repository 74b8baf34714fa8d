//! Rows of the table: selection, order and text.
//!
//! ```text
//! by cause:  ▾ warning EMCY 8305          sorted:  error   ACTIVE → FAULT HOLD
//!                ▾ error ACTIVE → FAULT …          warning EMCY 8305
//! ```

use std::cmp::Ordering;
use std::collections::BTreeSet;

use cobscope_decoder::diagnosis::incident::{IncidentFinding, group_incidents};
use cobscope_decoder::finding::phrase::subject_phrase;
use cobscope_decoder::finding::{CaptureFindings, FindingGroup, FindingSubject, Severity};
use cobscope_decoder::frame::{BusIndex, Timestamp};
use cobscope_decoder::sink::escape;
use cobscope_decoder::wire::NodeId;

use super::chosen::ChosenFindings;
use crate::timeline::{OpenedFinding, SurveyResults};

/// A row: id of the finding and its place in the tree.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) struct FindingRow {
    pub(super) id: u64,
    /// Index in the groups; in the opened findings while the rules still run.
    place: usize,
    pub(super) depth: u8,
    /// Whether the effects are shown; None without effects.
    pub(super) open: Option<bool>,
}

/// Content of a row.
#[derive(Debug)]
pub(super) struct FindingRowContent {
    pub(super) severity: Severity,
    pub(super) bus: BusIndex,
    pub(super) node: Option<NodeId>,
    /// Node with its name.
    pub(super) who: String,
    pub(super) count: u64,
    pub(super) began: Option<Timestamp>,
    pub(super) ended: Option<Timestamp>,
    /// First frame of evidence.
    pub(super) frame: u64,
    pub(super) rule: String,
    pub(super) about: String,
    /// Filter for the subject; None for a finding about a node or bus as a whole.
    pub(super) subject: Option<String>,
    pub(super) text: String,
    /// Suppressed by the bus file with a reason.
    pub(super) is_suppressed: bool,
}

/// Selected findings as a tree by cause, worst first, or sorted by the column and direction of `sort`.
pub(super) fn finding_rows(
    survey: &SurveyResults,
    chosen: Option<&ChosenFindings>,
    folded: &BTreeSet<u64>,
    sort: Option<(usize, bool)>,
) -> Vec<FindingRow> {
    let is_chosen = |id: u64| chosen.is_none_or(|chosen| chosen.is_selected(id));
    let mut items = match &survey.findings {
        Some(findings) => tree_rows(findings, &is_chosen, folded, sort.is_some()),
        None => opened_rows(&survey.overview.opened, &is_chosen),
    };
    if let Some((column, is_descending)) = sort {
        let mut reported: Vec<_> =
            items.iter().filter_map(|item| Some((row_content(survey, item)?, *item))).collect();
        reported.sort_by(|(one, _), (other, _)| {
            let order = compare_rows(one, other, column);
            if is_descending { order.reverse() } else { order }
        });
        items = reported.into_iter().map(|(_, item)| FindingRow { depth: 0, open: None, ..item }).collect();
    }
    items
}

/// Findings opened so far, each once, worst first.
fn opened_rows(news: &[OpenedFinding], is_chosen: &dyn Fn(u64) -> bool) -> Vec<FindingRow> {
    let mut seen = BTreeSet::new();
    let all = news.iter().enumerate();
    let mut first: Vec<_> =
        all.filter(|(_, opened)| is_chosen(opened.news.id) && seen.insert(opened.news.id)).collect();
    first.sort_by_key(|(_, opened)| std::cmp::Reverse(opened.news.severity));
    let item = |(place, opened): (usize, &OpenedFinding)| FindingRow {
        id: opened.news.id,
        place,
        depth: 0,
        open: None,
    };
    first.into_iter().map(item).collect()
}

/// Each incident with the effects of its cause; suppressed findings at the end.
fn tree_rows(
    findings: &CaptureFindings,
    is_chosen: &dyn Fn(u64) -> bool,
    folded: &BTreeSet<u64>,
    is_flat: bool,
) -> Vec<FindingRow> {
    let mut items: Vec<FindingRow> = Vec::new();
    for incident in group_incidents(findings.reported_groups().filter(|group| is_chosen(group.id))) {
        // Findings deeper than this are hidden.
        let mut hidden_below = usize::MAX;
        let rows: Vec<_> = incident.findings.iter().flat_map(incident_rows).collect();
        for (at, (depth, group)) in rows.iter().enumerate() {
            if *depth > hidden_below {
                continue;
            }
            let has_effects = rows.get(at + 1).is_some_and(|(next, _)| next > depth);
            let is_folded = has_effects && !is_flat && folded.contains(&group.id);
            hidden_below = if is_folded { *depth } else { usize::MAX };
            let depth = u8::try_from(*depth).unwrap_or(u8::MAX);
            items.push(row_of(group, depth, has_effects.then_some(!is_folded)));
        }
    }
    let suppressed = findings.groups.iter().filter(|group| group.suppressed.is_some() && is_chosen(group.id));
    items.extend(suppressed.map(|group| row_of(group, 0, None)));
    items
}

/// A finding, and below it the findings printed as one with it.
fn incident_rows<'a>(finding: &IncidentFinding<'a>) -> Vec<(usize, &'a FindingGroup)> {
    let below = finding.depth.saturating_add(1);
    let members = finding.members.iter().map(|group| (below, *group));
    [(finding.depth, finding.group)].into_iter().chain(members).collect()
}

fn row_of(group: &FindingGroup, depth: u8, open: Option<bool>) -> FindingRow {
    // Group ids start at 1 and follow the order of the groups.
    let place = usize::try_from(group.id.saturating_sub(1)).unwrap_or(usize::MAX);
    FindingRow { id: group.id, place, depth, open }
}

/// The group of a row; None while the rules still run.
pub(super) fn group_of<'a>(survey: &'a SurveyResults, item: &FindingRow) -> Option<&'a FindingGroup> {
    survey.findings.as_ref()?.groups.get(item.place).filter(|group| group.id == item.id)
}

/// Content of a row with escaped texts.
pub(super) fn row_content(survey: &SurveyResults, item: &FindingRow) -> Option<FindingRowContent> {
    if let Some(group) = group_of(survey, item) {
        let label = group.key.node.map(NodeId::label).unwrap_or_default();
        let name = group.node_name.as_deref().unwrap_or("");
        return Some(FindingRowContent {
            severity: group.severity,
            bus: group.key.bus,
            node: group.key.node,
            who: escape(format!("{label} {name}").trim()).into_owned(),
            count: group.count,
            began: group.first_occurrence().time,
            ended: group.last_occurrence().time,
            frame: group.first_occurrence().frames.last,
            rule: escape(&group.rule).into_owned(),
            about: escape(&group.key.about.to_string()).into_owned(),
            subject: match &group.key.about {
                FindingSubject::Whole => None,
                FindingSubject::Object(object) => Some(format!("object == 0x{object}")),
                FindingSubject::Pgn(pgn) => Some(format!("pgn == {pgn}")),
                other => Some(format!("about == {:?}", other.to_string())),
            },
            text: escape(&subject_phrase(group)).into_owned(),
            is_suppressed: group.suppressed.is_some(),
        });
    }
    let opened = survey.overview.opened.get(item.place)?;
    let news = &opened.news;
    let subject = match (news.object, news.pgn, &news.about) {
        (Some(object), ..) => Some(format!("object == 0x{object}")),
        (_, Some(pgn), _) => Some(format!("pgn == {pgn}")),
        (.., about) => about.as_ref().map(|about| format!("about == {about:?}")),
    };
    let about = news.object.map(|object| object.to_string());
    let about = about.or_else(|| news.pgn.map(|pgn| format!("pgn:{pgn}"))).or_else(|| news.about.clone());
    Some(FindingRowContent {
        severity: news.severity,
        bus: opened.bus,
        node: opened.node,
        who: opened.node.map(NodeId::label).unwrap_or_default(),
        count: news.count,
        began: opened.time,
        ended: opened.time,
        frame: opened.spot.frame,
        rule: escape(&news.rule).into_owned(),
        about: escape(&about.unwrap_or_default()).into_owned(),
        subject,
        text: escape(&news.text).into_owned(),
        is_suppressed: false,
    })
}

/// Compares two rows by a column of [`super::columns`].
fn compare_rows(one: &FindingRowContent, other: &FindingRowContent, column: usize) -> Ordering {
    match column {
        0 => one.severity.cmp(&other.severity),
        1 => one.bus.cmp(&other.bus),
        2 => (one.node, &one.who).cmp(&(other.node, &other.who)),
        3 => one.count.cmp(&other.count),
        // The distance from the cursor sorts like the first time.
        4 | 6 => one.began.cmp(&other.began),
        5 => one.ended.cmp(&other.ended),
        7 => one.rule.cmp(&other.rule),
        8 => one.about.cmp(&other.about),
        _ => one.text.cmp(&other.text),
    }
}
