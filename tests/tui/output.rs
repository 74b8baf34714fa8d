//! Output files: inputs are never overwritten, and write errors are reported.
#![cfg(unix)]

use std::fs;
use std::os::unix::fs::symlink;
use std::process::{Command, Stdio};

use crate::cli::{run, run_in};
use crate::support::workspace;

const BOOT: &str = "(1700000000.000000) can0 705#00\n(1700000000.100000) can0 705#05\n";

#[test]
fn no_output_goes_over_what_is_read() {
    let folder = tempfile::tempdir().unwrap();
    let path = |name: &str| folder.path().join(name);
    fs::create_dir(path("captures")).unwrap();
    for name in ["g.log", "w.log", "captures/a.log"] {
        fs::write(path(name), BOOT).unwrap();
    }
    fs::write(path("bus.toml"), "[node.5]\nname = 'pump'\n").unwrap();
    fs::copy(workspace().join("fixtures/device_files/valve.eds"), path("valve.eds")).unwrap();
    fs::copy(workspace().join("fixtures/dbc/signals.dbc"), path("signals.dbc")).unwrap();
    fs::write(path("named.toml"), "dbc = 'signals.dbc'\n[node.5]\neds = 'valve.eds'\n").unwrap();
    fs::hard_link(path("g.log"), path("twin.log")).unwrap();
    symlink("g.log", path("link.log")).unwrap();
    symlink("g.log", path("run.events.parquet")).unwrap();
    let refused = [
        &["decode", "-o", "g.log", "g.log"][..],
        &["decode", "-o", "./twin.log", "w.log", "g.log"],
        &["decode", "-o", "link.log", "g.log"],
        &["decode", "-f", "mcap", "-o", "g.log", "g.log"],
        &["decode", "-f", "parquet", "-o", "run", "g.log"],
        &["decode", "--bus", "bus.toml", "-o", "bus.toml", "g.log"],
        &["decode", "--bus", "named.toml", "-o", "valve.eds", "g.log"],
        &["check", "--bus", "named.toml", "-o", "signals.dbc", "g.log"],
        &["convert", "--force", "--bus", "named.toml", "-f", "candump", "g.log", "valve.eds"],
        &["check", "-o", "g.log", "g.log"],
        &["check", "-o", "captures/a.log", "captures"],
        &["check", "--baseline", "w.log", "--update-baseline", "w.log"],
        &["check", "--baseline", "captures/a.log", "--update-baseline", "captures"],
        &["convert", "--force", "--bus", "bus.toml", "-f", "candump", "g.log", "bus.toml"],
        &["live", "--print", "--follow", "-o", "g.log", "g.log"],
    ];
    for words in refused {
        if cfg!(not(all(feature = "mcap", feature = "parquet"))) && words.contains(&"-f") {
            continue;
        }
        let output = run_in(folder.path(), words, "");
        assert_eq!(output.code, 2, "{words:?}: {}", output.stderr);
        assert!(
            output.stderr.contains(": is also an input; choose another output file\n"),
            "{words:?}: {}",
            output.stderr
        );
        for name in ["g.log", "w.log", "captures/a.log"] {
            assert_eq!(fs::read_to_string(path(name)).unwrap(), BOOT, "{words:?}: {name}");
        }
    }
    // Standard input may be the same file.
    let mut decode = Command::new(env!("CARGO_BIN_EXE_cobscope"));
    decode.current_dir(folder.path()).args(["decode", "-o", "g.log"]);
    let output = decode.stdin(fs::File::open(path("g.log")).unwrap()).output().unwrap();
    assert_eq!(output.status.code(), Some(2));
    assert_eq!(fs::read_to_string(path("g.log")).unwrap(), BOOT);
}

/// A recorder that was switched off: everything before the last record is read, and the capture counts as
/// truncated.
#[test]
fn captures_cut_off_inside_a_record_are_not_read_to_their_end() {
    let folder = tempfile::tempdir().unwrap();
    let converted = |name: &str| {
        let output = run_in(folder.path(), &["convert", "whole.log", name], "");
        assert_eq!(output.code, 0, "{}", output.stderr);
        fs::read(folder.path().join(name)).unwrap()
    };
    let recorded = |name: &str| fs::read(workspace().join("fixtures/recorders").join(name)).unwrap();
    fs::write(folder.path().join("whole.log"), BOOT.repeat(3)).unwrap();
    let captures = [
        ("pcapng", converted("a.pcapng")),
        ("blf", recorded("stored.blf")),
        ("mf4", recorded("unsorted.mf4")),
    ];
    for (end, bytes) in captures {
        for (name, missing, code) in [("whole", 0, 0), ("cut", 3, 3)] {
            let name = format!("{name}.{end}");
            fs::write(folder.path().join(&name), &bytes[..bytes.len() - missing]).unwrap();
            for command in [&["decode"][..], &["check", "--fail-on", "never"], &["stats"]] {
                let output = run_in(folder.path(), &[command, &[&name]].concat(), "");
                assert_eq!(output.code, code, "{command:?} {name}: {}", output.stderr);
                let is_stated = output.stderr.contains(&format!("cobscope: {name}: byte "));
                assert_eq!(is_stated, code == 3, "{command:?} {name}: {}", output.stderr);
                let is_event = output.stdout.contains("UNREAD");
                assert!(command != ["decode"] || is_event == is_stated, "{name}: {}", output.stdout);
            }
        }
    }
    // A truncated line of text is treated like any other line.
    fs::write(folder.path().join("cut.log"), BOOT.repeat(3).trim_end().trim_end_matches("00")).unwrap();
    assert_eq!(run_in(folder.path(), &["decode", "cut.log"], "").code, 0);
}

#[test]
fn a_report_may_lie_in_the_folder() {
    let folder = tempfile::tempdir().unwrap();
    let path = |name: &str| folder.path().join(name);
    fs::create_dir(path("captures")).unwrap();
    fs::write(path("captures/a.log"), BOOT).unwrap();
    let words = [
        "check",
        "-f",
        "junit",
        "-o",
        "captures/report.xml",
        "--baseline",
        "captures/known.json",
        "--update-baseline",
        "captures",
    ];
    for _ in 0..2 {
        let output = run_in(folder.path(), &words, "");
        assert_eq!((output.code, output.stderr.as_str()), (0, ""));
    }
    assert!(fs::read_to_string(path("captures/report.xml")).unwrap().starts_with("<?xml"));
}

#[test]
fn a_full_disk_is_reported_by_every_command() {
    let full = || Stdio::from(fs::OpenOptions::new().write(true).open("/dev/full").unwrap());
    let commands = [
        &["stats", "fixtures/canopen/emcy.log"][..],
        &["objects", "fixtures/canopen/sdo_expedited.log"],
        &["why", "fixtures/canopen/emcy.log"],
        &["decode", "fixtures/canopen/emcy.log"],
        &["check", "fixtures/canopen/emcy.log"],
        &["rules"],
        &["explain", "8130"],
        &["explain", "node-lost"],
        &["profiles", "list"],
        &["profiles", "show", "rexroth-sydfec"],
        &["completions", "bash"],
        &["man"],
    ];
    for words in commands {
        let mut command = Command::new(env!("CARGO_BIN_EXE_cobscope"));
        let output = command.args(words).current_dir(workspace()).stdout(full()).output().unwrap();
        let stderr = String::from_utf8(output.stderr).unwrap();
        assert_eq!(output.status.code(), Some(3), "{words:?}: {stderr}");
        assert!(stderr.contains("cobscope: stdout: No space left on device"), "{words:?}: {stderr}");
    }
    let named = run(&["check", "-o", "/dev/full", "fixtures/canopen/emcy.log"], "");
    assert_eq!(named.code, 3);
    assert!(named.stderr.contains("cobscope: /dev/full: No space left on device"), "{}", named.stderr);
}

#[test]
fn a_closed_pipe_is_no_failure() {
    for words in [&["rules"][..], &["stats", "fixtures/canopen/emcy.log"], &["man"]] {
        let mut command = Command::new(env!("CARGO_BIN_EXE_cobscope"));
        command.args(words).current_dir(workspace()).stdout(Stdio::piped()).stderr(Stdio::piped());
        let (reader, writer) = std::io::pipe().unwrap();
        drop(reader);
        let output = command.stdout(Stdio::from(writer)).output().unwrap();
        assert_eq!((output.status.code(), output.stderr.as_slice()), (Some(0), &b""[..]), "{words:?}");
    }
}
