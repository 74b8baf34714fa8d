//! Output files take their name when they are whole, and replace nothing that the user did not name; messages and JSON
//! contain no control characters of a capture or a file name.
#![cfg(unix)]

use std::fs;
use std::path::Path;
use std::process::Command;

use crate::cli::{Output, run_in};
use crate::support::workspace;

const BOOT: &str = "(1700000000.000000) can0 705#00\n(1700000000.100000) can0 705#05\n";

fn folder() -> tempfile::TempDir {
    let folder = tempfile::tempdir().unwrap();
    fs::write(folder.path().join("a.log"), BOOT).unwrap();
    folder
}

fn names(folder: &Path) -> Vec<String> {
    let entries = fs::read_dir(folder).unwrap().map(|entry| entry.unwrap().file_name());
    let mut names: Vec<_> = entries.map(|name| name.to_string_lossy().into_owned()).collect();
    names.sort();
    names
}

#[test]
fn decode_replaces_a_file_only_if_forced() {
    let folder = folder();
    fs::write(folder.path().join("notes.txt"), "mine").unwrap();
    let decode = |words: &[&str]| run_in(folder.path(), &[&["decode", "a.log"], words].concat(), "");
    let refused = decode(&["-o", "notes.txt"]);
    let expected = "cobscope: notes.txt: file exists; use --force to overwrite it\n";
    assert_eq!((refused.code, refused.stderr.as_str()), (2, expected));
    assert_eq!(fs::read(folder.path().join("notes.txt")).unwrap(), b"mine");
    assert_eq!(decode(&["-o", "notes.txt", "--force"]).code, 0);
    assert!(fs::read_to_string(folder.path().join("notes.txt")).unwrap().contains("boot-up"));
    assert_eq!(names(folder.path()), ["a.log", "notes.txt"]);
    // A device is not replaced.
    assert_eq!(decode(&["-o", "/dev/null"]).code, 0);
}

/// A file of this name is neither read nor written: `-` is stdin or stdout.
#[test]
fn a_dash_is_no_file() {
    let folder = tempfile::tempdir().unwrap();
    let all = fs::read_to_string(workspace().join("fixtures/machine/machine.log")).unwrap();
    let decode =
        |words: &[&str]| run_in(folder.path(), &[&["decode", "-f", "jsonl", "-"], words].concat(), &all);
    let expected = decode(&["--from", "2023-11-14"]);
    assert_eq!(decode(&["--from", "2023-11-14", "-o", "-"]).stdout, expected.stdout);
    assert!(names(folder.path()).is_empty());
    fs::write(folder.path().join("-"), "").unwrap();
    assert_eq!(decode(&["--from", "2023-11-14"]).stdout, expected.stdout);
    assert_eq!(fs::read(folder.path().join("-")).unwrap(), b"");
}

#[cfg(feature = "parquet")]
#[test]
fn neither_of_two_files_is_replaced() {
    let folder = folder();
    fs::write(folder.path().join("run.signals.parquet"), "mine").unwrap();
    let words = ["decode", "-f", "parquet", "-o", "run.parquet", "a.log"];
    assert_eq!(run_in(folder.path(), &words, "").code, 2);
    assert_eq!(fs::read(folder.path().join("run.signals.parquet")).unwrap(), b"mine");
    let forced = [&words[..], &["--force"]].concat();
    assert_eq!(run_in(folder.path(), &forced, "").code, 0);
    assert_eq!(names(folder.path()), ["a.log", "run.events.parquet", "run.signals.parquet"]);
}

#[test]
fn check_replaces_its_reports_and_nothing_else() {
    let folder = folder();
    let formats = ["text", "jsonl", "junit", "sarif", "github"];
    let check = |format: &str, output: &str| {
        run_in(folder.path(), &["check", "a.log", "-f", format, "-o", output], "")
    };
    for one in formats {
        for other in formats {
            assert_eq!(check(one, "report").code, 0, "{one}");
            let replaced = check(other, "report");
            assert_eq!((replaced.code, replaced.stderr.as_str()), (0, ""), "{one}, then {other}");
        }
    }
    for content in ["mine\n", "{\"kind\": \"other\"}\n", "<?xml version=\"1.0\"?>\n<a/>\n"] {
        fs::write(folder.path().join("other"), content).unwrap();
        let refused = check("sarif", "other");
        let expected = "cobscope: other: not overwritten; expected a report of cobscope check, or no file\n";
        assert_eq!((refused.code, refused.stderr.as_str()), (2, expected));
        assert_eq!(fs::read_to_string(folder.path().join("other")).unwrap(), content);
    }
    fs::write(folder.path().join("empty"), "").unwrap();
    assert_eq!(check("junit", "empty").code, 0);
}

#[test]
fn pages_and_comparisons_replace_their_own_kind_and_nothing_else() {
    let folder = folder();
    let run = |words: &[&str], output: &str| run_in(folder.path(), &[words, &["-o", output]].concat(), "");
    let mut pages: Vec<&[&str]> = vec![&["report", "a.log"], &["report", "-f", "md", "a.log"]];
    if cfg!(feature = "parquet") {
        assert_eq!(run_in(folder.path(), &["lake", "add", "lake", "a.log"], "").code, 0);
        pages.push(&["report", "--lake", "lake"]);
    }
    let comparisons: Vec<&[&str]> = vec![
        &["diff", "a.log", "a.log"],
        &["diff", "-f", "json", "a.log", "a.log"],
        &["diff", "-f", "html", "a.log", "a.log"],
    ];
    let kinds = [("a page of cobscope report", pages), ("a comparison of cobscope diff", comparisons)];
    for (name, commands) in kinds {
        for one in &commands {
            for other in &commands {
                assert_eq!(run(one, "own").code, 0, "{one:?}");
                assert_eq!(run(other, "own").code, 0, "{one:?}, then {other:?}");
            }
            fs::write(folder.path().join("other"), "mine\n").unwrap();
            let refused = run(one, "other");
            let expected = format!("other: not overwritten; expected {name}, or no file\n");
            assert_eq!(refused.code, 2, "{one:?}");
            assert!(refused.stderr.ends_with(&expected), "{}", refused.stderr);
            assert_eq!(fs::read_to_string(folder.path().join("other")).unwrap(), "mine\n");
        }
        fs::remove_file(folder.path().join("own")).unwrap();
    }
    fs::create_dir(folder.path().join("pages")).unwrap();
    fs::write(folder.path().join("pages/index.html"), "mine").unwrap();
    fs::copy(folder.path().join("a.log"), folder.path().join("b.log")).unwrap();
    assert_eq!(run(&["report", "a.log", "b.log"], "pages").code, 2);
    assert_eq!(fs::read_to_string(folder.path().join("pages/index.html")).unwrap(), "mine");
}

#[test]
fn no_output_replaces_one_of_another_command() {
    let folder = folder();
    let run = |words: &[&str]| run_in(folder.path(), &[words, &["-o", "own"]].concat(), "");
    let kinds: [&[&[&str]]; 3] = [
        &[&["report", "a.log"], &["report", "-f", "md", "a.log"]],
        &[
            &["diff", "a.log", "a.log"],
            &["diff", "-f", "json", "a.log", "a.log"],
            &["diff", "-f", "html", "a.log", "a.log"],
        ],
        &[&["check", "a.log"], &["check", "-f", "jsonl", "a.log"], &["check", "-f", "junit", "a.log"]],
    ];
    for (place, earlier) in kinds.iter().enumerate() {
        for one in *earlier {
            assert_eq!(run(one).code, 0, "{one:?}");
            let content = fs::read(folder.path().join("own")).unwrap();
            let others = kinds.iter().enumerate().filter(|(other, _)| *other != place);
            for other in others.flat_map(|(_, commands)| *commands) {
                let refused = run(other);
                assert_eq!(refused.code, 2, "{one:?}, then {other:?}");
                assert!(refused.stderr.contains("own: not overwritten"), "{}", refused.stderr);
            }
            assert_eq!(fs::read(folder.path().join("own")).unwrap(), content, "{one:?}");
            fs::remove_file(folder.path().join("own")).unwrap();
        }
    }
}

#[test]
fn a_missing_folder_of_an_output_has_one_message() {
    let folder = folder();
    let outputs: [&[&str]; 8] = [
        &["decode", "a.log", "-o", "no/x.log"],
        &["check", "a.log", "-o", "no/x.log"],
        &["check", "a.log", "--update-baseline", "--baseline", "no/x.log"],
        &["diff", "a.log", "a.log", "-o", "no/x.log"],
        &["report", "a.log", "-o", "no/x.log"],
        &["convert", "a.log", "no/x.log"],
        &["convert", "a.log", "b.log", "--bus-file", "no/x.log"],
        &["live", "--print", "--record", "no/x.log", "-"],
    ];
    for words in outputs {
        let refused = run_in(folder.path(), words, BOOT);
        let expected = "cobscope: no/x.log: folder no does not exist; create it first\n";
        assert_eq!((refused.code, refused.stderr.as_str()), (2, expected), "{words:?}");
        assert_eq!(names(folder.path()), ["a.log"], "{words:?}");
    }
    let refused = run_in(folder.path(), &["decode", "a.log", "-o", "a.log/x.log"], "");
    let expected = "cobscope: a.log/x.log: a.log is not a folder; choose another name\n";
    assert_eq!((refused.code, refused.stderr.as_str()), (2, expected));
}

#[test]
fn a_capture_beside_a_page_is_replaced_and_no_other() {
    let folder = tempfile::tempdir().unwrap();
    let capture = workspace().join("fixtures/canopen/heartbeat_lost.log");
    let words = ["report", capture.to_str().unwrap(), "--attach", "-o", "page.html"];
    for _ in 0..2 {
        assert_eq!(run_in(folder.path(), &words, "").code, 0);
    }
    fs::write(folder.path().join("other.html"), "mine").unwrap();
    let elsewhere = [&words[..4], &["other.html"]].concat();
    assert_eq!(run_in(folder.path(), &elsewhere, "").code, 2);
    assert!(!folder.path().join("other.pcapng").exists(), "a refused page has no capture");
    fs::write(folder.path().join("page.pcapng"), "mine").unwrap();
    let refused = run_in(folder.path(), &words, "");
    assert_eq!(refused.code, 2, "{}", refused.stderr);
    assert!(
        refused.stderr.contains("page.pcapng: not overwritten; expected a capture of"),
        "{}",
        refused.stderr
    );
    assert_eq!(fs::read_to_string(folder.path().join("page.pcapng")).unwrap(), "mine");
}

/// Runs the program where no file can have more than 1,024 bytes.
fn run_on_full_disk(folder: &Path, words: &[&str]) -> Output {
    // An ignored signal stays ignored in the program, which sees an error instead.
    const LIMITED: &str = "trap '' XFSZ; ulimit -f 2; exec \"$@\"";
    let mut command = Command::new("sh");
    command.current_dir(folder).args(["-c", LIMITED, "sh", env!("CARGO_BIN_EXE_cobscope")]).args(words);
    let output = command.output().unwrap();
    Output {
        code: output.status.code().unwrap(),
        stdout: String::from_utf8(output.stdout).unwrap(),
        stderr: String::from_utf8(output.stderr).unwrap(),
    }
}

#[test]
fn on_a_full_disk_an_output_stays_a_part() {
    let folder = tempfile::tempdir().unwrap();
    fs::write(folder.path().join("a.log"), BOOT.repeat(200)).unwrap();
    let mut outputs = vec![
        (vec!["decode", "--all", "a.log", "-o"], "out.txt"),
        (vec!["decode", "-f", "jsonl", "a.log", "-o"], "out.jsonl"),
        (vec!["check", "-f", "sarif", "a.log", "-o"], "out.sarif"),
        (vec!["report", "a.log", "-o"], "out.html"),
    ];
    for suffix in ["log", "pcapng", "asc", "trc", "csv"] {
        outputs.push((vec!["convert", "a.log"], suffix));
    }
    for (words, suffix) in outputs {
        let name = if suffix.contains('.') { suffix.to_owned() } else { format!("out.{suffix}") };
        let run = run_on_full_disk(folder.path(), &[&words[..], &[name.as_str()]].concat());
        assert_eq!(run.code, 3, "{name}: {}", run.stderr);
        assert!(run.stderr.contains(&name), "{name}: {}", run.stderr);
        assert_eq!(names(folder.path()), ["a.log", &format!("{name}.part")], "{name}");
        fs::remove_file(folder.path().join(format!("{name}.part"))).unwrap();
    }
    // The former baseline is still there.
    let update = ["check", "a.log", "--baseline", "known.json", "--update-baseline"];
    fs::write(folder.path().join("known.json"), "").unwrap();
    let emcy = |node: u32| format!("(17000000{node:02}.0) can0 {:03X}#1081010000000000\n", 0x80 + node);
    fs::write(folder.path().join("a.log"), BOOT.to_owned() + &(1..60).map(emcy).collect::<String>()).unwrap();
    let run = run_on_full_disk(folder.path(), &update);
    assert_eq!(run.code, 3, "{}", run.stderr);
    assert_eq!(fs::read(folder.path().join("known.json")).unwrap(), b"");
}

#[test]
fn on_a_full_disk_no_page_is_claimed() {
    let folder = tempfile::tempdir().unwrap();
    fs::create_dir(folder.path().join("captures")).unwrap();
    let lost = workspace().join("fixtures/canopen/heartbeat_lost.log");
    fs::copy(&lost, folder.path().join("captures/a.log")).unwrap();
    let machine = workspace().join("fixtures/machine/machine.log");
    let words = ["report", machine.to_str().unwrap(), "--attach", "-o", "a.html"];
    let attached = run_on_full_disk(folder.path(), &words);
    assert_eq!(attached.code, 3, "{}", attached.stderr);
    assert!(attached.stderr.contains("a.pcapng: "), "{}", attached.stderr);
    assert_eq!(names(folder.path()), ["a.pcapng.part", "captures"]);
    for words in [&["report", "captures", "-o", "pages"][..], &["check", "captures", "--report", "pages"]] {
        let run = run_on_full_disk(folder.path(), words);
        assert_eq!(run.code, 3, "{words:?}: {}", run.stderr);
        let pages = names(&folder.path().join("pages"));
        assert_eq!(pages, ["captures_a.log.html.part", "index.html.part"], "{words:?}");
        let claims = run.stderr.lines().filter(|line| line.starts_with("cobscope: pages: ")).count();
        assert_eq!(claims, 0, "{words:?}: {}", run.stderr);
        fs::remove_dir_all(folder.path().join("pages")).unwrap();
    }
}

#[test]
fn files_without_end_are_refused() {
    let folder = folder();
    for (words, code) in [
        (&["decode", "a.log", "--bus", "/dev/zero"][..], 4),
        (&["check", "a.log", "--bus", "/dev/zero"], 4),
        (&["check", "a.log", "--baseline", "/dev/zero"], 4),
        (&["check", "a.log", "--baseline", "/dev/zero", "--update-baseline"], 2),
        (&["decode", "a.log", "--dbc", "/dev/zero"], 4),
    ] {
        let run = run_in(folder.path(), words, "");
        let expected = "cobscope: /dev/zero: larger than 64 MiB; expected a smaller file\n";
        assert_eq!((run.code, run.stderr.as_str()), (code, expected), "{words:?}");
    }
}

#[test]
fn a_profile_folder_that_is_none_has_one_exit_status() {
    let folder = folder();
    for command in
        ["decode", "check", "why", "stats", "objects", "report", "view", "rules", "diff", "convert"]
    {
        let captures = match command {
            "rules" => &[][..],
            "diff" => &["a.log", "a.log"],
            "convert" => &["a.log", "out.pcapng"],
            _ => &["a.log"],
        };
        let run = run_in(folder.path(), &[&[command, "--profiles", "a.log"], captures].concat(), "");
        let expected = "cobscope: --profiles a.log: not a folder\n";
        assert_eq!((run.code, run.stderr.as_str()), (4, expected), "{command}");
    }
}

#[test]
fn a_misspelt_command_is_named() {
    let folder = folder();
    for (word, meant) in
        [("chek", "check"), ("covnert", "convert"), ("stat", "stats"), ("objcets", "objects")]
    {
        let run = run_in(folder.path(), &[word, "a.log"], "");
        assert_eq!(run.code, 2, "{word}");
        assert!(run.stderr.contains(&format!("a similar subcommand exists: '{meant}'")), "{}", run.stderr);
    }
    // A file with such a name is a capture.
    fs::write(folder.path().join("chek"), BOOT).unwrap();
    assert_eq!(run_in(folder.path(), &["chek"], "").code, 0);
}

#[test]
fn no_message_contains_control_characters_of_a_name() {
    let folder = folder();
    let name = "a\u{1b}[31m\n::error::b\u{9b}c.log";
    let broken = "broken\u{1b}]0;x\u{7}\n.toml";
    fs::write(folder.path().join(name), BOOT).unwrap();
    fs::write(folder.path().join(broken), "a = \n").unwrap();
    let missing = "no\u{1b}[2J\nsuch.log";
    for words in [
        &["decode", missing][..],
        &["check", name, missing],
        &["convert", name, name],
        &["convert", name, "x\u{1b}\n/out.log"],
        &["decode", name, "-o", name],
        &["decode", "--bus", broken, name],
        &["decode", "--dbc", missing, name],
        &["decode", "--node", &format!("5={missing}"), name],
        &["decode", "--frm\u{1b}[2J", name],
        &["profiles", "check", broken],
        &["check", "--baseline", missing, name],
        &["report", name, "-o", "x\u{1b}\n/out.html"],
        &["diff", name, missing],
        &["stats", name],
        &["why", name],
    ] {
        let run = run_in(folder.path(), words, "");
        let is_control = |c: char| c.is_control() && c != '\n';
        assert!(!run.stderr.contains(is_control), "{words:?}: {:?}", run.stderr);
        assert!(!run.stdout.contains(is_control), "{words:?}: {:?}", run.stdout);
        let is_command = |line: &str| line.trim_start().starts_with("::error");
        assert!(!run.stderr.lines().chain(run.stdout.lines()).any(is_command), "{words:?}: {}", run.stderr);
    }
}

#[test]
fn json_contains_no_control_characters_of_a_capture() {
    let folder = tempfile::tempdir().unwrap();
    let name = "can\u{9b}2J\u{7f}\u{202e}\u{61c}";
    let frames = [
        "705#00",
        "705#05",
        "705#05",
        "585#4318100001000000",
        "605#4018100000000000",
        "085#1081010000000000",
        "705#00",
    ];
    let lines = (0..).zip(frames).map(|(second, frame)| format!("(17000000{second:02}.0) {name} {frame}\n"));
    fs::write(folder.path().join("a.log"), lines.collect::<String>()).unwrap();
    for words in [
        &["decode", "-f", "jsonl", "a.log"][..],
        &["check", "-f", "jsonl", "a.log"],
        &["check", "-f", "sarif", "a.log"],
        &["stats", "-f", "json", "a.log"],
        &["why", "-f", "json", "a.log"],
        &["objects", "-f", "json", "a.log"],
        &["diff", "-f", "json", "a.log", "a.log"],
    ] {
        let run = run_in(folder.path(), words, "");
        let is_unsafe = |c: char| c.is_control() && c != '\n' || matches!(c, '\u{202e}' | '\u{61c}');
        assert!(!run.stdout.contains(is_unsafe), "{words:?}: {:?}", run.stdout);
        // Text in JSON is escaped as on a terminal.
        let escaped = ["can\\u009b2J\\u007f\\u202e\\u061c", "can\\\\u{9b}2J\\\\u{7f}\\\\u{202e}\\\\u{61c}"];
        assert!(
            words[0] == "diff" || escaped.iter().any(|name| run.stdout.contains(name)),
            "{words:?}: {}",
            run.stdout
        );
    }
}
