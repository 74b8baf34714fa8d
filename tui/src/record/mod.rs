//! Records what comes of live buses, while it is looked at.
//!
//! ```text
//! frame, notice ─▶ items ──tick: every 100 ms──▶ queue ─▶ thread ─▶ part, part, … on the disk
//!                            bounded: a slow disk holds nobody up    synced more than once a second
//! ```
//!
//! Once it is open nothing stops it. What cannot be recorded is counted, and told in the record as well where its format
//! has a place for that.

mod disk;
pub mod format;
mod item;
mod names;
mod part;
mod parts;
mod status;
#[cfg(test)]
mod tests;

use std::path::PathBuf;
use std::sync::atomic::{AtomicUsize, Ordering};
use std::sync::mpsc::{Receiver, Sender, channel};
use std::sync::{Arc, Mutex, PoisonError};
use std::thread::JoinHandle;
use std::time::{Duration, Instant};

use anyhow::Context as _;
use cobscope_decoder::capture::Notice;
use cobscope_decoder::frame::Frame;
use jiff::civil::DateTime;

use disk::{Disk, Files};
use item::{Gap, Item, What};
pub use names::Names;
use parts::{Limits, Parts};
pub use status::{RecordFailure, RecordStatus};

/// Bytes of memory the queue takes at most: more than half a million frames.
const QUEUE: usize = 64 * 1024 * 1024;

/// Items handed over at once, at most.
const BATCH: usize = 1_024;

/// How long items are gathered before the system gets them, so that 200 ms are kept with ticks 100 ms apart.
const WRITE_EVERY: Duration = Duration::from_millis(100);

/// Time between syncs: with the time one takes, a power cut costs the last second.
const SYNC_EVERY: Duration = Duration::from_millis(750);

/// What is recorded, and into which files.
#[derive(Debug, Clone, Default)]
pub struct RecordOptions {
    /// File, whose name's end says the format. None or a folder: a name as `candump -l` gives it, here or there.
    /// With limits of size or time `run.log` becomes `run-0001.log`, `run-0002.log`, and so on.
    pub path: Option<PathBuf>,
    /// Bytes of a part at most; one frame is in it in any case. What comes besides frames may go beyond.
    pub max_bytes: Option<u64>,
    /// How long a part is written; it goes on until a frame comes that begins the next one.
    pub max_time: Option<Duration>,
    /// Parts kept at most, at least 1; the oldest are removed. None keeps all.
    pub files: Option<u32>,
}

/// What one batch asks of the thread.
struct Work {
    items: Vec<Item>,
    buses: Arc<Vec<String>>,
    now: Option<Instant>,
    sync: bool,
}

/// Memory that items take.
fn size(items: usize) -> usize {
    items.saturating_mul(size_of::<Item>())
}

/// A record being written.
pub struct Recorder {
    items: Vec<Item>,
    buses: Arc<Vec<String>>,
    /// None when nothing follows.
    work: Option<Sender<Work>>,
    thread: Option<JoinHandle<()>>,
    /// Bytes of memory with the thread, and how many there may be.
    queued: Arc<AtomicUsize>,
    most_queued: usize,
    status: Arc<Mutex<RecordStatus>>,
    /// What came while the queue was full.
    gap: Gap,
    too_fast: u64,
    /// Frames for which there is no thread any more.
    stranded: u64,
    now: Option<Instant>,
    handed_over: Option<Instant>,
    synced: Option<Instant>,
    is_synced: bool,
}

impl Recorder {
    /// Makes the file at once; never one that is there already. `now` is the time of day here, for its name.
    ///
    /// # Errors
    /// When the folder does not exist, when there is such a file, when it cannot be made or written, or when its name
    /// says no format.
    pub fn open(options: &RecordOptions, now: DateTime) -> anyhow::Result<Self> {
        Self::open_on(Box::new(Files), options, now, QUEUE)
    }

    fn open_on(
        disk: Box<dyn Disk>,
        options: &RecordOptions,
        now: DateTime,
        most_queued: usize,
    ) -> anyhow::Result<Self> {
        let has_limits = options.max_bytes.is_some() || options.max_time.is_some();
        let (names, format) = Names::new(options.path.as_deref(), has_limits, now)?;
        let limits = Limits {
            bytes: options.max_bytes.unwrap_or(u64::MAX),
            time: options.max_time.unwrap_or(Duration::MAX),
            files: options.files.map_or(usize::MAX, |files| files as usize),
        };
        let parts = Parts::open(disk, names, format, limits)?;
        let status = Arc::new(Mutex::new(parts.status().clone()));
        let queued = Arc::new(AtomicUsize::new(0));
        let (work, inbox) = channel();
        let (told, taken) = (Arc::clone(&status), Arc::clone(&queued));
        let thread = std::thread::Builder::new().name("record".into());
        let thread =
            thread.spawn(move || run(parts, &inbox, &told, &taken)).context("no thread can be started")?;
        Ok(Self {
            items: Vec::with_capacity(BATCH),
            buses: Arc::default(),
            work: Some(work),
            thread: Some(thread),
            queued,
            most_queued,
            status,
            gap: Gap::default(),
            too_fast: 0,
            stranded: 0,
            now: None,
            handed_over: None,
            synced: None,
            is_synced: true,
        })
    }

    /// Records a frame of the bus of this name.
    pub fn frame(&mut self, frame: &Frame, bus: &str) {
        let bus = self.bus(bus);
        self.add(Item { bus, what: What::Frame(*frame) });
    }

    /// Records what else is known of the bus of this name, where the format has a place for it.
    pub fn notice(&mut self, notice: &Notice, bus: &str) {
        let bus = self.bus(bus);
        self.add(Item { bus, what: What::Notice(notice.clone()) });
    }

    /// Lets time go on; to be called every 100 ms or more often, whether anything came or not. What came is with the
    /// system 200 ms later, where a crash of this program does not reach it, and on the disk within a second.
    pub fn tick(&mut self, now: Instant) {
        self.now = Some(now);
        let is_due = |last: Option<Instant>, every| {
            last.is_none_or(|last| now.saturating_duration_since(last) >= every)
        };
        let is_unsynced = !self.is_synced || !self.items.is_empty();
        if is_unsynced && is_due(self.synced, SYNC_EVERY) {
            self.hand_over(true);
            (self.synced, self.handed_over, self.is_synced) = (Some(now), Some(now), true);
        } else if !self.items.is_empty() && is_due(self.handed_over, WRITE_EVERY) {
            self.hand_over(false);
            self.handed_over = Some(now);
        }
    }

    /// What came of it so far.
    pub fn status(&self) -> RecordStatus {
        let mut status = self.status.lock().unwrap_or_else(PoisonError::into_inner).clone();
        status.too_fast = self.too_fast;
        status.missing = status.missing.saturating_add(self.too_fast).saturating_add(self.stranded);
        if self.stranded > 0 {
            let reason = "the thread that writes has ended; begin a new record".to_owned();
            let path = status.path.clone();
            status.failure = Some(RecordFailure { path, reason, missing: self.stranded, is_over: false });
        }
        status
    }

    /// Writes what is left, waits until all is on the disk, and tells what came of it.
    pub fn finish(mut self) -> RecordStatus {
        self.close();
        self.status()
    }

    fn close(&mut self) {
        if self.work.is_some() {
            self.items.extend(self.gap.take());
            self.hand_over(true);
        }
        self.work = None;
        if let Some(thread) = self.thread.take() {
            // If it ended early, that is in the status.
            let _ = thread.join();
        }
    }

    fn bus(&mut self, name: &str) -> usize {
        self.buses.iter().position(|known| known == name).unwrap_or_else(|| {
            let buses = Arc::make_mut(&mut self.buses);
            buses.push(name.to_owned());
            buses.len() - 1
        })
    }

    fn add(&mut self, item: Item) {
        let queued = self.queued.load(Ordering::Acquire).saturating_add(size(self.items.len() + 1));
        // After a gap half of the room must be free, so that there are few gaps.
        let most = if self.gap.is_empty() { self.most_queued } else { self.most_queued / 2 };
        if queued > most {
            self.too_fast += u64::from(item.is_frame());
            self.gap.miss(item);
            return;
        }
        if !self.gap.is_empty() {
            self.items.extend(self.gap.take());
        }
        self.items.push(item);
        if self.items.len() >= BATCH {
            self.hand_over(false);
        }
    }

    fn hand_over(&mut self, sync: bool) {
        let items = std::mem::replace(&mut self.items, Vec::with_capacity(BATCH));
        self.queued.fetch_add(size(items.len()), Ordering::AcqRel);
        self.is_synced = false;
        let work = Work { items, buses: Arc::clone(&self.buses), now: self.now, sync };
        if let Some(thread) = &self.work
            && let Err(unsent) = thread.send(work)
        {
            let items = unsent.0.items;
            self.queued.fetch_sub(size(items.len()), Ordering::AcqRel);
            self.stranded += items.iter().filter(|item| item.is_frame()).count() as u64;
        }
    }
}

/// A program that ends early loses nothing either.
impl Drop for Recorder {
    fn drop(&mut self) {
        self.close();
    }
}

fn run(mut parts: Parts, inbox: &Receiver<Work>, status: &Mutex<RecordStatus>, queued: &AtomicUsize) {
    let tell = |parts: &Parts| {
        status.lock().unwrap_or_else(PoisonError::into_inner).clone_from(parts.status());
    };
    for Work { items, buses, now, sync } in inbox {
        let taken = size(items.len());
        parts.take(items, &buses, now);
        if sync {
            parts.sync();
        }
        tell(&parts);
        queued.fetch_sub(taken, Ordering::AcqRel);
    }
    parts.finish();
    tell(&parts);
}
