//! The library of the page `cobscope.html` gives what the program prints, for every capture of this
//! repository and of the corpus.

use std::fs;
use std::path::{Path, PathBuf};
use std::sync::Arc;

use cobscope_web::WorkerState;
use cobscope_web::files::MemoryFiles;
use serde_json::{Value, json};

use crate::cli::run;
use crate::support::{corpus, is_readable, skip, step, workspace};

/// Lines of events compared per capture.
const COMPARED: usize = 200;

/// Frames per step.
const STEP: u64 = 1_000;

fn call(session: &mut WorkerState, request: &Value) -> (Value, Vec<u8>) {
    let response = session.call_json(request.to_string().as_bytes());
    (response.value, response.bytes)
}

/// Works until nothing is pending; returns the last response, and the exported bytes.
fn finish(session: &mut WorkerState) -> (Value, Vec<u8>) {
    let mut bytes = Vec::new();
    loop {
        let (value, _) = call(session, &json!({"do": "step", "frames": STEP}));
        let (_, more) = call(session, &json!({"do": "bytes", "what": "export"}));
        bytes.extend(more);
        let phase = value.get("phase").and_then(Value::as_str).unwrap_or("error");
        if ["ready", "done", "idle", "error"].contains(&phase) {
            return (value, bytes);
        }
    }
}

/// A session with files in memory; the error if they cannot be opened.
fn open(files: &[(&str, &[u8])]) -> Result<WorkerState, String> {
    let (beside, captures): (Vec<_>, Vec<_>) =
        (0..).zip(files).partition(|(_, (name, _))| Path::new(name).extension() == Some("toml".as_ref()));
    let list = |files: Vec<(u32, &(&str, &[u8]))>| {
        let one = |(file, (name, bytes)): (u32, &(&str, &[u8]))| json!({"file": file, "name": name, "size": bytes.len()});
        files.into_iter().map(one).collect::<Vec<_>>()
    };
    let request = json!({"do": "open", "captures": list(captures), "beside": list(beside)});
    let memory = MemoryFiles(files.iter().map(|(_, bytes)| bytes.to_vec()).collect());
    let mut session = WorkerState::new(Arc::new(memory));
    let error = |value: &Value| value.get("error")?.as_str().map(str::to_owned);
    if let Some(error) = error(&call(&mut session, &request).0) {
        return Err(error);
    }
    let (value, _) = finish(&mut session);
    error(&value).map_or(Ok(session), Err)
}

fn overview(session: &mut WorkerState) -> Value {
    call(session, &json!({"do": "overview"})).0
}

/// Findings without what depends on the name of the file or its lines.
fn plain(mut finding: Value) -> Value {
    if let Some(members) = finding.as_object_mut() {
        members.remove("capture");
        for key in ["occurrences", "worst"] {
            let list = members.get_mut(key).map(Value::take).unwrap_or_default();
            let list = if list.is_array() { list } else { json!([list]) };
            let mut all: Vec<Value> = list.as_array().cloned().unwrap_or_default();
            all.iter_mut().filter_map(Value::as_object_mut).for_each(|one| {
                one.remove("line");
            });
            members.insert(key.to_owned(), Value::Array(all));
        }
    }
    finding
}

fn lines(text: &str) -> Vec<Value> {
    text.lines().map(|line| serde_json::from_str(line).unwrap()).collect()
}

/// Compares one capture; returns the differences.
fn compare(path: &Path) -> Vec<String> {
    let shown = path.display().to_string();
    let bytes = fs::read(path).unwrap();
    let decoded = run(&["decode", "-f", "jsonl", "--frames", &shown], "");
    let mut session = match open(&[(&shown, &bytes)]) {
        Ok(session) => session,
        Err(error) => {
            let is_refused = decoded.stderr.contains(&error) && decoded.code != 0;
            return if is_refused { Vec::new() } else { vec![format!("{shown}: refused: {error}")] };
        }
    };
    let mut differences = Vec::new();
    let overview = overview(&mut session);
    call(&mut session, &json!({"do": "export", "format": "jsonl", "list": "all"}));
    let (_, exported) = finish(&mut session);
    let exported = String::from_utf8(exported).unwrap();
    let pairs = exported.lines().zip(decoded.stdout.lines()).take(COMPARED);
    if let Some((own, other)) = pairs.into_iter().find(|(own, other)| own != other) {
        differences.push(format!("{shown}: event\n  page    {own}\n  program {other}"));
    }
    let counts = (exported.lines().count(), decoded.stdout.lines().count());
    if counts.0 != counts.1 {
        differences.push(format!("{shown}: {counts:?} events of page and program"));
    }
    let checked = run(&["check", "-f", "jsonl", &shown], "");
    let is_finding = |value: &Value| value.get("kind").is_some_and(|kind| kind == "finding");
    let expected: Vec<_> = lines(&checked.stdout).into_iter().filter(is_finding).map(plain).collect();
    let own = overview.get("findings").and_then(Value::as_array).cloned().unwrap_or_default();
    let own: Vec<_> = own.into_iter().filter(is_finding).map(plain).collect();
    if own != expected {
        differences.push(format!("{shown}: findings\n  page    {own:?}\n  program {expected:?}"));
    }
    let why = run(&["why", "-f", "json", &shown], "");
    let why: Value = serde_json::from_str(&why.stdout).unwrap();
    let statistics = run(&["stats", "-f", "json", &shown], "");
    let statistics: Value = serde_json::from_str(&statistics.stdout).unwrap();
    for (key, expected) in [("why", why), ("statistics", statistics)] {
        let own = overview.get(key).unwrap_or(&Value::Null);
        // The page has no folders in the name of a capture.
        for (member, expected) in expected.as_object().unwrap().iter().filter(|(key, _)| *key != "capture") {
            let own = own.get(member);
            if own != Some(expected) {
                differences.push(format!("{shown}: {key}.{member}\n  page    {own:?}\n  program {expected}"));
            }
        }
    }
    differences
}

fn files(folder: &Path, found: &mut Vec<PathBuf>) {
    let Ok(entries) = fs::read_dir(folder) else { return };
    for path in entries.flatten().map(|entry| entry.path()) {
        if path.is_dir() {
            files(&path, found);
        } else if is_capture(&path) {
            found.push(path);
        }
    }
}

fn is_capture(path: &Path) -> bool {
    let name = path.display().to_string().to_lowercase();
    let suffixes =
        [".log", ".asc", ".trc", ".blf", ".mf4", ".pcap", ".pcapng", ".crtd", ".csv", ".mcap", ".gz"];
    suffixes.iter().any(|suffix| name.ends_with(suffix)) && is_readable(&name)
}

fn compare_all(folder: &Path) {
    let mut all = Vec::new();
    files(folder, &mut all);
    all.sort();
    assert!(!all.is_empty());
    let differences: Vec<_> = all.iter().step_by(step(5)).flat_map(|path| compare(path)).collect();
    assert!(differences.is_empty(), "{} of {}\n{}", differences.len(), all.len(), differences.join("\n"));
}

#[test]
fn fixtures_give_what_the_program_prints() {
    compare_all(&workspace().join("fixtures"));
}

#[test]
fn the_corpus_gives_what_the_program_prints() {
    let corpus = corpus();
    if corpus.is_dir() {
        compare_all(&corpus);
    } else {
        skip("corpus", "no folder of captures");
    }
}

/// Node 5 sends heartbeats every 500 ms, twice, then nothing.
fn lost() -> Vec<u8> {
    fs::read(workspace().join("fixtures/canopen/heartbeat_lost.log")).unwrap()
}

#[test]
fn rows_are_decoded_when_they_are_shown() {
    let capture: Vec<u8> = (0..5_000_u32)
        .flat_map(|n| {
            format!("({}.{:03}) can0 705#{:02X}\n", 100 + n / 1_000, n % 1_000, 4 + n % 2).into_bytes()
        })
        .collect();
    let mut session = open(&[("a.log", &capture)]).unwrap();
    let total = overview(&mut session)["events"].as_u64().unwrap();
    let all = |session: &mut WorkerState, from: u64, count: u64| {
        let request = json!({"do": "rows", "list": "all", "from": from, "count": count});
        call(session, &request).0["rows"].as_array().cloned().unwrap()
    };
    // Each frame is a heartbeat with another state: two events per frame but the first.
    let rows = all(&mut session, total - 3, 10);
    assert_eq!(rows.len(), 3);
    assert_eq!(rows[2]["frame"], 5_000);
    let middle = all(&mut session, 4_000, 2);
    let again = all(&mut session, 3_990, 12);
    assert_eq!(again[10], middle[0]);
    assert_eq!(again[11], middle[1]);
    let found = call(&mut session, &json!({"do": "locate", "list": "all", "at": {"time": 2.5}})).0;
    // 2.5 s after the first frame is frame 2,501.
    assert_eq!(found["frame"], 2_501);
    let row = all(&mut session, found["row"].as_u64().unwrap(), 1);
    assert_eq!(row[0]["frame"], 2_501);
}

#[test]
fn a_filter_selects_rows_and_errors_have_their_place() {
    let mut session = open(&[("a.log", &lost())]).unwrap();
    let wrong = call(&mut session, &json!({"do": "filter", "text": "kind = emcy", "only_news": false})).0;
    assert!(wrong["invalid"]["reason"].is_string(), "{wrong}");
    call(&mut session, &json!({"do": "filter", "text": "kind == node-lost", "only_news": false}));
    // Lost after 1.000 s and after 4.900 s.
    assert_eq!(finish(&mut session).0["total"], 2);
    let rows = call(&mut session, &json!({"do": "rows", "list": "filter", "from": 0, "count": 9})).0;
    assert_eq!(rows["rows"][0]["kind"], "LOST");
}

#[test]
fn a_report_has_the_finding_and_a_cut_out_capture() {
    let mut session = open(&[("<img src=x>.log", &lost())]).unwrap();
    let finding = overview(&mut session)["why"]["stories"][0]["findings"][0].clone();
    call(&mut session, &json!({"do": "report", "finding": finding, "page": "cobscope.html"}));
    let (done, _) = finish(&mut session);
    assert!(done["cut"].as_u64().unwrap() > 0, "{done}");
    let (_, page) = call(&mut session, &json!({"do": "bytes", "what": "report"}));
    let page = String::from_utf8(page).unwrap();
    assert!(page.contains("&lt;img src=x&gt;.log") && !page.contains("<img"));
    assert!(page.contains(&sha256(&lost())), "hash of the capture");
    let (_, cut) = call(&mut session, &json!({"do": "bytes", "what": "cut"}));
    let mut again = open(&[("cut.pcapng", &cut)]).unwrap();
    assert!(overview(&mut again)["frames"].as_u64().unwrap() > 0);
}

fn sha256(bytes: &[u8]) -> String {
    use sha2::Digest as _;
    use std::fmt::Write as _;
    let mut text = String::new();
    sha2::Sha256::digest(bytes).iter().for_each(|byte| write!(text, "{byte:02x}").unwrap());
    text
}

#[test]
fn errors_name_the_file_and_the_remedy() {
    let error = |files: &[(&str, &[u8])]| open(files).err().unwrap_or_default();
    assert!(error(&[("a.txt", b"no capture at all\n")]).starts_with("a.txt: "));
    assert!(error(&[("a.log", b"")]).starts_with("a.log: "));
    let mixed: &[(&str, &[u8])] =
        &[("a.log", b"(1.000000) can0 101#00\n"), ("b.log", b"(1700000000.000000) can0 101#00\n")];
    assert!(error(mixed).contains("no common time axis"), "{}", error(mixed));
    let lost = lost();
    let bus_file: &[(&str, &[u8])] = &[("a.log", &lost), ("m.toml", b"nodes = 1\n")];
    assert!(error(bus_file).starts_with("m.toml:1:1: "), "{}", error(bus_file));
    assert_eq!(
        call(&mut open(&[("a.log", &lost)]).unwrap(), &json!({"do": "nothing"})).0.as_object().unwrap().len(),
        1
    );
}

/// Position that a search found.
fn sought(session: &mut WorkerState, text: &str, from: u64, backward: bool) -> Value {
    let from = json!({"frame": from, "ordinal": 0});
    let request = json!({"do": "search", "text": text, "list": "all", "from": from, "backward": backward});
    call(session, &request);
    finish(session).0.get("place").cloned().unwrap_or_default()
}

#[test]
fn a_search_finds_rows_in_both_directions_across_checkpoints() {
    // Emergencies in frames 5 and 139,990 among heartbeats; checkpoints are 65,536 frames apart.
    let capture: Vec<u8> = (1..=140_000_u32)
        .flat_map(|n| {
            let frame = match n {
                5 => "085#1082010000000000",
                139_990 => "085#0000000000000000",
                _ => "705#05",
            };
            format!("({}.{:03}) can0 {frame}\n", 100 + n / 1_000, n % 1_000).into_bytes()
        })
        .collect();
    let mut session = open(&[("a.log", &capture)]).unwrap();
    assert_eq!(sought(&mut session, "emcy", 1, false), json!({"frame": 5, "ordinal": 0}));
    assert_eq!(sought(&mut session, "emcy", 5, false), json!({"frame": 139_990, "ordinal": 0}));
    assert_eq!(sought(&mut session, "emcy", 139_990, false), Value::Null);
    assert_eq!(sought(&mut session, "emcy", 140_000, true), json!({"frame": 139_990, "ordinal": 0}));
    assert_eq!(sought(&mut session, "8210", 140_000, true), json!({"frame": 5, "ordinal": 0}));
    assert_eq!(sought(&mut session, "emcy", 5, true), Value::Null);
    let request = json!({"do": "search", "text": "[", "list": "all", "from": {"frame": 1, "ordinal": 0}, "backward": false});
    assert!(call(&mut session, &request).0["invalid"]["reason"].is_string());
    // The error register of frame 139,990 is clear: the only error event is in frame 5.
    let error = |session: &mut WorkerState, frame: u64, backward: bool| {
        let from = json!({"frame": frame, "ordinal": 0});
        call(session, &json!({"do": "error", "from": from, "backward": backward})).0
    };
    assert_eq!(error(&mut session, 1, false)["frame"], 5);
    assert_eq!(error(&mut session, 5, false), Value::Null);
    assert_eq!(error(&mut session, 140_000, true)["frame"], 5);
}

#[test]
fn selected_frames_are_written_as_capture_and_as_events() {
    let mut session = open(&[("lost.log", &lost())]).unwrap();
    let mut written = |format: &str, frames: Value| {
        call(&mut session, &json!({"do": "export", "format": format, "list": "all", "frames": frames}));
        finish(&mut session).1
    };
    let cut = written("pcapng", json!([2, 3]));
    let whole = written("pcapng", Value::Null);
    let events = String::from_utf8(written("jsonl", json!([2, 2]))).unwrap();
    let frames = |bytes: &[u8]| {
        let mut session = open(&[("cut.pcapng", bytes)]).unwrap();
        overview(&mut session)["frames"].clone()
    };
    assert_eq!(frames(&cut), 2);
    let all =
        open(&[("lost.log", &lost())]).map(|mut session| overview(&mut session)["frames"].clone()).unwrap();
    assert_eq!(frames(&whole), all);
    let seen: Vec<_> = lines(&events).iter().map(|event| event["frames"][1].clone()).collect();
    assert!(!seen.is_empty() && seen.iter().all(|frame| frame == 2), "{seen:?}");
}

#[test]
fn parts_of_a_series_are_one_capture() {
    // Heartbeats of node 5 every 500 ms; the second file continues the first one.
    let beats = |seconds: std::ops::Range<u32>| -> Vec<u8> {
        seconds
            .flat_map(|n| {
                format!("({}.000) can0 705#05\n({}.500) can0 705#05\n", 100 + n, 100 + n).into_bytes()
            })
            .collect()
    };
    let mut session = open(&[("run-0002.log", &beats(20..40)), ("run.log", &beats(0..20))]).unwrap();
    let overview = overview(&mut session);
    assert_eq!(overview["frames"], 80);
    assert_eq!(overview["buses"].as_array().map(Vec::len), Some(1));
    assert_eq!((&overview["errors"], &overview["warnings"]), (&json!(0), &json!(0)));
    let row = call(&mut session, &json!({"do": "rows", "list": "all", "from": 0, "count": 1})).0;
    assert_eq!(row["rows"][0]["frame"], 1);
    // A part with comments only is left out; a gap above the limit is named, without an option of the command line.
    let parts = [
        ("run.log", beats(0..20)),
        ("run-0002.log", b"# paused\n".to_vec()),
        ("run-0003.log", beats(21..40)),
    ];
    let mut session = open(&parts.each_ref().map(|(name, content)| (*name, content.as_slice()))).unwrap();
    assert_eq!(crate::page::overview(&mut session)["frames"], 78);
    let mut apart = open(&[("run.log", &beats(0..20)), ("run-0002.log", &beats(30..50))]).unwrap();
    let notes = crate::page::overview(&mut apart)["problems"].clone();
    let text = "run-0002.log: not joined to run.log: starts 10.500 s after its last frame; parts of a capture follow within 5.000 s";
    assert!(notes.as_array().unwrap().contains(&json!(text)), "{notes}");
    // Other files at the same time are merged: two buses of the same name.
    let other = open(&[("front.log", &beats(0..20)), ("rear.log", &beats(0..20))]);
    let merged = other.map(|mut session| crate::page::overview(&mut session)).unwrap();
    assert_eq!(merged["buses"].as_array().map(Vec::len), Some(2));
}
