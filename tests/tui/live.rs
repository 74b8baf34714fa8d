//! `cobscope live` without a bus, on standard input and growing files. `tests/live` has the tests of CAN
//! interfaces.
#![cfg(unix)]

use std::fs;
use std::io::{BufRead as _, BufReader, Write as _};
use std::path::PathBuf;
use std::process::{Child, ChildStdin, Command, Stdio};
use std::sync::mpsc::{Receiver, channel};
use std::time::Duration;

use pty_process::blocking::Command as PtyCommand;

use crate::cli::run;
use crate::support::workspace;
use crate::terminal::Session;

/// Time limit for an expected condition on a busy machine.
pub const LIMIT: Duration = Duration::from_mins(1);

/// A fresh folder of this test.
pub fn folder(name: &str) -> PathBuf {
    let path = PathBuf::from(env!("CARGO_TARGET_TMPDIR")).join("live").join(name);
    let _ = fs::remove_dir_all(&path);
    fs::create_dir_all(&path).unwrap();
    path
}

pub fn fixture(name: &str) -> String {
    fs::read_to_string(workspace().join("fixtures").join(name)).unwrap()
}

/// The running program with its lines so far.
pub struct Running {
    pub child: Child,
    lines: Receiver<String>,
}

impl Running {
    pub fn start(arguments: &[&str]) -> Self {
        let mut child = Command::new(env!("CARGO_BIN_EXE_cobscope"))
            .arg("live")
            .args(arguments)
            .current_dir(workspace())
            .stdin(Stdio::piped())
            .stdout(Stdio::piped())
            .stderr(Stdio::piped())
            .spawn()
            .unwrap();
        let output = BufReader::new(child.stdout.take().unwrap());
        let (sender, lines) = channel();
        std::thread::spawn(move || {
            output.lines().map_while(Result::ok).try_for_each(|line| sender.send(line))
        });
        Self { child, lines }
    }

    pub fn input(&mut self) -> &mut ChildStdin {
        self.child.stdin.as_mut().unwrap()
    }

    pub fn line_with(&self, text: &str) -> String {
        let mut before = Vec::new();
        loop {
            let line = self.lines.recv_timeout(LIMIT);
            assert!(line.is_ok(), "no {text} behind {before:#?}");
            let line = line.unwrap();
            if line.contains(text) {
                return line;
            }
            before.push(line);
        }
    }

    /// Exit status, and the text on standard error.
    pub fn end(mut self) -> (Option<i32>, String) {
        drop(self.child.stdin.take());
        let output = self.child.wait_with_output().unwrap();
        (output.status.code(), String::from_utf8(output.stderr).unwrap())
    }
}

#[test]
fn lines_come_as_frames_do() {
    let mut live = Running::start(&["-", "--print"]);
    live.input().write_all(b"(1700000000.000000) can0 701#00\n").unwrap();
    assert!(live.line_with("BOOT").ends_with("{1}"), "while the bus goes on");
    live.input().write_all(b"(1700000000.100000) can0 081#1081010000000000\n").unwrap();
    assert!(live.line_with("EMCY").contains("8110"));
    let (code, stated) = live.end();
    assert_eq!(code, Some(0), "{stated}");
    assert!(stated.contains("can0: up; 0 frames lost"), "{stated}");
}

/// A live bus and its capture give the same events.
#[test]
fn the_same_events_as_of_a_capture() {
    for name in ["canopen/guarding.log", "j1939/mixed.log", "devices/pve.log", "rules/node-lost.log"] {
        let path = format!("fixtures/{name}");
        let decoded = run(&["decode", "-f", "jsonl", &path], "");
        let live = run(&["live", "-", "--print", "-f", "jsonl"], &fixture(name));
        assert!(
            live.stdout == decoded.stdout,
            "{name}: {} of {} bytes",
            live.stdout.len(),
            decoded.stdout.len()
        );
        assert_eq!(live.code, 0);
    }
}

#[test]
fn what_check_says_of_a_capture_live_says_at_the_end() {
    let checked = run(&["check", "fixtures/rules/node-lost.log"], "");
    let live = run(&["live", "-", "--check"], &fixture("rules/node-lost.log"));
    let verdict = live.stdout.split_once("\n== ").unwrap().1;
    let (title, verdict) = verdict.split_once('\n').unwrap();
    assert_eq!(title, "can0 (14 frames, 2.000 s)");
    let expected = checked.stdout.split_once('\n').unwrap().1;
    let width = |text: &str| text.split_whitespace().map(ToOwned::to_owned).collect::<Vec<_>>().join(" ");
    assert_eq!(width(verdict), width(&expected.replace("fixtures/rules/node-lost.log", "can0")));
    assert_eq!((live.code, checked.code), (1, 1));
    let clean = run(&["live", "-", "--check"], &fixture("rules/clean/canopen.log"));
    assert_eq!(clean.code, 0, "{}", clean.stdout);
}

#[test]
fn it_can_end_at_the_first_finding() {
    let mut live = Running::start(&["-", "--check", "--until-finding"]);
    // The input stays open: the program ends by itself.
    live.input().write_all(fixture("rules/node-lost.log").as_bytes()).unwrap();
    assert!(live.line_with("[node-lost]").contains("LATE"));
    live.line_with("1 capture: 1 failed");
    assert_eq!(live.child.wait().unwrap().code(), Some(1));
}

/// The first error of machine.log is the refused write {45-46}: nothing later has a part in output and report, however
/// much of the input was already read.
#[test]
fn the_first_finding_is_the_end_to_the_frame() {
    let all = fixture("machine/machine.log");
    let part: Vec<&str> = all.lines().take(46).collect();
    let folder = folder("until");
    let path = folder.join("run.log");
    fs::write(&path, &all).unwrap();
    let path = path.to_str().unwrap();
    for more in [&[][..], &["--print"], &["-f", "jsonl"], &["--print", "-f", "jsonl", "--all"]] {
        let command = |own: &[&str], input: &str| run(&[&["live", "--check"], own, more].concat(), input);
        let expected = command(&["-"], &(part.join("\n") + "\n"));
        let ended = command(&["-", "--until-finding"], &all);
        assert!(ended.stdout == expected.stdout, "{more:?}: {}\n{}", ended.stdout, expected.stdout);
        assert_eq!((ended.code, expected.code), (1, 1));
        let followed = command(&["--follow", path, "--until-finding"], "");
        assert!(followed.stdout == expected.stdout, "{more:?}: {}", followed.stdout);
    }
    let ended = run(&["live", "--check", "--until-finding", "-"], &all);
    assert!(ended.stdout.contains("\n== can0 (46 frames, 10.361 s)\n"), "{}", ended.stdout);
    // No error of this one is at or above the severity: all is read.
    let clean = run(&["live", "--check", "--until-finding", "-"], &fixture("rules/clean/canopen.log"));
    assert_eq!(clean.code, 0, "{}", clean.stdout);
}

/// A window of a trigger is completed before the end: its frames are judged, too.
#[test]
fn a_window_is_completed_after_the_first_finding() {
    let folder = folder("until-window");
    let record = folder.to_str().unwrap();
    let trigger = ["--trigger-finding", "sdo-download-refused", "--after", "1s", "--record", record];
    let arguments = [&["live", "--check", "--until-finding", "-"], &trigger[..]].concat();
    let all = fixture("machine/machine.log");
    let ended = run(&arguments, &all);
    assert_eq!(ended.code, 1, "{}", ended.stderr);
    // The first frame later than 10.361 s + 1 s closes the window; it is the last counted frame.
    let title = ended.stdout.lines().find(|line| line.starts_with("== can0 (")).unwrap();
    let count: usize = title.trim_start_matches("== can0 (").split(' ').next().unwrap().parse().unwrap();
    let lines: Vec<&str> = all.lines().collect();
    let time = |line: &str| line[1..].split(')').next().unwrap().parse::<f64>().unwrap();
    let end = time(lines[45]) + 1.0;
    assert!(time(lines[count - 2]) <= end && end < time(lines[count - 1]), "{title}");
}

/// The report names the bus, whichever option ends it.
#[test]
fn the_report_has_the_name_of_the_bus_however_it_ends() {
    let all = fixture("machine/machine.log");
    for (end, frames) in [(&["-n", "60"][..], "60 frames"), (&["--until-finding"], "46 frames")] {
        let live = run(&[&["live", "--check", "-"], end].concat(), &all);
        assert!(live.stdout.contains(&format!("\n== can0 ({frames}, ")), "{end:?}: {}", live.stdout);
        assert!(live.stdout.contains("\ncan0          1 "), "{end:?}: {}", live.stdout);
        assert!(live.stderr.contains("can0: up; 0 frames lost\n"), "{end:?}: {}", live.stderr);
        let json = run(&[&["live", "--check", "-f", "jsonl", "-"], end].concat(), &all).stdout;
        assert!(json.contains("\"capture\":\"can0\"") && !json.contains("\"capture\":\"\""), "{json}");
    }
    let folder = folder("names");
    let path = folder.join("run.log");
    fs::write(&path, "(1700000000.000000) can0 701#00\n").unwrap();
    let path = path.to_str().unwrap();
    // The name in the table, which is the last row of it.
    let name = |stdout: &str| {
        let row = stdout.lines().rev().nth(1).unwrap_or_default();
        row.split("  ").next().unwrap_or_default().to_owned()
    };
    // On a busy machine, the first frame is read long after the start.
    let followed = run(&["live", "--check", "--follow", path, "-T", "3000"], "");
    assert_eq!(name(&followed.stdout), "can0", "{}", followed.stdout);
    let mut open = Running::start(&["--check", "-", "-T", "3000"]);
    open.input().write_all(b"(1700000000.000000) can0 701#00\n").unwrap();
    open.line_with("can0          0 ");
    assert_eq!(open.child.wait().unwrap().code(), Some(0), "the input is still open");
    // can1 has no frame before the end.
    let two = "(1700000000.000000) can0 701#00\n(1700000001.000000) can1 701#00\n";
    let both = run(&["live", "--check", "-"], two);
    assert_eq!(name(&both.stdout), "can0 can1", "{}", both.stdout);
    let one = run(&["live", "--check", "-", "-n", "1"], two);
    assert_eq!(name(&one.stdout), "can0", "{}", one.stdout);
    // Without any frame, the report names the source, and nothing was checked.
    let none = run(&["live", "--check", "-"], "");
    assert_eq!(name(&none.stdout), "-", "{}", none.stdout);
    assert_eq!(none.code, 3, "{}", none.stderr);
    assert!(none.stderr.contains("cobscope: -: contains no frames\n"), "{}", none.stderr);
    assert_eq!(run(&["live", "--print", "--fail-on", "error", "-"], two).code, 2);
    assert_eq!(run(&["live", "--print", "-T", "0", "-"], two).code, 2);
}

#[test]
fn it_ends_after_frames_and_after_silence() {
    let live =
        run(&["live", "-", "--print", "-f", "jsonl", "--all", "-n", "5"], &fixture("canopen/guarding.log"));
    assert!(live.stdout.lines().all(|line| !line.contains("\"frames\":[6")), "{}", live.stdout);
    let mut live = Running::start(&["-", "--print", "-T", "50"]);
    live.input().write_all(b"(1700000000.000000) can0 701#00\n").unwrap();
    assert_eq!(live.child.wait().unwrap().code(), Some(0), "the input is still open");
}

#[test]
fn a_record_contains_all_received_frames() {
    let folder = folder("record");
    for suffix in ["log", "pcapng"] {
        let path = folder.join(format!("run.{suffix}"));
        let path = path.to_str().unwrap();
        let text = fixture("devices/md2.log");
        let live = run(&["live", "-", "--print", "-f", "none", "--record", path], &text);
        assert_eq!(live.code, 0, "{}", live.stderr);
        assert!(live.stderr.contains(&format!("recorded {path}: ")), "{}", live.stderr);
        let of = |path: &str| run(&["decode", "-f", "jsonl", path], "").stdout;
        assert!(of(path) == of("fixtures/devices/md2.log"), "{suffix}");
        let again = run(&["live", "-", "--print", "--record", path], &text);
        assert_eq!(again.code, 2, "nothing is ever written over");
    }
}

/// A file that may not grow beyond 4 or 8 KiB: later frames are missing, and the exit status shows it.
#[test]
fn frames_missing_in_a_record_are_an_error() {
    let folder = folder("limited");
    let path = folder.join("run.log");
    let frames: Vec<_> = (0..1_000).map(|n| format!("(1700000000.{n:06}) can0 123#{n:08X}\n")).collect();
    let frames = frames.concat();
    let script = "trap '' XFSZ; ulimit -f 8; exec \"$0\" live - --print -f none --record \"$1\"";
    let mut command = Command::new("sh");
    command.args(["-c", script, env!("CARGO_BIN_EXE_cobscope"), path.to_str().unwrap()]);
    let mut child = command.stdin(Stdio::piped()).stderr(Stdio::piped()).spawn().unwrap();
    child.stdin.take().unwrap().write_all(frames.as_bytes()).unwrap();
    let output = child.wait_with_output().unwrap();
    let stated = String::from_utf8(output.stderr).unwrap();
    assert_eq!(output.status.code(), Some(3), "{stated}");
    let text = fs::read_to_string(&path).unwrap();
    assert!(text.ends_with('\n') && frames.starts_with(&text), "complete lines");
    let missing = 1_000 - text.lines().count();
    assert!((700..900).contains(&missing), "{missing}");
    let (path, missing) = (path.display(), format!("{missing} frames"));
    assert!(
        stated.contains(&format!("{path}: File too large (os error 27): {missing} not written\n")),
        "{stated}"
    );
    assert!(stated.contains(&format!("; {missing} missing\n")), "{stated}");
}

/// Ctrl-C ends the program after everything is printed and written.
#[test]
fn an_interrupt_ends_it_well() {
    let folder = folder("interrupt");
    let path = folder.join("run.log");
    let mut live = Running::start(&["-", "--print", "--record", path.to_str().unwrap()]);
    live.input().write_all(b"(1700000000.000000) can0 701#00\n").unwrap();
    live.line_with("BOOT");
    let id = live.child.id().to_string();
    assert!(Command::new("kill").args(["-INT", &id]).status().unwrap().success());
    let (code, stated) = live.end();
    assert_eq!(code, Some(0), "{stated}");
    assert_eq!(fs::read_to_string(&path).unwrap(), "(1700000000.000000) can0 701#00\n");
}

#[test]
fn a_growing_file_is_followed() {
    let folder = folder("follow");
    let path = folder.join("run.log");
    fs::write(&path, "(1700000000.000000) can0 701#00\n").unwrap();
    let live = Running::start(&["--follow", path.to_str().unwrap(), "--print"]);
    live.line_with("BOOT");
    let mut file = fs::OpenOptions::new().append(true).open(&path).unwrap();
    file.write_all(b"(1700000000.100000) can0 081#1081010000000000\n").unwrap();
    live.line_with("EMCY");
    let mut child = live.child;
    child.kill().unwrap();
    child.wait().unwrap();
}

/// The formats that the help lists are read while they grow.
#[test]
fn files_of_several_formats_are_followed() {
    let folder = folder("follow-formats");
    for suffix in ["log", "trc", "asc", "csv", "pcapng", "mcap"] {
        if suffix == "mcap" && !cfg!(feature = "mcap") {
            continue;
        }
        let whole = folder.join(format!("whole.{suffix}"));
        let whole = whole.to_str().unwrap();
        let converted = run(&["convert", "fixtures/devices/md2.log", whole], "");
        assert_eq!(converted.code, 0, "{suffix}: {}", converted.stderr);
        let print = ["-f", "jsonl", "--all", "--no-findings"];
        let decoded = run(&[&["decode", whole], &print[..]].concat(), "");
        let (first, last) = (decoded.stdout.lines().next().unwrap(), decoded.stdout.lines().last().unwrap());
        let data = fs::read(whole).unwrap();
        let (begin, end) = data.split_at(data.len() / 2);
        let path = folder.join(format!("run.{suffix}"));
        fs::write(&path, begin).unwrap();
        let name = path.to_str().unwrap();
        let mut live = Running::start(&[&["--follow", name, "--print"], &print[..]].concat());
        live.line_with(first);
        fs::OpenOptions::new().append(true).open(&path).unwrap().write_all(end).unwrap();
        live.line_with(last);
        live.child.kill().unwrap();
        live.child.wait().unwrap();
    }
}

#[test]
fn an_unusable_source_is_reported_with_a_remedy() {
    let refused = |arguments: &[&str], code: i32, text: &str| {
        let output = run(&[&["live"], arguments].concat(), "");
        assert_eq!(output.code, code, "{arguments:?}: {}", output.stderr);
        assert!(output.stderr.contains(text), "{arguments:?}: {}", output.stderr);
    };
    refused(&["fixtures/devices/md2.log", "--print"], 2, "--follow");
    refused(&["can0,123", "--print"], 2, "expected ID:MASK");
    refused(&["slcan:/dev/no-such-adapter", "--print"], 3, "no-such-adapter");
    let reason = if cfg!(feature = "serial") { "123" } else { "this build cannot open serial adapters" };
    refused(&["slcan:/dev/null@123", "--print"], 3, reason);
    refused(&["-", "--print", "--record", "/no/such/folder/x.log"], 2, "/no/such/folder");
    refused(&["-", "--print", "--record", "x.txt"], 2, ".pcapng");
    refused(&["-", "--record-size", "1M", "--print"], 2, "--record");
    refused(&["-", "--print", "--record", "x.log", "--record-size", "10"], 2, "expected 64k or more");
    refused(&["-"], 2, "--print");
}

/// While frames arrive, the screen follows them, stops on request, and follows again.
#[test]
fn on_the_screen_it_follows_pauses_and_continues() {
    let folder = folder("screen");
    let (pipe, record) = (folder.join("bus"), folder.join("run.pcapng"));
    assert!(Command::new("mkfifo").arg(&pipe).status().unwrap().success());
    let program = env!("CARGO_BIN_EXE_cobscope");
    let (pipe, record) = (pipe.to_str().unwrap(), record.to_str().unwrap());
    let script = format!("{program} live - --all --record {record} < {pipe}");
    let session =
        Session::start(PtyCommand::new("sh").args(["-c", &script]).current_dir(workspace()), 24, 100);
    let mut bus = fs::OpenOptions::new().write(true).open(pipe).unwrap();
    let frame = |second: u32| format!("(170000000{second}.000000) can0 701#05\n");
    session.wait_text("following");
    bus.write_all(frame(0).as_bytes()).unwrap();
    session.wait_text("#1/1");
    bus.write_all(frame(1).as_bytes()).unwrap();
    session.wait_text("#2/2");
    session.send(" ");
    session.wait("pause", |screen| !screen.contains("following"));
    bus.write_all(frame(2).as_bytes()).unwrap();
    session.wait_text("#2/3");
    session.send(" ");
    session.wait_text("#3/3");
    session.wait_text("REC ");
    drop(bus);
    session.send("q");
    assert!(session.wait_end().success());
    let read = run(&["decode", "-f", "jsonl", "--all", record], "");
    assert_eq!(read.stdout.matches("\"kind\":\"heartbeat\"").count(), 3, "{}", read.stdout);
}
