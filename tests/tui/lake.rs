//! Tables of many captures: `lake add`.

#![expect(clippy::indexing_slicing, reason = "a test that cannot continue has failed")]

use std::collections::{BTreeMap, BTreeSet};
use std::fmt::Write as _;
use std::fs::{self, File};
use std::path::{Path, PathBuf};
use std::process::Command;

use parquet::file::reader::{FileReader as _, SerializedFileReader};
use parquet::record::Field;
use serde_json::Value;
use sha2::{Digest as _, Sha256};

use crate::check::folder;
use crate::cli::{Output, run, run_in};
use crate::support::{python, skip, workspace};

/// A row by column name; null values are left out.
type Row = BTreeMap<String, String>;

/// SYNC every 100 ms for 4 s; node 5 is silent after its heartbeats in the first second. Midnight is 1700006400.
fn lost() -> String {
    let mut text = String::new();
    for tenth in 0..=40 {
        let time = format!("{}.{}00000", 1_700_006_398 + tenth / 10, tenth % 10);
        writeln!(text, "({time}) can0 080#").unwrap();
        if tenth % 2 == 0 && tenth < 10 {
            writeln!(text, "({time}) can0 705#05").unwrap();
        }
    }
    text
}

/// An empty folder with files.
fn with_files(name: &str, files: &[(&str, &str)]) -> PathBuf {
    let path = folder(&format!("lake-{name}"));
    for (file, text) in files {
        let file = path.join(file);
        fs::create_dir_all(file.parent().unwrap()).unwrap();
        fs::write(file, text).unwrap();
    }
    path
}

fn add(path: &Path, arguments: &[&str]) -> Output {
    run_in(path, &[&["lake", "add", "lake"], arguments].concat(), "")
}

/// Files below a folder, relative, with `/` between folders; without those that each lake has for its tables.
fn files(folder: &Path) -> BTreeSet<String> {
    let mut found = BTreeSet::new();
    let mut folders = vec![folder.to_owned()];
    while let Some(next) = folders.pop() {
        for entry in fs::read_dir(next).into_iter().flatten().flatten() {
            if entry.path().is_dir() {
                folders.push(entry.path());
            } else {
                let path = entry.path();
                if entry.file_name() == "empty.parquet" {
                    continue;
                }
                found.insert(path.strip_prefix(folder).unwrap().to_str().unwrap().replace('\\', "/"));
            }
        }
    }
    found
}

/// Tables of a lake without their file names: `events/machine=unknown/day=2023-11-14`.
fn partitions(lake: &Path) -> Vec<String> {
    let tables = files(lake).into_iter().filter(|file| !file.starts_with('_'));
    tables.map(|file| file.rsplit_once('/').unwrap().0.to_owned()).collect()
}

/// All rows of a table.
fn rows(lake: &Path, table: &str) -> Vec<Row> {
    let folder = lake.join(table);
    let mut all = Vec::new();
    for file in files(&folder) {
        let reader = SerializedFileReader::new(File::open(folder.join(&file)).unwrap()).unwrap();
        for row in reader.get_row_iter(None).unwrap() {
            let cells = row.unwrap().into_columns();
            let text = |field: &Field| match field {
                Field::Str(text) => text.clone(),
                other => other.to_string(),
            };
            let known = cells.iter().filter(|(_, field)| !matches!(field, Field::Null));
            all.push(known.map(|(name, field)| (name.clone(), text(field))).collect());
        }
    }
    all
}

/// Findings as `check` prints them, and as the lake contains them.
fn compare_findings(path: &Path, arguments: &[&str]) -> usize {
    let check = run_in(path, &[&["check", "-f", "jsonl"], arguments].concat(), "");
    let is_finding = |line: &&str| line.starts_with("{\"kind\":\"finding\"");
    let mut expected: Vec<String> = check.stdout.lines().filter(is_finding).map(str::to_owned).collect();
    let output = add(path, arguments);
    assert!(output.code == 0 || output.code == 3, "{}", output.stderr);
    let lake = path.join("lake");
    let found_rows = rows(&lake, "findings");
    let mut found: Vec<String> = found_rows.iter().map(|row| row["json"].clone()).collect();
    expected.sort();
    found.sort();
    assert_eq!(found, expected, "{arguments:?}");
    // The other columns state the same.
    for row in &found_rows {
        let json: Value = serde_json::from_str(&row["json"]).unwrap();
        for (column, key) in
            [("rule", "rule"), ("severity", "severity"), ("standing", "standing"), ("text", "text")]
        {
            assert_eq!(json[key], row[column], "{column}");
        }
        for (column, key) in [("finding", "finding"), ("count", "count")] {
            assert_eq!(json[key].to_string(), row[column], "{column}");
        }
    }
    found.len()
}

#[test]
fn findings_are_those_of_check() {
    let workspace = workspace();
    let path = |name: &str| workspace.join("fixtures").join(name).to_str().unwrap().to_owned();
    let (machine, bus) = (path("machine/machine.log"), path("machine/machine.bus.toml"));
    assert!(compare_findings(&with_files("machine", &[]), &["--bus", &bus, &machine]) >= 3);
    assert!(compare_findings(&with_files("stories", &[]), &[&path("stories")]) >= 30);
    assert!(
        compare_findings(
            &with_files("sydfec", &[]),
            &["--node", "2=rexroth-sydfec", &path("devices/sydfec.log")]
        ) >= 1
    );
    let text = lost();
    // Parts of a series: findings have the lines of their parts.
    let (first, second) = text.split_at(text.find("(1700006398.4").unwrap());
    let series = with_files("series", &[("run.log", first), ("run-0002.log", second)]);
    assert_eq!(compare_findings(&series, &["run.log", "run-0002.log"]), 1);
}

/// SHA-256 of a text in hexadecimal.
fn sha256(text: &str) -> String {
    let mut hash = String::new();
    for byte in Sha256::digest(text) {
        write!(hash, "{byte:02x}").unwrap();
    }
    hash
}

/// The deadline of the heartbeat passes before midnight, and the finding closes at the end.
#[test]
fn rows_are_in_the_partition_of_their_day() {
    let path = with_files("days", &[("run.log", lost().as_str())]);
    let output = add(&path, &["--frames", "--all-events", "run.log"]);
    assert_eq!((output.code, output.stdout.as_str()), (0, "lake: 1 capture added\n"), "{}", output.stderr);
    let lake = path.join("lake");
    let expected = ["captures 14", "events 14", "events 15", "findings 14", "frames 14", "frames 15"];
    let expected: Vec<_> = expected.map(|text| text.split_once(' ').unwrap()).to_vec();
    let expected: Vec<_> =
        expected.iter().map(|(table, day)| format!("{table}/machine=unknown/day=2023-11-{day}")).collect();
    assert_eq!(partitions(&lake), expected);
    let hash = sha256(&lost());
    let frames = rows(&lake, "frames");
    // 41 SYNC and 5 heartbeats.
    assert_eq!(frames.len(), 46);
    assert!(frames.iter().all(|row| row["capture"] == "run.log" && row["capture_hash"] == hash));
    assert_eq!((frames[1]["id"].as_str(), frames[1]["data"].as_str()), ("1797", "05"));
    let captures = rows(&lake, "captures");
    let [capture] = captures.as_slice() else { panic!("{captures:?}") };
    let expected = [
        ("capture", "run.log"),
        ("capture_hash", hash.as_str()),
        ("frames", "46"),
        ("parts", "1"),
        ("size", &lost().len().to_string()),
        ("duration", "4.0"),
        ("buses", "can0"),
        ("verdict", "fail"),
        ("errors", "1"),
        ("stories", "1"),
        ("time_ns", "1700006398000000000"),
        ("cobscope", env!("CARGO_PKG_VERSION")),
    ];
    for (column, value) in expected {
        assert_eq!(capture[column], value, "{column}");
    }
    let names = files(&lake).into_iter().filter(|file| file.starts_with("captures/"));
    assert_eq!(
        names.collect::<Vec<_>>(),
        [format!("captures/machine=unknown/day=2023-11-14/{}.parquet", &hash[..32])]
    );
}

#[test]
fn a_capture_without_a_date_has_no_day_unless_one_is_given() {
    let text = "(0.0) can0 705#05\n(1.0) can0 705#05\n";
    let path = with_files(
        "undated",
        &[("a.log", text), ("b.log", "(0.0) can0 706#05\n"), ("c.log", "can0 707#05\n")],
    );
    assert_eq!(add(&path, &["a.log"]).code, 0);
    assert_eq!(add(&path, &["--day", "2024-02-29", "b.log", "c.log"]).code, 0);
    let lake = path.join("lake");
    let all: BTreeSet<_> = partitions(&lake).into_iter().collect();
    let expected = ["captures 2024-02-29", "captures unknown", "events 2024-02-29", "events unknown"];
    let expected = expected.map(|text| text.replace(' ', "/machine=unknown/day=")).into_iter().collect();
    assert_eq!(all, expected);
    let captures = rows(&lake, "captures");
    // A time of 1970 would be wrong; the offset from the start is known.
    assert!(captures.iter().all(|row| !row.contains_key("time")), "{captures:?}");
    let starts: BTreeMap<_, _> = captures
        .iter()
        .map(|row| (row["capture"].as_str(), row.get("time_ns").map(String::as_str)))
        .collect();
    assert_eq!(starts, BTreeMap::from([("a.log", Some("0")), ("b.log", Some("0")), ("c.log", None)]));
}

#[test]
fn the_same_content_is_added_once() {
    let path = with_files("again", &[("a.log", lost().as_str()), ("copy.log", lost().as_str())]);
    assert_eq!(add(&path, &["a.log"]).code, 0);
    let lake = path.join("lake");
    let before = files(&lake);
    let output = add(&path, &["a.log"]);
    assert_eq!(output.code, 0);
    assert_eq!(output.stderr, "cobscope: a.log: already in the lake; --replace adds it again\n");
    assert_eq!(output.stdout, "lake: 0 captures added, 1 already in the lake\n");
    let output = add(&path, &["--machine", "other", "copy.log"]);
    assert_eq!(
        output.stderr,
        "cobscope: copy.log: already in the lake as a.log of machine unknown; --replace adds it again\n"
    );
    assert_eq!(files(&lake), before);
    // In one run, on two threads.
    let both = with_files("twice", &[("a.log", lost().as_str()), ("copy.log", lost().as_str())]);
    let output = add(&both, &["--threads", "2", "a.log", "copy.log"]);
    assert_eq!(output.stdout, "lake: 1 capture added, 1 already in the lake\n", "{}", output.stderr);
    assert_eq!(partitions(&both.join("lake")), partitions(&lake));
}

#[test]
fn a_replaced_capture_leaves_nothing_behind() {
    let path = with_files("replace", &[("a.log", lost().as_str())]);
    assert_eq!(add(&path, &["--frames", "--machine", "one", "a.log"]).code, 0);
    let output = add(&path, &["--replace", "--machine", "two", "a.log"]);
    assert_eq!((output.code, output.stdout.as_str()), (0, "lake: 1 capture added\n"));
    let all = partitions(&path.join("lake"));
    assert_eq!(all.len(), 3, "{all:?}");
    assert!(all.iter().all(|place| place.contains("machine=two/")), "{all:?}");
}

#[test]
fn interrupted_runs_are_completed_or_discarded() {
    let path = with_files("whole", &[("a.log", lost().as_str()), ("b.log", "(1700000000.0) can0 706#05\n")]);
    assert_eq!(add(&path, &["a.log"]).code, 0);
    let (lake, hash) = (path.join("lake"), sha256(&lost()));
    let expected = files(&lake);
    let index = format!("_index/{}/{hash}.json", &hash[..2]);
    let tables: Vec<_> = expected.iter().filter(|file| !file.starts_with('_')).collect();
    let staging = lake.join("_staging").join(&hash);
    let stage = |file: &String| {
        let staged = staging.join(file);
        fs::create_dir_all(staged.parent().unwrap()).unwrap();
        fs::rename(lake.join(file), staged).unwrap();
    };
    // Killed while files were renamed: all were whole, one has its name already.
    fs::create_dir_all(&staging).unwrap();
    fs::copy(lake.join(&index), staging.join("commit.json")).unwrap();
    fs::remove_file(lake.join(&index)).unwrap();
    for file in tables.iter().skip(1) {
        stage(file);
    }
    assert_eq!(add(&path, &["b.log"]).code, 0);
    let is_of_a = |file: &String| file.contains(&hash[..32]);
    let of_a = |lake: &Path| files(lake).into_iter().filter(is_of_a).collect::<BTreeSet<_>>();
    assert_eq!(of_a(&lake), expected.iter().filter(|file| is_of_a(file)).cloned().collect());
    assert!(!staging.exists());
    let output = add(&path, &["a.log"]);
    assert_eq!(output.stdout, "lake: 0 captures added, 1 already in the lake\n");

    // Killed while the capture was read: no file is part of the lake.
    fs::remove_file(lake.join(&index)).unwrap();
    for file in &tables {
        stage(file);
    }
    fs::write(staging.join("half.parquet"), "PAR1").unwrap();
    assert_eq!(add(&path, &["b.log"]).code, 0);
    assert_eq!((of_a(&lake), staging.exists()), (BTreeSet::new(), false));
    assert_eq!(add(&path, &["a.log"]).stdout, "lake: 1 capture added\n");
    assert_eq!(of_a(&lake), expected.iter().filter(|file| is_of_a(file)).cloned().collect());
}

#[test]
fn an_index_with_foreign_paths_removes_nothing() {
    let path = with_files("foreign", &[("a.log", lost().as_str()), ("precious.parquet", "x")]);
    assert_eq!(add(&path, &["a.log"]).code, 0);
    let (lake, hash) = (path.join("lake"), sha256(&lost()));
    let index = lake.join(format!("_index/{}/{hash}.json", &hash[..2]));
    let text = fs::read_to_string(&index).unwrap();
    fs::write(&index, text.replacen("captures/", "../precious.parquet\",\"captures/", 1)).unwrap();
    assert_eq!(add(&path, &["--replace", "--machine", "two", "a.log"]).code, 0);
    assert_eq!(fs::read_to_string(path.join("precious.parquet")).unwrap(), "x");
}

#[test]
fn no_name_of_a_machine_leaves_the_lake() {
    let bus = "machine = '../../outside'\n";
    let path = with_files(
        "hostile",
        &[("in/a.log", lost().as_str()), ("bus.toml", bus), ("in/b.log", "(1700000000.0) can0 706#05\n")],
    );
    let inside = path.join("in");
    let output = run_in(&inside, &["lake", "add", "lake", "--bus", "../bus.toml", "a.log"], "");
    assert_eq!(output.code, 0, "{}", output.stderr);
    let all = partitions(&inside.join("lake"));
    assert!(all.iter().all(|place| place.contains("/machine=..%2F..%2Foutside/day=")), "{all:?}");
    let above: Vec<_> = files(&path).into_iter().filter(|file| !file.starts_with("in/lake/")).collect();
    assert_eq!(above, ["bus.toml", "in/a.log", "in/b.log"]);
    let output = run_in(&inside, &["lake", "add", "lake", "--machine", "", "b.log"], "");
    assert_eq!(output.code, 2);
    assert_eq!(output.stderr, "cobscope: name of the machine: empty; expected letters and digits\n");
}

#[test]
fn machines_are_named_by_option_path_or_bus_file() {
    let boot = |node: u8| format!("(1700000000.0) can0 7{node:02X}#00\n");
    let (one, two, three) = (boot(1), boot(2), boot(3));
    let path = with_files(
        "names",
        &[
            ("m/ex-1/a.log", one.as_str()),
            ("m/ex-2/a.log", two.as_str()),
            ("c.log", three.as_str()),
            ("bus.toml", "machine = 'crane'\n"),
        ],
    );
    assert_eq!(add(&path, &["--machine-from", "m/([^/]+)/", "m"]).code, 0);
    assert_eq!(add(&path, &["--bus", "bus.toml", "c.log"]).code, 0);
    let machines: BTreeSet<_> = partitions(&path.join("lake"))
        .iter()
        .map(|place| place.split('/').nth(1).unwrap().to_owned())
        .collect();
    assert_eq!(machines.into_iter().collect::<Vec<_>>(), ["machine=crane", "machine=ex-1", "machine=ex-2"]);
    let output = add(&path, &["--machine-from", "x/([^/]+)/", "c.log"]);
    assert_eq!((output.code, output.stdout.as_str()), (2, "lake: 0 captures added, 1 without a machine\n"));
    assert!(output.stderr.contains("c.log: no match of --machine-from x/([^/]+)/"), "{}", output.stderr);
}

#[test]
fn a_name_that_no_machine_can_have_is_refused_before_a_capture_is_read() {
    let path = with_files("refused", &[("a.log", lost().as_str()), ("bus.toml", "machine = 'a–b'\n")]);
    let output = add(&path, &["--bus", "bus.toml", "a.log"]);
    let expected = "cobscope: bus.toml: name of the machine: a–b; expected letters, digits and ASCII\n";
    assert_eq!((output.code, output.stderr.as_str()), (4, expected));
    assert!(!path.join("lake").exists());
    let output = add(&path, &[]);
    let expected = "cobscope: found no capture, expected files or folders after the lake\n";
    assert_eq!((output.code, output.stderr.as_str()), (2, expected));
}

#[test]
fn every_table_exists_before_its_first_row() {
    let path = with_files("empty", &[("a.log", "(1700000000.0) can0 705#00\n")]);
    let output = add(&path, &["a.log"]);
    assert!(output.stderr.contains(": 1 frame, "), "{}", output.stderr);
    let lake = path.join("lake");
    for table in ["captures", "findings", "objects", "events", "signals", "frames"] {
        let file = lake.join(table).join("machine=unknown/day=unknown/empty.parquet");
        let reader = SerializedFileReader::new(File::open(file).unwrap()).unwrap();
        let metadata = reader.metadata().file_metadata();
        assert_eq!(metadata.num_rows(), 0, "{table}");
        let columns = metadata.schema_descr().columns();
        assert_eq!(columns.last().unwrap().name(), "capture_hash", "{table}");
    }
    let Some(python) = python() else { return skip("python", "no Python for oracles") };
    let arguments = ["tests/oracles/lake_queries.py", lake.to_str().unwrap(), "docs/lake", "--only-run"];
    let run = Command::new(&python).current_dir(workspace()).args(arguments).output().unwrap();
    assert!(run.status.success(), "{}", String::from_utf8_lossy(&run.stderr));
}

#[test]
fn a_message_of_any_name_has_a_wide_table() {
    let bus = format!("CAN–{}", "x".repeat(200));
    let frames = format!("(1700000000.0) {bus} 705#05\n(1700000000.1) {bus} 182#08A01F0020\n");
    let path = with_files("wide-names", &[("a.log", frames.as_str())]);
    let output = add(&path, &["--wide", "--node", "2=rexroth-sydfec", "a.log"]);
    assert_eq!(output.code, 0, "{}", output.stderr);
    let folders: Vec<_> = files(&path.join("lake/wide")).into_iter().collect();
    assert_eq!(folders.len(), 1, "{folders:?}");
    assert!(folders[0].starts_with("unknown/CAN%E2%80%93xxx"), "{folders:?}");
}

#[test]
fn broken_captures_have_a_row_with_the_reason() {
    let path = with_files(
        "broken",
        &[("good.log", lost().as_str()), ("text.log", "this is no capture\n"), ("empty.log", "")],
    );
    // A pcap header that announces more bytes than there are.
    let header = [0xD4, 0xC3, 0xB2, 0xA1, 2, 0, 4, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0, 4, 0, 227, 0, 0, 0];
    let record = [
        0x00, 0x00, 0x53, 0x65, 0, 0, 0, 0, 16, 0, 0, 0, 16, 0, 0, 0, 0, 0, 7, 5, 1, 0, 0, 0, 5, 0, 0, 0, 0,
        0, 0, 0,
    ];
    fs::write(path.join("cut.pcap"), [&header[..], &record, &record[..20]].concat()).unwrap();
    let output = add(&path, &["good.log", "text.log", "empty.log", "cut.pcap"]);
    assert_eq!(output.code, 3);
    assert_eq!(output.stdout, "lake: 4 captures added, 3 unreadable or incomplete\n", "{}", output.stderr);
    let captures = rows(&path.join("lake"), "captures");
    let of = |name: &str| captures.iter().find(|row| row["capture"] == name).unwrap();
    assert!(!of("good.log").contains_key("failure"));
    assert_eq!((of("cut.pcap")["frames"].as_str(), of("cut.pcap")["verdict"].as_str()), ("1", "unreadable"));
    for name in ["text.log", "empty.log"] {
        assert_eq!((of(name)["frames"].as_str(), of(name)["verdict"].as_str()), ("0", "unreadable"));
        assert!(of(name)["failure"].contains(name), "{:?}", of(name));
    }
    // In a folder, a file that does not look like a capture is skipped.
    fs::write(path.join("notes.md"), "# Notes\n").unwrap();
    let output = run_in(&path, &["lake", "add", "other", "."], "");
    let expected = "other: 4 captures added, 3 unreadable or incomplete\n";
    assert_eq!((output.code, output.stdout.as_str()), (3, expected), "{}", output.stderr);
}

#[test]
fn only_a_lake_or_an_empty_folder_is_written() {
    let path = with_files("others", &[("a.log", lost().as_str()), ("data/notes.txt", "x")]);
    let output = run_in(&path, &["lake", "add", "data", "a.log"], "");
    assert_eq!(output.code, 2);
    let expected =
        "cobscope: data: folder with other files; expected a lake, an empty folder or a new name\n";
    assert_eq!(output.stderr, expected);
    let output = run(&["lake", "add", "never", "-"], "x");
    let expected = "cobscope: a lake needs a capture twice; stdin cannot be read again, give a file\n";
    assert_eq!((output.code, output.stderr.as_str()), (2, expected));
}

/// 5208:02 nominal pressure is read as 315 bar, written with 250 and 240 bar; a write of 500 bar is refused.
#[test]
fn objects_have_intervals() {
    let capture = "(1700000000.0) can0 602#4008520200000000\n(1700000000.1) can0 582#4B0852023B010000\n\
                   (1700000001.0) can0 602#22085202FA000000\n(1700000001.1) can0 582#6008520200000000\n\
                   (1700000002.0) can0 602#22085202F4010000\n(1700000002.1) can0 582#8008520231000906\n\
                   (1700000003.0) can0 602#22085202F0000000\n(1700000003.1) can0 582#6008520200000000\n";
    let path = with_files("objects", &[("a.log", capture)]);
    let output = add(&path, &["--node", "2=rexroth-sydfec", "a.log"]);
    assert_eq!(output.code, 0, "{}", output.stderr);
    let objects = rows(&path.join("lake"), "objects");
    let get = |row: &Row, key: &str| row.get(key).cloned().unwrap_or_default();
    let columns =
        ["time_ns", "until_ns", "frame", "until_frame", "object", "value", "text", "unit", "data", "origin"];
    let shown: BTreeSet<_> = objects.iter().map(|row| columns.map(|key| get(row, key)).join(",")).collect();
    let expected = [
        "1700000000100000000,1700000001100000000,2,4,5208:02,315.0,315 bar,bar,3B01,upload",
        "1700000001100000000,1700000003100000000,4,8,5208:02,250.0,250 bar,bar,FA00,download",
        "1700000003100000000,,8,,5208:02,240.0,240 bar,bar,F000,download",
    ];
    assert_eq!(shown, expected.map(str::to_owned).into());
}

#[test]
fn each_engine_reads_a_lake() {
    let Some(python) = python() else { return skip("python", "no Python for oracles") };
    let engines = "import datafusion, duckdb, pandas, polars, pyarrow";
    let has = Command::new(&python).args(["-c", engines]).output();
    if !has.is_ok_and(|output| output.status.success()) {
        return skip("python", "it lacks an engine that reads Parquet");
    }
    let path = with_files("engines", &[]);
    let fixture = |name: &str| workspace().join("fixtures").join(name).to_str().unwrap().to_owned();
    let machines = [
        ("ex/1 a", "devices/sydfec.log"),
        ("Süd", "stories/rexroth-sydfec"),
        ("ex-3", "machine/machine.log"),
    ];
    for (machine, capture) in machines {
        let arguments = ["--machine", machine, "--node", "2=rexroth-sydfec", &fixture(capture)];
        let output = add(&path, &arguments);
        assert_eq!(output.code, 0, "{}", output.stderr);
    }
    let script = workspace().join("tests/oracles/lake_engines.py");
    let lake = path.join("lake");
    let output = Command::new(&python).args([&script, &lake]).output().unwrap();
    assert!(output.status.success(), "{}", String::from_utf8_lossy(&output.stderr));
    assert!(String::from_utf8_lossy(&output.stdout).contains("5 engines"));
}

/// Faults of `fixtures/fleet/fleet.story`: press 3 loses its valve from day 7 to 11, the pump of press 7 restarts every fifth
/// day, firmware 1.53 refuses 350 bar, press 5 has another limit from day 12 on, the pump of press 12 loses 0.1 bar per day.
#[test]
fn queries_find_the_faults_of_the_fleet() {
    let Some(python) = python() else { return skip("python", "no Python for oracles") };
    let path = with_files("queries", &[]);
    let fleet = path.join("fleet");
    let script = |name: &str| workspace().join(name);
    let generator = script("fixtures/fleet/make_fleet.py");
    let arguments = ["--machines", "12", "--days", "14", "--seconds", "6", "--extras"];
    let made = Command::new(&python).arg(generator).arg(&fleet).args(arguments).output().unwrap();
    assert!(made.status.success(), "{}", String::from_utf8_lossy(&made.stderr));
    let output = add(&path, &["--bus", "fleet/press.bus.toml", "--machine-from", "(press-[0-9]+)/", "fleet"]);
    // 12 × 14 captures, and three broken files; two copies.
    let expected = "lake: 171 captures added, 2 already in the lake, 3 unreadable or incomplete\n";
    assert_eq!((output.code, output.stdout.as_str()), (3, expected), "{}", output.stderr);
    let lake = path.join("lake");
    assert_eq!(rows(&lake, "captures").iter().filter(|row| row["parts"] == "3").count(), 5);
    // Each seeded fault is found, in its capture only.
    let faults: Value = serde_json::from_slice(&fs::read(fleet.join("expected.json")).unwrap()).unwrap();
    let rules = ["node-lost", "unexpected-boot", "sdo-download-refused"];
    let findings = rows(&lake, "findings").into_iter().filter(|row| rules.contains(&row["rule"].as_str()));
    let found: BTreeSet<_> = findings.map(|row| (row["capture"].clone(), row["rule"].clone())).collect();
    let text = |fault: &Value, key: &str| fault[key].as_str().unwrap().to_owned();
    let seeded = faults.as_array().unwrap().iter();
    let seeded =
        seeded.map(|fault| (format!("fleet/{}", text(fault, "capture")), text(fault, "rule"))).collect();
    assert_eq!(found, seeded);
    let queries = script("tests/oracles/lake_queries.py");
    let mut run = Command::new(&python);
    run.args([&queries, &lake, &script("docs/lake")]);
    if std::env::var_os("COBSCOPE_BLESS").is_some() {
        run.arg("--write");
    }
    let output = run.output().unwrap();
    assert!(output.status.success(), "{}", String::from_utf8_lossy(&output.stderr));
}

#[test]
fn the_page_of_a_fleet_shows_machines_weeks_and_stories() {
    let path = with_files(
        "page",
        &[("a.log", lost().as_str()), ("b.log", "(0.0) can0 706#05\n"), ("empty.log", "")],
    );
    assert_eq!(add(&path, &["--machine", "<b>x", "a.log"]).code, 0);
    assert_eq!(add(&path, &["--machine", "press", "--day", "2024-01-03", "b.log"]).code, 0);
    assert_eq!(add(&path, &["--machine", "press", "empty.log"]).code, 3);
    let page = run_in(&path, &["report", "--lake", "lake"], "");
    assert_eq!(page.code, 0, "{}", page.stderr);
    let has = |text: &str| assert!(page.stdout.contains(text), "{text}: {}", page.stdout);
    // 2023-11-14 is a Tuesday, 2024-01-03 a Wednesday.
    has("<span>no date</span>");
    has("<span>2023-11-13</span>");
    has("<span>2024-01-01</span>");
    has("3 captures of 2 machines");
    has("<a href=\"#m1\">&lt;b&gt;x</a>");
    has("<td>node-lost</td>");
    has("empty.log: the capture is empty");
    assert!(!page.stdout.contains("<b>x"));
    let output = run_in(&path, &["report", "--lake", "."], "");
    assert_eq!(
        (output.code, output.stderr.as_str()),
        (2, "cobscope: .: not a lake; cobscope lake add creates one\n")
    );
}

/// Frame 23 of the fixture: 182#08A01F0020 at 1700000001.141, angle 49.417079 % and 157.509614 bar.
#[test]
fn values_side_by_side_have_a_table_per_message() {
    let path = with_files("wide", &[]);
    let capture = workspace().join("fixtures/devices/sydfec.log");
    let arguments = ["--wide", "--machine", "ex/7", "--node", "2=rexroth-sydfec", capture.to_str().unwrap()];
    let output = add(&path, &arguments);
    assert_eq!(output.code, 0, "{}", output.stderr);
    let wide = path.join("lake/wide");
    let folders: Vec<_> =
        files(&wide).into_iter().map(|file| file.rsplit_once('/').unwrap().0.to_owned()).collect();
    assert_eq!(folders, ["ex%2F7/can0_node_2_rpdo1/2023/11/14", "ex%2F7/can0_node_2_tpdo1/2023/11/14"]);
    let all = rows(&wide, "ex%2F7/can0_node_2_tpdo1");
    let columns: Vec<_> = all[0].keys().map(String::as_str).collect();
    assert_eq!(columns, ["Angle actual value", "Pressure actual value", "Status byte", "t"]);
    assert_eq!(all[0]["t"], "2023-11-14 22:13:21.141000 +00:00");
    let value = |name: &str| all[0][name].parse::<f64>().unwrap();
    assert!((value("Angle actual value") - 49.417_079).abs() < 1e-6, "{:?}", all[0]);
    assert!((value("Pressure actual value") - 157.509_614).abs() < 1e-6, "{:?}", all[0]);
    assert!((value("Status byte") - 8.0).abs() < 1e-6);
    // Replaced without: nothing stays.
    let output = add(&path, &[&["--replace"], &arguments[1..]].concat());
    assert_eq!((output.code, files(&wide).len()), (0, 0), "{}", output.stderr);
}
