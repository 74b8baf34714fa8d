//! `--filter`, `--from`, `--to` and `--only-node` in all commands, and wall-clock times.

use std::fs;
use std::path::{Path, PathBuf};
use std::process::Command;

use crate::check::folder;
use crate::cli::{Output, run, run_in};

/// Two nodes start at 22:13:20 UTC (1,700,000,000 s). Node 5 has EMCY 8110 from 22:13:25 to 22:13:26, node 6 EMCY
/// 8130 from 22:13:28 to 22:13:29 (CiA 301 §7.2.7.3.1: 0000 is the end of the error).
const RUN: &str = "\
(1700000000.000000) can0 705#00
(1700000000.000100) can0 706#00
(1700000001.000000) can0 000#0100
(1700000002.000000) can0 705#05
(1700000002.000000) can0 706#05
(1700000005.000000) can0 085#1081110000000000
(1700000006.000000) can0 085#0000000000000000
(1700000008.000000) can0 086#3081110000000000
(1700000009.000000) can0 086#0000000000000000
(1700000010.000000) can0 705#05
";

fn place(name: &str) -> PathBuf {
    let path = folder(&format!("select-{name}"));
    fs::write(path.join("run.log"), RUN).unwrap();
    path
}

fn on_run(path: &Path, arguments: &[&str]) -> Output {
    run_in(path, &[arguments, &["run.log"]].concat(), "")
}

/// Output in a time zone with daylight saving time, as in Berlin.
fn in_berlin(path: &Path, arguments: &[&str]) -> (String, String) {
    let output = Command::new(env!("CARGO_BIN_EXE_cobscope"))
        .args(arguments)
        .current_dir(path)
        .env("TZ", "CET-1CEST,M3.5.0,M10.5.0/3")
        .output()
        .unwrap();
    let text = |bytes| String::from_utf8(bytes).unwrap();
    (text(output.stdout), text(output.stderr))
}

/// The frames that `convert` selects.
fn converted(path: &Path, arguments: &[&str]) -> Vec<usize> {
    let output = run_in(path, &[&["convert", "-f", "candump"], arguments, &["run.log", "-"]].concat(), "");
    assert_eq!(output.code, 0, "{}", output.stderr);
    output.stdout.lines().map(|line| RUN.lines().position(|own| own == line).unwrap() + 1).collect()
}

#[test]
fn a_time_of_day_selects_alike_in_every_command() {
    let path = place("time");
    let of = |command: &str, window: &[&str]| on_run(&path, &[&[command], window].concat()).stdout;
    let window = ["--from", "22:13:27", "--to", "22:13:29"];
    assert_eq!(converted(&path, &window), [8, 9]);
    let events = of("decode", &window);
    assert!(events.contains("8130") && !events.contains("8110"), "{events}");
    let statistics = of("stats", &window);
    assert!(statistics.contains("2 frames in 1.000 s"), "{statistics}");
    assert!(statistics.contains("EMCY 8130") && !statistics.contains("EMCY 8110"), "{statistics}");
    let why = of("why", &window);
    assert!(why.contains("\nFIRST EFFECT   6/06  EMCY 8130 ") && why.contains("from 8.000 s"), "{why}");
    assert!(why.contains("BOOT"), "what precedes the range is known: {why}");
    let findings = of("check", &window);
    assert!(findings.contains("EMCY 8130") && !findings.contains("EMCY 8110"), "{findings}");
    // The same moments in other forms.
    for from in ["7", "#8", "2023-11-14 22:13:27", "2023-11-14T22:13:27Z", "23:13:27+01:00", "22:13:27Z"] {
        assert_eq!(converted(&path, &["--from", from, "--to", "9"]), [8, 9], "{from}");
    }
    assert_eq!(converted(&path, &["--from", "2023-11-14", "--to", "2023-11-14"]).len(), 10, "a whole day");
    assert_eq!(converted(&path, &["--from", "2023-11-15"]).len(), 0);
}

#[test]
fn a_node_selects_alike_in_every_command() {
    let path = place("node");
    let of = |command: &str| on_run(&path, &[command, "--only-node", "6"]).stdout;
    // From and to node 6: boot-up, the command to all, heartbeat, two EMCYs.
    assert_eq!(converted(&path, &["--only-node", "6"]), [2, 3, 5, 8, 9]);
    let events = of("decode");
    assert!(events.contains("NMT    start: all nodes") && !events.contains("5/05"), "{events}");
    assert!(of("stats").contains("5 frames in 8.999 s"), "{}", of("stats"));
    assert!(of("why").contains("\nFIRST EFFECT   6/06  EMCY 8130 "), "{}", of("why"));
    let findings = of("check");
    assert!(findings.contains("can0 6/06") && !findings.contains("can0 5/05"), "{findings}");
    for command in ["decode", "stats", "why", "check"] {
        let output = on_run(&path, &[command, "--only-node", "6=rexroth-sydfec"]);
        assert_eq!(output.code, 2, "{command}");
        assert!(output.stderr.contains("use --node to assign its profile"), "{}", output.stderr);
        let output = on_run(&path, &[command, "--from", "9", "--to", "8"]);
        assert!(output.code == 2 && output.stderr.contains("the range is empty"), "{command}");
    }
}

#[test]
fn a_filter_counts_frames_and_selects_faults_and_findings() {
    let path = place("filter");
    let statistics = on_run(&path, &["stats", "--filter", "kind == emcy"]).stdout;
    assert!(statistics.contains("4 frames in 4.000 s"), "{statistics}");
    let why = on_run(&path, &["why", "--filter", "node == 6"]).stdout;
    assert!(why.contains("\nFIRST EFFECT   6/06  EMCY 8130 "), "{why}");
    let output = on_run(&path, &["check", "--filter", "severity == warning && node == 5"]);
    assert!(output.stdout.contains("EMCY 8110") && !output.stdout.contains("EMCY 8130"), "{}", output.stdout);
    assert!(output.stderr.contains("run.log: 1 finding of 2 not selected"), "{}", output.stderr);
    let output = on_run(&path, &["check", "--filter", "kind == emcy"]);
    assert_eq!(output.code, 2);
    assert!(output.stderr.contains("never true for a finding"), "{}", output.stderr);
    let output = on_run(&path, &["check", "--filter", "rule == no-such-rule"]);
    assert_eq!(output.code, 2, "{}", output.stderr);
}

#[test]
fn a_finding_is_printed_if_any_part_is_in_the_range() {
    let path = place("part");
    let is_printed = |window: &[&str]| {
        let output = on_run(&path, &[&["check", "--only-node", "5"], window].concat());
        output.stdout.contains("EMCY 8110")
    };
    // From 5 to 6 s.
    assert!(is_printed(&["--from", "5.5"]), "it began before");
    assert!(is_printed(&["--to", "5.5"]), "it ends after");
    assert!(is_printed(&["--from", "5.2", "--to", "5.8"]), "it lasts over the range");
    assert!(!is_printed(&["--from", "6.1"]) && !is_printed(&["--to", "4.9"]));
    // The exit status follows the findings that are printed.
    assert_eq!(on_run(&path, &["check", "--fail-on", "warning"]).code, 1);
    assert_eq!(on_run(&path, &["check", "--fail-on", "warning", "--to", "4"]).code, 0);
    on_run(&path, &["check", "--baseline", "b.json", "--update-baseline"]);
    let known = fs::read_to_string(path.join("b.json")).unwrap();
    assert_eq!(known.matches("emcy-raised|can0|").count(), 2, "{known}");
    let output = on_run(&path, &["check", "--from", "11"]);
    assert!(output.stderr.contains("--from is after the last frame, #10 at 10.000 s"), "{}", output.stderr);
}

#[test]
fn a_check_of_a_node_without_a_frame_is_no_verdict() {
    let path = place("absent");
    let absent = "cobscope: run.log: node 41/29 sent no frame; nodes present: 5/05, 6/06\n";
    for format in ["text", "jsonl", "junit", "sarif", "github"] {
        let output = on_run(&path, &["check", "-f", format, "--only-node", "41"]);
        assert_eq!(output.code, 3, "{format}: {}", output.stdout);
        assert!(output.stderr.contains(absent), "{format}: {}", output.stderr);
    }
    // One note, also if another option names the node.
    let named = on_run(&path, &["check", "--only-node", "41", "--node", "41=rexroth-sydfec"]);
    assert_eq!((named.code, named.stderr.matches(absent).count()), (3, 1), "{}", named.stderr);
    for (node, note) in [
        ("can9:5", "run.log: unknown bus can9 in --only-node; buses present: can0\n"),
        ("can0:41", absent),
        ("sa:0x80", "sent no frame; nodes present: 5/05, 6/06\n"),
    ] {
        let output = on_run(&path, &["check", "--only-node", "5", "--only-node", node]);
        assert!(output.code == 3 && output.stderr.contains(note), "{node}: {}", output.stderr);
    }
    for node in ["5", "can0:6"] {
        let output = on_run(&path, &["check", "--fail-on", "never", "--only-node", node]);
        assert!(output.code == 0 && !output.stderr.contains("sent no frame"), "{node}: {}", output.stderr);
    }
}

#[test]
fn an_ambiguous_time_of_day_is_an_error_with_the_candidates() {
    let path = place("ambiguous");
    // 22:14 occurs on 14 and on 15 November; the capture ends on 16 November at 02:00.
    let days = "(1700000000.000000) can0 705#05\n(1700100000.000000) can0 705#05\n";
    fs::write(path.join("days.log"), days).unwrap();
    for command in ["decode", "stats", "why", "check"] {
        let output = run_in(&path, &[command, "--from", "22:14", "days.log"], "");
        let reason =
            "22:14:00 occurs 2 times in the capture; give one of 2023-11-14T22:14:00Z, 2023-11-15T22:14:00Z";
        assert!(output.stderr.contains(reason), "{command}: {}", output.stderr);
        assert_eq!(output.code, 3, "{command}");
    }
    let output = run_in(&path, &["convert", "-f", "candump", "--to", "22:14", "days.log", "-"], "");
    assert!(output.stderr.contains("--to: 22:14:00 occurs 2 times"), "{}", output.stderr);
    // 25 October 2026, 00:20 to 03:46 UTC: 02:30 in Berlin occurs at 00:30 and 01:30 UTC.
    let change = "(1792887600.000000) can0 705#05\n(1792900000.000000) can0 705#05\n";
    fs::write(path.join("change.log"), change).unwrap();
    let (_, stderr) = in_berlin(&path, &["decode", "--from", "02:30 local", "change.log"]);
    assert!(stderr.contains("2026-10-25T02:30:00+02:00, 2026-10-25T02:30:00+01:00"), "{stderr}");
    let (stdout, stderr) = in_berlin(&path, &["decode", "--all", "--from", "04:00 local", "change.log"]);
    assert_eq!((stdout.lines().count(), stderr.as_str()), (1, ""), "{stdout}");
    let (stdout, _) = in_berlin(&path, &["decode", "--from", "23:13:27 local", "run.log"]);
    assert!(stdout.contains("8130") && !stdout.contains("8110"), "{stdout}");
}

#[test]
fn a_time_of_day_needs_dates_and_a_file() {
    let path = place("needs");
    fs::write(path.join("relative.log"), RUN.replace("17000000", "")).unwrap();
    for command in ["decode", "check", "stats", "why"] {
        let output = run_in(&path, &[command, "--from", "22:13:25", "relative.log"], "");
        let reason =
            "times count from the start of the capture, without a date; give seconds, such as --from 12.5";
        assert!(output.stderr.contains(reason), "{command}: {}", output.stderr);
    }
    let output = run(&["decode", "--from", "22:13:25", "-"], RUN);
    assert!(output.stderr.contains("a time of day needs a date"), "{}", output.stderr);
    let output = run(&["decode", "--from", "2023-11-14 22:13:27", "-"], RUN);
    assert!(output.stdout.contains("8130") && !output.stdout.contains("8110"), "{}", output.stdout);
    for wrong in ["25:00", "22:13:25 mars", "2023-13-01"] {
        assert_eq!(run(&["decode", "--from", wrong, "-"], RUN).code, 2, "{wrong}");
    }
}
