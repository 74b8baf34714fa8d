//! Baselines of `check` with more captures than are judged, and suppressed findings in every format.

use std::fs;
use std::path::Path;

use serde_json::Value;

use crate::cli::{Output, run_in};
use crate::support::workspace;

const LOST: &str = "fixtures/rules/node-lost.log";
const BASELINE: [&str; 2] = ["--baseline", "known.json"];

fn check(folder: &Path, words: &[&str]) -> Output {
    run_in(folder, &[&["check"], words].concat(), "")
}

fn updated(folder: &Path, captures: &[&str]) -> Output {
    check(folder, &[&BASELINE[..], &["--update-baseline"], captures].concat())
}

/// A folder with two captures below `captures` and a baseline of both.
fn known() -> tempfile::TempDir {
    let folder = tempfile::tempdir().unwrap();
    fs::create_dir(folder.path().join("captures")).unwrap();
    for name in ["captures/a.log", "captures/b.log"] {
        fs::copy(workspace().join(LOST), folder.path().join(name)).unwrap();
    }
    let written = updated(folder.path(), &["captures"]);
    assert_eq!((written.code, written.stderr.as_str()), (0, ""));
    folder
}

fn baseline(folder: &Path) -> String {
    fs::read_to_string(folder.join("known.json")).unwrap()
}

#[test]
fn a_capture_of_the_baseline_that_is_not_judged_fails_in_every_format() {
    let folder = known();
    let path = folder.path().join("captures/b.log");
    let stated = "in the baseline, but not checked in this run";
    let write =
        |text: Option<&str>| text.map_or_else(|| fs::remove_file(&path), |text| fs::write(&path, text));
    for content in [None, Some(""), Some("no capture")] {
        write(content).unwrap();
        let of = |format: &str| {
            let output = check(folder.path(), &[&BASELINE[..], &["-f", format, "captures"]].concat());
            assert_eq!(output.code, 1, "{format}: {}", output.stdout);
            output
        };
        let text = of("text");
        assert!(text.stdout.contains(&format!("absent   captures/b.log: {stated}\n")), "{}", text.stdout);
        assert!(text.stdout.ends_with("; 1 capture of the baseline absent\n"), "{}", text.stdout);
        let skipped = match content {
            None => "",
            Some("") => "cobscope: captures/b.log: empty; skipped\n",
            Some(_) => "cobscope: captures/b.log: not a capture in a known format",
        };
        assert!(text.stderr.starts_with(skipped) && text.stderr.is_empty() == skipped.is_empty());
        let github = of("github").stdout;
        assert!(
            github.contains(&format!("::error file=captures/b.log,title=absent::{stated}\n")),
            "{github}"
        );
        let junit = of("junit").stdout;
        assert!(junit.contains("<testsuite name=\"baseline\" tests=\"1\""), "{junit}");
        assert!(junit.contains(&format!("<failure message=\"{stated}\" type=\"absent\"")), "{junit}");
        let sarif: Value = serde_json::from_str(&of("sarif").stdout).unwrap();
        let notes = &sarif["runs"][0]["invocations"][0]["toolExecutionNotifications"];
        let note = notes.as_array().unwrap().last().unwrap();
        assert_eq!(
            (&note["level"], &note["message"]["text"]),
            (&"error".into(), &format!("captures/b.log: {stated}").into())
        );
        let lines = of("jsonl").stdout;
        let total: Value = serde_json::from_str(lines.lines().last().unwrap()).unwrap();
        assert_eq!((&total["absent"][0], &total["fails"]), (&"captures/b.log".into(), &true.into()));
    }
}

#[test]
fn an_update_keeps_what_it_did_not_judge_and_says_what_is_gone() {
    let folder = known();
    let both = baseline(folder.path());
    // A single capture is compared with the baseline of all captures.
    let alone = check(folder.path(), &[&BASELINE[..], &["captures/a.log"]].concat());
    assert_eq!(alone.code, 0, "{}", alone.stdout);
    let kept = updated(folder.path(), &["captures/a.log"]);
    let stated = "cobscope: known.json: kept the entries of 1 capture not checked in this run\n";
    assert_eq!((kept.code, kept.stderr.as_str()), (0, stated));
    assert_eq!(baseline(folder.path()), both);
    fs::remove_file(folder.path().join("captures/b.log")).unwrap();
    let dropped = updated(folder.path(), &["captures"]);
    let stated = "cobscope: known.json: dropped the entries of captures/b.log; the file does not exist\n";
    assert_eq!((dropped.code, dropped.stderr.as_str()), (0, stated));
    assert!(!baseline(folder.path()).contains("b.log"));
}

#[test]
fn a_baseline_is_left_as_it_is_where_a_capture_cannot_be_read() {
    let folder = known();
    let before = baseline(folder.path());
    for unread in ["no.log", "known.json"] {
        let output = updated(folder.path(), &["captures/a.log", unread]);
        assert_ne!(output.code, 0);
        assert_eq!(baseline(folder.path()), before);
    }
    let output = updated(folder.path(), &["captures/a.log", "no.log"]);
    assert_eq!(output.code, 3);
    assert!(output.stderr.contains("known.json: not updated; a capture is unreadable"), "{}", output.stderr);
}

#[test]
fn only_a_baseline_is_replaced_by_one() {
    let folder = known();
    let expected = "not overwritten; expected a baseline written by --update-baseline, or no file";
    for other in ["my notes", "{\"version\": 1}", "\u{ff}"] {
        fs::write(folder.path().join("known.json"), other).unwrap();
        let output = updated(folder.path(), &["captures"]);
        assert_eq!(output.code, 2, "{}", output.stderr);
        assert!(
            output.stderr.starts_with(&format!("cobscope: known.json: {expected}: ")),
            "{}",
            output.stderr
        );
        assert_eq!(baseline(folder.path()), other);
    }
    fs::write(folder.path().join("known.json"), [0xFF, 0xFE]).unwrap();
    assert!(updated(folder.path(), &["captures"]).stderr.contains(expected));
}

#[test]
fn suppressions_and_missing_findings_are_reported_in_formats_for_programs() {
    let folder = known();
    let bus = "[[suppress]]\nrule = 'node-lost'\nreason = 'known gateway'\n\
               [[suppress]]\nrule = 'sdo-no-response'\nreason = 'old master'\n\
               [[suppress]]\nrule = 'emcy-raised'\nuntil = 2026-01-31\nreason = 'until repaired'\n";
    fs::write(folder.path().join("bus.toml"), bus).unwrap();
    let text = baseline(folder.path()).replace("node-lost|can0|5", "node-lost|can0|9");
    fs::write(folder.path().join("known.json"), text).unwrap();
    let words = ["--bus", "bus.toml", "--today", "2026-02-01", "captures/a.log", "captures/b.log", "-f"];
    let of = |format: &str| check(folder.path(), &[&BASELINE[..], &words, &[format]].concat()).stdout;
    let met = "suppressed 4 findings by node-lost: known gateway";
    let vain = "suppression of sdo-no-response matched no finding: old master";
    let ended = "suppression of emcy-raised expired on 2026-01-31: until repaired";
    let gone = "error node-lost|can0|9: no heartbeat after {10}";

    let github = of("github");
    for stated in [met, vain, ended] {
        assert!(github.contains(&format!("::notice title=suppression::{stated}\n")), "{github}");
    }
    assert!(github.contains(&format!("::notice file=captures/a.log,title=gone::{gone}")), "{github}");

    let junit = of("junit");
    for stated in [met, vain, ended] {
        assert!(junit.contains(&format!("<system-out>{stated}</system-out>")), "{junit}");
    }
    assert!(junit.contains("suppressed: can0 5/05  no heartbeat after {10}"), "{junit}");
    assert!(junit.contains("<skipped message=\"suppressed: "), "{junit}");
    assert!(junit.contains(": known gateway\"/>") && junit.contains(&format!("gone: {gone}")), "{junit}");

    let sarif: Value = serde_json::from_str(&of("sarif")).unwrap();
    let notes = sarif["runs"][0]["invocations"][0]["toolExecutionNotifications"].to_string();
    for stated in [vain, ended, &format!("gone: {gone}")] {
        assert!(notes.contains(stated), "{stated}: {notes}");
    }

    let lines = of("jsonl");
    let total: Value = serde_json::from_str(lines.lines().last().unwrap()).unwrap();
    let met: Vec<_> =
        total["suppressions"].as_array().unwrap().iter().map(|one| one["met"].clone()).collect();
    assert_eq!(met, [4, 0, 0]);
    assert_eq!(total["suppressions"][2]["ended"], "2026-01-31");
}

#[test]
fn only_rules_that_ran_and_findings_that_can_be_selected_are_compared() {
    let folder = known();
    let with = |options: &[&str]| check(folder.path(), &[&BASELINE[..], options, &["captures"]].concat());
    let selections: [&[&str]; 7] = [
        &["--ignore", "node-lost"],
        &["--ignore", "node-*,emcy-*"],
        &["--select", "node-lost"],
        &["--only-node", "5"],
        &["--from", "0.1"],
        &["--to", "0.1"],
        &["--filter", "severity == warning"],
    ];
    for options in selections {
        let output = with(options);
        assert_eq!(output.code, 0, "{options:?}: {}", output.stdout);
        let has = |word: &str| output.stdout.lines().any(|line| line.starts_with(word));
        assert!(!has("silent ") && !has("gone "), "{options:?}: {}", output.stdout);
    }
    // A rule that ran is compared: emcy-raised has no EMCY to check in this capture.
    let verdict = "  \"verdicts\": [\n    {\"capture\":\"captures/a.log\",\"rule\":\"emcy-raised\",\"verdict\":\"pass\"},";
    let text = baseline(folder.path()).replace("  \"verdicts\": [", verdict);
    fs::write(folder.path().join("known.json"), text.replace("node-lost|can0|5", "node-lost|can0|9"))
        .unwrap();
    let gone = "gone     error node-lost|can0|9: ";
    for (options, is_silent, is_gone) in [
        (&["--ignore", "sdo-*"][..], true, true),
        (&["--ignore", "emcy-raised"], false, true),
        (&["--select", "emcy-raised"], true, false),
        (&["--only-node", "9"], true, true),
        (&["--only-node", "can0:9"], true, true),
        (&["--only-node", "5"], true, false),
        (&["--to", "0.1"], true, false),
    ] {
        let stdout = with(options).stdout;
        assert_eq!(stdout.contains("silent   emcy-raised"), is_silent, "{options:?}: {stdout}");
        assert_eq!(stdout.contains(gone), is_gone, "{options:?}: {stdout}");
    }
}

#[test]
fn an_update_with_a_selection_is_refused() {
    let folder = known();
    let before = baseline(folder.path());
    for (option, value) in [
        ("--select", "node-lost"),
        ("--ignore", "node-lost"),
        ("--filter", "severity == error"),
        ("--from", "1"),
        ("--to", "1"),
        ("--only-node", "5"),
    ] {
        let output = updated(folder.path(), &[option, value, "captures"]);
        let reason =
            format!("cobscope: --update-baseline: a baseline covers all findings; without {option}\n");
        assert_eq!((output.code, output.stderr), (2, reason));
        assert_eq!(baseline(folder.path()), before);
    }
    let both = updated(folder.path(), &["--to", "1", "--ignore", "node-lost", "captures"]);
    assert!(both.stderr.ends_with("without --ignore, --to\n"), "{}", both.stderr);
}
