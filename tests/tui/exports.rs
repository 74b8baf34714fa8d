//! Values and events for other programs: CSV (long and wide) and Parquet.

use std::collections::BTreeMap;
use std::fmt::Write as _;
use std::fs;
use std::path::{Path, PathBuf};

use cobscope_decoder::sink::EVENT_FORMATS;

use crate::cli::{Output, run};
use crate::screens::Screen;
use crate::support::workspace;

const SYDFEC: [&str; 3] = ["--node", "2=rexroth-sydfec", "fixtures/devices/sydfec.log"];
const PVE: [&str; 3] = ["--node", "sa:0x80=danfoss-pve-ci", "fixtures/devices/pve_j1939.log"];

fn ok(arguments: &[&str], input: &str) -> Output {
    let output = run(arguments, input);
    assert_eq!(output.code, 0, "{arguments:?}: {}", output.stderr);
    output
}

/// A fresh folder of a test.
fn folder(name: &str) -> PathBuf {
    let path = PathBuf::from(env!("CARGO_TARGET_TMPDIR")).join("exports").join(name);
    let _ = fs::remove_dir_all(&path);
    fs::create_dir_all(&path).unwrap();
    path
}

/// Lines of CSV by RFC 4180; no cell contains a line end.
fn table(text: &str) -> Vec<Vec<String>> {
    let cells = |line: &str| {
        let mut cells = vec![String::new()];
        let mut quoted = false;
        for letter in line.chars() {
            match letter {
                '"' => quoted = !quoted,
                ',' if !quoted => cells.push(String::new()),
                _ => cells.last_mut().unwrap().push(letter),
            }
        }
        cells
    };
    text.split_terminator("\r\n").map(cells).collect()
}

/// Frames 23, 26 and 28: 182#08A01F0020, 202#08FF1F0020, 182#08A01FF91F, the last one 182#0000000000. 16383
/// is 100 % of the angle, and 315 bar until 250 is written: 8096 and 8191 of 16383 are 49.417079 % and
/// 49.996948 %; 8192 of 16383 is 157.509614 of 315 bar and 125.00763 of 250 bar, 8185 is 124.900812 bar.
#[test]
fn a_row_an_event_a_column_a_signal() {
    let text = ok(&[&["decode", "-f", "csv-wide"][..], &SYDFEC].concat(), "").stdout;
    let lines: Vec<&str> = text.split_terminator("\r\n").collect();
    let expected = [
        "time,bus,frame,node/2/tpdo1 Status byte,node/2/tpdo1 Angle actual value [%],\
         node/2/tpdo1 Pressure actual value [bar],node/2/rpdo1 Control byte,node/2/rpdo1 Angle set point [%],\
         node/2/rpdo1 Pressure set point [bar]",
        "1700000001.141000000,can0,23,8,49.417079,157.509614,,,",
        "1700000002.130000000,can0,26,,,,8,49.996948,125.00763",
        "1700000002.141000000,can0,28,8,49.417079,124.900812,,,",
    ];
    assert_eq!(lines[..4], expected);
    assert!(lines.last().unwrap().ends_with(",0,0,0,,,"), "{lines:?}");
}

#[test]
fn long_and_wide_hold_the_same_values() {
    for capture in [SYDFEC, PVE] {
        let of = |format| table(&ok(&[&["decode", "-f", format][..], &capture].concat(), "").stdout);
        let mut long = BTreeMap::new();
        for row in &of("csv")[1..] {
            let [time, bus, frame, _, _, group, signal, _, value, unit, _, _] = &row[..] else {
                panic!("{row:?}")
            };
            // Transferred values have no column in the wide table.
            if group.contains("/sdo-") || group.contains("/uds-") {
                continue;
            }
            let unit = if unit.is_empty() { String::new() } else { format!(" [{unit}]") };
            let key = (time.clone(), bus.clone(), frame.clone(), format!("{group} {signal}{unit}"));
            if !value.is_empty() {
                assert!(long.insert(key, value.clone()).is_none(), "{row:?}");
            }
        }
        let rows = of("csv-wide");
        let mut wide = BTreeMap::new();
        for row in &rows[1..] {
            assert_eq!(row.len(), rows[0].len());
            for (title, value) in rows[0].iter().zip(row).skip(3).filter(|(_, value)| !value.is_empty()) {
                let [time, bus, frame] = [0, 1, 2].map(|at: usize| row[at].clone());
                wide.insert((time, bus, frame, title.clone()), value.clone());
            }
        }
        assert!(long.len() > 50);
        assert_eq!(long, wide);
    }
}

/// Messages 1 to `messages` with 64 signals of one bit each.
fn bits(messages: u32) -> (String, String) {
    let (mut dbc, mut frames) = ("VERSION \"\"\n".to_owned(), String::new());
    for message in 1..=messages {
        writeln!(dbc, "BO_ {message} M{message}: 8 N").unwrap();
        (0..64).for_each(|bit| writeln!(dbc, " SG_ S{bit} : {bit}|1@1+ (1,0) [0|1] \"\" N").unwrap());
        writeln!(frames, "({message}.0) can0 {message:03X}#FFFFFFFFFFFFFFFF").unwrap();
    }
    (dbc, frames)
}

#[test]
fn signals_without_a_column_are_reported() {
    let folder = folder("columns");
    let dbc = folder.join("bits.dbc");
    let (text, frames) = bits(65);
    fs::write(&dbc, text).unwrap();
    let stated = ok(&["decode", "-f", "csv-wide", "--dbc", dbc.to_str().unwrap(), "-"], &frames);
    // 64 messages of 64 signals are 4096; one more message exceeds the limit.
    assert!(stated.stderr.starts_with("cobscope: 64 values dropped"), "{}", stated.stderr);
    let rows = table(&stated.stdout);
    assert!(rows.iter().all(|row| row.len() == 3 + 4096));
    assert_eq!(rows.len(), 1 + 64);
    let frames = frames.lines().take(64).collect::<Vec<_>>().join("\n");
    assert_eq!(ok(&["decode", "-f", "csv-wide", "--dbc", dbc.to_str().unwrap(), "-"], &frames).stderr, "");
}

/// Names of buses may be hostile, and buses of several captures are different.
#[test]
fn wide_rows_of_several_buses_and_captures() {
    let folder = folder("buses");
    let write = |name: &str, text: &str| {
        let path = folder.join(name);
        fs::write(&path, text).unwrap();
        path.to_str().unwrap().to_owned()
    };
    let dbc = write("one.dbc", "VERSION \"\"\nBO_ 1 M: 2 N\n SG_ S : 0|8@1+ (1,0) [0|0] \"=A\" N\n");
    let first = write("1.log", "(1.0) =x 001#01\n(2.0) can9 001#02\n");
    let second = write("2.log", "(3.0) can0 001#03\n(4.0) can1 001#04\n(5.0) can9 001#05\n");
    let text = ok(&["decode", "--separate", "-f", "csv-wide", "--dbc", &dbc, &first, &second], "").stdout;
    let expected = "time,bus,frame,frame/001 S [=A],can9/frame/001 S [=A],can1/frame/001 S [=A]\r\n\
                    1.000000000,\"'=x\",1,1,,\r\n2.000000000,can9,2,,2,\r\n\
                    3.000000000,can0,1,3,,\r\n4.000000000,can1,2,,,4\r\n5.000000000,can9,3,,5,\r\n";
    assert_eq!(text, expected);
    let text = ok(&["decode", "--separate", "-f", "csv", "--dbc", &dbc, &first, &second], "").stdout;
    let groups: Vec<String> = table(&text).into_iter().skip(1).map(|row| row[5].clone()).collect();
    assert_eq!(groups, ["frame/001", "can9/frame/001", "frame/001", "can1/frame/001", "can9/frame/001"]);
}

#[test]
fn a_capture_without_values_is_a_header() {
    let text = ok(&["decode", "-f", "csv-wide", "fixtures/canopen/emcy.log"], "").stdout;
    assert_eq!(text, "time,bus,frame\r\n");
}

/// Writes all events of a capture from the terminal UI; returns the screen.
fn exported(path: &Path) -> String {
    let mut screen = Screen::open(&format!("cobscope view {}", SYDFEC.join(" ")), 300, 30);
    screen.keys(&format!("vw<ctrl-u>{}<enter>", path.display()));
    screen.text()
}

/// `decode -f` and the UI offer the same formats and write the same contents.
#[test]
fn the_terminal_ui_exports_in_every_format() {
    let folder = folder("view");
    for format in EVENT_FORMATS {
        let path = folder.join(format!("run.{}", format.suffix));
        let screen = exported(&path);
        assert!(screen.contains("events written"), "{}: {screen}", format.name);
        if format.name == "parquet" {
            assert!(!path.exists() && folder.join("run.events.parquet").exists());
            assert!(folder.join("run.signals.parquet").exists());
            let again = exported(&path);
            assert!(again.contains("run.events.parquet: file exists"), "{again}");
            continue;
        }
        let decoded = folder.join(format.name);
        let options =
            ["decode", "--no-findings", "--all", "--frames", "--pdo", "all", "-f", format.name, "-o"];
        ok(&[&options[..], &[decoded.to_str().unwrap()], &SYDFEC].concat(), "");
        let (ui, decode) = (fs::read(&path).unwrap(), fs::read(&decoded).unwrap());
        // Attachments and descriptions of MCAP differ.
        if format.name == "mcap" {
            assert!(ui.starts_with(b"\x89MCAP") && ui.ends_with(b"MCAP0\r\n"), "{}", ui.len());
        } else {
            assert_eq!(String::from_utf8(ui).unwrap(), String::from_utf8(decode).unwrap(), "{}", format.name);
        }
    }
}

#[cfg(unix)]
#[test]
fn a_full_disk_is_reported() {
    let output = run(&[&["decode", "-f", "csv-wide", "-o", "/dev/full"][..], &SYDFEC].concat(), "");
    assert_eq!(output.code, 3);
    assert!(output.stderr.contains("cobscope: /dev/full: No space left"), "{}", output.stderr);
}

#[cfg(feature = "parquet")]
mod parquet {
    use std::io::{BufRead as _, BufReader, Write as _};
    use std::process::{Command, Stdio};

    use super::*;
    use crate::support::{corpus, python, skip, workspace};

    #[test]
    fn two_files_are_named_after_one() {
        let folder = folder("names");
        for name in ["run", "run.v2", "run.parquet"] {
            let path = folder.join(name);
            let path = path.to_str().unwrap();
            let stated =
                ok(&["decode", "-f", "parquet", "--force", "-o", path, "fixtures/canopen/emcy.log"], "");
            let stem = path.trim_end_matches(".parquet");
            let expected = format!("cobscope: writing {stem}.events.parquet and {stem}.signals.parquet\n");
            assert!(stated.stderr.starts_with(&expected), "{}", stated.stderr);
            assert_eq!(stated.stdout, "");
            for what in ["events", "signals"] {
                let bytes = fs::read(format!("{stem}.{what}.parquet")).unwrap();
                assert!(bytes.starts_with(b"PAR1") && bytes.ends_with(b"PAR1"));
            }
        }
    }

    #[test]
    fn without_a_name_it_is_refused() {
        let refused = |arguments: &[&str], text: &str| {
            let output = run(&[&["decode", "-f", "parquet"], arguments].concat(), "");
            assert_eq!(output.code, 2);
            assert!(output.stderr.contains(text), "{}", output.stderr);
        };
        refused(&["fixtures/canopen/emcy.log"], "-o NAME");
        refused(
            &["-o", "no/such/folder/run", "fixtures/canopen/emcy.log"],
            "no/such/folder/run.events.parquet",
        );
        refused(&["-o", "..", "fixtures/canopen/emcy.log"], "not a file name");
    }

    /// Compares the output of another reader with the JSON Lines of the same run.
    fn is_as_jsonl(name: &str, arguments: &[&str], least: usize) {
        let Some(python) = python() else { return skip("python", "no Python for oracles") };
        let has = Command::new(&python).args(["-c", "import duckdb"]).output();
        if !has.is_ok_and(|output| output.status.success()) {
            return skip("python", "it has no duckdb");
        }
        let folder = folder(name);
        let (lines, stem) = (folder.join("run.jsonl"), folder.join("run"));
        let (lines, stem) = (lines.to_str().unwrap(), stem.to_str().unwrap());
        for (format, path) in [("jsonl", lines), ("parquet", stem)] {
            ok(&[&["decode", "-f", format, "-o", path], arguments].concat(), "");
        }
        let script = workspace().join("tests/oracles/parquet_sums.py");
        let output = Command::new(python).arg(script).args([lines, stem]).output().unwrap();
        assert!(output.status.success(), "{name}: {}", String::from_utf8_lossy(&output.stderr));
        let signals: usize = String::from_utf8(output.stdout).unwrap().trim().parse().unwrap();
        assert!(signals >= least, "{name}: only {signals} groups and signals were compared");
    }

    #[test]
    fn duckdb_finds_the_values_and_events_of_json_lines() {
        is_as_jsonl("sydfec", &SYDFEC, 6);
        is_as_jsonl("j1939", &PVE, 7);
        let dbc = ["--dbc", "fixtures/dbc/signals.dbc", "fixtures/j1939/mixed.log"];
        is_as_jsonl("dbc", &dbc, 4);
        is_as_jsonl("several", &["fixtures/canopen/pdo_mapping.log", "fixtures/canopen/mid_run.log"], 1);
        is_as_jsonl("hostile", &["fixtures/malformed/interface_names.log"], 0);
    }

    /// DuckDB, Polars, Arrow, pandas and DataFusion: equal counts, sums and times without options.
    #[test]
    fn each_engine_reads_the_same_tables() {
        let Some(python) = python() else { return skip("python", "no Python for oracles") };
        let engines = "import datafusion, duckdb, pandas, polars, pyarrow";
        let has = Command::new(&python).args(["-c", engines]).output();
        if !has.is_ok_and(|output| output.status.success()) {
            return skip("python", "it lacks an engine that reads Parquet");
        }
        for (name, arguments, least) in [("sydfec", &SYDFEC[..], 400), ("j1939", &PVE[..], 400)] {
            let stem = folder(&format!("engines-{name}")).join("run");
            let stem = stem.to_str().unwrap();
            ok(&[&["decode", "-f", "parquet", "-o", stem], arguments].concat(), "");
            let script = workspace().join("tests/oracles/parquet_engines.py");
            let output = Command::new(&python).args([script.to_str().unwrap(), stem]).output().unwrap();
            assert!(output.status.success(), "{name}: {}", String::from_utf8_lossy(&output.stderr));
            let values: usize = String::from_utf8(output.stdout).unwrap().trim().parse().unwrap();
            assert!(values >= least, "{name}: {values} values");
        }
    }

    #[test]
    fn duckdb_finds_those_of_a_real_machine() {
        let path = corpus().join("canopen/canopen-lens__sample_amr_2wheel.log");
        if !path.exists() {
            return skip("corpus", "no captures of other projects");
        }
        is_as_jsonl("real", &[path.to_str().unwrap()], 10);
    }

    fn is_whole(path: &Path) -> bool {
        fs::read(path).unwrap().ends_with(b"PAR1")
    }

    /// Ctrl-C writes the end of the file, without which the file is not readable.
    #[cfg(unix)]
    #[test]
    fn an_interrupted_live_bus_leaves_whole_files() {
        let folder = folder("interrupt");
        let mut live = Command::new(env!("CARGO_BIN_EXE_cobscope"))
            .args(["live", "-", "--print", "-f", "parquet", "-o"])
            .arg(folder.join("run"))
            .current_dir(workspace())
            .stdin(Stdio::piped())
            .stderr(Stdio::piped())
            .spawn()
            .unwrap();
        let capture = fs::read(workspace().join("fixtures/canopen/lss.log")).unwrap();
        let mut input = live.stdin.take().unwrap();
        input.write_all(&capture).unwrap();
        // The program prints this event when it has reached the frame; the input stays open.
        let mut stated = BufReader::new(live.stderr.take().unwrap()).lines().map_while(Result::ok);
        assert!(stated.any(|line| line.contains("new bit rate")));
        assert!(!is_whole(&folder.join("run.events.parquet")));
        let id = live.id().to_string();
        assert!(Command::new("kill").args(["-INT", &id]).status().unwrap().success());
        stated.for_each(drop);
        assert_eq!(live.wait().unwrap().code(), Some(0));
        for what in ["events", "signals"] {
            assert!(is_whole(&folder.join(format!("run.{what}.parquet"))));
        }
    }
}

/// TPDO1 of node 9 every 10 ms for 8 s, after a SYNC each, and nothing else of CANopen; every tenth message is 0x600
/// with 3 bytes, which no service has.
fn only_tpdos() -> String {
    let mut log = String::new();
    for place in 0..800_u32 {
        let (second, micros) = (1_700_000_000 + place / 100, place % 100 * 10_000);
        writeln!(log, "({second}.{micros:06}) can0 080#").unwrap();
        writeln!(log, "({second}.{:06}) can0 189#{:02X}000000", micros + 500, place % 256).unwrap();
        if place % 10 == 0 {
            writeln!(log, "({second}.{:06}) can0 600#010203", micros + 900).unwrap();
        }
    }
    log
}

/// TPDO1 has two objects in the PVE (status word and spool position) and in the EDS: each of the 800 frames has two values,
/// whatever names the node.
#[test]
fn a_named_node_is_decoded_from_frame_1_in_every_format() {
    let folder = folder("named-node");
    let path = |name: &str| folder.join(name).to_str().unwrap().to_owned();
    fs::write(path("a.log"), only_tpdos()).unwrap();
    // The EDS sets 1800:01 to 1C0 + node-ID.
    fs::write(path("eds.log"), only_tpdos().replace("189#", "1C9#")).unwrap();
    fs::write(path("bus.toml"), "[node.9]\ndevice = \"danfoss-pve-ci\"\n").unwrap();
    fs::write(path("can0.toml"), "[bus.can0.node.9]\ndevice = \"danfoss-pve-ci\"\n").unwrap();
    let eds = workspace().join("fixtures/device_files/valve.eds");
    let eds = format!("9={}", eds.display());
    let (bus, own, log, of_eds) = (path("bus.toml"), path("can0.toml"), path("a.log"), path("eds.log"));
    let named = [
        (["--node", "9=danfoss-pve-ci"], &log),
        (["--node", "can0:9=danfoss-pve-ci"], &log),
        (["--eds", &eds], &of_eds),
        (["--bus", &bus], &log),
        (["--bus", &own], &log),
    ];
    for (option, log) in named {
        let note = "can0: 80 frames of unknown service without values; --dbc or [[id]] in a bus file";
        let csv = run(&[&["decode", "--pdo", "all", "-f", "csv"][..], &option, &[log]].concat(), "");
        assert!(!csv.stderr.contains("not decoded"), "{option:?}: {}", csv.stderr);
        let rows = csv.stdout.lines().filter(|line| line.contains(",node/9/tpdo1,")).count();
        assert_eq!(rows, 2 * 800, "{option:?}: {}", csv.stderr);
        assert!(csv.stderr.contains(note), "{option:?}: {}", csv.stderr);
        let lines = run(&[&["decode", "--pdo", "all", "-f", "jsonl"][..], &option, &[log]].concat(), "");
        let presumed = |kind: &str| {
            let of_kind = |line: &&str| line.contains(&format!("\"kind\":\"{kind}\""));
            let all = lines.stdout.lines().filter(of_kind);
            all.filter(|line| line.contains("\"presumed\":true")).count()
        };
        // Only the SYNC of frame 1 precedes the node.
        assert_eq!(presumed("pdo"), 0, "{option:?}");
        assert!(presumed("sync") <= 1, "{option:?}");
        for (format, file) in [("mcap", "a.mcap"), ("parquet", "a.parquet")] {
            if !EVENT_FORMATS.iter().any(|known| known.name == format) {
                continue;
            }
            let target = path(file);
            let words =
                [&["decode", "--pdo", "all", "-f", format, "-o", &target][..], &option, &[log]].concat();
            let output = run(&words, "");
            assert_eq!(output.code, 0, "{option:?}: {}", output.stderr);
            assert!(!output.stderr.contains("not decoded"), "{option:?} {format}: {}", output.stderr);
            assert!(output.stderr.contains(note), "{option:?} {format}: {}", output.stderr);
            for file in ["a.mcap", "a.events.parquet", "a.signals.parquet"] {
                let _ = fs::remove_file(path(file));
            }
        }
    }
}

#[test]
fn a_named_node_of_another_protocol_is_reported() {
    // UDS on 709 and 609: a first frame of ISO-TP, and three bytes where CiA 301 has an SDO of eight.
    let cases = [
        ("709#1014620102030405", "709 has 8 bytes (CiA 301: 1 byte)"),
        ("709#33", "709 has 1 byte (CiA 301: the value 00, 04, 05 or 7F, toggle bit apart)"),
        ("609#023E80", "609 has 3 bytes (CiA 301: SDO of 8 bytes)"),
        ("089#01", "089 has 1 byte (CiA 301: EMCY of 8 bytes)"),
    ];
    for (frame, reason) in cases {
        let log = format!("(1.000000) can0 {frame}\n(1.100000) can0 {frame}\n(1.200000) can0 321#00\n");
        let output = run(&["decode", "-f", "csv", "--node", "9=danfoss-pve-ci", "-"], &log);
        let expected =
            format!("node 9/09 treated as CANopen because the user named it, but {reason}; BUS:N limits an");
        assert!(output.stderr.contains(&expected), "{frame}: {}", output.stderr);
        // Another bus, and a valid frame.
        let output = run(&["decode", "-f", "csv", "--node", "can1:9=danfoss-pve-ci", "-"], &log);
        assert!(!output.stderr.contains("treated as"), "{frame}: {}", output.stderr);
    }
    let log = "(1.000000) can0 709#05\n(1.100000) can0 609#4000100000000000\n(1.200000) can0 089#0000000000000000\n";
    let output = run(&["decode", "-f", "csv", "--node", "9=danfoss-pve-ci", "-"], log);
    assert!(!output.stderr.contains("treated as"), "{}", output.stderr);
}
