//! `docs/events.schema.json`: generated from the field table, and valid for every event of every fixture.

#![expect(clippy::panic, reason = "a test that cannot go on has failed")]

use std::collections::{BTreeMap, BTreeSet};
use std::fs;
use std::path::PathBuf;
use std::process::{Command, Stdio};

use cobscope_decoder::capture::{Batch, BatchItem, CaptureReader, ReadOptions};
use cobscope_decoder::decoder::Decoder;
use cobscope_decoder::event::{Event, Kind, KindSet};
use cobscope_decoder::profile::Catalogue;
use cobscope_decoder::query::fields::{FieldDefinition, FieldType, field_table};
use cobscope_decoder::session::{Bus, SessionOptions};
use cobscope_decoder::sink::EventSink as _;
use cobscope_decoder::sink::jsonl::JsonlSink;
use regex_lite::Regex;
use serde_json::{Map, Value, json};

use crate::scene::{self, Expected};
use crate::{devices, support};

/// Keys of every event.
const REQUIRED: [&str; 5] = ["t", "bus", "frames", "kind", "protocol"];

fn path() -> PathBuf {
    support::workspace().join("docs").join("events.schema.json")
}

/// The whole schema.
fn schema() -> Value {
    let (every, some): (Vec<&FieldDefinition>, Vec<&FieldDefinition>) =
        field_table().fields.iter().partition(|field| field.kinds == KindSet::ALL);
    let mut definitions = Map::new();
    let mut choices = Vec::new();
    for kind in Kind::ALL {
        let (kind, description) = (kind.name(), kind.description());
        let own = some.iter().copied().filter(|field| field.kinds.names().any(|own| own == kind));
        let mut definition = Map::new();
        definition.insert("description".into(), description.into());
        definition.insert("properties".into(), properties(&own.collect::<Vec<_>>(), ""));
        definitions.insert(kind.into(), definition.into());
        choices.push(json!({
            "if": { "properties": { "kind": { "const": kind } } },
            "then": { "$ref": format!("#/$defs/{kind}") },
        }));
    }
    let mut properties = properties(&every, "");
    properties["kind"]["examples"] = KindSet::ALL.names().collect();
    json!({
        "$schema": "https://json-schema.org/draft/2020-12/schema",
        "$id": "urn:cobscope:events/v1",
        "title": "Events as cobscope writes them with -f jsonl, one object a line",
        "description": "Kinds, keys and texts may be added within v1; none is removed or renamed.",
        "type": "object",
        "required": REQUIRED,
        "properties": properties,
        "allOf": choices,
        "additionalProperties": true,
        "$defs": definitions,
    })
}

/// Properties of the object at `prefix`, which ends with a dot unless it is empty.
fn properties(fields: &[&FieldDefinition], prefix: &str) -> Value {
    let mut all = Map::new();
    for field in fields {
        let Some(key) = field.key.strip_prefix(prefix).filter(|key| !key.contains('.')) else { continue };
        let mut value = match field.value {
            FieldType::Group => {
                let inner = properties(fields, &format!("{}.", field.key));
                json!({ "type": "object", "properties": inner, "additionalProperties": true })
            }
            _ => value(field),
        };
        if field.list {
            value = json!({ "type": "array", "items": value });
        }
        value["description"] = field.doc.clone().into();
        all.insert(key.into(), value);
    }
    all.into()
}

fn value(field: &FieldDefinition) -> Value {
    let (name, pattern) = match field.value {
        FieldType::Any => return json!({ "type": ["number", "string", "null"] }),
        FieldType::Bool => ("boolean", ""),
        FieldType::Unsigned | FieldType::Integer => ("integer", ""),
        FieldType::Real => return json!({ "type": ["number", "null"] }),
        FieldType::Seconds => ("number", ""),
        FieldType::Text | FieldType::Group => ("string", ""),
        FieldType::Code => ("string", "^0x[0-9A-F]+$"),
        FieldType::Id => ("string", "^([0-9A-F]{3}|[0-9A-F]{8})$"),
        FieldType::Object => ("string", "^0x[0-9A-F]{4}:[0-9A-F]{2}$"),
        FieldType::Bytes => ("string", "^([0-9A-F]{2})*$"),
    };
    let mut value = json!({ "type": name });
    if field.null {
        value["type"] = json!([name, "null"]);
    }
    if field.value == FieldType::Unsigned {
        value["minimum"] = 0.into();
    }
    if !pattern.is_empty() {
        value["pattern"] = pattern.into();
    }
    if !field.values.is_empty() {
        value["examples"] = field.values.clone().into();
    }
    value
}

#[test]
fn the_schema_is_that_of_the_field_table() {
    let made = serde_json::to_string_pretty(&schema()).unwrap() + "\n";
    if std::env::var_os("COBSCOPE_BLESS").is_some() {
        fs::write(path(), &made).unwrap();
    }
    let kept = fs::read_to_string(path()).unwrap_or_default();
    assert!(kept == made, "docs/events.schema.json is stale: run this test with COBSCOPE_BLESS=1");
}

/// A JSON Schema validator for the keywords of our schema; an unknown keyword is an error.
struct Validator {
    root: Value,
    patterns: BTreeMap<String, Regex>,
}

impl Validator {
    fn new() -> Self {
        Self { root: schema(), patterns: BTreeMap::new() }
    }

    fn check(&mut self, value: &Value) -> Result<(), String> {
        let root = self.root.clone();
        self.value(&root, value, "")
    }

    fn value(&mut self, schema: &Value, value: &Value, at: &str) -> Result<(), String> {
        for (keyword, rule) in schema.as_object().unwrap() {
            let fault = |what: String| Err(format!("{at}: {value} {what}"));
            match keyword.as_str() {
                "additionalProperties" => assert_eq!(rule, true),
                "type" if !has_type(rule, value) => return fault(format!("is not {rule}")),
                "minimum" if value.as_u64().is_none() && value.is_number() => {
                    return fault("is below 0".into());
                }
                "const" if rule != value => return fault(format!("is not {rule}")),
                "pattern" => self.pattern(rule, value, at)?,
                "required" => required(rule, value, at)?,
                "properties" => self.members(rule, value, at)?,
                "items" => {
                    for (place, item) in value.as_array().into_iter().flatten().enumerate() {
                        self.value(rule, item, &format!("{at}/{place}"))?;
                    }
                }
                "allOf" => {
                    for part in rule.as_array().unwrap() {
                        self.value(part, value, at)?;
                    }
                }
                "if" => {
                    if self.value(rule, value, at).is_ok() {
                        self.value(&schema["then"], value, at)?;
                    }
                }
                "$ref" => {
                    let target = rule.as_str().unwrap().trim_start_matches('#');
                    let target = self.root.pointer(target).unwrap().clone();
                    self.value(&target, value, at)?;
                }
                // Annotations, and keywords that are checked elsewhere.
                "$schema" | "$id" | "$defs" | "title" | "description" | "examples" | "then" | "type"
                | "minimum" | "const" => {}
                other => panic!("keyword {other}"),
            }
        }
        Ok(())
    }

    fn members(&mut self, rule: &Value, value: &Value, at: &str) -> Result<(), String> {
        for (key, member) in value.as_object().into_iter().flatten() {
            if let Some(rule) = rule.get(key) {
                self.value(rule, member, &format!("{at}/{key}"))?;
            }
        }
        Ok(())
    }

    fn pattern(&mut self, rule: &Value, value: &Value, at: &str) -> Result<(), String> {
        let pattern = rule.as_str().unwrap();
        let regex = self.patterns.entry(pattern.into()).or_insert_with(|| Regex::new(pattern).unwrap());
        match value.as_str() {
            Some(text) if !regex.is_match(text) => Err(format!("{at}: {text} is not {pattern}")),
            _ => Ok(()),
        }
    }
}

fn required(rule: &Value, value: &Value, at: &str) -> Result<(), String> {
    let mut keys = rule.as_array().unwrap().iter().map(|key| key.as_str().unwrap());
    match keys.find(|key| value.get(key).is_none()) {
        Some(key) => Err(format!("{at}: {key} is missing")),
        None => Ok(()),
    }
}

fn has_type(rule: &Value, value: &Value) -> bool {
    match rule {
        Value::Array(choices) => choices.iter().any(|choice| has_type(choice, value)),
        _ => match rule.as_str().unwrap() {
            "null" => value.is_null(),
            "boolean" => value.is_boolean(),
            "integer" => value.is_i64() || value.is_u64(),
            "number" => value.is_number(),
            "string" => value.is_string(),
            "array" => value.is_array(),
            "object" => value.is_object(),
            other => panic!("type {other}"),
        },
    }
}

/// All lines of the JSON output for a capture.
fn lines(bytes: &[u8], options: SessionOptions) -> String {
    let mut reader = CaptureReader::open(bytes, &ReadOptions::default()).unwrap();
    let mut decoder = Decoder::new(options);
    let mut batch = Batch::new();
    let mut output = Vec::new();
    let mut sink = JsonlSink::new(&mut output);
    let mut observer = |event: &Event, bus: &Bus| {
        sink.write_event(event, bus);
    };
    while reader.read(&mut batch).unwrap() {
        for item in batch.items() {
            match item {
                BatchItem::Frame(frame) => decoder.push(frame, reader.buses(), &mut observer),
                BatchItem::Notice(notice) => decoder.on_notice(notice, reader.buses(), &mut observer),
            }
        }
    }
    decoder.finish_capture(reader.buses(), &mut observer);
    sink.finish_output().unwrap();
    String::from_utf8(output).unwrap()
}

/// Lines of every fixture, and of the samples.
fn all_lines() -> String {
    let mut all = String::new();
    for (folder, least) in [("canopen", 20), ("j1939", 7)] {
        let captures = scene::captures(folder);
        assert!(captures.len() >= least);
        for name in captures {
            all += &lines(&fs::read(name.with_extension("log")).unwrap(), SessionOptions::default());
        }
    }
    let catalogue = Catalogue::default();
    for name in scene::captures("devices") {
        let expected = Expected::read(&name.with_extension("expected.txt"));
        let options = devices::options(&name, &expected, &catalogue);
        all += &lines(&fs::read(name.with_extension("log")).unwrap(), options);
    }
    all + include_str!("inside/events.jsonl")
}

#[test]
fn every_event_of_every_fixture_is_as_the_schema_says() {
    let mut validator = Validator::new();
    for line in all_lines().lines() {
        let value: Value = serde_json::from_str(line).unwrap();
        if let Err(fault) = validator.check(&value) {
            panic!("{fault}\n{line}");
        }
        let kind = value["kind"].as_str().unwrap();
        for key in value.as_object().unwrap().keys() {
            let known =
                |field: &FieldDefinition| field.key == *key && field.kinds.names().any(|own| own == kind);
            assert!(field_table().fields.iter().any(known), "{key} is in no table: {line}");
        }
    }
}

#[test]
fn the_check_finds_faults() {
    let mut validator = Validator::new();
    let good = r#"{"t":null,"bus":"can0","frames":[1,1],"kind":"emcy","protocol":"canopen","code":"0x8130"}"#;
    let faults = [
        ("\"t\":null,", ""),
        ("\"t\":null", "\"t\":\"1\""),
        ("[1,1]", "[1,-1]"),
        ("0x8130", "8130"),
        ("\"0x8130\"", "33072"),
    ];
    let mut check = |text: &str| validator.check(&serde_json::from_str(text).unwrap());
    assert_eq!(check(good), Ok(()));
    assert_eq!(check(&good.replace("emcy", "of a later version")), Ok(()));
    for (from, to) in faults {
        assert!(check(&good.replace(from, to)).is_err(), "{from} as {to}");
    }
}

#[test]
fn another_validator_agrees() {
    const SCRIPT: &str = "import json, sys, jsonschema\n\
        schema = json.load(open(sys.argv[1]))\n\
        jsonschema.Draft202012Validator.check_schema(schema)\n\
        check = jsonschema.Draft202012Validator(schema)\n\
        for line in sys.stdin: check.validate(json.loads(line))\n";
    let Some(python) = support::python() else { return support::skip("python", "no Python for oracles") };
    let has = Command::new(&python).args(["-c", "import jsonschema"]).stderr(Stdio::null()).status();
    if !has.is_ok_and(|status| status.success()) {
        return support::skip("python", "it has no jsonschema");
    }
    let input = std::env::temp_dir().join(format!("cobscope-schema-{}.jsonl", std::process::id()));
    fs::write(&input, all_lines()).unwrap();
    let mut command = Command::new(python);
    command.arg("-c").arg(SCRIPT).arg(path()).stdin(fs::File::open(&input).unwrap());
    let output = command.output().unwrap();
    let _ = fs::remove_file(&input);
    assert!(output.status.success(), "{}", String::from_utf8_lossy(&output.stderr));
}

#[test]
#[cfg_attr(not(unix), ignore = "wants tshark")]
fn aliases_are_names_of_wireshark() {
    let output = Command::new("tshark").args(["-G", "fields"]).output();
    let Ok(output) = output else {
        support::skip("tshark", "it is not installed");
        return;
    };
    let listing = String::from_utf8_lossy(&output.stdout);
    let names: BTreeSet<&str> = listing.lines().filter_map(|line| line.split('\t').nth(2)).collect();
    let fields = field_table().fields.iter().flat_map(|field| &field.alias);
    for alias in fields.chain(field_table().parts.iter().flat_map(|part| &part.alias)) {
        assert!(names.contains(alias.as_str()), "{alias}");
    }
}
