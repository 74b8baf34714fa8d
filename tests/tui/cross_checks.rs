//! Compares events with the output of other decoders for the same frames, field by field.

use std::path::PathBuf;
use std::process::Command;

use crate::support::{self, workspace};

/// CANopen captures below a folder, sorted by name.
fn captures(folder: PathBuf) -> Vec<PathBuf> {
    let entries = std::fs::read_dir(folder).into_iter().flatten().flatten().map(|entry| entry.path());
    let is_capture = |path: &PathBuf| {
        let name = path.to_string_lossy();
        [".log", ".trc", ".pcapng", ".candump.txt"].iter().any(|end| name.ends_with(end))
    };
    let mut all: Vec<_> = entries.filter(is_capture).collect();
    all.sort();
    all
}

/// Counts printed by `canopen_fields.py`; `None` if tshark is missing.
fn compared_with_tshark(captures: &[PathBuf]) -> Option<String> {
    if Command::new("tshark").arg("-v").output().is_err() {
        support::skip("tshark", "the program is missing");
        return None;
    }
    let python = support::python().unwrap_or_else(|| "python3".into());
    if Command::new(&python).arg("--version").output().is_err() {
        support::skip("python", "the program is missing");
        return None;
    }
    let script = workspace().join("tests/oracles/canopen_fields.py");
    let output =
        Command::new(python).arg(script).arg(env!("CARGO_BIN_EXE_cobscope")).args(captures).output().unwrap();
    let text = String::from_utf8_lossy(&output.stdout).trim_end().to_owned();
    assert!(output.status.success(), "{text}\n{}", String::from_utf8_lossy(&output.stderr));
    Some(text)
}

#[test]
fn canopen_of_recordings_field_by_field() {
    let captures = captures(support::corpus().join("canopen"));
    if captures.is_empty() {
        return support::skip("corpus", "no captures of other projects");
    }
    let Some(compared) = compared_with_tshark(&captures) else { return };
    let expected = "compared boot-up 178\ncompared emcy 864\ncompared guard-reply 1122\ncompared heartbeat 6680\n\
        compared nmt-command 2666\ncompared pdo 36226\ncompared sdo-transfer 29699\ncompared sync 3054\n\
        compared time 596\nknown block 45\nknown malformed 1\nknown remote 374\nknown retry 94";
    assert_eq!(compared, expected);
}

#[test]
fn canopen_of_fixtures_field_by_field() {
    let Some(compared) = compared_with_tshark(&captures(workspace().join("fixtures/canopen"))) else {
        return;
    };
    // Services that are missing in captures of other projects: LSS, moved identifiers, blocks.
    for part in ["compared lss ", "known moved ", "known block "] {
        assert!(compared.contains(part), "{compared}");
    }
}

/// Status words of drives: one capture contains their device types, the other does not.
#[test]
fn states_of_drives_at_each_status_word() {
    let folder = support::corpus().join("canopen");
    if !folder.exists() {
        return support::skip("corpus", "no captures of other projects");
    }
    let Some(python) = support::python() else {
        return support::skip("python", "states of drives are not compared with canopen-lens");
    };
    let compared = |capture: &str, options: &[&str]| {
        let mut command = Command::new(&python);
        command.arg(workspace().join("tests/oracles/drive_states.py")).arg(env!("CARGO_BIN_EXE_cobscope"));
        let output = command.arg(folder.join(capture)).args(options).output().unwrap();
        let stated = String::from_utf8_lossy(&output.stderr).into_owned();
        assert!(output.status.success(), "{}{stated}", String::from_utf8_lossy(&output.stdout));
        String::from_utf8_lossy(&output.stdout).trim_end().to_owned()
    };
    let known = compared("canopen-lens__sample_cia402.log", &[]);
    assert_eq!(known, "1650 equal, 550 not decoded, 0 different");
    let drives = ["--node", "1=cia402", "--node", "2=cia402"];
    let named = compared("canopen-lens__sample_amr_2wheel.log", &drives);
    assert_eq!(named, "3188 equal, 0 not decoded, 0 different");
}

/// Data types of the profile for drives, compared with device files of drives.
#[test]
fn objects_of_drives_have_the_types_of_device_files() {
    let entries = std::fs::read_dir(support::corpus().join("eds")).into_iter().flatten().flatten();
    let is_read = |path: &PathBuf| path.extension().is_some_and(|end| end == "eds" || end == "dcf");
    let files: Vec<_> = entries.map(|entry| entry.path()).filter(is_read).collect();
    if files.is_empty() {
        return support::skip("corpus", "no device files of other projects");
    }
    let Some(python) = support::python() else {
        return support::skip("python", "objects of drives are not compared with device files");
    };
    let script = workspace().join("tests/oracles/drive_objects.py");
    let profile = workspace().join("decoder/profiles/generic/cia402.toml");
    let output = Command::new(python).arg(script).arg(profile).args(files).output().unwrap();
    let stated = String::from_utf8_lossy(&output.stdout);
    assert!(output.status.success(), "{}", String::from_utf8_lossy(&output.stderr));
    // Some drives have torques of 32 bits, or signed speeds and limits.
    let expected = "6071:00 INTEGER16, in 2 files INTEGER32\n6077:00 INTEGER16, in 2 files INTEGER32\n\
        6081:00 UNSIGNED32, in 1 files INTEGER32\n6084:00 UNSIGNED32, in 1 files INTEGER32\n\
        60B2:00 INTEGER16, in 3 files INTEGER32\n60E0:00 UNSIGNED16, in 1 files INTEGER16\n\
        60E1:00 UNSIGNED16, in 1 files INTEGER16\n13 files, 672 equal, 11 different";
    assert_eq!(stated.trim_end(), expected);
}
