//! From a customer's capture to the explanation and the proof, in at most 25 keys, all of which are in the footer or
//! the help: the first fault, what was 50 ms before, the signals over time, what the rule says, an export.
#![cfg(unix)]

use std::process::Command;

use pty_process::blocking::Command as PtyCommand;

use crate::support::workspace;
use crate::terminal::Session;

/// Most keys of a journey.
const MOST_KEYS: usize = 25;

/// A faulty capture, and what must be seen on the way.
struct Journey {
    capture: &'static str,
    options: &'static [&'static str],
    /// Keys to the fault.
    to_fault: &'static str,
    /// In the table at the fault: the fault, and the control word before it.
    fault: &'static [&'static str],
    /// In the explanation: the rule's text.
    rule: &'static [&'static str],
    /// Events 50 ms before.
    before: &'static str,
    /// In the plot: signals with their smallest and largest values.
    range: &'static [&'static str],
    frames: usize,
}

fn play(journey: &Journey) {
    let folder = tempfile::tempdir().unwrap();
    let capture = workspace().join("fixtures/devices").join(journey.capture);
    let options: Vec<String> = journey.options.iter().map(|word| in_workspace(word)).collect();
    let command = PtyCommand::new(env!("CARGO_BIN_EXE_cobscope"));
    let command = command.arg("view").args(&options).arg(&capture).current_dir(folder.path());
    let session = Session::start(command, 30, 110);
    let mut keys = 0;
    let mut press = |text: &str, expected: &[&str]| {
        keys += text.chars().count();
        session.send(text);
        for text in expected {
            session.wait_text(text);
        }
    };
    press("", &["FINDINGS"]);
    press(journey.to_fault, journey.fault);
    press("\r", journey.rule);
    press("\x1b", journey.fault);
    press(":-0.05\r", &[journey.before]);
    press("p", journey.range);
    press("w\r", &[&format!("{} frames written", journey.frames)]);
    press("q", &[]);
    assert!(keys <= MOST_KEYS, "{keys} keys");
    assert!(session.wait_end().success());

    let stem = capture.file_stem().unwrap().to_str().unwrap();
    let exported = folder.path().join(format!("{stem}-export.log"));
    let decode = |capture: &std::path::Path| {
        let program = Command::new(env!("CARGO_BIN_EXE_cobscope"));
        let mut program = program;
        let output = program.args(["decode", "-f", "jsonl"]).args(&options).arg(capture).output().unwrap();
        assert!(output.status.success());
        String::from_utf8(output.stdout).unwrap()
    };
    assert_eq!(decode(&exported), decode(&capture));
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
        to_fault: "]",
        fault: &["8305 spool position error", "control 0F"],
        rule: &["What it checks: A device sends an EMCY message", "emcy-raised"],
        before: "#103/190",
        // 6300 was commanded 0 and 37.5 %, the spool went there and back.
        range: &["0.0  37.5 %"],
        frames: 190,
    });
}

#[test]
fn a_pump_with_a_control_deviation() {
    play(&Journey {
        capture: "sydfec.log",
        options: &["--node", "2=rexroth-sydfec"],
        to_fault: "]]",
        fault: &["FF01 control deviation", "Control byte"],
        rule: &["What it checks: A device sends an EMCY message"],
        before: "#241/359",
        range: &["0.00  157.51 bar", "0.000  49.997 %"],
        frames: 359,
    });
}

#[test]
fn an_amplifier_with_a_cable_break() {
    play(&Journey {
        capture: "md2.log",
        options: &["--node", "1=wandfluh-md2:amplifier"],
        to_fault: "]]]]]]",
        fault: &["2311 solenoid driver 1", "control"],
        rule: &["What it checks: A device sends an EMCY message"],
        before: "/371",
        range: &["%"],
        frames: 371,
    });
}

#[test]
fn a_valve_with_a_broken_pressure_sensor() {
    play(&Journey {
        capture: "ifb.log",
        options: &["--node", "5=rexroth-ifb-iac"],
        to_fault: "]]]",
        fault: &["5231 pressure sensor A", "control"],
        rule: &["What it checks: A device sends an EMCY message"],
        before: "/178",
        range: &["l/min", "bar"],
        frames: 178,
    });
}

#[test]
fn a_card_with_a_cable_break() {
    play(&Journey {
        capture: "vpcd.log",
        options: &["--bus", "fixtures/devices/vpcd.bus.toml"],
        to_fault: "]]",
        fault: &["3400 cable break"],
        rule: &["What it checks: A device sends an EMCY message"],
        before: "/170",
        range: &["bar"],
        frames: 170,
    });
}
