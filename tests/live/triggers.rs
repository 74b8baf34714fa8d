//! Captures around triggers on a real bus.

use std::fs;
use std::io::Write as _;
use std::path::{Path, PathBuf};
use std::process::{Command, Stdio};

use serde_json::Value;

use crate::harness::{Bus, Program, greet, in_guest, ip, run, send, wait_until};

/// Identifier of the frames that trigger.
const TRIGGER: [&str; 2] = ["--trigger", "kind == frame && id == 0x13E"];

/// A frame as decoded: time in ns, and the rest of its line without the frame number.
type Decoded = (i64, String);

fn program(arguments: &[&[&str]]) -> Program {
    Program::live(arguments.concat())
}

/// Frames of a capture, which must be readable.
fn frames(path: &Path) -> Vec<Decoded> {
    let arguments = ["decode", "--no-findings", "-f", "jsonl", "--frames", path.to_str().unwrap()];
    let text = run(env!("CARGO_BIN_EXE_cobscope"), &arguments);
    let frame = |line: &str| {
        let mut frame: Value = serde_json::from_str(line).unwrap();
        frame.as_object_mut().unwrap().retain(|key, _| key != "frames");
        (time(line), frame.to_string())
    };
    text.lines().filter(|line| line.contains(r#""kind":"frame""#)).map(frame).collect()
}

/// Time of a JSON line in ns.
fn time(line: &str) -> i64 {
    let (seconds, fraction) = line[5..].split_once(',').unwrap().0.split_once('.').unwrap();
    format!("{seconds}{fraction}").parse().unwrap()
}

fn count_of(frames: &[Decoded], id: &str) -> usize {
    frames.iter().filter(|(_, text)| text.contains(&format!(r#""id":"{id}""#))).count()
}

/// Captures in a folder in order of their names.
fn captures(folder: &Path) -> Vec<PathBuf> {
    let entries = fs::read_dir(folder).unwrap().map(|entry| entry.unwrap().path());
    let mut paths: Vec<_> =
        entries.filter(|path| path.extension().is_some_and(|it| it == "pcapng")).collect();
    paths.sort();
    paths
}

/// Plays frames at these ms with their gaps.
fn play(bus: &str, frames: impl Iterator<Item = (u64, &'static str)>) {
    let mut player = Command::new("canplayer");
    player.arg(format!("{bus}=played")).stdin(Stdio::piped());
    let mut player = player.spawn().unwrap();
    let mut input = player.stdin.take().unwrap();
    for (milliseconds, frame) in frames {
        writeln!(input, "({}.{:03}000) played {frame}", milliseconds / 1_000, milliseconds % 1_000).unwrap();
    }
    drop(input);
    assert!(player.wait().unwrap().success());
}

#[test]
fn windows_are_exact_and_overlapping_ones_are_one_file() {
    if !in_guest() {
        return;
    }
    let bus = Bus::new("vcan7");
    let folder = tempfile::tempdir().unwrap();
    let (all, day) = (folder.path().join("all.pcapng"), folder.path().join("day"));
    let full = Program::live([bus.0, "--record", all.to_str().unwrap()]);
    let sides = [bus.0, "--before", "400ms", "--after", "300ms"];
    let live = program(&[&sides, &TRIGGER, &["--record", day.to_str().unwrap()]]);
    greet(bus.0, &[&live, &full]);
    // A frame every 2 ms; triggers at 1.0 and 1.2 s overlap, that at 2.6 s does not.
    let faults = [1_000, 1_200, 2_600];
    play(
        bus.0,
        (0..4_000).step_by(2).flat_map(|at| {
            let fault = faults.contains(&at).then_some((at, "13E#02"));
            std::iter::once((at, "13A#01")).chain(fault)
        }),
    );
    greet(bus.0, &[&live, &full]);
    full.interrupt();
    let ended = live.interrupt();
    let all = frames(&all);
    assert_eq!((count_of(&all, "13A"), count_of(&all, "13E")), (2_000, 3));
    let of = |kind: &str| -> Vec<&String> {
        let kind = format!(r#""kind":"{kind}""#);
        ended.out.iter().filter(|line| line.contains(&kind)).collect()
    };
    let [one, two, three] = of("trigger").try_into().unwrap();
    assert_eq!(of("capture").len(), 2);
    let captures = captures(&day);
    assert_eq!(captures.len(), 2);
    for (capture, first, last) in [(&captures[0], one, two), (&captures[1], three, three)] {
        assert!(first.contains(capture.to_str().unwrap()) && last.contains(capture.to_str().unwrap()));
        let window = time(first) - 400_000_000..=time(last) + 300_000_000;
        let expected: Vec<_> = all.iter().filter(|(time, _)| window.contains(time)).cloned().collect();
        assert!(expected.len() > 200, "{}", expected.len());
        assert_eq!(frames(capture), expected);
    }
}

#[test]
fn the_number_of_captures_is_limited() {
    if !in_guest() {
        return;
    }
    let folder = tempfile::tempdir().unwrap();
    let day = folder.path().to_str().unwrap();
    let sides = ["vcan0", "--before", "0s", "--after", "0s", "--trigger-files", "1"];
    let live = program(&[&sides, &TRIGGER, &["--record", day]]);
    greet("vcan0", &[&live]);
    for count in 1..=3 {
        send("vcan0", &["13E#"]);
        live.wait_events("trigger", |events| events.len() == count);
    }
    let ended = live.interrupt();
    assert_eq!(captures(folder.path()).len(), 1);
    let remarks = ended.err.iter().filter(|line| line.contains("limit of --trigger-files reached")).count();
    assert_eq!(remarks, 1, "{}", ended.err.join("\n"));
}

#[test]
fn a_killed_program_leaves_the_capture_and_the_ring() {
    if !in_guest() {
        return;
    }
    let folder = tempfile::tempdir().unwrap();
    let day = folder.path().to_str().unwrap();
    let live = program(&[&["vcan0", "--after", "1h", "--ring-files", "1M"], &TRIGGER, &["--record", day]]);
    greet("vcan0", &[&live]);
    send("vcan0", &["13E#"]);
    live.wait_events("trigger", |events| events.len() == 1);
    run("cangen", &["vcan0", "-g", "1", "-I", "13A", "-L", "8", "-n", "100"]);
    // Without the end of the program and without further frames.
    let counts = || -> Vec<usize> {
        captures(folder.path()).iter().map(|path| count_of(&frames(path), "13A")).collect()
    };
    wait_until("100 frames in capture and ring", || counts() == [100, 100]);
    live.signal("KILL");
    live.end();
    assert_eq!(counts(), [100, 100]);
}

#[test]
fn a_full_disk_is_an_error_with_the_number_of_missing_frames() {
    if !in_guest() {
        return;
    }
    let folder = tempfile::tempdir().unwrap();
    let disk = folder.path().to_str().unwrap();
    run("mount", &["-t", "tmpfs", "-o", "size=64k", "tmpfs", disk]);
    let live = program(&[&["vcan0", "--before", "0s", "--after", "1h"], &TRIGGER, &["--record", disk]]);
    greet("vcan0", &[&live]);
    send("vcan0", &["13E#"]);
    run("cangen", &["vcan0", "-g", "0", "-c", "50", "-I", "13B", "-L", "8", "-n", "4000"]);
    live.wait_message("full disk", |line| line.contains("No space left"));
    greet("vcan0", &[&live]);
    live.signal("INT");
    let ended = live.end();
    let paths = captures(folder.path());
    let written = frames(&paths[0]).len();
    run("umount", &[disk]);
    let text = ended.err.join("\n");
    assert_eq!(ended.status.code(), Some(3), "{text}");
    let path = paths[0].display().to_string();
    let message = ended.err.iter().find(|line| line.contains(&path) && line.ends_with(" frames not written"));
    let missing = message.unwrap().strip_suffix(" frames not written").unwrap().rsplit(' ').next().unwrap();
    let missing: usize = missing.parse().unwrap();
    // The trigger, 4,000 frames and a few greetings.
    assert!((4_002..4_100).contains(&(written + missing)), "{written} + {missing}\n{text}");
    assert!(written > 500 && missing > 500, "{written} + {missing}");
}

#[test]
fn a_window_survives_the_loss_of_its_link() {
    if !in_guest() {
        return;
    }
    let bus = Bus::new("vcan7");
    let folder = tempfile::tempdir().unwrap();
    let day = folder.path().to_str().unwrap();
    let live = program(&[&[bus.0, "--after", "1h"], &TRIGGER, &["--record", day]]);
    greet(bus.0, &[&live]);
    send(bus.0, &["13E#"]);
    live.wait_events("trigger", |events| events.len() == 1);
    ip("link set vcan7 down");
    live.wait_events("link", |events| events.iter().any(|event| event["state"] == "down"));
    ip("link set vcan7 up");
    greet(bus.0, &[&live]);
    send(bus.0, &["13F#"]);
    live.wait_events("frame", |events| events.iter().any(|event| event["id"] == "13F"));
    live.interrupt();
    let capture = &captures(folder.path())[0];
    let decoded = frames(capture);
    assert_eq!((count_of(&decoded, "13E"), count_of(&decoded, "13F")), (1, 1));
    let text = run(env!("CARGO_BIN_EXE_cobscope"), &["decode", "-f", "jsonl", capture.to_str().unwrap()]);
    assert!(text.contains(r#""state":"down""#), "{text}");
}
