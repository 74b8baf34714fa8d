//! What was recorded is read again, whatever the disk does.

use std::collections::BTreeMap;
use std::io::{self, ErrorKind, Write};
use std::path::{Path, PathBuf};
use std::sync::{Arc, Condvar, Mutex, MutexGuard};
use std::time::{Duration, Instant};

use cobscope_decoder::capture::{self, Batch, Notice, Place, ReadOptions, Reader, WRITABLE};
use cobscope_decoder::frame::{BusIndex, CanId, Frame, FrameFlags, LinkState, Timestamp};
use cobscope_decoder::session::SessionOptions;

use super::disk::{Disk, PartFile};
use super::item::{Item, What};
use super::names::Names;
use super::parts::{Limits, Parts, RETRY_AFTER};
use super::*;
use crate::timeline::{Captures, News, Timeline};

/// Bytes of a candump line of [`frame`]: `(1700000000.000001) can0 185#01000000` and its end.
const LINE: usize = 19 + 1 + 4 + 1 + 12 + 1;

/// Longest that a condition is waited for.
const LIMIT: Duration = Duration::from_secs(60);

const UNLIMITED: Limits = Limits { bytes: u64::MAX, time: Duration::MAX, files: usize::MAX };

/// A disk in memory with so much room.
#[derive(Clone)]
struct Memory(Arc<(Mutex<Inner>, Condvar)>);

struct Inner {
    files: BTreeMap<PathBuf, Vec<u8>>,
    room: usize,
    /// Nothing can be made.
    is_gone: bool,
    /// Writing waits.
    is_stuck: bool,
    fails_to_sync: bool,
    /// Others take what is freed.
    is_crowded: bool,
    made: usize,
    syncs: usize,
}

struct MemoryFile(Memory, PathBuf);

impl Memory {
    fn new(room: usize) -> Self {
        Self(Arc::new((
            Mutex::new(Inner {
                files: BTreeMap::new(),
                room,
                is_gone: false,
                is_stuck: false,
                fails_to_sync: false,
                is_crowded: false,
                made: 0,
                syncs: 0,
            }),
            Condvar::new(),
        )))
    }

    fn lock(&self) -> MutexGuard<'_, Inner> {
        self.0.0.lock().unwrap()
    }

    fn set(&self, change: impl FnOnce(&mut Inner)) {
        change(&mut self.lock());
        self.0.1.notify_all();
    }

    fn names(&self) -> Vec<String> {
        self.lock().files.keys().map(|path| path.display().to_string()).collect()
    }

    fn bytes(&self, name: &str) -> Vec<u8> {
        self.lock().files.get(Path::new(name)).unwrap_or_else(|| panic!("there is no {name}")).clone()
    }
}

impl Disk for Memory {
    fn create(&mut self, path: &Path) -> io::Result<Box<dyn PartFile>> {
        let mut inner = self.lock();
        inner.made += 1;
        if inner.is_gone {
            return Err(io::Error::from_raw_os_error(5));
        }
        if inner.files.contains_key(path) {
            return Err(ErrorKind::AlreadyExists.into());
        }
        inner.files.insert(path.to_owned(), Vec::new());
        Ok(Box::new(MemoryFile(self.clone(), path.to_owned())))
    }

    fn remove(&mut self, path: &Path) -> io::Result<()> {
        let mut inner = self.lock();
        let bytes = inner.files.remove(path).ok_or(ErrorKind::NotFound)?;
        if !inner.is_crowded {
            inner.room += bytes.len();
        }
        Ok(())
    }
}

impl Write for MemoryFile {
    fn write(&mut self, bytes: &[u8]) -> io::Result<usize> {
        let Memory(shared) = &self.0;
        let mut inner = shared.1.wait_while(shared.0.lock().unwrap(), |inner| inner.is_stuck).unwrap();
        let count = bytes.len().min(inner.room);
        if count == 0 {
            return Err(io::Error::from_raw_os_error(28));
        }
        inner.room -= count;
        inner.files.get_mut(&self.1).unwrap().extend_from_slice(&bytes[..count]);
        Ok(count)
    }

    fn flush(&mut self) -> io::Result<()> {
        Ok(())
    }
}

impl PartFile for MemoryFile {
    fn sync(&mut self) -> io::Result<()> {
        let mut inner = self.0.lock();
        inner.syncs += 1;
        if inner.fails_to_sync { Err(io::Error::from_raw_os_error(5)) } else { Ok(()) }
    }

    fn cut(&mut self, length: u64) -> io::Result<()> {
        let mut inner = self.0.lock();
        let bytes = inner.files.get_mut(&self.1).unwrap();
        let cut = bytes.len() - usize::try_from(length).unwrap();
        bytes.truncate(bytes.len() - cut);
        inner.room += cut;
        Ok(())
    }
}

fn day() -> DateTime {
    jiff::civil::date(2026, 11, 22).at(7, 30, 51, 0)
}

fn time(number: u32) -> Timestamp {
    Timestamp(1_700_000_000_000_000_000 + i64::from(number) * 1_000)
}

/// The frame of this number.
fn frame(number: u32) -> Frame {
    Frame { time: Some(time(number)), ..Frame::data_frame(CanId::standard(0x185), &number.to_le_bytes()) }
}

fn items(numbers: std::ops::Range<u32>) -> Vec<Item> {
    numbers.map(|number| Item { bus: 0, what: What::Frame(frame(number)) }).collect()
}

fn lost(count: u64) -> Notice {
    Notice::LostFrames { place: Place::Now, bus: BusIndex(0), count: Some(count) }
}

fn link(number: u32, state: LinkState) -> Notice {
    Notice::Link { bus: BusIndex(0), time: time(number), state, bit_rate: Some(250_000) }
}

/// What a capture says, in its order: frames with their buses, and notices; neither place nor index.
#[derive(Debug, PartialEq)]
enum Said {
    Frame(String, Frame),
    Notice(String, Notice),
}

fn read(bytes: &[u8]) -> Vec<Said> {
    if bytes.is_empty() {
        return Vec::new();
    }
    let mut reader = Reader::open(bytes, &ReadOptions::default()).unwrap();
    let (mut batch, mut said) = (Batch::new(), Vec::new());
    while reader.read(&mut batch).unwrap() {
        let names = reader.buses().names();
        said.extend(batch.items().map(|item| match item {
            capture::Item::Frame(frame) => Said::Frame(
                names[usize::from(frame.bus.0)].clone(),
                Frame { number: 0, bus: BusIndex(0), ..*frame },
            ),
            capture::Item::Notice(notice) => of_bus(notice.clone(), names),
        }));
    }
    said
}

fn of_bus(mut notice: Notice, names: &[String]) -> Said {
    let mut name = String::new();
    match &mut notice {
        Notice::LostFrames { place, bus, .. } => {
            name.clone_from(&names[usize::from(bus.0)]);
            (*place, *bus) = (Place::Now, BusIndex(0));
        }
        Notice::Link { bus, .. } => {
            name.clone_from(&names[usize::from(bus.0)]);
            *bus = BusIndex(0);
        }
        _ => (),
    }
    Said::Notice(name, notice)
}

fn frames(said: &[Said]) -> Vec<Frame> {
    said.iter()
        .filter_map(|said| if let Said::Frame(_, frame) = said { Some(*frame) } else { None })
        .collect()
}

fn losses(said: &[Said]) -> u64 {
    let count = |said: &Said| match said {
        Said::Notice(_, Notice::LostFrames { count, .. }) => count.unwrap(),
        _ => 0,
    };
    said.iter().map(count).sum()
}

fn expected(numbers: impl IntoIterator<Item = u32>) -> Vec<Frame> {
    numbers.into_iter().map(frame).collect()
}

fn parts(memory: &Memory, name: &str, is_numbered: bool, limits: Limits) -> Parts {
    let (names, format) = Names::new(Some(Path::new(name)), is_numbered, day()).unwrap();
    Parts::open(Box::new(memory.clone()), names, format, limits).unwrap()
}

fn can0() -> Vec<String> {
    vec!["can0".to_owned()]
}

/// Waits until a record is so far.
fn wait(recorder: &Recorder, is_so_far: impl Fn(&RecordStatus) -> bool) -> RecordStatus {
    let begun = Instant::now();
    loop {
        let status = recorder.status();
        if is_so_far(&status) {
            return status;
        }
        assert!(begun.elapsed() < LIMIT, "{status:?}");
        std::thread::yield_now();
    }
}

fn options(path: &Path) -> RecordOptions {
    RecordOptions { path: Some(path.to_owned()), ..RecordOptions::default() }
}

/// Frames of each kind.
fn kinds() -> Vec<Frame> {
    let with = |flags: FrameFlags, data: &[u8]| Frame {
        flags,
        ..Frame::data_frame(CanId::extended(0x18FE_CA80), data)
    };
    let mut all = vec![
        Frame::data_frame(CanId::standard(0x185), &[1, 2, 3]),
        with(FrameFlags::TRANSMITTED, &[0xFF; 8]),
        with(FrameFlags::RECEIVED, &[]),
        with(FrameFlags::FD.with(FrameFlags::BIT_RATE_SWITCH).with(FrameFlags::ERROR_STATE), &[9; 64]),
        Frame { length: 4, ..with(FrameFlags::REMOTE, &[]) },
        Frame { raw_dlc: 11, ..with(FrameFlags(0), &[7; 8]) },
        Frame { id: CanId::extended(0x20), ..with(FrameFlags::ERROR, &[0, 0, 0, 0, 0, 0, 0, 5]) },
    ];
    for (number, frame) in (1..).zip(&mut all) {
        frame.time = Some(time(number));
    }
    all
}

#[test]
fn what_was_recorded_is_read_again() {
    for format in WRITABLE {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join(format!("run.{}", format.suffix));
        let mut recorder = Recorder::open(&options(&path), day()).unwrap();
        let holds_notices = format.name == "pcapng";
        let mut said = Vec::new();
        for (number, frame) in (0_u32..).zip(kinds()) {
            let bus = if number % 3 == 1 { "can1" } else { "can0" };
            recorder.frame(&frame, bus);
            said.push(Said::Frame(bus.to_owned(), frame));
            for notice in [link(number, LinkState::Down), lost(2), link(number, LinkState::Up)] {
                recorder.notice(&notice, bus);
                said.push(Said::Notice(bus.to_owned(), notice));
            }
            recorder.notice(&Notice::Quiet(time(number)), bus);
            said.push(Said::Notice(String::new(), Notice::Quiet(time(number))));
        }
        said.retain(|said| holds_notices || matches!(said, Said::Frame(..)));
        let status = recorder.finish();
        let bytes = std::fs::read(&path).unwrap();
        assert_eq!(read(&bytes), said, "{}", format.name);
        assert_eq!((status.path, status.parts, status.frames), (path, 1, 7));
        assert_eq!((status.bytes, status.missing, status.failure), (bytes.len() as u64, 0, None));
        let unheld: &[_] =
            if holds_notices { &[] } else { &[Unheld::Links, Unheld::Losses, Unheld::QuietTimes] };
        assert_eq!(status.unheld, unheld, "{}", format.name);
    }
}

#[test]
fn nothing_is_written_over() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("run.log");
    std::fs::write(&path, "mine").unwrap();
    let error = Recorder::open(&options(&path), day()).err().unwrap().to_string();
    let shown = path.display();
    assert!(
        error.starts_with(&format!("{shown}: is there already; nothing is ever written over")),
        "{error}"
    );
    assert_eq!(std::fs::read(&path).unwrap(), b"mine");
}

#[test]
fn a_crash_leaves_what_was_given_to_the_system() {
    for format in WRITABLE {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join(format!("run.{}", format.suffix));
        let mut recorder = Recorder::open(&options(&path), day()).unwrap();
        let begin = Instant::now();
        (0..10).for_each(|number| recorder.frame(&frame(number), "can0"));
        recorder.tick(begin);
        wait(&recorder, |status| status.frames == 10);
        (10..20).for_each(|number| recorder.frame(&frame(number), "can0"));
        recorder.tick(begin + Duration::from_millis(200));
        wait(&recorder, |status| status.frames == 20);
        (20..30).for_each(|number| recorder.frame(&frame(number), "can0"));
        recorder.tick(begin + Duration::from_millis(210));
        let after_a_crash = std::fs::read(&path).unwrap();
        assert_eq!(frames(&read(&after_a_crash)), expected(0..20), "{}", format.name);
        // One that ends early writes the rest.
        drop(recorder);
        assert_eq!(frames(&read(&std::fs::read(&path).unwrap())), expected(0..30), "{}", format.name);
    }
}

#[test]
fn the_system_has_it_soon_and_the_disk_within_a_second() {
    let memory = Memory::new(usize::MAX);
    let mut recorder =
        Recorder::open_on(Box::new(memory.clone()), &options(Path::new("run.log")), day(), QUEUE).unwrap();
    let begin = Instant::now();
    let mut count = 0;
    // Ticks 50 ms apart, a frame before each: what the system and the disk have behind them.
    for step in 0..40_u32 {
        recorder.frame(&frame(step), "can0");
        recorder.tick(begin + Duration::from_millis(50) * step);
        let held = u64::try_from(recorder.items.len()).unwrap();
        assert!(held <= 1, "{held} at {step}");
        count += 1;
        wait(&recorder, |status| status.frames == count - held);
        // The first at once, then at 750 ms and 1,500 ms.
        let syncs = 1 + usize::from(step >= 15) + usize::from(step >= 30);
        assert_eq!(memory.lock().syncs, syncs, "at {step}");
    }
    // Without frames there is nothing more to do than one sync.
    for step in 40..100_u32 {
        recorder.tick(begin + Duration::from_millis(50) * step);
    }
    assert_eq!(recorder.finish().frames, count);
    assert_eq!(memory.lock().syncs, 4);
}

#[test]
fn parts_are_as_large_as_allowed_and_miss_nothing() {
    let memory = Memory::new(usize::MAX);
    let limits = Limits { bytes: 10 * LINE as u64, ..UNLIMITED };
    let mut log = parts(&memory, "run.log", true, limits);
    for start in (0..35).step_by(7) {
        log.take(items(start..start + 7), &can0(), None);
    }
    log.finish();
    assert_eq!(memory.names(), ["run-0001.log", "run-0002.log", "run-0003.log", "run-0004.log"]);
    for (part, numbers) in [(1, 0..10), (2, 10..20), (3, 20..30), (4, 30..35)] {
        let bytes = memory.bytes(&format!("run-000{part}.log"));
        assert_eq!(bytes.len(), numbers.len() * LINE);
        assert_eq!(frames(&read(&bytes)), expected(numbers));
    }
    let status = log.status();
    assert_eq!((status.parts, status.frames, status.missing), (4, 35, 0));
    assert_eq!(status.path, Path::new("run-0004.log"));
    assert_eq!(status.bytes, 35 * LINE as u64);
}

#[test]
fn each_part_is_a_whole_capture() {
    let memory = Memory::new(usize::MAX);
    let mut pcapng = parts(&memory, "run.pcapng", true, Limits { bytes: 400, ..UNLIMITED });
    let buses = ["can0".to_owned(), "can1".to_owned()];
    for number in 0..40 {
        let bus = usize::from(number % 4 == 3);
        let down = Item { bus, what: What::Notice(link(number, LinkState::Down)) };
        pcapng.take(vec![Item { bus, what: What::Frame(frame(number)) }, down], &buses, None);
    }
    pcapng.finish();
    let names = memory.names();
    assert!(names.len() > 4, "{names:?}");
    let mut said = Vec::new();
    for name in names {
        let bytes = memory.bytes(&name);
        // A notice does not begin a part.
        assert!(bytes.len() <= 400 + 60, "{name}: {}", bytes.len());
        said.extend(read(&bytes));
    }
    let expected = (0..40).flat_map(|number| {
        let bus = buses[usize::from(number % 4 == 3)].clone();
        [Said::Frame(bus.clone(), frame(number)), Said::Notice(bus, link(number, LinkState::Down))]
    });
    assert_eq!(said, expected.collect::<Vec<_>>());
}

#[test]
fn a_part_ends_after_its_time_when_a_frame_comes() {
    let memory = Memory::new(usize::MAX);
    let limits = Limits { time: Duration::from_secs(600), ..UNLIMITED };
    let mut log = parts(&memory, "run.pcapng", true, limits);
    let begin = Instant::now();
    let at = |seconds| Some(begin + Duration::from_secs(seconds));
    let quiet = |number| vec![Item { bus: 0, what: What::Notice(Notice::Quiet(time(number))) }];
    log.take(items(0..3), &can0(), at(0));
    log.take(items(3..5), &can0(), at(599));
    log.take(quiet(5), &can0(), at(1_000));
    log.take(items(5..6), &can0(), at(1_300));
    log.take(items(6..7), &can0(), at(1_899));
    log.take(items(7..9), &can0(), at(1_900));
    log.finish();
    let said: Vec<_> = (1..=3).map(|part| read(&memory.bytes(&format!("run-000{part}.pcapng")))).collect();
    assert_eq!(frames(&said[0]), expected(0..5));
    assert_eq!(said[0].last(), Some(&Said::Notice(String::new(), Notice::Quiet(time(5)))));
    assert_eq!(frames(&said[1]), expected(5..7));
    assert_eq!(frames(&said[2]), expected(7..9));
    assert_eq!(memory.names().len(), 3);
}

#[test]
fn only_so_many_parts_are_kept() {
    let memory = Memory::new(usize::MAX);
    let limits = Limits { bytes: LINE as u64, files: 2, ..UNLIMITED };
    let mut log = parts(&memory, "run.log", true, limits);
    log.take(items(0..5), &can0(), None);
    log.finish();
    assert_eq!(memory.names(), ["run-0004.log", "run-0005.log"]);
    let status = log.status();
    assert_eq!((status.parts, status.removed, status.frames), (5, 3, 5));
}

#[test]
fn a_full_disk_leaves_whole_records_and_the_record_goes_on() {
    for format in WRITABLE {
        let name = format!("run.{}", format.suffix);
        let memory = Memory::new(usize::MAX);
        let mut all = parts(&memory, &name, false, UNLIMITED);
        all.take(items(0..20), &can0(), None);
        all.finish();
        let full = memory.bytes(&name).len();
        let header = if format.name == "pcapng" { 28 } else { 0 };
        // Room for every number of bytes.
        for room in header..full {
            full_at(&name, room, header);
        }
    }
}

/// Twenty frames in two batches on a disk with so much room, ten more while it is full, ten when it is not any more.
fn full_at(name: &str, room: usize, header: usize) {
    let memory = Memory::new(room);
    let mut parts = parts(&memory, name, false, UNLIMITED);
    let begin = Instant::now();
    parts.take(items(0..10), &can0(), Some(begin));
    parts.take(items(10..20), &can0(), Some(begin));
    parts.take(items(20..30), &can0(), Some(begin + RETRY_AFTER / 2));
    let first = memory.lock().files.get(Path::new(name)).cloned().unwrap_or_default();
    let recorded = frames(&read(&first));
    let count = u32::try_from(recorded.len()).unwrap();
    assert_eq!(recorded, expected(0..count), "{room}");
    // As many as there was room for.
    assert!(room - first.len() < 100 + header, "{room} {}", first.len());
    let status = parts.status().clone();
    let missing = u64::from(30 - count);
    assert_eq!((status.frames, status.missing, status.bytes), (count.into(), missing, first.len() as u64));
    let failure = status.failure.unwrap();
    assert_eq!((failure.missing, failure.is_over), (missing, false), "{room}");
    assert_eq!(failure.reason, "No space left on device (os error 28)");
    assert_eq!(failure.path, Path::new(name));

    memory.set(|inner| inner.room = usize::MAX / 2);
    parts.take(items(30..40), &can0(), Some(begin + RETRY_AFTER));
    parts.finish();
    let second = if first.is_empty() { name.to_owned() } else { name.replace('.', "-0002.") };
    let said = read(&memory.bytes(&second));
    assert_eq!(frames(&said), expected(30..40));
    let has_losses = usize::from(!name.ends_with("log"));
    assert_eq!(losses(&said), missing * has_losses as u64);
    assert_eq!(matches!(said[0], Said::Notice(..)), has_losses == 1, "they are told before the first frame");
    let status = parts.status();
    assert_eq!(status.path, Path::new(&second));
    assert_eq!((status.frames, status.missing), (u64::from(count) + 10, missing));
    assert!(status.failure.as_ref().unwrap().is_over);
    assert_eq!(status.parts, if first.is_empty() { 1 } else { 2 });
    let held: u64 = memory.names().iter().map(|name| memory.bytes(name).len() as u64).sum();
    assert_eq!(status.bytes, held);
}

#[test]
fn a_disk_that_is_gone_is_tried_every_few_seconds() {
    let memory = Memory::new(28 + 200);
    let mut parts = parts(&memory, "run.pcapng", false, UNLIMITED);
    let begin = Instant::now();
    parts.take(items(0..10), &can0(), Some(begin));
    let count = frames(&read(&memory.bytes("run.pcapng"))).len() as u64;
    assert!((1..5).contains(&count), "{count}");
    memory.set(|inner| inner.is_gone = true);
    // A frame each second for a minute.
    for second in 1..=60_u32 {
        let lost = Item { bus: 0, what: What::Notice(lost(1)) };
        let now = begin + Duration::from_secs(second.into());
        parts.take([items(second..second + 1), vec![lost]].concat(), &can0(), Some(now));
    }
    assert_eq!(memory.lock().made, 1 + 12);
    let failure = parts.status().failure.clone().unwrap();
    assert_eq!((failure.missing, failure.path), (70 - count, "run-0002.pcapng".into()));
    assert!(failure.reason.ends_with("(os error 5)"), "{}", failure.reason);
    // There again but full: no empty files are left.
    memory.set(|inner| inner.is_gone = false);
    memory.set(|inner| inner.room = 30);
    parts.take(items(61..62), &can0(), Some(begin + Duration::from_secs(65)));
    assert_eq!(memory.names(), ["run.pcapng"]);
    memory.set(|inner| inner.room = 1_000);
    let down = Item { bus: 0, what: What::Notice(link(62, LinkState::Down)) };
    let up = Item { bus: 0, what: What::Notice(link(62, LinkState::Up)) };
    parts.take([vec![down, up], items(62..63)].concat(), &can0(), Some(begin + Duration::from_secs(70)));
    let said = read(&memory.bytes("run-0002.pcapng"));
    // Those that were lost on the way here are missing too; and the link is told as it is.
    let missing = 71 - count;
    let bus = || "can0".to_owned();
    assert_eq!(
        said,
        [
            Said::Notice(bus(), lost(missing + 60)),
            Said::Notice(bus(), link(62, LinkState::Up)),
            Said::Frame(bus(), frame(62))
        ]
    );
    assert_eq!(parts.status().missing, missing);
    // A later failure counts for itself.
    memory.set(|inner| inner.room = 0);
    parts.take(items(63..65), &can0(), Some(begin + Duration::from_secs(71)));
    assert_eq!(parts.status().failure.as_ref().unwrap().missing, 2);
    assert_eq!(parts.status().missing, missing + 2);
}

#[test]
fn a_full_disk_takes_one_old_part_at_most() {
    let memory = Memory::new(6 * LINE);
    let limits = Limits { bytes: 2 * LINE as u64, files: 3, ..UNLIMITED };
    let mut log = parts(&memory, "run.log", true, limits);
    let begin = Instant::now();
    log.take(items(0..6), &can0(), Some(begin));
    assert_eq!(memory.names(), ["run-0001.log", "run-0002.log", "run-0003.log"]);
    // The oldest makes room for the next one.
    log.take(items(6..8), &can0(), Some(begin));
    assert_eq!(memory.names(), ["run-0002.log", "run-0003.log", "run-0004.log"]);
    assert_eq!((log.status().frames, log.status().missing), (8, 0));
    memory.set(|inner| inner.is_crowded = true);
    for second in (10..100).step_by(10) {
        log.take(items(8..9), &can0(), Some(begin + Duration::from_secs(second)));
        assert_eq!(memory.names(), ["run-0003.log", "run-0004.log"]);
    }
    assert_eq!((log.status().removed, log.status().missing), (2, 9));
}

#[test]
fn parts_are_looked_at_as_one_recording() {
    let folder = tempfile::tempdir().unwrap();
    for (name, max_bytes) in [("a.log", Some(100)), ("b.pcapng", Some(300)), ("c.log", None)] {
        let path = folder.path().join(name);
        let mut recorder = Recorder::open(&RecordOptions { max_bytes, ..options(&path) }, day()).unwrap();
        (0..9).for_each(|number| recorder.frame(&frame(number), "can0"));
        recorder.finish();
        let stem = name.split('.').next().unwrap();
        if max_bytes.is_none() {
            // As it is called when the first one could not be written any more.
            let name = folder.path().join("c-0002.log");
            std::fs::write(name, "(1700000001.000000) can0 185#00\n").unwrap();
        }
        let of_record = |path: &PathBuf| path.file_name().unwrap().to_str().unwrap().starts_with(stem);
        let paths = std::fs::read_dir(folder.path()).unwrap().map(|entry| entry.unwrap().path());
        let mut paths: Vec<_> = paths.filter(of_record).collect();
        paths.sort();
        assert!(paths.len() > 1, "{name}");
        let captures = Captures {
            paths,
            align: false,
            read: ReadOptions::default(),
            session: SessionOptions::default(),
            rules: Arc::default(),
        };
        let (news, inbox) = channel();
        let timeline = Timeline::open(captures, news).unwrap();
        while !matches!(inbox.recv_timeout(LIMIT).unwrap(), News::Indexed) {}
        let end = timeline.end().unwrap();
        assert_eq!(end.frames(), if max_bytes.is_none() { 10 } else { 9 }, "{name}");
        assert_eq!(end.buses().len(), 1, "{name}");
    }
}

#[test]
fn names_that_are_taken_meanwhile_are_passed_by() {
    let memory = Memory::new(usize::MAX);
    let limits = Limits { bytes: LINE as u64, ..UNLIMITED };
    let mut log = parts(&memory, "run.log", true, limits);
    memory.set(|inner| drop(inner.files.insert("run-0002.log".into(), b"others".to_vec())));
    log.take(items(0..2), &can0(), None);
    assert_eq!(memory.names(), ["run-0001.log", "run-0002.log", "run-0003.log"]);
    assert_eq!(memory.bytes("run-0002.log"), b"others");
    assert_eq!(frames(&read(&memory.bytes("run-0003.log"))), expected(1..2));
}

#[test]
fn a_disk_that_cannot_be_synced_is_told() {
    let memory = Memory::new(usize::MAX);
    let mut log = parts(&memory, "run.log", false, UNLIMITED);
    let begin = Instant::now();
    log.take(items(0..2), &can0(), Some(begin));
    memory.set(|inner| inner.fails_to_sync = true);
    log.sync();
    log.take(items(2..5), &can0(), Some(begin));
    let failure = log.status().failure.clone().unwrap();
    assert!(failure.reason.contains("(os error 5)"), "{}", failure.reason);
    assert_eq!((failure.missing, log.status().frames), (3, 2));
    memory.set(|inner| inner.fails_to_sync = false);
    log.take(items(5..6), &can0(), Some(begin + RETRY_AFTER));
    log.sync();
    assert_eq!(frames(&read(&memory.bytes("run-0002.log"))), expected(5..6));
}

#[test]
fn a_slow_disk_holds_nobody_up() {
    let memory = Memory::new(usize::MAX);
    let room = 3_000;
    let path = options(Path::new("run.pcapng"));
    let mut recorder = Recorder::open_on(Box::new(memory.clone()), &path, day(), size(room)).unwrap();
    memory.set(|inner| inner.is_stuck = true);
    for number in 0..5_000 {
        recorder.frame(&frame(number), "can0");
    }
    recorder.notice(&link(5_000, LinkState::Down), "can1");
    recorder.tick(Instant::now());
    let status = recorder.status();
    assert_eq!((status.too_fast, status.missing), (2_000, 2_000));
    assert_eq!(status.failure, None);
    memory.set(|inner| inner.is_stuck = false);
    wait(&recorder, |status| status.frames == 3_000);
    // The status is told before the room is free again.
    let begun = Instant::now();
    while recorder.queued.load(Ordering::Acquire) > 0 {
        assert!(begun.elapsed() < LIMIT);
        std::thread::yield_now();
    }
    recorder.frame(&frame(5_000), "can0");
    let status = recorder.finish();
    assert_eq!((status.frames, status.missing, status.parts), (3_001, 2_000, 1));
    let said = read(&memory.bytes("run.pcapng"));
    assert_eq!(frames(&said), expected((0..3_000).chain([5_000])));
    assert_eq!(
        said[3_000..3_002],
        [
            Said::Notice("can0".to_owned(), lost(2_000)),
            Said::Notice("can1".to_owned(), link(5_000, LinkState::Down))
        ]
    );
}

#[test]
fn what_was_too_much_at_the_end_is_told_too() {
    let memory = Memory::new(usize::MAX);
    let path = options(Path::new("run.pcapng"));
    let mut recorder = Recorder::open_on(Box::new(memory.clone()), &path, day(), size(10)).unwrap();
    memory.set(|inner| inner.is_stuck = true);
    (0..15).for_each(|number| recorder.frame(&frame(number), "can0"));
    memory.set(|inner| inner.is_stuck = false);
    let status = recorder.finish();
    assert_eq!((status.frames, status.missing), (10, 5));
    let said = read(&memory.bytes("run.pcapng"));
    assert_eq!((frames(&said).len(), losses(&said)), (10, 5));
}

/// A disk whose files are all the device that is always full.
#[cfg(target_os = "linux")]
struct Full;

#[cfg(target_os = "linux")]
impl Disk for Full {
    fn create(&mut self, _path: &Path) -> io::Result<Box<dyn PartFile>> {
        Ok(Box::new(std::fs::File::options().write(true).open("/dev/full")?))
    }

    fn remove(&mut self, _path: &Path) -> io::Result<()> {
        Ok(())
    }
}

#[cfg(target_os = "linux")]
#[test]
fn the_device_that_is_full_is_full() {
    let path = options(Path::new("run.log"));
    let mut recorder = Recorder::open_on(Box::new(Full), &path, day(), QUEUE).unwrap();
    let begin = Instant::now();
    for number in 0..3_000 {
        recorder.frame(&frame(number), "can0");
    }
    recorder.tick(begin);
    let status = wait(&recorder, |status| status.missing == 3_000);
    assert_eq!(
        status.remarks().first().unwrap(),
        "run.log: No space left on device (os error 28): 3000 frames not recorded so far; trying again"
    );
    assert_eq!(recorder.finish().frames, 0);
    // What has a header says so at once.
    let path = options(Path::new("run.pcapng"));
    let error = Recorder::open_on(Box::new(Full), &path, day(), QUEUE).err().unwrap();
    assert_eq!(format!("{error:#}"), "run.pcapng: cannot be made: No space left on device (os error 28)");
}

/// Folder for [`files_that_may_not_grow`], which runs in a process of its own.
const FOLDER: &str = "COBSCOPE_TEST_RECORD_FOLDER";

#[cfg(target_os = "linux")]
#[test]
fn files_that_may_not_grow_are_followed_by_others() {
    let folder = tempfile::tempdir().unwrap();
    // 4 or 8 KiB, by the shell; a signal that is ignored is an error instead.
    let script = "trap '' XFSZ; ulimit -f 8; exec \"$0\" \"$@\"";
    let test = "record::tests::files_that_may_not_grow";
    let mut command = std::process::Command::new("sh");
    command.args(["-c", script]).arg(std::env::current_exe().unwrap());
    command.args(["--exact", test, "--ignored"]).env(FOLDER, folder.path());
    let output = command.output().unwrap();
    let said = String::from_utf8_lossy(&output.stdout);
    assert!(output.status.success() && said.contains("1 passed"), "{said}");
}

#[test]
#[ignore = "run by files_that_may_not_grow_are_followed_by_others"]
fn files_that_may_not_grow() {
    let Some(folder) = std::env::var_os(FOLDER).map(PathBuf::from) else { return };
    for format in WRITABLE {
        let name = |part: &str| folder.join(format!("run{part}.{}", format.suffix));
        let mut recorder = Recorder::open(&options(&name("")), day()).unwrap();
        let begin = Instant::now();
        (0..500).for_each(|number| recorder.frame(&frame(number), "can0"));
        recorder.tick(begin);
        let status = wait(&recorder, |status| status.frames + status.missing == 500);
        assert_eq!(status.failure.as_ref().unwrap().reason, "File too large (os error 27)");
        assert!(!status.failure.unwrap().is_over);
        let before = frames(&read(&std::fs::read(name("")).unwrap()));
        assert!(before.len() > 20, "{}", before.len());
        assert_eq!(before, expected(0..u32::try_from(before.len()).unwrap()));
        assert_eq!(status.missing, 500 - before.len() as u64);
        (500..510).for_each(|number| recorder.frame(&frame(number), "can0"));
        recorder.tick(begin + RETRY_AFTER);
        let end = recorder.finish();
        assert_eq!((end.frames, end.missing), (before.len() as u64 + 10, status.missing));
        let said = read(&std::fs::read(name("-0002")).unwrap());
        assert_eq!(frames(&said), expected(500..510));
        assert_eq!(losses(&said), if format.name == "pcapng" { status.missing } else { 0 });
    }
}
