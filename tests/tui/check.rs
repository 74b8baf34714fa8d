//! `cobscope check` and its options. `fixtures/rules/` has the expected findings.

use std::fs;
use std::path::PathBuf;

use serde_json::{Value, json};

use crate::cli::{Output, run};
use crate::docs::is_blessing;
use crate::support::{step, workspace};

const LOST: &str = "fixtures/rules/node-lost.log";
const EMCY: &str = "fixtures/rules/emcy-raised.log";
const CLEAN: &str = "fixtures/rules/clean/canopen.log";

/// Captures of the recipe in `docs/ci.md`.
pub const RECIPE: [&str; 3] = ["fixtures/canopen", "fixtures/j1939", "fixtures/uds"];

pub fn check(arguments: &[&str]) -> Output {
    run(&[&["check"], arguments].concat(), "")
}

/// A fresh folder of this test.
pub fn folder(name: &str) -> PathBuf {
    let path = PathBuf::from(env!("CARGO_TARGET_TMPDIR")).join("check").join(name);
    let _ = fs::remove_dir_all(&path);
    fs::create_dir_all(&path).unwrap();
    path
}

pub fn text(path: &std::path::Path) -> &str {
    path.to_str().unwrap()
}

/// Lines of `-f jsonl`.
fn lines(arguments: &[&str]) -> Vec<Value> {
    let output = check(&[&["-f", "jsonl"], arguments].concat());
    output.stdout.lines().map(|line| serde_json::from_str(line).unwrap()).collect()
}

#[test]
fn the_page() {
    // The marks of the fixture: late at frame 9, silent from 10 on. The table counts enabled rules, so the
    // number of rules that are not exercised changes with new rules.
    let output = check(&[LOST]);
    let lines: Vec<&str> = output.stdout.lines().collect();
    assert_eq!(lines[0], "== fixtures/rules/node-lost.log (14 frames, 2.000 s)");
    assert_eq!(
        lines[1],
        "error    can0 5/05  no heartbeat after {10} (last state pre-operational) for 1.1 s; \
         check supply and cable of the node if all its messages are missing, otherwise its heartbeat time (1017) and load [node-lost]"
    );
    assert_eq!(lines[2], "         at 0.970 s {10}");
    assert_eq!(
        lines[3],
        "warning  can0 5/05  heartbeat interval 170 ms > 150 ms (1.5 × 1017:00); \
         check supply and cable of the node if all its messages are missing, otherwise its heartbeat time (1017) and load [node-lost]"
    );
    let readme = fs::read_to_string(workspace().join("README.md")).unwrap();
    assert!(readme.contains(&lines[..5].join("\n")));
    // Nothing on the bus shows why the node is silent. The late heartbeat is of the same rule, at the same object.
    assert!(
        lines[6].starts_with("UNKNOWN        cause not visible in this capture; record next: "),
        "{}",
        lines[6]
    );
    assert!(lines[7].starts_with("FIRST EFFECT   5/05  "), "{}", lines[7]);
    let table = lines.iter().position(|line| line.starts_with("CAPTURE ")).unwrap();
    assert_eq!(
        lines[table],
        "CAPTURE                       ERRORS  WARNINGS  NOTES  PASSED  NOT EXERCISED  VERDICT"
    );
    let row = lines[table + 1];
    assert!(row.starts_with("fixtures/rules/node-lost.log       1         1      0"), "{row}");
    assert!(row.ends_with("FAILED"), "{row}");
    assert_eq!(lines[table + 2], "1 capture: 1 failed, 0 unreadable; 1 error, 1 warning, 0 notes");
    assert_eq!((output.code, output.stderr.as_str()), (1, ""));
}

#[test]
fn the_footer_names_the_option_that_prints_a_story() {
    // The capture has 5 stories; `check` prints 3.
    let output = check(&["fixtures/canopen/sdo_abort.log"]);
    let footer = "and 2 stories more; cobscope why --story N prints one\n";
    assert!(output.stdout.contains(footer), "{}", output.stdout);
}

#[test]
fn a_node_that_sends_without_its_heartbeat_is_not_silent() {
    // Heartbeats of 1 s: {216} at 13.2 s, {267} at 16.2 s; TPDO2 {253} between.
    let output = check(&["--node", "1=wandfluh-md2", "fixtures/devices/md2.log"]);
    assert!(output.stdout.contains(
        "no heartbeat after {216} (last frame {253}, last state operational, last EMCY 8100, PDOs continue) for 3.0 s"
    ));
}

#[cfg(feature = "gzip")]
#[test]
fn the_reason_of_a_cut_capture_is_printed_once() {
    // A gzip member (RFC 1952) with one stored block (RFC 1951 §3.2.4) of 64 bytes, truncated after a line of
    // 40.
    let mut bytes = vec![0x1F, 0x8B, 8, 0, 0, 0, 0, 0, 0, 3, 0, 64, 0, !64, 0xFF];
    bytes.extend(b"(1700000000.000000) can0 123#1122334455\n");
    let path = folder("cut").join("cut.log.gz");
    fs::write(&path, bytes).unwrap();
    let output = check(&[text(&path)]);
    let reason = output.stderr.trim_end().split("the file is cut off: ").nth(1).unwrap();
    assert_eq!(reason, "incomplete gzip member at byte 55");
    assert!(output.stdout.contains(&format!("the file is cut off: {reason}\n")), "{}", output.stdout);
}

/// `fixtures/incidents/`: the expected output of each capture is next to it, written by hand.
#[test]
fn one_trouble_is_one_incident() {
    for name in ["error-frames", "lost-frames"] {
        let expected =
            fs::read_to_string(workspace().join(format!("fixtures/incidents/{name}.expected.txt")));
        let expected: Vec<_> =
            expected.unwrap().lines().filter(|line| !line.starts_with('#')).map(ToOwned::to_owned).collect();
        let output = check(&[&format!("fixtures/incidents/{name}.log")]);
        let reported: Vec<_> = output.stdout.lines().skip(1).take_while(|line| !line.is_empty()).collect();
        assert_eq!(reported, expected, "{name}");
        assert_eq!(output.code, i32::from(name == "error-frames"), "{name}");
    }
}

#[test]
fn a_capture_there_is_nothing_to_say_of_is_a_row() {
    let output = check(&[CLEAN]);
    assert_eq!((output.code, output.stdout.lines().count()), (0, 3), "{}", output.stdout);
    assert!(output.stdout.starts_with("CAPTURE"), "{}", output.stdout);
}

/// The reader of TRC notes first that it assumes UTC; only node 7 starts more than 10 s after the first frame.
#[test]
fn a_note_of_the_reader_is_not_the_start_of_the_capture() {
    let capture = folder("start").join("start.trc");
    let head = ";$FILEVERSION=1.1\n;$STARTTIME=44964.5\n";
    let frames = [(100.0, "0705"), (200.0, "0706"), (12_100.0, "0707")]
        .map(|(time, id)| format!("     1) {time:>11.1}  Rx         {id}  1  00 \n"));
    fs::write(&capture, format!("{head}{}", frames.concat())).unwrap();
    let output = check(&[text(&capture)]);
    let late: Vec<_> = output.stdout.lines().filter(|line| line.contains("[late-start]")).collect();
    assert_eq!(late.len(), 1, "{}", output.stdout);
    assert!(late[0].contains("7/07  late start: first frame 12 s after the start"), "{}", late[0]);
}

#[test]
fn colours_only_when_asked_for() {
    assert!(!check(&[LOST]).stdout.contains('\u{1b}'));
    assert!(check(&["--color", "always", LOST]).stdout.contains("\u{1b}[31merror   \u{1b}[0m can0 5/05"));
}

#[test]
fn exit_codes() {
    assert_eq!(check(&[CLEAN]).code, 0);
    assert_eq!(check(&[LOST]).code, 1);
    assert_eq!(check(&["--fail-on", "never", LOST]).code, 0);
    // The EMCYs are warnings.
    assert_eq!(check(&[EMCY]).code, 0);
    assert_eq!(check(&["--fail-on", "warning", EMCY]).code, 1);
    assert_eq!(check(&["-f", "xml", EMCY]).code, 2);
    assert_eq!(check(&["--today", "tomorrow", EMCY]).code, 2);
    assert_eq!(check(&["--update-baseline", EMCY]).code, 2);
    let several = check(&["no/such.log", LOST]);
    assert_eq!(several.code, 3);
    assert!(several.stderr.contains("no/such.log: cannot be opened"), "{}", several.stderr);
    assert!(several.stdout.contains("[node-lost]") && several.stdout.contains("UNREADABLE"));
    assert_eq!(check(&["--baseline", "no/such.json", LOST]).code, 4);
    assert_eq!(check(&["--bus", "no/such.toml", LOST]).code, 4);
}

#[test]
fn rules_a_bus_file_names_wrongly_are_shown_with_their_place() {
    let file = folder("wrong").join("bus.toml");
    let wrong = [
        (
            "[rules.node-losst]\nseverity = \"note\"\n",
            "bus.toml:1:8: unknown rule 'node-losst'; did you mean 'node-lost'?",
        ),
        (
            "[rules.node-lost]\nlimit = 3\n",
            "bus.toml:2:1: unknown key 'limit' of node-lost; expected severity, ",
        ),
        (
            "[rules.node-lost]\nseverity = \"bad\"\n",
            "bus.toml:2:12: unknown severity; expected \"error\", \"warning\", \"note\" or \"off\"",
        ),
        ("[[suppress]]\nrule = \"node-lots\"\nreason = \"x\"\n", "bus.toml:2:8: unknown rule 'node-lots'"),
        ("[[suppress]]\nrule = \"node-lost\"\n", "bus.toml:1:1: missing field `reason`"),
        (
            "[[suppress]]\nrule = \"node-lost\"\nreason = \"x\"\nuntil = \"May\"\n",
            "bus.toml:4:9: invalid date; expected the form 2026-01-31",
        ),
    ];
    for (bus, stated) in wrong {
        fs::write(&file, bus).unwrap();
        // All commands that judge report it.
        for command in ["check", "decode", "why", "report", "diff"] {
            let captures = if command == "diff" { &[LOST, LOST][..] } else { &[LOST] };
            let output = run(&[&[command, "--bus", text(&file)], captures].concat(), "");
            assert_eq!(output.code, 4, "{bus}");
            assert!(output.stderr.contains(stated), "{stated}\n{}", output.stderr);
        }
    }
}

#[test]
fn the_bus_file_says_how_strict() {
    let file = folder("strict").join("bus.toml");
    fs::write(&file, "[rules.node-lost]\nseverity = \"note\"\n").unwrap();
    let output = check(&["--bus", text(&file), LOST]);
    assert!(output.code == 0 && output.stdout.contains("note     can0 5/05"), "{}", output.stdout);
    fs::write(&file, "[rules.node-lost]\nseverity = \"off\"\n").unwrap();
    let lines = lines(&["--bus", text(&file), LOST]);
    assert!(lines.iter().all(|line| line["rule"] != "node-lost"));
    assert!(lines[0]["rules"].as_array().unwrap().iter().all(|rule| rule["rule"] != "node-lost"));
}

#[test]
fn suppressions_are_printed() {
    let file = folder("suppressed").join("bus.toml");
    let bus = "[[suppress]]\nrule = \"node-lost\"\nnode = 5\nuntil = 2026-06-30\nreason = \"known gateway\"\n\
               [[suppress]]\nrule = \"sdo-no-response\"\nreason = \"old master\"\n";
    fs::write(&file, bus).unwrap();
    let arguments = ["--bus", text(&file), LOST];
    let before = check(&[&["--today", "2026-06-30", "-v"], &arguments[..]].concat());
    assert_eq!(before.code, 0);
    let stated = "suppressed 2 findings by node-lost of node 5/05: known gateway\n";
    assert!(before.stdout.contains(stated), "{}", before.stdout);
    assert!(before.stdout.contains("at 0.970 s {10}; known gateway\n"));
    assert!(
        before.stdout.contains("note     suppression of sdo-no-response matched no finding: old master\n")
    );
    assert!(before.stdout.contains("0 notes, 2 suppressed\n"), "{}", before.stdout);
    let after = check(&[&["--today", "2026-07-01"], &arguments[..]].concat());
    assert_eq!(after.code, 1);
    let stated = "note     suppression of node-lost of node 5/05 expired on 2026-06-30: known gateway\n";
    assert!(after.stdout.contains(stated), "{}", after.stdout);
    // An expectation that one of several captures exercises is exercised.
    let several = check(&["--bus", text(&file), LOST, "fixtures/rules/sdo-no-response.log"]);
    assert!(!several.stdout.contains("matched no finding"), "{}", several.stdout);
}

#[test]
fn output_is_the_same_for_any_number_of_threads() {
    let captures =
        [&RECIPE[..], &["fixtures/devices", "fixtures/malformed", "no/such.log", "fixtures/rules"]].concat();
    for format in ["text", "jsonl", "junit", "sarif", "github"].into_iter().step_by(step(3)) {
        let by = |threads: &str| check(&[&["-f", format, "--threads", threads], &captures[..]].concat());
        let (one, two, five) = (by("1"), by("2"), by("5"));
        assert!(one.stdout.lines().count() > 20, "{format}");
        assert!(one.stdout == two.stdout && one.stdout == five.stdout, "{format}");
        assert!(one.stderr == two.stderr && one.stderr == five.stderr, "{format}");
        assert_eq!((one.code, two.code, five.code), (3, 3, 3));
    }
}

#[test]
fn a_folder_selects_the_captures_below_it() {
    let folder = folder("below");
    fs::create_dir_all(folder.join("b/c")).unwrap();
    fs::create_dir_all(folder.join(".git")).unwrap();
    let boot = "(1700000000.000000) can0 705#00\n";
    for capture in ["z.log", "b/c/d", "b/a.txt", ".git/x.log"] {
        fs::write(folder.join(capture), boot).unwrap();
    }
    fs::write(folder.join("notes.md"), "no capture").unwrap();
    fs::write(folder.join("empty"), "").unwrap();
    let summaries = lines(&[text(&folder), CLEAN]);
    let names: Vec<_> = summaries.iter().filter_map(|line| line["capture"].as_str()).collect();
    let below = |name: &str| folder.join(name).to_str().unwrap().to_owned();
    assert_eq!(names, [below("b/a.txt").as_str(), &below("b/c/d"), &below("z.log"), CLEAN]);
    let empty = check(&[text(&folder.join(".git")), text(&folder.join("b"))]);
    assert_eq!(empty.code, 0);
    fs::remove_file(folder.join(".git/x.log")).unwrap();
    let empty = check(&[text(&folder.join(".git")), CLEAN]);
    assert_eq!(empty.code, 3);
    assert!(empty.stderr.contains(".git: no captures"), "{}", empty.stderr);
    // A file named in the command must be a capture.
    assert_eq!(check(&[text(&folder.join("notes.md"))]).code, 3);
}

#[test]
fn a_file_instead_of_standard_output() {
    let file = folder("output").join("report.xml");
    let output = check(&["-f", "junit", "-o", text(&file), LOST]);
    assert_eq!((output.code, output.stdout.as_str()), (1, ""));
    assert!(fs::read_to_string(&file).unwrap().starts_with("<?xml"));
    assert_eq!(check(&["-o", "no/such/report.xml", LOST]).code, 2);
}

/// The capture of node 5 with its missing heartbeats, followed by more frames.
fn capture(folder: &std::path::Path, more: &str) -> String {
    let path = folder.join("machine.log");
    fs::write(&path, fs::read_to_string(workspace().join(LOST)).unwrap() + more).unwrap();
    text(&path).to_owned()
}

#[test]
fn a_baseline_accepts_what_is_known() {
    let folder = folder("baseline");
    let file = folder.join("baseline.json");
    let baseline = ["--baseline", text(&file)];
    let known = capture(&folder, "");
    let with = |more: &[&str], capture: &str| check(&[&baseline[..], more, &[capture]].concat());
    let missing = with(&[], &known);
    assert!(
        missing.code == 4 && missing.stderr.contains("--update-baseline creates it"),
        "{}",
        missing.stderr
    );
    let written = with(&["--update-baseline"], &known);
    assert_eq!(written.code, 0, "{}{}", written.stdout, written.stderr);
    let kept = fs::read_to_string(&file).unwrap();
    let finding = format!(
        "    {{\"capture\":{},\"fingerprint\":\"node-lost|can0|5\",\"severity\":\"error\",\"count\":1,\
         \"text\":\"no heartbeat after {{10}} (last state pre-operational)\"}},\n",
        json!(known)
    );
    assert!(kept.contains(&finding), "{kept}");

    let same = with(&[], &known);
    assert_eq!(same.code, 0);
    assert!(same.stdout.contains("0 errors, 0 warnings, 0 notes, 2 accepted"), "{}", same.stdout);
    assert!(!same.stdout.contains("[node-lost]"), "{}", same.stdout);
    assert!(with(&["-v"], &known).stdout.contains("accepted   can0 5/05  no heartbeat after {10}"));

    // EMCY 8130 of a node that is operational is a new finding, and a warning.
    let more = "(1700000003.000000) can0 000#0105\n(1700000003.100000) can0 705#05\n\
                (1700000003.200000) can0 705#05\n(1700000003.250000) can0 085#3081110000000000\n";
    let worse = capture(&folder, more);
    let new = with(&["--fail-on", "warning"], &worse);
    assert!(new.code == 1 && new.stdout.contains("EMCY 8130"), "{}", new.stdout);
    assert!(!new.stdout.contains("no heartbeat after {10}"), "{}", new.stdout);
}

#[test]
fn worse_and_missing_findings_and_a_silent_rule_are_reported() {
    let folder = folder("worse");
    let file = folder.join("baseline.json");
    let known = capture(&folder, "");
    let baseline = |text: &Value| fs::write(&file, text.to_string()).unwrap();
    let finding = |fingerprint: &str, severity: &str| json!({"capture": known, "fingerprint": fingerprint, "severity": severity, "count": 1, "text": "silent"});
    let verdict = |rule: &str| json!({"capture": known, "rule": rule, "verdict": "pass"});
    let arguments = ["--baseline", text(&file), known.as_str()];

    baseline(&json!({"version": 1, "findings": [finding("node-lost|can0|5", "warning")], "verdicts": []}));
    let worse = check(&arguments);
    assert!(
        worse.code == 1 && worse.stdout.contains("error    can0 5/05  no heartbeat after {10}"),
        "{}",
        worse.stdout
    );

    let findings = [finding("node-lost|can0|5", "error"), finding("node-lost|can0|9", "error")];
    baseline(&json!({"version": 1, "findings": findings, "verdicts": [verdict("node-lost")]}));
    let gone = check(&arguments);
    assert_eq!(gone.code, 0, "{}", gone.stdout);
    assert!(gone.stdout.contains("gone     error node-lost|can0|9: silent\n"), "{}", gone.stdout);

    let other = json!({"capture": "other.log", "rule": "node-lost", "verdict": "pass"});
    baseline(&json!({"version": 1, "findings": [&findings[0]], "verdicts": [verdict("emcy-raised"), other]}));
    for arguments in [&arguments[..], &["--fail-on", "never", arguments[0], arguments[1], arguments[2]]] {
        let silent = check(arguments);
        assert_eq!(silent.code, 1, "{}", silent.stdout);
        let stated = "silent   emcy-raised is no longer exercised (exercised in the baseline)\n";
        assert!(silent.stdout.contains(stated), "{}", silent.stdout);
        // The other capture is not in the command.
        assert!(!silent.stdout.contains("absent"), "{}", silent.stdout);
    }

    fs::write(&file, "{\"version\": 1,\n\"findings\": 3}").unwrap();
    let broken = check(&arguments);
    assert!(broken.code == 4 && broken.stderr.contains("line 2 column"), "{}", broken.stderr);
}

#[test]
fn rules_that_have_to_be_exercised() {
    let met = check(&["--require-exercised", "node-lost,emcy-raised", "--fail-on", "never", LOST, EMCY]);
    assert_eq!(met.code, 0, "{}", met.stdout);
    let missing = check(&["--require-exercised", "node-lost,emcy-raised", "--fail-on", "never", LOST]);
    assert_eq!(missing.code, 1);
    let stated = "missing  emcy-raised required, but not exercised in any capture\n";
    assert!(missing.stdout.contains(stated), "{}", missing.stdout);
    let unknown = check(&["--require-exercised", "node-losst", LOST]);
    assert_eq!(unknown.code, 2);
    let stated = "--require-exercised: unknown rule 'node-losst'; did you mean 'node-lost'?";
    assert!(unknown.stderr.contains(stated), "{}", unknown.stderr);
}

#[test]
fn an_unknown_rule_in_an_option_is_a_wrong_argument_of_every_command() {
    for (command, option, value) in [
        ("check", "--select", "node-losst"),
        ("check", "--ignore", "emcy-raised,node-losst"),
        ("check", "--require-exercised", "node-losst"),
        ("report", "--finding", "node-losst"),
        ("check", "--filter", "rule == node-losst"),
        ("decode", "--filter", "rule == node-losst"),
        ("why", "--filter", "rule == node-losst"),
        ("report", "--filter", "rule == node-losst"),
        ("stats", "--filter", "rule == node-losst"),
        ("live", "--filter", "rule == node-losst"),
    ] {
        let input = if command == "live" { &["--print", "-"][..] } else { &[LOST] };
        let boot = "(1700000000.000000) can0 705#00\n";
        let output = run(&[&[command, option, value], input].concat(), boot);
        let stated = format!("cobscope: {option}: unknown rule 'node-losst'; did you mean 'node-lost'?\n");
        assert_eq!((output.code, output.stderr), (2, stated), "{command}");
    }
}

#[test]
fn coverage_by_rule_and_by_case_of_the_test_plan() {
    // Six heartbeats in time, one late, then none; one boot-up at the start; no EMCY.
    let output = check(&["--coverage", LOST]).stdout;
    let row = |name: &str| {
        let row = output.lines().find(|line| line.starts_with(&format!("{name} "))).unwrap();
        row.split_whitespace().skip(1).take(4).map(str::to_owned).collect::<Vec<_>>()
    };
    assert_eq!(row("node-lost"), ["6", "2", "0", "fail"]);
    assert_eq!(row("emcy-raised"), ["0", "0", "0", "not"]);
    assert!(output.contains("heartbeats counted against their time\n"), "{output}");
}

#[test]
fn findings_stand_among_events_where_they_come() {
    let output = run(&["decode", LOST], "").stdout;
    let lines: Vec<&str> = output.lines().collect();
    let found = lines.iter().position(|line| line.contains("no heartbeat after {10}")).unwrap();
    // The event and the finding are one line.
    assert!(lines[found].contains("5/05") && lines[found].ends_with("[node-lost] {10}"), "{}", lines[found]);
    assert!(
        lines[found].contains("LOST   silent for 0.200 s") && lines[found].contains("; error: "),
        "{output}"
    );
    assert!(!run(&["decode", "--no-findings", LOST], "").stdout.contains("[node-lost]"));
    let kinds = |arguments: &[&str]| {
        let output = run(&[&["decode", "-f", "jsonl"], arguments, &[LOST]].concat(), "").stdout;
        let all = output.lines().map(|line| serde_json::from_str::<Value>(line).unwrap());
        all.filter(|event| event["rule"] == "node-lost")
            .map(|event| event["kind"].clone())
            .collect::<Vec<_>>()
    };
    assert_eq!(kinds(&[]), ["finding-opened", "finding-opened", "finding-closed", "finding-closed"]);
    assert_eq!(kinds(&["--filter", "severity == error && kind == finding-opened"]), ["finding-opened"]);
    assert!(kinds(&["--no-findings"]).is_empty());
}

#[test]
fn the_rules_are_listed_and_explained() {
    let table = run(&["rules"], "").stdout;
    assert!(table.starts_with("RULE "), "{table}");
    let row = table.lines().find(|line| line.starts_with("node-lost ")).unwrap();
    let cells: Vec<&str> = row.split_whitespace().take(4).collect();
    assert_eq!(cells, ["node-lost", "error", "on", "timing"]);
    assert!(table.contains("\ndanfoss-pve-ci:avc-gap "), "{table}");
    let all: Value = serde_json::from_str(&run(&["rules", "-f", "json"], "").stdout).unwrap();
    let slow = all.as_array().unwrap().iter().find(|rule| rule["name"] == "sdo-no-response").unwrap();
    assert_eq!(slow["tolerances"][0]["key"], "warning-ms");
    let page = run(&["explain", "sdo-no-response"], "");
    assert_eq!(page.code, 0);
    for part in
        ["\nWhat it checks\n", "\nTolerances\n", "  warning-ms      200  ms ", "  [rules.sdo-no-response]\n"]
    {
        assert!(page.stdout.contains(part), "{part}{}", page.stdout);
    }
    let device = run(&["explain", "danfoss-pve-ci:avc-gap"], "").stdout;
    assert!(
        device.contains("\nSource\n") && device.contains("[rules.\"danfoss-pve-ci:avc-gap\"]"),
        "{device}"
    );
    // The numbers of device rules: one per kind of key, as in their profiles.
    for (rule, row, line) in [
        ("danfoss-pve-ci:avc-gap", "\n  ms       250  ms    max interval\n", "\n  ms = 250\n"),
        (
            "danfoss-pve-ci:control-0f-in-fault-hold",
            "\n  count        2        max number\n",
            "\n  count = 2\n",
        ),
        (
            "rexroth-vpcd:tpdo1-at-its-event-timer",
            "\n  times        2        factor for the time in 1800:05\n",
            "\n  times = 2\n",
        ),
    ] {
        let page = run(&["explain", rule], "").stdout;
        assert!(page.contains(row) && page.contains(line), "{page}");
    }
    // The snippet contains the defaults.
    let bus = folder("snippet").join("bus.toml");
    let snippet = page.stdout.split("\nBus file, with the defaults\n").nth(1).unwrap();
    fs::write(&bus, snippet).unwrap();
    assert_eq!(check(&["--bus", text(&bus), LOST]).stdout, check(&[LOST]).stdout);
}

#[test]
fn our_own_fixtures_are_checked_as_the_recipe_says() {
    const BASELINE: &str = "fixtures/baseline.json";
    if is_blessing() {
        check(&[&["--baseline", BASELINE, "--update-baseline"], &RECIPE[..]].concat());
    }
    let output = check(&[&["--baseline", BASELINE, "--fail-on", "warning"], &RECIPE[..]].concat());
    assert_eq!(output.code, 0, "read each line, then COBSCOPE_BLESS=1\n{}", output.stdout);
    for mark in ["\ngone ", "\nerror ", "\nwarning ", "\nnote "] {
        assert!(!output.stdout.contains(mark), "read each line, then COBSCOPE_BLESS=1\n{}", output.stdout);
    }
}

#[test]
fn every_command_of_the_document_runs() {
    let folder = folder("document");
    let document = fs::read_to_string(workspace().join("docs/ci.md")).unwrap();
    let bus = folder.join("machine.toml");
    fs::write(&bus, "[node.5]\nname = \"pump\"\n").unwrap();
    let (baseline, captures) = (folder.join("baseline.json"), "fixtures/rules");
    let mut count = 0;
    for block in document.split("```").skip(1).step_by(2) {
        for line in block.lines() {
            let Some((_, arguments)) = line.split_once("cobscope check ") else { continue };
            let words = arguments.split(' ').map(|word| match word {
                "machine.toml" => text(&bus).to_owned(),
                "captures/baseline.json" => text(&baseline).to_owned(),
                "captures" => captures.to_owned(),
                "cobscope.sarif" | "cobscope.xml" | "pages" => text(&folder.join(word)).to_owned(),
                other => other.to_owned(),
            });
            let words: Vec<String> = words.collect();
            let output = check(&words.iter().map(String::as_str).collect::<Vec<_>>());
            // Without a baseline the fixtures of the rules have findings.
            let is_accepted = arguments.contains("--baseline") || arguments.contains("--fail-on never");
            assert_eq!(output.code, i32::from(!is_accepted), "{line}\n{}{}", output.stdout, output.stderr);
            count += 1;
        }
    }
    assert_eq!(count, 10);
}

#[test]
fn the_examples_of_the_bus_file_s_document() {
    let document = fs::read_to_string(workspace().join("docs/bus-file.md")).unwrap();
    let example = |heading: &str| {
        let section = document.split(&format!("\n## {heading}\n")).nth(1).unwrap();
        section.split("```toml\n").nth(1).unwrap().split("```").next().unwrap().to_owned()
    };
    let bus = folder("examples").join("bus.toml");
    fs::write(&bus, example("Severities and tolerances of rules")).unwrap();
    let lenient = check(&["--bus", text(&bus), LOST]);
    assert!(lenient.code == 0 && lenient.stdout.contains("warning  can0 5/05"), "{}", lenient.stdout);
    // With the new tolerance, the heartbeat after 170 ms (period 100 ms) is not late.
    assert!(lenient.stdout.contains("         at 0.970 s {10}\n"), "{}", lenient.stdout);
    fs::write(&bus, example("Known and accepted findings")).unwrap();
    let suppressed = check(&["--today", "2026-12-31", "--bus", text(&bus), LOST]);
    // The finding is about the node, not about 1018:01.
    assert_eq!(suppressed.code, 1);
    let all = example("Known and accepted findings").replace("about =", "# about =");
    fs::write(&bus, all).unwrap();
    let suppressed = check(&["--today", "2026-12-31", "--bus", text(&bus), LOST]);
    assert_eq!(suppressed.code, 0, "{}", suppressed.stdout);
}
