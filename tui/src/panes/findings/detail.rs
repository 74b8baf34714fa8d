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

use cobscope_decoder::diagnosis::incident::absorbed;
use cobscope_decoder::finding::phrase::{self, fact_text, moment, sentence, what, who};
use cobscope_decoder::finding::{Cause, Findings, Group, SuppressionUse};
use cobscope_decoder::rules::section;
use cobscope_decoder::sink::escape;
use cobscope_decoder::words::plural;
use ratatui::text::{Line, Span};

use super::chosen::FilterResult;
use super::rows::Facts;
use crate::panes::common::{LabelledLines, severity_role, time};
use crate::state::{Core, DIFFERS};
use crate::theme::Role;
use crate::timeline::SurveyResults;

/// Width of the labels.
const LABEL: u16 = 14;

/// Number of findings removed by the filter, and limits of the verdicts as in `check`.
pub(super) fn notes(
    core: &Core,
    survey: &SurveyResults,
    chosen: Option<&FilterResult>,
) -> Vec<Line<'static>> {
    let theme = &core.theme;
    let labelled = |role: Role, label: &str, text: &str| {
        let label = Span::styled(format!("{label:<9}"), theme.style(role));
        Line::from(vec![label, Span::raw(escape(text).into_owned())])
    };
    let mut lines = Vec::new();
    lines.extend(chosen.map(|chosen| labelled(Role::Note, "filter", &chosen.words())));
    if let Some(failure) = core.timeline.failure() {
        lines.push(labelled(Role::Bad, "failure", &failure));
    }
    let Some(findings) = &survey.findings else {
        let text = format!(
            "{} analysed so far; causes and counts follow at the end",
            plural(survey.frames, "frame")
        );
        lines.push(labelled(Role::Note, "running", &text));
        return lines;
    };
    lines.extend(findings.quality.iter().map(|note| labelled(Role::Caution, "quality", note)));
    let complaints = findings.suppressions.iter().filter_map(SuppressionUse::complaint);
    lines.extend(complaints.map(|said| labelled(Role::Note, "note", &said)));
    if findings.ungrouped > 0 {
        let text = format!("{} more occurrences without a place in the table", findings.ungrouped);
        lines.push(labelled(Role::Caution, "more", &text));
    }
    lines
}

/// Details of a finding, most important first because the area may be small.
pub(super) fn lines(core: &Core, findings: &Findings, group: &Group) -> LabelledLines {
    let style = core.theme.style(severity_role(group.severity));
    let plain = |text: String| Line::raw(escape(&text).into_owned());
    let who = format!("{}  ", escape(&who(group)));
    let first = Line::from(vec![Span::raw(who), Span::styled(escape(&sentence(group)).into_owned(), style)]);
    let mut lines = vec![("", first)];
    if let Some(reason) = &group.suppressed {
        lines.push(labelled("  suppressed", reason));
    }
    if let Some(name) = core.compared_name().filter(|_| core.is_new_finding(group.id)) {
        lines.push(labelled("  against", &format!("{DIFFERS} not in {name}")));
    }
    lines.extend(phrase::notes(group, core.zero()).into_iter().map(|note| ("", plain(format!("  {note}")))));
    if let Some(cause) = cause(findings, group) {
        lines.push(labelled("  caused by", &cause));
    }
    let rule = findings.rules.get(usize::from(group.key.rule));
    if let Some(look) = rule.and_then(|rule| section(&rule.explanation, "What to look at first")) {
        lines.push(labelled("  look first", &one_line(look)));
    }
    if let Some(absorbed) = absorbed(findings).get(&group.id) {
        lines.push(labelled("  also covers", &absorbed.to_string()));
    }
    lines.extend(occurrences(core, group));
    if let Some(rule) = rule {
        lines.push(labelled("  rule", &format!("{}: {}", rule.name, rule.title)));
        let source = rule.source.as_deref().or_else(|| section(&rule.explanation, "Source"));
        let source = source.filter(|_| group.manual.is_none());
        lines.extend(source.map(|source| labelled("  source", &one_line(source))));
    }
    LabelledLines { room: LABEL, lines }
}

/// Details of a finding while the rules still run.
pub(super) fn opening(core: &Core, facts: &Facts) -> LabelledLines {
    let style = core.theme.style(severity_role(facts.severity));
    let first =
        Line::from(vec![Span::raw(format!("{}  ", facts.who)), Span::styled(facts.text.clone(), style)]);
    let at = Line::raw(format!("  at {} s {{{}}}", time(core, facts.began), facts.frame));
    LabelledLines { room: LABEL, lines: vec![("", first), ("", at)] }
}

/// Times and frames of the occurrences, unless the notes contain all of them.
fn occurrences(core: &Core, group: &Group) -> Option<(&'static str, Line<'static>)> {
    if group.first.len() + group.last.len() <= 2 {
        return None;
    }
    let moments = |all: &mut dyn Iterator<Item = String>| all.collect::<Vec<_>>().join(", ");
    let first = moments(&mut group.first.iter().map(|at| moment(*at, core.zero())));
    let last = moments(&mut group.last.iter().map(|at| moment(*at, core.zero())));
    let kept = u64::try_from(group.first.len() + group.last.len()).unwrap_or(u64::MAX);
    let between = if group.count > kept { " … " } else { ", " };
    let between = if last.is_empty() { "" } else { between };
    Some(labelled("  seen", &format!("{first}{between}{last}")))
}

fn cause(findings: &Findings, group: &Group) -> Option<String> {
    match group.cause.as_ref()? {
        Cause::Group(id) => {
            let cause = findings.group(*id)?;
            Some(format!("{} {} [{}]", who(cause), what(cause), cause.rule))
        }
        Cause::Quality(text) => Some(text.to_string()),
        Cause::Fact(fact) => Some(fact_text(fact)),
    }
}

/// `look first   Its last EMCY …`
fn labelled(label: &'static str, text: &str) -> (&'static str, Line<'static>) {
    (label, Line::raw(escape(text).into_owned()))
}

fn one_line(text: &str) -> String {
    text.split_whitespace().collect::<Vec<_>>().join(" ")
}
