//! Captures of every kind of frame equal those of candump, with the same times.

use crate::harness::{Bus, HELLO, Program, greet, has_devices, in_guest, ip, run, send};
use crate::pair::{Pair, read};

/// Lengths of CAN FD data (ISO 11898-1).
const FD_LENGTHS: [usize; 16] = [0, 1, 2, 3, 4, 5, 6, 7, 8, 12, 16, 20, 24, 32, 48, 64];

/// Every kind, length and flag, and both ends of each range of identifiers.
fn all_kinds() -> Vec<String> {
    let data =
        |length: usize| (0..length).map(|byte| format!("{:02X}", 0xFF - byte)).collect::<Vec<_>>().concat();
    let mut frames = Vec::new();
    for id in ["000", "123", "7FF", "00000000", "00000123", "12345678", "1FFFFFFE"] {
        frames.extend((0..=8).map(|length| format!("{id}#{}", data(length))));
        frames.push(format!("{id}#R"));
        frames.extend((1..=8).map(|length| format!("{id}#R{length}")));
        frames.extend((0..4).map(|flags| format!("{id}##{flags}{}", data(12))));
    }
    frames.extend(FD_LENGTHS.map(|length| format!("1ABCDEF0##1{}", data(length))));
    // Timeout, lost arbitration, controller, protocol, transceiver, no acknowledgement, bus off, bus error,
    // restarted, counters (linux/can/error.h).
    let classes = [0x1, 0x2, 0x4, 0x8, 0x10, 0x20, 0x40, 0x80, 0x100, 0x204];
    frames.extend(classes.map(|class| format!("{:08X}#0010000000006000", 0x2000_0000 | class)));
    frames
}

#[test]
fn every_kind_of_frame_is_recorded_as_candump_records_it() {
    if !in_guest() {
        return;
    }
    let frames = all_kinds();
    let pair = Pair::start("vcan0", "vcan0");
    send("vcan0", &frames);
    let records = pair.end();
    records.assert_same(frames.len());
    assert_eq!(records.frames(), frames);
}

#[test]
fn a_mix_of_a_thousand_frames_is_recorded_as_candump_records_it() {
    if !in_guest() {
        return;
    }
    let pair = Pair::start("vcan0", "vcan0");
    run("cangen", &["vcan0", "-m", "-g", "1", "-n", "1000"]);
    pair.end().assert_same(1000);
}

#[test]
fn played_frames_are_recorded_with_the_time_the_kernel_gave_them() {
    if !in_guest() {
        return;
    }
    let folder = tempfile::tempdir().unwrap();
    let file = folder.path().join("played.log");
    let lines: Vec<_> = (0..500).map(|n| format!("(1.{:06}) played 321#{n:08X}\n", n * 1000)).collect();
    std::fs::write(&file, lines.concat()).unwrap();
    let pair = Pair::start("vcan0", "vcan0");
    run("canplayer", &["-I", file.to_str().unwrap(), "vcan0=played"]);
    let records = pair.end();
    records.assert_same(500);
    let frames: Vec<_> = (0..500).map(|number| format!("321#{number:08X}")).collect();
    assert_eq!(records.frames(), frames);
}

#[test]
fn the_kernel_stamps_frames_of_a_virtual_bus_which_is_reported() {
    if !in_guest() {
        return;
    }
    let pair = Pair::start("vcan0", "vcan0");
    let ended = pair.end().ended;
    let texts = |line: &String| line.contains("vcan0") && line.contains("kernel");
    assert!(ended.err.iter().any(texts), "{:#?}", ended.err);
}

#[test]
fn any_means_every_bus_also_one_that_comes_later() {
    if !in_guest() {
        return;
    }
    let folder = tempfile::tempdir().unwrap();
    let record = folder.path().join("any.log");
    let live = Program::live(["any", "--record", record.to_str().unwrap()]);
    greet("vcan0", &[&live]);
    greet("vcan1", &[&live]);
    let late = Bus::new("vcan5");
    greet(late.0, &[&live]);
    for bus in ["vcan0", "vcan1", late.0] {
        send(bus, &["135#01", "135##102"]);
    }
    greet(late.0, &[&live]);
    live.interrupt();
    let all = read(&record);
    let of = |bus: &str| -> Vec<_> {
        let is = |frame: &str| !frame.starts_with(HELLO);
        all.iter().filter(|line| line.bus == bus && is(&line.frame)).map(|line| line.frame.clone()).collect()
    };
    for bus in ["vcan0", "vcan1", late.0] {
        assert_eq!(of(bus), ["135#01", "135##102"], "{bus}");
    }
}

#[test]
fn several_buses_are_distinguished() {
    if !in_guest() {
        return;
    }
    let live = Program::live(["vcan0", "vcan1"]);
    greet("vcan0", &[&live]);
    greet("vcan1", &[&live]);
    send("vcan0", &["136#00"]);
    send("vcan1", &["136#01"]);
    let frames =
        live.wait_events("frame", |events| events.iter().filter(|event| event["id"] == "136").count() == 2);
    let reported: Vec<_> = frames
        .iter()
        .filter(|event| event["id"] == "136")
        .map(|event| (&event["bus"], &event["data"]))
        .collect();
    assert_eq!(
        format!("{reported:?}"),
        r#"[(String("vcan0"), String("00")), (String("vcan1"), String("01"))]"#
    );
}

#[test]
fn qemu_frames_from_a_wire_are_recorded_as_candump_records_them() {
    if !has_devices() {
        return;
    }
    for bus in ["can0", "can1"] {
        ip(&format!("link set {bus} up type can bitrate 500000"));
    }
    let records = {
        let pair = Pair::start("can0", "can1");
        run("cangen", &["can1", "-g", "2", "-n", "300", "-p", "10", "-e"]);
        pair.end()
    };
    for bus in ["can0", "can1"] {
        ip(&format!("link set {bus} down"));
    }
    records.assert_same(300);
}
