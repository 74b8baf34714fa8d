//! Every lost frame is counted, and the capture on disk is complete.

use std::fs;
use std::path::Path;

use serde_json::Value;

use crate::harness::{HELLO, Program, events, greet, in_guest, run, send, wait_until};
use crate::pair::read;

/// Total number of lost frames in all events.
fn lost(events: &[Value]) -> u64 {
    events.iter().map(|event| event["count"].as_u64().unwrap()).sum()
}

#[test]
fn frames_that_a_starved_reader_lost_are_counted_exactly() {
    if !in_guest() {
        return;
    }
    let folder = tempfile::tempdir().unwrap();
    let record = folder.path().join("starved.log");
    let live = Program::live(["vcan0", "--record", record.to_str().unwrap()]);
    greet("vcan0", &[&live]);
    live.signal("STOP");
    let sent = 60_000;
    run("cangen", &["vcan0", "-g", "0", "-I", "123", "-L", "8", "-D", "i", "-n", &sent.to_string()]);
    live.signal("CONT");
    // The kernel reports a loss with a later frame.
    greet("vcan0", &[&live]);
    let ended = live.interrupt();
    let lost = lost(&events(&ended.out, "lost-frames"));
    let frames = read(&record).into_iter().filter(|recorded| !recorded.frame.starts_with(HELLO));
    let received: Vec<_> = frames.map(|recorded| recorded.frame).collect();
    assert_eq!(received.len() as u64 + lost, sent, "received and lost");
    assert!(lost > 0 && received.len() >= 278, "{} received", received.len());
    assert!(received.is_sorted_by(|one, next| counter(one) < counter(next)), "out of order or twice");
    let stated = ended.err.join("\n");
    assert!(stated.contains(&lost.to_string()), "{lost} is not in\n{stated}");
}

/// Counter of cangen in the payload, least significant byte first.
fn counter(frame: &str) -> u64 {
    u64::from_str_radix(frame.split_once('#').unwrap().1, 16).unwrap().swap_bytes()
}

/// Number of frames that the program reads in a capture, which must be readable.
fn decoded(path: &Path) -> usize {
    let text =
        run(env!("CARGO_BIN_EXE_cobscope"), &["decode", "-f", "jsonl", "--frames", path.to_str().unwrap()]);
    text.lines().filter(|line| line.contains(r#""id":"13A""#)).count()
}

#[test]
fn a_killed_program_leaves_a_readable_record() {
    if !in_guest() {
        return;
    }
    for format in ["log", "pcapng"] {
        let folder = tempfile::tempdir().unwrap();
        let record = folder.path().join(format!("killed.{format}"));
        let live = Program::live(["vcan0", "--record", record.to_str().unwrap()]);
        greet("vcan0", &[&live]);
        run("cangen", &["vcan0", "-g", "1", "-I", "13A", "-L", "8", "-n", "100"]);
        // Without the end of the program and without further frames.
        wait_until("100 frames in the record", || decoded(&record) == 100);
        live.signal("KILL");
        live.end();
        assert_eq!(decoded(&record), 100, "{format}");
    }
}

#[test]
fn a_full_disk_is_reported_and_watching_continues() {
    if !in_guest() {
        return;
    }
    let folder = tempfile::tempdir().unwrap();
    let disk = folder.path().to_str().unwrap();
    run("mount", &["-t", "tmpfs", "-o", "size=64k", "tmpfs", disk]);
    let record = folder.path().join("full.log");
    let live = Program::live(["vcan0", "--record", record.to_str().unwrap()]);
    greet("vcan0", &[&live]);
    run("cangen", &["vcan0", "-g", "0", "-c", "50", "-I", "13B", "-L", "8", "-n", "4000"]);
    let stated = live.wait_message("full disk", |line| line.contains("full.log"));
    assert!(stated.contains("No space left") || stated.contains("full"), "{stated}");
    greet("vcan0", &[&live]);
    send("vcan0", &["13C#01"]);
    live.wait_events("frame", |events| events.iter().any(|event| event["id"] == "13C"));
    live.signal("INT");
    let ended = live.end();
    // The capture has complete lines only.
    let text = fs::read_to_string(&record).unwrap();
    run("umount", &[disk]);
    let stated = ended.err.join("\n");
    assert_eq!(ended.status.code(), Some(3), "{stated}");
    // Greetings are frames too; more than the 4,000 were sent.
    let missing = 4_000 - text.lines().count();
    let reported = ended.err.iter().find_map(|line| line.strip_suffix(" frames missing")).unwrap();
    let reported: usize = reported.rsplit(' ').next().unwrap().parse().unwrap();
    assert!((missing..missing + 100).contains(&reported), "{reported} instead of {missing}\n{stated}");
    assert!(text.lines().count() > 500, "{} lines", text.lines().count());
}
