//! Behaviour that only Windows has: names of devices, drives, wildcards, long paths, shared files, named pipes.
#![cfg(windows)]
#![expect(clippy::unwrap_used, reason = "a test that cannot go on has failed")]

#[path = "../tui/adapters.rs"]
mod adapters;
#[path = "../support/mod.rs"]
mod support;

use std::ffi::OsStr;
use std::fs::{self, File};
use std::io::{Read as _, Write as _};
use std::os::windows::fs::OpenOptionsExt as _;
use std::path::{Path, PathBuf};
use std::process::{Command, Output, Stdio};

const PROGRAM: &str = env!("CARGO_BIN_EXE_cobscope");

/// Boot-up and a heartbeat of node 5.
const BOOT: &str = "(1700000000.000000) can0 705#00\n(1700000000.100000) can0 705#05\n";

fn cobscope<S: AsRef<OsStr>>(folder: &Path, words: &[S]) -> Output {
    Command::new(PROGRAM).args(words).current_dir(folder).stdin(Stdio::null()).output().unwrap()
}

fn stdout(output: &Output) -> String {
    String::from_utf8(output.stdout.clone()).unwrap()
}

fn stderr(output: &Output) -> String {
    String::from_utf8(output.stderr.clone()).unwrap()
}

/// A folder with `a.log`.
fn folder() -> (tempfile::TempDir, PathBuf) {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().to_owned();
    fs::write(path.join("a.log"), BOOT).unwrap();
    (folder, path)
}

fn names(folder: &Path) -> Vec<String> {
    let mut names: Vec<_> = fs::read_dir(folder)
        .unwrap()
        .map(|entry| entry.unwrap().file_name().into_string().unwrap())
        .collect();
    names.sort();
    names
}

#[test]
fn an_output_can_be_a_device_but_not_by_mistake() {
    let (_kept, folder) = folder();
    for device in ["NUL", "nul", r"sub\..\NUL"] {
        for command in ["decode", "convert", "check"] {
            let words: &[&str] = match command {
                "convert" => &["convert", "-f", "candump", "a.log", device],
                command => &[command, "a.log", "-o", device],
            };
            let output = cobscope(&folder, words);
            assert_eq!(output.status.code(), Some(0), "{words:?}: {}", stderr(&output));
        }
    }
    for name in ["con.log", "aux.csv", "COM1.log"] {
        let output = cobscope(&folder, &["convert", "-f", "candump", "a.log", name]);
        let expected =
            format!("cobscope: {name}: cannot be created: name of a device; choose another file name\n");
        assert_eq!((output.status.code(), stderr(&output)), (Some(2), expected));
    }
    assert_eq!(names(&folder), ["a.log"]);
}

#[test]
fn drives_and_forward_slashes_are_paths() {
    let (_kept, folder) = folder();
    let expected = stdout(&cobscope(&folder, &["decode", "a.log"]));
    assert!(expected.contains("BOOT"), "{expected}");
    let whole = folder.join("a.log");
    let drive = whole.to_str().unwrap().get(..2).unwrap();
    assert!(drive.ends_with(':'), "{drive}");
    for path in [
        whole.to_str().unwrap(),
        &whole.to_str().unwrap().replace('\\', "/"),
        &format!("{drive}a.log"),
        r".\a.log",
    ] {
        let output = cobscope(&folder, &["decode", path]);
        assert_eq!(stdout(&output), expected, "{path}: {}", stderr(&output));
        let live = cobscope(&folder, &["live", "--follow", "--print", "-n", "2", path]);
        assert_eq!(live.status.code(), Some(0), "{path}: {}", stderr(&live));
        assert!(stdout(&live).contains("BOOT"), "{path}: {}", stdout(&live));
    }
}

#[test]
fn wildcards_are_expanded() {
    let (_kept, folder) = folder();
    fs::write(folder.join("b.log"), BOOT).unwrap();
    let output = cobscope(&folder, &["check", "--separate", "*.log", "-f", "jsonl"]);
    let text = stdout(&output);
    assert!(text.contains("a.log") && text.contains("b.log"), "{text}{}", stderr(&output));
    let output = cobscope(&folder, &["decode", "."]);
    assert!(stderr(&output).starts_with("cobscope: .: a folder; "), "{}", stderr(&output));
    let output = cobscope(&folder, &["decode", "*.trc"]);
    assert_eq!(output.status.code(), Some(3));
    assert!(stderr(&output).contains("*.trc"), "{}", stderr(&output));
}

#[test]
fn names_in_any_script_and_long_paths() {
    let (_kept, folder) = folder();
    let mut deep = folder.clone();
    for _ in 0..8 {
        deep.push("a folder with a rather long name, 40 lett");
    }
    assert!(deep.as_os_str().len() > 300);
    fs::create_dir_all(&deep).unwrap();
    let name = deep.join("Prüfstand 試験 Ω.log");
    let output = cobscope(&folder, &[OsStr::new("convert"), OsStr::new("a.log"), name.as_os_str()]);
    assert_eq!(output.status.code(), Some(0), "{}", stderr(&output));
    assert_eq!(names(&deep), ["Prüfstand 試験 Ω.log"]);
    let output = cobscope(&folder, &[OsStr::new("decode"), name.as_os_str()]);
    assert!(stdout(&output).contains("BOOT"), "{}", stderr(&output));
    let output = cobscope(&folder, &["decode", "Maß.log"]);
    assert!(stderr(&output).starts_with("cobscope: Maß.log: "), "{}", stderr(&output));
}

#[test]
fn files_of_other_programs() {
    let (_kept, folder) = folder();
    // Open for writing, as by a program that still records.
    let mut log = File::options().append(true).open(folder.join("a.log")).unwrap();
    assert!(stdout(&cobscope(&folder, &["decode", "a.log"])).contains("BOOT"));
    log.write_all(b"(1700000000.200000) can0 705#05\n").unwrap();
    // A file that its owner does not share.
    let whole = File::options()
        .write(true)
        .create(true)
        .truncate(false)
        .share_mode(0)
        .open(folder.join("own.log"))
        .unwrap();
    let output = cobscope(&folder, &["decode", "own.log"]);
    assert_eq!(output.status.code(), Some(3));
    assert!(stderr(&output).starts_with("cobscope: own.log: cannot be opened: "), "{}", stderr(&output));
    let output = cobscope(&folder, &["convert", "--force", "a.log", "own.log"]);
    assert_ne!(output.status.code(), Some(0));
    assert!(stderr(&output).contains("own.log"), "{}", stderr(&output));
    drop(whole);
    // A file that somebody reads is replaced; the reader keeps the former content.
    fs::write(folder.join("out.log"), "before").unwrap();
    let mut reader = File::open(folder.join("out.log")).unwrap();
    let output = cobscope(&folder, &["convert", "--force", "a.log", "out.log"]);
    let mut text = String::new();
    reader.read_to_string(&mut text).unwrap();
    assert_eq!(text, "before");
    // Wine and Windows before 10 cannot replace it: the part stays, and the error has a remedy.
    let (place, is_refused) = match output.status.code() {
        Some(0) => ("out.log", false),
        _ => ("out.log.part", true),
    };
    assert!(fs::read_to_string(folder.join(place)).unwrap().contains("705#05"), "{}", stderr(&output));
    assert_eq!(stderr(&output).ends_with("close programs that have the file open\n"), is_refused);
    assert_eq!(names(&folder).contains(&"out.log.part".to_owned()), is_refused);
}

#[test]
fn an_input_is_protected_under_another_name() {
    let (_kept, folder) = folder();
    fs::hard_link(folder.join("a.log"), folder.join("same.log")).unwrap();
    for name in ["same.log", "A.LOG"] {
        let output = cobscope(&folder, &["convert", "--force", "a.log", name]);
        assert_eq!(output.status.code(), Some(2), "{name}");
        let expected = format!("cobscope: {name}: is also an input; choose another output file\n");
        assert_eq!(stderr(&output), expected);
    }
    assert_eq!(fs::read_to_string(folder.join("a.log")).unwrap(), BOOT);
}

#[test]
fn text_from_a_pipe_may_have_carriage_returns() {
    let (_kept, folder) = folder();
    let mut child = Command::new(PROGRAM)
        .args(["decode", "-"])
        .stdin(Stdio::piped())
        .stdout(Stdio::piped())
        .stderr(Stdio::piped())
        .spawn()
        .unwrap();
    child.stdin.take().unwrap().write_all(BOOT.replace('\n', "\r\n").as_bytes()).unwrap();
    let piped = child.wait_with_output().unwrap();
    assert_eq!(stdout(&piped), stdout(&cobscope(&folder, &["decode", "a.log"])), "{}", stderr(&piped));
    assert!(!stdout(&piped).contains('\r'));
}

#[test]
fn sources_of_other_systems_have_an_error() {
    let (_kept, folder) = folder();
    let output = cobscope(&folder, &["live", "--print", "can0"]);
    assert_eq!(output.status.code(), Some(3), "{}", stderr(&output));
    assert!(stderr(&output).contains("Linux"), "{}", stderr(&output));
    let output = cobscope(&folder, &["live", "--print", "pcan:USB1@500k"]);
    assert_eq!(output.status.code(), Some(3), "{}", stderr(&output));
    assert!(stderr(&output).contains("PCANBasic.dll"), "{}", stderr(&output));
}
