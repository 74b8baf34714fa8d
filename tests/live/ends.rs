//! End conditions of the program and its exit status.

use std::process::Command;

use crate::harness::{Program, events, greet, in_guest, send};

#[test]
fn it_ends_after_so_many_frames() {
    if !in_guest() {
        return;
    }
    let folder = tempfile::tempdir().unwrap();
    let record = folder.path().join("five.log");
    let live = Program::live(["vcan0", "-n", "5", "--record", record.to_str().unwrap()]);
    // Sends more than enough frames until it is stopped.
    let sender = Program::start(Command::new("cangen").args(["vcan0", "-g", "5", "-I", "137", "-L", "1"]));
    let ended = live.end();
    drop(sender);
    assert!(ended.status.success(), "{ended:?}");
    assert_eq!(events(&ended.out, "frame").len(), 5, "{ended:?}");
    assert_eq!(std::fs::read_to_string(&record).unwrap().lines().count(), 5);
}

#[test]
fn it_ends_after_the_given_time_without_a_frame() {
    if !in_guest() {
        return;
    }
    let live = Program::live(["vcan0", "-T", "3000"]);
    greet("vcan0", &[&live]);
    send("vcan0", &["138#77"]);
    let ended = live.end();
    assert!(ended.status.success(), "{ended:?}");
    let reported = events(&ended.out, "frame").iter().any(|event| event["id"] == "138");
    assert!(reported, "{ended:?}");
}

#[test]
fn a_judged_bus_with_findings_ends_as_check_does() {
    if !in_guest() {
        return;
    }
    let live = Program::live(["vcan0", "--check"]);
    greet("vcan0", &[&live]);
    // Bus-off of the controller (linux/can/error.h).
    send("vcan0", &["20000040#0000000000000000"]);
    live.wait_events("finding-opened", |events| events.iter().any(|event| event["rule"] == "bus-health"));
    live.signal("INT");
    let ended = live.end();
    assert_eq!(ended.status.code(), Some(1), "{ended:?}");
}

#[test]
fn a_terminated_program_has_recorded_all() {
    if !in_guest() {
        return;
    }
    let folder = tempfile::tempdir().unwrap();
    let record = folder.path().join("ended.log");
    let live = Program::live(["vcan0", "--record", record.to_str().unwrap()]);
    greet("vcan0", &[&live]);
    let last = greet("vcan0", &[&live]);
    live.signal("TERM");
    live.end();
    let text = std::fs::read_to_string(&record).unwrap();
    assert!(text.lines().last().unwrap().contains(&last), "{text}");
}

#[test]
fn an_interface_that_is_not_there_is_named_beside_those_that_are() {
    if !in_guest() {
        return;
    }
    let ended = Program::live(["vcan9"]).end();
    assert!(!ended.status.success(), "{ended:?}");
    let stated = ended.err.join("\n");
    assert!(stated.contains("vcan9") && stated.contains("vcan0") && stated.contains("vcan1"), "{stated}");
}

#[test]
fn without_a_source_the_interfaces_are_listed() {
    if !in_guest() {
        return;
    }
    let command = &mut Command::new(env!("CARGO_BIN_EXE_cobscope"));
    let ended = Program::start(command.arg("live")).end();
    let stated = [ended.out.join("\n"), ended.err.join("\n")].join("\n");
    assert!(stated.contains("vcan0") && stated.contains("vcan1"), "{stated}");
}
