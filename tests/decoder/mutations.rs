//! Changes clean captures by the rows of `fixtures/rules/mutations/`. Exactly the rule of the row fires, with
//! the consequences that the row lists, also on variations of the capture that do not concern it.

#![expect(clippy::panic, reason = "a test that cannot go on has failed")]

use std::collections::{BTreeMap, BTreeSet};
use std::fmt::Write as _;
use std::fs;
use std::path::PathBuf;

use cobscope_decoder::finding::{FindingCause, FindingGroup, RuleOrigin};
use cobscope_decoder::rules::all_declarations;
use serde::Deserialize;

use crate::mutator::{Line, apply, lines, text};
use crate::rules::{device_rules, judge, parse};
use crate::statements::judged_statements;
use crate::support::workspace;

/// Mutations of one file.
#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Table {
    /// Profile whose statements the mutations prove.
    #[serde(default)]
    pub profile: String,
    /// Judged statements without a mutation; the number may only fall.
    #[serde(default)]
    pub unproven: usize,
    pub capture: BTreeMap<String, Capture>,
    pub mutation: Vec<Mutation>,
}

/// A capture without violations.
#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Capture {
    /// File below `fixtures/`.
    file: String,
    /// Options and bus file lines, as in annotated fixtures: `#! --node 5=…`, `#| [node.5]`.
    #[serde(default)]
    lines: Vec<String>,
    /// End of the used part, in seconds.
    until: Option<f64>,
}

/// One row of a table.
#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Mutation {
    pub rule: String,
    pub capture: String,
    /// Operators, applied in this order.
    pub steps: Vec<String>,
    /// Other rules that fire in consequence.
    #[serde(default)]
    also: Vec<String>,
    /// Bus file lines for this row only.
    #[serde(default)]
    lines: Vec<String>,
    /// Statements of the manual that the row violates.
    #[serde(default)]
    pub statements: Vec<String>,
    /// Reason why the row has no variations.
    #[serde(default)]
    pub fixed: String,
}

/// Tables of all files, sorted by name.
pub fn tables() -> Vec<Table> {
    let folder = workspace().join("fixtures/rules/mutations");
    let mut paths: Vec<_> = fs::read_dir(folder).unwrap().map(|entry| entry.unwrap().path()).collect();
    paths
        .retain(|path| path.extension().is_some_and(|it| it == "toml") && !path.ends_with("variations.toml"));
    paths.sort();
    let table = |path: &PathBuf| {
        let text = fs::read_to_string(path).unwrap();
        toml::from_str(&text).unwrap_or_else(|error| panic!("{}: {error}", path.display()))
    };
    paths.iter().map(table).collect()
}

/// Options and bus file lines in the comments of a capture.
pub fn remarks(text: &str) -> String {
    let known = text.lines().filter(|line| line.starts_with("#!") || line.starts_with("#|"));
    known.flat_map(|line| [line, "\n"]).collect()
}

impl Capture {
    fn frames(&self) -> (Vec<Line>, String) {
        let all = fs::read_to_string(workspace().join("fixtures").join(&self.file)).unwrap();
        let mut frames = lines(&all);
        if let Some(until) = self.until {
            #[expect(clippy::cast_possible_truncation, reason = "seconds of a table of our own")]
            let end = frames[0].time + (until * 1e6) as i64;
            frames.retain(|line| line.time <= end);
        }
        let mut known = remarks(&all);
        known.extend(self.lines.iter().map(|line| format!("{line}\n")));
        (frames, known)
    }
}

impl Table {
    /// Clean frames of a mutation, with options and bus file lines.
    pub fn frames(&self, mutation: &Mutation) -> (Vec<Line>, String) {
        let Mutation { rule, capture, lines, .. } = mutation;
        let capture = self.capture.get(capture).unwrap_or_else(|| panic!("{rule}: no capture {capture}"));
        let (frames, mut known) = capture.frames();
        known.extend(lines.iter().map(|line| format!("{line}\n")));
        (frames, known)
    }
}

/// Fired rules, each with the text of its first group and whether any of its groups counts.
fn fired(name: &str, known: &str, frames: &[Line]) -> BTreeMap<String, (bool, String)> {
    let annotated = parse(name, &format!("{known}{}", text(frames)));
    let (_, findings) = judge(&annotated.frames, &annotated.options, annotated.setup);
    let mut fired = BTreeMap::<_, (bool, String)>::new();
    // A conclusion explains findings of rules; a mutation is one for a rule.
    let explains = |id: u64| {
        let mut effects = findings.reported_groups();
        effects.any(|group| matches!(group.cause, Some(FindingCause::Group(cause)) if cause == id))
    };
    let is_explanation = |group: &&FindingGroup| {
        findings.rules[usize::from(group.key.rule)].origin == RuleOrigin::Conclusion && explains(group.id)
    };
    for group in findings.groups.iter().filter(|group| !is_explanation(group)) {
        let node = group.key.node.map_or_else(String::new, |node| node.to_string());
        let (severity, about, at) =
            (group.severity.name(), &group.key.about, group.first_occurrence().frames.last);
        let text = format!("{node} {severity} {about}: {} {{{at}}}", group.text);
        let known = fired.entry(group.rule.to_string()).or_insert((false, text));
        known.0 |= group.is_reported();
    }
    fired
}

/// What a mutation is to cause and does not, and the reverse; empty if it is found.
pub fn wrong(mutation: &Mutation, known: &str, frames: &[Line]) -> String {
    let Mutation { rule, capture, also, .. } = mutation;
    let fired = fired(rule, known, frames);
    let wanted: BTreeSet<_> = also.iter().chain([rule]).collect();
    let mut report = String::new();
    for missing in wanted.iter().filter(|name| !fired.contains_key(**name)) {
        writeln!(report, "{rule} on {capture}: {missing} does not fire").unwrap();
    }
    // Findings that another one covers need not be listed.
    for (other, (_, text)) in fired.iter().filter(|(name, (counts, _))| *counts && !wanted.contains(name)) {
        writeln!(report, "{rule} on {capture}: also {other}: {text}").unwrap();
    }
    report
}

#[test]
fn nothing_is_wrong_in_clean_captures() {
    let mut report = String::new();
    for (name, capture) in tables().iter().flat_map(|table| &table.capture) {
        let (frames, known) = capture.frames();
        for (rule, (_, text)) in fired(name, &known, &frames) {
            writeln!(report, "{name}: {rule}: {text}").unwrap();
        }
    }
    assert!(report.is_empty(), "\n{report}");
}

#[test]
fn every_mutation_is_found_and_nothing_else() {
    let mut report = String::new();
    for table in &tables() {
        for mutation in &table.mutation {
            let (mut frames, known) = table.frames(mutation);
            mutation.steps.iter().for_each(|step| apply(step, &mut frames));
            report += &wrong(mutation, &known, &frames);
        }
    }
    assert!(report.is_empty(), "\n{report}");
}

#[test]
fn every_rule_has_a_mutation() {
    let tables = tables();
    let rows = tables.iter().flat_map(|table| &table.mutation);
    let rows: BTreeSet<_> = rows.map(|row| row.rule.as_str()).collect();
    let general = all_declarations().map(|rule| rule.name.to_owned());
    let missing: Vec<_> =
        general.chain(device_rules()).filter(|rule| !rows.contains(rule.as_str())).collect();
    assert!(missing.is_empty(), "no row in fixtures/rules/mutations: {missing:?}");
}

/// Rows that prove a statement name it; their rule judges it.
#[test]
fn every_judged_statement_has_a_mutation() {
    let mut report = String::new();
    for table in tables().iter().filter(|table| !table.profile.is_empty()) {
        let judged = judged_statements(&table.profile);
        let mut unproven: BTreeSet<_> = judged.keys().map(String::as_str).collect();
        for Mutation { rule, statements, .. } in &table.mutation {
            for text in statements {
                let is_judge = judged.get(text).is_some_and(|rules| rules.contains(rule));
                if !is_judge {
                    writeln!(report, "{rule} does not judge {text:?}").unwrap();
                }
                unproven.remove(text.as_str());
            }
        }
        if unproven.len() != table.unproven {
            let (found, stated) = (unproven.len(), table.unproven);
            writeln!(report, "{}: {found} of {} unproven, not {stated}", table.profile, judged.len())
                .unwrap();
            for text in unproven {
                writeln!(report, "    {text}").unwrap();
            }
        }
    }
    assert!(report.is_empty(), "\n{report}");
}
