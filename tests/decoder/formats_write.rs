//! Written captures read by other programs: python-can and tshark find the same frames, and the comments.

#![expect(clippy::panic, reason = "helpers of tests fail so")]

use std::fs::{self, File};
use std::io::BufReader;
use std::path::{Path, PathBuf};
use std::process::Command;

use cobscope_decoder::capture::{
    Batch, CaptureReader, LossCounter, ReadOptions, WRITABLE, WritableFormat, WriteOptions, decompress,
};
use cobscope_decoder::frame::{CanId, Frame, FrameFlags, Timestamp, fd_length};

use crate::support::{corpus, is_readable, python, skip, workspace};

/// Our own captures with every kind of frame.
const FIXTURES: &[&str] = &[
    "dialects/candump_L.log",
    "dialects/candump_L_8.log",
    "dialects/candump_L_ns.log",
    "dialects/candump_L_x.log",
    "canopen/error_frames.log",
    "canopen/sdo_block_upload.log",
];

/// Captures of other projects: real traffic, FD, error frames, several buses.
const CORPUS: &[&str] = &[
    "canopen/canopen-message-interpreter__pcan2.trc",
    "formats/mdf4-converters__multiple_CAN.trc",
    "formats/python-can__logfile.asc",
    "formats/python-can__test_CanFdMessage64.asc",
    "formats/python-can__test_CanErrorFrames.asc",
    "formats/python-can__test_CanMessage_V2_1.trc",
    "j1939/remora_ctrl_proto__candump-2021-07-21_220402-15-seconds-engine-on-big-truck.log",
];

/// Max frames per capture, because the oracles are slow.
const MOST: usize = 1_500;

/// Frames with the names of their buses.
struct Recording {
    name: String,
    frames: Vec<Frame>,
    buses: Vec<String>,
}

impl Recording {
    fn read(path: &Path) -> Self {
        let name = path.file_name().unwrap().to_string_lossy().into_owned();
        let file = File::open(path).unwrap_or_else(|error| panic!("{}: {error}", path.display()));
        let source = decompress(BufReader::new(file)).unwrap();
        let mut reader = CaptureReader::open(source, &ReadOptions::default()).unwrap();
        let (mut batch, mut frames) = (Batch::new(), Vec::new());
        while reader.read(&mut batch).unwrap() {
            frames.extend_from_slice(batch.frames());
        }
        frames.truncate(MOST);
        let used = frames.iter().map(|frame| usize::from(frame.bus.0) + 1).max().unwrap_or(0);
        Self { name, frames, buses: reader.buses().names()[..used].to_vec() }
    }

    fn bus(&self, frame: &Frame) -> &str {
        &self.buses[usize::from(frame.bus.0)]
    }

    /// Writes the capture with a comment on every fifth frame.
    fn write(&self, format: &WritableFormat) -> PathBuf {
        let folder = Path::new(env!("CARGO_TARGET_TMPDIR")).join("formats_write");
        fs::create_dir_all(&folder).unwrap();
        let path = folder.join(format!("{}.{}", self.name, format.suffix));
        let output = Box::new(File::create(&path).unwrap());
        let mut writer = (format.writer)(output, &WriteOptions::default());
        for (index, frame) in self.frames.iter().enumerate() {
            match comment(index) {
                Some(comment) => writer.write_commented(frame, self.bus(frame), &comment).unwrap(),
                None => writer.write(frame, self.bus(frame)).unwrap(),
            }
        }
        writer.finish().unwrap();
        path
    }

    /// Removes frames that another program cannot read.
    fn without(mut self, is_bad: impl Fn(&Frame) -> bool) -> Self {
        self.frames.retain(|frame| !is_bad(frame));
        self
    }
}

fn comment(index: usize) -> Option<String> {
    index.is_multiple_of(5).then(|| format!("frame {index}: 1.5 °C, \"so\""))
}

fn recordings() -> Vec<Recording> {
    let fixtures = FIXTURES.iter().map(|name| workspace().join("fixtures").join(name));
    let mut paths: Vec<PathBuf> = fixtures.collect();
    if corpus().join("README.md").exists() {
        let names = CORPUS.iter().filter(|name| is_readable(name));
        paths.extend(names.map(|name| corpus().join(name)));
    } else {
        skip("corpus", "no captures of other projects");
    }
    paths.iter().map(|path| Recording::read(path)).collect()
}

fn format(name: &str) -> &'static WritableFormat {
    WRITABLE.iter().find(|format| format.name == name).unwrap()
}

/// A frame as the oracles print it.
#[derive(Debug, Clone, PartialEq)]
struct Row {
    /// Nanoseconds since the first row.
    time: i64,
    channel: String,
    id: String,
    flags: String,
    length: usize,
    data: String,
}

fn is(frame: &Frame, flag: FrameFlags) -> bool {
    frame.flags.contains(flag)
}

fn row(frame: &Frame, channel: String) -> Row {
    let is_extended = matches!(frame.id, CanId::Extended(_));
    let letters = [
        (is_extended && !is(frame, FrameFlags::ERROR), 'X'),
        (is(frame, FrameFlags::REMOTE), 'R'),
        (is(frame, FrameFlags::ERROR), 'E'),
        (is(frame, FrameFlags::FD), 'F'),
        (is(frame, FrameFlags::BIT_RATE_SWITCH), 'B'),
        (is(frame, FrameFlags::ERROR_STATE), 'S'),
    ];
    let flags: String = letters.iter().filter(|(on, _)| *on).map(|(_, letter)| *letter).collect();
    let data = frame.data().iter().fold(String::new(), |text, byte| format!("{text}{byte:02X}"));
    Row {
        time: frame.time.unwrap().0,
        channel,
        id: frame.id.to_string(),
        flags: if flags.is_empty() { "-".into() } else { flags },
        length: frame.length.into(),
        data: if data.is_empty() { "-".into() } else { data },
    }
}

/// Rows that an oracle prints, with times relative to the first one.
fn rows(text: &str) -> Vec<Row> {
    let rows = text.lines().map(|line| {
        let [time, channel, id, flags, length, data] = line.split('\t').collect::<Vec<_>>()[..] else {
            panic!("not six columns: {line}")
        };
        let (seconds, fraction) = time.split_once('.').unwrap();
        let time = seconds.parse::<i64>().unwrap() * 1_000_000_000 + fraction.parse::<i64>().unwrap();
        let [channel, id, flags, data] = [channel, id, flags, data].map(str::to_owned);
        Row { time, channel, id, flags, length: length.parse().unwrap(), data }
    });
    from_first(rows.collect())
}

fn from_first(mut rows: Vec<Row>) -> Vec<Row> {
    let start = rows.first().map_or(0, |row| row.time);
    for row in &mut rows {
        row.time -= start;
    }
    rows
}

/// Runs an oracle; it must not print errors.
fn oracle(script: &str, python: &Path, path: &Path) -> Vec<Row> {
    let script = workspace().join("tests/oracles").join(script);
    let output = Command::new(python).arg(script).arg(path).output().unwrap();
    assert!(output.status.success(), "{}: {}", path.display(), String::from_utf8_lossy(&output.stderr));
    rows(std::str::from_utf8(&output.stdout).unwrap())
}

fn compare(path: &Path, ours: Vec<Row>, theirs: &[Row], tolerance: i64) {
    let ours = from_first(ours);
    assert_eq!(ours.len(), theirs.len(), "{}", path.display());
    for (ours, theirs) in ours.iter().zip(theirs) {
        assert!((ours.time - theirs.time).abs() <= tolerance, "{}: {ours:?} {theirs:?}", path.display());
        assert_eq!(*ours, Row { time: ours.time, ..theirs.clone() }, "{}", path.display());
    }
}

/// Number of a bus in a format without names.
fn number(recording: &Recording, frame: &Frame) -> usize {
    let mut seen: Vec<u8> = Vec::new();
    for frame in &recording.frames {
        if !seen.contains(&frame.bus.0) {
            seen.push(frame.bus.0);
        }
    }
    1 + seen.iter().position(|bus| *bus == frame.bus.0).unwrap()
}

/// Expected row of python-can 4.6 for a frame in a format, with its known errors; `None` if it omits the
/// frame.
fn as_python_reads(format: &WritableFormat, recording: &Recording, frame: &Frame) -> Option<Row> {
    let kept = format.holds.kept_frame(frame)?;
    let bus = number(recording, frame);
    let is_error = is(&kept, FrameFlags::ERROR);
    match format.name {
        "asc" => {
            let row = row(&kept, (bus - 1).to_string());
            if is_error {
                // It omits overload frames, and reads no contents of other error frames.
                let is_overload = kept.data().get(2).is_some_and(|bits| bits & 0x20 != 0);
                let mark =
                    Row { id: "00000000".into(), flags: "E".into(), length: 0, data: "-".into(), ..row };
                return (!is_overload).then_some(mark);
            }
            // It treats a DLC above 8 as that of an FD frame, and an FD frame without data as a remote frame.
            let is_empty_fd = is(&kept, FrameFlags::FD) && kept.length == 0;
            let marks = if row.flags == "-" { String::new() } else { row.flags.clone() };
            let flags = match (is_empty_fd, marks.strip_prefix('X')) {
                (true, Some(rest)) => format!("XR{rest}"),
                (true, None) => format!("R{marks}"),
                (false, _) => row.flags.clone(),
            };
            let is_remote = is(&kept, FrameFlags::REMOTE);
            let length = match kept.raw_dlc {
                9.. if is_remote => kept.raw_dlc.into(),
                dlc @ 9.. => fd_length(dlc).into(),
                _ => row.length,
            };
            Some(Row { flags, length, ..row })
        }
        "trc" => {
            // It omits reports of the bus; its length is the DLC.
            let row = row(&kept, bus.to_string());
            let dlc = (0..=15).find(|dlc| fd_length(*dlc) == kept.length).unwrap();
            let dlc = if kept.raw_dlc > 8 { kept.raw_dlc } else { dlc };
            (!is_error).then_some(Row { length: dlc.into(), ..row })
        }
        _ => Some(row(&kept, recording.bus(frame).to_owned())),
    }
}

#[test]
fn python_can_reads_what_is_written() {
    let Some(python) = python() else {
        return skip("python", "no Python with tests/oracles/requirements.txt");
    };
    for name in ["asc", "trc", "candump"] {
        let format = format(name);
        for recording in recordings() {
            // In candump text it misreads error frames and rejects raw DLCs.
            let is_bad = |frame: &Frame| is(frame, FrameFlags::ERROR) || frame.raw_dlc > 8;
            let recording =
                if name == "candump" { recording.without(is_bad) } else { recording.without(|_| false) };
            let path = recording.write(format);
            let frames = recording.frames.iter();
            let ours: Vec<Row> =
                frames.filter_map(|frame| as_python_reads(format, &recording, frame)).collect();
            // Times of python-can are doubles with a resolution of about 0.25 µs for current dates.
            compare(&path, ours, &oracle("frames.py", &python, &path), 1_000);
        }
    }
}

fn has_tshark() -> bool {
    let found = Command::new("tshark").arg("-v").output().is_ok();
    if !found {
        skip("tshark", "the program is missing");
    }
    found
}

#[test]
fn tshark_reads_what_is_written() {
    let python = python().unwrap_or_else(|| "python3".into());
    if !has_tshark() {
        return;
    }
    for recording in recordings() {
        let path = recording.write(format("pcapng"));
        let ours = recording.frames.iter().map(|frame| row(frame, recording.bus(frame).to_owned()));
        compare(&path, ours.collect(), &oracle("frames_tshark.py", &python, &path), 0);
        // In candump text it supports neither directions nor raw DLCs nor names, and microseconds at most.
        let mut recording = recording.without(|frame| frame.raw_dlc > 8);
        for frame in &mut recording.frames {
            let directions = FrameFlags::TRANSMITTED.with(FrameFlags::RECEIVED);
            frame.flags = FrameFlags(frame.flags.0 & !directions.0);
            frame.time = frame.time.map(|Timestamp(time)| Timestamp(time / 1_000 * 1_000));
        }
        recording.name.push_str("-plain");
        let path = recording.write(format("candump"));
        let ours = recording.frames.iter().map(|frame| row(frame, "-".to_owned()));
        compare(&path, ours.collect(), &oracle("frames_tshark.py", &python, &path), 0);
    }
}

#[test]
fn tshark_reads_the_comments() {
    if !has_tshark() {
        return;
    }
    for recording in recordings() {
        let path = recording.write(format("pcapng"));
        let mut command = Command::new("tshark");
        command.args(["-Q", "-T", "fields", "-e", "frame.comment", "-r"]).arg(&path);
        let output = command.output().unwrap();
        let comments: Vec<String> =
            String::from_utf8(output.stdout).unwrap().lines().map(Into::into).collect();
        let expected = (0..recording.frames.len()).map(|index| comment(index).unwrap_or_default());
        assert_eq!(comments, expected.collect::<Vec<_>>(), "{}", path.display());
    }
}

#[test]
fn captures_come_back_as_their_format_says() {
    for format in WRITABLE {
        for recording in recordings() {
            let path = recording.write(format);
            let read = Recording::read(&path);
            let mut losses = LossCounter::new(format.holds);
            for frame in &recording.frames {
                losses.count_frame(frame);
            }
            let first = recording.frames[0].time.unwrap();
            let kept = recording.frames.iter().filter_map(|frame| format.holds.kept_frame(frame));
            let kept: Vec<Frame> = kept
                .map(|frame| {
                    let earliest =
                        if format.holds.backwards { None } else { Some(format.holds.round_time(first)) };
                    Frame { time: frame.time.max(earliest), ..frame }
                })
                .collect();
            assert_eq!(read.frames, kept, "{}", path.display());
            assert_eq!(
                losses.loss_texts().is_empty(),
                kept == recording.frames,
                "{}: {:?}",
                path.display(),
                losses.loss_texts()
            );
            assert_eq!(read.buses, recording.buses, "{}", path.display());
        }
    }
}
