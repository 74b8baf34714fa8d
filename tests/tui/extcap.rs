//! Wireshark uses the program as an extcap interface: sentences, frames with comments through a pipe, and tshark itself.
#![cfg(unix)]

use std::fs::{self, OpenOptions};
use std::io::{BufRead as _, BufReader, Read as _, Write as _};
use std::path::Path;
use std::process::{Child, Command, Stdio};
use std::thread;
use std::time::{Duration, Instant};

use crate::cli::{run, run_in};
use crate::support::{self, workspace};

const PROGRAM: &str = env!("CARGO_BIN_EXE_cobscope");
const BOOT: &str = "(1700000000.000000) can0 705#00\n(1700000000.100000) can0 705#05\n";

#[test]
fn sentences_describe_the_interfaces() {
    let reported = run(&["--extcap-interfaces", "--extcap-version=4.0"], "");
    assert_eq!((reported.code, reported.stderr.as_str()), (0, ""));
    let lines: Vec<&str> = reported.stdout.lines().collect();
    assert!(lines[0].starts_with("extcap {version="), "{}", reported.stdout);
    assert_eq!(lines[1], "interface {value=cobscope-file}{display=cobscope: a capture in any format}");
    let types = run(&["--extcap-dlts", "--extcap-interface", "cobscope-file"], "");
    assert!(types.stdout.starts_with("dlt {number=227}{name="), "{}", types.stdout);
    let options = run(&["--extcap-config", "--extcap-interface", "cobscope-source"], "");
    assert!(options.stdout.starts_with("arg {number=0}{call=--source}"), "{}", options.stdout);
    // Each sentence is one line of parts in braces.
    for line in [reported, types, options].iter().flat_map(|reported| reported.stdout.lines()) {
        let parts = line.split_once(' ').unwrap().1;
        assert!(parts.starts_with('{') && parts.ends_with('}'), "{line}");
        assert_eq!(parts.matches('{').count(), parts.matches('}').count(), "{line}");
    }
}

#[test]
fn calls_with_errors_are_reported() {
    for (words, expected) in [
        (&["--extcap-dlts"][..], "--extcap-interface is missing"),
        (&["--extcap-config", "--extcap-interface", "eth0"], "--extcap-interface eth0: unknown"),
        (&["--capture", "--extcap-interface", "cobscope-file"], "--fifo is missing"),
        (&["--capture", "--extcap-interface", "cobscope-file", "--fifo", "/dev/null"], "no capture selected"),
        (&["--capture", "--extcap-interface", "cobscope-source", "--fifo", "/dev/null"], "no source given"),
    ] {
        let reported = run(words, "");
        assert_eq!(reported.code, 2, "{words:?}");
        assert!(reported.stderr.contains(expected), "{words:?}: {}", reported.stderr);
    }
    // No output means a valid filter.
    let verdict =
        |filter| run(&["--extcap-interface", "cobscope-file", "--extcap-capture-filter", filter], "").stdout;
    assert_eq!(verdict("kind == emcy && node == 5"), "");
    assert!(verdict("kind == emcyy").starts_with("unknown kind 'emcyy'; did you mean emcy?"));
}

/// A pipe with a name, as Wireshark creates it.
fn pipe(folder: &Path) -> String {
    let path = folder.join("pipe").to_str().unwrap().to_owned();
    assert!(Command::new("mkfifo").arg(&path).status().unwrap().success());
    path
}

#[test]
fn a_capture_goes_through_the_pipe_with_its_meaning() {
    let folder = tempfile::tempdir().unwrap();
    fs::write(folder.path().join("a.log"), BOOT).unwrap();
    let pipe = pipe(folder.path());
    let words = [
        "--capture",
        "--extcap-interface",
        "cobscope-file",
        "--fifo",
        &pipe,
        "--file",
        "a.log",
        "--node",
        "",
    ];
    let mut writer = Command::new(PROGRAM).args(words).current_dir(folder.path()).spawn().unwrap();
    let bytes = fs::read(&pipe).unwrap();
    assert!(writer.wait().unwrap().success());
    assert!(bytes.windows(8).any(|part| part == b"5/05 BOO"), "no comment");
    fs::write(folder.path().join("a.pcapng"), bytes).unwrap();
    let decode = |capture| run_in(folder.path(), &["decode", "-f", "jsonl", capture], "").stdout;
    assert_eq!(decode("a.pcapng"), decode("a.log"));
    // The pipe is not a file: nothing else was created.
    assert!(!folder.path().join("pipe.part").exists());
}

#[test]
fn a_recording_is_a_stream_on_stdout_and_in_a_pipe() {
    let folder = tempfile::tempdir().unwrap();
    fs::write(folder.path().join("a.log"), BOOT).unwrap();
    let pipe = pipe(folder.path());
    for (target, is_pipe) in [("-", false), (pipe.as_str(), true)] {
        let mut live = Command::new(PROGRAM);
        live.args(["live", "-", "--record", target])
            .stdin(fs::File::open(folder.path().join("a.log")).unwrap());
        let child = live.stdout(Stdio::piped()).stderr(Stdio::null()).spawn().unwrap();
        let bytes = if is_pipe { fs::read(&pipe).unwrap() } else { Vec::new() };
        let output = child.wait_with_output().unwrap();
        assert!(output.status.success(), "{target}");
        let bytes = if is_pipe { bytes } else { output.stdout };
        fs::write(folder.path().join("a.pcapng"), bytes).unwrap();
        let decoded = run_in(folder.path(), &["decode", "-f", "jsonl", "a.pcapng"], "").stdout;
        let kinds = ["boot-up", "heartbeat"].map(|kind| decoded.contains(&format!("\"kind\":\"{kind}\"")));
        assert_eq!(kinds, [true; 2], "{target}: {decoded}");
    }
    let refused = run(&["live", "-", "--record", "-", "--print"], BOOT);
    assert_eq!(refused.code, 2);
    assert!(
        refused.stderr.contains("--record -: the stream needs a command of its own"),
        "{}",
        refused.stderr
    );
}

#[test]
fn the_link_replaces_links_only() {
    let folder = tempfile::tempdir().unwrap();
    let install = || run_in(folder.path(), &["extcap", "--install", "--dir", "extcap"], "");
    // A misspelt folder is not created.
    let missing = install();
    let text = "cobscope: extcap/cobscope: folder extcap does not exist; create it first\n";
    assert_eq!((missing.code, missing.stderr.as_str()), (2, text));
    assert!(!folder.path().join("extcap").exists());
    fs::create_dir(folder.path().join("extcap")).unwrap();
    for _ in 0..2 {
        assert_eq!(install().code, 0);
        assert_eq!(fs::read_link(folder.path().join("extcap/cobscope")).unwrap(), Path::new(PROGRAM));
    }
    fs::remove_file(folder.path().join("extcap/cobscope")).unwrap();
    fs::write(folder.path().join("extcap/cobscope"), "mine").unwrap();
    let refused = install();
    assert_eq!(
        (refused.code, refused.stderr.as_str()),
        (2, "cobscope: extcap/cobscope: file exists; remove it first\n")
    );
}

/// tshark of a user with this home folder; `None` without tshark.
fn tshark(home: &Path) -> Option<Command> {
    if Command::new("tshark").arg("-v").output().is_err() {
        support::skip("tshark", "the program is missing");
        return None;
    }
    let mut command = Command::new("tshark");
    command.env("HOME", home).env("XDG_CONFIG_HOME", home.join(".config"));
    Some(command)
}

/// Home folder of a user who installed the link.
fn home() -> tempfile::TempDir {
    let home = tempfile::tempdir().unwrap();
    let mut install = Command::new(PROGRAM);
    install
        .args(["extcap", "--install"])
        .env("HOME", home.path())
        .env("XDG_CONFIG_HOME", home.path().join(".config"));
    assert!(install.stderr(Stdio::null()).status().unwrap().success());
    home
}

#[test]
fn tshark_lists_the_interfaces_and_captures_a_file() {
    let home = home();
    let Some(mut list) = tshark(home.path()) else { return };
    let listed = String::from_utf8(list.arg("-D").output().unwrap().stdout).unwrap();
    for name in ["cobscope-file (cobscope: a capture in any format)", "cobscope-source (cobscope: "] {
        assert!(listed.contains(name), "{listed}");
    }
    let capture = workspace().join("fixtures/devices/pve.log");
    let mut command = tshark(home.path()).unwrap();
    command.args(["-i", "cobscope-file", "-c", "104", "-T", "fields", "-e", "can.id", "-e", "frame.comment"]);
    command.args(["-o", &format!("extcap.cobscope_file.file:{}", capture.display())]);
    command.args(["-o", "extcap.cobscope_file.node:32=danfoss-pve-ci"]);
    let output = command.output().unwrap();
    let text = String::from_utf8(output.stdout).unwrap();
    assert_eq!(text.lines().count(), 104, "{}", String::from_utf8_lossy(&output.stderr));
    let end = text.lines().last().unwrap();
    assert!(end.starts_with("160\t32/20 EMCY 8305 spool position error → FAULT HOLD"), "{end}");
}

/// Ends a process at the end of the test.
struct Ended(Child);

impl Ended {
    /// Waits until the process ends by itself.
    fn code(&mut self) -> Option<i32> {
        let begin = Instant::now();
        loop {
            if let Some(status) = self.0.try_wait().unwrap() {
                return status.code();
            }
            assert!(begin.elapsed() < Duration::from_mins(1), "does not end");
            thread::sleep(Duration::from_millis(20));
        }
    }
}

impl Drop for Ended {
    fn drop(&mut self) {
        // SIGTERM: a killed tshark leaves dumpcap and its extcap program running.
        let _ = Command::new("kill").arg(self.0.id().to_string()).status();
        let _ = self.0.wait();
    }
}

#[test]
fn tshark_shows_frames_as_they_come() {
    let home = home();
    let Some(mut command) = tshark(home.path()) else { return };
    let log = home.path().join("grow.log");
    fs::write(&log, BOOT).unwrap();
    command.args(["-l", "-i", "cobscope-source", "-T", "fields", "-e", "frame.comment"]);
    command.args(["-o", &format!("extcap.cobscope_source.source:{}", log.display())]);
    command.stdout(Stdio::piped()).stderr(Stdio::null());
    let mut process = Ended(command.spawn().unwrap());
    let mut lines = BufReader::new(process.0.stdout.take().unwrap()).lines().map(Result::unwrap);
    assert!(lines.next().unwrap().starts_with("5/05 BOOT"));
    assert!(lines.next().unwrap().starts_with("5/05 HB operational"));
    let mut file = OpenOptions::new().append(true).open(&log).unwrap();
    file.write_all(b"(1700000000.200000) can0 085#1081010000000000\n").unwrap();
    assert!(lines.next().unwrap().starts_with("5/05 EMCY 8110 "));
}

#[test]
fn a_stream_of_a_silent_bus_ends_with_its_reader() {
    let folder = tempfile::tempdir().unwrap();
    let log = folder.path().join("silent.log");
    fs::write(&log, BOOT).unwrap();
    let mut command = Command::new(PROGRAM);
    command.args(["live", "--record", "-", "--follow"]).arg(&log);
    command.stdout(Stdio::piped()).stderr(Stdio::null());
    let mut process = Ended(command.spawn().unwrap());
    // Both frames are read: a later write would notice that the reader is gone.
    let mut output = process.0.stdout.take().unwrap();
    let mut frames = 0;
    while frames < 2 {
        let mut head = [0; 8];
        output.read_exact(&mut head).unwrap();
        let size = u32::from_le_bytes(head[4..].try_into().unwrap());
        let mut rest = vec![0; usize::try_from(size).unwrap() - head.len()];
        output.read_exact(&mut rest).unwrap();
        // Enhanced Packet Block.
        frames += u32::from(head[..4] == [6, 0, 0, 0]);
    }
    drop(output);
    assert_eq!(process.code(), Some(0));
}
