//! Other programs read the output of `convert`.

use std::path::Path;
use std::process::Command;

#[cfg(feature = "mcap")]
use super::Content;
use super::{Folder, fixture};
#[cfg(feature = "mcap")]
use crate::cli::run;
use crate::support::{self, workspace};

/// Output of a script of `tests/oracles`; `None` without a Python for it.
fn oracle(script: &str, arguments: &[&Path]) -> Option<Vec<String>> {
    let Some(python) = support::python() else {
        support::skip("python", "no Python with tests/oracles/requirements.txt");
        return None;
    };
    let mut words = script.split(' ');
    let script = workspace().join("tests/oracles").join(words.next().unwrap());
    let output = Command::new(python).arg(script).args(words).args(arguments).output().unwrap();
    assert!(output.status.success(), "{arguments:?}: {}", String::from_utf8_lossy(&output.stderr));
    Some(String::from_utf8(output.stdout).unwrap().lines().map(str::to_owned).collect())
}

/// A frame in the format of the scripts.
#[derive(Debug, Clone, PartialEq)]
struct Row {
    /// Microseconds since the first row.
    time: i64,
    channel: String,
    rest: String,
}

/// Rows with `from` added to numeric channels.
fn rows(lines: &[String], from: u32) -> Vec<Row> {
    let row = |line: &String| {
        let [time, channel, rest] = line.splitn(3, '\t').collect::<Vec<_>>()[..] else {
            unreachable!("{line}")
        };
        let (seconds, fraction) = time.split_once('.').unwrap();
        // Epoch times of python-can are doubles: rounded to their resolution.
        let fraction = (fraction.parse::<i64>().unwrap() + 500) / 1_000;
        let channel =
            channel.parse::<u32>().map_or_else(|_| channel.into(), |number| (number + from).to_string());
        Row { time: seconds.parse::<i64>().unwrap() * 1_000_000 + fraction, channel, rest: rest.into() }
    };
    let mut rows: Vec<Row> = lines.iter().map(row).collect();
    let start = rows.first().map_or(0, |row| row.time);
    for row in &mut rows {
        row.time -= start;
    }
    rows
}

/// A row without the contents of an error frame.
fn marked(row: &Row) -> Row {
    let flags = row.rest.split('\t').nth(1).unwrap();
    if flags.contains('E') {
        return Row { time: row.time, channel: String::new(), rest: "E".into() };
    }
    row.clone()
}

/// python-can reads FD frames without data in ASC as remote frames.
fn as_in_asc(row: Row) -> Row {
    match row.rest.split('\t').collect::<Vec<_>>()[..] {
        [id, flags, "0", data] if flags.contains('F') => {
            Row { rest: format!("{id}\t{}\t0\t{data}", flags.replacen('F', "RF", 1)), ..row }
        }
        _ => row,
    }
}

/// Captures of loggers, read by python-can before and after conversion to text.
#[test]
fn python_can_finds_the_same_in_a_logger_s_capture_and_in_what_is_made_of_it() {
    let folder = Folder::new();
    for name in ["stored.blf", "zlib.blf"] {
        if name == "zlib.blf" && !cfg!(feature = "gzip") {
            continue;
        }
        let source = fixture("recorders").join(name);
        let Some(lines) = oracle("frames.py --direction", &[&source]) else { return };
        let theirs: Vec<Row> = rows(&lines, 1).iter().map(marked).collect();
        assert_eq!(theirs.len(), 120);
        assert!(
            lines.iter().any(|line| line.contains("\tFBT\t"))
                && lines.iter().any(|line| line.contains("\tXR"))
        );
        for (suffix, script, from) in [
            ("asc", "frames.py --direction", 1),
            ("trc", "frames.py --direction", 0),
            ("log", "frames.py --direction", 0),
            ("csv", "csv_frames.py", 0),
        ] {
            let out = format!("@{name}.{suffix}");
            folder.converted(&[source.to_str().unwrap(), &out]);
            let found = oracle(script, &[&folder.path(&out[1..])]).unwrap();
            let found: Vec<Row> = rows(&found, from)
                .iter()
                .map(|row| marked(&Row { rest: row.rest.trim_end_matches('\t').into(), ..row.clone() }))
                .collect();
            // python-can skips error frames of TRC.
            let expected = theirs.iter().filter(|row| suffix != "trc" || row.rest != "E");
            let expected = expected.cloned().map(|row| if suffix == "asc" { as_in_asc(row) } else { row });
            assert_eq!(found, expected.collect::<Vec<_>>(), "{out}");
        }
    }
}

fn tshark(path: &Path, fields: &[&str]) -> Option<Vec<Vec<String>>> {
    let mut command = Command::new("tshark");
    command.args(["-Q", "-T", "fields"]);
    for field in fields {
        command.args(["-e", field]);
    }
    let Ok(output) = command.arg("-r").arg(path).output() else {
        support::skip("tshark", "the program is missing");
        return None;
    };
    assert!(output.status.success(), "{}", String::from_utf8_lossy(&output.stderr));
    let text = String::from_utf8(output.stdout).unwrap();
    Some(text.lines().map(|line| line.split('\t').map(str::to_owned).collect()).collect())
}

#[test]
fn tshark_shows_what_each_frame_means_on_which_interface_and_when() {
    let folder = Folder::new();
    let source = fixture("devices/sydfec.log");
    let words = ["--comments", "--node", "2=rexroth-sydfec", source.to_str().unwrap()];
    let content = folder.converted(&[&words[..], &["@a.pcapng"]].concat());
    folder.converted(&[&words[..], &["@a.csv"]].concat());
    let Some(found) = tshark(&folder.path("a.pcapng"), &["frame.comment", "frame.interface_name", "can.id"])
    else {
        return;
    };
    assert_eq!(found.len(), content.frames.len());
    for (row, frame) in found.iter().zip(&content.frames) {
        assert_eq!(row[1..], ["can0".to_owned(), frame.id.number().to_string()]);
    }
    // By hand: the second frame is an empty EMCY of node 2, its boot sign.
    assert!(found[1][0].starts_with("2/02 READY empty EMCY message"), "{:?}", found[1]);
    assert!(found[1][0].contains("\\n2/02 STATE pre-operational"), "{:?}", found[1]);
    assert!(found.iter().any(|row| row[0].is_empty()), "frames that say nothing have no comment");
    if let Some(lines) = oracle("csv_frames.py", &[&folder.path("a.csv")]) {
        let ours: Vec<_> = lines.iter().map(|line| line.rsplit('\t').next().unwrap()).collect();
        let theirs: Vec<_> = found.iter().map(|row| row[0].as_str()).collect();
        assert_eq!(ours, theirs);
    }
    // Nanoseconds: fixtures/README.md, the last three digits are 123.
    folder.converted(&[fixture("dialects/candump_L_ns.log").to_str().unwrap(), "@ns.pcapng"]);
    let times = tshark(&folder.path("ns.pcapng"), &["frame.time_epoch", "frame.interface_name"]).unwrap();
    assert!(times.iter().all(|row| row[0].ends_with("123") && row[0].len() == 20), "{times:?}");
    assert!(times.iter().any(|row| row[1] == "can0") && times.iter().any(|row| row[1] == "can1"));
}

/// A frame in the columns of `mcap_capture.py`.
#[cfg(feature = "mcap")]
fn columns(content: &Content) -> Vec<String> {
    use cobscope_decoder::frame::{CanId, FrameFlags};
    let line = |frame: &cobscope_decoder::frame::Frame| {
        let is = |flag| frame.flags.contains(flag);
        let is_error = is(FrameFlags::ERROR);
        let letters = [
            (!is_error && matches!(frame.id, CanId::Extended(_)), 'X'),
            (is(FrameFlags::REMOTE), 'R'),
            (is_error, 'E'),
            (is(FrameFlags::FD), 'F'),
        ];
        let flags: String = letters.iter().filter(|(on, _)| *on).map(|(_, letter)| *letter).collect();
        let data = frame.data().iter().fold(String::new(), |text, byte| format!("{text}{byte:02X}"));
        let or = |text: String| if text.is_empty() { "-".to_owned() } else { text };
        let bus = &content.buses[usize::from(frame.bus.0)];
        let topic = if is(FrameFlags::FD) { format!("/can/{bus}/fd") } else { format!("/can/{bus}") };
        let (time, id, length) = (frame.time.unwrap(), frame.id, frame.length);
        format!("{time}\t{bus}\t{topic}\t{id}\t{}\t{length}\t{}", or(flags), or(data))
    };
    content.frames.iter().map(line).collect()
}

#[cfg(feature = "mcap")]
#[test]
fn the_reader_of_mcap_finds_our_frames_and_a_whole_index() {
    let folder = Folder::new();
    for name in
        ["dialects/candump_L.log", "canopen/error_frames.log", "recorders/stored.blf", "j1939/mixed.log"]
    {
        let source = fixture(name);
        let expected = columns(&Content::read(&source));
        for packing in ["none", "lz4", "zstd"] {
            let out = format!("@{packing}.mcap");
            folder.converted(&["--force", "--packing", packing, source.to_str().unwrap(), &out]);
            let Some(found) = oracle("mcap_capture.py", &[&folder.path(&out[1..])]) else { return };
            assert_eq!(found, expected, "{name}, {packing}");
        }
    }
}

/// Captures with options for their devices.
#[cfg(feature = "mcap")]
const DEVICES: &[(&str, &[&str])] = &[
    ("devices/sydfec.log", &["--node", "2=rexroth-sydfec"]),
    ("devices/pve.log", &["--node", "32=danfoss-pve-ci"]),
    ("devices/sydfec_nominal_pressure.log", &["--node", "2=rexroth-sydfec"]),
    ("canopen/error_frames.log", &[]),
    ("canopen/sdo_abort.log", &[]),
    ("canopen/pdo_mapping.log", &[]),
    ("j1939/mixed.log", &[]),
    ("dialects/dropped_ta_d.txt", &[]),
];

#[cfg(feature = "mcap")]
fn decoded(format: &str, source: &Path, options: &[&str], out: &Path) {
    let words = ["decode", "-f", format, "-o", out.to_str().unwrap(), source.to_str().unwrap()];
    let output = run(&[&words[..], options].concat(), "");
    assert_eq!(output.code, 0, "{words:?}: {}", output.stderr);
}

#[cfg(feature = "mcap")]
#[test]
fn values_and_events_in_mcap_are_those_of_json_lines_and_fit_their_schemas() {
    let folder = Folder::new();
    for (at, (name, options)) in DEVICES.iter().enumerate() {
        let [mcap, jsonl] = [format!("{at}.mcap"), format!("{at}.jsonl")].map(|name| folder.path(&name));
        decoded("mcap", &fixture(name), options, &mcap);
        decoded("jsonl", &fixture(name), options, &jsonl);
        let Some(found) = oracle("mcap_read.py", &[&mcap, &jsonl]) else { return };
        if at == 0 {
            // One message for each PDO with a known mapping: 142 TPDOs and 5 RPDOs.
            assert!(found[0].starts_with("values 147 records "), "{found:?}");
        }
    }
}

/// A broadcast of 12 bytes: 0x1E, then zeros, the last 0xFF.
#[cfg(feature = "mcap")]
const BROADCAST: &str = "(1700000000.0) can0 18ECFF80#200C0002FFE3FE00\n(1700000000.1) can0 18EBFF80#011E000000000000\n\
                         (1700000000.2) can0 18EBFF80#0200000000FFFFFF\n";

#[cfg(feature = "mcap")]
#[test]
fn a_transfer_is_values_and_an_event() {
    let folder = Folder::new();
    let source = folder.write("bam.log", BROADCAST);
    // 0x98FEE380 with the bit for 29 bits.
    let dbc = "VERSION \"\"\nBO_ 2566841216 ENGINE: 12 N\n SG_ Speed : 0|8@1+ (0.5,0) [0|100] \"rpm\" N\n \
               SG_ Last : 88|8@1+ (1,0) [0|0] \"\" N\n";
    let dbc = folder.write("engine.dbc", dbc);
    let [mcap, jsonl] = ["a.mcap", "a.jsonl"].map(|name| folder.path(name));
    let options = ["--dbc", dbc.to_str().unwrap()];
    decoded("mcap", &source, &options, &mcap);
    decoded("jsonl", &source, &options, &jsonl);
    let text = std::fs::read_to_string(&jsonl).unwrap();
    assert!(text.contains("\"value\":15,") && text.contains("j1939-transfer"), "{text}");
    let Some(found) = oracle("mcap_read.py", &[&mcap, &jsonl]) else { return };
    assert!(found[0].starts_with("values 1 "), "{found:?}");
}

#[cfg(feature = "mcap")]
#[test]
fn mcap_read_again_gives_the_same_events_to_the_byte() {
    let folder = Folder::new();
    for (at, (name, options)) in DEVICES.iter().enumerate() {
        let source = fixture(name);
        let [frames, events] = [format!("f{at}.mcap"), format!("e{at}.mcap")].map(|name| folder.path(&name));
        let words = ["convert", source.to_str().unwrap(), frames.to_str().unwrap()];
        assert_eq!(run(&words, "").code, 0);
        decoded("mcap", &source, options, &events);
        let lines = |capture: &Path| {
            let words = ["decode", "-f", "jsonl", capture.to_str().unwrap()];
            run(&[&words[..], options].concat(), "").stdout
        };
        let expected = lines(&source);
        assert!(expected.lines().count() > 5);
        assert_eq!(lines(&frames), expected, "{name}: frames");
        assert_eq!(lines(&events), expected, "{name}: frames and events");
        // Text lines contain nodes, which are not buses.
        assert_eq!(Content::read(&events).buses, Content::read(&source).buses, "{name}");
    }
}
