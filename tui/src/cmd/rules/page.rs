//! One rule for a terminal.

use std::fmt::Write as _;

use cobscope_decoder::rules::conformance::cases;
use cobscope_decoder::rules::sections;
use cobscope_decoder::sink::table::{Align, Table};

use super::Listed;
use crate::cmd::describe::fold;

/// What `explain RULE` prints.
pub(in crate::cmd) fn page(rule: &Listed) -> String {
    let on = if rule.is_on { "" } else { ", off unless the bus file gives it a severity" };
    let timing = if rule.is_timing { ", silent where the capture's times say nothing" } else { "" };
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
    part(&mut text, "Only of the variants", &rule.variants);
    let named = rule.cases.iter().map(|id| {
        let name = cases().by_id(id).map_or("", |case| case.name.as_str());
        format!("{id} {name}")
    });
    part(&mut text, "Cases of CiA's conformance test plan", &named.collect::<Vec<_>>());
    let waived = rule.waivers.iter().map(|(device, reason)| format!("{device}: {reason}"));
    part(&mut text, "Waived by", &waived.collect::<Vec<_>>());
    if !rule.tolerances.is_empty() {
        text.push_str("\nTolerances\n");
        tolerances(rule).write(2, &mut text);
    }
    text.push_str("\nBus file, with what holds without it\n");
    for line in rule.snippet().lines() {
        let _ = writeln!(text, "  {line}");
    }
    text
}

/// A heading with its lines; nothing without any.
fn part(text: &mut String, heading: &str, lines: &[String]) {
    if !lines.is_empty() {
        let _ = writeln!(text, "\n{heading}");
    }
    for line in lines {
        fold(text, "  ", line, 2);
    }
}

fn tolerances(rule: &Listed) -> Table {
    let mut table = Table::new(&[
        ("KEY", Align::Left),
        ("DEFAULT", Align::Right),
        ("UNIT", Align::Left),
        ("LIMITS", Align::Left),
    ]);
    for tolerance in rule.tolerances {
        let cells = [tolerance.key, "", tolerance.unit, tolerance.text];
        let mut cells = cells.map(str::to_owned);
        if let Some(cell) = cells.get_mut(1) {
            *cell = tolerance.default.to_string();
        }
        table.row(cells);
    }
    table
}
