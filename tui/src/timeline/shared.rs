//! Data shared by the threads of a timeline.

use std::sync::atomic::{AtomicBool, AtomicI64, AtomicU32, AtomicU64, AtomicUsize, Ordering};
use std::sync::mpsc::Sender;
use std::sync::{Arc, Condvar, Mutex, PoisonError, RwLock};
use std::time::{Duration, Instant};

use cobscope_decoder::capture::{
    CaptureError, CaptureReader, MergedCapture, MergedPosition, MergedReader, ReadOptions,
};
use cobscope_decoder::frame::Timestamp;
use cobscope_decoder::replay::{Checkpoint, CheckpointIndex, EventPosition, ReplayState};
use cobscope_decoder::session::SessionOptions;

use super::matches::SearchMatches;
use super::news::TimelineNews;
use super::survey::SurveyResults;
use crate::source::{DecompressedBytes, StoreReader};

/// Initial number of frames between two marks of a live bus.
const LIVE_INTERVAL: u64 = 16_384;

/// A capture of a timeline.
#[derive(Clone)]
pub struct TimelineCapture {
    /// Decompressed bytes of the capture.
    pub store: Arc<DecompressedBytes>,
    /// Captures with the same number are parts of one capture.
    pub group: usize,
    /// Nanoseconds added to the timestamps.
    pub shift: i64,
    /// The lane before this one is the previous part of its capture.
    pub continues: bool,
    /// Title of the format.
    pub format: &'static str,
    /// A live bus; its oldest frames may be evicted.
    pub is_live: bool,
}

/// Captures with the results of all threads.
pub struct SharedResults {
    pub(super) lanes: Vec<TimelineCapture>,
    pub(super) options: SessionOptions,
    pub(super) read_options: ReadOptions,
    pub(super) index: RwLock<CheckpointIndex>,
    pub(super) survey: RwLock<SurveyResults>,
    pub(super) matches: RwLock<Option<Arc<SearchMatches>>>,
    /// State of the buses at the end, once the index is complete.
    pub(super) end: Mutex<Option<Arc<ReplayState>>>,
    /// Reason why reading ended early.
    pub(super) failure: Mutex<Option<String>>,
    /// Last reported change of a file.
    change: Mutex<Option<String>>,
    pub(super) progress: IndexProgress,
    /// Number of threads that sample signals.
    pub(super) tracing: AtomicUsize,
    /// Growth was reported and not yet handled.
    pub(super) has_reported_growth: AtomicBool,
    is_over: AtomicBool,
    /// Threads that wait for the index may start.
    may_begin: Mutex<bool>,
    begins: Condvar,
}

/// Progress of the index.
#[derive(Default)]
pub struct IndexProgress {
    frames: AtomicU64,
    /// Events since the last frame: a link that closes, a node that is lost.
    ordinal: AtomicU32,
    bytes: AtomicU64,
    is_complete: AtomicBool,
    zero: AtomicI64,
    time: AtomicI64,
    has_times: AtomicBool,
    buses: AtomicUsize,
}

impl IndexProgress {
    pub(super) fn publish_progress(&self, world: &ReplayState, names: &[String], bytes: u64) {
        self.buses.store(names.len(), Ordering::Relaxed);
        if let (Some(zero), Some(time)) = (world.first_time(), world.last_time()) {
            self.zero.store(zero.0, Ordering::Relaxed);
            self.time.store(time.0, Ordering::Relaxed);
            self.has_times.store(true, Ordering::Relaxed);
        }
        self.bytes.store(bytes, Ordering::Relaxed);
        self.ordinal.store(world.next_position().ordinal, Ordering::Relaxed);
        self.frames.store(world.frames(), Ordering::Release);
    }

    pub(super) fn complete_index(&self) {
        self.is_complete.store(true, Ordering::Release);
    }

    /// Number of indexed frames.
    pub fn frames(&self) -> u64 {
        self.frames.load(Ordering::Acquire)
    }

    /// Position after the last indexed event.
    pub fn last_position(&self) -> EventPosition {
        let frame = self.frames();
        EventPosition { frame, ordinal: self.ordinal.load(Ordering::Relaxed) }
    }

    /// Number of decompressed bytes read.
    pub fn bytes(&self) -> u64 {
        self.bytes.load(Ordering::Relaxed)
    }

    /// Whether the whole capture is read.
    pub fn is_complete(&self) -> bool {
        self.is_complete.load(Ordering::Acquire)
    }

    /// Number of buses whose names are read; it may exceed those with indexed frames.
    pub fn buses(&self) -> usize {
        self.buses.load(Ordering::Relaxed)
    }

    /// Times of the first and of the last indexed frame.
    pub fn time_range(&self) -> Option<(Timestamp, Timestamp)> {
        self.has_times.load(Ordering::Relaxed).then(|| {
            (Timestamp(self.zero.load(Ordering::Relaxed)), Timestamp(self.time.load(Ordering::Relaxed)))
        })
    }
}

impl SharedResults {
    pub(super) fn new(
        lanes: Vec<TimelineCapture>,
        options: SessionOptions,
        read_options: ReadOptions,
    ) -> Self {
        // Short intervals, because evicted frames remove the marks at the start.
        let is_live = lanes.iter().any(|lane| lane.is_live);
        let index =
            if is_live { CheckpointIndex::with_interval(LIVE_INTERVAL) } else { CheckpointIndex::default() };
        Self {
            lanes,
            options,
            read_options,
            index: RwLock::new(index),
            survey: RwLock::default(),
            matches: RwLock::default(),
            end: Mutex::default(),
            failure: Mutex::default(),
            change: Mutex::default(),
            progress: IndexProgress::default(),
            tracing: AtomicUsize::new(0),
            has_reported_growth: AtomicBool::new(false),
            is_over: AtomicBool::new(false),
            may_begin: Mutex::new(false),
            begins: Condvar::new(),
        }
    }

    /// Opens readers at the start of the captures.
    pub(super) fn open(&self) -> Result<MergedReader<StoreReader>, CaptureError> {
        let capture = |lane: &TimelineCapture| {
            let reader = CaptureReader::open(lane.store.reader_at(0), &self.read_options)?;
            Ok(MergedCapture { reader, group: lane.group, shift: lane.shift, continues: lane.continues })
        };
        Ok(MergedReader::new(self.lanes.iter().map(capture).collect::<Result<_, CaptureError>>()?))
    }

    /// The first kept mark; None if nothing was evicted.
    pub(super) fn first_kept(&self) -> Option<Checkpoint> {
        let is_cut = self.kept_from() > 0;
        let index = self.index.read().unwrap_or_else(PoisonError::into_inner);
        index.checkpoints().first().filter(|_| is_cut).cloned()
    }

    /// First kept byte of a single capture.
    pub(super) fn kept_from(&self) -> u64 {
        if let [lane] = self.lanes.as_slice() { lane.store.start() } else { 0 }
    }

    /// Removes marks of evicted frames.
    pub(super) fn forget_evicted(&self) {
        let start = self.kept_from();
        if start > 0 {
            self.index.write().unwrap_or_else(PoisonError::into_inner).forget_before(start);
        }
    }

    /// Opens readers at a position.
    pub(super) fn resume_readers(
        &self,
        position: &MergedPosition,
    ) -> Result<MergedReader<StoreReader>, CaptureError> {
        let sources = self.lanes.iter().zip(position.offsets());
        MergedReader::resume(sources.map(|(lane, offset)| lane.store.reader_at(offset)).collect(), position)
    }

    /// Whether `frames` are all frames so far of a growing capture.
    pub(super) fn is_at_head(&self, frames: u64) -> bool {
        frames >= self.progress.frames() && self.may_grow()
    }

    pub(super) fn fail_reading(&self, error: &CaptureError) {
        let mut failure = self.failure.lock().unwrap_or_else(PoisonError::into_inner);
        failure.get_or_insert_with(|| error.to_string());
    }

    /// Compares the files of the captures with their content when they were opened; reports each change once.
    pub(super) fn report_changes(&self, news: &Sender<TimelineNews>) {
        let Some(text) = self.lanes.iter().find_map(|lane| lane.store.file_change()) else { return };
        let mut change = self.change.lock().unwrap_or_else(PoisonError::into_inner);
        if change.as_ref() != Some(&text) {
            *change = Some(text.clone());
            // The application may have ended.
            let _ = news.send(TimelineNews::Changed(text));
        }
    }

    /// Reports growth, unless an earlier report was not handled yet.
    pub(super) fn report_growth(&self, news: &Sender<TimelineNews>) {
        if self.may_grow() && !self.has_reported_growth.swap(true, Ordering::AcqRel) {
            // The application may have ended.
            let _ = news.send(TimelineNews::Grew);
        }
    }

    /// Waits at most `most` for bytes after an offset in all captures together; `true` if the next read does not
    /// wait.
    pub(super) fn waits_for_growth(&self, offset: u64, most: Duration) -> bool {
        let (mut total, mut growing) = (0, None);
        for lane in &self.lanes {
            let (length, is_complete) = lane.store.length();
            total += length;
            growing = growing.or((!is_complete).then_some((lane, length)));
        }
        match growing {
            Some((lane, length)) if total <= offset => lane.store.waits_beyond(length, most),
            _ => true,
        }
    }

    /// Whether a capture may still grow.
    pub(super) fn may_grow(&self) -> bool {
        self.lanes.iter().any(|lane| !lane.store.length().1)
    }

    /// Waits until the index is complete, so that it has the processors for itself. Growing captures are not
    /// waited for.
    pub(super) fn wait_for_index(&self) {
        if self.may_grow() {
            return;
        }
        let mut may_begin = self.may_begin.lock().unwrap_or_else(PoisonError::into_inner);
        while !*may_begin {
            may_begin = self.begins.wait(may_begin).unwrap_or_else(PoisonError::into_inner);
        }
    }

    /// Waits at most `most` for the first indexed frames.
    pub(super) fn wait_for_first(&self, most: Duration) {
        let start = Instant::now();
        while self.progress.frames() == 0 && !self.progress.is_complete() && start.elapsed() < most {
            std::thread::sleep(Duration::from_millis(1));
        }
    }

    /// Starts the threads that wait for the index.
    pub(super) fn begin_threads(&self) {
        *self.may_begin.lock().unwrap_or_else(PoisonError::into_inner) = true;
        self.begins.notify_all();
    }

    /// Waits for the end of the timeline, at most `most`; whether it has ended.
    pub(super) fn waits_for_end(&self, most: Duration) -> bool {
        let begun = self.may_begin.lock().unwrap_or_else(PoisonError::into_inner);
        let wait = self.begins.wait_timeout_while(begun, most, |_| !self.is_over());
        drop(wait.unwrap_or_else(PoisonError::into_inner));
        self.is_over()
    }

    pub(super) fn is_over(&self) -> bool {
        self.is_over.load(Ordering::Relaxed)
    }

    /// Ends all threads; the captures are still being read for another timeline.
    pub(super) fn retire_threads(&self) {
        self.is_over.store(true, Ordering::Relaxed);
        self.begin_threads();
    }

    /// Ends all threads.
    pub(super) fn stop_threads(&self) {
        self.retire_threads();
        for lane in &self.lanes {
            lane.store.end_readers();
        }
    }
}
