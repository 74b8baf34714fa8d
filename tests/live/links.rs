//! A bus that disappears and returns.

use std::thread;
use std::time::{Duration, Instant};

use serde_json::Value;

use crate::harness::{Bus, Program, greet, has_devices, in_guest, ip};
use crate::pair::read;

/// States of a bus in the order of their events.
fn states(events: &[Value], bus: &str) -> Vec<String> {
    let of_bus = events.iter().filter(|event| event["bus"] == bus);
    of_bus.map(|event| event["state"].as_str().unwrap().to_owned()).collect()
}

/// Waits until the last event of a bus has this state.
fn wait_state(live: &Program, bus: &str, state: &str) {
    live.wait_events("link", |events| states(events, bus).last().is_some_and(|last| last == state));
}

/// Asserts that the program waits without using CPU time.
fn assert_idle(live: &Program) {
    let (begin, used) = (Instant::now(), live.processor_time());
    thread::sleep(Duration::from_secs(1));
    let used = live.processor_time().checked_sub(used).unwrap();
    assert!(used * 4 < begin.elapsed(), "{used:?} of processor time in {:?}", begin.elapsed());
}

#[test]
fn an_interface_switched_off_and_on_is_reported_and_read_again() {
    if !in_guest() {
        return;
    }
    let bus = Bus::new("vcan6");
    let folder = tempfile::tempdir().unwrap();
    let record = folder.path().join("down.log");
    let live = Program::live([bus.0, "--record", record.to_str().unwrap()]);
    let before = greet(bus.0, &[&live]);
    for _ in 0..2 {
        ip("link set vcan6 down");
        wait_state(&live, bus.0, "down");
        assert_idle(&live);
        ip("link set vcan6 up");
        wait_state(&live, bus.0, "up");
        greet(bus.0, &[&live]);
    }
    let after = greet(bus.0, &[&live]);
    let reported = states(&live.events("link"), bus.0);
    assert!(reported.ends_with(&["down", "up", "down", "up"].map(str::to_owned)), "{reported:?}");
    live.interrupt();
    let frames: Vec<_> = read(&record).into_iter().map(|recorded| recorded.frame).collect();
    assert!(frames.contains(&before) && frames.contains(&after), "{frames:?}");
}

#[test]
fn an_interface_deleted_and_created_again_is_reported_and_read_again() {
    if !in_guest() {
        return;
    }
    let bus = Bus::new("vcan6");
    let live = Program::live([bus.0]);
    greet(bus.0, &[&live]);
    for _ in 0..2 {
        bus.delete();
        wait_state(&live, bus.0, "gone");
        assert_idle(&live);
        bus.create();
        wait_state(&live, bus.0, "up");
        greet(bus.0, &[&live]);
    }
    live.interrupt();
}

#[test]
fn if_one_of_several_buses_disappears_the_others_are_still_read() {
    if !in_guest() {
        return;
    }
    let bus = Bus::new("vcan6");
    for source in [&["vcan0", "vcan6"][..], &["any"]] {
        let live = Program::live(source);
        greet("vcan0", &[&live]);
        greet(bus.0, &[&live]);
        bus.delete();
        wait_state(&live, bus.0, "gone");
        greet("vcan0", &[&live]);
        bus.create();
        wait_state(&live, bus.0, "up");
        greet(bus.0, &[&live]);
        live.interrupt();
    }
}

#[test]
fn an_interface_that_is_down_at_the_start_is_waited_for() {
    if !in_guest() {
        return;
    }
    let bus = Bus::new("vcan6");
    ip("link set vcan6 down");
    let live = Program::live([bus.0]);
    let stated =
        live.wait_message("word on the interface", |line| line.contains("vcan6") && line.contains("down"));
    assert!(stated.contains("ip link set vcan6 up"), "{stated}");
    ip("link set vcan6 up");
    wait_state(&live, bus.0, "up");
    greet(bus.0, &[&live]);
}

#[test]
fn qemu_a_bit_rate_comes_from_the_controller() {
    if !has_devices() {
        return;
    }
    ip("link set can1 up type can bitrate 250000");
    ip("link set can0 up type can bitrate 250000");
    let live = Program::live(["can0"]);
    greet("can1", &[&live]);
    for rate in [500_000, 125_000] {
        for bus in ["can0", "can1"] {
            ip(&format!("link set {bus} down"));
        }
        wait_state(&live, "can0", "down");
        for bus in ["can1", "can0"] {
            ip(&format!("link set {bus} up type can bitrate {rate}"));
        }
        let is_reported = |event: &Value| event["state"] == "up" && event["bit_rate"] == rate;
        live.wait_events("link", |events| events.last().is_some_and(is_reported));
        greet("can1", &[&live]);
    }
    live.interrupt();
    for bus in ["can0", "can1"] {
        ip(&format!("link set {bus} down"));
    }
}

#[test]
fn qemu_the_mode_of_the_controller_is_the_one_of_the_system() {
    if !has_devices() {
        return;
    }
    for (setting, mode) in [("off", "acknowledges frames (listen-only off)"), ("on", "listen-only")] {
        ip(&format!("link set can0 up type can bitrate 250000 listen-only {setting}"));
        let live = Program::live(["can0"]);
        let expected = format!(", {mode}, timestamps by ");
        live.wait_message("mode of can0", |line| line.contains("can0: up") && line.contains(&expected));
        live.interrupt();
        ip("link set can0 down");
    }
    // Later tests expect a controller in normal mode.
    ip("link set can0 type can listen-only off");
}
