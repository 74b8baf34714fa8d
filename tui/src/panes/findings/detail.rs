//! Text above and below the table: limits of the verdicts, and details of one finding.
//!
//! ```text
//! quality  27 error frames
//! ── warning emcy-raised ──────────────────────────────
//! can0 32/20  EMCY 8305 spool position error
//!   at 7.204 s {104}
//! rule         emcy-raised: EMCY raised after start-up
//! look first   Its error register, what was commanded before.
//! ```

use cobscope_decoder::diagnosis::incident::absorbed_findings;
use cobscope_decoder::finding::phrase::{
    self, fact_text, finding_sentence, format_moment, node_phrase, subject_phrase,
};
use cobscope_decoder::finding::{CaptureFindings, FindingCause, FindingGroup, SuppressionUse};
use cobscope_decoder::rules::section_text;
use cobscope_decoder::sink::escape;
use cobscope_decoder::words::count_noun;
use ratatui::text::{Line, Span};

use super::chosen::ChosenFindings;
use super::rows::FindingRowContent;
use crate::panes::common::{LabelledLines, display_time, severity_role};
use crate::state::{DIFFERS, UiState};
use crate::theme::TextRole;
use crate::timeline::SurveyResults;

/// Width of the labels.
const LABEL: u16 = 14;

/// Number of findings removed by the filter, and limits of the verdicts as in `check`.
pub(super) fn note_lines(
    core: &UiState,
    survey: &SurveyResults,
    chosen: Option<&ChosenFindings>,
) -> Vec<Line<'static>> {
    let theme = &core.theme;
    let labelled = |role: TextRole, label: &str, text: &str| {
        let label = Span::styled(format!("{label:<9}"), theme.role_style(role));
        Line::from(vec![label, Span::raw(escape(text).into_owned())])
    };
    let mut lines = Vec::new();
    lines.extend(chosen.map(|chosen| labelled(TextRole::Note, "filter", &chosen.selection_text())));
    if let Some(failure) = core.timeline.failure() {
        lines.push(labelled(TextRole::Bad, "failure", &failure));
    }
    let Some(findings) = &survey.findings else {
        let text = format!(
            "{} analysed so far; causes and counts follow at the end",
            count_noun(survey.frames, "frame")
        );
        lines.push(labelled(TextRole::Note, "running", &text));
        return lines;
    };
    lines.extend(findings.quality.iter().map(|note| labelled(TextRole::Caution, "quality", note)));
    let complaints = findings.suppressions.iter().filter_map(SuppressionUse::review_reason);
    lines.extend(complaints.map(|stated| labelled(TextRole::Note, "note", &stated)));
    if findings.ungrouped > 0 {
        let text = format!("{} more occurrences without a place in the table", findings.ungrouped);
        lines.push(labelled(TextRole::Caution, "more", &text));
    }
    lines
}

/// Details of a finding, most important first because the area may be small.
pub(super) fn finding_lines(
    core: &UiState,
    findings: &CaptureFindings,
    group: &FindingGroup,
) -> LabelledLines {
    let style = core.theme.role_style(severity_role(group.severity));
    let plain = |text: String| Line::raw(escape(&text).into_owned());
    let who = format!("{}  ", escape(&node_phrase(group)));
    let first =
        Line::from(vec![Span::raw(who), Span::styled(escape(&finding_sentence(group)).into_owned(), style)]);
    let mut lines = vec![("", first)];
    if let Some(reason) = &group.suppressed {
        lines.push(labelled_line("  suppressed", reason));
    }
    if let Some(name) = core.against.compared_name().filter(|_| core.against.is_new_finding(group.id)) {
        lines.push(labelled_line("  against", &format!("{DIFFERS} not in {name}")));
    }
    lines.extend(
        phrase::finding_notes(group, core.first_time())
            .into_iter()
            .map(|note| ("", plain(format!("  {note}")))),
    );
    if let Some(cause) = cause_text(findings, group) {
        lines.push(labelled_line("  caused by", &cause));
    }
    let rule = findings.rules.get(usize::from(group.key.rule));
    if let Some(look) = rule.and_then(|rule| section_text(&rule.explanation, "What to look at first")) {
        lines.push(labelled_line("  look first", &one_line(look)));
    }
    if let Some(absorbed) = absorbed_findings(findings).get(&group.id) {
        lines.push(labelled_line("  also covers", &absorbed.to_string()));
    }
    lines.extend(occurrence_line(core, group));
    if let Some(rule) = rule {
        lines.push(labelled_line("  rule", &format!("{}: {}", rule.name, rule.title)));
        let source = rule.source.as_deref().or_else(|| section_text(&rule.explanation, "Source"));
        let source = source.filter(|_| group.manual.is_none());
        lines.extend(source.map(|source| labelled_line("  source", &one_line(source))));
    }
    LabelledLines { room: LABEL, lines }
}

/// Details of a finding while the rules still run.
pub(super) fn opening_lines(core: &UiState, facts: &FindingRowContent) -> LabelledLines {
    let style = core.theme.role_style(severity_role(facts.severity));
    let first =
        Line::from(vec![Span::raw(format!("{}  ", facts.who)), Span::styled(facts.text.clone(), style)]);
    let at = Line::raw(format!("  at {} s {{{}}}", display_time(core, facts.began), facts.frame));
    LabelledLines { room: LABEL, lines: vec![("", first), ("", at)] }
}

/// Times and frames of the occurrences, unless the notes contain all of them.
fn occurrence_line(core: &UiState, group: &FindingGroup) -> Option<(&'static str, Line<'static>)> {
    if group.first.len() + group.last.len() <= 2 {
        return None;
    }
    let moments = |all: &mut dyn Iterator<Item = String>| all.collect::<Vec<_>>().join(", ");
    let first = moments(&mut group.first.iter().map(|at| format_moment(*at, core.first_time())));
    let last = moments(&mut group.last.iter().map(|at| format_moment(*at, core.first_time())));
    let kept = u64::try_from(group.first.len() + group.last.len()).unwrap_or(u64::MAX);
    let between = if group.count > kept { " … " } else { ", " };
    let between = if last.is_empty() { "" } else { between };
    Some(labelled_line("  seen", &format!("{first}{between}{last}")))
}

fn cause_text(findings: &CaptureFindings, group: &FindingGroup) -> Option<String> {
    match group.cause.as_ref()? {
        FindingCause::Group(id) => {
            let cause = findings.group_by_id(*id)?;
            Some(format!("{} {} [{}]", node_phrase(cause), subject_phrase(cause), cause.rule))
        }
        FindingCause::Quality(text) => Some(text.to_string()),
        FindingCause::Fact(fact) => Some(fact_text(fact)),
    }
}

/// `look first   Its last EMCY …`
fn labelled_line(label: &'static str, text: &str) -> (&'static str, Line<'static>) {
    (label, Line::raw(escape(text).into_owned()))
}

fn one_line(text: &str) -> String {
    text.split_whitespace().collect::<Vec<_>>().join(" ")
}
