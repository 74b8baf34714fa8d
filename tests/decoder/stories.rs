//! Stories of failing devices: `fixtures/stories/<device>/<name>.story` was written from the manual before the
//! program was run; `.toml` contains the same expectation as data, `.log` the capture of the simulator. Also the
//! captures of `fixtures/diagnosis/`, which the same simulators write.

use std::collections::{BTreeMap, BTreeSet};
use std::fs;
use std::path::{Path, PathBuf};
use std::process::Command;

use cobscope_decoder::diagnosis::{Diagnosis, DiagnosisContext};
use serde::Deserialize;

use crate::rules::{judge, parse};
use crate::support::{python, skip, workspace};

/// Expectation of one story.
#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
struct Expectation {
    /// Nodes with their profiles, as given to `--node`.
    node: Vec<String>,
    /// Rules that must report a finding.
    expected: Vec<String>,
    /// Rules that must not report one.
    forbidden: Vec<String>,
    /// No rule must report a finding.
    #[serde(default)]
    clean: bool,
    /// Lines of a bus file.
    #[serde(default)]
    bus_file: String,
    /// Rules that do not meet the story yet (expected but missing, or forbidden but reported), and the reason.
    #[serde(default)]
    pending: BTreeMap<String, String>,
}

fn folder() -> PathBuf {
    workspace().join("fixtures").join("stories")
}

/// Paths of all files with this extension in a folder and in the folders of the devices.
fn files(root: &Path, extension: &str) -> BTreeSet<PathBuf> {
    let entries = |folder: &Path| fs::read_dir(folder).unwrap().map(|entry| entry.unwrap().path());
    let devices = entries(root).filter(|path| path.is_dir());
    let all = devices.flat_map(|device| entries(&device).collect::<Vec<_>>()).chain(entries(root));
    all.filter(|path| path.extension().is_some_and(|found| found == extension)).collect()
}

/// Deviations of the program from the story.
fn deviations(path: &Path) -> Vec<String> {
    let expectation: Expectation = toml::from_str(&fs::read_to_string(path).unwrap()).unwrap();
    let frames = fs::read_to_string(path.with_extension("log")).unwrap();
    let story = fs::read_to_string(path.with_extension("story")).unwrap();
    let mut head: Vec<String> = expectation.node.iter().map(|node| format!("#! --node {node}")).collect();
    head.extend(expectation.bus_file.lines().map(|line| format!("#| {line}")));
    let capture = parse(&path.display().to_string(), &format!("{}\n{frames}", head.join("\n")));
    let (_, findings) = judge(&capture.frames, &capture.options, capture.setup.clone());
    let diagnosis =
        Diagnosis::diagnose_findings(&findings, findings.reported_groups(), DiagnosisContext::default());
    let emitted = diagnosis.stories.first().map(|story| story.findings.clone()).unwrap_or_default();
    let emitted: BTreeSet<&str> =
        emitted.iter().filter_map(|id| Some(&*findings.group_by_id(*id)?.rule)).collect();
    let is_only_notes = diagnosis.stories.is_empty() && !diagnosis.notes.is_empty();
    if !expectation.expected.is_empty()
        && !is_only_notes
        && !expectation.expected.iter().any(|rule| emitted.contains(rule.as_str()))
    {
        let text =
            format!("{}: the first story has none of the expected findings: {emitted:?}", path.display());
        return vec![text];
    }
    let reported: BTreeSet<&str> = findings.reported_groups().map(|group| &*group.rule).collect();
    let mut deviations = Vec::new();
    if expectation.clean && !reported.is_empty() {
        deviations.push("a clean run has findings".to_owned());
    }
    for rule in &expectation.expected {
        let is_pending = expectation.pending.contains_key(rule);
        match (reported.contains(rule.as_str()), is_pending) {
            (true, true) => deviations.push(format!("{rule} is reported; remove it from pending")),
            (false, false) => deviations.push(format!("{rule} is missing")),
            _ => {}
        }
    }
    for rule in &expectation.forbidden {
        match (reported.contains(rule.as_str()), expectation.pending.contains_key(rule)) {
            (true, false) => deviations.push(format!("{rule} must not be reported")),
            (false, true) => deviations.push(format!("{rule} is not reported; remove it from pending")),
            _ => {}
        }
    }
    let named = expectation.expected.iter().chain(&expectation.forbidden);
    deviations.extend(
        named.filter(|rule| !story.contains(rule.as_str())).map(|rule| format!("{rule} not in the story")),
    );
    let known: BTreeSet<&str> = findings.rules.iter().map(|rule| &*rule.name).collect();
    let named = expectation.expected.iter().chain(&expectation.forbidden);
    let unknown = named
        .filter(|rule| !known.contains(rule.as_str()) && !expectation.pending.contains_key(rule.as_str()));
    deviations.extend(unknown.map(|rule| format!("{rule} is not a rule")));
    let reported = reported.into_iter().collect::<Vec<_>>().join(" ");
    deviations.iter().map(|text| format!("{}: {text} (reported: {reported})", path.display())).collect()
}

#[test]
fn each_story_has_its_findings_and_no_forbidden_one() {
    let stories = files(&folder(), "toml");
    let deviations: Vec<String> = stories.iter().flat_map(|path| deviations(path)).collect();
    assert!(deviations.is_empty(), "{}", deviations.join("\n"));
    let mut per_device = BTreeMap::new();
    for path in &stories {
        *per_device.entry(path.parent().unwrap()).or_insert(0) += 1;
        assert!(fs::metadata(path.with_extension("log")).unwrap().len() < 60_000, "{}", path.display());
    }
    assert_eq!(per_device.len(), 5);
    assert!(per_device.values().all(|count| *count >= 7), "{per_device:?}");
    assert!(per_device.keys().all(|device| device.join("clean-run.toml").exists()));
}

/// Runs the script of a folder of fixtures and compares the captures.
fn regenerate(name: &str) {
    let Some(python) = python() else {
        return skip("python", &format!("captures of fixtures/{name} are not generated again"));
    };
    let target = Path::new(env!("CARGO_TARGET_TMPDIR")).join(name);
    if target.exists() {
        fs::remove_dir_all(&target).unwrap();
    }
    fs::create_dir_all(&target).unwrap();
    let folder = workspace().join("fixtures").join(name);
    let script = folder.join(format!("make_{name}.py"));
    let output = Command::new(python).arg(script).arg(&target).output().unwrap();
    assert!(output.status.success(), "{}", String::from_utf8_lossy(&output.stderr));
    let committed = files(&folder, "log");
    assert_eq!(files(&target, "log").len(), committed.len());
    for path in committed {
        let again = target.join(path.strip_prefix(&folder).unwrap());
        assert_eq!(
            fs::read_to_string(&path).unwrap(),
            fs::read_to_string(again).unwrap(),
            "{}",
            path.display()
        );
    }
}

#[test]
fn the_simulators_write_the_committed_stories() {
    regenerate("stories");
}

#[test]
fn the_simulators_write_the_committed_root_causes() {
    regenerate("diagnosis");
}
