//! One rule as text.

use std::fmt::Write as _;

use cobscope_decoder::rules::conformance::cases;
use cobscope_decoder::rules::sections;
use cobscope_decoder::sink::table::{Align, Table};

use super::ListedRule;
use crate::cmd::describe::fold;

/// Text of `explain RULE`.
pub(in crate::cmd) fn page(rule: &ListedRule) -> String {
    let on = if rule.is_on { "" } else { ", off unless the bus file sets a severity" };
    let timing = if rule.is_timing { ", skipped without usable timestamps" } else { "" };
    let mut text = String::new();
    fold(&mut text, &format!("{}  ", rule.name), &rule.title, 4);
    fold(&mut text, "  ", &format!("{}{on}{timing}", rule.severity.name()), 2);
    for (heading, paragraph) in sections(&rule.explanation) {
        part(&mut text, heading, &[paragraph]);
    }
    if rule.explanation.is_empty() && !rule.source.is_empty() {
        part(&mut text, "Source", std::slice::from_ref(&rule.source));
    }
    if !rule.note.is_empty() {
        part(&mut text, "Note", std::slice::from_ref(&rule.note));
    }
    part(&mut text, "Only for the variants", &rule.variants);
    let named = rule.cases.iter().map(|id| {
        let name = cases().by_id(id).map_or("", |case| case.name.as_str());
        format!("{id} {name}")
    });
    part(&mut text, "Cases of the CiA conformance test plan", &named.collect::<Vec<_>>());
    let waived = rule.waivers.iter().map(|(device, reason)| format!("{device}: {reason}"));
    part(&mut text, "Waived by", &waived.collect::<Vec<_>>());
    if !rule.tolerances.is_empty() {
        text.push_str("\nTolerances\n");
        tolerances(rule).write(2, &mut text);
    }
    text.push_str("\nBus file, with the defaults\n");
    for line in rule.snippet().lines() {
        let _ = writeln!(text, "  {line}");
    }
    text
}

/// A heading with lines; omitted without lines.
fn part(text: &mut String, heading: &str, lines: &[String]) {
    if !lines.is_empty() {
        let _ = writeln!(text, "\n{heading}");
    }
    for line in lines {
        fold(text, "  ", line, 2);
    }
}

fn tolerances(rule: &ListedRule) -> Table {
    let mut table = Table::new(&[
        ("KEY", Align::Left),
        ("DEFAULT", Align::Right),
        ("UNIT", Align::Left),
        ("LIMITS", Align::Left),
    ]);
    for tolerance in &rule.tolerances {
        let default = tolerance.default.to_string();
        table.row([tolerance.key, &default, tolerance.unit, &tolerance.text].map(str::to_owned));
    }
    table
}
