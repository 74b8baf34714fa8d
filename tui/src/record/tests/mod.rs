//! Tests that read the written captures again, with various disks.

mod cuts;
mod fails;
mod keeps;

use std::collections::BTreeMap;
use std::io::{self, ErrorKind, Write};
use std::path::{Path, PathBuf};
use std::sync::{Arc, Condvar, Mutex, MutexGuard};
use std::time::{Duration, Instant};

use cobscope_decoder::capture::{
    self, Batch, CapturePlace, CaptureReader, Notice, ReadOptions, WRITABLE, WritableFormat, WriteOptions,
};
use cobscope_decoder::frame::{BusIndex, CanId, Frame, FrameFlags, LinkState, Timestamp};
use cobscope_decoder::session::SessionOptions;

use super::disk::{RecordDisk, RecordFile};
use super::item::{PendingItem, RecordItem};
use super::names::RecordNames;
use super::parts::{RETRY_AFTER, RecordLimits, RecordParts};
use super::status::UnstoredKind;
use super::*;
use crate::timeline::{Timeline, TimelineCaptures, TimelineNews};

/// Length of a candump line of [`frame`] with its end: `(1700000000.000001) can0 185#01000000`.
const LINE: usize = 19 + 1 + 4 + 1 + 12 + 1;

/// Time limit for a condition.
const LIMIT: Duration = Duration::from_mins(1);

const UNLIMITED: RecordLimits = RecordLimits { bytes: u64::MAX, time: Duration::MAX, files: usize::MAX };

/// A disk in memory with limited space.
#[derive(Clone)]
struct Memory(Arc<(Mutex<DiskContent>, Condvar)>);

struct DiskContent {
    files: BTreeMap<PathBuf, Vec<u8>>,
    /// New names of files that were open when they were renamed.
    renamed: BTreeMap<PathBuf, PathBuf>,
    room: usize,
    /// No file can be created.
    is_gone: bool,
    /// Writing blocks.
    is_stuck: bool,
    fails_to_sync: bool,
    /// Freed space is used by others.
    is_crowded: bool,
    made: usize,
    syncs: usize,
}

impl DiskContent {
    /// Content of an open file, also after it was renamed.
    fn file(&mut self, path: &Path) -> &mut Vec<u8> {
        let path = self.renamed.get(path).map_or(path, PathBuf::as_path);
        self.files.get_mut(path).unwrap()
    }
}

struct MemoryFile(Memory, PathBuf);

impl Memory {
    fn new(room: usize) -> Self {
        Self(Arc::new((
            Mutex::new(DiskContent {
                files: BTreeMap::new(),
                renamed: BTreeMap::new(),
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

    fn lock(&self) -> MutexGuard<'_, DiskContent> {
        self.0.0.lock().unwrap()
    }

    fn set(&self, change: impl FnOnce(&mut DiskContent)) {
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

impl RecordDisk for Memory {
    fn create_file(&mut self, path: &Path) -> io::Result<Box<dyn RecordFile>> {
        let mut inner = self.lock();
        inner.made += 1;
        if inner.is_gone {
            return Err(io::Error::from_raw_os_error(5));
        }
        if inner.files.contains_key(path) {
            return Err(ErrorKind::AlreadyExists.into());
        }
        inner.renamed.remove(path);
        inner.files.insert(path.to_owned(), Vec::new());
        Ok(Box::new(MemoryFile(self.clone(), path.to_owned())))
    }

    fn read(&mut self, path: &Path) -> io::Result<Box<dyn io::Read + Send>> {
        let bytes = self.lock().files.get(path).cloned().ok_or(ErrorKind::NotFound)?;
        Ok(Box::new(io::Cursor::new(bytes)))
    }

    fn remove_file(&mut self, path: &Path) -> io::Result<()> {
        let mut inner = self.lock();
        let bytes = inner.files.remove(path).ok_or(ErrorKind::NotFound)?;
        if !inner.is_crowded {
            inner.room += bytes.len();
        }
        Ok(())
    }

    fn rename_file(&mut self, from: &Path, to: &Path) -> io::Result<()> {
        let mut inner = self.lock();
        let bytes = inner.files.remove(from).ok_or(ErrorKind::NotFound)?;
        let replaced = inner.files.insert(to.to_owned(), bytes);
        inner.renamed.insert(from.to_owned(), to.to_owned());
        inner.room += replaced.map_or(0, |bytes| bytes.len());
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
        inner.file(&self.1).extend_from_slice(&bytes[..count]);
        Ok(count)
    }

    fn flush(&mut self) -> io::Result<()> {
        Ok(())
    }
}

impl RecordFile for MemoryFile {
    fn sync_to_disk(&mut self) -> io::Result<()> {
        let mut inner = self.0.lock();
        inner.syncs += 1;
        if inner.fails_to_sync { Err(io::Error::from_raw_os_error(5)) } else { Ok(()) }
    }

    fn truncate_to(&mut self, length: u64) -> io::Result<()> {
        let mut inner = self.0.lock();
        let bytes = inner.file(&self.1);
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

/// The frame with number `number`.
fn frame(number: u32) -> Frame {
    Frame {
        time: Some(time(number)),
        ..Frame::data_frame(CanId::from_standard(0x185), &number.to_le_bytes())
    }
}

fn items(numbers: std::ops::Range<u32>) -> Vec<PendingItem> {
    numbers.map(|number| PendingItem { bus: 0, what: RecordItem::Frame(frame(number)) }).collect()
}

fn lost(count: u64) -> Notice {
    Notice::LostFrames { place: CapturePlace::Now, bus: BusIndex(0), count: Some(count) }
}

fn link(number: u32, state: LinkState) -> Notice {
    Notice::Link { bus: BusIndex(0), time: time(number), state, bit_rate: Some(250_000) }
}

/// Content of a capture in order: frames and notices with bus names, without position and index.
#[derive(Debug, PartialEq)]
enum RecordedItem {
    Frame(String, Frame),
    Notice(String, Notice),
}

fn read(bytes: &[u8]) -> Vec<RecordedItem> {
    if bytes.is_empty() {
        return Vec::new();
    }
    let mut reader = CaptureReader::open(bytes, &ReadOptions::default()).unwrap();
    let (mut batch, mut stated) = (Batch::new(), Vec::new());
    while reader.read(&mut batch).unwrap() {
        let names = reader.buses().names();
        stated.extend(batch.items().filter_map(|item| match item {
            capture::BatchItem::Frame(frame) => Some(RecordedItem::Frame(
                names[usize::from(frame.bus.0)].clone(),
                Frame { number: 0, bus: BusIndex(0), ..*frame },
            )),
            // An assumption of the reader is not part of the capture.
            capture::BatchItem::Notice(Notice::Assumption(_)) => None,
            capture::BatchItem::Notice(notice) => Some(of_bus(notice.clone(), names)),
        }));
    }
    stated
}

fn of_bus(mut notice: Notice, names: &[String]) -> RecordedItem {
    let mut name = String::new();
    match &mut notice {
        Notice::LostFrames { place, bus, .. } => {
            name.clone_from(&names[usize::from(bus.0)]);
            (*place, *bus) = (CapturePlace::Now, BusIndex(0));
        }
        Notice::Link { bus, .. } => {
            name.clone_from(&names[usize::from(bus.0)]);
            *bus = BusIndex(0);
        }
        _ => (),
    }
    RecordedItem::Notice(name, notice)
}

fn frames(stated: &[RecordedItem]) -> Vec<Frame> {
    stated
        .iter()
        .filter_map(|stated| if let RecordedItem::Frame(_, frame) = stated { Some(*frame) } else { None })
        .collect()
}

fn losses(stated: &[RecordedItem]) -> u64 {
    let count = |stated: &RecordedItem| match stated {
        RecordedItem::Notice(_, Notice::LostFrames { count, .. }) => count.unwrap(),
        _ => 0,
    };
    stated.iter().map(count).sum()
}

fn expected(numbers: impl IntoIterator<Item = u32>) -> Vec<Frame> {
    numbers.into_iter().map(frame).collect()
}

/// Frames with these numbers as a format stores them.
fn kept(format: &WritableFormat, numbers: impl IntoIterator<Item = u32>) -> Vec<Frame> {
    numbers.into_iter().filter_map(|number| format.holds.kept_frame(&frame(number))).collect()
}

/// Whether a format writes several frames together.
fn gathers(format: &WritableFormat) -> bool {
    let mut writer = (format.writer)(Box::new(io::sink()), &WriteOptions::default());
    writer.write(&frame(0), "can0").unwrap();
    writer.pending() > 0
}

fn parts(memory: &Memory, name: &str, is_numbered: bool, limits: RecordLimits) -> RecordParts {
    let (names, format) = RecordNames::new(Some(Path::new(name)), is_numbered, day()).unwrap();
    RecordParts::open_parts(Box::new(memory.clone()), names, format, limits).unwrap()
}

fn can0() -> Vec<String> {
    vec!["can0".to_owned()]
}

/// Waits until the status satisfies a condition.
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
