//! One rule as text.

use std::fmt::Write as _;

use cobscope_decoder::rules::all_sections;
use cobscope_decoder::rules::conformance::test_cases;
use cobscope_decoder::sink::table::{CellAlignment, TextTable};

use super::ListedRule;
use crate::run::describe::fold_text;

/// Text of `explain RULE`.
pub(in crate::cmd) fn rule_page(rule: &ListedRule) -> String {
    let on = if rule.is_on { "" } else { ", off unless the bus file sets a severity" };
    let timing = if rule.is_timing { ", skipped without usable timestamps" } else { "" };
    let mut text = String::new();
    fold_text(&mut text, &format!("{}  ", rule.name), &rule.title, 4);
    fold_text(&mut text, "  ", &format!("{}{on}{timing}", rule.severity.name()), 2);
    for (heading, paragraph) in all_sections(&rule.explanation) {
        push_part(&mut text, heading, &[paragraph]);
    }
    if rule.explanation.is_empty() && !rule.source.is_empty() {
        push_part(&mut text, "Source", std::slice::from_ref(&rule.source));
    }
    if !rule.note.is_empty() {
        push_part(&mut text, "Note", std::slice::from_ref(&rule.note));
    }
    push_part(&mut text, "Only for the variants", &rule.variants);
    let named = rule.cases.iter().map(|id| {
        let name = test_cases().by_id(id).map_or("", |case| case.name.as_str());
        format!("{id} {name}")
    });
    push_part(&mut text, "Cases of the CiA conformance test plan", &named.collect::<Vec<_>>());
    let waived = rule.waivers.iter().map(|(device, reason)| format!("{device}: {reason}"));
    push_part(&mut text, "Waived by", &waived.collect::<Vec<_>>());
    if !rule.tolerances.is_empty() {
        text.push_str("\nTolerances\n");
        tolerance_table(rule).write_table(2, &mut text);
    }
    text.push_str("\nBus file, with the defaults\n");
    for line in rule.bus_file_snippet().lines() {
        let _ = writeln!(text, "  {line}");
    }
    text
}

/// A heading with lines; omitted without lines.
fn push_part(text: &mut String, heading: &str, lines: &[String]) {
    if !lines.is_empty() {
        let _ = writeln!(text, "\n{heading}");
    }
    for line in lines {
        fold_text(text, "  ", line, 2);
    }
}

fn tolerance_table(rule: &ListedRule) -> TextTable {
    let mut table = TextTable::new(&[
        ("KEY", CellAlignment::Left),
        ("DEFAULT", CellAlignment::Right),
        ("UNIT", CellAlignment::Left),
        ("LIMITS", CellAlignment::Left),
    ]);
    for tolerance in &rule.tolerances {
        let default = tolerance.default.to_string();
        table.add_row([tolerance.key, &default, tolerance.unit, &tolerance.text].map(str::to_owned));
    }
    table
}
