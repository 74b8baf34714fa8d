//! What stands above and below the table: what limits the verdicts, and all that is known of one finding.
//!
//! ```text
//! quality  27 error frames
//! ── warning emcy-raised ──────────────────────────────
//! can0 32/20  EMCY 8305 spool position error
//!   at 7.204 s {104}
//! rule   an error was raised (CiA 301 §7.2.7)
//! first  Its error register, what was commanded before.
//! ```

use cobscope_decoder::finding::{Cause, Findings, Group, SuppressionUse};
use cobscope_decoder::rules::section;
use cobscope_decoder::sink::escape;
use cobscope_decoder::sink::findings::incident::absorbed;
use cobscope_decoder::sink::findings::{self, moment, what, who};
use cobscope_decoder::words::plural;
use ratatui::text::{Line, Span};

use super::chosen::Chosen;
use super::rows::Facts;
use crate::panes::common::{Labelled, severity_role, time};
use crate::state::Core;
use crate::theme::Role;
use crate::timeline::Survey;

/// Columns for labels.
const LABEL: u16 = 13;

/// What the filter leaves out, and what limits the verdicts, as `check` says it.
pub(super) fn notes(core: &Core, survey: &Survey, chosen: Option<&Chosen>) -> Vec<Line<'static>> {
    let theme = &core.theme;
    let labelled = |role: Role, label: &str, text: &str| {
        let label = Span::styled(format!("{label:<9}"), theme.style(role));
        Line::from(vec![label, Span::raw(escape(text).into_owned())])
    };
    let mut lines = Vec::new();
    lines.extend(chosen.map(|chosen| labelled(Role::Note, "filter", &chosen.words())));
    if let Some(failure) = core.timeline.failure() {
        lines.push(labelled(Role::Bad, "unread", &failure));
    }
    let Some(findings) = &survey.findings else {
        let text = format!(
            "{} judged so far; what explains what, and how often, is known at the end",
            plural(survey.frames, "frame")
        );
        lines.push(labelled(Role::Note, "judging", &text));
        return lines;
    };
    lines.extend(findings.quality.iter().map(|note| labelled(Role::Caution, "quality", note)));
    let complaints = findings.suppressions.iter().filter_map(SuppressionUse::complaint);
    lines.extend(complaints.map(|said| labelled(Role::Note, "note", &said)));
    if findings.ungrouped > 0 {
        let text = format!("{} further times something was wrong found no room", findings.ungrouped);
        lines.push(labelled(Role::Caution, "more", &text));
    }
    lines
}

/// All of a finding, the most important first: there may be room for some lines only.
pub(super) fn lines(core: &Core, findings: &Findings, group: &Group) -> Labelled {
    let style = core.theme.style(severity_role(group.severity));
    let plain = |text: String| Line::raw(escape(&text).into_owned());
    let who = format!("{}  ", escape(&who(group)));
    let first = Line::from(vec![Span::raw(who), Span::styled(escape(&what(group)).into_owned(), style)]);
    let mut lines = vec![("", first)];
    if let Some(reason) = &group.suppressed {
        lines.push(labelled("  suppressed", reason));
    }
    lines
        .extend(findings::notes(group, core.zero()).into_iter().map(|note| ("", plain(format!("  {note}")))));
    if let Some(cause) = cause(findings, group) {
        lines.push(labelled("  caused by", &cause));
    }
    let rule = findings.rules.get(usize::from(group.key.rule));
    if let Some(look) = rule.and_then(|rule| section(&rule.explanation, "What to look at first")) {
        lines.push(labelled("  look first", &one_line(look)));
    }
    if let Some(absorbed) = absorbed(findings).get(&group.id) {
        lines.push(labelled("  stands for", &absorbed.to_string()));
    }
    lines.extend(occurrences(core, group));
    if let Some(rule) = rule {
        lines.push(labelled("  rule", &format!("{}: {}", rule.name, rule.title)));
        let source = rule.source.as_deref().or_else(|| section(&rule.explanation, "Source"));
        lines.extend(source.map(|source| labelled("  source", &one_line(source))));
    }
    Labelled { room: LABEL, lines }
}

/// What is known of a finding before groups are.
pub(super) fn opening(core: &Core, facts: &Facts) -> Labelled {
    let style = core.theme.style(severity_role(facts.severity));
    let first =
        Line::from(vec![Span::raw(format!("{}  ", facts.who)), Span::styled(facts.text.clone(), style)]);
    let at = Line::raw(format!("  at {} s {{{}}}", time(core, facts.began), facts.frame));
    Labelled { room: LABEL, lines: vec![("", first), ("", at)] }
}

/// When it was seen, where the notes do not say all of that already.
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
    }
}

/// `look first   Its last EMCY …`
fn labelled(label: &'static str, text: &str) -> (&'static str, Line<'static>) {
    (label, Line::raw(escape(text).into_owned()))
}

fn one_line(text: &str) -> String {
    text.split_whitespace().collect::<Vec<_>>().join(" ")
}
