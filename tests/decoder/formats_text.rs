//! PEAK traces and Vector ASC: captures of other projects compared with python-can, and robustness.

#![expect(clippy::disallowed_methods, reason = "the rule is for the decoder, not for what tests it")]
#![expect(clippy::unwrap_used, clippy::panic, clippy::indexing_slicing, reason = "helpers of tests fail so")]

use std::fs::File;
use std::io::{BufReader, Read};
use std::path::Path;
use std::process::Command;

use cobscope_decoder::capture::{
    Batch, CaptureError, CaptureReader, FORMATS, LARGEST_RECORD, Notice, ReadOptions, decompress,
};
use cobscope_decoder::frame::{CanId, Frame, FrameFlags, fd_length};
use proptest::prelude::*;

use crate::support::{corpus, is_readable, python, skip, workspace};

/// PEAK traces: file, frames, and lines that report a bus state (decoded as error frames; the counts of the
/// corpus omit them).
const TRACES: &[(&str, usize, usize)] = &[
    ("canopen/canopen-message-interpreter__pcan1.trc", 11_283, 0),
    ("canopen/canopen-message-interpreter__pcan2.trc", 6_968, 0),
    ("nmea2000/canboat__sample3_PCAN-View.trc", 12_274, 0),
    ("formats/mdf4-converters__multiple_CAN.trc", 164, 0),
    ("formats/python-can__test_CanMessage.trc", 2, 0),
    ("formats/python-can__test_CanMessage_V1_0_BUS1.trc", 11, 1),
    ("formats/python-can__test_CanMessage_V1_1.trc", 11, 1),
    ("formats/python-can__test_CanMessage_V1_3.trc", 11, 1),
    ("formats/python-can__test_CanMessage_V2_0_BUS1.trc", 11, 1),
    ("formats/python-can__test_CanMessage_V2_1.trc", 11, 1),
];

/// ASC captures with their number of frames, including error frames. The corpus count of BUSMASTER's file is
/// from python-can, which loses the first frame.
const ASC: &[(&str, usize)] = &[
    ("formats/busmaster__FormatConvASC2LOG.asc", 1_116),
    ("formats/mdf4-converters__multiple_CAN.asc", 164),
    ("formats/python-can__issue_1256.asc", 1_457),
    ("formats/python-can__issue_1299.asc", 4),
    ("formats/python-can__logfile.asc", 20),
    ("formats/python-can__logfile_errorframes.asc", 12),
    ("formats/python-can__single_frame.asc", 1),
    ("formats/python-can__single_frame_us_locale.asc", 1),
    ("formats/python-can__test_CanErrorFrames.asc", 4),
    ("formats/python-can__test_CanFdMessage.asc", 3),
    ("formats/python-can__test_CanFdMessage64.asc", 2),
    ("formats/python-can__test_CanFdRemoteMessage.asc", 1),
    ("formats/python-can__test_CanMessage.asc", 2),
    ("formats/python-can__test_CanMessage.asc.gz", 2),
    ("formats/python-can__test_CanRemoteMessage.asc", 3),
];

/// Captures whose first frame python-can 4.6 reads as a header line, because the line `internal events
/// logged`, which ends the header, is missing.
const FIRST_FRAME_LOST: &[&str] =
    &["formats/mdf4-converters__multiple_CAN.asc", "formats/busmaster__FormatConvASC2LOG.asc"];

/// Everything that a reader returns for a capture.
#[derive(Debug, Default, PartialEq)]
pub(crate) struct Content {
    pub(crate) format: &'static str,
    pub(crate) frames: Vec<Frame>,
    pub(crate) notices: Vec<Notice>,
    pub(crate) buses: Vec<String>,
    pub(crate) error: Option<String>,
}

impl Content {
    pub(crate) fn unreadable(&self) -> Vec<String> {
        let lines = self.notices.iter().filter(|notice| matches!(notice, Notice::Unreadable { .. }));
        lines.map(ToString::to_string).collect()
    }
}

pub(crate) fn is_error(frame: &Frame) -> bool {
    frame.flags.contains(FrameFlags::ERROR)
}

pub(crate) fn read(source: impl Read) -> Result<Content, CaptureError> {
    let mut reader = CaptureReader::open(source, &ReadOptions::default())?;
    let mut content = Content { format: reader.format().name, ..Content::default() };
    let mut batch = Batch::new();
    loop {
        let more = reader.read(&mut batch);
        content.frames.extend_from_slice(batch.frames());
        content.notices.extend(batch.notices().iter().map(|(_, notice)| notice.clone()));
        match more {
            Ok(true) => {}
            Ok(false) => break,
            Err(error) => {
                content.error = Some(error.to_string());
                break;
            }
        }
    }
    content.buses = reader.buses().names().to_vec();
    Ok(content)
}

pub(crate) fn read_file(path: &Path) -> Content {
    let file = File::open(path).unwrap_or_else(|error| panic!("{}: {error}", path.display()));
    let content = read(decompress(BufReader::new(file)).unwrap()).unwrap();
    assert_eq!(content.error, None, "{}", path.display());
    content
}

pub(crate) fn has_corpus() -> bool {
    let found = corpus().join("README.md").exists();
    if !found {
        skip("corpus", &format!("{} is not there", corpus().display()));
    }
    found
}

#[test]
fn traces_of_the_corpus_are_read_to_the_last_line() {
    if !has_corpus() {
        return;
    }
    for (name, frames, reports) in TRACES {
        let content = read_file(&corpus().join(name));
        let errors = content.frames.iter().filter(|frame| is_error(frame)).count();
        assert_eq!(content.format, "trc", "{name}");
        assert_eq!((content.frames.len() - errors, errors), (*frames, *reports), "{name}");
        assert_eq!(content.unreadable(), [] as [String; 0], "{name}");
    }
}

#[test]
fn asc_captures_of_the_corpus_are_read_to_the_last_line() {
    if !has_corpus() {
        return;
    }
    for (name, frames) in ASC.iter().filter(|(name, _)| is_readable(name)) {
        let content = read_file(&corpus().join(name));
        assert_eq!(content.format, "asc", "{name}");
        assert_eq!(content.frames.len(), *frames, "{name}");
        assert_eq!(content.unreadable(), [] as [String; 0], "{name}");
    }
}

#[test]
fn another_programs_trc_is_not_read_as_peaks() {
    if !has_corpus() {
        return;
    }
    let content = read_file(&corpus().join("formats/SavvyCAN__CarBusAnalyzer.trc"));
    assert_eq!(content.format, "carbus");
}

#[test]
fn the_same_traffic_reads_the_same_from_both_formats() {
    if !has_corpus() {
        return;
    }
    let trace = read_file(&corpus().join("formats/mdf4-converters__multiple_CAN.trc"));
    let asc = read_file(&corpus().join("formats/mdf4-converters__multiple_CAN.asc"));
    let start = |content: &Content| content.frames[0].time.unwrap();
    assert_eq!(trace.frames.len(), asc.frames.len());
    for (one, other) in trace.frames.iter().zip(&asc.frames) {
        assert_eq!((one.id, one.data()), (other.id, other.data()), "frame {}", one.number);
        assert_eq!(trace.buses[usize::from(one.bus.0)], asc.buses[usize::from(other.bus.0)]);
        assert_eq!(one.time.unwrap().since(start(&trace)), other.time.unwrap().since(start(&asc)));
        // The ASC does not mark FD; only lengths beyond 8 show it.
        let longer = one.length > 8;
        assert_eq!(other.flags.contains(FrameFlags::FD), longer && one.flags.contains(FrameFlags::FD));
    }
}

/// A frame in the format of `oracles/frames.py`.
#[derive(Debug, Clone, PartialEq)]
pub(crate) struct Row {
    /// Nanoseconds since the first row.
    pub(crate) time: i64,
    pub(crate) channel: String,
    pub(crate) id: String,
    pub(crate) flags: String,
    pub(crate) length: usize,
    pub(crate) data: String,
}

pub(crate) fn our_row(frame: &Frame, start: i64, buses: &[String]) -> Row {
    let letters = [
        (matches!(frame.id, CanId::Extended(_)), 'X'),
        (frame.flags.contains(FrameFlags::REMOTE), 'R'),
        (frame.flags.contains(FrameFlags::FD), 'F'),
        (frame.flags.contains(FrameFlags::BIT_RATE_SWITCH), 'B'),
        (frame.flags.contains(FrameFlags::ERROR_STATE), 'S'),
    ];
    let flags: String = letters.iter().filter(|(on, _)| *on).map(|(_, letter)| *letter).collect();
    let data = frame.data().iter().fold(String::new(), |text, byte| format!("{text}{byte:02X}"));
    let row = Row {
        time: frame.time.unwrap().0 - start,
        channel: buses[usize::from(frame.bus.0)].clone(),
        id: frame.id.to_string(),
        flags: if flags.is_empty() { "-".into() } else { flags },
        length: frame.length.into(),
        data: if data.is_empty() { "-".into() } else { data },
    };
    if !is_error(frame) {
        return row;
    }
    // python-can reads no contents of an error frame.
    Row { id: "00000000".into(), flags: "E".into(), length: 0, data: "-".into(), ..row }
}

pub(crate) fn their_rows(text: &str, is_asc: bool) -> Vec<Row> {
    let mut rows: Vec<Row> = text
        .lines()
        .map(|line| {
            let [time, channel, id, flags, length, data] = line.split('\t').collect::<Vec<_>>()[..] else {
                panic!("not six columns: {line}")
            };
            let (seconds, fraction) = time.split_once('.').unwrap();
            // python-can counts the channels of ASC from 0.
            let channel = channel.parse::<u8>().unwrap() + u8::from(is_asc);
            Row {
                time: seconds.parse::<i64>().unwrap() * 1_000_000_000 + fraction.parse::<i64>().unwrap(),
                channel: channel.to_string(),
                id: id.into(),
                flags: flags.into(),
                length: length.parse().unwrap(),
                data: data.into(),
            }
        })
        .collect();
    let start = rows.first().map_or(0, |row| row.time);
    for row in &mut rows {
        row.time -= start;
    }
    rows
}

/// Corrects known errors of python-can 4.6, as far as its row permits.
fn put_right(row: Row, ours: &Row, raw_dlc: u8) -> Row {
    let mut row = row;
    let only_marked_fd = row.flags.contains('F') && !ours.flags.contains('F');
    // It marks every CANFD line as FD, but error frames and remote frames never are.
    if only_marked_fd && (ours.flags.contains('R') || ours.flags == "E") {
        row.flags = row.flags.replace(['F', 'B', 'S'], "");
    }
    // Classic lines with a DLC above 8: it truncates the data to eight bytes and does not mark the frames as
    // FD. It derives the length from the DLC as for FD, or uses 64 if it reads the DLC in the wrong base.
    let (its, all) = (row.data.len(), ours.data.len());
    let cut = its == 16 && all > 16 && ours.data.starts_with(&row.data) && !row.flags.contains('F');
    let expanded = raw_dlc > 8 && ours.data == row.data && row.length > 8;
    if cut {
        row = Row { data: ours.data.clone(), flags: ours.flags.clone(), ..row };
    }
    // For FD frames in traces its length is the DLC.
    let dlc = u8::try_from(row.length).unwrap_or(u8::MAX);
    let is_dlc = row.flags.contains('F')
        && dlc > 8
        && ours.data == row.data
        && usize::from(fd_length(dlc)) == ours.length;
    if cut || expanded || is_dlc {
        row.length = ours.length;
    }
    row
}

fn compare(name: &str, content: &Content, theirs: &[Row], skipped: usize) {
    // It does not read PEAK's reports of the bus.
    let is_trc = content.format == "trc";
    let frames: Vec<&Frame> =
        content.frames.iter().filter(|frame| !(is_trc && is_error(frame))).skip(skipped).collect();
    assert_eq!(frames.len(), theirs.len(), "{name}");
    let start = frames[0].time.unwrap().0;
    for (frame, theirs) in frames.iter().zip(theirs) {
        let ours = our_row(frame, start, &content.buses);
        let theirs = put_right(theirs.clone(), &ours, frame.raw_dlc);
        // Times of python-can are doubles with a resolution of about 0.25 µs for current dates.
        assert!((ours.time - theirs.time).abs() <= 1_000, "{name}: {ours:?} {theirs:?}");
        assert_eq!(ours, Row { time: ours.time, ..theirs }, "{name}");
    }
}

#[test]
fn python_can_reads_the_same_frames() {
    if !has_corpus() {
        return;
    }
    let script = workspace().join("tests/oracles/frames.py");
    let Some(python) = python().filter(|_| script.exists()) else {
        skip("python", "no Python with tests/oracles/requirements.txt");
        return;
    };
    let names = TRACES.iter().map(|(name, _, _)| name).chain(ASC.iter().map(|(name, _)| name));
    for name in names.filter(|name| is_readable(name)) {
        let path = corpus().join(name);
        let output = Command::new(&python).arg(&script).arg(&path).output().unwrap();
        assert!(output.status.success(), "{name}: {}", String::from_utf8_lossy(&output.stderr));
        let content = read_file(&path);
        let theirs = their_rows(std::str::from_utf8(&output.stdout).unwrap(), content.format == "asc");
        compare(name, &content, &theirs, usize::from(FIRST_FRAME_LOST.contains(name)));
    }
}

const TRACE: &str = ";$FILEVERSION=2.1\r
;$STARTTIME=44548.6028595139\r
;$COLUMNS=N,O,T,B,I,d,R,L,D\r
;\r
      1     17535.400 DT 1  00000100 Tx -  8    00 01 02 03 04 05 06 07\r
      2     17540.300 ST 1         - Rx -  4    00 00 00 08\r
      3     17541.300 ER 1         - Rx -  5    04 00 02 00 00\r
      4     17700.300 FB 2      0601 Tx -  9    00 01 02 03 04 05 06 07 08 09 0A 0B\r
      5     17701.000 EV -  something the user said\r
      6     48937.600 RR 1      0704 Rx -  1\r
";

const LOG: &str = "date Sam Sep 30 03:06:13.191 pm 2017
base hex  timestamps absolute
internal events logged
// version 9.0.0
Begin Triggerblock Sam Sep 30 03:06:13.191 pm 2017
   0.000000 Start of measurement
   1.015991 1  Statistic: D 0 R 0 XD 0 XR 0 E 0 O 0 B 0.00%
   2.501010 1 ErrorFrame ECC: 10100010
   2.501020 2 ErrorFrame Flags = 0xe CodeExt = 0x20a2 Code = 0x82 ID = 0 DLC = 0
   2.584921 4 300             Tx   r 8 Length = 1704000 BitCount = 145 ID = 300x
   3.098426 1  18EBFF00x       Rx   d 8 01 A0 0F A6 60 3B D1 40    Length = 273910 BitCount = 141
  30.005071 CANFD   2 Rx        300  Name  1 0 9  12 01 02 03 04 05 06 07 08 09 0A 0B 0C   102203  133   303000
  30.300981 CANFD   3 Tx     50005x        0 0 5 0 140000 73 200050 7a60
End TriggerBlock
";

/// A reader that returns its bytes in parts of the given sizes, repeatedly.
struct Pieces<'a> {
    rest: &'a [u8],
    sizes: std::iter::Cycle<std::slice::Iter<'a, usize>>,
}

impl Read for Pieces<'_> {
    fn read(&mut self, buffer: &mut [u8]) -> std::io::Result<usize> {
        let size = (*self.sizes.next().unwrap_or(&1)).min(buffer.len()).min(self.rest.len());
        let (now, rest) = self.rest.split_at(size);
        buffer[..size].copy_from_slice(now);
        self.rest = rest;
        Ok(size)
    }
}

/// `text` with some bytes replaced.
fn mutated(text: &'static str) -> impl Strategy<Value = Vec<u8>> {
    let edits = prop::collection::vec((0..text.len(), any::<u8>()), 0..24);
    edits.prop_map(move |edits| {
        let mut bytes = text.as_bytes().to_vec();
        for (at, byte) in edits {
            bytes[at] = byte;
        }
        bytes
    })
}

/// A recognised header, followed by random bytes.
pub(crate) fn anything_behind(header: &'static str) -> impl Strategy<Value = Vec<u8>> {
    let printable =
        prop::collection::vec(prop::sample::select(&b" \t\n;.0189AFdxr-RxTxERRTR/"[..]), 0..2_000);
    let random = prop::collection::vec(any::<u8>(), 0..2_000);
    prop_oneof![printable, random].prop_map(move |tail| [header.as_bytes(), &tail].concat())
}

/// The content does not depend on the division of the bytes, and nothing panics.
pub(crate) fn reads_alike(bytes: &[u8], sizes: &[usize]) -> Result<(), TestCaseError> {
    let whole = read(bytes);
    let pieces = read(Pieces { rest: bytes, sizes: sizes.iter().cycle() });
    match (whole, pieces) {
        (Ok(whole), Ok(pieces)) => prop_assert_eq!(whole, pieces),
        (Err(whole), Err(pieces)) => prop_assert_eq!(whole.to_string(), pieces.to_string()),
        (whole, pieces) => prop_assert!(false, "{whole:?} in one piece, {pieces:?} in several"),
    }
    Ok(())
}

proptest! {
    #![proptest_config(ProptestConfig { cases: 200, failure_persistence: None, ..ProptestConfig::default() })]

    #[test]
    fn broken_traces_read_alike_in_pieces(
        bytes in prop_oneof![mutated(TRACE), anything_behind(";$FILEVERSION=1.1\n")],
        sizes in prop::collection::vec(1_usize..300, 1..8),
    ) {
        reads_alike(&bytes, &sizes)?;
    }

    #[test]
    fn broken_asc_reads_alike_in_pieces(
        bytes in prop_oneof![mutated(LOG), anything_behind("base hex  timestamps relative\n")],
        sizes in prop::collection::vec(1_usize..300, 1..8),
    ) {
        reads_alike(&bytes, &sizes)?;
    }
}

#[test]
fn the_samples_above_are_sound() {
    let trace = read(TRACE.as_bytes()).unwrap();
    assert_eq!((trace.format, trace.frames.len(), trace.buses.len()), ("trc", 5, 2));
    assert_eq!(trace.unreadable(), [] as [String; 0]);
    let log = read(LOG.as_bytes()).unwrap();
    assert_eq!((log.format, log.frames.len(), log.buses.len()), ("asc", 6, 4));
    assert_eq!(log.unreadable(), [] as [String; 0]);
}

#[test]
fn text_parsers_take_some_of_the_largest_record_whatever_it_is() {
    for format in FORMATS.iter().filter(|format| format.is_text) {
        for byte in *b"x;0\r \t\xFF" {
            let bytes = vec![byte; LARGEST_RECORD];
            let mut batch = Batch::new();
            let mut parser = (format.parser)(&ReadOptions::default());
            assert!(parser.parse(&bytes, false, &mut batch).unwrap() > 0, "{} {byte:#x}", format.name);
            batch.clear();
            let mut parser = (format.parser)(&ReadOptions::default());
            assert_eq!(parser.parse(&[byte], true, &mut batch).unwrap(), 1, "{} {byte:#x}", format.name);
        }
    }
}
