//! Lines of a story.

use std::fmt::Write as _;

use super::evidence::{disproved_causes, unknown_points};
use super::incident::IncidentFinding;
use super::plot::StoryPlot;
use super::ranking::load_ranking;
use crate::figures::format_time;
use crate::finding::phrase::{fact_text, format_duration, format_interval, subject_phrase};
use crate::finding::{Advice, CaptureFindings, FactCause, FindingGroup, Occurrence};
use crate::frame::Timestamp;
use crate::wire::NodeId;
use crate::words::count_noun;

/// Maximum number of effects listed in a story.
const SHOWN_EFFECTS: usize = 6;

/// Delay in ns up to which an effect is before its cause; above it, the printed delay is 0 ms.
const EARLIER: i64 = -500_000;

/// Meaning of a line.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
#[non_exhaustive]
pub enum LineLabel {
    /// The most likely cause.
    Cause,
    /// The capture does not show the cause.
    NoCause,
    /// First effect of an invisible cause.
    FirstEffect,
    /// Continuation of the line before.
    More,
    /// A consequence.
    Effect,
    /// A consequence that the capture shows before its cause: a deadline must pass, or the device reports it first.
    EarlierEffect,
    /// A step to take.
    Act,
    /// Causes that the capture disproves.
    Disproved,
    /// What the capture cannot show.
    Unjudged,
    /// Manual and section.
    Manual,
    /// A note.
    Note,
}

impl LineLabel {
    /// The word at the beginning of the line.
    pub const fn label_word(self) -> &'static str {
        match self {
            Self::Cause => "MOST LIKELY",
            Self::NoCause => "UNKNOWN",
            Self::FirstEffect => "FIRST EFFECT",
            Self::More => "",
            Self::Effect => "  then",
            Self::EarlierEffect => "  before",
            Self::Act => "DO NOW",
            Self::Disproved => "NOT THE CAUSE",
            Self::Unjudged => "NOT JUDGED",
            Self::Manual => "MANUAL",
            Self::Note => "NOTE",
        }
    }

    /// Key of the line in JSON.
    pub const fn json_key(self) -> &'static str {
        match self {
            Self::Cause => "cause",
            Self::NoCause => "no-cause",
            Self::FirstEffect => "first-effect",
            Self::More => "more",
            Self::Effect | Self::EarlierEffect => "effect",
            Self::Act => "act",
            Self::Disproved => "disproved",
            Self::Unjudged => "not-judged",
            Self::Manual => "manual",
            Self::Note => "note",
        }
    }
}

/// One line of a story.
#[derive(Debug, Clone, PartialEq)]
pub struct StoryLine {
    /// Meaning of the line.
    pub label: LineLabel,
    /// Text without the label. It can contain names of the capture: escape it for output.
    pub text: String,
    /// Time and frames that show it; without frames for a line about the whole story.
    pub at: Occurrence,
}

/// Context of the texts.
pub(super) struct DiagnosisPage<'a> {
    pub(super) findings: &'a CaptureFindings,
    pub(super) zero: Option<Timestamp>,
    pub(super) is_growing: bool,
    pub(super) has_several_buses: bool,
}

const NOWHERE: Occurrence = Occurrence { time: None, frames: crate::event::FrameRange::one(0) };

impl DiagnosisPage<'_> {
    /// All lines of a story.
    pub(super) fn story_lines(&self, plot: &StoryPlot<'_>, steps: &[Advice]) -> Vec<StoryLine> {
        let mut lines = Vec::new();
        let Some(root) = plot.findings.first() else { return lines };
        let line = |label, text, at| StoryLine { label, text, at };
        let began = plot.fact.as_ref().map_or_else(|| root.group.first_occurrence(), |fact| fact.at);
        let titled = || format!("{}   {}", self.title_text(root.group), self.period_text(root.group));
        match (&plot.fact, load_ranking().record_hint(root.group)) {
            (Some(fact), _) => {
                let at = self.moment_text(fact.at).map_or_else(String::new, |at| format!("   at {at}"));
                lines.push(line(
                    LineLabel::Cause,
                    format!("{}{at}", self.fact_text(root.group, fact)),
                    fact.at,
                ));
            }
            (None, Some(record)) => {
                let text = format!("cause not visible in this capture; record next: {record}");
                lines.push(line(LineLabel::NoCause, text, began));
                lines.push(line(LineLabel::FirstEffect, titled(), began));
            }
            (None, None) => lines.push(line(LineLabel::Cause, titled(), began)),
        }
        let is_effect = plot.fact.is_some();
        let more = worst_text(root).filter(|_| !is_effect);
        lines.extend(more.map(|more| line(LineLabel::More, more, began)));
        let mut effects: Vec<_> = plot.findings.iter().skip(usize::from(!is_effect)).collect();
        effects.sort_by_key(|it| (it.group.first_occurrence().time, std::cmp::Reverse(it.severity())));
        for effect in effects.iter().take(SHOWN_EFFECTS) {
            let delay = delay_to(effect.group, began);
            let is_earlier = delay.is_some_and(|delay| delay <= EARLIER);
            let label = if is_earlier { LineLabel::EarlierEffect } else { LineLabel::Effect };
            lines.push(line(
                label,
                self.effect_text((root.group, delay), effect),
                effect.group.first_occurrence(),
            ));
        }
        let rest = effects.len().saturating_sub(SHOWN_EFFECTS);
        if rest > 0 {
            lines.push(line(LineLabel::More, format!("and {}", count_noun(rest, "further effect")), NOWHERE));
        }
        for (place, step) in (1..).zip(steps) {
            let label = if place == 1 { LineLabel::Act } else { LineLabel::More };
            let section =
                if step.section.is_empty() { String::new() } else { format!(" ({})", step.section) };
            lines.push(line(label, format!("{place} {}{section}", step.text), NOWHERE));
        }
        let joined = [
            (LineLabel::Disproved, disproved_causes(plot)),
            (LineLabel::Unjudged, unknown_points(plot, self.findings)),
        ];
        for (label, parts) in joined.into_iter().filter(|(_, parts)| !parts.is_empty()) {
            lines.push(line(label, parts.join("; "), NOWHERE));
        }
        let manual = plot.findings.iter().find_map(|it| it.group.manual.as_deref());
        lines.extend(manual.map(|manual| line(LineLabel::Manual, manual.to_owned(), NOWHERE)));
        lines
    }

    /// A finding that is only a note.
    pub(super) fn note_line(&self, plot: &StoryPlot<'_>) -> Option<StoryLine> {
        let group = plot.findings.first()?.group;
        Some(StoryLine { label: LineLabel::Note, text: self.title_text(group), at: group.first_occurrence() })
    }

    /// Node and text of a finding with its first frames: `32/20 boom  EMCY 8305 spool position error {104}`.
    pub(super) fn title_text(&self, group: &FindingGroup) -> String {
        let who = self.node_text(group);
        let gap = if who.is_empty() { "" } else { "  " };
        format!("{who}{gap}{}", cited_text(group))
    }

    /// Text of a fact that is the cause of a finding: `can1 7/07 mixer  1005:00 = 40000080h written {185-188}`.
    pub(super) fn fact_text(&self, effect: &FindingGroup, fact: &FactCause) -> String {
        let text = fact_text(fact);
        match (self.has_several_buses, fact.node) {
            (false, _) => text,
            (true, Some(_)) => format!("{} {text}", effect.bus),
            (true, None) => format!("{}  {text}", effect.bus),
        }
    }

    fn node_text(&self, group: &FindingGroup) -> String {
        let bus = self.has_several_buses.then(|| group.bus.to_string());
        let node = group.key.node.map(NodeId::label);
        let parts = [bus, node, group.node_name.as_deref().map(str::to_owned)];
        parts.into_iter().flatten().filter(|part| !part.is_empty()).collect::<Vec<_>>().join(" ")
    }

    /// `7.204 s`.
    fn moment_text(&self, at: Occurrence) -> Option<String> {
        Some(format_time(at.time?.since(self.zero?)))
    }

    /// `at 7.204 s`, `7.204 to 10.430 s, 12 times`, `from 7.204 s to the end`.
    fn period_text(&self, group: &FindingGroup) -> String {
        let moment = |at: Occurrence| self.moment_text(at);
        let mut text = match (moment(group.first_occurrence()), moment(group.last_occurrence())) {
            (Some(began), _) if group.lasts_to_end && self.is_growing => {
                format!("from {began}, still present")
            }
            (Some(began), _) if group.lasts_to_end => format!("from {began} to the end of the capture"),
            (Some(began), _) if group.lasted.is_some_and(|lasted| lasted > 0) => {
                format!("from {began} for {}", format_duration(group.lasted.unwrap_or(0)))
            }
            (Some(began), Some(ended)) if began != ended => format!("{began} to {ended}"),
            (Some(began), _) => format!("at {began}"),
            (None, _) => "no time".to_owned(),
        };
        if group.count > 1 {
            let _ = write!(text, ", {} times", group.count);
        }
        format!("{text} [{}]", group.rule)
    }

    /// `+2 ms   ACTIVE → FAULT HOLD {105}`.
    fn effect_text(
        &self,
        (root, delay): (&FindingGroup, Option<i64>),
        finding: &IncidentFinding<'_>,
    ) -> String {
        let group = finding.group;
        let delay = delay.map_or_else(String::new, |delay| {
            let sign = if delay <= EARLIER { '-' } else { '+' };
            format!("{sign}{}  ", format_interval(delay.saturating_abs()))
        });
        let is_same_node = group.key.node == root.key.node && group.key.bus == root.key.bus;
        let text = if is_same_node { cited_text(group) } else { self.title_text(group) };
        let more = if group.count > 1 { format!(", {} times", group.count) } else { String::new() };
        let also = finding.member_text().map_or_else(String::new, |also| format!("; {also}"));
        format!("{delay}{text}{more}{also}")
    }
}

/// Time from the cause to an effect, in ns.
fn delay_to(effect: &FindingGroup, cause: Occurrence) -> Option<i64> {
    effect.first_occurrence().time.zip(cause.time).map(|(effect, cause)| effect.since(cause))
}

/// The worst occurrence, the members, and the reason for a lower severity.
fn worst_text(finding: &IncidentFinding<'_>) -> Option<String> {
    let group = finding.group;
    let mut parts = Vec::new();
    if let Some((_, text, at)) = &group.worst {
        parts.push(format!("worst {text}{}", frames_text(*at)));
    }
    parts.extend(finding.member_text());
    parts.extend(group.downgraded.as_ref().map(|reason| format!("severity lowered: {reason}")));
    (!parts.is_empty()).then(|| parts.join("; "))
}

/// Text of a finding with its first frames, unless the text already names them.
fn cited_text(group: &FindingGroup) -> String {
    let (text, frames) = (subject_phrase(group), frames_text(group.first_occurrence()));
    if text.contains(frames.trim_start()) { text } else { format!("{text}{frames}") }
}

/// ` {12-13}`; empty without a frame.
fn frames_text(at: Occurrence) -> String {
    match (at.frames.first, at.frames.last) {
        (_, 0) => String::new(),
        (first, last) if first == last || first == 0 => format!(" {{{last}}}"),
        (first, last) => format!(" {{{first}-{last}}}"),
    }
}
