//! Writes live buses to a capture (`--record`) while they are displayed.
//!
//! ```text
//! frame, notice ─▶ items ──tick: every 100 ms──▶ queue ─▶ thread ─▶ part, part, … on the disk
//!                            bounded: a slow disk does not block     synced more than once per second
//! ```
//!
//! After it is opened, errors do not stop it. Frames that cannot be written are counted, also in the capture
//! if its format can store the count.

mod backend;
mod cuts;
mod disk;
pub mod format;
mod item;
mod names;
mod part;
mod parts;
mod status;
#[cfg(test)]
mod tests;
mod trigger;

use std::path::PathBuf;
use std::sync::atomic::{AtomicUsize, Ordering};
use std::sync::mpsc::{Receiver, Sender, channel};
use std::sync::{Arc, Mutex, PoisonError};
use std::thread::JoinHandle;
use std::time::{Duration, Instant};

use anyhow::Context as _;
use cobscope_decoder::capture::Notice;
use cobscope_decoder::frame::Frame;
use cobscope_decoder::session::SessionOptions;
use jiff::civil::DateTime;

use backend::RecorderBackend;
pub use cuts::{CompleteCut, CutEnd, CutNews, CutOptions, RefusalReason, StateText};
use cuts::{CutWriter, StateFollower};
use disk::{RealDisk, RecordDisk};
use item::{PendingItem, RecordGap, RecordItem};
pub use names::RecordNames;
use parts::{RecordLimits, RecordParts};
pub use status::{RecordFailure, RecordStatus};
pub use trigger::CaptureTrigger;

/// Maximum memory of the queue in bytes: more than half a million frames.
const QUEUE: usize = 64 * 1024 * 1024;

/// Maximum time for which frames wait for room in the queue of a recorder of triggers. A file or a pipe is faster than
/// a bus and must not lose frames.
const PATIENCE: Duration = Duration::from_secs(2);

/// Interval between two checks for room in the queue.
const ROOM_POLL: Duration = Duration::from_millis(1);

/// Maximum number of items per batch.
const BATCH: usize = 1_024;

/// Time for which items are collected. With ticks 100 ms apart they reach the system within 200 ms.
const WRITE_EVERY: Duration = Duration::from_millis(100);

/// Interval between syncs; with the duration of a sync, a power failure loses at most the last second.
const SYNC_EVERY: Duration = Duration::from_millis(750);

/// Output files and limits.
#[derive(Debug, Clone, Default)]
pub struct RecordOptions {
    /// File; its suffix selects the format. None or a folder: a name like that of `candump -l`, in the
    /// current folder or in this one. With limits of size or time `run.log` becomes `run-0001.log`,
    /// `run-0002.log`, and so on.
    pub path: Option<PathBuf>,
    /// Maximum size of a part in bytes; a part contains at least one frame. Notices may exceed it.
    pub max_bytes: Option<u64>,
    /// Maximum duration of a part; the next part starts with the next frame.
    pub max_time: Option<Duration>,
    /// Maximum number of parts, at least 1; the oldest are removed. None keeps all.
    pub files: Option<u32>,
}

/// A batch for the writer thread.
struct RecordThread {
    items: Vec<PendingItem>,
    /// Memory of the items in bytes.
    memory: usize,
    buses: Arc<Vec<String>>,
    now: Option<Instant>,
    sync: bool,
}

/// A capture being written.
pub struct Recorder {
    items: Vec<PendingItem>,
    /// Memory of `items` in bytes.
    memory: usize,
    buses: Arc<Vec<String>>,
    /// None after the end.
    work: Option<Sender<RecordThread>>,
    thread: Option<JoinHandle<()>>,
    /// Memory of the queue, shared with the thread.
    queued: Arc<AtomicUsize>,
    most_queued: usize,
    /// Maximum time to wait for room in the queue.
    patience: Duration,
    status: Arc<Mutex<RecordStatus>>,
    /// Items lost while the queue was full.
    gap: RecordGap,
    too_fast: u64,
    lost_triggers: u64,
    /// Number of frames lost because the thread has ended.
    stranded: u64,
    now: Option<Instant>,
    handed_over: Option<Instant>,
    synced: Option<Instant>,
    is_synced: bool,
}

impl Recorder {
    /// Creates the file; never overwrites one. `now` is the local time for its name.
    ///
    /// # Errors
    /// Folder missing, file exists, file cannot be created or written, or unknown suffix.
    pub fn open(options: &RecordOptions, now: DateTime) -> anyhow::Result<Self> {
        Self::open_on(Box::new(RealDisk), options, now, QUEUE)
    }

    fn open_on(
        disk: Box<dyn RecordDisk>,
        options: &RecordOptions,
        now: DateTime,
        most_queued: usize,
    ) -> anyhow::Result<Self> {
        let has_limits = options.max_bytes.is_some() || options.max_time.is_some();
        let (names, format) = RecordNames::new(options.path.as_deref(), has_limits, now)?;
        let limits = RecordLimits {
            bytes: options.max_bytes.unwrap_or(u64::MAX),
            time: options.max_time.unwrap_or(Duration::MAX),
            files: options.files.map_or(usize::MAX, |files| files as usize),
        };
        Self::start(RecordParts::open_parts(disk, names, format, limits)?, most_queued)
    }

    /// Writes a capture per trigger instead of all frames. News of the captures arrive through the receiver. Frames are
    /// decoded with the options `session` for the bus file next to each capture, whose text is that of `text`.
    ///
    /// # Errors
    /// The folder cannot be created, or the files of a ring on disk cannot.
    pub fn on_triggers(
        options: CutOptions,
        session: SessionOptions,
        text: StateText,
        now: DateTime,
    ) -> anyhow::Result<(Self, Receiver<CutNews>)> {
        let (news, inbox) = channel();
        let state = StateFollower::new(session, text);
        let writer =
            CutWriter::open_writer(Box::new(|| Box::new(RealDisk)), options, Some(state), news, now)?;
        let mut recorder = Self::start(writer, QUEUE)?;
        recorder.patience = PATIENCE;
        Ok((recorder, inbox))
    }

    fn start(backend: impl RecorderBackend + 'static, most_queued: usize) -> anyhow::Result<Self> {
        let status = Arc::new(Mutex::new(backend.status().clone()));
        let queued = Arc::new(AtomicUsize::new(0));
        let (work, inbox) = channel();
        let (reported, taken) = (Arc::clone(&status), Arc::clone(&queued));
        let thread = std::thread::Builder::new().name("record".into());
        let thread =
            thread.spawn(move || run(backend, &inbox, &reported, &taken)).context("cannot start a thread")?;
        Ok(Self {
            items: Vec::with_capacity(BATCH),
            memory: 0,
            buses: Arc::default(),
            work: Some(work),
            thread: Some(thread),
            queued,
            most_queued,
            patience: Duration::ZERO,
            status,
            gap: RecordGap::default(),
            too_fast: 0,
            lost_triggers: 0,
            stranded: 0,
            now: None,
            handed_over: None,
            synced: None,
            is_synced: true,
        })
    }

    /// Writes a frame of the bus `bus`.
    pub fn frame(&mut self, frame: &Frame, bus: &str) {
        let bus = self.bus(bus);
        self.add(PendingItem { bus, what: RecordItem::Frame(*frame) });
    }

    /// Writes a notice about the bus `bus`, if the format can store it.
    pub fn notice(&mut self, notice: &Notice, bus: &str) {
        let bus = self.bus(bus);
        self.add(PendingItem { bus, what: RecordItem::Notice(notice.clone()) });
    }

    /// The next item triggers a capture. Only for a recorder of triggers.
    pub fn trigger(&mut self, trigger: CaptureTrigger) {
        let bus = self.bus(&trigger.bus);
        self.add(PendingItem { bus, what: RecordItem::Trigger(Box::new(trigger)) });
    }

    /// Advances the time; called every 100 ms or more often. Items are passed to the system within 200 ms,
    /// where a crash of this program does not affect them, and are on the disk within a second.
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

    /// Status so far.
    pub fn status(&self) -> RecordStatus {
        let mut status = self.status.lock().unwrap_or_else(PoisonError::into_inner).clone();
        status.too_fast = self.too_fast;
        status.lost_triggers = self.lost_triggers;
        status.missing = status.missing.saturating_add(self.too_fast).saturating_add(self.stranded);
        if self.stranded > 0 {
            let reason = "the writer thread has ended; start a new capture".to_owned();
            let path = status.path.clone();
            status.failure = Some(RecordFailure { path, reason, missing: self.stranded, is_over: false });
        }
        status
    }

    /// Writes the rest, waits until all is on the disk and returns the status.
    pub fn finish(mut self) -> RecordStatus {
        self.stop()
    }

    /// As `finish`; further items are only counted as missing.
    pub fn stop(&mut self) -> RecordStatus {
        self.close();
        self.status()
    }

    fn close(&mut self) {
        if self.work.is_some() {
            self.items.extend(self.gap.take_notices());
            self.hand_over(true);
        }
        self.work = None;
        if let Some(thread) = self.thread.take() {
            // The status contains an early end of the thread.
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

    fn add(&mut self, item: PendingItem) {
        let own = item.memory_size();
        if !self.has_room(own) && !self.finds_room(own) {
            self.too_fast += u64::from(item.is_frame());
            self.lost_triggers += u64::from(matches!(item.what, RecordItem::Trigger(_)));
            self.gap.add_missed(item);
            return;
        }
        if !self.gap.is_empty() {
            self.items.extend(self.gap.take_notices());
        }
        self.memory = self.memory.saturating_add(own);
        self.items.push(item);
        if self.items.len() >= BATCH {
            self.hand_over(false);
        }
    }

    /// Whether the queue has room for `own` bytes.
    fn has_room(&self, own: usize) -> bool {
        let queued = self.queued.load(Ordering::Acquire).saturating_add(self.memory).saturating_add(own);
        // After a gap half of the queue must be free, so that there are few gaps.
        let most = if self.gap.is_empty() { self.most_queued } else { self.most_queued / 2 };
        queued <= most
    }

    /// Waits for room; never in a gap, so that a disk that is stuck delays the input once.
    fn finds_room(&self, own: usize) -> bool {
        let begun = Instant::now();
        while self.gap.is_empty() && begun.elapsed() < self.patience {
            std::thread::sleep(ROOM_POLL);
            if self.has_room(own) {
                return true;
            }
        }
        false
    }

    fn hand_over(&mut self, sync: bool) {
        let items = std::mem::replace(&mut self.items, Vec::with_capacity(BATCH));
        let memory = std::mem::take(&mut self.memory);
        self.queued.fetch_add(memory, Ordering::AcqRel);
        self.is_synced = false;
        let work = RecordThread { items, memory, buses: Arc::clone(&self.buses), now: self.now, sync };
        if let Some(thread) = &self.work
            && let Err(unsent) = thread.send(work)
        {
            let items = unsent.0.items;
            self.queued.fetch_sub(memory, Ordering::AcqRel);
            self.stranded += items.iter().filter(|item| item.is_frame()).count() as u64;
        }
    }
}

/// Writes the rest if the program ends early.
impl Drop for Recorder {
    fn drop(&mut self) {
        self.close();
    }
}

fn run(
    mut backend: impl RecorderBackend,
    inbox: &Receiver<RecordThread>,
    status: &Mutex<RecordStatus>,
    queued: &AtomicUsize,
) {
    let explain = |backend: &dyn RecorderBackend| {
        status.lock().unwrap_or_else(PoisonError::into_inner).clone_from(backend.status());
    };
    let mut known = Arc::default();
    for RecordThread { items, memory, buses, now, sync } in inbox {
        backend.take_items(items, &buses, now);
        if sync {
            backend.sync_to_disk();
        }
        explain(&backend);
        queued.fetch_sub(memory, Ordering::AcqRel);
        known = buses;
    }
    backend.finish_recording(&known);
    explain(&backend);
}
