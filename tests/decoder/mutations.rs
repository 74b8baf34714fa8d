//! Changes clean captures by the rows of `fixtures/rules/mutations.toml`. Exactly the rule of the row fires,
//! with the consequences that the row lists. Captures with random changes are judged without a panic, within
//! bounds and with reproducible results.

#![expect(clippy::panic, reason = "a test that cannot go on has failed")]

use std::collections::{BTreeMap, BTreeSet};
use std::fmt::Write as _;
use std::fs;
use std::path::PathBuf;

use cobscope_decoder::event::{Event, EventKind};
use cobscope_decoder::finding::{Findings, GROUP_LIMIT, KEPT_OCCURRENCES};
use cobscope_decoder::rules::declarations;
use serde::Deserialize;

use crate::mutator::{Line, apply, lines, text};
use crate::rules::{Annotated, device_rules, judge, parse};
use crate::support::workspace;

#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
struct Table {
    capture: BTreeMap<String, Capture>,
    mutation: Vec<Mutation>,
}

/// A capture without violations.
#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
struct Capture {
    /// File below `fixtures/`.
    file: String,
    /// Options and bus file lines, as in annotated fixtures: `#! --node 5=…`, `#| [node.5]`.
    #[serde(default)]
    lines: Vec<String>,
    /// End of the used part, in seconds.
    until: Option<f64>,
}

/// One row of the table.
#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
struct Mutation {
    rule: String,
    capture: String,
    /// Operators, applied in this order.
    steps: Vec<String>,
    /// Other rules that fire in consequence.
    #[serde(default)]
    also: Vec<String>,
    /// Bus file lines for this row only.
    #[serde(default)]
    lines: Vec<String>,
}

fn table() -> Table {
    let text = fs::read_to_string(workspace().join("fixtures/rules/mutations.toml")).unwrap();
    toml::from_str(&text).unwrap_or_else(|error| panic!("mutations.toml: {error}"))
}

/// Options and bus file lines in the comments of a capture.
fn remarks(text: &str) -> String {
    let known = text.lines().filter(|line| line.starts_with("#!") || line.starts_with("#|"));
    known.flat_map(|line| [line, "\n"]).collect()
}

fn frames(capture: &Capture) -> (Vec<Line>, String) {
    let all = fs::read_to_string(workspace().join("fixtures").join(&capture.file)).unwrap();
    let mut frames = lines(&all);
    if let Some(until) = capture.until {
        #[expect(clippy::cast_possible_truncation, reason = "seconds of a table of our own")]
        let end = frames[0].time + (until * 1e6) as i64;
        frames.retain(|line| line.time <= end);
    }
    let mut known = remarks(&all);
    known.extend(capture.lines.iter().map(|line| format!("{line}\n")));
    (frames, known)
}

/// Fired rules, each with the text of its first group and whether any of its groups counts.
fn fired(name: &str, known: &str, frames: &[Line]) -> BTreeMap<String, (bool, String)> {
    let annotated = parse(name, &format!("{known}{}", text(frames)));
    let (_, findings) = judge(&annotated.frames, &annotated.options, annotated.setup);
    let mut fired = BTreeMap::<_, (bool, String)>::new();
    for group in &findings.groups {
        let node = group.key.node.map_or_else(String::new, |node| node.to_string());
        let (severity, about, at) = (group.severity.name(), &group.key.about, group.began().frames.last);
        let text = format!("{node} {severity} {about}: {} {{{at}}}", group.text);
        let known = fired.entry(group.rule.to_string()).or_insert((false, text));
        known.0 |= group.counts();
    }
    fired
}

#[test]
fn nothing_is_wrong_in_clean_captures() {
    let mut report = String::new();
    for (name, capture) in &table().capture {
        let (frames, known) = frames(capture);
        for (rule, (_, text)) in fired(name, &known, &frames) {
            writeln!(report, "{name}: {rule}: {text}").unwrap();
        }
    }
    assert!(report.is_empty(), "\n{report}");
}

#[test]
fn every_mutation_is_found_and_nothing_else() {
    let table = table();
    let mut report = String::new();
    for Mutation { rule, capture, steps, also, lines } in &table.mutation {
        let known = table.capture.get(capture).unwrap_or_else(|| panic!("{rule}: no capture {capture}"));
        let (mut frames, mut known) = frames(known);
        known.extend(lines.iter().map(|line| format!("{line}\n")));
        for step in steps {
            apply(step, &mut frames);
        }
        let fired = fired(rule, &known, &frames);
        let wanted: BTreeSet<_> = also.iter().chain([rule]).collect();
        for missing in wanted.iter().filter(|name| !fired.contains_key(**name)) {
            writeln!(report, "{rule} on {capture}: {missing} does not fire").unwrap();
        }
        // Findings that another one covers need not be listed.
        for (other, (_, text)) in fired.iter().filter(|(name, (counts, _))| *counts && !wanted.contains(name))
        {
            writeln!(report, "{rule} on {capture}: also {other}: {text}").unwrap();
        }
    }
    assert!(report.is_empty(), "\n{report}");
}

#[test]
fn every_rule_has_a_mutation() {
    let table = table();
    let rows: BTreeSet<_> = table.mutation.iter().map(|row| row.rule.as_str()).collect();
    let general = declarations().map(|rule| rule.name.to_owned());
    let missing: Vec<_> =
        general.chain(device_rules()).filter(|rule| !rows.contains(rule.as_str())).collect();
    assert!(missing.is_empty(), "no row in mutations.toml: {missing:?}");
}

// Random changes.

/// Total number of captures with random changes.
const ROUNDS: u64 = 300;

/// A random generator with the same numbers in every run.
struct Dice(u64);

impl Dice {
    fn roll(&mut self, sides: usize) -> usize {
        self.0 ^= self.0 << 13;
        self.0 ^= self.0 >> 7;
        self.0 ^= self.0 << 17;
        usize::try_from(self.0 >> 33).unwrap() % sides.max(1)
    }
}

/// Our own captures with their options and bus file lines.
fn sources() -> Vec<(PathBuf, String)> {
    let mut sources = Vec::new();
    for folder in ["canopen", "devices", "j1939", "uds", "rules", "rules/clean"] {
        for entry in fs::read_dir(workspace().join("fixtures").join(folder)).unwrap() {
            let path = entry.unwrap().path();
            if path.extension().is_none_or(|extension| extension != "log") {
                continue;
            }
            let nodes = fs::read_to_string(path.with_extension("expected.txt")).unwrap_or_default();
            let nodes = nodes.lines().filter_map(|line| line.strip_prefix("# node:"));
            let nodes = nodes.flat_map(str::split_whitespace).map(|node| format!("#! --node {node}\n"));
            let bus_file = fs::read_to_string(path.with_extension("bus.toml")).unwrap_or_default();
            let bus_file = bus_file.lines().map(|line| format!("#| {line}\n"));
            let mut known = remarks(&fs::read_to_string(&path).unwrap());
            known.extend(nodes.chain(bus_file));
            sources.push((path, known));
        }
    }
    sources.sort();
    sources
}

fn change(dice: &mut Dice, lines: &mut Vec<Line>) {
    let (count, place) = (lines.len(), dice.roll(lines.len()));
    if count == 0 {
        return;
    }
    match dice.roll(8) {
        0 => drop(lines.drain(place..(place + dice.roll(count / 4 + 1)).min(count))),
        1 => {
            // Clock steps by days and years, too.
            let scale = [1, 1, 1, 1_000, 100_000_000][dice.roll(5)];
            let by = (i64::try_from(dice.roll(4_000_000)).unwrap() - 1_000_000) * scale;
            lines[place..].iter_mut().for_each(|line| line.time += by);
        }
        2 => {
            let line = lines[place].clone();
            let times = dice.roll(40);
            lines.splice(place..place, std::iter::repeat_n(line, times));
        }
        3 => {
            let other = dice.roll(count);
            lines.swap(place, other);
        }
        4 if lines[place].has_payload() => lines[place].body.truncate(dice.roll(8) * 2),
        5 if lines[place].id.len() == 3 => lines[place].id = format!("{:03X}", dice.roll(0x800)),
        5 => lines[place].id = format!("{:08X}", dice.roll(0x2000_0000)),
        6 => {
            let id = lines[dice.roll(count)].id.clone();
            let body = format!("{:016X}", dice.0)[..dice.roll(9) * 2].to_owned();
            let line = Line { id, body, ..lines[place].clone() };
            lines.insert(place, line);
        }
        _ if lines[place].has_payload() && !lines[place].body.is_empty() => {
            let at = dice.roll(lines[place].body.len() / 2) * 2;
            lines[place].body.replace_range(at..at + 2, &format!("{:02X}", dice.roll(256)));
        }
        _ => {}
    }
}

/// All findings, as text.
fn told(capture: &Annotated) -> (String, Findings) {
    let (news, findings) = judge(&capture.frames, &capture.options, capture.setup.clone());
    let mut told = String::new();
    for (number, Event { kind, .. }) in &news {
        if let EventKind::FindingOpened(news) | EventKind::FindingClosed(news) = kind {
            writeln!(told, "{number} {} {news:?}", kind.name()).unwrap();
        }
    }
    for group in &findings.groups {
        writeln!(told, "{group:?}").unwrap();
    }
    writeln!(told, "{:?} {:?} {:?}", findings.tallies, findings.cases, findings.quality).unwrap();
    (told, findings)
}

#[test]
fn captures_changed_at_random_are_judged_within_bounds_and_always_the_same() {
    let sources = sources();
    let mut found = 0;
    for round in 0..ROUNDS {
        let mut dice = Dice(0x9E37_79B9_7F4A_7C15 ^ (round + 1));
        let (path, known) = &sources[dice.roll(sources.len())];
        let name = format!("{} changed in round {round}", path.display());
        let mut frames = lines(&fs::read_to_string(path).unwrap());
        for _ in 0..=dice.roll(12) {
            change(&mut dice, &mut frames);
        }
        let capture = parse(&name, &format!("{known}{}", text(&frames)));
        let (first, findings) = told(&capture);
        assert_eq!(first, told(&capture).0, "{name}");
        assert!(findings.groups.len() <= GROUP_LIMIT, "{name}");
        for group in &findings.groups {
            let kept = group.first.len() + group.last.len();
            assert!(kept <= 2 * KEPT_OCCURRENCES, "{name}: {group:?}");
            assert!(kept as u64 <= group.count && !group.text.is_empty(), "{name}: {group:?}");
            assert!(group.text.len() < 400 && !group.text.contains('\n'), "{name}: {group:?}");
        }
        found += findings.groups.len();
    }
    assert!(found > 50, "{found}");
}
