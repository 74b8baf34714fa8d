//! The arguments of a tool, checked against its parameters, and the options of the command line that they stand for.

use std::path::{Path, PathBuf};

use anyhow::{Context as _, anyhow, bail, ensure};
use serde_json::{Map, Value, json};

use super::folders::AllowedFolders;
use crate::run::arguments::{InputArgs, NodeOption, parse_words};
use crate::run::input::files_named;

/// All tools with their parameters.
const TOOLS: &str = include_str!("tools.json");

/// Parameters of every tool that reads a capture, except for its name.
const DECODING: &str = r#"{
  "nodes": {"type": "array", "items": {"type": "string"}, "description": "Profiles of nodes: 2=rexroth-sydfec, sa:0x80=danfoss-pve-ci"},
  "eds": {"type": "array", "items": {"type": "string"}, "description": "EDS, DCF, XDD or XDC of nodes: 5=pump.eds"},
  "dbc": {"type": "array", "items": {"type": "string"}, "description": "DBC files"},
  "bus_file": {"type": "string", "description": "Bus file (TOML) with names, bit rates and values of this machine"}
}"#;

/// Parameters that name captures.
const CAPTURE: &str = r#"{
  "capture": {"type": "string", "description": "The capture: a file in the folders of this server", "required": true},
  "more_parts": {"type": "array", "items": {"type": "string"}, "description": "Further parts of the same capture"}
}"#;

/// A tool with its schema.
pub(super) struct McpTool {
    pub(super) name: String,
    description: String,
    parameters: Map<String, Value>,
}

/// All tools.
pub(super) fn all_tools() -> Vec<McpTool> {
    let parse = |text: &str| serde_json::from_str::<Value>(text).unwrap_or_default();
    let members = |value: Value| match value {
        Value::Object(members) => members,
        _ => Map::new(),
    };
    let all = parse(TOOLS);
    let all = all.as_array().into_iter().flatten();
    all.map(|tool| {
        let text = |key: &str| tool[key].as_str().unwrap_or_default().to_owned();
        let mut parameters = members(tool["parameters"].clone());
        let has_capture = parameters.remove("capture").is_some();
        if has_capture {
            parameters.extend(members(parse(CAPTURE)));
        }
        if parameters.remove("decoding").is_some() || has_capture {
            parameters.extend(members(parse(DECODING)));
        }
        McpTool { name: text("name"), description: text("description"), parameters }
    })
    .collect()
}

impl McpTool {
    /// The tool as `tools/list` describes it.
    pub(super) fn tool_listing(&self) -> Value {
        let mut properties = Map::new();
        let mut required = Vec::new();
        for (name, parameter) in &self.parameters {
            let mut parameter = parameter.clone();
            if let Some(members) = parameter.as_object_mut()
                && members.remove("required").is_some()
            {
                required.push(name.clone());
            }
            properties.insert(name.clone(), parameter);
        }
        json!({
            "name": self.name,
            "description": self.description,
            "inputSchema": {
                "type": "object",
                "properties": properties,
                "required": required,
                "additionalProperties": false,
            },
            "annotations": {"readOnlyHint": true, "openWorldHint": false},
        })
    }

    /// The arguments of a call.
    ///
    /// # Errors
    /// One is missing, unknown, of another type or outside its limits.
    pub(super) fn parse_arguments(&self, given: &Value) -> anyhow::Result<CallArguments> {
        let Some(given) = given.as_object() else {
            bail!("expected the arguments as an object; found {given}")
        };
        for (name, value) in given {
            let Some(parameter) = self.parameters.get(name) else {
                let known: Vec<_> = self.parameters.keys().map(String::as_str).collect();
                bail!("unknown argument {name:?}; expected {}", known.join(", "));
            };
            check_value(name, value, parameter)?;
        }
        for (name, parameter) in &self.parameters {
            let is_required = parameter.get("required").is_some();
            ensure!(!is_required || given.contains_key(name), "argument {name:?} is missing");
        }
        Ok(CallArguments(given.clone()))
    }
}

fn check_value(name: &str, value: &Value, parameter: &Value) -> anyhow::Result<()> {
    let kind = parameter["type"].as_str().unwrap_or_default();
    let is_valid = match kind {
        "string" => value.is_string(),
        "boolean" => value.is_boolean(),
        "integer" => value.is_u64(),
        "array" => value.as_array().is_some_and(|list| list.iter().all(Value::is_string)),
        _ => false,
    };
    let what = if kind == "array" { "list of strings" } else { kind };
    ensure!(is_valid, "{name}: found {value}, expected {what}");
    if let Some(number) = value.as_u64() {
        let limit = |key: &str| parameter[key].as_u64();
        let (least, most) = (limit("minimum").unwrap_or(0), limit("maximum").unwrap_or(u64::MAX));
        ensure!((least..=most).contains(&number), "{name}: found {number}, expected {least} to {most}");
    }
    if let Some(choices) = parameter["enum"].as_array() {
        let choices_text: Vec<_> = choices.iter().filter_map(Value::as_str).collect();
        ensure!(choices.contains(value), "{name}: found {value}, expected {}", choices_text.join(", "));
    }
    Ok(())
}

/// Checked arguments of a call.
pub(super) struct CallArguments(Map<String, Value>);

impl CallArguments {
    pub(super) fn text_argument(&self, name: &str) -> Option<&str> {
        self.0.get(name)?.as_str()
    }

    pub(super) fn number_argument(&self, name: &str) -> Option<usize> {
        usize::try_from(self.0.get(name)?.as_u64()?).ok()
    }

    pub(super) fn is_set(&self, name: &str) -> bool {
        self.0.get(name) == Some(&Value::Bool(true))
    }

    pub(super) fn list_argument(&self, name: &str) -> Vec<&str> {
        self.0.get(name).and_then(Value::as_array).into_iter().flatten().filter_map(Value::as_str).collect()
    }

    /// A value that is parsed as on the command line.
    ///
    /// # Errors
    /// The text is not valid.
    pub(super) fn parse_argument<T: std::str::FromStr<Err: std::fmt::Display>>(
        &self,
        name: &str,
    ) -> anyhow::Result<Option<T>> {
        let parse = |text: &str| text.parse().map_err(|error| anyhow!("{name}: found {text:?}; {error}"));
        self.text_argument(name).map(parse).transpose()
    }

    /// The captures named by `names`, and the options of the command line for decoding them.
    ///
    /// # Errors
    /// A file is outside the folders, or an option is not valid.
    pub(super) fn command_words(
        &self,
        names: &[&str],
        folders: &AllowedFolders,
    ) -> anyhow::Result<Vec<String>> {
        let path = |text: &str| {
            let path = folders.find_file(text)?;
            path.into_os_string().into_string().map_err(|_| anyhow!("{text}: the name is not UTF-8"))
        };
        let mut words = Vec::new();
        for node in self.list_argument("nodes") {
            ensure!(
                node.contains('='),
                "nodes: found {node:?}, expected a node with its profile: 2=rexroth-sydfec"
            );
            words.push(format!("--node={node}"));
        }
        for eds in self.list_argument("eds") {
            let (node, file) =
                eds.split_once('=').with_context(|| format!("eds: found {eds:?}, expected 5=pump.eds"))?;
            words.push(format!("--eds={node}={}", path(file)?));
        }
        for file in self.list_argument("dbc") {
            words.push(format!("--dbc={}", path(file)?));
        }
        if let Some(file) = self.text_argument("bus_file") {
            let file = path(file)?;
            // A bus file names further files, which are read, too.
            for named in files_named(Path::new(&file)) {
                folders.find_file(&named.to_string_lossy()).context("named in the bus file")?;
            }
            words.push(format!("--bus={file}"));
        }
        words.push("--".to_owned());
        for name in names {
            match self.text_argument(name) {
                Some(file) => words.push(path(file)?),
                None => self
                    .list_argument(name)
                    .into_iter()
                    .try_for_each(|file| path(file).map(|file| words.push(file)))?,
            }
        }
        Ok(words)
    }
}

/// Options of the command line from words.
///
/// # Errors
/// They are not valid.
pub(super) fn parse_input(words: &[String], profiles: &[PathBuf]) -> anyhow::Result<InputArgs> {
    let input: InputArgs = parse_options("stats", words)?;
    input.check_nodes(Some(NodeOption::Decode)).map_err(anyhow::Error::msg)?;
    Ok(InputArgs { profiles: profiles.to_vec(), ..input })
}

/// Options of a command from words.
///
/// # Errors
/// They are not valid.
pub(super) fn parse_options<A: clap::Args>(command: &'static str, words: &[String]) -> anyhow::Result<A> {
    parse_words(command, words.iter().map(Into::into)).map_err(|error| {
        let text = error.to_string();
        // The usage that follows describes the command line.
        anyhow!(text.lines().next().unwrap_or_default().trim_start_matches("error: ").to_owned())
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    fn tool(name: &str) -> McpTool {
        all_tools().into_iter().find(|tool| tool.name == name).unwrap()
    }

    #[test]
    fn each_tool_has_a_schema() {
        let names: Vec<_> = all_tools().iter().map(|tool| tool.name.clone()).collect();
        let expected =
            ["captures", "summary", "why", "findings", "events", "objects", "signals", "explain", "diff"];
        assert_eq!(names, expected);
        let events = tool("events").tool_listing();
        let schema = &events["inputSchema"];
        assert_eq!(schema["required"], json!(["capture"]));
        assert_eq!(schema["properties"]["limit"]["maximum"], 500);
        assert!(schema["properties"]["bus_file"].is_object());
        assert!(schema["properties"]["capture"].get("required").is_none());
        for tool in all_tools() {
            for (name, parameter) in &tool.parameters {
                assert!(parameter["description"].is_string(), "{} {name}", tool.name);
            }
        }
    }

    #[test]
    fn arguments_are_checked() {
        let error = |arguments: Value| tool("events").parse_arguments(&arguments).err().unwrap().to_string();
        assert_eq!(error(json!({})), "argument \"capture\" is missing");
        assert_eq!(error(json!({"capture": 1})), "capture: found 1, expected string");
        assert_eq!(error(json!({"capture": "a", "limit": 501})), "limit: found 501, expected 1 to 500");
        assert_eq!(error(json!({"capture": "a", "limit": -1})), "limit: found -1, expected integer");
        assert_eq!(
            error(json!({"capture": "a", "nodes": "2"})),
            "nodes: found \"2\", expected list of strings"
        );
        assert!(
            error(json!({"capture": "a", "file": "b"})).starts_with("unknown argument \"file\"; expected ")
        );
        assert_eq!(error(json!([])), "expected the arguments as an object; found []");
        let severity = json!({"capture": "a", "severity": "bad"});
        let text = tool("findings").parse_arguments(&severity).err().unwrap().to_string();
        assert_eq!(text, "severity: found \"bad\", expected error, warning, note");
        let arguments = tool("events").parse_arguments(&json!({"capture": "a", "from": "x"})).unwrap();
        let text = arguments.parse_argument::<crate::select::RangeBound>("from").unwrap_err().to_string();
        assert!(text.starts_with("from: found \"x\"; expected seconds"), "{text}");
    }

    #[test]
    fn options_are_those_of_the_command_line() {
        let words = |words: &[&str]| words.iter().map(|word| (*word).to_owned()).collect::<Vec<_>>();
        let found = parse_input(&words(&["--node=2=rexroth-sydfec", "--", "-f"]), &["p".into()]).unwrap();
        assert_eq!((found.captures, found.profiles), (vec!["-f".into()], vec!["p".into()]));
        let text =
            parse_input(&words(&["--node=200=rexroth-sydfec", "--", "a"]), &[]).unwrap_err().to_string();
        assert!(text.contains("expected a node-ID"), "{text}");
    }
}
