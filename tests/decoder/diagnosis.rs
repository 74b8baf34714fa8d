//! Diagnosis of captures with a known root cause: `fixtures/diagnosis/<name>.toml` was written from the manual
//! before the program was run.

use std::fmt::Write as _;
use std::fs;
use std::path::{Path, PathBuf};

use cobscope_decoder::diagnosis::{Diagnosis, DiagnosisContext, LineLabel, Story};
use cobscope_decoder::finding::{CaptureFindings, Severity};
use cobscope_decoder::session::SessionOptions;
use serde::Deserialize;

use crate::rules::{judge, judge_capture, parse, plain_setup};
use crate::support::{corpus, skip, workspace};

/// Expectation for one capture; texts for the reader are not compared.
#[derive(Deserialize)]
struct Expectation {
    node: Vec<String>,
    #[serde(default)]
    bus_file: String,
    emcy: bool,
    words: Vec<String>,
    cause_frames: String,
    /// Without the frames of the cause, the remaining effects are notes only.
    #[serde(default)]
    cut_leaves_notes: bool,
}

#[derive(Deserialize)]
struct Clean {
    clean: Vec<String>,
}

fn folder() -> PathBuf {
    workspace().join("fixtures").join("diagnosis")
}

fn expectations() -> Vec<(PathBuf, Expectation)> {
    let entries = fs::read_dir(folder()).unwrap().map(|entry| entry.unwrap().path());
    let is_expectation =
        |path: &PathBuf| path.extension().is_some_and(|it| it == "toml") && !path.ends_with("clean.toml");
    let mut paths: Vec<_> = entries.filter(is_expectation).collect();
    paths.sort();
    let read = |path: PathBuf| (path.clone(), toml::from_str(&fs::read_to_string(path).unwrap()).unwrap());
    paths.into_iter().map(read).collect()
}

/// Findings of a capture with options in its first lines.
fn findings(path: &Path, node: &[String], bus_file: &str, frames: &str) -> CaptureFindings {
    let mut head: Vec<String> = node.iter().map(|node| format!("#! --node {node}")).collect();
    head.extend(bus_file.lines().map(|line| format!("#| {line}")));
    let capture = parse(&path.display().to_string(), &format!("{}\n{frames}", head.join("\n")));
    judge(&capture.frames, &capture.options, capture.setup).1
}

fn story_count(findings: &CaptureFindings) -> Vec<Story> {
    Diagnosis::diagnose_findings(findings, findings.reported_groups(), DiagnosisContext::default()).stories
}

/// The first lines of the first story.
fn beginning(stories: &[Story], lines: usize) -> String {
    let lines = stories.iter().take(1).flat_map(|story| story.lines.iter().take(lines));
    lines.map(|line| format!("{:14} {}", line.label.label_word(), line.text)).collect::<Vec<_>>().join("\n")
}

/// Whether a frame number is in `a-b,c`.
fn contains(ranges: &str, number: usize) -> bool {
    ranges.split(',').any(|range| {
        let (first, last) = range.split_once('-').unwrap_or((range, range));
        (first.parse().unwrap()..=last.parse().unwrap()).contains(&number)
    })
}

#[test]
fn the_cause_is_in_the_first_three_lines() {
    let mut wrong = Vec::new();
    let all = expectations();
    assert!(all.len() >= 10 && all.iter().filter(|(_, it)| !it.emcy).count() >= 5);
    for (path, expected) in all {
        let frames = fs::read_to_string(path.with_extension("log")).unwrap();
        let found = beginning(&story_count(&findings(&path, &expected.node, &expected.bus_file, &frames)), 3);
        let missing: Vec<_> = expected.words.iter().filter(|word| !found.contains(word.as_str())).collect();
        if !missing.is_empty() {
            wrong.push(format!("{}: {missing:?} not in\n{found}", path.display()));
        }
    }
    assert!(wrong.is_empty(), "{}", wrong.join("\n"));
}

#[test]
fn without_its_frames_the_cause_is_not_visible() {
    let mut wrong = Vec::new();
    for (path, expected) in expectations() {
        let frames = fs::read_to_string(path.with_extension("log")).unwrap();
        let numbered =
            (1..).zip(frames.lines()).filter(|(number, _)| !contains(&expected.cause_frames, *number));
        let cut: Vec<_> = numbered.map(|(_, line)| line).collect();
        let found = story_count(&findings(&path, &expected.node, &expected.bus_file, &cut.join("\n")));
        // Where only notes remain, nothing may be named.
        if found.is_empty() && expected.cut_leaves_notes {
            continue;
        }
        let label = found.first().and_then(|story| story.lines.first()).map(|line| line.label);
        if label != Some(LineLabel::NoCause) {
            wrong.push(format!("{}:\n{}", path.display(), beginning(&found, 3)));
        }
    }
    assert!(wrong.is_empty(), "{}", wrong.join("\n"));
}

#[test]
fn a_clean_capture_has_no_story() {
    let clean: Clean = toml::from_str(&fs::read_to_string(folder().join("clean.toml")).unwrap()).unwrap();
    let mut wrong = Vec::new();
    for name in clean.clean {
        let path = folder().join(&name).with_extension("toml");
        let text = fs::read_to_string(&path).unwrap();
        let table: toml::Table = toml::from_str(&text).unwrap();
        let node = table["node"].as_array().unwrap().iter().map(|node| node.as_str().unwrap().to_owned());
        let bus_file = table.get("bus_file").and_then(toml::Value::as_str).unwrap_or_default();
        let frames = fs::read_to_string(path.with_extension("log")).unwrap();
        let found = story_count(&findings(&path, &node.collect::<Vec<_>>(), bus_file, &frames));
        if !found.is_empty() {
            wrong.push(format!("{name}:\n{}", beginning(&found, 3)));
        }
    }
    assert!(wrong.is_empty(), "{}", wrong.join("\n"));
}

/// Maximum number of stories with an error that a real capture may have.
const ERRORS: usize = 8;

/// The stories of recordings of other projects are those of `corpus.txt`, which was read against the recordings.
#[test]
fn the_stories_of_recordings_are_the_reviewed_ones() {
    let reviewed = fs::read_to_string(folder().join("corpus.txt")).unwrap();
    let mut found = String::new();
    for line in reviewed.lines().filter(|line| line.starts_with('#')) {
        writeln!(found, "{line}").unwrap();
    }
    for name in reviewed.lines().filter_map(|line| line.strip_prefix("== ")) {
        let path = corpus().join(name);
        let Ok(capture) = fs::read(&path) else {
            return skip("corpus", &format!("{} is not there", path.display()));
        };
        let (_, findings) = judge_capture(&capture, &SessionOptions::default(), plain_setup());
        let stories = story_count(&findings);
        let errors = stories.iter().filter(|story| story.severity == Severity::Error).count();
        assert!(errors <= ERRORS, "{name}: {errors} stories with an error");
        writeln!(found, "== {name}").unwrap();
        for story in stories {
            let cause = if story.is_cause_visible { "" } else { "cause not visible: " };
            writeln!(found, "{:8} {cause}{}", story.severity.name(), story.title).unwrap();
            for rule in story.rules.iter().skip(1) {
                writeln!(found, "           then {rule}").unwrap();
            }
        }
    }
    if std::env::var_os("COBSCOPE_BLESS").is_some() {
        fs::write(folder().join("corpus.txt"), &found).unwrap();
    }
    assert_eq!(found, reviewed);
}

/// The same traffic on two buses: a cause that is a fact names its bus, as a finding does.
#[test]
fn a_fact_names_its_bus_if_there_are_two() {
    let path = folder().join("plc-commands-pre-operational.log");
    let text = fs::read_to_string(&path).unwrap();
    let one = story_count(&findings(&path, &[], "", &text));
    assert!(one[0].title.starts_with("63/3F  NMT"), "{}", one[0].title);
    let both: String = text.lines().flat_map(|line| [line.to_owned(), line.replace("can0", "can1")]).fold(
        String::new(),
        |mut all, line| {
            writeln!(all, "{line}").unwrap();
            all
        },
    );
    let two = story_count(&findings(&path, &[], "", &both));
    let titles: Vec<_> = two.iter().map(|story| story.title.as_str()).collect();
    for bus in ["can0 63/3F  NMT", "can1 63/3F  NMT"] {
        assert!(titles.iter().any(|title| title.starts_with(bus)), "{titles:?}");
    }
    assert!(two[0].lines[0].text.starts_with("can"), "{}", two[0].lines[0].text);
}

/// While the capture grows, an open condition is not at its end.
#[test]
fn an_open_condition_of_a_growing_capture_is_still_present() {
    let path = workspace().join("fixtures/devices/pve.log");
    let text = fs::read_to_string(&path).unwrap();
    let part: Vec<_> = text.lines().take(110).collect();
    let findings = findings(&path, &["32=danfoss-pve-ci".to_owned()], "", &part.join("\n"));
    let zero = findings.groups[0].first[0].time;
    let first = |is_growing| {
        let setting = DiagnosisContext { zero, is_growing, ..DiagnosisContext::default() };
        let diagnosis = Diagnosis::diagnose_findings(&findings, findings.reported_groups(), setting);
        diagnosis.stories[0].lines[0].text.clone()
    };
    assert!(first(false).contains("to the end of the capture"), "{}", first(false));
    assert!(first(true).contains("from 0.000 s, still present"), "{}", first(true));
}
