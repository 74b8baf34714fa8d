//! `cobscope diff`. The causes are those that the stories in `fixtures/` state; the words that name them are those of the
//! output, so that these tests find changes of the output, not a wrong word.

use std::fmt::Write as _;
use std::fs;
use std::path::{Path, PathBuf};

use serde_json::Value;

use crate::check::folder;
use crate::cli::{Output, run};
use crate::report::{assert_inert, parsed};
use crate::schema::violations;
use crate::support::workspace;

fn diff<T: AsRef<str>>(arguments: &[T]) -> Output {
    let arguments = arguments.iter().map(AsRef::as_ref);
    run(&std::iter::once("diff").chain(arguments).collect::<Vec<_>>(), "")
}

/// Captures of one device, with its profile and its lines of the bus file.
struct Machine {
    folder: &'static str,
    profiles: &'static [&'static str],
    bus_file: &'static str,
    /// Identifier of the TPDO and lowest byte of a measured value in it.
    measured: (&'static str, usize),
}

const MACHINES: [Machine; 5] = [
    Machine {
        folder: "danfoss-pve-ci",
        profiles: &["32=danfoss-pve-ci:pvea", "33=danfoss-pve-ci:pvea"],
        bus_file: "",
        measured: ("1A0#", 2),
    },
    Machine {
        folder: "rexroth-ifb-iac",
        profiles: &["5=rexroth-ifb-iac"],
        bus_file: "",
        measured: ("185#", 2),
    },
    Machine {
        folder: "rexroth-sydfec",
        profiles: &["2=rexroth-sydfec"],
        bus_file: "",
        measured: ("182#", 1),
    },
    Machine {
        folder: "rexroth-vpcd",
        profiles: &["63=rexroth-vpcd"],
        bus_file: "[node.63]\nrx_area = [\"2C67/4\", \"2C74/4\"]\ntx_area = [\"2F10/4\", \"2F07/4\"]\n",
        measured: ("1BF#", 0),
    },
    Machine {
        folder: "wandfluh-md2",
        profiles: &["1=wandfluh-md2:amplifier"],
        bus_file: "",
        measured: ("181#", 2),
    },
];

impl Machine {
    fn options(&self) -> Vec<String> {
        let nodes = self.profiles.iter().flat_map(|profile| ["--node".to_owned(), (*profile).to_owned()]);
        let mut options: Vec<_> = nodes.collect();
        if !self.bus_file.is_empty() {
            let path = Path::new(env!("CARGO_TARGET_TMPDIR")).join(format!("diff-{}.toml", self.folder));
            fs::write(&path, self.bus_file).unwrap();
            options.extend(["--bus".to_owned(), path.to_str().unwrap().to_owned()]);
        }
        options
    }

    fn clean(&self) -> String {
        format!("fixtures/stories/{}/clean-run.log", self.folder)
    }

    fn text(&self) -> String {
        fs::read_to_string(workspace().join(self.clean())).unwrap()
    }
}

/// Writes a capture to a folder of this test.
fn write(folder: &Path, name: &str, text: &str) -> String {
    let path: PathBuf = folder.join(name);
    fs::write(&path, text).unwrap();
    path.to_str().unwrap().to_owned()
}

/// Lines with their time in µs, and the rest of the line.
fn lines(text: &str) -> Vec<(i64, &str)> {
    let split = |line| {
        let (time, rest) = str::strip_prefix(line, "(")?.split_once(") ")?;
        let (seconds, micros) = time.split_once('.')?;
        Some((seconds.parse::<i64>().ok()? * 1_000_000 + micros.parse::<i64>().ok()?, rest))
    };
    text.lines().filter_map(split).collect()
}

fn capture(lines: &[(i64, &str)]) -> String {
    lines.iter().fold(String::new(), |mut text, (time, rest)| {
        let _ = writeln!(text, "({}.{:06}) {rest}", time / 1_000_000, time % 1_000_000);
        text
    })
}

/// Asserts that the captures are equal.
fn is_equal(machine: &Machine, good: &str, bad: &str) {
    let output = diff(&[&machine.options()[..], &[good.to_owned(), bad.to_owned()]].concat());
    assert_eq!(output.code, 0, "{good} {bad}\n{}{}", output.stdout, output.stderr);
}

#[test]
fn a_capture_equals_itself_and_itself_at_another_time() {
    let path = folder("diff-shifted");
    for machine in &MACHINES {
        is_equal(machine, &machine.clean(), &machine.clean());
        let text = machine.text();
        let shifted: Vec<_> = lines(&text).iter().map(|(time, rest)| (time + 7_654_321_987, *rest)).collect();
        let shifted = write(&path, &format!("{}.log", machine.folder), &capture(&shifted));
        is_equal(machine, &machine.clean(), &shifted);
        is_equal(machine, &shifted, &machine.clean());
    }
}

#[test]
fn a_capture_equals_its_parts() {
    for machine in &MACHINES {
        let path = folder(&format!("diff-parts-{}", machine.folder));
        let text = machine.text();
        let all = lines(&text);
        for (number, part) in all.chunks(all.len() / 3 + 1).enumerate() {
            write(&path, &format!("run_{number}.log"), &capture(part));
        }
        is_equal(machine, &machine.clean(), path.to_str().unwrap());
    }
}

#[test]
fn a_capture_equals_its_conversions() {
    let path = folder("diff-converted");
    for machine in &MACHINES {
        for format in cobscope_decoder::capture::WRITABLE {
            let converted = path.join(format!("{}.{}", machine.folder, format.suffix));
            let converted = converted.to_str().unwrap();
            let output = run(&["convert", "--force", &machine.clean(), converted], "");
            assert_eq!(output.code, 0, "{converted}: {}", output.stderr);
            is_equal(machine, &machine.clean(), converted);
            is_equal(machine, converted, &machine.clean());
        }
    }
}

/// Generator of noise: xorshift with a fixed seed.
struct Noise(u64);

impl Noise {
    fn below(&mut self, limit: i64) -> i64 {
        self.0 ^= self.0 << 13;
        self.0 ^= self.0 >> 7;
        self.0 ^= self.0 << 17;
        (self.0 >> 1).cast_signed().rem_euclid(limit)
    }
}

/// Frames in operation, delayed by up to 2 ms each without a change of their order.
fn with_jitter<'a>(lines: &[(i64, &'a str)], noise: &mut Noise) -> Vec<(i64, &'a str)> {
    let mut last = i64::MIN;
    let delay = |(time, rest): &(i64, &'a str)| {
        last = (time + noise.below(2_000)).max(last + 50);
        (last, *rest)
    };
    lines.iter().map(delay).collect()
}

/// A frame with other lowest bits of a measured value.
fn with_measured(rest: &str, (id, byte): (&str, usize), noise: &mut Noise) -> String {
    let place = rest.find('#').filter(|_| rest.split(' ').nth(1).is_some_and(|frame| frame.starts_with(id)));
    let Some(at) = place.map(|place| place + 2 + 2 * byte) else { return rest.to_owned() };
    let Some(digit) = rest.get(at..=at).and_then(|digit| u8::from_str_radix(digit, 16).ok()) else {
        return rest.to_owned();
    };
    let digit = digit ^ u8::try_from(noise.below(4)).unwrap();
    format!("{}{digit:X}{}", &rest[..at], &rest[at + 1..])
}

#[test]
fn jitter_phase_and_measured_values_are_no_differences() {
    let path = folder("diff-noise");
    for machine in &MACHINES {
        for seed in 1..=5 {
            let mut source = Noise(seed);
            let text = machine.text();
            let noisy = with_jitter(&lines(&text), &mut source);
            let shift = source.below(1_000_000);
            let measure = |rest| with_measured(rest, machine.measured, &mut source);
            let rests: Vec<_> = noisy.iter().map(|(_, rest)| *rest).map(measure).collect();
            let times = noisy.iter().map(|(time, _)| time + shift);
            let noisy: Vec<_> = times.zip(rests.iter().map(String::as_str)).collect();
            assert_ne!(capture(&noisy), text);
            let noisy = write(&path, &format!("{}-{seed}.log", machine.folder), &capture(&noisy));
            is_equal(machine, &machine.clean(), &noisy);
        }
    }
}

/// Machine, failure, and words that the first three lines contain: the cause, or the first effect if the story states that the
/// cause is not on the bus (loose connector, lost supply). `plc-task-too-slow` is a J1939 machine without a clean run.
const FAILURES: &[(usize, &str, &[&str])] = &[
    (0, "stories/danfoss-pve-ci/brown-out", &["unexpected boot-up"]),
    (1, "stories/rexroth-ifb-iac/brown-out", &["unexpected boot-up"]),
    (2, "stories/rexroth-sydfec/brown-out", &["unexpected boot-up"]),
    (4, "stories/wandfluh-md2/brown-out", &["unexpected boot-up"]),
    (0, "stories/danfoss-pve-ci/connector-loose", &["32/20  lost  0 | 1"]),
    (1, "stories/rexroth-ifb-iac/connector-loose", &["5/05  lost  0 | 1"]),
    (3, "stories/rexroth-vpcd/connector-loose", &["63/3F  lost  0 | 1"]),
    (4, "stories/wandfluh-md2/connector-loose", &["1/01  lost  0 | 1"]),
    (
        0,
        "stories/danfoss-pve-ci/node-id-conflict",
        &["alternates between pre-operational and operational", "duplicate-node-id"],
    ),
    (
        3,
        "stories/rexroth-vpcd/node-id-conflict",
        &["alternates between pre-operational and operational", "duplicate-node-id"],
    ),
    (
        4,
        "stories/wandfluh-md2/node-id-conflict",
        &["alternates between pre-operational and operational", "duplicate-node-id"],
    ),
    (0, "stories/danfoss-pve-ci/enable-in-fault-hold", &["EMCY 8305", "control-0f-in-fault-hold"]),
    (0, "stories/danfoss-pve-ci/wrong-remap", &["1A00:00", "mapping changed while the TPDO is valid"]),
    (0, "stories/danfoss-pve-ci/wrong-signature", &["1010:01", "wrong store signature"]),
    (4, "stories/wandfluh-md2/wrong-signature", &["1010:01", "wrong store signature"]),
    (1, "stories/rexroth-ifb-iac/analog-source", &["6042:00", "analog inputs"]),
    (1, "stories/rexroth-ifb-iac/master-silent", &["guarding requests missing"]),
    (1, "stories/rexroth-ifb-iac/mode-not-writable", &["6043:00", "without effect"]),
    (1, "stories/rexroth-ifb-iac/pdo-not-answered", &["no TPDO1 within 100 ms of RPDO1"]),
    (1, "stories/rexroth-ifb-iac/wrong-byte-order", &["6380:01", "out of range"]),
    (
        2,
        "stories/rexroth-sydfec/calibration-outside-operational",
        &["5201:01", "calibration started outside operational"],
    ),
    (2, "stories/rexroth-sydfec/master-connector-loose", &["life guarding expired", "8102"]),
    (2, "stories/rexroth-sydfec/plc-task-too-fast", &["more than 2 RPDO1 per SYNC interval"]),
    (2, "stories/rexroth-sydfec/sync-producer-twice", &["SYNC period below the 2 ms minimum"]),
    (2, "stories/rexroth-sydfec/two-masters", &["RPDO1 alternates between two contents"]),
    (2, "stories/rexroth-sydfec/wrong-byte-order", &["5039:00", "out of range"]),
    (3, "stories/rexroth-vpcd/event-timer-late", &["TPDO1 later than its event timer"]),
    (3, "stories/rexroth-vpcd/settings-lost", &["unexpected boot-up", "config-lost"]),
    (3, "stories/rexroth-vpcd/tpdo-stops", &["TPDO1 missing"]),
    (3, "stories/rexroth-vpcd/two-masters-monitor", &["guarding used while the heartbeat is on"]),
    (3, "stories/rexroth-vpcd/wrong-byte-order", &["2C67:00", "Trigger bit above 16"]),
    (4, "stories/wandfluh-md2/enable-input-open", &["6300:01", "gate ACTIVE closed"]),
    (4, "stories/wandfluh-md2/fault-reset-held", &["EMCY 2311", "fault-reset-without-edge"]),
    (4, "stories/wandfluh-md2/mode-while-active", &["6043:00", "control mode changed outside INIT"]),
    (4, "stories/wandfluh-md2/wrong-remap", &["1A00:00", "while the PDO is valid"]),
    (4, "diagnosis/bus-off", &["error frames", "1/01"]),
    (4, "diagnosis/eeprom-wear", &["1010:01", "writes to non-volatile memory"]),
    (4, "diagnosis/enable-wrong-order", &["fault reset in FAULT with H = 1"]),
    (3, "diagnosis/heartbeat-consumer-short", &["1016:01", "110 ms"]),
    (1, "diagnosis/mode-write-ignored", &["6043:00", "position closed loop (2)"]),
    (0, "diagnosis/no-consumer", &["220h", "221h"]),
    (3, "diagnosis/plc-commands-pre-operational", &["63/3F", "enter-pre-operational"]),
    (3, "diagnosis/ram-settings-lost", &["63/3F", "unexpected boot-up", "config-lost"]),
    (2, "diagnosis/sync-producer-twice", &["1005:00", "7/07"]),
    (4, "diagnosis/wrong-remap", &["1600", "RPDO1"]),
];

#[test]
fn the_first_lines_name_the_cause() {
    let mut wrong = String::new();
    for (machine, failure, words) in FAILURES {
        let machine = &MACHINES[*machine];
        let bad = format!("fixtures/{failure}.log");
        let output = diff(&[&machine.options()[..], &[machine.clean(), bad]].concat());
        let head: Vec<_> = output.stdout.lines().take(3).collect();
        let head = head.join("\n");
        if output.code != 1 || words.iter().any(|word| !head.contains(word)) {
            let _ = writeln!(wrong, "{failure} {words:?}\n{head}\n");
        }
    }
    assert!(wrong.is_empty(), "\n{wrong}");
}

#[test]
fn every_failure_of_the_simulators_is_compared() {
    for device in fs::read_dir(workspace().join("fixtures/stories")).unwrap().flatten() {
        for file in fs::read_dir(device.path()).into_iter().flatten().flatten() {
            let name = format!(
                "stories/{}/{}",
                device.file_name().display(),
                file.path().file_stem().unwrap().display()
            );
            let is_log = file.path().extension().is_some_and(|extension| extension == "log");
            let is_failure = is_log && !name.ends_with("/clean-run") && !name.ends_with("/plc-task-too-slow");
            assert!(!is_failure || FAILURES.iter().any(|(_, failure, _)| *failure == name), "{name}");
        }
    }
}

#[test]
fn the_first_step_that_differs_is_printed() {
    let boot = |value: &str| {
        format!(
            "(1.000000) can0 702#00\n(1.010000) can0 602#2B171000{value}0000\n(1.011000) can0 582#6017100000000000\n\
             (1.020000) can0 602#2B00180500640000\n(1.021000) can0 582#6000180500000000\n(1.030000) can0 000#0102\n\
             (1.100000) can0 702#05\n"
        )
    };
    let path = folder("diff-steps");
    let (good, bad) = (write(&path, "good.log", &boot("E803")), write(&path, "bad.log", &boot("F401")));
    let output = diff(&["--at-event", "kind == boot-up && node == 2", "--only", "sequence", &good, &bad]);
    let line = output.stdout.lines().find(|line| line.starts_with("SEQUENCE")).unwrap();
    for words in ["step 2", "SDO write 1017:00", "1000 ms | ", "500 ms", "{2 | 2}"] {
        assert!(line.contains(words), "{words}: {line}");
    }
    assert_eq!(output.code, 1);
}

#[test]
fn a_comparison_of_nothing_is_not_equality() {
    let path = folder("diff-nothing");
    let boot = "(1.000000) can0 702#00\n(1.100000) can0 702#05\n";
    let (good, bad) = (write(&path, "good.log", boot), write(&path, "bad.log", boot));
    let refused = diff(&["--only", "sequence", &good, &bad]);
    let text = "cobscope: --only sequence: no event to start from; add --at-event\n";
    assert_eq!((refused.code, refused.stderr.as_str(), refused.stdout.as_str()), (2, text, ""));
    // Node 3 does not exist.
    let event = "--at-event=kind == boot-up && node == 3";
    let at = |options: &[&str]| diff(&[&[event][..], options, &[&good, &bad]].concat());
    let nothing = at(&["--only", "sequence"]);
    assert_eq!(nothing.code, 3, "{}", nothing.stdout);
    assert!(!nothing.stdout.contains("no difference"), "{}", nothing.stdout);
    let of = |format: &str| at(&["--only", "sequence", "-f", format]).stdout;
    assert!(of("html").contains("<h1>Nothing compared</h1>"));
    let json: Value = serde_json::from_str(&of("json")).unwrap();
    assert_eq!((&json["equal"], json["not_compared"].as_array().unwrap().len()), (&Value::Bool(false), 2));
    // The other sections are compared.
    assert_eq!([at(&[]), at(&["--only", "nodes"])].map(|output| output.code), [0, 0]);
}

#[test]
fn captures_without_times_are_compared_without_timing() {
    let path = folder("diff-untimed");
    let machine = &MACHINES[4];
    let text = machine.text();
    let untimed: Vec<_> = lines(&text).iter().map(|(_, rest)| (1_000_000, *rest)).collect();
    let untimed = write(&path, "untimed.log", &capture(&untimed));
    let output = diff(&[&machine.options()[..], &[machine.clean(), untimed]].concat());
    assert!(output.stdout.contains("timing not compared"), "{}", output.stdout);
    assert_eq!(output.code, 0, "{}", output.stdout);
}

#[test]
fn two_different_machines_are_reported() {
    let output = diff(&[MACHINES[1].clean(), MACHINES[4].clean()]);
    assert_eq!(output.code, 1);
    assert!(
        output.stdout.lines().take(3).any(|line| line.contains("different machines")),
        "{}",
        output.stdout
    );
}

#[test]
fn hostile_names_are_escaped() {
    let path = folder("diff-hostile");
    let names = write(&path, "names.toml", "[node.2]\nname = \"pump\\u001B[31m\"\n");
    let log = |state: &str| {
        (0..30).fold(String::new(), |mut text, at| {
            let _ = writeln!(text, "({at}.000000) can0\u{1B}[2J 702#{}", if at == 0 { "00" } else { state });
            text
        })
    };
    let (good, bad) = (write(&path, "good.log", &log("05")), write(&path, "bad.log", &log("04")));
    for format in ["text", "json"] {
        let output = diff(&["-f", format, "--bus", &names, &good, &bad]);
        assert_eq!(output.code, 1, "{}", output.stderr);
        assert!(!output.stdout.contains('\u{1B}'), "{:?}", output.stdout);
    }
}

/// Two captures of node 2 whose names try HTML, SVG and terminal injection: operational, and stopped.
fn hostile_pair(path: &Path) -> [String; 3] {
    let name = "<script>alert(1)</script></style></title><img src=x onerror=alert(2)>\\u001B[31m";
    let names = write(path, "names.toml", &format!("[node.2]\nname = \"{name}\"\n"));
    let bus = "\"><svg/onload=alert(3)>\u{1b}]0;x\u{7}";
    let log = |state: &str| {
        (0..30).fold(String::new(), |mut text, at| {
            let _ = writeln!(text, "({at}.000000) {bus} 702#{}", if at == 0 { "00" } else { state });
            text
        })
    };
    [names, write(path, "<b>good&.log", &log("05")), write(path, "=bad'\u{1b}[2J.log", &log("04"))]
}

#[test]
fn a_page_of_hostile_captures_is_inert() {
    let path = folder("diff-page");
    let [names, good, bad] = hostile_pair(&path);
    let output = diff(&["-f", "html", "--bus", &names, &good, &bad]);
    assert_eq!(output.code, 1, "{}", output.stderr);
    assert_inert(&output.stdout);
    let (elements, text) = parsed(&output.stdout);
    for part in ["<script>alert(1)</script>", "<img src=x onerror=alert(2)>", "<b>good&.log", "stopped 28 s"]
    {
        assert!(text.contains(part), "{part}: {text}");
    }
    // Each link leads to a heading.
    let ids: Vec<_> = elements.iter().filter_map(|element| element.value("id")).collect();
    let links: Vec<_> = elements.iter().filter_map(|element| element.value("href")).collect();
    assert!(
        !links.is_empty() && links.iter().all(|link| ids.contains(&link.trim_start_matches('#'))),
        "{links:?}"
    );
}

#[test]
fn a_page_names_the_differences_the_files_and_the_command() {
    let machine = &MACHINES[4];
    let bad = "fixtures/stories/wandfluh-md2/brown-out.log".to_owned();
    let path = folder("diff-output").join("diff.html");
    let options = ["-f".to_owned(), "html".to_owned(), "-o".to_owned(), path.to_str().unwrap().to_owned()];
    let output = diff(&[&options[..], &machine.options()[..], &[machine.clean(), bad]].concat());
    assert_eq!((output.code, output.stdout.as_str()), (1, ""), "{}", output.stderr);
    let page = fs::read_to_string(&path).unwrap();
    assert_inert(&page);
    let (_, text) = parsed(&page);
    for part in ["unexpected boot-up", "NEW IN BAD", "every 100 ms", "EQUAL", "cobscope diff -f html -o"] {
        assert!(text.contains(part), "{part}: {text}");
    }
    // SHA-256 of both captures, by sha256sum.
    assert_eq!(page.matches("clean-run.log</td>").count(), 1);
    assert_eq!(page.matches("brown-out.log</td>").count(), 1);
    let equal = diff(&["-f", "html", &machine.clean(), &machine.clean()]);
    assert_eq!(equal.code, 0);
    assert!(equal.stdout.contains("<h1>No difference within the tolerances</h1>"), "{}", equal.stdout);
    let input = diff(&["-f", "html", "-o", &machine.clean(), &machine.clean(), &machine.clean()]);
    assert_eq!(input.code, 2);
    assert!(input.stderr.contains("is also an input"), "{}", input.stderr);
}

#[test]
fn parameters_are_those_at_the_end_of_the_range() {
    let path = folder("diff-range");
    // 2000:00 of node 5 is written at 1 s, and in the second capture again at 5 s.
    let log = |last: &str| {
        let mut text = String::new();
        for (time, value) in [(1, "01"), (5, last)] {
            let _ = writeln!(text, "({time}.000000) can0 605#2F002000{value}000000");
            let _ = writeln!(text, "({time}.001000) can0 585#6000200000000000");
        }
        text + "(9.000000) can0 705#05\n"
    };
    let (good, bad) = (write(&path, "good.log", &log("01")), write(&path, "bad.log", &log("02")));
    let compare = |range: &[&str]| diff(&[&["--only", "configuration"], range, &[&*good, &*bad]].concat());
    assert_eq!(compare(&[]).code, 1);
    assert_eq!(compare(&["--to", "3"]).code, 0);
    assert_eq!(compare(&["--from", "2", "--to", "3.5"]).code, 0);
    let late = compare(&["--from", "4.5"]);
    assert_eq!(late.code, 1);
    assert!(late.stdout.contains("2000:00   01 | 02  written at 4.0 s"), "{}", late.stdout);
}

#[test]
fn sections_are_selected() {
    let machine = &MACHINES[4];
    let bad = "fixtures/diagnosis/wrong-remap.log".to_owned();
    let compare = |only: &str| {
        let captures = ["--only".to_owned(), only.to_owned(), machine.clean(), bad.clone()];
        diff(&[&machine.options()[..], &captures].concat())
    };
    let output = compare("configuration,timing");
    assert_eq!(output.code, 1);
    assert!(
        output.stdout.contains("CONFIGURATION ") && !output.stdout.contains("STATES "),
        "{}",
        output.stdout
    );
    // The period of the messages is the same.
    assert_eq!(compare("timing,load").code, 0);
}

#[test]
fn tolerances_are_those_of_the_bus_file() {
    let path = folder("diff-tolerances");
    let beats = |period: i64| {
        (0..50).fold(String::new(), |mut text, at| {
            let time = 1_000_000 + at * period + at % 7;
            let _ = writeln!(text, "({}.{:06}) can0 702#05", time / 1_000_000, time % 1_000_000);
            text
        })
    };
    let (good, bad) = (write(&path, "good.log", &beats(100_000)), write(&path, "bad.log", &beats(104_000)));
    assert_eq!(diff(&[&good, &bad]).code, 0);
    let tight = write(&path, "tight.toml", "[diff]\nperiod-percent = 2\n");
    let output = diff(&["--bus", &tight, &good, &bad]);
    assert_eq!(output.code, 1);
    assert!(
        output.stdout.contains("702 NMT error control of 2  period  100 ms | 104 ms"),
        "{}",
        output.stdout
    );
}

#[test]
fn parts_on_the_command_line_form_two_captures() {
    let path = folder("diff-listed");
    let machine = &MACHINES[2];
    let text = machine.text();
    let all = lines(&text);
    let (first, second) = all.split_at(all.len() / 2);
    let good = ["run_1.log", "run_2.log"].map(|name| path.join(name).to_str().unwrap().to_owned());
    fs::write(&good[0], capture(first)).unwrap();
    fs::write(&good[1], capture(second)).unwrap();
    let output = diff(&[&machine.options()[..], &good, &[machine.clean()]].concat());
    assert_eq!(output.code, 0, "{}{}", output.stdout, output.stderr);
}

#[test]
fn arguments_that_are_not_two_captures_are_refused() {
    let clean = MACHINES[4].clean();
    let output = diff(&[&clean]);
    assert_eq!(output.code, 2);
    assert!(output.stderr.contains("diff needs two captures"), "{}", output.stderr);
    assert_eq!(diff(&["--only", "colour", &clean, &clean]).code, 2);
    assert_eq!(diff(&[&clean, "no/such.log"]).code, 3);
}

#[test]
fn the_report_is_as_its_schema_says() {
    let schema = fs::read_to_string(workspace().join("docs/diff.schema.json")).unwrap();
    let schema: Value = serde_json::from_str(&schema).unwrap();
    let machine = &MACHINES[3];
    let bad = format!("fixtures/stories/{}/settings-lost.log", machine.folder);
    let captures = ["-f".to_owned(), "json".to_owned(), machine.clean(), bad];
    let output = diff(&[&machine.options()[..], &captures].concat());
    let report: Value = serde_json::from_str(&output.stdout).unwrap();
    assert_eq!(violations(&report, &schema, "", &mut Vec::new()), [""; 0]);
    let weights: Vec<_> =
        report["differences"].as_array().unwrap().iter().map(|it| it["weight"].as_f64().unwrap()).collect();
    assert!(!weights.is_empty() && weights.is_sorted_by(|one, next| one >= next), "{weights:?}");
}

#[test]
fn a_capture_that_ends_before_a_message_is_due_does_not_lack_it() {
    let folder = folder("diff-short");
    // 100 every 10 ms, 200 every second.
    let capture = |name: &str, until: u32| {
        let mut text = String::new();
        for time in (0..until).step_by(10) {
            let wobble = time % 7;
            let stamp = format!("({}.{:03}{wobble:03}) can0", 1_600_000_000 + time / 1_000, time % 1_000);
            let _ = writeln!(text, "{stamp} 100#01");
            if time % 1_000 == 500 {
                let _ = writeln!(text, "{stamp} 200#02");
            }
        }
        write(&folder, name, &text)
    };
    let (long, short, silent) =
        (capture("long.log", 20_000), capture("short.log", 400), folder.join("silent.log"));
    let kept: Vec<_> = fs::read_to_string(&long)
        .unwrap()
        .lines()
        .filter(|line| !line.contains(" 200#"))
        .map(str::to_owned)
        .collect();
    fs::write(&silent, kept.join("\n") + "\n").unwrap();
    let cut = diff(&[&long, &short]);
    assert_eq!(cut.code, 0, "{}", cut.stdout);
    assert!(cut.stdout.contains("NOT SEEN IN BAD"), "{}", cut.stdout);
    let lost = diff(&[long.as_str(), silent.to_str().unwrap()]);
    assert_eq!(lost.code, 1, "{}", lost.stdout);
    assert!(lost.stdout.contains("every 1") && lost.stdout.contains("not seen"), "{}", lost.stdout);
}
