//! Diagnosis: findings as stories, each with its cause, what followed, what to do, and what the capture
//! disproves or cannot show.
//!
//! ```text
//! Findings ─incidents─▶ causes with effects ─ranking.toml─▶ stories in order ─lines─▶ text of every output
//! ```
//!
//! One diagnosis serves `why`, `check` and the UI. It depends on findings only: each finding carries the state
//! of its node and bus when it began ([`FindingScene`](crate::finding::FindingScene)).

mod evidence;
pub mod incident;
mod lines;
mod plot;
mod ranking;
mod steps;

pub(crate) use evidence::WIRING;
pub use lines::{LineLabel, StoryLine};

use std::sync::Arc;

use self::incident::group_incidents;
use self::plot::{StoryPlot, join_incidents};
use self::ranking::load_ranking;
use crate::conclusion::find_hypothesis;
use crate::finding::{Advice, CaptureFindings, FindingGroup, Occurrence, Severity};
use crate::frame::{BusIndex, Timestamp};
use crate::wire::NodeId;

/// Context of a diagnosis.
#[derive(Debug, Clone, Copy, Default)]
pub struct DiagnosisContext {
    /// Timestamp of the first frame, the zero of printed times.
    pub zero: Option<Timestamp>,
    /// The capture ends at this requested moment: only stories that last, or ended up to [`RECENT`] before it.
    pub end: Option<Timestamp>,
    /// The capture still grows, or was not read to its end: open conditions are not at its end.
    pub is_growing: bool,
}

/// Time in ns for which a story counts after its last finding, for a diagnosis of a moment.
pub const RECENT: i64 = 10_000_000_000;

/// Stories of a capture, most important first.
#[derive(Debug, Clone, Default)]
pub struct Diagnosis {
    /// Stories with a warning or an error.
    pub stories: Vec<Story>,
    /// Findings that are notes only.
    pub notes: Vec<FindingNote>,
}

/// A finding that is only a note.
#[derive(Debug, Clone)]
pub struct FindingNote {
    /// The finding as one line.
    pub line: StoryLine,
    /// Ids of the findings, including those printed with the first one.
    pub findings: Vec<u64>,
    /// Nodes that the findings concern.
    pub nodes: Vec<(BusIndex, NodeId)>,
}

/// A cause with all findings that it explains.
#[derive(Debug, Clone)]
pub struct Story {
    /// Bus and node of the cause; no node for a finding about the bus.
    pub bus: BusIndex,
    /// Node of the cause.
    pub node: Option<NodeId>,
    /// Highest severity of its findings.
    pub severity: Severity,
    /// Part of the machine that fails, and how; `None` if only rules judged.
    pub failure: Option<StoryFailure>,
    /// Whether the capture shows the cause; else the first finding is only its first effect.
    pub is_cause_visible: bool,
    /// Text of the cause, or of the first effect.
    pub title: String,
    /// Ids of all findings, cause first.
    pub findings: Vec<u64>,
    /// Rules of the findings, without those printed with another one.
    pub rules: Vec<Arc<str>>,
    /// Nodes that the findings concern.
    pub nodes: Vec<(BusIndex, NodeId)>,
    /// First occurrence of the cause.
    pub began: Occurrence,
    /// Last occurrence of any finding.
    pub ended: Occurrence,
    /// A condition of the story still held at the end of the capture.
    pub lasts: bool,
    /// Steps to take, at most three.
    pub steps: Vec<Advice>,
    /// All lines in order.
    pub lines: Vec<StoryLine>,
    rank: f64,
}

/// Part of the machine that fails, and how it fails; see [`Hypothesis`](crate::conclusion::Hypothesis).
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct StoryFailure {
    /// Part of the machine.
    pub component: &'static str,
    /// Failure mode.
    pub mode: &'static str,
}

impl Story {
    /// Sum of the weights of its findings; stories are in descending order of it.
    pub fn rank(&self) -> f64 {
        self.rank
    }

    /// The cause, its effects and the steps, without evidence and manual.
    pub fn brief_lines(&self) -> impl Iterator<Item = &StoryLine> {
        self.lines.iter().take_while(|line| {
            !matches!(line.label, LineLabel::Disproved | LineLabel::Unjudged | LineLabel::Manual)
        })
    }
}

impl Diagnosis {
    /// Diagnosis from those findings that count in the output.
    pub fn diagnose_findings<'a>(
        findings: &'a CaptureFindings,
        counting: impl Iterator<Item = &'a FindingGroup>,
        setting: DiagnosisContext,
    ) -> Self {
        let has_several_buses = findings.groups.windows(2).any(|pair| match pair {
            [one, other] => one.key.bus != other.key.bus,
            _ => false,
        });
        let page = lines::DiagnosisPage {
            findings,
            zero: setting.zero,
            is_growing: setting.is_growing,
            has_several_buses,
        };
        let mut diagnosis = Self::default();
        for plot in join_incidents(group_incidents(counting)) {
            if plot.severity() == Severity::Note {
                diagnosis.notes.extend(build_note(&plot, &page));
            } else {
                diagnosis.stories.extend(build_story(&plot, &page));
            }
        }
        if let Some(end) = setting.end {
            diagnosis
                .stories
                .retain(|story| story.lasts || story.ended.time.is_none_or(|time| end.since(time) <= RECENT));
        }
        diagnosis.stories.sort_by(|one, other| {
            other.rank.total_cmp(&one.rank).then(story_order(one).cmp(&story_order(other)))
        });
        diagnosis
    }

    /// Keeps stories and notes that concern a node, or no node.
    pub fn keep_node(&mut self, is_meant: impl Fn(BusIndex, NodeId) -> bool) {
        let is_kept = |nodes: &[(BusIndex, NodeId)]| {
            nodes.is_empty() || nodes.iter().any(|(bus, node)| is_meant(*bus, *node))
        };
        self.stories.retain(|story| is_kept(&story.nodes));
        self.notes.retain(|note| is_kept(&note.nodes));
    }

    /// Keeps stories and notes with a finding of which `is_meant` is true.
    pub fn keep_findings(&mut self, is_meant: impl Fn(u64) -> bool) {
        self.stories.retain(|story| story.findings.iter().any(|id| is_meant(*id)));
        self.notes.retain(|note| note.findings.iter().any(|id| is_meant(*id)));
    }
}

/// `1 story`, `2 stories`.
pub fn story_count(count: usize) -> String {
    if count == 1 { "1 story".to_owned() } else { format!("{count} stories") }
}

fn story_order(story: &Story) -> (Option<Timestamp>, u64) {
    (story.began.time, story.began.frames.first)
}

fn build_note(plot: &StoryPlot<'_>, page: &lines::DiagnosisPage<'_>) -> Option<FindingNote> {
    let findings = plot.groups().map(|group| group.id).collect();
    Some(FindingNote { line: page.note_line(plot)?, findings, nodes: plot.nodes() })
}

fn build_story(plot: &StoryPlot<'_>, page: &lines::DiagnosisPage<'_>) -> Option<Story> {
    let root = plot.root_finding()?;
    let ranking = load_ranking();
    let weights = plot.findings.iter().map(|it| ranking.finding_weight(&it.group.rule, it.severity()));
    let all = || plot.groups();
    let ended = all().map(FindingGroup::last_occurrence).max_by_key(|at| (at.time, at.frames.last));
    let steps = steps::propose_steps(plot);
    let began = plot.fact.as_ref().map_or_else(|| root.first_occurrence(), |fact| fact.at);
    Some(Story {
        bus: root.key.bus,
        node: plot.fact.as_ref().and_then(|fact| fact.node).or(root.key.node),
        severity: plot.severity(),
        failure: find_hypothesis(&root.rule)
            .filter(|_| plot.fact.is_none())
            .map(|row| StoryFailure { component: &row.component, mode: &row.mode }),
        is_cause_visible: plot.fact.is_some() || ranking.record_hint(root).is_none(),
        title: plot.fact.as_ref().map_or_else(|| page.title_text(root), |fact| page.fact_text(root, fact)),
        findings: all().map(|group| group.id).collect(),
        rules: plot.findings.iter().map(|it| Arc::clone(&it.group.rule)).collect(),
        nodes: plot.nodes(),
        began,
        ended: ended.unwrap_or_else(|| root.last_occurrence()),
        lasts: all().any(|group| group.lasts_to_end),
        lines: page.story_lines(plot, &steps),
        steps,
        rank: weights.sum(),
    })
}
