//! Findings in the formats of servers, and contents of captures that must be escaped in them.

use std::fmt::Write as _;
use std::fs;

use serde_json::{Value, json};

use crate::check::{check, folder, text};
use crate::support::workspace;

const LOST: &str = "fixtures/rules/node-lost.log";
const EMCY: &str = "fixtures/rules/emcy-raised.log";
const CLEAN: &str = "fixtures/rules/clean/canopen.log";

/// Frames with a hostile bus name, in a file with a hostile name, with a hostile name of the node.
fn hostile() -> (String, String) {
    let folder = folder("hostile\u{1b}[2J,line=1::x");
    let capture = folder.join("a\u{202e}b%\n::error file=x::y.log");
    let bus = "::a,b\u{1b}[31m<&>\"'";
    let mut frames = String::new();
    for (time, frame) in ["705#00", "000#0105", "705#05", "705#05", "085#3081110000000000"].iter().enumerate()
    {
        writeln!(frames, "(17000000{time:02}.{}00000) {bus} {frame}", time + 1).unwrap();
    }
    fs::write(&capture, frames).unwrap();
    let file = folder.join("bus.toml");
    let name = "]]>\\u001B]0;x\\u0007\\n::error::z]]>\\u0000\\uFFFE</failure>";
    fs::write(&file, format!("[node.5]\nname = \"{name}\"\n")).unwrap();
    (text(&capture).to_owned(), text(&file).to_owned())
}

#[test]
fn no_text_of_a_capture_controls_a_terminal_or_a_server() {
    let (capture, bus) = hostile();
    let captures = [
        capture.as_str(),
        "fixtures/malformed/device_name_escapes.log",
        "fixtures/malformed/interface_names.log",
    ];
    for format in ["text", "jsonl", "junit", "sarif", "github"] {
        let arguments =
            [&["-f", format, "--fail-on", "warning", "--bus", &bus, "-v"], &captures[..]].concat();
        let output = check(&arguments);
        assert_eq!(output.code, 1, "{format} {}", output.stderr);
        let is_terminal_control =
            |c: char| c != '\n' && (c.is_control() || ('\u{202a}'..='\u{202e}').contains(&c));
        let is_json = matches!(format, "jsonl" | "sarif");
        if !is_json {
            assert!(!output.stdout.contains(is_terminal_control), "{format}: {:?}", output.stdout);
        }
        assert!(!output.stderr.contains(is_terminal_control), "{format}: {:?}", output.stderr);
        match format {
            "jsonl" => {
                let finding: Value = serde_json::from_str(output.stdout.lines().next().unwrap()).unwrap();
                assert_eq!(finding["capture"], json!(capture));
            }
            "github" => {
                let commands: Vec<&str> = output.stdout.lines().collect();
                let (total, commands) = commands.split_last().unwrap();
                assert!(total.starts_with("3 captures: ") && !commands.is_empty());
                for command in commands {
                    // One command, whose properties end at the second pair of colons.
                    let mut parts = command.splitn(3, "::");
                    assert_eq!(parts.next(), Some(""));
                    let properties = parts.next().unwrap();
                    let level = properties.split(' ').next().unwrap();
                    assert!(["error", "warning", "notice"].contains(&level), "{command}");
                    assert!(properties[level.len()..].starts_with(" file="), "{command}");
                    assert!(properties.matches(',').count() <= 2, "{command}");
                }
            }
            _ => {}
        }
    }
}

#[test]
fn commands_of_github_name_the_line() {
    // The EMCY in the 6th frame is in line 8, after two remarks.
    let output = check(&["-f", "github", EMCY]);
    let first = "::warning file=fixtures/rules/emcy-raised.log,line=8,title=emcy-raised::can0 5/05  EMCY 8130 \
                 heartbeat or life-guard error for 1.0 s, 2 times; look up the error code in the device manual%0Afirst \
                 1.000 s {6}, last 1.100 s {7}";
    assert_eq!(output.stdout.lines().next().unwrap(), first);
    assert!(output.stdout.lines().last().unwrap().starts_with("1 capture: 0 failed"));
}

#[test]
fn lines_are_those_of_the_file_and_only_of_text() {
    let line = |path: &str| {
        let log: Value = serde_json::from_str(&check(&["-f", "sarif", path]).stdout).unwrap();
        let results = log["runs"][0]["results"].as_array().unwrap().clone();
        let lost = results.into_iter().find(|result| result["ruleId"] == "bus-health").unwrap();
        let location = &lost["locations"][0];
        assert_eq!(location["logicalLocations"][0]["name"], "frame 31");
        location["physicalLocation"]["region"]["startLine"].clone()
    };
    // Frame 31 reports bus-off; pasted text has six other lines before it.
    for (path, behind) in [
        ("fixtures/dialects/candump_L.log", 0),
        ("fixtures/dialects/candump_ta.txt", 0),
        ("fixtures/dialects/pasted_L.log", 6),
        ("fixtures/dialects/cr_only.log", 0),
    ] {
        let found = line(path).as_u64().unwrap();
        let file = fs::read_to_string(workspace().join(path)).unwrap();
        let text = file.split(['\n', '\r']).nth(usize::try_from(found).unwrap() - 1).unwrap();
        assert!(found == 31 + behind && text.contains("20000040"), "{path}:{found}: {text}");
    }
}

#[test]
fn sarif_holds_what_code_scanning_shows() {
    let log: Value = serde_json::from_str(&check(&["-f", "sarif", LOST, CLEAN]).stdout).unwrap();
    let run = &log["runs"][0];
    assert_eq!((&log["version"], run["results"].as_array().unwrap().len()), (&json!("2.1.0"), 2));
    let result = &run["results"][0];
    let rule =
        &run["tool"]["driver"]["rules"][usize::try_from(result["ruleIndex"].as_u64().unwrap()).unwrap()];
    assert_eq!((&result["ruleId"], &rule["id"]), (&json!("node-lost"), &json!("node-lost")));
    assert_eq!(rule["defaultConfiguration"]["level"], "error");
    assert!(rule["help"]["markdown"].as_str().unwrap().starts_with("# What it checks\n"));
    assert!(rule["properties"]["tags"].as_array().unwrap().contains(&json!("ctt-7.102")));
    for name in ["cobscopeGroup/v1", "primaryLocationLineHash"] {
        assert_eq!(result["partialFingerprints"][name], "node-lost|can0|5|1017:00");
    }
    let physical = &result["locations"][0]["physicalLocation"];
    assert_eq!(physical["artifactLocation"], json!({"uri": LOST, "index": 0}));
    // Frame 9 is the first late heartbeat: the line before its mark.
    let line = physical["region"]["startLine"].as_u64().unwrap();
    let file = fs::read_to_string(workspace().join(LOST)).unwrap();
    assert!(file.lines().nth(usize::try_from(line).unwrap()).unwrap().starts_with("#~ node-lost"));
}

#[test]
fn junit_has_a_suite_per_capture_and_a_case_per_exercised_rule() {
    let output = check(&["-f", "junit", LOST, CLEAN]).stdout;
    assert!(output.contains("<testsuite name=\"fixtures/rules/node-lost.log\""), "{output}");
    let (lost, clean) = output.split_once("<testsuite name=\"fixtures/rules/clean/canopen.log\"").unwrap();
    assert!(lost.contains("<failure message=\"can0 5/05  no heartbeat after {10}"), "{lost}");
    assert!(lost.contains("    fixtures/rules/node-lost.log:10</failure>"), "{lost}");
    assert!(!clean.contains("<skipped") && clean.contains(" rules not exercised</system-out>"), "{clean}");
    assert!(clean.contains("skipped=\"0\"") && clean.contains("time=\"5.951\""), "{clean}");
    assert!(!clean.contains("<failure"), "{clean}");
    let lines = check(&["-f", "jsonl", CLEAN]).stdout;
    let summary: Value = serde_json::from_str(lines.lines().next().unwrap()).unwrap();
    let rules = summary["rules"].as_array().unwrap();
    let exercised = rules.iter().filter(|rule| rule["verdict"] != "not-exercised").count();
    assert!(exercised < rules.len() && clean.matches("<testcase ").count() == exercised, "{clean}");
    let lenient = check(&["-f", "junit", "--fail-on", "never", LOST]).stdout;
    assert!(!lenient.contains("<failure") && lenient.contains("<system-out>error can0 5/05"), "{lenient}");
    let unread = check(&["-f", "junit", "no/such.log"]).stdout;
    assert!(unread.contains("<error message=\"no/such.log: cannot be opened"), "{unread}");
}
