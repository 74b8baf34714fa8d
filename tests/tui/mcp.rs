//! `cobscope mcp` with a client that writes lines and reads lines.
#![expect(clippy::indexing_slicing, clippy::panic, reason = "a test that cannot go on has failed")]

use std::io::{BufRead as _, BufReader, Write as _};
use std::path::{Path, PathBuf};
use std::process::{Child, ChildStdin, ChildStdout, Command, Stdio};

use proptest::prelude::*;
use serde_json::{Value, json};

/// Maximum length of an answer in bytes.
const LONGEST: usize = 64 * 1024;

struct Client {
    server: Child,
    input: ChildStdin,
    output: BufReader<ChildStdout>,
    number: u64,
}

fn fixtures() -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).join("../fixtures")
}

impl Client {
    fn start(folder: &Path) -> Self {
        let mut command = Command::new(env!("CARGO_BIN_EXE_cobscope"));
        command.arg("mcp").arg(folder).stdin(Stdio::piped()).stdout(Stdio::piped()).stderr(Stdio::null());
        let mut server = command.spawn().unwrap();
        let (input, output) = (server.stdin.take().unwrap(), server.stdout.take().unwrap());
        let mut client = Self { server, input, output: BufReader::new(output), number: 0 };
        let hello = json!({"protocolVersion": "2025-03-26", "capabilities": {}, "clientInfo": {"name": "test", "version": "1"}});
        let greeting = client.request("initialize", &hello);
        assert_eq!(greeting["result"]["protocolVersion"], "2025-03-26");
        assert_eq!(greeting["result"]["serverInfo"]["name"], "cobscope");
        client.send(br#"{"jsonrpc":"2.0","method":"notifications/initialized"}"#);
        client
    }

    fn send(&mut self, line: &[u8]) {
        self.input.write_all(line).unwrap();
        self.input.write_all(b"\n").unwrap();
    }

    fn receive(&mut self) -> Value {
        let mut line = String::new();
        self.output.read_line(&mut line).unwrap();
        assert!(line.len() <= LONGEST, "{}", line.len());
        serde_json::from_str(&line).unwrap_or_else(|error| panic!("{error}: {line:?}"))
    }

    fn request(&mut self, method: &str, params: &Value) -> Value {
        self.number += 1;
        let request = json!({"jsonrpc": "2.0", "id": self.number, "method": method, "params": params});
        self.send(request.to_string().as_bytes());
        let answer = self.receive();
        assert_eq!(answer["id"], self.number);
        answer
    }

    fn tool(&mut self, name: &str, arguments: &Value) -> Result<String, String> {
        let answer = self.request("tools/call", &json!({"name": name, "arguments": arguments}));
        let text = answer["result"]["content"][0]["text"].as_str().unwrap_or_else(|| panic!("{answer}"));
        if answer["result"]["isError"] == true { Err(text.to_owned()) } else { Ok(text.to_owned()) }
    }

    fn ask(&mut self, name: &str, arguments: &Value) -> Value {
        let text = self.tool(name, arguments).unwrap_or_else(|error| panic!("{name} {arguments}: {error}"));
        serde_json::from_str(&text).unwrap_or_else(|error| panic!("{error}: {text}"))
    }

    /// Ends the input; the server must end with success.
    fn end(mut self) {
        drop(self.input);
        assert!(self.server.wait().unwrap().success());
    }
}

fn texts(value: &Value) -> String {
    value.to_string()
}

/// The questions of a person at the machine, answered without reading frames. Expected values are those of the scripts that
/// made the captures (`fixtures/devices/make_*.py`).
/// Lines of a command as objects.
fn lines(command: &[&str]) -> Vec<Value> {
    let output = crate::cli::run(command, "").stdout;
    output.lines().map(|line| serde_json::from_str(line).unwrap()).collect()
}

/// Members of a command's object that an answer has with another value.
fn differing_keys(expected: &Value, answer: &Value) -> Vec<String> {
    let members = expected.as_object().unwrap().iter();
    members.filter(|(key, value)| answer.get(key) != Some(value)).map(|(key, _)| key.clone()).collect()
}

#[test]
fn answers_have_the_keys_of_the_commands() {
    let mut client = Client::start(&fixtures());
    let (mut compared, mut omitted) = (0, 0);
    for capture in crate::support::captures_below("fixtures").iter().step_by(crate::support::step(6)) {
        let own = json!({"capture": capture});
        let Ok(summary) = client.tool("summary", &own) else {
            assert!(lines(&["stats", "-f", "json", capture]).is_empty(), "{capture}");
            continue;
        };
        let summary: Value = serde_json::from_str(&summary).unwrap();
        let [statistics] = lines(&["stats", "-f", "json", capture]).try_into().unwrap();
        let [stories] = lines(&["why", "-f", "json", capture]).try_into().unwrap();
        let why = client.ask("why", &own);
        let found = client.ask("findings", &own);
        // A long answer is shortened and states it.
        if [&summary, &why, &found].iter().any(|answer| answer.get("omitted").is_some()) {
            omitted += 1;
            continue;
        }
        compared += 1;
        assert_eq!(differing_keys(&statistics, &summary), [""; 0], "{capture}: stats");
        assert_eq!(differing_keys(&stories, &why), [""; 0], "{capture}: why");
        let is_finding = |line: &Value| line["kind"] == "finding" && line.get("suppressed").is_none();
        let mut checked = lines(&["check", "-f", "jsonl", capture]);
        checked.retain(is_finding);
        let answered = found["findings"].as_array().unwrap().iter().cloned();
        let plain = |mut finding: Value| {
            // Line numbers need another reading.
            for place in finding["occurrences"].as_array_mut().unwrap() {
                place.as_object_mut().unwrap().remove("line");
            }
            if let Some(worst) = finding.get_mut("worst") {
                worst.as_object_mut().unwrap().remove("line");
            }
            finding
        };
        let checked: Vec<_> = checked.into_iter().map(plain).collect();
        assert_eq!(answered.map(plain).collect::<Vec<_>>(), checked, "{capture}: findings");
        for node in lines(&["objects", "-f", "json", capture]) {
            let name = format!("{}:{}", node["bus"].as_str().unwrap(), node["node"]);
            let answer = client.ask("objects", &json!({"capture": capture, "node": name}));
            let printed = lines(&["objects", "-f", "json", "--node", &name, capture]);
            let shown = answer["objects"].as_array().unwrap();
            for (own, printed) in shown.iter().zip(&printed) {
                for (key, value) in own.as_object().unwrap() {
                    assert_eq!(Some(value), printed.get(key), "{capture}: {name} {key}");
                }
            }
            assert!(shown.len() == printed.len() || answer.get("omitted").is_some(), "{capture}: {name}");
        }
    }
    assert!(compared > 30 && compared > omitted, "{compared} of {}", compared + omitted);
    client.end();
}

#[test]
fn ten_questions_are_answered() {
    let mut client = Client::start(&fixtures());
    let pve = json!({"capture": "devices/pve.log", "nodes": ["32=danfoss-pve-ci"]});
    let pump = |more: &Value| {
        let mut all = json!({"capture": "devices/sydfec.log", "nodes": ["2=rexroth-sydfec"]});
        for (key, value) in more.as_object().unwrap() {
            all[key] = value.clone();
        }
        all
    };

    // 1 Why does the valve not follow the set point? 4 Why did it go to fault, and what was first?
    let why = client.ask("why", &pve);
    let point = &why["nodes"][0]["set_points"][0];
    assert_eq!((&point["signal"], &point["effective"]), (&json!("Spool set point"), &json!("no")));
    let closed = point["gates"].as_array().unwrap().iter().find(|gate| gate["status"] == "closed").unwrap();
    assert_eq!(closed["gate"], "device ACTIVE");
    let first = &why["stories"][0]["lines"][0];
    assert_eq!((&first["label"], &first["frames"]), (&json!("cause"), &json!([104, 104])));
    assert!(first["text"].as_str().unwrap().contains("EMCY 8305 spool position error"), "{first}");

    // 2 Who sends this COB-ID?
    let summary = client.ask("summary", &pump(&json!({})));
    let ids = summary["buses"][0]["ids"].as_array().unwrap();
    let what = |id: &str| ids.iter().find(|row| row["id"] == id).unwrap()["what"].clone();
    assert_eq!((what("182"), what("202")), (json!("TPDO1 of 2"), json!("RPDO1 of 2")));

    // 3 Did the node accept the new parameter, and will it survive a power cycle?
    let objects = client.ask("objects", &pump(&json!({"node": "2", "object": "5208:02"})));
    let [pressure] = objects["objects"].as_array().unwrap().as_slice() else { panic!("{objects}") };
    assert_eq!((&pressure["value"], &pressure["unit"]), (&json!(250), &json!("bar")));
    assert_eq!((&pressure["origin"], &pressure["persists"]), (&json!("download"), &json!("yes")));

    // 5 Is my PLC too slow? The reaction times, and the worst gap of its guarding.
    let why = client.ask("why", &pump(&json!({})));
    assert_eq!(why["reactions"][0]["rpdo"], "RPDO1");
    assert!(texts(&why["stories"][0]).contains("worst guarding interval 2200 ms > 1500 ms"), "{why}");

    // 6 Which node is silent, and since when?
    let lost = json!({"capture": "rules/node-lost.log"});
    let findings = client.ask("findings", &json!({"capture": lost["capture"], "rule": "node-lost"}));
    let silent = &findings["findings"][0];
    assert!(silent["node"].is_number() && silent["occurrences"][0]["t"].is_number(), "{silent}");

    // 7 Is the wiring bad?
    assert!(
        texts(&why["stories"][0]["lines"]).contains("wiring: no error frames, and the capture does not show"),
        "{why}"
    );

    // 8 What differs between the good machine and the bad one?
    let pair = json!({"good": "devices/pve.log", "bad": "devices/pve_reset_communication.log", "nodes": ["32=danfoss-pve-ci"]});
    let differences = client.ask("diff", &pair);
    assert_eq!(differences["equal"], false);
    assert!(!differences["differences"].as_array().unwrap().is_empty());

    // 9 Which configuration has this node?
    let objects = client.ask("objects", &pump(&json!({"node": "2"})));
    assert!(objects["objects"].as_array().unwrap().len() > 5, "{objects}");

    // 10 Can I prove it to the supplier? Manual section, frames, measured value against limit.
    let findings = client.ask("findings", &pump(&json!({})));
    let found = findings["findings"].as_array().unwrap();
    let of = |rule: &str| found.iter().find(|finding| finding["rule"] == rule).unwrap();
    assert_eq!(of("emcy-raised")["manual"], "RE 30027-Z/11.06 §14.3.1.2");
    assert_eq!(of("guard-late")["worst"]["frames"], json!([337, 345]));
    assert!(texts(&of("guard-late")["worst"]).contains("2200 ms > 1500 ms"), "{findings}");
    let verdict = client.ask("findings", &pump(&json!({"rule": "node-lost"})));
    assert_eq!((&verdict["findings"], &verdict["rule"]["verdict"]), (&json!([]), &json!("not-exercised")));
    client.end();
}

#[test]
fn events_are_continued_where_an_answer_ended() {
    let mut client = Client::start(&fixtures());
    let ask = |more: Value| {
        let mut all = json!({"capture": "devices/sydfec.log", "nodes": ["2=rexroth-sydfec"]});
        for (key, value) in more.as_object().unwrap() {
            all[key] = value.clone();
        }
        all
    };
    let whole = client.ask("events", &ask(json!({"limit": 500})));
    assert_eq!((&whole["complete"], &whole["next"]), (&json!(true), &Value::Null));
    let whole = whole["events"].as_array().unwrap().clone();
    assert!(whole.len() > 20);
    let mut pieces = Vec::new();
    let mut next = Value::Null;
    loop {
        let mut arguments = ask(json!({"limit": 7}));
        if let Some(next) = next.as_str() {
            arguments["after"] = json!(next);
        }
        let answer = client.ask("events", &arguments);
        pieces.extend(answer["events"].as_array().unwrap().clone());
        next = answer["next"].clone();
        if next.is_null() {
            break;
        }
    }
    assert_eq!(pieces, whole);
    // A range and a filter select the same events.
    let emergencies =
        |events: &[Value]| events.iter().filter(|event| event["kind"] == "emcy").cloned().collect::<Vec<_>>();
    let filtered = client.ask("events", &ask(json!({"filter": "kind == emcy"})));
    assert_eq!(filtered["events"], json!(emergencies(&whole)));
    let late = client.ask("events", &ask(json!({"filter": "kind == emcy", "from": "#243"})));
    let after = emergencies(&whole).into_iter().filter(|event| event["frames"][1].as_u64().unwrap() >= 243);
    assert_eq!(late["events"], json!(after.collect::<Vec<_>>()));
    client.end();
}

/// `fixtures/devices/make_pve.py`: the spool reaches 37.4 % at 4.15 s and again at 11.944 s, and −49.9 % at 12.454 s.
#[test]
fn signals_have_extremes_with_their_times() {
    let mut client = Client::start(&fixtures());
    let ask = |more: Value| {
        let mut all =
            json!({"capture": "devices/pve.log", "nodes": ["32=danfoss-pve-ci"], "signal": "spool position"});
        for (key, value) in more.as_object().unwrap() {
            all[key] = value.clone();
        }
        all
    };
    let answer = client.ask("signals", &ask(json!({})));
    let signal = &answer["signals"][0];
    assert_eq!((&signal["object"], &signal["unit"]), (&json!("6301:01"), &json!("%")));
    assert_eq!(signal["max"], json!({"seconds": 4.15, "frame": 73, "value": "37.4 %"}));
    assert_eq!(signal["min"], json!({"seconds": 12.454, "frame": 172, "value": "-49.9 %"}));
    let part = client.ask("signals", &ask(json!({"from": "5", "to": "12"})));
    assert_eq!(part["signals"][0]["max"]["seconds"], 7.206);
    // Objects before the first write are unknown, afterwards they have the value of that time.
    let objects = |client: &mut Client, at: &str| {
        let arguments = json!({"capture": "devices/pve.log", "nodes": ["32=danfoss-pve-ci"], "node": "32", "object": "1001", "at": at});
        client.ask("objects", &arguments)["objects"].clone()
    };
    assert_eq!(objects(&mut client, "#119"), json!([]));
    assert_eq!(objects(&mut client, "#120")[0]["value"], 33);
    client.end();
}

#[test]
fn objects_lists_no_node_that_never_sent() {
    // The NMT command to node 2 has no response.
    let folder = tempfile::tempdir().unwrap();
    let log = "(1700000000.0) can0 701#05\n(1700000000.1) can0 000#8102\n(1700000000.2) can0 701#05\n";
    std::fs::write(folder.path().join("a.log"), log).unwrap();
    let mut client = Client::start(folder.path());
    let nodes = client.ask("objects", &json!({"capture": "a.log"}))["nodes"].clone();
    let nodes: Vec<_> = nodes.as_array().unwrap().iter().map(|node| &node["node"]).collect();
    assert_eq!(nodes, [&json!("1")]);
    client.end();
}

#[test]
fn bad_requests_are_answered_and_nothing_outside_is_read() {
    let folder = tempfile::tempdir().unwrap();
    let inner = folder.path().join("inner");
    std::fs::create_dir(&inner).unwrap();
    std::fs::write(folder.path().join("secret.log"), "(1.0) can0 701#05\n").unwrap();
    std::fs::write(inner.join("broken.log"), "\u{1b}[31m no frames\n").unwrap();
    let mut client = Client::start(&inner);
    for path in ["../secret.log", "/etc/passwd", "", "no.log", "-"] {
        let error = client.tool("why", &json!({"capture": path})).unwrap_err();
        assert!(
            error.contains("no such file in the folders") || error.contains("expected a file"),
            "{error}"
        );
    }
    for arguments in [
        json!({"capture": "broken.log", "eds": ["5=../secret.log"]}),
        json!({"capture": "broken.log", "bus_file": "/etc/hostname"}),
        json!({"capture": "broken.log", "dbc": ["../secret.log"]}),
        json!({"capture": "broken.log", "more_parts": ["../secret.log"]}),
    ] {
        let error = client.tool("summary", &arguments).unwrap_err();
        assert!(error.contains("no such file in the folders"), "{error}");
    }
    std::fs::write(inner.join("machine.toml"), "[node.5]\neds = \"../secret.log\"\n").unwrap();
    let named = json!({"capture": "broken.log", "bus_file": "machine.toml"});
    let error = client.tool("summary", &named).unwrap_err();
    assert!(error.starts_with("named in the bus file: "), "{error}");
    std::fs::remove_file(inner.join("machine.toml")).unwrap();
    let error = client.tool("summary", &json!({"capture": "broken.log"})).unwrap_err();
    assert!(error.contains("broken.log") && !error.contains('\u{1b}'), "{error}");
    let error = client.tool("events", &json!({"capture": "broken.log", "filter": "kind =="})).unwrap_err();
    assert!(!error.is_empty());
    let answer = client.request("tools/call", &json!({"name": "transmit"}));
    assert_eq!(answer["error"]["code"], -32_602);
    client.send(&vec![b'['; 100_000]);
    assert_eq!(client.receive()["error"]["code"], -32_700);
    client.send(&vec![b'x'; 2 << 20]);
    assert_eq!(client.receive()["error"]["code"], -32_600);
    // A damaged capture without a finding is not clean.
    std::fs::write(inner.join("damaged.log"), "(1.0) can0 705#05\nrubbish\n(2.0) can0 705#05\n").unwrap();
    for tool in ["why", "findings", "summary"] {
        let answer = client.ask(tool, &json!({"capture": "damaged.log"}));
        assert!(texts(&answer["warnings"]).contains("1 line or record unreadable"), "{answer}");
    }
    let wrong = |tool: &str, arguments: Value| (tool.to_owned(), arguments);
    for (tool, arguments) in [
        wrong("findings", json!({"capture": "damaged.log", "rule": "node-lots"})),
        wrong("findings", json!({"capture": "damaged.log", "node": "99"})),
        wrong("why", json!({"capture": "damaged.log", "node": "can7:5"})),
        wrong("objects", json!({"capture": "damaged.log", "node": "can7:5"})),
    ] {
        let error = client.tool(&tool, &arguments).unwrap_err();
        let expected = ["rule: unknown rule", "node 99: not in", "node can7:5: not in"];
        assert!(expected.iter().any(|start| error.contains(start)), "{tool} {arguments}: {error}");
    }
    std::fs::remove_file(inner.join("damaged.log")).unwrap();
    let files = client.ask("captures", &json!({}));
    assert_eq!(files["files"].as_array().unwrap().len(), 1);
    client.end();
}

#[test]
fn the_list_of_tools_is_complete() {
    let mut client = Client::start(&fixtures());
    let tools = client.request("tools/list", &json!({}))["result"]["tools"].clone();
    let names: Vec<_> = tools.as_array().unwrap().iter().map(|tool| tool["name"].as_str().unwrap()).collect();
    let expected =
        ["captures", "summary", "why", "findings", "events", "objects", "signals", "explain", "diff"];
    assert_eq!(names, expected);
    for tool in tools.as_array().unwrap() {
        assert_eq!(tool["annotations"]["readOnlyHint"], true);
    }
    assert!(client.tool("explain", &json!({"thing": "06090030"})).unwrap().contains("0609"));
    client.end();
}

proptest! {
    #![proptest_config(ProptestConfig { cases: 8, ..ProptestConfig::default() })]

    /// Whatever lines arrive, the server answers the next request.
    #[test]
    fn any_line_leaves_the_server_alive(lines in prop::collection::vec(line(), 1..40)) {
        let mut client = Client::start(&fixtures());
        for line in &lines {
            client.send(line.as_bytes());
        }
        client.send(br#"{"jsonrpc":"2.0","id":"end","method":"ping"}"#);
        while client.receive()["id"] != "end" {}
        client.end();
    }
}

/// Text, JSON, and calls with arguments of any type.
fn line() -> impl Strategy<Value = String> {
    let argument = prop_oneof![
        any::<u64>().prop_map(|number| json!(number)),
        "[ -~]{0,20}".prop_map(|text| json!(text)),
        Just(json!("devices/pve.log")),
        Just(json!("#3")),
        Just(json!(["32=danfoss-pve-ci"])),
        Just(Value::Null),
    ];
    let names = prop::sample::select(vec![
        "capture", "filter", "from", "to", "node", "after", "signal", "nodes", "limit", "at", "story",
        "thing",
    ]);
    let tools = prop::sample::select(vec![
        "summary", "why", "findings", "events", "objects", "signals", "explain", "diff",
    ]);
    let arguments = prop::collection::btree_map(names, argument, 0..5);
    let call = (tools, arguments).prop_map(|(tool, arguments)| {
        let arguments: serde_json::Map<String, Value> =
            arguments.into_iter().map(|(name, value)| (name.to_owned(), value)).collect();
        json!({"jsonrpc": "2.0", "id": 1, "method": "tools/call", "params": {"name": tool, "arguments": arguments}}).to_string()
    });
    prop_oneof!["[^\n]{0,60}", call]
}
