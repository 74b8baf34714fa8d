//! `cobscope live --trigger` on standard input. `tests/live` has the tests of CAN interfaces.
#![cfg(unix)]

use std::fs;
use std::io::Write as _;
use std::os::unix::fs::PermissionsExt as _;
use std::path::{Path, PathBuf};
use std::process::{Command, Stdio};
use std::time::Instant;

use serde_json::Value;

use crate::cli::run;
use crate::live::{LIMIT, Running, fixture, folder};

/// A heartbeat of node 5 every 100 ms for 20 s, and an EMCY of node 2 at these tenths of a second.
fn bus(emergencies: &[u32]) -> Vec<String> {
    let mut lines = Vec::new();
    for tenth in 0..200 {
        let time = format!("(17000000{:02}.{}00000) can0", tenth / 10, tenth % 10);
        lines.push(format!("{time} 705#05"));
        if emergencies.contains(&tenth) {
            lines.push(format!("{time} 082#1081010000000000"));
        }
    }
    lines
}

/// Captures in a folder in order of their names.
fn captures(folder: &Path) -> Vec<PathBuf> {
    let entries = fs::read_dir(folder).unwrap().map(|entry| entry.unwrap().path());
    let mut paths: Vec<_> =
        entries.filter(|path| path.extension().is_some_and(|it| it == "pcapng")).collect();
    paths.sort();
    paths
}

/// Frames of a capture as candump text.
fn lines(capture: &Path) -> Vec<String> {
    let output = capture.with_extension("log");
    let _ = fs::remove_file(&output);
    let converted = run(&["convert", capture.to_str().unwrap(), output.to_str().unwrap()], "");
    assert_eq!(converted.code, 0, "{}", converted.stderr);
    fs::read_to_string(&output).unwrap().lines().map(str::to_owned).collect()
}

const EMERGENCY: [&str; 4] = ["--trigger", "kind == emcy && node == 2", "--before", "1s"];

#[test]
fn each_capture_has_the_frames_of_its_window() {
    let folder = folder("window");
    let bus = bus(&[50, 65, 150]);
    let record = folder.to_str().unwrap();
    let arguments = [&["live", "-"], &EMERGENCY[..], &["--after", "500ms", "--record", record]].concat();
    let live = run(&arguments, &(bus.join("\n") + "\n"));
    assert_eq!(live.code, 0, "{}", live.stderr);
    let within = |from: &str, to: &str| -> Vec<String> {
        let time = |line: &str| line[1..18].to_owned();
        bus.iter().filter(|line| (from..=to).contains(&time(line).as_str())).cloned().collect()
    };
    // 4.0 to 5.5 s and 5.5 to 7.0 s overlap; both bounds are inclusive.
    let captures = captures(&folder);
    assert_eq!(captures.len(), 2);
    assert_eq!(lines(&captures[0]), within("1700000004.000000", "1700000007.000000"));
    assert_eq!(lines(&captures[1]), within("1700000014.000000", "1700000015.500000"));
    // 31 heartbeats, 2 EMCY; 16 heartbeats, 1 EMCY.
    assert_eq!([lines(&captures[0]).len(), lines(&captures[1]).len()], [33, 17]);
    let out: Vec<&str> = live.stdout.lines().collect();
    assert_eq!(out.len(), 5, "{}", live.stdout);
    let name = captures[0].display();
    let text = "emcy: 8110 CAN overrun, frames lost, register 01 (generic)";
    assert_eq!(out[0], format!("    5.000  2/02              TRIG   {text} → {name} {{52}}"));
    assert!(out[1].contains(&format!("{name} {{68}}")), "{}", out[1]);
    assert!(out[2].contains("33 frames, 3.000 s, 2 triggers, "), "{}", out[2]);
    assert!(live.stderr.contains(": 50 frames, "), "{}", live.stderr);
    assert!(live.stderr.contains(" in 2 captures\n"), "{}", live.stderr);
}

/// 256M and 4G are 256 × 1024² and 4 × 1024³ bytes.
#[test]
fn the_ring_is_printed_in_the_units_of_its_options() {
    let folder = folder("units");
    let record = folder.to_str().unwrap();
    let arguments = [&["live", "-"], &EMERGENCY[..], &["--record", record]].concat();
    let ring = |more: &[&str]| run(&[&arguments[..], more].concat(), "").stderr;
    let stated = ring(&[]);
    assert!(stated.contains("; ring of up to 256 MiB in memory\n"), "{stated}");
    let stated = ring(&["--ring-size", "64k", "--ring-files", "4G"]);
    assert!(stated.contains("; ring of up to 64 KiB in memory, of up to 4 GiB in files\n"), "{stated}");
}

#[test]
fn json_lines_are_printed_between_events() {
    let folder = folder("json");
    let record = folder.to_str().unwrap();
    let arguments =
        [&["live", "-", "--print", "-f", "jsonl"], &EMERGENCY[..], &["--record", record]].concat();
    let live = run(&arguments, &(bus(&[50]).join("\n") + "\n"));
    let parsed: Vec<Value> = live.stdout.lines().map(|line| serde_json::from_str(line).unwrap()).collect();
    let of = |kind: &str| parsed.iter().filter(|line| line["kind"] == kind).cloned().collect::<Vec<_>>();
    assert_eq!(of("heartbeat").len(), 200);
    let [trigger] = of("trigger").try_into().unwrap();
    let path = captures(&folder)[0].to_str().unwrap().to_owned();
    assert_eq!(trigger["capture"], path.as_str());
    assert_eq!((&trigger["cause"], &trigger["node"]), (&"emcy".into(), &2.into()));
    assert_eq!(trigger["frames"], serde_json::json!([52, 52]));
    assert!(live.stdout.contains("{\"t\":1700000005.000000000,\"bus\":\"can0\","), "{}", live.stdout);
    let [capture] = of("capture").try_into().unwrap();
    // 4.0 to 15.0 s, with the EMCY.
    assert_eq!((&capture["count"], &capture["end"]), (&112.into(), &"window".into()));
    assert_eq!((&capture["triggers"], &capture["missing"]), (&1.into(), &0.into()));
    // Another format on stdout stays readable.
    let csv = [&["live", "-", "--print", "-f", "csv"], &EMERGENCY[..], &["--record", record]].concat();
    let csv = run(&csv, &(bus(&[50]).join("\n") + "\n"));
    assert!(!csv.stdout.contains("TRIG") && csv.stderr.contains("TRIG"), "{}", csv.stdout);
}

#[test]
fn a_finding_triggers_from_its_first_frame() {
    let folder = folder("finding");
    let record = folder.to_str().unwrap();
    let arguments = ["live", "-", "--check", "--until-finding", "--trigger-finding", "node-lost"];
    let window = ["--before", "100ms", "--after", "300ms", "--record", record];
    // The session ends after the window of the finding, not at the finding.
    let live = run(&[&arguments[..], &window].concat(), &fixture("rules/node-lost.log"));
    assert_eq!(live.code, 1, "{}", live.stderr);
    assert!(live.stdout.contains("1 capture: 1 failed"), "{}", live.stdout);
    // LATE between 0.5 and 0.67 s, LOST at 0.97 s after the heartbeat of 0.77 s: 0.4 to 1.27 s.
    let captures = captures(&folder);
    assert_eq!(captures.len(), 1);
    let times: Vec<String> = lines(&captures[0]).iter().map(|line| line[10..14].to_owned()).collect();
    assert_eq!(times, ["0.40", "0.50", "0.67", "0.77", "1.00"]);
    assert!(captures[0].to_str().unwrap().ends_with("_node5_node-lost.pcapng"));
}

/// The response at 1.051856 s ends the write that is the cause; its request came at 1.050457 s.
#[test]
fn a_finding_triggers_from_the_command_or_write_that_is_its_cause() {
    let folder = folder("fact");
    let window = ["--before", "1ms", "--after", "300ms", "--record", folder.to_str().unwrap()];
    let arguments = [&["live", "-", "--trigger-finding", "sync-producer"], &window[..]].concat();
    let live = run(&arguments, &fixture("rules/sync-producer.log"));
    assert_eq!(live.code, 0, "{}", live.stderr);
    let captures = captures(&folder);
    assert_eq!(captures.len(), 1);
    let first = lines(&captures[0]).first().cloned().unwrap();
    assert!(first.starts_with("(1700000001.050457") && first.contains("604#2305100080000000"), "{first}");
}

/// Times and signals of all PDO events, without their origin, which the bus file changes.
fn values(arguments: &[&str]) -> Vec<(String, Value)> {
    let decoded =
        run(&[&["decode", "-f", "jsonl", "--filter", "kind == pdo && signals"], arguments].concat(), "");
    assert_eq!(decoded.code, 0, "{}", decoded.stderr);
    let values = |line: &str| {
        let event: Value = serde_json::from_str(line).unwrap();
        let signals = event.get("signals").and_then(Value::as_array).unwrap().iter();
        let of = |signal: &Value| {
            serde_json::json!([signal["name"], signal["raw"], signal["value"], signal["label"]])
        };
        (line.split(',').next().unwrap().to_owned(), signals.map(of).collect())
    };
    decoded.stdout.lines().map(values).collect()
}

/// The capture starts after the frames that mapped the PDOs; its bus file contains the mapping.
#[test]
fn the_bus_file_gives_the_values_of_the_live_bus() {
    let folder = folder("state");
    for name in ["devices/md2", "devices/pve", "devices/md2_mapping", "machine/machine"] {
        let (path, record) = (format!("fixtures/{name}.log"), folder.join(name.replace('/', "_")));
        let text = fixture(&format!("{name}.log"));
        let frames = text.lines().filter(|line| line.starts_with('(')).count();
        // From two thirds of the capture to its end.
        let filter = format!("frames == {}", frames * 2 / 3);
        let window = ["--before", "0s", "--after", "1h", "--trigger", &filter];
        let live = run(&[&["live", "-", "--record", record.to_str().unwrap()], &window[..]].concat(), &text);
        assert_eq!(live.code, 0, "{name}: {}", live.stderr);
        let [capture] = captures(&record).try_into().unwrap();
        let bus_file = capture.with_extension("toml");
        let first = frames - lines(&capture).len() + 1;
        let (capture, bus_file) = (capture.to_str().unwrap(), bus_file.to_str().unwrap());
        let expected = values(&["--from", &format!("#{first}"), &path]);
        assert!(!expected.is_empty(), "{name}");
        assert_eq!(values(&["--bus", bus_file, capture]), expected, "{name}");
        assert_ne!(values(&[capture]), expected, "{name}: the bus file makes the difference");
    }
}

#[test]
fn a_program_gets_the_name_of_the_capture() {
    let folder = folder("program");
    let (program, seen) = (folder.join("run.sh"), folder.join("seen"));
    let script = format!("#!/bin/sh\necho \"$# $1\" >> {}\nexit 3\n", seen.display());
    fs::write(&program, script).unwrap();
    fs::set_permissions(&program, fs::Permissions::from_mode(0o755)).unwrap();
    let (record, program) = (folder.join("day"), program.to_str().unwrap());
    let record = record.to_str().unwrap();
    let arguments =
        [&["live", "-", "--on-trigger", program], &EMERGENCY[..], &["--after", "0s", "--record", record]];
    let live = run(&arguments.concat(), &(bus(&[50, 150]).join("\n") + "\n"));
    assert_eq!(live.code, 0, "{}", live.stderr);
    let captures = captures(Path::new(record));
    let expected: String = captures.iter().flat_map(|path| ["1 ", path.to_str().unwrap(), "\n"]).collect();
    assert_eq!((captures.len(), fs::read_to_string(&seen).unwrap()), (2, expected));
    let failed = format!("--on-trigger {program}: exit status: 3 for {}", captures[1].display());
    assert!(live.stderr.contains(&failed), "{}", live.stderr);
    let arguments = [&["live", "-", "--on-trigger", "/no/such"], &EMERGENCY[..], &["--record", record]];
    let live = run(&arguments.concat(), &(bus(&[50]).join("\n") + "\n"));
    assert_eq!(live.code, 0, "{}", live.stderr);
    assert!(live.stderr.contains("--on-trigger /no/such: No such file"), "{}", live.stderr);
}

#[test]
fn impossible_triggers_are_refused_before_recording() {
    let folder = folder("refused");
    let record = folder.join("day");
    let refused = |arguments: &[&str], text: &str| {
        let arguments = [&["live", "-", "--record", record.to_str().unwrap()], arguments].concat();
        let live = run(&arguments, "");
        assert_eq!(live.code, 2, "{arguments:?}: {}", live.stderr);
        assert!(live.stderr.contains(text), "{arguments:?}: {}", live.stderr);
        assert!(!record.exists(), "{arguments:?}");
    };
    refused(&["--trigger", "knd == emcy"], "unknown field 'knd'; did you mean kind?");
    refused(&["--trigger", "kind == emcyy"], "unknown kind 'emcyy'; did you mean emcy?");
    refused(&["--trigger", "state == runing"], "runing");
    refused(&["--trigger", "rule == guard-lat"], "--trigger: unknown rule 'guard-lat'");
    refused(&["--trigger-finding", "guard-lat"], "unknown rule 'guard-lat'; did you mean 'guard-late'?");
    refused(&["--trigger-finding", "rexroth-sydfec:no"], "profile 'rexroth-sydfec' has no rule 'no'");
    refused(&["--trigger", "kind", "--before", "1d"], "expected a time up to 24h");
    refused(&["--trigger", "kind", "--record-size", "1M"], "cannot be used with");
    refused(&["--print", "--after", "1s"], "--trigger");
    let live = run(&["live", "-", "--trigger", "kind"], "");
    assert!(live.code == 2 && live.stderr.contains("--record"), "{}", live.stderr);
    let live = run(&["live", "-", "--trigger", "kind", "--record", "/no/such/folder"], "");
    assert!(live.code == 2 && live.stderr.contains("/no/such/folder: cannot create the folder"));
    for file in ["-", "run.pcapng"] {
        let live = run(&["live", "-", "--trigger", "kind", "--record", file], "");
        assert!(live.code == 2 && live.stderr.contains("need a folder"), "{}", live.stderr);
    }
    // No user can create files there, not even root.
    let live = run(&["live", "-", "--trigger", "kind", "--record", "/proc"], "");
    assert!(live.code == 2 && live.stderr.contains("/proc: cannot create files in it"), "{}", live.stderr);
}

/// A signal, object or node can be learnt later.
#[test]
fn what_never_appears_is_a_remark() {
    let folder = folder("unknown");
    let record = folder.to_str().unwrap();
    for filter in ["signals.name == nonsense", "object == 0x9999:00", "node == 99"] {
        let live = run(&["live", "-", "--trigger", filter, "--record", record], &fixture("canopen/emcy.log"));
        assert_eq!(live.code, 0, "{}", live.stderr);
        let remark = format!("live: no event matched --trigger '{filter}'");
        assert!(live.stderr.contains(&remark), "{}", live.stderr);
    }
    assert!(captures(&folder).is_empty());
}

#[test]
fn limits_are_printed_once() {
    let folder = folder("limits");
    let record = folder.to_str().unwrap();
    let arguments =
        [&["live", "-", "--trigger-files", "1", "--after", "0s"], &EMERGENCY[..], &["--record", record]];
    let live = run(&arguments.concat(), &(bus(&[20, 80, 140]).join("\n") + "\n"));
    assert_eq!(live.code, 0, "{}", live.stderr);
    assert_eq!(captures(&folder).len(), 1);
    let remark = "live: limit of --trigger-files reached; later triggers are not recorded";
    assert_eq!(live.stderr.matches(remark).count(), 1, "{}", live.stderr);
    assert_eq!(
        live.stdout.matches("; not recorded: limit of --trigger-files {").count(),
        2,
        "{}",
        live.stdout
    );
}

/// Text of a bus never becomes a file name, and never reaches the terminal raw.
#[test]
fn hostile_text_is_inert() {
    let folder = folder("hostile");
    let record = folder.join("day");
    let capture = "(1700000000.000000) ../$(id)\u{1b}[2J 081#1081010000000000\n";
    let arguments = ["live", "-", "--trigger", "kind == emcy || kind == frame || kind == note"];
    let live = run(&[&arguments[..], &["--record", record.to_str().unwrap()]].concat(), capture);
    assert!(!live.stdout.contains('\u{1b}') && !live.stderr.contains('\u{1b}'), "{}", live.stdout);
    let names = fs::read_dir(&record).unwrap().map(|entry| entry.unwrap().file_name().into_string().unwrap());
    for name in names {
        assert!(name.chars().all(|it| it.is_ascii_alphanumeric() || "-_.".contains(it)), "{name}");
    }
    assert_eq!(fs::read_dir(&folder).unwrap().count(), 1);
}

/// Ctrl-C completes the capture with the frames so far.
#[test]
fn an_interrupt_completes_the_capture() {
    let folder = folder("trigger-interrupt");
    let record = folder.to_str().unwrap();
    let mut live = Running::start(&[&["-"], &EMERGENCY[..], &["--record", record]].concat());
    live.input().write_all((bus(&[10])[..20].join("\n") + "\n").as_bytes()).unwrap();
    live.line_with("TRIG");
    let id = live.child.id().to_string();
    assert!(Command::new("kill").args(["-INT", &id]).status().unwrap().success());
    let summary = live.line_with("FILE");
    assert!(summary.contains("; stopped before the end of its window"), "{summary}");
    let (code, text) = live.end();
    assert_eq!(code, Some(0), "{text}");
    assert_eq!(lines(&captures(&folder)[0]), bus(&[10])[..20]);
}

/// The file of a window that is open grows with the frames; the ring on disk contains all of them.
#[test]
fn a_killed_program_loses_at_most_a_second() {
    let folder = folder("trigger-killed");
    let record = folder.to_str().unwrap();
    let arguments =
        [&["-", "--ring-files", "1M"], &EMERGENCY[..], &["--after", "1h", "--record", record]].concat();
    let mut live = Running::start(&arguments);
    let bus = bus(&[50]);
    live.input().write_all((bus[..100].join("\n") + "\n").as_bytes()).unwrap();
    live.line_with("TRIG");
    let begin = Instant::now();
    let count = |paths: &[PathBuf]| paths.iter().map(|path| lines(path).len()).collect::<Vec<_>>();
    // 4.0 s is frame 41; the ring is the second file.
    while count(&captures(&folder)) != [60, 100] {
        assert!(begin.elapsed() < LIMIT, "{:?}", count(&captures(&folder)));
        std::thread::sleep(std::time::Duration::from_millis(20));
    }
    live.child.kill().unwrap();
    live.child.wait().unwrap();
    let captures = captures(&folder);
    assert_eq!(lines(&captures[0]), bus[40..100]);
    assert_eq!(lines(&captures[1]), bus[..100]);
}

/// Files that may not grow beyond 4 or 8 KiB.
#[test]
fn frames_missing_in_a_capture_are_an_error() {
    let folder = folder("trigger-limited");
    let script = "trap '' XFSZ; ulimit -f 8; exec \"$0\" live - --trigger 'kind == emcy' --record \"$1\"";
    let mut command = Command::new("sh");
    command.args(["-c", script, env!("CARGO_BIN_EXE_cobscope"), folder.to_str().unwrap()]);
    let mut child =
        command.stdin(Stdio::piped()).stdout(Stdio::piped()).stderr(Stdio::piped()).spawn().unwrap();
    let input = bus(&[50]);
    child.stdin.take().unwrap().write_all((input.join("\n") + "\n").as_bytes()).unwrap();
    let output = child.wait_with_output().unwrap();
    let text = String::from_utf8(output.stderr).unwrap();
    assert_eq!(output.status.code(), Some(3), "{text}");
    let captures = captures(&folder);
    let written = lines(&captures[0]);
    // 0 to 15 s, with the EMCY.
    let missing = 152 - written.len();
    assert!(missing > 20 && written.len() > 50, "{missing} missing");
    assert_eq!(written, input[..written.len()]);
    let path = captures[0].display();
    assert!(
        text.contains(&format!("{path}: File too large (os error 27): {missing} frames not written\n")),
        "{text}"
    );
}
