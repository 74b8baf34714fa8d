//! Findings at an event: text of the rule, causes and effects.
//!
//! ```text
//! error emcy-raised: EMCY 8305 spool position error
//!   caused by {70} heartbeat-late: …
//!   What it checks: …
//! ```

use cobscope_decoder::conclusion::find_hypothesis;
use cobscope_decoder::finding::phrase::fact_text;
use cobscope_decoder::finding::{CaptureFindings, FindingCause, FindingGroup, Occurrence, RuleInfo};
use cobscope_decoder::rules::{all_declarations, all_sections, format_manual};

use super::item::{DetailItem, ItemTarget};
use crate::panes::common::severity_role;
use crate::state::{JumpPlace, UiState};
use crate::theme::TextRole;
use crate::timeline::{ReplayRow, SurveyResults};

/// Maximum length of a chain of causes.
const LONGEST_CHAIN: usize = 8;

/// Items of the findings with evidence at the cursor.
pub(super) fn finding_items(core: &UiState, row: Option<&ReplayRow>) -> Vec<DetailItem> {
    let frames: Vec<u64> = match row {
        Some(row) => vec![row.event.frames.first, row.event.frames.last, core.cursor.frame],
        None => vec![core.cursor.frame],
    };
    let survey = core.timeline.survey();
    let (mut items, mut reported) = (Vec::new(), Vec::new());
    match &survey.findings {
        Some(findings) => {
            let here = |occurrence: &Occurrence| {
                frames.contains(&occurrence.frames.first) || frames.contains(&occurrence.frames.last)
            };
            let is_here = |group: &&FindingGroup| group.first.iter().chain(&group.last).any(here);
            for group in findings.groups.iter().filter(is_here) {
                of_group(core, findings, group, &mut items);
                // The text of a rule is shown once for all its findings.
                if !reported.contains(&group.key.rule) {
                    reported.push(group.key.rule);
                    if let Some(rule) = findings.rules.get(usize::from(group.key.rule)) {
                        push_explanation(rule, &mut items);
                    }
                }
            }
        }
        None => so_far(core, &survey, &frames, &mut items),
    }
    items
}

fn of_group(core: &UiState, findings: &CaptureFindings, group: &FindingGroup, items: &mut Vec<DetailItem>) {
    let head = format!("{} {}: {}", group.severity.name(), group.rule, group.text);
    items.push(DetailItem::new(&head, severity_role(group.severity)));
    let mut facts = Vec::new();
    if group.count > 1 {
        facts.push(format!(
            "{} times, first {}",
            group.count,
            occurrence_text(core, &group.first_occurrence())
        ));
    }
    if let Some((_, text, worst)) = &group.worst {
        facts.push(format!("worst {}: {text}", occurrence_text(core, worst)));
    }
    facts.extend(group.downgraded.as_ref().map(|why| format!("severity downgraded: {why}")));
    facts.extend(group.manual.as_ref().map(|manual| format!("manual: {manual}")));
    facts.extend(group.suppressed.as_ref().map(|why| format!("suppressed by the bus file: {why}")));
    items.extend(facts.iter().map(|fact| DetailItem::minor_item(&format!("  {fact}"))));
    push_chain(core, findings, group, items);
}

/// The chain of causes of a finding, and its effects.
fn push_chain(core: &UiState, findings: &CaptureFindings, group: &FindingGroup, items: &mut Vec<DetailItem>) {
    let mut of = group;
    for _ in 0..LONGEST_CHAIN {
        match &of.cause {
            Some(FindingCause::Group(id)) => {
                let Some(cause) = findings.group_by_id(*id) else { break };
                items.push(link_item(core, "caused by", cause));
                of = cause;
            }
            Some(FindingCause::Quality(text)) => {
                items.push(DetailItem::minor_item(&format!("  explained by {text}")));
                break;
            }
            Some(FindingCause::Fact(fact)) => {
                items.push(DetailItem::minor_item(&format!("  caused by {}", fact_text(fact))));
                break;
            }
            None => break,
        }
    }
    items.extend(
        findings.effects_of(group.id).take(LONGEST_CHAIN).map(|effect| link_item(core, "causes", effect)),
    );
}

fn link_item(core: &UiState, word: &str, group: &FindingGroup) -> DetailItem {
    let began = group.first_occurrence();
    let text = format!("  {word} {} {}: {}", occurrence_text(core, &began), group.rule, group.text);
    DetailItem::new(&text, TextRole::Link).with_target(ItemTarget::Place(JumpPlace::Frame(began.frames.last)))
}

fn occurrence_text(core: &UiState, occurrence: &Occurrence) -> String {
    let time = core.time_words(occurrence.time, 3).map_or(String::new(), |time| format!(" {time}"));
    format!("{{{}}}{time}", occurrence.frames.last)
}

/// Findings that opened here, while the rules still run.
fn so_far(core: &UiState, survey: &SurveyResults, frames: &[u64], items: &mut Vec<DetailItem>) {
    for opened in survey.overview.opened.iter().filter(|opened| frames.contains(&opened.spot.frame)) {
        let news = &opened.news;
        let head = format!("{} {}: {}", news.severity.name(), news.rule, news.text);
        items.push(DetailItem::new(&head, severity_role(news.severity)));
        let cause = news.cause.and_then(|id| survey.overview.opened.iter().find(|other| other.news.id == id));
        if let Some(cause) = cause {
            let time = core.time_words(cause.time, 3).map_or(String::new(), |time| format!(" {time}"));
            let frame = cause.spot.frame;
            let text = format!("  caused by {{{frame}}}{time} {}: {}", cause.news.rule, cause.news.text);
            items.push(
                DetailItem::new(&text, TextRole::Link)
                    .with_target(ItemTarget::Place(JumpPlace::Frame(frame))),
            );
        }
        if let Some(rule) = all_declarations().find(|rule| *rule.name == *news.rule) {
            push_explanation(&rule.rule_info(), items);
        } else if let Some(row) = find_hypothesis(&news.rule) {
            push_explanation(&row.rule_info(), items);
        }
    }
}

/// The documentation of the rule, one item per section.
fn push_explanation(rule: &RuleInfo, items: &mut Vec<DetailItem>) {
    let text = format_manual(&rule.explanation);
    let paragraphs = all_sections(&text);
    if paragraphs.is_empty() {
        items.push(DetailItem::new(&format!("  {}", rule.title), TextRole::Text));
        items
            .extend(rule.cited_source().map(|source| DetailItem::minor_item(&format!("  Source: {source}"))));
    }
    for (heading, paragraph) in paragraphs {
        items.push(DetailItem::headed_item(&format!("  {heading}: "), &paragraph));
    }
}
