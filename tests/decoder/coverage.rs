//! Every rule of the five devices has a verdict in a fixture of its device: a rule that no fixture exercises is
//! unproven.

use std::collections::{BTreeMap, BTreeSet};
use std::fs;
use std::path::{Path, PathBuf};

use cobscope_decoder::finding::{RuleOrigin, RuleOutcome};
use cobscope_decoder::profile::Catalogue;

use crate::rules::{captures, judge, parse};
use crate::support::workspace;

/// Profiles of the five manuals.
const DEVICES: [&str; 5] =
    ["rexroth-sydfec", "rexroth-vpcd", "rexroth-ifb-iac", "wandfluh-md2", "danfoss-pve-ci"];

/// Files below a folder with this extension.
fn files(folder: &Path, extension: &str, found: &mut Vec<PathBuf>) {
    for entry in fs::read_dir(folder).unwrap() {
        let path = entry.unwrap().path();
        if path.is_dir() {
            files(&path, extension, found);
        } else if path.extension().is_some_and(|it| it == extension) {
            found.push(path);
        }
    }
}

/// Text of each capture with its options: annotated captures, clean ones, and stories.
fn fixtures() -> Vec<(String, String)> {
    let mut paths = captures();
    files(&workspace().join("fixtures/rules/clean"), "log", &mut paths);
    let named = |path: &PathBuf| (path.display().to_string(), fs::read_to_string(path).unwrap());
    let mut all: Vec<_> = paths.iter().map(named).collect();
    let mut stories = Vec::new();
    for folder in ["stories", "diagnosis"] {
        files(&workspace().join("fixtures").join(folder), "toml", &mut stories);
    }
    for path in stories.iter().filter(|path| path.with_extension("log").exists()) {
        let table: toml::Table = toml::from_str(&fs::read_to_string(path).unwrap()).unwrap();
        let nodes = table["node"].as_array().unwrap().iter().filter_map(toml::Value::as_str);
        let nodes: Vec<String> = nodes.map(|node| format!("#! --node {node}\n")).collect();
        let mut text = nodes.concat();
        let bus_file = table.get("bus_file").and_then(toml::Value::as_str).unwrap_or_default();
        text.extend(bus_file.lines().map(|line| format!("#| {line}\n")));
        text += &fs::read_to_string(path.with_extension("log")).unwrap();
        all.push((path.display().to_string(), text));
    }
    all
}

/// Names of all rules of a profile and its variants.
fn rules_of(profile: &str) -> BTreeSet<String> {
    let catalogue = Catalogue::default();
    let device = catalogue.device(profile).unwrap();
    let variants = device.variants.iter().map(|variant| format!("{profile}:{}", variant.id));
    let devices =
        variants.map(|name| catalogue.device(&name).unwrap()).chain([catalogue.device(profile).unwrap()]);
    devices
        .flat_map(|device| {
            device.rules.iter().map(|rule| format!("{profile}:{}", rule.name)).collect::<Vec<_>>()
        })
        .collect()
}

#[test]
fn each_rule_of_a_device_has_a_verdict_in_a_fixture() {
    let mut verdicts: BTreeMap<String, bool> = BTreeMap::new();
    for (name, text) in fixtures() {
        let capture = parse(&name, &text);
        let (_, findings) = judge(&capture.frames, &capture.options, capture.setup);
        for (rule, tally) in findings.rules.iter().zip(&findings.tallies) {
            if rule.origin == RuleOrigin::Device {
                let has_verdict = tally.verdict() != RuleOutcome::NotExercised;
                *verdicts.entry(rule.name.to_string()).or_default() |= has_verdict;
            }
        }
    }
    let all = DEVICES.iter().flat_map(|profile| rules_of(profile));
    let missing: Vec<_> = all.filter(|rule| verdicts.get(rule) != Some(&true)).collect();
    assert!(missing.is_empty(), "{missing:#?}");
}
