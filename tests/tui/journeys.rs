//! From a customer's capture to the cause in max 25 keys, all of which are in the footer or the help: the
//! first fault, the state 50 ms earlier, the signals over time, the text of the rule, an export.
#![cfg(unix)]

use std::path::Path;
use std::process::Command;

use pty_process::blocking::Command as PtyCommand;
use ratatui::crossterm::event::KeyCode;

use crate::support::workspace;
use crate::terminal::Session;

/// Max keys of a journey.
const MOST_KEYS: usize = 25;

/// A faulty capture, and the expected screens.
struct Journey {
    capture: &'static str,
    options: &'static [&'static str],
    /// Frame of the first finding.
    first: u64,
    /// Text of the fault in the table at that frame.
    fault: &'static str,
    /// Text of the rule in the explanation.
    rule: &'static str,
    /// The last frame at least 50 ms before.
    before: &'static str,
    /// Name of the control word next to the plot.
    control: &'static str,
    /// Min and max value in the plot's legend.
    range: &'static [&'static str],
    frames: usize,
}

fn play(journey: &Journey) {
    let folder = tempfile::tempdir().unwrap();
    let capture = workspace().join("fixtures/devices").join(journey.capture);
    let options: Vec<String> = journey.options.iter().map(|word| in_workspace(word)).collect();
    let command = PtyCommand::new(env!("CARGO_BIN_EXE_cobscope"));
    let command = command
        .args(["view", "--layout", "one", "--at", "0"])
        .args(&options)
        .arg(&capture)
        .current_dir(folder.path());
    let session = Session::start(command, 40, 120);
    session.wait_verdict();
    session.wait_text(&format!("#1/{}", journey.frames));
    let mut keys = 0;
    let mut press = |count: usize, text: &str, expected: &[&str]| {
        keys += count;
        session.send(text);
        for text in expected {
            session.wait_text(text);
        }
    };
    press(1, "]", &[&format!("#{}/{}", journey.first, journey.frames), journey.fault]);
    press(1, "\r", &["What it checks", journey.rule]);
    // Sent at once, as over a slow line: then a terminal cannot distinguish Esc and a key from Alt and the
    // key.
    press(8, "\x1b:-0.05\r", &["Kind", journey.before]);
    press(1, "p", &[journey.control]);
    for range in journey.range {
        session.wait_text(range);
    }
    press(2, "w\r", &[&format!("{} frames written", journey.frames)]);
    press(1, "q", &[]);
    assert!(keys <= MOST_KEYS, "{keys} keys");
    assert!(session.wait_end().success());

    let stem = capture.file_stem().unwrap().to_str().unwrap();
    let exported = folder.path().join(format!("{stem}-export.log"));
    let decode = |capture: &Path| {
        let mut program = Command::new(env!("CARGO_BIN_EXE_cobscope"));
        let output = program.args(["decode", "-f", "jsonl"]).args(&options).arg(capture).output().unwrap();
        assert!(output.status.success());
        String::from_utf8(output.stdout).unwrap()
    };
    assert_eq!(decode(&exported), decode(&capture));
}

/// A step: keys in the form of the keymap, and texts that the screen then shows.
type KeyStep = (&'static str, &'static [&'static str]);

/// Frequent tasks, from the first screen on, with max [`FEW_KEYS`] keys each.
const SHORT: [(&str, &[KeyStep]); 4] = [
    (
        "find the fault",
        &[
            ("", &["1 error 3 warnings: 32/20 EMCY 8305 spool position error, 7.204 s", "#104/190"]),
            ("0", &["MOST LIKELY", "DO NOW", "lever"]),
            ("j<enter>", &["#105/190", "ACTIVE → FAULT HOLD"]),
        ],
    ),
    (
        "go back",
        &[("0j<enter>", &["#105/190", "Kind"]), ("<esc>", &["MOST LIKELY"]), ("k<enter>", &["#104/190"])],
    ),
    (
        "compare set point and position",
        &[("p", &["37.5 %"]), ("<right><left>", &["t 7.2"]), ("b", &["B 7.", "Δ 0."])],
    ),
    ("export", &[("V", &["selected from #104"]), ("G", &["#190/190"]), ("w<enter>", &["87 frames written"])]),
];

/// Max keys of a frequent task.
const FEW_KEYS: usize = 6;

#[test]
fn what_is_done_most_takes_few_keys() {
    for (name, steps) in SHORT {
        let folder = tempfile::tempdir().unwrap();
        let command = PtyCommand::new(env!("CARGO_BIN_EXE_cobscope"));
        let command = command.args(["view", "--node", "32=danfoss-pve-ci"]);
        let command = command.arg(workspace().join("fixtures/devices/pve.log")).current_dir(folder.path());
        let session = Session::start(command, 24, 80);
        session.wait_verdict();
        session.wait_text("#104/190");
        let mut count = 0;
        for (keys, expected) in steps {
            let keys = cobscope::keymap::parse_sequence(keys).unwrap();
            count += keys.len();
            for key in &keys {
                session.send(&terminal_bytes(key.code));
            }
            expected.iter().for_each(|text| session.wait_text(text));
        }
        assert!(count <= FEW_KEYS, "{name}: {count} keys");
        session.send("q");
        assert!(session.wait_end().success());
    }
}

#[test]
fn a_report_of_the_selected_finding() {
    let folder = tempfile::tempdir().unwrap();
    let command = PtyCommand::new(env!("CARGO_BIN_EXE_cobscope"));
    let command = command.args(["view", "--layout", "one", "--node", "32=danfoss-pve-ci"]);
    let command = command.arg(workspace().join("fixtures/devices/pve.log")).current_dir(folder.path());
    let session = Session::start(command, 24, 80);
    session.wait_verdict();
    session.wait_text("#104/190");
    // The finding of the first story, which is at the cursor.
    session.send("R");
    session.wait_text("report to pve-emcy-raised-1.html");
    session.send("\r");
    session.wait_text("pve-emcy-raised-1.html: report of 1 story");
    let page = std::fs::read_to_string(folder.path().join("pve-emcy-raised-1.html")).unwrap();
    assert!(page.contains("8305 spool position error") && page.contains("{104}"), "{page}");

    // The file exists now; another suffix selects Markdown.
    session.send("8R\r");
    session.wait_text("pve-emcy-raised-1.html: file exists");
    session.send("Rcase.txt\r");
    session.wait_text(".html, .md");
    session.send("\x1b");
    session.wait_text("? help");
    session.send("0Rcase.md\r");
    session.wait_text("case.md: report of 1 story");
    let page = std::fs::read_to_string(folder.path().join("case.md")).unwrap();
    assert!(page.starts_with("# ") && page.contains("8305"), "{page}");

    session.send("Rnone/case.html\r");
    session.wait_text("none/case.html: folder none does not exist; create it first");
    // At the first frame there is no finding.
    session.send("2:0\r");
    session.wait_text("#1/190");
    session.send("R");
    session.wait_text("no finding selected");
    session.send("q");
    assert!(session.wait_end().success());
}

/// What a terminal sends for a key.
fn terminal_bytes(code: KeyCode) -> String {
    match code {
        KeyCode::Char(letter) => letter.to_string(),
        KeyCode::Enter => "\r".into(),
        KeyCode::Esc => "\u{1b}".into(),
        KeyCode::Right => "\u{1b}[C".into(),
        KeyCode::Left => "\u{1b}[D".into(),
        other => unreachable!("{other}"),
    }
}

fn in_workspace(word: &str) -> String {
    let path = workspace().join(word);
    if path.exists() { path.display().to_string() } else { word.to_owned() }
}

#[test]
fn a_valve_with_a_spool_position_error() {
    play(&Journey {
        capture: "pve.log",
        options: &["--node", "32=danfoss-pve-ci"],
        first: 104,
        fault: "8305 spool position error",
        rule: "emcy-raised",
        before: "#103/190",
        control: "Device control w",
        range: &["37.5 %"],
        frames: 190,
    });
}

#[test]
fn a_pump_that_refuses_a_nominal_pressure() {
    play(&Journey {
        capture: "sydfec.log",
        options: &["--node", "2=rexroth-sydfec"],
        first: 46,
        fault: "06090031",
        rule: "sdo-download-refused",
        before: "#44/359",
        control: "Control byte",
        range: &["0.00  125.01 bar"],
        frames: 359,
    });
}

#[test]
fn an_amplifier_that_refuses_guarding() {
    play(&Journey {
        capture: "md2.log",
        options: &["--node", "1=wandfluh-md2:amplifier"],
        first: 153,
        fault: "060A0023",
        rule: "guard-time-only-without-heartbeat",
        before: "#151/371",
        control: "Control word 1",
        range: &["%"],
        frames: 371,
    });
}

#[test]
fn a_valve_that_refuses_a_value() {
    play(&Journey {
        capture: "ifb.log",
        options: &["--node", "5=rexroth-ifb-iac"],
        first: 31,
        fault: "06090031",
        rule: "sdo-download-refused",
        before: "#17/178",
        control: "control word",
        range: &["l/min", "bar"],
        frames: 178,
    });
}

#[test]
fn a_card_that_refuses_a_pressure() {
    play(&Journey {
        capture: "vpcd.log",
        options: &["--node", "63=rexroth-vpcd", "--bus", "fixtures/devices/vpcd.bus.toml"],
        first: 27,
        fault: "700.0 bar",
        rule: "pressure-call-up-in-limits",
        before: "#21/170",
        control: "Discrete",
        range: &["bar"],
        frames: 170,
    });
}
