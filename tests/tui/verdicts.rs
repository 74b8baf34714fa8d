//! Conditions for judged and passed rules.

use crate::cli::run;

#[test]
fn a_case_of_the_test_plan_passes_only_where_the_capture_shows_it() {
    // Heartbeats only: their time is judged (7.102), but no PDO is sent in any state (3.4 to 3.20).
    let table = run(&["check", "--coverage", "fixtures/canopen/heartbeat_lost.log"], "").stdout;
    let verdict =
        |case: &str| table.lines().find(|line| line.starts_with(&format!("{case} "))).map(str::to_owned);
    assert!(verdict("7.102").unwrap().contains("fail"), "{table}");
    for case in ["3.4", "3.9", "3.20", "9.2", "10.2"] {
        assert!(verdict(case).unwrap().contains("not exercised"), "{table}");
    }
}

#[test]
fn a_capture_of_which_nothing_was_judged_has_not_passed() {
    let output = run(&["check", "-"], "(1.0) can0 555#01\n(2.0) can0 555#02\n");
    let row = output.stdout.lines().find(|line| line.starts_with("- ")).unwrap();
    assert!(row.ends_with("nothing checked"), "{}", output.stdout);
    assert!(output.stdout.ends_with("; nothing checked in 1 capture\n"), "{}", output.stdout);
    assert_eq!(output.code, 0);
}

#[test]
fn every_format_states_that_nothing_was_checked() {
    let state = |format: &str| {
        let none = run(&["check", "-f", format, "-"], "(1.0) can0 555#01\n(2.0) can0 555#02\n");
        let some = run(&["check", "-f", format, "fixtures/rules/pdo-long.log"], "");
        assert_eq!((none.code, some.code), (0, 0), "{format}");
        (none.stdout, some.stdout)
    };
    for (format, stated) in [
        ("jsonl", "\"verdict\":\"nothing-checked\""),
        ("junit", "nothing checked: no rule was exercised"),
        ("sarif", "nothing checked: no rule was exercised"),
        ("github", "::notice file=-,title=nothing-checked::nothing checked: no rule was exercised"),
    ] {
        let (none, some) = state(format);
        assert!(none.contains(stated), "{format}: {none}");
        assert!(!some.contains(stated), "{format}: {some}");
    }
}

/// The verdict of a capture that does not fail names its findings.
#[test]
fn passed_is_a_capture_without_findings() {
    let verdict = |arguments: &[&str]| {
        let output = run(&[&["check"][..], arguments].concat(), "").stdout;
        let row = output.lines().skip_while(|line| !line.starts_with("CAPTURE")).nth(1).unwrap().to_owned();
        row.rsplit("  ").next().unwrap().to_owned()
    };
    assert_eq!(verdict(&["fixtures/rules/pdo-long.log"]), "1 note");
    assert_eq!(verdict(&["fixtures/rules/sync-period.log", "--fail-on", "never"]), "1 error");
    assert_eq!(verdict(&["fixtures/rules/trouble-code.log"]), "2 warnings");
    assert_eq!(verdict(&["fixtures/rules/trouble-code.log", "--fail-on", "warning"]), "FAILED");
    assert_eq!(verdict(&["fixtures/rules/clean/canopen.log"]), "passed");
}

#[test]
fn what_was_found_by_taking_a_bus_for_canopen_is_forgotten_where_it_is_none() {
    let lines = |seconds: u32| {
        let line = |t: u32| format!("({t}.0) can0 588#0102\n({t}.5) can0 1A0#00\n");
        (0..seconds).map(line).collect::<Vec<_>>().concat()
    };
    // Two bytes are not an SDO message on a CANopen bus; after three of them, the bus is not CANopen.
    let early = run(&["check", "-"], &lines(2)).stdout;
    assert!(early.contains("[malformed-message]"), "{early}");
    let late = run(&["check", "-"], &lines(100)).stdout;
    assert!(!late.contains("[malformed-message]"), "{late}");
    assert!(run(&["stats", "-"], &lines(100)).stdout.contains("not detected as CANopen"));
}

#[test]
fn stamps_that_are_made_up_let_no_time_run_out() {
    let line =
        |(number, what): (u32, &str)| format!("({}.{:03}) can0 {what}\n", number / 1_000, number % 1_000);
    let frames =
        (0..3_000).map(|number| (number, if number == 500 { "605#4018100100000000" } else { "701#05" }));
    let output = run(&["decode", "-"], &frames.map(line).collect::<Vec<_>>().concat()).stdout;
    assert!(
        output.contains("NOTE   all timestamps have equal intervals, presumably synthetic: time limits"),
        "{output}"
    );
    assert!(output.contains("unfinished at end of capture"), "{output}");
}

#[test]
fn a_note_fails_where_it_is_asked_to() {
    // One PDO is longer than its mapping, which is a note.
    let code = |least: &str| run(&["check", "--fail-on", least, "fixtures/rules/pdo-long.log"], "").code;
    assert_eq!(["error", "warning", "note", "never"].map(code), [0, 0, 1, 0]);
}

#[test]
fn a_late_heartbeat_is_no_lost_node() {
    let text =
        run(&["decode", "--filter", "kind == finding-opened", "fixtures/rules/node-lost.log"], "").stdout;
    let words: Vec<_> = text.lines().filter_map(|line| line.split_whitespace().nth(2)).collect();
    assert_eq!(words, ["LATE", "LOST"], "{text}");
}

#[test]
fn a_finding_names_the_rules_it_covers() {
    let text = run(&["check", "fixtures/rules/store-not-effective.log"], "").stdout;
    assert!(text.contains("\n         also covers 1 finding of other rules: read-back\n"), "{text}");
}

#[test]
fn limits_of_all_captures_are_printed_once() {
    let folder = tempfile::tempdir().unwrap();
    let bus = folder.path().join("bus.toml");
    let rule =
        "[[expect]]\nid = \"x\"\nkind = \"never\"\nreason = \"r\"\nbus = \"can7\"\nwhen = \"kind == emcy\"\n";
    std::fs::write(&bus, rule).unwrap();
    let captures = ["fixtures/canopen/emcy.log", "fixtures/canopen/error_frames.log"];
    let text = run(&["check", "--bus", bus.to_str().unwrap(), captures[0], captures[1]], "").stdout;
    let stated = "quality  x is not exercised: no bus 'can7' in the capture\n";
    assert!(text.starts_with(&format!("== all 2 captures\n{stated}\n== {} (", captures[0])), "{text}");
    assert_eq!(text.matches(stated).count(), 1, "{text}");
    // The limitation of a verdict is printed with its capture.
    let limits = "0.744 s)\nquality  recorder lost 1 frame\nquality  24 error frames\n";
    assert!(text.contains(limits), "{text}");
    let alone = run(&["check", "--bus", bus.to_str().unwrap(), captures[0]], "").stdout;
    let head = alone.split("\nwarning ").next().unwrap();
    assert!(head.starts_with(&format!("== {} (15 frames, 7.000 s)\n", captures[0])), "{alone}");
    assert!(head.contains(stated.trim_end()), "{alone}");
}
