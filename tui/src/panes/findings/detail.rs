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
use cobscope_decoder::sink::findings::{moment, notes, plural, what, who};
use ratatui::text::{Line, Span};

use super::rows::Facts;
use crate::app::Core;
use crate::panes::common::{severity_role, time};
use crate::theme::{Role, Theme};
use crate::timeline::Survey;

/// What limits the verdicts, as `check` says it.
pub(super) fn quality(core: &Core, survey: &Survey) -> Vec<Line<'static>> {
    let theme = &core.theme;
    let labelled = |role: Role, label: &str, text: &str| {
        let label = Span::styled(format!("{label:<9}"), theme.style(role));
        Line::from(vec![label, Span::raw(escape(text).into_owned())])
    };
    let mut lines = Vec::new();
    if let Some(failure) = core.timeline.failure() {
        lines.push(labelled(Role::Bad, "unread", &failure));
    }
    let Some(findings) = &survey.findings else {
        let text = format!(
            "{} frames judged so far; what explains what, and how often, is known at the end",
            survey.frames
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
pub(super) fn lines(core: &Core, findings: &Findings, group: &Group) -> Vec<Line<'static>> {
    let theme = &core.theme;
    let style = theme.style(severity_role(group.severity));
    let plain = |text: String| Line::raw(escape(&text).into_owned());
    let who = format!("{}  ", escape(&who(group)));
    let mut lines =
        vec![Line::from(vec![Span::raw(who), Span::styled(escape(&what(group)).into_owned(), style)])];
    if let Some(reason) = &group.suppressed {
        lines.push(labelled(theme, "suppressed", reason));
    }
    lines.extend(notes(group, core.zero()).into_iter().map(|note| plain(format!("  {note}"))));
    if let Some(cause) = cause(findings, group) {
        lines.push(labelled(theme, "caused by", &cause));
    }
    let rule = findings.rules.get(usize::from(group.key.rule));
    if let Some(look) = rule.and_then(|rule| section(&rule.explanation, "What to look at first")) {
        lines.push(labelled(theme, "look first", &one_line(look)));
    }
    if let Some(taken) = absorbed(findings).get(&group.id) {
        let rules: Vec<&str> =
            findings.effects(group.id).filter(|e| e.is_absorbed).map(|e| e.rule.as_ref()).collect();
        let text = format!("{} of other rules too: {}", plural(*taken, "finding"), rules.join(", "));
        lines.push(labelled(theme, "stands for", &text));
    }
    lines.extend(occurrences(core, group));
    if let Some(rule) = rule {
        lines.push(labelled(theme, "rule", &format!("{}: {}", rule.name, rule.title)));
        let source = rule.source.as_deref().or_else(|| section(&rule.explanation, "Source"));
        lines.extend(source.map(|source| labelled(theme, "source", &one_line(source))));
    }
    lines
}

/// What is known of a finding before groups are.
pub(super) fn opening(core: &Core, facts: &Facts) -> Vec<Line<'static>> {
    let style = core.theme.style(severity_role(facts.severity));
    let first =
        Line::from(vec![Span::raw(format!("{}  ", facts.who)), Span::styled(facts.text.clone(), style)]);
    vec![first, Line::raw(format!("  at {} s {{{}}}", time(core, facts.began), facts.frame))]
}

/// When it was seen, where the notes do not say all of that already.
fn occurrences(core: &Core, group: &Group) -> Option<Line<'static>> {
    if group.first.len() + group.last.len() <= 2 {
        return None;
    }
    let moments = |all: &mut dyn Iterator<Item = String>| all.collect::<Vec<_>>().join(", ");
    let first = moments(&mut group.first.iter().map(|at| moment(*at, core.zero())));
    let last = moments(&mut group.last.iter().map(|at| moment(*at, core.zero())));
    let kept = u64::try_from(group.first.len() + group.last.len()).unwrap_or(u64::MAX);
    let between = if group.count > kept { " … " } else { ", " };
    let between = if last.is_empty() { "" } else { between };
    Some(labelled(&core.theme, "seen", &format!("{first}{between}{last}")))
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

/// `look first   Its last EMCY …`: further lines stand below the text.
fn labelled(theme: &Theme, label: &str, text: &str) -> Line<'static> {
    let label = Span::styled(format!("  {label:<11}"), theme.style(Role::Quiet));
    Line::from(vec![label, Span::raw(escape(text).into_owned())])
}

fn one_line(text: &str) -> String {
    text.split_whitespace().collect::<Vec<_>>().join(" ")
}
