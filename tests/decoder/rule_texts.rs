//! The numbers in the documentation of a rule are those of its code.

use std::collections::BTreeMap;
use std::fmt::Write as _;
use std::fs;
use std::path::PathBuf;

use cobscope_decoder::profile::connection_set;
use cobscope_decoder::rules::{all_declarations, section_text};
use regex::Regex;

use crate::support::{files_below, workspace};

/// Rules whose limit is a decision of the session.
const LIMITS_ELSEWHERE: &[(&str, &str)] = &[
    ("node-lost", "session/bus/nodes/monitoring.rs"),
    ("sdo-client-does-not-wait", "session/canopen/sdo/pending.rs"),
    ("uds-no-response", "session/uds/exchange.rs"),
];

/// Sources of all general rules, by name of the rule.
fn sources() -> BTreeMap<String, PathBuf> {
    let folder = workspace().join("decoder/src/rules/general");
    let families =
        fs::read_dir(folder).unwrap().map(|entry| entry.unwrap().path()).filter(|path| path.is_dir());
    let files = families.flat_map(|family| fs::read_dir(family).unwrap().map(|entry| entry.unwrap().path()));
    let name = |path: &PathBuf| path.file_stem().unwrap().to_string_lossy().replace('_', "-");
    files.map(|path| (name(&path), path)).collect()
}

/// Code without comments, texts and tests; numbers without underscores.
fn code(path: &PathBuf) -> String {
    let text = fs::read_to_string(path).unwrap();
    let lines = text.split("#[cfg(test)]").next().unwrap().lines();
    let code: Vec<_> = lines.filter(|line| !line.trim_start().starts_with("//")).collect();
    let digits = Regex::new(r"(\d)_(\d)").unwrap();
    let joined = digits.replace_all(&code.join("\n"), "$1$2").into_owned();
    let joined = digits.replace_all(&joined, "$1$2").into_owned();
    Regex::new("\"[^\"]*\"").unwrap().replace_all(&joined, "\"\"").into_owned()
}

/// A number with its unit as code may write it: in ns, µs, ms or s, and a percentage also as a share.
fn notations(number: f64, unit: &str) -> Vec<f64> {
    let nanoseconds = match unit {
        "h" => number * 3_600e9,
        "s" => number * 1e9,
        "ms" => number * 1e6,
        "µs" => number * 1e3,
        _ => return vec![number, number / 100.0],
    };
    [1.0, 1e3, 1e6, 1e9].map(|unit| nanoseconds / unit).to_vec()
}

#[test]
fn each_number_in_a_text_is_in_the_code() {
    let stated = Regex::new(r"(?:^|[^\w§.])(\d+(?:\.\d+)?)\s?(ms|s|h|%|µs|bytes|bits)\b").unwrap();
    let written = Regex::new(r"\d+(?:\.\d+)?").unwrap();
    let (sources, mut report, mut count) = (sources(), String::new(), 0);
    for rule in all_declarations() {
        let elsewhere = LIMITS_ELSEWHERE.iter().find(|(name, _)| *name == rule.name);
        let elsewhere = elsewhere.map(|(_, file)| workspace().join("decoder/src").join(file));
        let path = sources.get(rule.name).unwrap();
        let code = code(path) + &elsewhere.map_or_else(String::new, |path| code(&path));
        let known: Vec<f64> =
            written.find_iter(&code).map(|number| number.as_str().parse().unwrap()).collect();
        let text = section_text(rule.explanation, "What it checks").unwrap_or_default().replace('\n', " ");
        for number in stated.captures_iter(&text) {
            let (value, unit) = (number[1].parse().unwrap(), &number[2]);
            let is_known =
                notations(value, unit).iter().any(|one| known.iter().any(|it| (it - one).abs() < 1e-9));
            count += 1;
            if !is_known {
                writeln!(report, "{}: {value} {unit} is not in {}", rule.name, path.display()).unwrap();
            }
        }
    }
    assert!(report.is_empty(), "\n{report}");
    assert!(count >= 12, "{count} numbers");
}

/// CiA 301 §7.3.5, table 40: the ranges in the text are those of the table that all rules use.
#[test]
fn the_restricted_identifiers_are_those_of_the_text() {
    let rule = all_declarations().find(|rule| rule.name == "cob-id-restricted").unwrap();
    let range = Regex::new(r"([0-9A-F]{3})–([0-9A-F]{3})").unwrap();
    let hex = |digits: &str| u16::from_str_radix(digits, 16).unwrap();
    let ranges: Vec<_> =
        range.captures_iter(rule.explanation).map(|ends| hex(&ends[1])..=hex(&ends[2])).collect();
    assert_eq!(ranges.len(), 6);
    for id in 0..0x800 {
        let is_stated = ranges.iter().any(|range| range.contains(&id));
        assert_eq!(is_stated, connection_set().restriction_reason(id).is_some(), "{id:03X}");
    }
}

/// Each row of the table of words names a test that exists.
#[test]
fn each_word_has_a_test() {
    let text = fs::read_to_string(workspace().join("docs/decisions.md")).unwrap();
    let table = text.split("\n## Words\n").nth(1).unwrap().split("\n## ").next().unwrap();
    let last_column = Regex::new(r"\| `(\w+)` \|\n").unwrap();
    let names: Vec<_> = last_column.captures_iter(table).map(|name| name[1].to_owned()).collect();
    assert_eq!(names.len(), table.lines().filter(|line| line.starts_with("| ")).count() - 2);
    let sources: String = ["decoder/src", "tests"]
        .into_iter()
        .flat_map(|folder| files_below(folder, "rs"))
        .map(|path| fs::read_to_string(path).unwrap())
        .collect();
    for name in names {
        assert!(sources.contains(&format!("fn {name}(")), "{name}");
    }
}
