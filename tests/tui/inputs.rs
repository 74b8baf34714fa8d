//! What people pass as captures: other files, parts of a series, times in another unit or zone, frames of CAN XL.

use std::fs;
use std::path::Path;

use crate::check::folder;
use crate::cli::{Output, run_in};

fn run(place: &Path, arguments: &[&str]) -> Output {
    run_in(place, arguments, "")
}

#[test]
fn other_files_are_refused_with_a_way_out() {
    let place = folder("inputs-foreign");
    for (name, content, expected) in [
        ("a.zip", &b"PK\x03\x04\x14\0\0\0"[..], "a ZIP archive, not a capture in a known format; unpack it"),
        (
            "machine.toml",
            b"[bus.can0]\nbitrate = 250000\n",
            "a bus file, not a capture in a known format; use --bus FILE",
        ),
        ("pump.eds", b"[FileInfo]\r\nFileName=pump.eds\r\n", "use --eds NODE=FILE with a capture"),
        ("day.KME50", b"\x01\x02\x03\x04", "a log of Kvaser Memorator"),
        ("values.csv", b"time,bus,frame,node,device,group,signal,id,value,unit,label,raw\n", "decode -f csv"),
    ] {
        fs::write(place.join(name), content).unwrap();
        let output = run(&place, &["decode", name]);
        assert_eq!(output.code, 3, "{name}");
        assert!(output.stderr.contains(&format!("{name}: ")), "{}", output.stderr);
        assert!(output.stderr.contains(expected), "{name}: {}", output.stderr);
    }
    // In a folder they are skipped as before.
    fs::write(place.join("run.log"), "(1.0) can0 705#05\n").unwrap();
    let output = run(&place, &["check", "."]);
    assert!(output.stdout.contains("run.log") && !output.stdout.contains("UNREADABLE"), "{}", output.stdout);
}

const PARTS: [&str; 3] = ["00000001-60FE3F04.log", "00000002-60FE415D.log", "00000003-60FE43B2.log"];

#[test]
fn parts_with_a_time_in_hex_are_one_capture_and_one_names_the_others() {
    let place = folder("inputs-series");
    for (part, name) in PARTS.iter().enumerate() {
        let lines = (0..10).map(|tenth| format!("({}.{tenth}00000) can0 705#05\n", 1_700_000_001 + part));
        fs::write(place.join(name), lines.collect::<Vec<_>>().concat()).unwrap();
    }
    let listed = run(&place, &[&["check"], &PARTS[..]].concat());
    let found = run(&place, &["check", "."]);
    for output in [&listed, &found] {
        assert!(output.stderr.contains("3 parts of one capture"), "{}", output.stderr);
        assert!(output.stdout.contains("1 capture: 0 failed"), "{}", output.stdout);
    }
    let note = "00000002-60FE415D.log: one of 3 files with consecutive names in its folder";
    let converted = run(&place, &["convert", "-f", "candump", PARTS[1], "-"]);
    assert!(converted.stderr.contains(note), "{}", converted.stderr);
    let many = run(&place, &["convert", "-f", "candump", PARTS[0], PARTS[1], PARTS[2], "-"]);
    assert!(!many.stderr.contains(note), "{}", many.stderr);
    for command in ["decode", "check", "why", "stats", "report", "objects"] {
        let one = run(&place, &[command, PARTS[1]]);
        assert!(one.stderr.contains(note), "{command}: {}", one.stderr);
        let separate = run(&place, &[command, "--separate", PARTS[1]]);
        assert!(!separate.stderr.contains(note), "{command}: {}", separate.stderr);
    }
}

/// 40 frames, 46 units apart: as microseconds, 21,739 frames/s of at least 47 µs each.
#[test]
fn the_unit_of_times_is_stated_or_inferred() {
    let place = folder("inputs-unit");
    let rows = (0..40).map(|row| format!("{},00000705,false,Rx,0,1,05,\n", row * 46));
    let text = format!("Time Stamp,ID,Extended,Dir,Bus,LEN,D1\n{}", rows.collect::<Vec<_>>().concat());
    fs::write(place.join("a.csv"), text).unwrap();
    let inferred = run(&place, &["convert", "-f", "candump", "a.csv", "-"]);
    assert!(inferred.stderr.contains("times read as milliseconds"), "{}", inferred.stderr);
    assert!(inferred.stdout.ends_with("(1.794000) 0 705#05 R\n"), "{}", inferred.stdout);
    let stated = run(&place, &["check", "--time-unit", "us", "a.csv"]);
    assert!(stated.stdout.contains("unit of the timestamps wrong?"), "{}", stated.stdout);
    assert_eq!(run(&place, &["stats", "--time-unit", "min", "a.csv"]).code, 2);
}

/// Starts in winter and in summer: 14:06:13 in Berlin is 13:06:13 and 12:06:13 UTC, in Tokyo 05:06:13 UTC.
#[test]
fn local_times_have_the_zone_of_the_option_or_of_the_bus() {
    let place = folder("inputs-zone");
    let rows = "base hex  timestamps absolute\n0.000000 1 705 Rx d 1 05\n1.000000 1 705 Rx d 1 05\n";
    for (name, date) in
        [("winter.asc", "Mon Jan 15 14:06:13 2024"), ("summer.asc", "Mon Jul 15 14:06:13 2024")]
    {
        fs::write(place.join(name), format!("date {date}\n{rows}")).unwrap();
    }
    let first = |words: &[&str]| {
        let output = run(&place, &[&["convert", "-f", "candump"], words, &["-"]].concat());
        let time = output.stdout.get(1..11).unwrap_or_default().parse().unwrap_or(0_i64);
        (time, output.stderr)
    };
    // `date -u -d '2024-01-15 14:06:13' +%s`, and of July 15.
    let (winter, summer) = (1_705_327_573, 1_721_052_373);
    let unknown = first(&["winter.asc"]);
    assert!(unknown.0 == winter && unknown.1.contains("local time, zone unknown"), "{unknown:?}");
    let berlin = ["--time-zone", "Europe/Berlin"];
    assert_eq!(first(&[&berlin[..], &["winter.asc"]].concat()), (winter - 3_600, String::new()));
    assert_eq!(first(&[&berlin[..], &["summer.asc"]].concat()), (summer - 7_200, String::new()));
    fs::write(place.join("m.toml"), "[bus.1]\ntime_zone = 'Asia/Tokyo'\n").unwrap();
    assert_eq!(first(&["--bus", "m.toml", "summer.asc"]), (summer - 9 * 3_600, String::new()));
    let both = [&["--bus", "m.toml"], &berlin[..], &["summer.asc"]].concat();
    assert_eq!(first(&both), (summer - 7_200, String::new()));
    let checked = run(&place, &["check", "winter.asc"]);
    assert!(checked.stdout.contains("local time, zone unknown"), "{}", checked.stdout);
    let checked = run(&place, &["check", "--bus", "m.toml", "winter.asc"]);
    assert!(!(checked.stdout + &checked.stderr).contains("zone unknown"));
    let report = run(&place, &["report", "winter.asc", "--format", "md"]);
    assert!(report.stdout.contains("zone: local time, zone unknown"), "{}{}", report.stdout, report.stderr);
}

#[test]
fn an_unknown_zone_is_refused() {
    let place = folder("inputs-zone-unknown");
    fs::write(place.join("a.log"), "(1.0) can0 705#05\n").unwrap();
    let output = run(&place, &["check", "--time-zone", "Europe/Bärlin", "a.log"]);
    assert!(output.code == 2 && output.stderr.contains("expected a name such as"), "{}", output.stderr);
    fs::write(place.join("m.toml"), "[bus.can0]\ntime_zone = 'Mars'\n").unwrap();
    let output = run(&place, &["check", "--bus", "m.toml", "a.log"]);
    assert!(output.stderr.contains("m.toml:2:13: unknown time zone"), "{}", output.stderr);
    assert_eq!(output.code, 4);
}

/// A header of pcap, link type 227, and one packet.
fn pcap(packet: &[u8]) -> Vec<u8> {
    let mut bytes = b"\xD4\xC3\xB2\xA1\x02\0\x04\0\0\0\0\0\0\0\0\0\0\0\x04\0\xE3\0\0\0".to_vec();
    let length = u32::try_from(packet.len()).unwrap();
    for number in [1_700_000_000, 0, length, length] {
        bytes.extend(number.to_le_bytes());
    }
    bytes.extend(packet);
    bytes
}

#[test]
fn a_conversion_without_its_can_xl_frames_is_incomplete() {
    let place = folder("inputs-xl");
    let classic = pcap(b"\0\0\x07\x01\x01\0\0\0\x05");
    let xl = pcap(b"\0\0\x01\x23\x80\x03\x04\0\x44\x33\x22\x11\x01\x02\x03\x04");
    fs::write(place.join("a.pcap"), [&classic[..], &xl[24..]].concat()).unwrap();
    let output = run(&place, &["convert", "a.pcap", "a.log"]);
    assert_eq!(output.code, 3, "{}", output.stderr);
    assert!(output.stderr.contains("CAN XL frame: not supported (priority 123"), "{}", output.stderr);
    fs::write(place.join("b.pcap"), classic).unwrap();
    assert_eq!(run(&place, &["convert", "b.pcap", "b.log"]).code, 0);
}

/// Text of Windows PowerShell.
#[test]
fn text_in_utf_16_is_read() {
    let place = folder("inputs-utf-16");
    let text = "\u{FEFF}(1.0) can0 705#05\r\n(2.0) can0 705#7F\r\n";
    fs::write(place.join("a.log"), text.encode_utf16().flat_map(u16::to_le_bytes).collect::<Vec<_>>())
        .unwrap();
    let output = run(&place, &["convert", "-f", "candump", "a.log", "-"]);
    assert_eq!(output.stdout, "(1.000000) can0 705#05\n(2.000000) can0 705#7F\n", "{}", output.stderr);
}
