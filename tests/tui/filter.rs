//! `--filter`, `--from`, `--to` on fixtures. Expected lines are those of `expected.txt` next to each capture.
#![expect(clippy::indexing_slicing, reason = "a test that cannot go on has failed")]

use std::path::Path;
use std::process::{Command, Output};

use crate::cli;

fn run(arguments: &[&str], capture: &str) -> Output {
    let root = Path::new(env!("CARGO_MANIFEST_DIR")).parent().unwrap();
    let path = root.join("fixtures").join("canopen").join(capture);
    let mut command = Command::new(env!("CARGO_BIN_EXE_cobscope"));
    command.env("NO_COLOR", "1").arg("decode").args(arguments).arg(path);
    command.output().unwrap()
}

/// Lines that a run prints; it must succeed without messages other than suggested profiles.
fn lines(arguments: &[&str], capture: &str) -> Vec<String> {
    let output = run(arguments, capture);
    let messages = String::from_utf8(output.stderr).unwrap();
    assert!(messages.lines().all(|line| line.contains(" behaves like ")), "{messages}");
    assert_eq!(output.status.code(), Some(0));
    String::from_utf8(output.stdout).unwrap().lines().map(str::to_owned).collect()
}

/// `first-last kind` of each event that matches a filter.
fn events(arguments: &[&str], capture: &str) -> Vec<String> {
    let lines = lines(&[&["-f", "jsonl"], arguments].concat(), capture);
    let event = |line: &String| {
        let event: serde_json::Value = serde_json::from_str(line).unwrap();
        let kind = event["kind"].as_str().unwrap();
        match (&event["frames"][0], &event["frames"][1]) {
            (first, last) if first == last => format!("{last} {kind}"),
            (first, last) => format!("{first}-{last} {kind}"),
        }
    };
    lines.iter().map(event).collect()
}

fn filtered(filter: &str, capture: &str) -> Vec<String> {
    events(&["--filter", filter], capture)
}

#[test]
fn the_transfers_the_client_aborted() {
    // sdo_abort.expected.txt: abort.by=client in frames 23-27 and 28-29.
    let expected = [
        "    0.206  client→2          SDO r  2010:00 ABORTED by client 08000021: refused because of local \
         control dt=4.0ms seg {23-27}",
        "    0.527  client→3          SDO r  1000:00 Device type ABORTED by client 05040000: SDO timed out \
         dt=300.0ms {28-29}",
    ];
    assert_eq!(lines(&["--filter", "abort.by == client"], "sdo_abort.log"), expected);
}

#[test]
fn by_abort_code_with_wireshark_s_name() {
    let filter = "canopen.sdo.abort_code in {0x06010000..0x0601FFFF 0x060A0023}";
    let expected = ["5-6 sdo-transfer", "7-8 sdo-transfer", "13-14 sdo-transfer"];
    assert_eq!(filtered(filter, "sdo_abort.log"), expected);
    assert_eq!(filtered("abort.code && node == 3", "sdo_abort.log"), ["28-29 sdo-transfer"]);
    assert_eq!(filtered("outcome == aborted && !mode && direction", "sdo_abort.log").len(), 4);
}

#[test]
fn emergencies_that_say_something() {
    // emcy.expected.txt: codes other than 0000 in frames 6, 7, 11 and 14; 13 is empty.
    let expected = ["6 emcy", "7 emcy", "11 emcy", "14 emcy"];
    assert_eq!(filtered("kind == emcy && code != 0", "emcy.log"), expected);
    assert_eq!(filtered("vendor_data contains DE:AD", "emcy.log"), ["11 emcy"]);
    assert_eq!(filtered("action == ready", "emcy.log"), ["13 emcy"]);
    // A finding about it also matches, when it opens and closes.
    let expected = ["14 emcy", "14 finding-opened", "15 finding-closed"];
    assert_eq!(filtered("text matches \"TEMPERATURE$\"", "emcy.log"), expected);
}

#[test]
fn states_and_commands() {
    // nmt_heartbeat.expected.txt: frame 17 stops node 5, which reports it in 19 and 21.
    let expected = ["19 heartbeat", "21 heartbeat"];
    assert_eq!(
        filtered("kind == heartbeat && state == stopped && frames < 23", "nmt_heartbeat.log"),
        expected
    );
    let target = filtered("canopen.nmt_ctrl.node_id == 5 && command == stop", "nmt_heartbeat.log");
    assert_eq!(target, ["17 nmt-command"]);
}

#[test]
fn a_limit_by_frames_goes_by_the_last_one() {
    let both = events(&["--from", "#6", "--to", "#10", "--no-findings"], "sdo_abort.log");
    assert_eq!(both, ["5-6 sdo-transfer", "7-8 sdo-transfer", "9-10 sdo-transfer"]);
}

#[test]
fn a_limit_by_seconds_counts_from_the_first_frame() {
    // Frames 11 and 12 are 4.5 and 5 s after the first one, 13 is 6 s after it.
    let within = ["--from", "4.5", "--to", "5.000", "--filter", "kind == emcy"];
    assert_eq!(events(&within, "emcy.log"), ["11 emcy", "12 emcy"]);
    let dates =
        ["--from", "2023-11-14T22:13:24.5Z", "--to", "2023-11-14 22:13:25", "--filter", "kind == emcy"];
    assert_eq!(events(&dates, "emcy.log"), ["11 emcy", "12 emcy"]);
    assert_eq!(events(&["--from", "6.000000001", "--to", "6.4"], "emcy.log"), [""; 0]);
}

#[test]
fn what_is_left_out_is_learnt_all_the_same() {
    // pdo_mapping: the mapping is written long before the PDOs that depend on it.
    let all = filtered("kind == pdo && signals", "pdo_mapping.log");
    let late = events(&["--filter", "kind == pdo && signals", "--from", "#30"], "pdo_mapping.log");
    assert!(!late.is_empty() && late.len() < all.len());
    assert_eq!(all[all.len() - late.len()..], late);
    let zero = lines(&["--filter", "code == 0x4210"], "emcy.log");
    assert!(zero.len() == 1 && zero[0].starts_with("    6.500  "), "{zero:?}");
}

#[test]
fn no_limit_prints_what_no_option_prints() {
    let all = lines(&["-f", "jsonl"], "sdo_no_answer.log");
    for arguments in [["--from", "0"], ["--to", "#999"], ["--filter", "kind"]] {
        assert_eq!(lines(&[&["-f", "jsonl"], &arguments[..]].concat(), "sdo_no_answer.log"), all);
    }
}

#[test]
fn a_wrong_filter_is_shown_where_it_is_wrong() {
    let output = run(&["--filter", "node == 4 && nod == 1"], "emcy.log");
    assert_eq!(output.status.code(), Some(2));
    assert!(output.stdout.is_empty());
    let text = String::from_utf8(output.stderr).unwrap();
    let expected = "unknown field 'nod'; did you mean node?\n  node == 4 && nod == 1\n               ^^^\n";
    assert!(text.contains(expected), "{text}");
}

#[test]
fn a_wrong_limit_is_a_wrong_command_line() {
    let output = run(&["--from", "yesterday"], "emcy.log");
    assert_eq!(output.status.code(), Some(2));
    let text = String::from_utf8(output.stderr).unwrap();
    assert!(text.contains("expected seconds (12.5), a frame (#1234) or a time"), "{text}");
}

#[test]
fn a_capture_without_times_has_no_seconds() {
    let path = std::env::temp_dir().join(format!("cobscope-no-times-{}.log", std::process::id()));
    std::fs::write(&path, "  can0  702   [1]  00\n  can0  702   [1]  05\n").unwrap();
    let timed = run(&["--from", "1"], path.to_str().unwrap());
    let numbered = run(&["--from", "#1"], path.to_str().unwrap());
    std::fs::remove_file(&path).unwrap();
    assert_eq!(timed.status.code(), Some(3));
    let text = String::from_utf8(timed.stderr).unwrap();
    assert!(text.contains("has no timestamps; use frame numbers, such as --from #1234"), "{text}");
    assert_eq!(numbered.status.code(), Some(0), "{}", String::from_utf8_lossy(&numbered.stderr));
}

#[test]
fn a_start_after_the_end_is_reported() {
    // 44 frames, the last one at 1700000010.002.
    for (from, says) in [
        ("10.1", "guarding.log: --from is after the last frame, #44 at 10.002 s"),
        ("#45", "--from is after the last frame, #44 at 10.002 s"),
        ("2024-01-01T00:00:00Z", "--from is after the last frame, #44 at 2023-11-14T22:13:30.002Z"),
    ] {
        let output = cli::run(&["decode", "--from", from, "fixtures/canopen/guarding.log"], "");
        assert_eq!((output.code, output.stdout.as_str()), (0, ""), "{from}");
        assert!(output.stderr.contains(says), "{from}: {}", output.stderr);
    }
    // The clock steps back to 1 s after the start at the end; an earlier event is at 4 s.
    let stepped = "(5.0) can0 705#00\n(9.0) can0 705#05\n(6.0) can0 705#05\n";
    let output = cli::run(&["decode", "--from", "3.5", "--no-findings", "-"], stepped);
    assert!(!output.stdout.is_empty() && !output.stderr.contains("--from"), "{}", output.stderr);
    let output = cli::run(&["decode", "--from", "9.5", "fixtures/canopen/guarding.log"], "");
    assert_eq!((output.code, output.stderr.as_str()), (0, ""));
}

#[test]
fn stamps_that_step_back_are_differences_on_a_screen_and_a_step_in_a_log() {
    let log = "(10.0) can0 701#05\n(11.0) can0 701#05\n(9.0) can0 701#05\n";
    let output = cli::run(&["decode", "--all", "-"], log).stdout;
    assert!(output.contains("CLOCK  timestamps jumped back by 2.000 s"), "{output}");
    let screen =
        " (010.0)  can0  701   [1]  05\n (011.0)  can0  701   [1]  05\n (009.0)  can0  701   [1]  05\n";
    let output = cli::run(&["decode", "--all", "-"], screen).stdout;
    assert!(output.contains("20.000  1/01"), "{output}");
    assert!(output.contains("NOTE   timestamps step back: read as time since the frame before"), "{output}");
}

#[test]
fn an_empty_output_is_reported_with_its_reason() {
    const CAPTURE: &str = "fixtures/canopen/nmt_heartbeat.log";
    let texts = |words: &[&str]| {
        let output = cli::run(&[&["decode", CAPTURE], words].concat(), "");
        assert_eq!((output.code, output.stdout.as_str()), (0, ""), "{words:?}");
        output.stderr.strip_prefix(&format!("cobscope: {CAPTURE}: ")).unwrap().trim_end().to_owned()
    };
    assert_eq!(texts(&["--filter", "node == 99"]), "no event matches the filter");
    let hidden = texts(&["--filter", "kind == heartbeat && state == operational"]);
    assert!(
        hidden.starts_with("no printed event matches the filter; hidden ones do, print them with --all ("),
        "{hidden}"
    );
    assert!(!cli::run(&["decode", CAPTURE, "--all", "--filter", "kind == heartbeat"], "").stdout.is_empty());
    let output = cli::run(&["decode", "-f", "jsonl", "--filter", "id == 0x123"], "(1.0) can0 123#00\n");
    assert_eq!(
        (output.stdout.as_str(), output.stderr.as_str()),
        (
            "",
            "cobscope: -: no printed event matches the filter; hidden ones do, print them with --frames (1)\n"
        )
    );
    assert_eq!(cli::run(&["decode", "-f", "none", "--filter", "node == 99", CAPTURE], "").stderr, "");
    assert!(
        texts(&["--filter", "node == 99", "--from", "100000"]).starts_with("--from is after the last frame")
    );
}

#[test]
fn what_can_never_match_is_refused() {
    const CAPTURE: &str = "fixtures/canopen/nmt_heartbeat.log";
    for (words, stated) in [
        (
            &["--filter", "rule == node-los"][..],
            "--filter: unknown rule 'node-los'; did you mean 'node-lost'?",
        ),
        (&["--filter", "node == 5 || !(rule in {node-lost, emcy-rased})"], "unknown rule 'emcy-rased'"),
        (&["--filter", "rule != node-los"], "unknown rule 'node-los'"),
        (&["--filter", "kind == pdo && pdo == TPD1"], "unknown pdo 'TPD1'; did you mean TPDO1?"),
        (&["--from", "5", "--to", "3"], "--from is after --to; the range is empty"),
        (&["--from", "#5", "--to", "#3"], "--from is after --to; the range is empty"),
    ] {
        let output = cli::run(&[&["decode", CAPTURE], words].concat(), "");
        assert!(output.code == 2 && output.stderr.contains(stated), "{words:?}: {}", output.stderr);
    }
    assert_eq!(cli::run(&["convert", "-f", "candump", "--from", "5", "--to", "3", CAPTURE, "-"], "").code, 2);
    // A device rule and an expectation are rules too.
    let rule = "rule == \"rexroth-sydfec:eeprom-wear\"";
    assert_eq!(cli::run(&["decode", "--filter", rule, CAPTURE], "").code, 0);
    assert_eq!(cli::run(&["decode", "--from", "3", "--to", "3", CAPTURE], "").code, 0);
}
