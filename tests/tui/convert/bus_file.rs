//! The bus file with the state before a part of a capture.

use std::fs;

use super::fixture;
use crate::cli::run;

const SYDFEC: &str = "devices/sydfec.log";

/// Meaning of each frame, without times and numbers of frames.
fn meaning(arguments: &[&str]) -> Vec<String> {
    let kinds = "kind == pdo || kind == sdo-transfer || kind == emcy";
    let output = run(&[&["decode", "-f", "jsonl", "--all", "--filter", kinds], arguments].concat(), "");
    assert_eq!(output.code, 0, "{}", output.stderr);
    let parts = output.stdout.lines().map(|line| {
        let (_, rest) = line.split_once("\"kind\"").unwrap();
        rest.replace("\"byte_order_origin\":\"learnt\"", "\"byte_order_origin\":\"profile\"")
    });
    parts.collect()
}

#[test]
fn a_part_decodes_as_within_the_whole_capture() {
    let folder = tempfile::tempdir().unwrap();
    let (out, bus) = (folder.path().join("part.pcapng"), folder.path().join("part.toml"));
    let (out, bus) = (out.to_str().unwrap(), bus.to_str().unwrap());
    let whole = fixture(SYDFEC);
    let whole = whole.to_str().unwrap();
    let convert = ["convert", "--node", "2=rexroth-sydfec", "--from", "#36", "--bus-file", bus, whole, out];
    let output = run(&convert, "");
    assert_eq!((output.code, output.stderr.as_str()), (0, ""));
    let text = fs::read_to_string(bus).unwrap();
    // Nominal pressure, written in frame 25: 250 bar.
    let object = "data = \"FA 00\"\nframe = 25\nobject = \"5208:02\"\norigin = \"download\"\n";
    assert!(text.contains(object), "{text}");
    assert!(text.contains("[bus.can0.node.2]\ndevice = \"rexroth-sydfec\"\n"), "{text}");

    let expected = meaning(&["--node", "2=rexroth-sydfec", "--from", "#36", whole]);
    let found = meaning(&["--bus", bus, out]);
    assert!(expected.len() > 100);
    assert_eq!(found, expected);
    // Without the file, the part lacks profile and nominal pressure.
    assert_ne!(meaning(&[out]), expected);

    let refused = run(&convert, "");
    assert_eq!(refused.code, 2);
    assert!(
        refused.stderr.contains("part.toml: file exists; use --force to overwrite it"),
        "{}",
        refused.stderr
    );
}

#[test]
fn the_settings_of_the_user_remain_and_files_stay_reachable() {
    let folder = tempfile::tempdir().unwrap();
    let name = |name: &str| folder.path().join(name).to_str().unwrap().to_owned();
    fs::create_dir(name("in")).unwrap();
    fs::copy(fixture("device_files/minimal.eds"), name("in/a.eds")).unwrap();
    fs::copy(fixture("dbc/signals.dbc"), name("b.dbc")).unwrap();
    let base = "[node.2]\nname = \"pu\\\"mp\"\neds = \"a.eds\"\n[rules.node-lost]\nseverity = \"off\"\n";
    fs::write(name("in/m.toml"), base).unwrap();
    let whole = fixture("canopen/nmt_heartbeat.log");
    let words = ["convert", "--bus", &name("in/m.toml"), "--dbc", &name("b.dbc"), "--from", "#20"];
    let rest = ["--bus-file", &name("part.toml"), whole.to_str().unwrap(), &name("part.log")];
    let output = run(&[&words[..], &rest].concat(), "");
    assert_eq!(output.code, 0, "{}", output.stderr);

    let text = fs::read_to_string(name("part.toml")).unwrap();
    // Both files are in the folder of the new file, or below it.
    assert!(text.contains("eds = \"in/a.eds\"\n"), "{text}");
    assert!(text.contains("dbc = [\"b.dbc\"]\n"), "{text}");
    assert!(text.contains("[rules.node-lost]\nseverity = \"off\"\n"), "{text}");
    let output = run(&["decode", "--bus", &name("part.toml"), &name("part.log")], "");
    assert_eq!(output.code, 0, "{}", output.stderr);
    assert!(output.stdout.contains("2/02 pu\"mp"), "{}", output.stdout);
}

#[test]
fn an_input_or_the_output_is_never_overwritten() {
    let folder = tempfile::tempdir().unwrap();
    let name = |name: &str| folder.path().join(name).to_str().unwrap().to_owned();
    fs::write(name("m.toml"), "[node.2]\nname = \"pump\"\n").unwrap();
    let whole = fixture(SYDFEC);
    let convert = |bus: &str| {
        let words = ["convert", "--force", "--bus", &name("m.toml"), "--bus-file", bus];
        run(&[&words[..], &[whole.to_str().unwrap(), &name("out.log")]].concat(), "")
    };
    let refused = convert(&name("m.toml"));
    assert!(
        refused.stderr.contains("m.toml: is also an input; choose another output file"),
        "{}",
        refused.stderr
    );
    let refused = convert(&name("out.log"));
    assert!(
        refused.stderr.contains("out.log: is also the output; choose another file"),
        "{}",
        refused.stderr
    );
    assert!(!fs::exists(name("out.log")).unwrap());
}

#[test]
fn the_findings_of_a_part_are_those_of_the_whole_capture() {
    let folder = tempfile::tempdir().unwrap();
    let name = |name: &str| folder.path().join(name).to_str().unwrap().to_owned();
    let whole = fixture("devices/pve.log");
    let whole = whole.to_str().unwrap();
    let (bus, part) = (name("part.toml"), name("part.pcapng"));
    // Frame 104 is the EMCY; the device was operational and ACTIVE before it.
    let words =
        ["convert", "--node", "32=danfoss-pve-ci:pvea", "--from", "#104", "--bus-file", &bus, whole, &part];
    assert_eq!(run(&words, "").code, 0);
    let rules = |arguments: &[&str]| {
        let output = run(&[&["check", "-f", "jsonl"], arguments].concat(), "");
        let rule = |line: &str| Some(line.split_once("\"rule\":\"")?.1.split_once('"')?.0.to_owned());
        output.stdout.lines().filter_map(rule).collect::<Vec<_>>()
    };
    let found = rules(&["--bus", &bus, &part]);
    for rule in ["emcy-raised", "state-lost", "danfoss-pve-ci:control-0f-in-fault-hold"] {
        assert!(found.iter().any(|known| known == rule), "{rule}: {found:?}");
    }
    // Without the state, the device never was in an active state.
    assert!(!rules(&["--node", "32=danfoss-pve-ci:pvea", &part]).iter().any(|rule| rule == "state-lost"));

    let objects = run(&["objects", "--bus", &bus, "--node", "32", &part], "").stdout;
    assert!(objects.contains("read    before the capture"), "{objects}");
    let why = run(&["why", "--bus", &bus, &part], "").stdout;
    assert!(why.starts_with("MOST LIKELY    32/20  EMCY 8305") && !why.contains("bus file"), "{why}");
}
