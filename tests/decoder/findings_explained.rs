//! Findings in the scenes of `fixtures/devices/` and in captures of other projects:
//! `fixtures/rules/explained.txt` has one line with a reason for each, and there are no others.
//!
//! ```text
//! # a remark
//! devices/ifb.log  state-lost  5  the scene withdraws the enable input
//! ```

use std::collections::BTreeMap;
use std::fmt::Write as _;
use std::fs;
use std::path::{Path, PathBuf};

use cobscope_decoder::profile::Catalogue;
use cobscope_decoder::rules::RuleSetup;
use cobscope_decoder::session::SessionOptions;

use crate::devices;
use crate::rules::judge;
use crate::scene::{self, Expected};
use crate::support::{corpus, skip, workspace};

/// Judged captures of other projects, in plain candump text.
const RECORDINGS: [&str; 4] = [
    "canopen/canopen-lens__sample_amr_2wheel.log",
    "canopen/canopen-lens__sample_cia402.log",
    "canopen/canopen-message-interpreter__pcan1.trc",
    "j1939/remora_ctrl_proto__candump-2021-07-21_220402-15-seconds-engine-on-big-truck.log",
];

/// Rule and node of the effective findings in a capture.
fn found(path: &Path, options: &SessionOptions) -> Vec<(String, String)> {
    let bytes = fs::read(path).unwrap();
    let text = String::from_utf8_lossy(&bytes);
    let (_, findings) = judge(&text, options, RuleSetup::default());
    let mut all: Vec<_> = findings
        .reported_groups()
        .map(|group| {
            let node = group.key.node.map_or_else(|| "-".to_owned(), |node| node.to_string());
            (group.rule.to_string(), node)
        })
        .collect();
    all.sort();
    all.dedup();
    all
}

/// Lines of the file by capture.
fn explained() -> BTreeMap<String, Vec<(String, String)>> {
    let text = fs::read_to_string(workspace().join("fixtures/rules/explained.txt")).unwrap();
    let mut all = BTreeMap::<_, Vec<_>>::new();
    for line in text.lines().filter(|line| !line.starts_with('#') && !line.is_empty()) {
        let mut words = line.split_whitespace();
        let (capture, rule, node) = (words.next().unwrap(), words.next().unwrap(), words.next().unwrap());
        assert!(words.count() > 2, "no reason: {line}");
        all.entry(capture.to_owned()).or_default().push((rule.to_owned(), node.to_owned()));
    }
    all
}

fn compare(capture: &str, found: &[(String, String)], report: &mut String) {
    let mut wanted = explained().remove(capture).unwrap_or_default();
    wanted.sort();
    for (rule, node) in found.iter().filter(|line| !wanted.contains(line)) {
        writeln!(report, "not explained: {capture}  {rule}  {node}").unwrap();
    }
    for (rule, node) in wanted.iter().filter(|line| !found.contains(line)) {
        writeln!(report, "not found: {capture}  {rule}  {node}").unwrap();
    }
}

#[test]
fn findings_in_the_scenes_of_devices_are_explained() {
    let catalogue = Catalogue::default();
    let mut report = String::new();
    for name in scene::captures("devices") {
        let path = name.with_extension("expected.txt");
        if !path.exists() {
            continue;
        }
        let options = devices::options(&name, &Expected::read(&path), &catalogue);
        let capture = format!("devices/{}.log", name.file_name().unwrap().to_string_lossy());
        compare(&capture, &found(&name.with_extension("log"), &options), &mut report);
    }
    assert!(report.is_empty(), "\n{report}");
}

#[test]
fn findings_in_recordings_of_others_are_explained() {
    let folder = corpus();
    if !folder.is_dir() {
        return skip("corpus", "no recordings");
    }
    let mut report = String::new();
    for capture in RECORDINGS {
        let path: PathBuf = folder.join(capture);
        compare(capture, &found(&path, &SessionOptions::default()), &mut report);
    }
    assert!(report.is_empty(), "\n{report}");
}
