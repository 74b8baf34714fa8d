//! Text captures of other programs: the same traffic in several formats, compared with each other, with
//! tshark and with python-can, and damaged captures.

#![expect(clippy::disallowed_methods, reason = "the rule is for the decoder, not for what tests it")]
#![expect(clippy::unwrap_used, clippy::panic, clippy::indexing_slicing, reason = "helpers of tests fail so")]

use std::fs::{self, File};
use std::io::BufReader;
use std::path::{Path, PathBuf};
use std::process::Command;

use cobscope_decoder::capture::{CaptureReader, FORMATS, Notice, ReadOptions, decompress};
use cobscope_decoder::frame::{CanId, Frame, FrameFlags};
use proptest::prelude::*;

use crate::formats_text::{
    Content, Row, anything_behind, has_corpus, is_error, our_row, read, read_file, reads_alike, their_rows,
};
use crate::support::{corpus, python, skip, workspace};

/// Captures with their format and number of frames.
const CAPTURES: &[(&str, &str, usize)] = &[
    (BUSMASTER, "busmaster", 12_974),
    ("formats/busmaster__FormatConvASC2LOG.log", "busmaster", 1_116),
    (J1939, "busmaster", 110),
    ("formats/Open-Vehicle-Monitoring-System-3__kcan-synthetic.crtd", "crtd", 20),
    (ROADSTER_TEXT, "roadster", 1_057),
    (ROADSTER_CSV, "csv", 1_057),
    ("formats/SavvyCAN__CarBusAnalyzer.trc", "carbus", 55),
    ("formats/SavvyCAN__MicrochipLog.log", "microchip", 12_974),
    ("formats/SavvyCAN__GVRET_Log.csv", "csv", 12_974),
    ("formats/SavvyCAN__GenericID_Log.csv", "csv", 12_974),
    ("formats/mdf4-converters__multiple_CAN.csv", "csv", 164),
    ("canopen/canopen-message-interpreter__pcan1.trc.csv", "csv", 11_283),
    ("canopen/canopen-message-interpreter__pcan2.trc.csv", "csv", 6_968),
];

const BUSMASTER: &str = "formats/SavvyCAN__BusMasterLog.log";
const J1939: &str = "j1939/busmaster__TestLogToExcel_J1939.log";
const ROADSTER_TEXT: &str = "formats/Open-Vehicle-Monitoring-System__20120218.charge.breakerstop.txt";
const ROADSTER_CSV: &str = "formats/Open-Vehicle-Monitoring-System__20120218.charge.breakerstop.csv";

fn of_corpus(name: &str) -> Content {
    read_file(&corpus().join(name))
}

/// Identifier and data of every frame.
fn payloads(content: &Content) -> Vec<(CanId, Vec<u8>)> {
    content.frames.iter().map(|frame| (frame.id, frame.data().to_vec())).collect()
}

/// Times since the first frame.
fn offsets(content: &Content) -> Vec<i64> {
    let start = content.frames[0].time.unwrap();
    content.frames.iter().map(|frame| frame.time.unwrap().since(start)).collect()
}

fn assert_same<T: PartialEq + std::fmt::Debug>(name: &str, ours: &[T], theirs: &[T]) {
    for (number, (ours, theirs)) in ours.iter().zip(theirs).enumerate() {
        assert_eq!(ours, theirs, "{name}: frame {}", number + 1);
    }
    assert_eq!(ours.len(), theirs.len(), "{name}");
}

/// Files added to the corpus must be compared with another reader, too.
#[test]
fn no_format_of_the_corpus_is_left_out() {
    if !has_corpus() {
        return;
    }
    let tests = fs::read_dir(workspace().join("tests/decoder")).unwrap().map(|entry| entry.unwrap().path());
    let tests = tests.filter(|path| path.file_stem().unwrap().to_string_lossy().starts_with("formats_"));
    let sources: Vec<String> = tests.map(|path| fs::read_to_string(path).unwrap()).collect();
    for file in fs::read_dir(corpus().join("formats")).unwrap() {
        let name = file.unwrap().file_name().into_string().unwrap();
        // Five formats of one capture differ in their suffix only.
        let is_of_five = name.starts_with("mdf4-converters__multiple_CAN.");
        assert!(is_of_five || sources.iter().any(|text| text.contains(&name)), "{name}");
    }
}

#[test]
fn captures_of_the_corpus_are_read_to_the_last_line() {
    if !has_corpus() {
        return;
    }
    for (name, format, frames) in CAPTURES {
        let content = of_corpus(name);
        assert_eq!(content.unreadable(), [] as [String; 0], "{name}");
        assert_eq!((content.format, content.frames.len()), (*format, *frames), "{name}");
    }
}

#[test]
fn one_drive_in_five_formats() {
    if !has_corpus() {
        return;
    }
    let candump = of_corpus("formats/SavvyCAN__candump.log");
    let expected = payloads(&candump);
    assert_eq!(expected.len(), 12_974);
    for name in [
        BUSMASTER,
        "formats/SavvyCAN__MicrochipLog.log",
        "formats/SavvyCAN__GVRET_Log.csv",
        "formats/SavvyCAN__GenericID_Log.csv",
    ] {
        assert_same(name, &payloads(&of_corpus(name)), &expected);
    }
    // Microseconds in integer milliseconds, and milliseconds; time of day in milliseconds; candump has
    // seconds only.
    let microseconds = offsets(&of_corpus("formats/SavvyCAN__GVRET_Log.csv"));
    assert_same("Microchip", &offsets(&of_corpus("formats/SavvyCAN__MicrochipLog.log")), &microseconds);
    assert_same("BUSMASTER", &offsets(&of_corpus(BUSMASTER)), &microseconds);
    assert!(of_corpus("formats/SavvyCAN__GenericID_Log.csv").frames.iter().all(|frame| frame.time.is_none()));
}

#[test]
fn one_recording_of_fd_in_five_formats() {
    if !has_corpus() {
        return;
    }
    let of = |suffix: &str| of_corpus(&format!("formats/mdf4-converters__multiple_CAN.{suffix}"));
    let csv = of("csv");
    for suffix in ["log", "trc", "asc", "pcap"] {
        let other = of(suffix);
        assert_same(suffix, &payloads(&csv), &payloads(&other));
        assert_same(suffix, &offsets(&csv), &offsets(&other));
        // candump and pcap mark FD frames and those with bit rate switch.
        let marks = FrameFlags::FD.0 | FrameFlags::BIT_RATE_SWITCH.0;
        let kinds = |content: &Content, marks: u8| {
            content.frames.iter().map(|frame| frame.flags.0 & marks).collect::<Vec<_>>()
        };
        match suffix {
            "asc" => {}
            "trc" => assert_same(suffix, &kinds(&csv, FrameFlags::FD.0), &kinds(&other, FrameFlags::FD.0)),
            _ => assert_same(suffix, &kinds(&csv, marks), &kinds(&other, marks)),
        }
    }
    assert_eq!(csv.frames[0].time, of("log").frames[0].time);
    assert_eq!(csv.buses, of("asc").buses);
}

#[test]
fn decoded_traces_hold_the_frames_of_the_traces() {
    if !has_corpus() {
        return;
    }
    for name in ["pcan1", "pcan2"] {
        let of = |suffix: &str| of_corpus(&format!("canopen/canopen-message-interpreter__{name}.{suffix}"));
        let (csv, trace) = (of("trc.csv"), of("trc"));
        assert_same(name, &payloads(&csv), &payloads(&trace));
        assert_same(name, &offsets(&csv), &offsets(&trace));
        let remote = |content: &Content| {
            content.frames.iter().map(|frame| frame.flags.0 & FrameFlags::REMOTE.0).collect::<Vec<_>>()
        };
        assert_same(name, &remote(&csv), &remote(&trace));
    }
}

/// The text was derived from the CSV by hand: it lacks the direction only, and the five frames "sent" without
/// data, which contain notes of the author, are notes in both.
#[test]
fn annotated_text_and_csv_of_a_charge_agree() {
    if !has_corpus() {
        return;
    }
    let (text, csv) = (of_corpus(ROADSTER_TEXT), of_corpus(ROADSTER_CSV));
    assert_same("payloads", &payloads(&text), &payloads(&csv));
    let times = |content: &Content| content.frames.iter().map(|frame| frame.time).collect::<Vec<_>>();
    assert_same("times", &times(&text), &times(&csv));
    assert!(csv.frames.iter().all(|frame| frame.flags == FrameFlags::RECEIVED));
}

/// Written by BUSMASTER's converter, with bus, direction and time.
#[test]
fn a_converted_capture_is_the_one_it_was_made_of() {
    if !has_corpus() {
        return;
    }
    let of = |suffix: &str| of_corpus(&format!("formats/busmaster__FormatConvASC2LOG.{suffix}"));
    let (capture, asc) = (of("log"), of("asc"));
    assert_eq!(capture.buses, asc.buses);
    let rest =
        |content: &Content| content.frames.iter().map(|frame| (frame.bus, frame.flags)).collect::<Vec<_>>();
    assert_same("payloads", &payloads(&capture), &payloads(&asc));
    assert_same("buses", &rest(&capture), &rest(&asc));
    assert_same("times", &offsets(&capture), &offsets(&asc));
}

/// Output of a script of `tests/oracles`; `None` if its requirements are missing.
fn oracle(script: &str, arguments: &[&Path]) -> Option<String> {
    let script = workspace().join("tests/oracles").join(script);
    let Some(python) = python().filter(|_| script.exists()) else {
        skip("python", "no Python with tests/oracles/requirements.txt");
        return None;
    };
    // tshark reads times of day in its local time zone.
    let output = Command::new(&python).arg(&script).args(arguments).env("TZ", "UTC").output().unwrap();
    assert!(output.status.success(), "{arguments:?}: {}", String::from_utf8_lossy(&output.stderr));
    Some(String::from_utf8(output.stdout).unwrap())
}

/// Sets the bus to 1 in rows of an oracle without buses.
fn on_bus_1(text: &str) -> String {
    let named = |line: &str| {
        let [time, _, rest] = line.splitn(3, '\t').collect::<Vec<_>>()[..] else { panic!("{line}") };
        format!("{time}\t1\t{rest}\n")
    };
    text.lines().map(named).collect::<Vec<_>>().concat()
}

fn our_rows(content: &Content, start: i64) -> Vec<Row> {
    content.frames.iter().map(|frame| our_row(frame, start, &content.buses)).collect()
}

#[test]
fn tshark_reads_the_same_frames_of_busmaster() {
    if !has_corpus() {
        return;
    }
    if Command::new("tshark").arg("-v").output().is_err() {
        skip("tshark", "the program is missing");
        return;
    }
    for name in [BUSMASTER, J1939] {
        let Some(text) = oracle("frames_tshark.py", &[&corpus().join(name)]) else { return };
        let content = of_corpus(name);
        let theirs = their_rows(&on_bus_1(&text), false);
        let ours = our_rows(&content, content.frames[0].time.unwrap().0);
        assert_eq!(ours.len(), theirs.len(), "{name}");
        for (ours, theirs) in ours.into_iter().zip(theirs) {
            // SavvyCAN wrote three digits of a second; tshark reads each one as 100 µs.
            let time = if name == BUSMASTER { ours.time } else { theirs.time };
            assert_eq!(ours, Row { channel: ours.channel.clone(), time, ..theirs }, "{name}");
        }
    }
    let first = of_corpus(J1939).frames[0].time.unwrap();
    // `date -u -d '2013-09-05 13:19:55.2009' +%s.%N`
    assert_eq!(first.0, 1_378_387_195_200_900_000);
}

#[test]
fn python_can_reads_the_same_frames_of_its_csv() {
    if !has_corpus() {
        return;
    }
    for name in [
        "formats/SavvyCAN__candump.log",
        "canopen/canopen-message-interpreter__pcan2.trc",
        "formats/python-can__logfile.asc",
        "formats/mdf4-converters__multiple_CAN.log",
    ] {
        let path = Path::new(env!("CARGO_TARGET_TMPDIR")).join(name.replace('/', "_") + ".csv");
        if oracle("write_csv.py", &[&corpus().join(name), &path]).is_none() {
            return;
        }
        let theirs = their_rows(&on_bus_1(&oracle("frames.py", &[&path]).unwrap()), false);
        let content = read_file(&path);
        assert_eq!((content.format, content.unreadable().len()), ("csv", 0), "{name}");
        let ours = our_rows(&content, content.frames[0].time.unwrap().0);
        assert_eq!(ours.len(), theirs.len(), "{name}");
        for (ours, theirs) in ours.into_iter().zip(theirs) {
            assert!((ours.time - theirs.time).abs() <= 1_000, "{name}: {ours:?} {theirs:?}");
            // The CSV does not mark FD frames; our reader derives FD from the length.
            let flags = ours.flags.replace('F', "");
            let ours = Row { flags: if flags.is_empty() { "-".into() } else { flags }, ..ours };
            assert_eq!(ours, Row { time: ours.time, ..theirs }, "{name}");
        }
    }
}

/// A synthetic capture for each format: name, file, frames.
const SAMPLES: &[(&str, &str, usize)] = &[
    ("busmaster", "fuzz/busmaster/sample.log", 6),
    ("crtd", "fuzz/crtd/sample.crtd", 3),
    ("carbus", "fuzz/carbus/sample.trc", 3),
    ("microchip", "fuzz/microchip/sample.log", 3),
    ("canking", "fuzz/canking/sample.txt", 4),
    ("roadster", "fuzz/roadster/sample.txt", 3),
    ("csv", "fuzz/csv/cobscope.csv", 6),
    ("csv", "fuzz/csv/python-can.csv", 3),
    ("csv", "fuzz/csv/savvycan.csv", 2),
    ("csv", "fuzz/csv/generic.csv", 2),
    ("csv", "fuzz/csv/css.csv", 3),
    ("csv", "fuzz/csv/ixxat.csv", 3),
    ("csv", "fuzz/csv/kvaser.csv", 3),
    ("csv", "fuzz/csv/cando.csv", 5),
    ("csv", "fuzz/csv/interpreter.csv", 2),
    ("csv", "fuzz/csv/zlg_gbk.csv", 4),
    ("excerpt", "fuzz/excerpt/sample.txt", 5),
    ("columns", "fuzz/columns/sample.txt", 6),
    ("lawicel", "fuzz/lawicel/sample.txt", 6),
    ("elm327", "fuzz/elm327/sample.txt", 6),
    ("n2k-ascii", "fuzz/n2k-ascii/sample.txt", 5),
    ("canboat", "fuzz/canboat/sample.txt", 4),
    ("ros-echo", "fuzz/ros-echo/sample.yaml", 3),
    ("isotpdump", "fuzz/isotpdump/sample.txt", 5),
    ("tshark", "fuzz/tshark/sample.txt", 3),
    ("ctt", "fuzz/ctt/sample.txt", 4),
    ("gvret", "fuzz/gvret/sample.bin", 22),
];

/// Formats that match, without the last resort if another one does: most tables of numbers match it.
fn matching_formats(head: &[u8]) -> Vec<&'static str> {
    let matching = FORMATS.iter().filter(|format| (format.detect)(head)).map(|format| format.name);
    let mut names: Vec<_> = matching.collect();
    if names.len() > 1 {
        names.retain(|name| *name != "columns");
    }
    names
}

fn sample(file: &str) -> Vec<u8> {
    let path: PathBuf = workspace().join("fixtures").join(file);
    fs::read(&path).unwrap_or_else(|error| panic!("{}: {error}", path.display()))
}

#[test]
fn every_sample_is_recognised_by_its_format_alone_and_read() {
    for (format, file, frames) in SAMPLES {
        let bytes = sample(file);
        assert_eq!(matching_formats(&bytes), [*format], "{file}");
        let content = read(&bytes[..]).unwrap();
        assert_eq!((content.frames.len(), content.unreadable()), (*frames, vec![]), "{file}");
    }
}

#[test]
fn every_capture_of_the_corpus_is_recognised_by_one_format_alone() {
    if !has_corpus() {
        return;
    }
    let folder = fs::read_dir(corpus().join("formats")).unwrap();
    for path in folder.map(|entry| entry.unwrap().path()) {
        let name = path.display().to_string();
        if path.extension().is_some_and(|suffix| suffix == "gz") {
            continue;
        }
        let bytes = fs::read(&path).unwrap();
        let head = &bytes[..bytes.len().min(64 * 1024)];
        let names = matching_formats(head);
        assert!(names.len() <= 1, "{name}: {names:?}");
        let is_text = path.extension().is_some_and(|suffix| suffix != "blf" && suffix != "mf4");
        assert!(!is_text || names.len() == 1, "{name}");
    }
}

/// Every file of the corpus, with its path in the corpus.
fn corpus_files(folder: &Path, found: &mut Vec<(String, PathBuf)>) {
    for path in fs::read_dir(folder).unwrap().map(|entry| entry.unwrap().path()) {
        if path.is_dir() {
            corpus_files(&path, found);
        } else {
            found.push((path.strip_prefix(corpus()).unwrap().to_str().unwrap().to_owned(), path));
        }
    }
}

/// A lenient format must not take a file of another one, nor a file without frames. The table holds for builds that
/// can decompress and that know all formats.
#[test]
fn no_file_of_the_corpus_changes_its_format() {
    if !has_corpus() || !cfg!(all(feature = "gzip", feature = "mcap")) {
        return;
    }
    let mut files = Vec::new();
    corpus_files(&corpus(), &mut files);
    let open = |path: &Path| {
        let source = decompress(BufReader::new(File::open(path).unwrap())).unwrap();
        CaptureReader::open(source, &ReadOptions::default()).map(|reader| reader.format().name)
    };
    let mut found: Vec<_> =
        files.iter().filter_map(|(name, path)| Some(format!("{} {name}", open(path).ok()?))).collect();
    found.sort_unstable();
    let table = fs::read_to_string(workspace().join("tests/decoder/corpus_formats.txt")).unwrap();
    let expected: Vec<_> = table.lines().filter(|line| !line.starts_with('#')).collect();
    assert_same("corpus", &found.iter().map(String::as_str).collect::<Vec<_>>(), &expected);
}

/// Samples except the excerpt: without a header, one line that does not fit means that the text is not an excerpt.
fn samples_with_a_header() -> Vec<(&'static str, &'static str, usize)> {
    SAMPLES.iter().filter(|(format, ..)| !matches!(*format, "excerpt" | "columns")).copied().collect()
}

/// Samples of formats whose lines contain at most one frame.
fn samples_with_frames_in_lines() -> Vec<(&'static str, &'static str, usize)> {
    let samples = samples_with_a_header().into_iter();
    samples.filter(|(format, ..)| !SEVERAL_FRAMES.contains(format) && *format != "gvret").collect()
}

/// Formats with one message per line, which may have several frames.
pub(crate) const SEVERAL_FRAMES: [&str; 4] = ["n2k-ascii", "canboat", "canboat-json", "uds-messages"];

/// A sample with some bytes replaced.
fn mutated() -> impl Strategy<Value = Vec<u8>> {
    let edits = prop::collection::vec((any::<prop::sample::Index>(), any::<u8>()), 0..24);
    (prop::sample::select(SAMPLES), edits).prop_map(|((_, file, _), edits)| {
        let mut bytes = sample(file);
        for (at, byte) in edits {
            let at = at.index(bytes.len());
            bytes[at] = byte;
        }
        bytes
    })
}

/// The header of a sample, followed by random bytes.
fn headers() -> impl Strategy<Value = Vec<u8>> {
    prop_oneof![
        anything_behind("***BUSMASTER Ver 2.4.0***\n***HEX***\n"),
        anything_behind("1.0 CXX OVMS CRTD\n"),
        anything_behind("@ TEXT @ 2 @ 64 @ 0 @ 55 @ 1 @ 1 @\r"),
        anything_behind("//-\nCAN BUS Analyzer\n//-\n"),
        anything_behind("Chn Identifier Flg\n"),
        anything_behind("         0.0458 588 00 00 84\n"),
        anything_behind("ID,Data Bytes\n"),
    ]
}

fn frames_of(bytes: &[u8]) -> Vec<Frame> {
    read(bytes).map(|content| content.frames).unwrap_or_default()
}

proptest! {
    #![proptest_config(ProptestConfig { cases: 300, failure_persistence: None, ..ProptestConfig::default() })]

    #[test]
    fn broken_captures_read_alike_in_pieces(
        bytes in prop_oneof![mutated(), headers()],
        sizes in prop::collection::vec(1_usize..300, 1..8),
    ) {
        reads_alike(&bytes, &sizes)?;
    }

    /// The reader returns all frames before the cut, and at most one from the truncated line.
    #[test]
    fn captures_that_are_cut_off_give_all_before_the_cut(
        (_, file, _) in prop::sample::select(samples_with_frames_in_lines()),
        at in any::<prop::sample::Index>(),
    ) {
        let whole = sample(file);
        let at = at.index(whole.len());
        let end = whole[..at].iter().rposition(|byte| matches!(byte, b'\n' | b'\r')).map_or(0, |end| end + 1);
        let (all, lines, cut) = (frames_of(&whole), frames_of(&whole[..end]), frames_of(&whole[..at]));
        prop_assert!(all.starts_with(&lines), "{file}: {} bytes", at);
        prop_assert!(cut.starts_with(&lines) && cut.len() <= lines.len() + 1, "{file}: {} bytes", at);
    }

    /// A changed byte affects at most its own line, outside a header.
    #[test]
    fn a_broken_line_costs_no_other(
        (_, file, _) in prop::sample::select(samples_with_frames_in_lines().split_off(1)),
        (line, at) in any::<(prop::sample::Index, prop::sample::Index)>(),
        byte in 0x20_u8..0x7F,
    ) {
        let whole = sample(file);
        let all = frames_of(&whole);
        let is_end = |at: usize| whole[at] == b'\n' || whole[at] == b'\r' && whole.get(at + 1) != Some(&b'\n');
        let ends: Vec<_> = (0..whole.len()).filter(|at| is_end(*at)).map(|at| at + 1).collect();
        // Lines after that of the first frame: the shortest start with a frame ends with it.
        let first = ends.iter().position(|end| !frames_of(&whole[..*end]).is_empty()).unwrap();
        let lines = ends.len() - first - 1;
        prop_assume!(lines > 0);
        let line = first + line.index(lines);
        let (start, end) = (ends[line], ends[line + 1]);
        let mut broken = whole.clone();
        broken[start + at.index((end - start - 1).max(1))] = byte;
        let found = read(&broken[..]).unwrap();
        let lost = all.len().saturating_sub(found.frames.len());
        prop_assert!(lost <= 1, "{file}: line {}", line + 2);
        let errors = found.notices.iter().filter(|notice| matches!(notice, Notice::Unreadable { .. })).count();
        prop_assert!(errors <= 1, "{file}: {:?}", found.notices);
    }
}

#[test]
fn error_frames_of_samples_are_marked() {
    for (file, errors) in
        [("fuzz/busmaster/sample.log", 1), ("fuzz/canking/sample.txt", 1), ("fuzz/csv/cando.csv", 3)]
    {
        let content = read(&sample(file)[..]).unwrap();
        assert_eq!(content.frames.iter().filter(|frame| is_error(frame)).count(), errors, "{file}");
    }
}
