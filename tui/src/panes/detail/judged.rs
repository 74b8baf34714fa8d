//! Findings at an event: text of the rule, causes and effects.
//!
//! ```text
//! error emcy-raised: EMCY 8305 spool position error
//!   caused by {70} heartbeat-late: …
//!   What it checks: …
//! ```

use cobscope_decoder::finding::phrase::fact_text;
use cobscope_decoder::finding::{Cause, Findings, Group, Occurrence, RuleInfo};
use cobscope_decoder::rules::{declarations, manual, sections};

use super::item::{Item, ItemTarget};
use crate::panes::common::severity_role;
use crate::state::{Core, JumpPlace};
use crate::theme::Role;
use crate::timeline::{Row, SurveyResults};

/// Maximum length of a chain of causes.
const LONGEST_CHAIN: usize = 8;

/// Items of the findings with evidence at the cursor.
pub(super) fn items(core: &Core, row: Option<&Row>) -> Vec<Item> {
    let frames: Vec<u64> = match row {
        Some(row) => vec![row.event.frames.first, row.event.frames.last, core.cursor.frame],
        None => vec![core.cursor.frame],
    };
    let survey = core.timeline.survey();
    let (mut items, mut told) = (Vec::new(), Vec::new());
    match &survey.findings {
        Some(findings) => {
            let here = |occurrence: &Occurrence| {
                frames.contains(&occurrence.frames.first) || frames.contains(&occurrence.frames.last)
            };
            let is_here = |group: &&Group| group.first.iter().chain(&group.last).any(here);
            for group in findings.groups.iter().filter(is_here) {
                of_group(core, findings, group, &mut items);
                // The text of a rule is shown once for all its findings.
                if !told.contains(&group.key.rule) {
                    told.push(group.key.rule);
                    if let Some(rule) = findings.rules.get(usize::from(group.key.rule)) {
                        explanation(rule, &mut items);
                    }
                }
            }
        }
        None => so_far(core, &survey, &frames, &mut items),
    }
    items
}

fn of_group(core: &Core, findings: &Findings, group: &Group, items: &mut Vec<Item>) {
    let head = format!("{} {}: {}", group.severity.name(), group.rule, group.text);
    items.push(Item::new(&head, severity_role(group.severity)));
    let mut facts = Vec::new();
    if group.count > 1 {
        facts.push(format!("{} times, first {}", group.count, place(core, &group.began())));
    }
    if let Some((_, text, worst)) = &group.worst {
        facts.push(format!("worst {}: {text}", place(core, worst)));
    }
    facts.extend(group.downgraded.as_ref().map(|why| format!("severity downgraded: {why}")));
    facts.extend(group.manual.as_ref().map(|manual| format!("manual: {manual}")));
    facts.extend(group.suppressed.as_ref().map(|why| format!("suppressed by the bus file: {why}")));
    items.extend(facts.iter().map(|fact| Item::quiet(&format!("  {fact}"))));
    chain(core, findings, group, items);
}

/// The chain of causes of a finding, and its effects.
fn chain(core: &Core, findings: &Findings, group: &Group, items: &mut Vec<Item>) {
    let mut of = group;
    for _ in 0..LONGEST_CHAIN {
        match &of.cause {
            Some(Cause::Group(id)) => {
                let Some(cause) = findings.group(*id) else { break };
                items.push(link(core, "caused by", cause));
                of = cause;
            }
            Some(Cause::Quality(text)) => {
                items.push(Item::quiet(&format!("  explained by {text}")));
                break;
            }
            Some(Cause::Fact(fact)) => {
                items.push(Item::quiet(&format!("  caused by {}", fact_text(fact))));
                break;
            }
            None => break,
        }
    }
    items.extend(findings.effects(group.id).take(LONGEST_CHAIN).map(|effect| link(core, "causes", effect)));
}

fn link(core: &Core, word: &str, group: &Group) -> Item {
    let began = group.began();
    let text = format!("  {word} {} {}: {}", place(core, &began), group.rule, group.text);
    Item::new(&text, Role::Link).leading(ItemTarget::Place(JumpPlace::Frame(began.frames.last)))
}

fn place(core: &Core, occurrence: &Occurrence) -> String {
    let time = core.time_words(occurrence.time, 3).map_or(String::new(), |time| format!(" {time}"));
    format!("{{{}}}{time}", occurrence.frames.last)
}

/// Findings that opened here, while the rules still run.
fn so_far(core: &Core, survey: &SurveyResults, frames: &[u64], items: &mut Vec<Item>) {
    for opened in survey.overview.opened.iter().filter(|opened| frames.contains(&opened.spot.frame)) {
        let news = &opened.news;
        let head = format!("{} {}: {}", news.severity.name(), news.rule, news.text);
        items.push(Item::new(&head, severity_role(news.severity)));
        let cause = news.cause.and_then(|id| survey.overview.opened.iter().find(|other| other.news.id == id));
        if let Some(cause) = cause {
            let time = core.time_words(cause.time, 3).map_or(String::new(), |time| format!(" {time}"));
            let frame = cause.spot.frame;
            let text = format!("  caused by {{{frame}}}{time} {}: {}", cause.news.rule, cause.news.text);
            items.push(Item::new(&text, Role::Link).leading(ItemTarget::Place(JumpPlace::Frame(frame))));
        }
        if let Some(rule) = declarations().find(|rule| *rule.name == *news.rule) {
            explanation(&rule.info(), items);
        }
    }
}

/// The documentation of the rule, one item per section.
fn explanation(rule: &RuleInfo, items: &mut Vec<Item>) {
    let text = manual(&rule.explanation);
    let paragraphs = sections(&text);
    if paragraphs.is_empty() {
        items.push(Item::new(&format!("  {}", rule.title), Role::Text));
        items.extend(rule.source.as_ref().map(|source| Item::quiet(&format!("  Source: {source}"))));
    }
    for (heading, paragraph) in paragraphs {
        items.push(Item::headed(&format!("  {heading}: "), &paragraph));
    }
}
