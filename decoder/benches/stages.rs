//! Frames per second of each stage, compared with counting the newlines of the same file.
//!
//! ```text
//! cargo bench -p cobscope-decoder                   # 1,000,000 frames, 7 rounds
//! cargo bench -p cobscope-decoder -- 10000000 5     # frames, rounds
//! cargo bench -p cobscope-decoder -- findings       # only stages with this text in their names
//! ```
//!
//! Each round runs all stages in turn, so that other load on the machine affects all of them; the
//! median is printed. Times are CPU time if the system provides it (Linux), otherwise elapsed time.

#![expect(clippy::disallowed_methods, reason = "opens its own files and measures time")]

mod machine;

use std::collections::BTreeMap;
use std::fs::File;
use std::hint::black_box;
use std::io::{self, BufWriter, Read, Write};
use std::path::{Path, PathBuf};
use std::sync::{Arc, OnceLock};
use std::time::{Duration, Instant};

use cobscope_decoder::Reading;
use cobscope_decoder::capture::{
    Batch, CaptureCompression, CaptureReader, ReadOptions, WRITABLE, WriteOptions,
};
use cobscope_decoder::decoder::Decoder;
use cobscope_decoder::event::Event;
use cobscope_decoder::frame::Frame;
use cobscope_decoder::profile::{Catalogue, ProfileError};
use cobscope_decoder::session::{AssignedBy, Assignment, Bus, Observer, SessionOptions};
use cobscope_decoder::sink::EventSink as _;
use cobscope_decoder::sink::jsonl::JsonlSink;
use cobscope_decoder::sink::text::{TextOptions, TextSink};
use machine::devices::{DEVICES, Devices};
use machine::engine::Engine;
use machine::formats::Format;
use machine::{Machine, Message, Options};

/// Bytes read at a time when newlines are counted.
const CHUNK: usize = 256 * 1024;

/// Size of the output buffer of the sinks in bytes.
const OUTPUT: usize = 64 * 1024;

type Outcome = Result<(), Box<dyn std::error::Error>>;

/// Number of frames that are written repeatedly: few enough to fit into the cache, so that only writing is
/// measured.
const WRITTEN: usize = 2_048;

/// The captures, all with the same number of frames.
struct Captures {
    normal: PathBuf,
    mapped: PathBuf,
    storm: PathBuf,
    pcap: PathBuf,
    pcapng: PathBuf,
    mcap: PathBuf,
    columns: PathBuf,
    cells: PathBuf,
    devices: PathBuf,
    engine: PathBuf,
    frames: usize,
    /// The first frames of the normal capture.
    first: Vec<Frame>,
}

/// Runs a stage on the captures.
type Run = fn(&Captures) -> Outcome;

struct Stage {
    name: &'static str,
    run: Run,
    times: Vec<Duration>,
}

/// Name of the stage that all others are compared with.
const FLOOR: &str = "newline count";

const STAGES: [(&str, Run); 35] = [
    (FLOOR, |captures| count_newlines(&captures.normal)),
    ("candump, frames only", |captures| read(&captures.normal)),
    ("candump to events", |captures| decode(&captures.normal, &mut ignore)),
    ("candump to findings", |captures| judge(&captures.normal, SessionOptions::default())),
    ("J1939 to events", |captures| decode(&captures.engine, &mut ignore)),
    ("J1939 to findings", |captures| judge(&captures.engine, SessionOptions::default())),
    ("candump to JSON Lines", |captures| decode(&captures.normal, &mut ToJsonl(JsonlSink::new(output())))),
    ("candump to text", |captures| decode(&captures.normal, &mut to_text())),
    ("known mappings to JSON Lines", |captures| {
        decode(&captures.mapped, &mut ToJsonl(JsonlSink::new(output())))
    }),
    ("fault storm to events", |captures| decode(&captures.storm, &mut ignore)),
    ("fault storm to findings", |captures| judge(&captures.storm, SessionOptions::default())),
    ("fault storm to text", |captures| decode(&captures.storm, &mut to_text())),
    ("devices to events, plain", |captures| decode(&captures.devices, &mut ignore)),
    ("devices to events, profiles", |captures| decode_with(&captures.devices, profiles()?, &mut ignore)),
    ("devices to findings, profiles", |captures| judge(&captures.devices, profiles()?)),
    ("devices to text, plain", |captures| decode(&captures.devices, &mut to_text())),
    ("devices to text, profiles", |captures| decode_with(&captures.devices, profiles()?, &mut to_text())),
    ("pcap, frames only", |captures| read(&captures.pcap)),
    ("pcap to events", |captures| decode(&captures.pcap, &mut ignore)),
    ("pcapng, frames only", |captures| read(&captures.pcapng)),
    ("pcapng to events", |captures| decode(&captures.pcapng, &mut ignore)),
    ("write candump", |captures| rewrite(captures, "candump", CaptureCompression::None)),
    ("write pcapng", |captures| rewrite(captures, "pcapng", CaptureCompression::None)),
    ("write asc", |captures| rewrite(captures, "asc", CaptureCompression::None)),
    ("write trc", |captures| rewrite(captures, "trc", CaptureCompression::None)),
    ("write csv", |captures| rewrite(captures, "csv", CaptureCompression::None)),
    ("write MCAP, not packed", |captures| rewrite(captures, "mcap", CaptureCompression::None)),
    ("write MCAP, lz4", |captures| rewrite(captures, "mcap", CaptureCompression::Lz4)),
    ("write MCAP, zstd", |captures| rewrite(captures, "mcap", CaptureCompression::Zstd)),
    ("mcap crate alone, not packed", |captures| crate_alone(captures, None)),
    ("mcap crate alone, lz4", |captures| crate_alone(captures, Some(mcap::Compression::Lz4))),
    ("mcap crate alone, zstd", |captures| crate_alone(captures, Some(mcap::Compression::Zstd))),
    ("MCAP, zstd, frames only", |captures| read(&captures.mcap)),
    ("inferred columns, frames only", |captures| read(&captures.columns)),
    ("inferred cells, frames only", |captures| read(&captures.cells)),
];

fn main() -> Outcome {
    // `cargo bench` adds its own options; use only numbers and parts of names.
    let arguments: Vec<String> = std::env::args().skip(1).filter(|it| !it.starts_with('-')).collect();
    let (numbers, wanted): (Vec<_>, Vec<_>) = arguments.iter().partition(|it| it.parse::<usize>().is_ok());
    let mut numbers = numbers.into_iter().filter_map(|number| number.parse::<usize>().ok());
    let frames = numbers.next().unwrap_or(1_000_000).max(1);
    let rounds = numbers.next().unwrap_or(7).max(1);
    let captures = captures(Path::new(env!("CARGO_TARGET_TMPDIR")), frames)?;
    let is_wanted = |name: &str| wanted.is_empty() || wanted.iter().any(|part| name.contains(part.as_str()));
    let stages = STAGES.into_iter().filter(|(name, _)| *name == FLOOR || is_wanted(name));
    let mut stages: Vec<_> = stages.map(|(name, run)| Stage { name, run, times: Vec::new() }).collect();
    for _ in 0..=rounds {
        for stage in &mut stages {
            let begin = now();
            (stage.run)(&captures)?;
            stage.times.push(now().saturating_sub(begin));
        }
    }
    for stage in &mut stages {
        // The first round only warms the caches.
        stage.times.remove(0);
        stage.times.sort_unstable();
    }
    report(&stages, frames, rounds)?;
    Ok(())
}

fn report(stages: &[Stage], frames: usize, rounds: usize) -> io::Result<()> {
    let median = |stage: &Stage| {
        stage.times.get(stage.times.len() / 2).map_or(0.0, |time| nanoseconds(*time) / count(frames))
    };
    let floor = stages.first().map_or(1.0, median);
    let mut out = io::stdout().lock();
    writeln!(out, "{frames} frames, median of {rounds} rounds")?;
    writeln!(out, "{:<30} {:>9} {:>10} {:>15}", "stage", "ns/frame", "M frames/s", "newline counts")?;
    for stage in stages {
        let time = median(stage);
        writeln!(out, "{:<30} {time:>9.1} {:>10.1} {:>15.1}", stage.name, 1_000.0 / time, time / floor)?;
    }
    Ok(())
}

#[expect(clippy::cast_precision_loss, reason = "far below 2^52")]
fn nanoseconds(time: Duration) -> f64 {
    time.as_nanos() as f64
}

#[expect(clippy::cast_precision_loss, reason = "far below 2^52")]
fn count(frames: usize) -> f64 {
    frames as f64
}

/// CPU time of this thread; the system updates it when the thread yields.
fn now() -> Duration {
    std::thread::yield_now();
    std::fs::read_to_string("/proc/thread-self/schedstat")
        .ok()
        .and_then(|text| text.split_whitespace().next()?.parse().ok())
        .filter(|time| *time > 0)
        .map_or_else(wall, Duration::from_nanos)
}

fn wall() -> Duration {
    static BEGIN: OnceLock<Instant> = OnceLock::new();
    BEGIN.get_or_init(Instant::now).elapsed()
}

fn captures(folder: &Path, frames: usize) -> io::Result<Captures> {
    let normal = Options { seed: 1, storm: false, mapping: false };
    let write = |name: &str, format: Format, options| {
        write(&folder.join(name), format, Machine::new(options).take(frames))
    };
    let normal_path = write("normal.log", Format::Candump, normal)?;
    Ok(Captures {
        frames,
        first: first(&normal_path)?,
        mcap: to_mcap(&normal_path, &folder.join("normal.mcap"))?,
        columns: to_layout(&normal_path, &folder.join("columns.txt"), ' ')?,
        cells: to_layout(&normal_path, &folder.join("cells.txt"), ';')?,
        normal: normal_path,
        mapped: write("mapped.log", Format::Candump, Options { mapping: true, ..normal })?,
        storm: write("storm.log", Format::Candump, Options { storm: true, ..normal })?,
        pcap: write("normal.pcap", Format::Pcap, normal)?,
        pcapng: write("normal.pcapng", Format::Pcapng, normal)?,
        devices: self::write(&folder.join("devices.log"), Format::Candump, Devices::new(1).take(frames))?,
        engine: self::write(&folder.join("engine.log"), Format::Candump, Engine::new(1).take(frames))?,
    })
}

fn write(path: &Path, format: Format, messages: impl Iterator<Item = Message>) -> io::Result<PathBuf> {
    let mut out = BufWriter::with_capacity(CHUNK, File::create(path)?);
    format.begin(&mut out)?;
    for message in messages {
        format.write(&message, &mut out)?;
    }
    out.flush()?;
    Ok(path.to_owned())
}

/// Writes the frames of the capture as text without a known format: with blanks between the columns, or with names and cells.
fn to_layout(from: &Path, to: &Path, separator: char) -> io::Result<PathBuf> {
    let mut reader =
        CaptureReader::open(File::open(from)?, &ReadOptions::default()).map_err(io::Error::other)?;
    let mut out = BufWriter::with_capacity(CHUNK, File::create(to)?);
    if separator != ' ' {
        writeln!(out, "Time [s]{separator}Dir{separator}ID{separator}Len{separator}Data")?;
    }
    let mut batch = Batch::new();
    while reader.read(&mut batch).map_err(io::Error::other)? {
        for frame in batch.frames() {
            let time = frame.time.unwrap_or_default().0 / 1_000;
            let (seconds, fraction) = (time / 1_000_000, time % 1_000_000);
            write!(out, "{seconds}.{fraction:06}{separator}Rx{separator}{:X}", frame.id.number())?;
            write!(out, "{separator}{}", frame.length)?;
            for (index, byte) in frame.data().iter().enumerate() {
                let before = if index == 0 { separator } else { ' ' };
                write!(out, "{before}{byte:02X}")?;
            }
            writeln!(out)?;
        }
    }
    out.flush()?;
    Ok(to.to_owned())
}

/// Converts the capture to MCAP.
fn to_mcap(from: &Path, to: &Path) -> io::Result<PathBuf> {
    let format = WRITABLE.iter().find(|format| format.name == "mcap");
    let format = format.ok_or_else(|| io::Error::other("this build cannot write MCAP"))?;
    let output = Box::new(BufWriter::with_capacity(CHUNK, File::create(to)?));
    let mut writer = (format.writer)(output, &WriteOptions::default());
    let mut reader =
        CaptureReader::open(File::open(from)?, &ReadOptions::default()).map_err(io::Error::other)?;
    let mut batch = Batch::new();
    while reader.read(&mut batch).map_err(io::Error::other)? {
        for frame in batch.frames() {
            writer.write(frame, "can0")?;
        }
    }
    writer.finish()?;
    Ok(to.to_owned())
}

/// All devices of the hydraulic machine with their profiles. The time to read profiles is part of the
/// start-up, which `benches/run` measures.
fn profiles() -> Result<SessionOptions, Box<dyn std::error::Error>> {
    static CATALOGUE: OnceLock<Catalogue> = OnceLock::new();
    let catalogue = CATALOGUE.get_or_init(Catalogue::default);
    let assign = |(node, id): (u8, &str)| {
        let device = catalogue.device(id)?;
        Ok(Assignment { bus: None, node: node.into(), device, by: AssignedBy::Option })
    };
    let assignments = DEVICES.into_iter().map(assign).collect::<Result<_, ProfileError>>()?;
    Ok(SessionOptions { assignments, ..SessionOptions::default() })
}

fn count_newlines(path: &Path) -> Outcome {
    let mut file = File::open(path)?;
    let mut buffer = vec![0; CHUNK];
    let mut lines = 0;
    loop {
        let count = file.read(&mut buffer)?;
        if count == 0 {
            black_box(lines);
            return Ok(());
        }
        lines += memchr::memchr_iter(b'\n', buffer.get(..count).unwrap_or_default()).count();
    }
}

fn read(path: &Path) -> Outcome {
    let mut reader = CaptureReader::open(File::open(path)?, &ReadOptions::default())?;
    let mut batch = Batch::new();
    while reader.read(&mut batch)? {
        black_box(batch.frames());
    }
    Ok(())
}

/// Reads the first frames of a capture.
fn first(path: &Path) -> io::Result<Vec<Frame>> {
    let mut reader =
        CaptureReader::open(File::open(path)?, &ReadOptions::default()).map_err(io::Error::other)?;
    let (mut batch, mut frames) = (Batch::new(), Vec::new());
    while frames.len() < WRITTEN && reader.read(&mut batch).map_err(io::Error::other)? {
        frames.extend_from_slice(batch.frames());
    }
    frames.truncate(WRITTEN);
    Ok(frames)
}

/// Writes the same number of frames as in the captures.
fn rewrite(captures: &Captures, name: &str, packing: CaptureCompression) -> Outcome {
    let mut known = WRITABLE.iter();
    let format = known.find(|format| format.name == name).ok_or("no such format")?;
    let output = Box::new(BufWriter::with_capacity(OUTPUT, io::sink()));
    let mut writer = (format.writer)(output, &WriteOptions { packing, ..WriteOptions::default() });
    for frame in captures.first.iter().cycle().take(captures.frames) {
        writer.write(black_box(frame), "can0")?;
    }
    Ok(writer.finish()?)
}

/// Writes the same number of messages of the same size with the `mcap` crate only; the difference is the cost
/// of our code.
fn crate_alone(captures: &Captures, compression: Option<mcap::Compression>) -> Outcome {
    let output = BufWriter::with_capacity(OUTPUT, io::sink());
    let mut writer = mcap::WriteOptions::new()
        .compression_level(u32::from(matches!(compression, Some(mcap::Compression::Zstd))))
        .compression(compression)
        .compression_threads(0)
        .chunk_size(Some(1024 * 1024))
        .calculate_data_section_crc(false)
        .disable_seeking(true)
        .create(mcap::write::NoSeek::new(output))?;
    let schema = writer.add_schema("frame", "ros2msg", b"")?;
    let channel_id = writer.add_channel(schema, "/can", "cdr", &BTreeMap::new())?;
    let mut message = Vec::with_capacity(41);
    for (sequence, frame) in (0..).zip(captures.first.iter().cycle().take(captures.frames)) {
        message.clear();
        message.extend_from_slice(&[0; 29]);
        message.extend_from_slice(&frame.id.number().to_le_bytes());
        message.extend_from_slice(frame.bytes.first_chunk::<8>().unwrap_or(&[0; 8]));
        let time = frame.time.map_or(0, |time| time.0.cast_unsigned());
        let header =
            mcap::records::MessageHeader { channel_id, sequence, log_time: time, publish_time: time };
        writer.write_to_known_channel(&header, black_box(&message))?;
    }
    writer.finish()?;
    Ok(())
}

fn decode(path: &Path, out: &mut dyn Observer) -> Outcome {
    decode_with(path, SessionOptions::default(), out)
}

fn decode_with(path: &Path, options: SessionOptions, out: &mut dyn Observer) -> Outcome {
    let mut reader = CaptureReader::open(File::open(path)?, &ReadOptions::default())?;
    let mut decoder = Decoder::new(options);
    let mut batch = Batch::new();
    while reader.read(&mut batch)? {
        if !batch.notices().is_empty() {
            return Err("the generated capture has unreadable lines".into());
        }
        for frame in batch.frames() {
            decoder.push(frame, reader.buses(), out);
        }
    }
    decoder.finish_capture(reader.buses(), out);
    Ok(())
}

/// Decodes and checks with all rules.
fn judge(path: &Path, options: SessionOptions) -> Outcome {
    let mut reading = Reading::of_options(options, Some(Arc::default()), ignore);
    reading.run(File::open(path)?)?;
    black_box(reading.finish().findings);
    Ok(())
}

fn ignore(event: &Event, _: &Bus) {
    black_box(event);
}

/// Output of the sinks: buffered as in the program, then dropped.
fn output() -> Box<dyn Write> {
    Box::new(BufWriter::with_capacity(OUTPUT, io::sink()))
}

struct ToJsonl(JsonlSink<Box<dyn Write>>);

impl Observer for ToJsonl {
    fn on_event(&mut self, event: &Event, bus: &Bus) {
        self.0.write_event(event, bus);
    }
}

struct ToText(TextSink<Box<dyn Write>>);

fn to_text() -> ToText {
    ToText(TextSink::new(output(), TextOptions::default()))
}

impl Observer for ToText {
    fn on_event(&mut self, event: &Event, bus: &Bus) {
        self.0.write_event(event, bus);
    }
}
