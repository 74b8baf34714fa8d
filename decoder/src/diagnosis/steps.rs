//! What to do now: steps from manual, rule and state machine.

use super::plot::StoryPlot;
use crate::conclusion::find_hypothesis;
use crate::finding::{Advice, AdviceSource, FindingGroup};
use crate::profile;

/// Maximum number of steps of a story.
const COUNT: usize = 3;

/// At most [`COUNT`] steps of a story, most likely cause first.
pub(super) fn propose_steps(plot: &StoryPlot<'_>) -> Vec<Advice> {
    let mut all = Vec::new();
    let Some(root) = plot.findings.first().map(|it| it.group) else { return all };
    if let Some(fact) = plot.fact.as_ref().filter(|fact| !fact.next.is_empty()) {
        add_step(&mut all, &fact.next, "", AdviceSource::Rule);
    }
    add_advice(root, &mut all, |it| matches!(it.by, AdviceSource::Emcy | AdviceSource::Dtc));
    let is_of_device = root.rule.contains(':');
    if is_of_device {
        add_rule_step(root, &mut all);
    }
    if plot.findings.iter().any(|it| &*it.group.rule == LOST_SETTINGS) {
        add_hints(LOST_SETTINGS, &mut all);
    }
    add_advice(root, &mut all, |it| it.by == AdviceSource::Code);
    add_hints(&root.rule, &mut all);
    for step in find_hypothesis(&root.rule).iter().flat_map(|row| &row.steps) {
        add_step(&mut all, step, "", AdviceSource::General);
    }
    for finding in &plot.findings {
        add_advice(finding.group, &mut all, |it| it.by == AdviceSource::State);
    }
    add_rule_step(root, &mut all);
    add_advice(root, &mut all, |it| it.by == AdviceSource::Gate);
    for finding in &plot.findings {
        add_rule_step(finding.group, &mut all);
    }
    all.truncate(COUNT);
    all
}

/// Rule of lost settings: its hint precedes those of the restart that lost them.
const LOST_SETTINGS: &str = "config-lost";

fn add_step(all: &mut Vec<Advice>, text: &str, section: &str, by: AdviceSource) {
    let text = match by {
        AdviceSource::Rule | AdviceSource::State | AdviceSource::General => text.to_owned(),
        AdviceSource::Emcy | AdviceSource::Dtc | AdviceSource::Gate | AdviceSource::Code => {
            format!("check: {}", to_clause(text))
        }
    };
    if !all.iter().any(|known| known.text == text) {
        all.push(Advice { text, section: section.to_owned(), by });
    }
}

/// A sentence as a clause: `Measure the supply.` becomes `measure the supply`.
fn to_clause(text: &str) -> String {
    let text = text.trim_end_matches('.');
    let mut letters = text.chars();
    let first = letters.next();
    let is_word = letters.clone().next().is_some_and(char::is_lowercase);
    let text = match first {
        Some(first) if is_word => format!("{}{}", first.to_lowercase(), letters.as_str()),
        _ => text.to_owned(),
    };
    text.strip_prefix("check ").map(str::to_owned).unwrap_or(text)
}

/// Adds advice of the moment when the finding began.
fn add_advice(group: &FindingGroup, all: &mut Vec<Advice>, is_wanted: impl Fn(&Advice) -> bool) {
    let known = group.scene.iter().flat_map(|scene| &scene.advice);
    for advice in known.filter(|advice| is_wanted(advice)) {
        add_step(all, &advice.text, &advice.section, advice.by);
    }
}

/// Adds the next step that the rule proposes.
fn add_rule_step(group: &FindingGroup, all: &mut Vec<Advice>) {
    if let Some(next) = &group.next_step {
        add_step(all, next, "", AdviceSource::Rule);
    }
}

fn add_hints(rule: &str, all: &mut Vec<Advice>) {
    for text in profile::fault_hints(rule) {
        add_step(all, text, "", AdviceSource::General);
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn sentences_become_clauses() {
        assert_eq!(to_clause("Measure the supply at the device."), "measure the supply at the device");
        assert_eq!(to_clause("Check the outputs."), "the outputs");
        assert_eq!(to_clause("EMCY 8305 first."), "EMCY 8305 first");
        assert_eq!(to_clause(""), "");
    }
}
