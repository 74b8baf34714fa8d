//! Parts of one capture: joined by time, clock, buses and identity, with the events and findings of the whole.

#![expect(clippy::indexing_slicing, reason = "a test that cannot continue has failed")]

use std::fs;
use std::path::{Path, PathBuf};

use serde_json::Value;

use crate::check::folder;
use crate::cli::{Output, run_in};
use crate::support::workspace;

/// Runs the program in a folder.
fn in_folder(path: &Path, arguments: &[&str]) -> Output {
    run_in(path, arguments, "")
}

/// Writes files into a fresh folder.
fn with_files(name: &str, files: &[(&str, &str)]) -> PathBuf {
    let path = folder(&format!("series-{name}"));
    for (file, text) in files {
        fs::write(path.join(file), text).unwrap();
    }
    path
}

/// Heartbeats of node 5 in operational, one per second from `from` to `to`, on an absolute clock.
fn heartbeats(from: u32, to: u32) -> String {
    let line = |second| format!("({}.000000) can0 705#05\n", 1_700_000_000 + second);
    (from..=to).map(line).collect::<Vec<_>>().concat()
}

/// Number of captures that `check` judges.
fn judged(path: &Path, arguments: &[&str]) -> Vec<String> {
    let output = in_folder(path, &[&["check", "-f", "jsonl"], arguments].concat());
    let lines = output.stdout.lines().map(|line| serde_json::from_str::<Value>(line).unwrap());
    let summaries = lines.filter(|line| line["kind"] == "summary");
    summaries.map(|line| line["capture"].as_str().unwrap().to_owned()).collect()
}

/// Parts of `split -n l/N`: each ends with the line that contains the end of its share of the bytes.
fn split(text: &str, count: usize) -> Vec<String> {
    let mut parts = vec![String::new(); count];
    let (mut offset, share) = (0, (text.len() / count).max(1));
    for line in text.split_inclusive('\n') {
        parts[(offset / share).min(count - 1)].push_str(line);
        offset += line.len();
    }
    parts
}

/// Lines of JSON without the references to files and without the totals.
fn without_references(output: &str) -> Vec<String> {
    fn strip(value: &mut Value) {
        match value {
            Value::Object(members) => {
                for key in ["capture", "parts", "file", "line", "offset"] {
                    members.remove(key);
                }
                members.values_mut().for_each(strip);
            }
            Value::Array(items) => items.iter_mut().for_each(strip),
            _ => {}
        }
    }
    let mut lines = Vec::new();
    for line in output.lines() {
        let mut value: Value = serde_json::from_str(line).unwrap();
        if value["kind"] != "total" {
            strip(&mut value);
            lines.push(value.to_string());
        }
    }
    lines
}

/// Text fixtures in candump's log format on an absolute clock.
fn logs() -> Vec<PathBuf> {
    let mut folders = vec![workspace().join("fixtures")];
    let mut logs = Vec::new();
    while let Some(folder) = folders.pop() {
        for entry in fs::read_dir(folder).unwrap() {
            let path = entry.unwrap().path();
            if path.is_dir() {
                folders.push(path);
            } else if path.extension().is_some_and(|suffix| suffix == "log") {
                let text = fs::read(&path).unwrap();
                let is_log = text.split(|byte| *byte == b'\n').find(|line| !line.starts_with(b"#"));
                if is_log.is_some_and(|line| line.starts_with(b"(1700000000.") && line.contains(&b'#')) {
                    logs.push(path);
                }
            }
        }
    }
    logs.sort();
    logs
}

/// Gaps of the fixtures exceed 5 s; this covers the longest one.
const ANY_GAP: [&str; 2] = ["--part-gap", "100000"];

#[test]
fn a_capture_in_parts_has_the_events_and_findings_of_the_whole() {
    let mut compared = 0;
    for path in logs() {
        let shown = path.to_str().unwrap();
        let Ok(text) = fs::read_to_string(&path) else { continue };
        // Two devices with one node-ID: their identities contradict, so the parts are not joined.
        if path.ends_with("canopen/two_responses.log") {
            continue;
        }
        let check = in_folder(&workspace(), &["check", "-f", "jsonl", shown]);
        if !check.stdout.contains("\"kind\":\"finding\"") {
            continue;
        }
        let events = in_folder(&workspace(), &["decode", "-f", "jsonl", shown]);
        for count in [4, 8] {
            let parts = split(&text, count);
            if parts.iter().filter(|part| part.contains("\n(")).count() < 2 {
                // One line, or line ends of old Macs.
                continue;
            }
            let names: Vec<String> = (0..u8::try_from(count).unwrap())
                .map(|part| format!("xa{}", char::from(b'a' + part)))
                .collect();
            let files: Vec<_> =
                names.iter().map(String::as_str).zip(parts.iter().map(String::as_str)).collect();
            let place = with_files("whole", &files);
            let names: Vec<&str> = names.iter().map(String::as_str).collect();
            for (command, whole) in [("check", &check), ("decode", &events)] {
                let joined = in_folder(&place, &[&[command, "-f", "jsonl"], &ANY_GAP[..], &names].concat());
                let (found, expected) =
                    (without_references(&joined.stdout), without_references(&whole.stdout));
                let differs = found.iter().zip(&expected).find(|(found, expected)| found != expected);
                let stderr = &joined.stderr;
                assert_eq!(differs, None, "{shown} in {count} parts, {command}: {stderr}");
                assert_eq!(found.len(), expected.len(), "{shown} in {count} parts, {command}: {stderr}");
            }
            compared += 1;
        }
    }
    assert!(compared > 100, "{compared}");
}

#[test]
fn other_formats_in_parts_have_the_findings_of_the_whole() {
    // Marks of the fixture: 14 frames, late at frame 9, silent from 10 on. The cut is between the two.
    let log = workspace().join("fixtures/rules/node-lost.log");
    let log = log.to_str().unwrap();
    let place = with_files("formats", &[]);
    for suffix in ["asc", "trc", "pcapng", "blf", "csv", "mf4", "mcap", "pcap"] {
        let names = [format!("part1.{suffix}"), format!("part2.{suffix}")];
        let [first, second] = [names[0].as_str(), names[1].as_str()];
        let whole = format!("whole.{suffix}");
        if in_folder(&place, &["convert", log, &whole]).code != 0 {
            // A format that cannot be written.
            continue;
        }
        assert_eq!(in_folder(&place, &["convert", "--to", "#9", log, first]).code, 0, "{suffix}");
        assert_eq!(in_folder(&place, &["convert", "--from", "#10", log, second]).code, 0, "{suffix}");
        let all = in_folder(&place, &["check", "-f", "jsonl", &whole]);
        let parts = in_folder(&place, &["check", "-f", "jsonl", first, second]);
        let expected = without_references(&all.stdout);
        assert!(expected.iter().any(|line| line.contains("node-lost|can") || line.contains("\"node-lost\"")));
        assert_eq!(without_references(&parts.stdout), expected, "{suffix}: {}", parts.stderr);
    }
}

#[test]
fn references_name_the_part() {
    // The second part has 3 lines: an unreadable one, then the frames 4 and 5 of the series.
    let second = format!("rubbish\n{}", heartbeats(4, 5));
    let place = with_files("references", &[("part1.log", &heartbeats(1, 3)), ("part2.log", &second)]);
    let output = in_folder(&place, &["decode", "part1.log", "part2.log"]);
    assert!(output.stdout.contains("UNREAD part2.log:1: "), "{}", output.stdout);
    assert_eq!(
        output.stderr,
        "cobscope: part1.log..part2.log: 2 parts of one capture: part1.log from {1}, part2.log from {4}; \
         --separate reads each alone\n\
         cobscope: part1.log..part2.log: 1 line or record unreadable (part2.log line 1: not a candump line; found \
         \"rubbish\"); all others decoded\n"
    );
    let output = in_folder(&place, &["decode", "-f", "jsonl", "part1.log", "part2.log"]);
    assert!(output.stdout.contains(r#""file":"part2.log","line":1"#), "{}", output.stdout);
    assert!(output.stdout.contains(r#""frames":[5,5]"#), "{}", output.stdout);
    assert!(!output.stdout.contains("\"capture\":"), "one capture needs no name");
}

#[test]
fn findings_refer_to_the_lines_of_parts() {
    let log = fs::read_to_string(workspace().join("fixtures/rules/node-lost.log")).unwrap();
    // The frame after which the node is silent is {10}: the fifth frame of the second part.
    let frames = log.lines().filter(|line| line.starts_with('('));
    let frames: Vec<&str> = frames.collect();
    let (one, two) = (frames[..5].join("\n") + "\n", frames[5..].join("\n") + "\n");
    let place = with_files("lines", &[("run.log", &one), ("run-0002.log", &two)]);
    // A folder is grouped like files on the command line; the later part has the number.
    let text = in_folder(&place, &["check", "."]);
    assert!(text.stdout.contains("at 0.970 s {10} ./run-0002.log:5"), "{}", text.stdout);
    let junit = in_folder(&place, &["check", "-f", "junit", "run.log", "run-0002.log"]);
    assert!(junit.stdout.contains("<testsuite name=\"run.log..run-0002.log\""), "{}", junit.stdout);
    assert!(junit.stdout.contains("    run-0002.log:5"), "{}", junit.stdout);
    let github = in_folder(&place, &["check", "-f", "github", "run.log", "run-0002.log"]);
    assert!(
        github.stdout.contains("::error file=run-0002.log,line=5,title=node-lost::"),
        "{}",
        github.stdout
    );
    let sarif = in_folder(&place, &["check", "-f", "sarif", "run.log", "run-0002.log"]);
    let sarif: Value = serde_json::from_str(&sarif.stdout).unwrap();
    let run = &sarif["runs"][0];
    assert_eq!(run["artifacts"].as_array().unwrap().len(), 2);
    let lines = run["results"].as_array().unwrap().iter().map(|result| {
        let place = &result["locations"][0]["physicalLocation"];
        (place["artifactLocation"]["index"].as_u64(), place["region"]["startLine"].as_u64())
    });
    assert!(lines.clone().any(|line| line == (Some(1), Some(5))), "{:?}", lines.collect::<Vec<_>>());
    let baseline = ["check", "--baseline", "known.json", "run.log", "run-0002.log"];
    in_folder(&place, &[&baseline[..], &["--update-baseline"]].concat());
    let known = fs::read_to_string(place.join("known.json")).unwrap();
    assert!(known.contains(r#""capture":"run.log..run-0002.log""#), "{known}");
    assert_eq!(in_folder(&place, &baseline).code, 0);
}

#[test]
fn files_are_joined_only_within_the_gap() {
    let one = heartbeats(1, 3);
    let place = |name: &str, second: &str| with_files(name, &[("a1.log", &one), ("a2.log", second)]);
    let both = ["a1.log", "a2.log"];
    let next = place("gap-5", &heartbeats(8, 9));
    assert_eq!(judged(&next, &both), ["a1.log..a2.log"]);
    assert_eq!(judged(&next, &["--separate", "a1.log", "a2.log"]), both);
    assert_eq!(judged(&next, &["--part-gap", "4.9", "a1.log", "a2.log"]), both);
    let late = place("gap-6", &heartbeats(9, 9));
    assert_eq!(judged(&late, &both), both);
    assert_eq!(judged(&late, &["--part-gap", "6", "a1.log", "a2.log"]), ["a1.log..a2.log"]);
    let output = in_folder(&late, &["check", "a1.log", "a2.log"]);
    let reason = "a2.log: not joined to a1.log: starts 6.000 s after its last frame (--part-gap 5.000 s)\n";
    assert!(output.stderr.contains(reason), "{}", output.stderr);
}

#[test]
fn other_loggers_clocks_and_buses_are_not_joined() {
    let one = heartbeats(1, 3);
    let both = ["a1.log", "a2.log"];
    let relative = "(0.000000) can0 705#05\n(1.000000) can0 705#05\n";
    let other_bus = heartbeats(4, 5).replace("can0", "can1");
    // Two parts that overlap by one frame, two loggers at the same time, another bus, a relative clock.
    let cases = [
        ("overlap", one.as_str(), heartbeats(3, 5)),
        ("loggers", &one, heartbeats(2, 5)),
        ("bus", &one, other_bus),
        ("clock", &one, relative.to_owned()),
        ("zero", "(0.000000) can0 705#05\n(0.500000) can0 705#05\n", "(0.600000) can0 705#05\n".to_owned()),
        ("zero-again", relative, relative.to_owned()),
    ];
    for (name, first, second) in &cases {
        let place = with_files(name, &[("a1.log", first), ("a2.log", second)]);
        assert_eq!(judged(&place, &both), both, "{name}");
    }
    let place = with_files("overlap-note", &[("a1.log", &one), ("a2.log", &heartbeats(3, 5))]);
    let output = in_folder(&place, &["check", "a1.log", "a2.log"]);
    assert!(output.stderr.contains("starts with its last frame, so they overlap"), "{}", output.stderr);
    // A relative clock that continues.
    let place = with_files("continues", &[("a1.log", relative), ("a2.log", "(2.000000) can0 705#05\n")]);
    assert_eq!(judged(&place, &both), ["a1.log..a2.log"]);
    // Both on the same bus in one file: the overlapping ones are two buses.
    let place = with_files("merged", &[("a1.log", &one), ("a2.log", &heartbeats(2, 5))]);
    let output = in_folder(&place, &["convert", "-f", "candump", "a1.log", "a2.log", "-"]);
    assert!(output.stdout.contains("can0@2"), "{}", output.stdout);
    let place = with_files("chained", &[("a1.log", &one), ("a2.log", &heartbeats(4, 5))]);
    let output = in_folder(&place, &["convert", "-f", "candump", "a1.log", "a2.log", "-"]);
    assert_eq!(output.stdout, heartbeats(1, 5));
}

#[test]
fn a_node_with_another_identity_starts_another_capture() {
    // CiA 301 §7.2.4.3.6: 43h is an expedited upload response with 4 bytes; 1018:04 is the serial number.
    let with_serial = |from, to, serial: u8| {
        let time = 1_700_000_000 + from;
        format!("{}({time}.500000) can0 585#43181004{serial:02X}000000\n", heartbeats(from, to - 1))
            + &heartbeats(to, to)
    };
    let both = ["a1.log", "a2.log"];
    for (name, serial, expected) in
        [("same-serial", 7, vec!["a1.log..a2.log"]), ("other-serial", 8, both.to_vec())]
    {
        let second = with_serial(4, 5, serial);
        let place = with_files(name, &[("a1.log", &with_serial(1, 2, 7)), ("a2.log", &second)]);
        assert_eq!(judged(&place, &both), expected, "{name}");
    }
    let place = folder("series-other-serial");
    fs::write(place.join("a1.log"), with_serial(1, 2, 7)).unwrap();
    fs::write(place.join("a2.log"), with_serial(4, 5, 8)).unwrap();
    let output = in_folder(&place, &["check", "a1.log", "a2.log"]);
    let reason = "1018:04 of can0 node 5 is 00000008, before 00000007";
    assert!(output.stderr.contains(reason), "{}", output.stderr);
}

#[test]
fn a_part_whose_clock_steps_stays_in_its_place() {
    // The clock of the second part steps back by 2 s; the third one continues its last frame.
    let second = heartbeats(4, 6) + &heartbeats(5, 6);
    let files = [("a1.log", heartbeats(1, 3)), ("a2.log", second), ("a3.log", heartbeats(7, 8))];
    let all: Vec<(&str, &str)> = files.iter().map(|(name, text)| (*name, text.as_str())).collect();
    let place = with_files("step", &all);
    assert_eq!(judged(&place, &["a1.log", "a2.log", "a3.log"]), ["a1.log..a3.log"]);
    let output = in_folder(&place, &["convert", "-f", "candump", "a1.log", "a2.log", "a3.log", "-"]);
    let expected: String = files.iter().map(|(_, text)| text.as_str()).collect();
    assert_eq!(output.stdout, expected, "the order of the parts, not of the times");
}

#[test]
fn a_folder_of_other_captures_is_not_joined() {
    // Consecutive in time, but the names do not count; on the command line they follow each other.
    let files = [("brake.log", heartbeats(1, 3)), ("pump.log", heartbeats(4, 5))];
    let all: Vec<(&str, &str)> = files.iter().map(|(name, text)| (*name, text.as_str())).collect();
    let place = with_files("folder", &all);
    assert_eq!(judged(&place, &["."]), ["./brake.log", "./pump.log"]);
    assert_eq!(judged(&place, &["brake.log", "pump.log"]), ["brake.log..pump.log"]);
    assert_eq!(judged(&place, &["pump.log", "brake.log"]), ["pump.log", "brake.log"]);
}

#[test]
fn a_part_that_ends_early_costs_nothing_of_the_others() {
    // A compressed part that was cut: its end is reported, and the later part is read.
    let place =
        with_files("cut", &[("a1.log", &heartbeats(1, 3)), ("a2.log", &heartbeats(4, 5)), ("a3.log", "")]);
    let output = in_folder(&place, &["decode", "-f", "jsonl", "a1.log", "a2.log", "a3.log"]);
    // Next to two parts, an empty file is a part without frames.
    assert_eq!((output.code, output.stdout.contains(r#""frames":[5,5]"#)), (0, true), "{}", output.stderr);
    let output = in_folder(&place, &["decode", "a1.log", "a3.log"]);
    assert!(output.code != 0 && output.stderr.contains("a3.log"), "{}", output.stderr);
}

#[test]
fn relative_captures_are_joined_only_on_request() {
    // Each part starts near zero. Heartbeats every second: 3 frames, then 2, then 2 on the clock of the second part.
    let part = |from: u32, to: u32| {
        let line = |second| format!("({second}.100000) can0 705#05\n");
        (from..=to).map(line).collect::<Vec<_>>().concat()
    };
    let files = [("a1.log", part(0, 2)), ("a2.log", part(0, 1)), ("a3.log", part(2, 3))];
    let all: Vec<(&str, &str)> = files.iter().map(|(name, text)| (*name, text.as_str())).collect();
    let place = with_files("request", &all);
    let names = ["a1.log", "a2.log", "a3.log"];
    assert_eq!(judged(&place, &names[..2]), names[..2]);
    assert_eq!(judged(&place, &["--join", "a1.log", "a2.log", "a3.log"]), ["a1.log..a3.log"]);
    // Last frame of part 1 at 2.1 s: part 2 starts there; part 3 continues its clock, so both are moved by 2 s.
    let times = "(0.100000)(1.100000)(2.100000)(2.100000)(3.100000)(4.100000)(5.100000)";
    let output = in_folder(&place, &[&["convert", "--join", "-f", "candump"], &names[..], &["-"]].concat());
    let found: String = output.stdout.lines().map(|line| line.split(' ').next().unwrap()).collect();
    assert_eq!(found, times, "{}", output.stderr);
    let decode = [&["decode", "--join", "--all", "-f", "jsonl"], &names[..]].concat();
    let output = in_folder(&place, &decode);
    assert!(output.stdout.contains(r#""frames":[7,7]"#), "{}", output.stdout);
    let note = "a1.log..a3.log: 3 parts of one capture: a1.log from {1}, a2.log from {4}, a3.log from {6}; their clocks \
                start again, so the times of each continue at the last frame of the one before (--join)";
    assert!(output.stderr.contains(note), "{}", output.stderr);
    for command in ["stats", "why"] {
        let output = in_folder(&place, &[&[command, "--join"], &names[..]].concat());
        assert!(output.stderr.contains("3 parts of one capture"), "{command}: {}", output.stderr);
    }
    let both = in_folder(&place, &["check", "--join", "--separate", "a1.log", "a2.log"]);
    assert!(both.stderr.contains("--separate"), "{}", both.stderr);
}

#[test]
fn clocks_that_do_not_fit_are_not_joined_on_request() {
    let (one, relative) = (heartbeats(1, 3), "(0.000000) can0 705#05\n");
    let cases = [
        ("early", heartbeats(2, 5), "starts 1.000 s before its last frame"),
        ("mixed", relative.to_owned(), "only one of them has an absolute clock"),
    ];
    for (name, second, reason) in cases {
        let place = with_files(name, &[("a1.log", &one), ("a2.log", &second)]);
        let output = in_folder(&place, &["check", "--join", "a1.log", "a2.log"]);
        let expected = format!("a2.log: not joined to a1.log: {reason}\n");
        assert!(output.stderr.contains(&expected), "{name}: {}", output.stderr);
    }
    // A gap of any length on an absolute clock.
    let place = with_files("gap-any", &[("a1.log", &one), ("a2.log", &heartbeats(900, 901))]);
    assert_eq!(judged(&place, &["--join", "a1.log", "a2.log"]), ["a1.log..a2.log"]);
}

/// Writable text formats; each fixture is cut in one of them.
const TEXT: [&str; 4] = ["log", "asc", "trc", "csv"];

#[test]
fn captures_cut_by_convert_have_the_events_and_findings_of_the_whole() {
    let mut compared = 0;
    for (path, suffix) in logs().iter().zip(TEXT.iter().cycle()) {
        let shown = path.to_str().unwrap();
        let check = in_folder(&workspace(), &["check", "-f", "jsonl", shown]);
        if !check.stdout.contains("\"kind\":\"finding\"") {
            continue;
        }
        let place = with_files("cut-by-convert", &[]);
        let name = |part: &str| format!("{part}.{suffix}");
        let convert = |arguments: &[&str], target: &str| {
            let output = in_folder(&place, &[&["convert"], arguments, &[shown, target]].concat());
            assert_eq!(output.code, 0, "{shown} to {target}: {}", output.stderr);
        };
        convert(&[], &name("whole"));
        let frames = in_folder(&place, &["convert", "-f", "candump", &name("whole"), "-"]).stdout;
        let middle = frames.lines().filter(|line| line.starts_with('(')).count() / 2;
        if middle == 0 {
            continue;
        }
        convert(&["--to", &format!("#{middle}")], &name("part1"));
        convert(&["--from", &format!("#{}", middle + 1)], &name("part2"));
        for command in ["check", "decode"] {
            let read = |files: &[&str]| {
                in_folder(&place, &[&[command, "-f", "jsonl"], &ANY_GAP[..], files].concat())
            };
            let whole = without_references(&read(&[&name("whole")]).stdout);
            let parts = read(&[&name("part1"), &name("part2")]);
            let found = without_references(&parts.stdout);
            let differs = found.iter().zip(&whole).find(|(found, whole)| found != whole);
            assert_eq!(differs, None, "{shown} as {suffix} at {middle}, {command}: {}", parts.stderr);
            assert_eq!(
                found.len(),
                whole.len(),
                "{shown} as {suffix} at {middle}, {command}: {}",
                parts.stderr
            );
        }
        compared += 1;
    }
    assert!(compared > 100, "{compared}");
}

#[test]
fn notes_on_named_nodes_name_the_series() {
    let place = with_files("named", &[("a1.log", &heartbeats(1, 3)), ("a2.log", &heartbeats(4, 5))]);
    for command in ["check", "decode", "stats", "why"] {
        let output = in_folder(&place, &[command, "--node", "99=rexroth-sydfec", "a1.log", "a2.log"]);
        let note = "a1.log..a2.log: node 99/63 sent no frame; nodes present: 5/05\n";
        assert_eq!(output.stderr.matches(note).count(), 1, "{command}: {}", output.stderr);
    }
}
