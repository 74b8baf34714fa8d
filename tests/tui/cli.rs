//! Arguments, input, output and exit codes.

use std::io::Write;
use std::path::Path;
use std::process::{Command, Stdio};

use crate::support::workspace;

/// Result of a run of the program.
pub struct Output {
    pub stdout: String,
    pub stderr: String,
    pub code: i32,
}

/// Runs the program in the workspace with `input` on its standard input.
pub fn run(arguments: &[&str], input: &str) -> Output {
    run_in(&workspace(), arguments, input)
}

/// Like [`run`], in another folder.
pub fn run_in(folder: &Path, arguments: &[&str], input: &str) -> Output {
    let mut child = Command::new(env!("CARGO_BIN_EXE_cobscope"))
        .args(arguments)
        .current_dir(folder)
        .env_remove("NO_COLOR")
        // Ignores profiles of the user who runs the tests.
        .env("XDG_CONFIG_HOME", concat!(env!("CARGO_TARGET_TMPDIR"), "/no-config"))
        .stdin(Stdio::piped())
        .stdout(Stdio::piped())
        .stderr(Stdio::piped())
        .spawn()
        .unwrap();
    // The program may end before it has read its whole input.
    let _ = child.stdin.take().unwrap().write_all(input.as_bytes());
    let output = child.wait_with_output().unwrap();
    Output {
        stdout: String::from_utf8(output.stdout).unwrap(),
        stderr: String::from_utf8(output.stderr).unwrap(),
        code: output.status.code().unwrap_or(-1),
    }
}

const BOOT: &str = "(1700000000.000000) can0 705#00\n";

#[test]
fn a_capture_on_standard_input_is_decoded() {
    for arguments in [&[][..], &["-"], &["decode"], &["decode", "-"]] {
        let output = run(arguments, BOOT);
        assert!(output.stdout.contains("5/05") && output.stdout.contains("BOOT"), "{}", output.stdout);
        assert_eq!(output.code, 0);
    }
}

#[test]
fn json_lines_hold_the_contract_s_keys() {
    let output = run(&["decode", "-f", "jsonl"], BOOT);
    let expected = concat!(
        r#"{"t":1700000000.000000000,"bus":"can0","frames":[1,1],"kind":"boot-up","protocol":"canopen","#,
        r#""node":5,"cause":"presumed-power-on"}"#
    );
    assert_eq!(output.stdout.lines().next().unwrap(), expected);
    for line in output.stdout.lines() {
        serde_json::from_str::<serde_json::Value>(line).unwrap();
    }
}

#[test]
fn a_capture_that_cannot_be_read_gives_3_and_the_others_are_done() {
    let missing = run(&["no/such/file.log", "fixtures/canopen/emcy.log"], "");
    assert_eq!(missing.code, 3);
    assert!(missing.stderr.contains("no/such/file.log: cannot be opened"), "{}", missing.stderr);
    assert!(missing.stdout.contains("== fixtures/canopen/emcy.log") && missing.stdout.contains("8130"));
    let unknown = run(&["LICENSE"], "");
    assert_eq!(unknown.code, 3);
    assert!(unknown.stderr.contains("not a capture in a known format"), "{}", unknown.stderr);
    let empty = run(&["-"], "");
    assert_eq!(empty.code, 3);
    assert!(empty.stderr.contains("empty"), "{}", empty.stderr);
    let no_frame = run(&["-"], "(1700000000.000000) can0 123#80:00:12345678#AABB\n");
    assert_eq!(no_frame.code, 3);
    assert!(no_frame.stderr.contains("contains no frames"), "{}", no_frame.stderr);
}

#[test]
fn a_wrong_argument_gives_2() {
    assert_eq!(run(&["decode", "--no-such-option"], "").code, 2);
    assert_eq!(run(&["decode", "-f", "xml"], "").code, 2);
}

#[test]
fn bad_lines_alone_do_not_change_the_exit_code() {
    let output = run(&["fixtures/dialects/bad_lines.log"], "");
    assert_eq!(output.code, 0);
    assert_eq!(output.stdout.matches("UNREAD").count(), 11, "{}", output.stdout);
    assert!(output.stdout.contains("3 more, 13 in total"), "{}", output.stdout);
}

#[test]
fn control_characters_of_a_capture_reach_no_terminal() {
    let hostile = "(1700000000.000000) \u{1b}]0;evil\u{7} 705#00\n(1700000000.1) can1 705#00\n";
    for arguments in
        [&["decode"][..], &["decode", "-v"], &["decode", "--color", "never"], &["decode", "-f", "jsonl"]]
    {
        let output = run(arguments, hostile);
        assert!(output.stdout.chars().all(|c| c == '\n' || !c.is_control()), "{:?}", output.stdout);
    }
}

#[test]
fn colours_only_when_asked_for_on_a_pipe() {
    assert!(!run(&["decode"], BOOT).stdout.contains('\u{1b}'));
    assert!(run(&["decode", "--color", "always"], BOOT).stdout.contains("\u{1b}["));
}

#[test]
fn a_closed_pipe_is_no_failure() {
    let mut child = Command::new(env!("CARGO_BIN_EXE_cobscope"))
        .args(["decode", "--pdo", "all", "--all", "fixtures/canopen/mid_run.log"])
        .current_dir(workspace())
        .stdout(Stdio::piped())
        .stderr(Stdio::piped())
        .spawn()
        .unwrap();
    drop(child.stdout.take());
    let output = child.wait_with_output().unwrap();
    assert_eq!(output.status.code(), Some(0));
    assert!(output.stderr.is_empty(), "{}", String::from_utf8_lossy(&output.stderr));
}

#[test]
fn time_columns_as_candump_has_them() {
    let two = "(1436509052.249713) can0 705#00\n(1436509052.449713) can0 705#00\n";
    let column = |style: &str| {
        let output = run(&["decode", "-t", style], two);
        output.stdout.lines().nth(1).unwrap().trim_start().split("  ").next().unwrap().to_owned()
    };
    assert_eq!(column("a"), "1436509052.449713");
    assert_eq!(column("d"), "0.200000");
    assert_eq!(column("z"), "0.200");
    assert_eq!(column("A"), "2015-07-10 06:17:32.449713");
}

#[test]
fn completions_and_the_manual_page_are_made() {
    assert!(run(&["completions", "bash"], "").stdout.contains("cobscope"));
    assert!(run(&["man"], "").stdout.contains(".TH"));
    let decode = run(&["man", "decode"], "").stdout;
    assert!(decode.contains(".TH cobscope-decode 1"), "{decode}");
    let unknown = run(&["man", "x"], "");
    assert_eq!(
        (unknown.code, unknown.stderr.as_str()),
        (2, "cobscope: unknown command 'x'; see cobscope --help\n")
    );
}

#[test]
fn manual_pages_name_pages_that_are_made() {
    for (page, own) in [(vec!["man"], "cobscope"), (vec!["man", "profiles"], "cobscope-profiles")] {
        let text = run(&page, "").stdout.replace("\\-", "-");
        let named: Vec<_> = text.lines().filter_map(|line| line.strip_suffix("(1)")).collect();
        assert!(named.len() > 3, "{text}");
        for name in named {
            assert!(name.starts_with(own) && !name.ends_with("-help"), "{name}");
            let further = run(&["man", name.strip_prefix("cobscope-").unwrap()], "");
            assert!(further.stdout.contains(&format!(".TH {name} 1")), "{name}: {}", further.stderr);
        }
    }
}

#[test]
fn completions_offer_files_only_where_files_are_meant() {
    let script = run(&["completions", "bash"], "").stdout;
    for (option, wants_files) in
        [("--node", false), ("--filter", false), ("--bitrate", false), ("--bus", true)]
    {
        let cases: Vec<_> = script.split(&format!(" {option})\n")).skip(1).collect();
        assert!(!cases.is_empty(), "{option}");
        for case in cases {
            let case = case.split(";;").next().unwrap();
            assert_eq!(case.contains("compgen -f"), wants_files, "{option}: {case}");
        }
    }
}

#[test]
fn help_tells_what_exit_statuses_mean_and_shows_examples() {
    for command in [vec![], vec!["check"]] {
        let help = run(&[command.as_slice(), &["--help"]].concat(), "").stdout;
        for status in 0..=4 {
            assert!(help.contains(&format!("\n  {status}  ")), "{command:?} {status}: {help}");
        }
    }
    let commands =
        ["view", "live", "decode", "convert", "stats", "objects", "why", "check", "explain", "profiles"];
    for command in commands {
        let help = run(&[command, "--help"], "").stdout;
        assert!(help.contains(&format!("Examples:\n  cobscope {command} ")), "{help}");
    }
    let view = run(&["view", "--help"], "").stdout;
    assert!(view.contains("see --all.") && !view.contains("--pdo"), "{view}");
}

#[test]
fn the_outcome_of_a_fault_follows_a_comma() {
    let lines = run(&["decode", "fixtures/j1939/nm_clear.log"], "").stdout;
    for stated in [", previously active", ", no longer reported after 1.000 s", ", cleared after 2.006 s"] {
        assert!(lines.contains(stated), "{stated}: {lines}");
    }
}
