//! Databases of messages: `--dbc`, the bus file, and the output for frames that they describe.

use std::fs;
use std::path::PathBuf;

use serde_json::{Value, json};

use crate::cli::{Output, run};

/// Speed in half km/h and a state; 100 is 0x064.
const DBC: &str = "VERSION \"\"\nBO_ 100 MOTION: 2 N\n SG_ Speed : 0|8@1+ (0.5,0) [0|100] \"km/h\" N\n \
                   SG_ State : 8|8@1+ (1,0) [0|0] \"\" N\nVAL_ 100 State 0 \"parked\" 1 \"driving\" ;\n";

/// The second frame repeats the first. The last one is in no database.
const FRAMES: &str = "(1700000000.0) can0 064#1E01\n(1700000000.1) can0 064#1E01\n(1700000000.2) can0 064#FF00\n\
                      (1700000000.3) can0 065#1E01\n";

/// A new folder named after its test, with files.
fn folder(name: &str, files: &[(&str, &str)]) -> PathBuf {
    let folder = PathBuf::from(env!("CARGO_TARGET_TMPDIR")).join(name);
    let _ = fs::remove_dir_all(&folder);
    fs::create_dir_all(&folder).unwrap();
    for (name, text) in files {
        fs::write(folder.join(name), text).unwrap();
    }
    folder
}

fn ok(arguments: &[&str], input: &str) -> Output {
    let output = run(arguments, input);
    assert_eq!(output.code, 0, "{}", output.stderr);
    output
}

fn frames(arguments: &[&str]) -> Vec<Value> {
    let output = ok(&[&["decode", "-f", "jsonl"], arguments].concat(), FRAMES);
    let all = output.stdout.lines().map(|line| serde_json::from_str::<Value>(line).unwrap());
    all.filter(|event| event["kind"] == "frame").collect()
}

#[test]
fn frames_of_a_dbc_are_printed_when_they_change() {
    let folder = folder("dbc_option", &[("motion.dbc", DBC)]);
    let dbc = folder.join("motion.dbc");
    let dbc = dbc.to_str().unwrap();
    let lines = |arguments: &[&str]| {
        let output = ok(&[&["decode", "--dbc", dbc], arguments].concat(), FRAMES);
        assert_eq!(output.stderr, "");
        let found = output.stdout.lines().filter(|line| line.contains("FRAME"));
        found.map(|line| line.split("FRAME").nth(1).unwrap().trim().to_owned()).collect::<Vec<_>>()
    };
    let first = "064 MOTION 1E 01: Speed 15.0 km/h, State driving (1) {1}";
    let changed = "064 MOTION FF 00: Speed 127.5 km/h (outside), State parked (0) {3}";
    assert_eq!(lines(&[]), [first, changed]);
    assert_eq!(lines(&["--pdo", "all"]).len(), 3);
    assert_eq!(lines(&["--pdo", "none"]).len(), 0);
    assert_eq!(lines(&["--pdo", "none", "--frames"]).len(), 4);
    assert_eq!(lines(&["--filter", "signals.name == Speed && signals.value > 100"]), [changed]);
    let stated = ok(&["decode", "--dbc", dbc], FRAMES).stdout;
    assert!(stated.contains("1 frame of unknown service"), "{stated}");
}

#[test]
fn a_fault_has_the_name_of_its_parameter() {
    // SPN 91 FMI 3 once, malfunction lamp.
    const FAULT: &str = "(1700000000.0) can0 18FECA00#40FF5B000301FFFF\n";
    let pedal = "VERSION \"\"\nBO_ 2364540158 EEC2: 8 N\n SG_ Pedal : 8|8@1+ (0.4,0) [0|100] \"%\" N\n\
                 BA_DEF_ SG_ \"SPN\" INT 0 524287;\nBA_ \"SPN\" SG_ 2364540158 Pedal 91;\n";
    let folder = folder("dbc_fault", &[("pedal.dbc", pedal)]);
    let dbc = folder.join("pedal.dbc");
    let dbc = dbc.to_str().unwrap();
    let text = ok(&["decode", "--dbc", dbc], FAULT).stdout;
    assert!(text.contains("SPN 91 Pedal, FMI 3 voltage too high"), "{text}");
    let output = ok(&["decode", "--dbc", dbc, "-f", "jsonl", "--filter", "spn_name == Pedal"], FAULT).stdout;
    let event: Value = serde_json::from_str(&output).unwrap();
    assert_eq!((&event["kind"], &event["spn"]), (&json!("dtc"), &json!(91)));
}

#[test]
fn signals_in_json() {
    let folder = folder("dbc_json", &[("motion.dbc", DBC)]);
    let found = frames(&["--dbc", folder.join("motion.dbc").to_str().unwrap()]);
    assert_eq!(found.len(), 3);
    assert_eq!(found[0]["name"], "MOTION");
    let expected = json!([
        {"id": null, "name": "Speed", "raw": 30, "value": 15, "unit": "km/h", "origin": "dbc"},
        {"id": null, "name": "State", "raw": 1, "value": 1, "label": "driving", "origin": "dbc"},
    ]);
    assert_eq!(found[0]["signals"], expected);
    assert_eq!(found[2]["signals"][0]["outside"], true);
}

#[test]
fn of_several_the_option_goes_before_the_bus_and_the_bus_before_all() {
    let renamed = |name: &str| DBC.replace("MOTION", name);
    let bus_file = "dbc = \"all.dbc\"\n[bus.can0]\ndbc = [\"own.dbc\", \"more.dbc\"]\n";
    let more = renamed("MORE").replace("100 ", "101 ");
    let files = [
        ("bus.toml", bus_file),
        ("all.dbc", &renamed("ALL")),
        ("own.dbc", &renamed("OWN")),
        ("more.dbc", &more),
    ];
    let folder = folder("dbc_order", &files);
    let path = |name: &str| folder.join(name).to_str().unwrap().to_owned();
    let names = |arguments: &[&str]| -> Vec<_> {
        frames(arguments).iter().map(|event| event["name"].as_str().unwrap().to_owned()).collect()
    };
    assert_eq!(names(&["--bus", &path("bus.toml")]), ["OWN", "OWN", "OWN", "MORE"]);
    fs::write(folder.join("option.dbc"), renamed("OPTION")).unwrap();
    let option = names(&["--bus", &path("bus.toml"), "--dbc", &path("option.dbc")]);
    assert_eq!(option, ["OPTION", "OPTION", "OPTION", "MORE"]);
    fs::write(folder.join("bus.toml"), "dbc = \"all.dbc\"\n[bus.can1]\ndbc = \"own.dbc\"\n").unwrap();
    assert_eq!(names(&["--bus", &path("bus.toml")]), ["ALL", "ALL", "ALL"]);
}

#[test]
fn omissions_are_printed_once_and_an_invalid_dbc_ends_the_program() {
    let half =
        "BO_ 100 HALF: 2 N\n SG_ Gone : 60|8@1+ (1,0) [0|0] \"\" N\n SG_ There : 0|8@1+ (1,0) [0|0] \"\" N\n";
    let folder =
        folder("dbc_broken", &[("half.dbc", half), ("none.dbc", "words"), ("none.json", "{\n\"a\": ]")]);
    let path = |name: &str| folder.join(name).to_str().unwrap().to_owned();
    let dbc = path("half.dbc");
    let output = ok(&["decode", "--dbc", &dbc, "--dbc", &dbc], FRAMES);
    assert!(output.stdout.contains("064 HALF 1E 01: There 30"), "{}", output.stdout);
    let reason = "signal \"Gone\" skipped: it exceeds the message length of 2 bytes";
    assert_eq!(output.stderr, format!("cobscope: {dbc}:2:2: {reason}\n"));
    for (name, reason) in [
        ("none.dbc", ":1:1: neither DBC nor JSON"),
        ("none.json", ":2:6: not valid pretty_j1939 JSON"),
        ("gone.dbc", ": cannot be read"),
    ] {
        let output = run(&["decode", "--dbc", &path(name), "-"], FRAMES);
        assert_eq!(output.code, 4, "{}", output.stderr);
        assert!(output.stderr.contains(&format!("{}{reason}", path(name))), "{}", output.stderr);
    }
}
