//! What the threads of a timeline have in common.

use std::sync::atomic::{AtomicBool, AtomicI64, AtomicU64, AtomicUsize, Ordering};
use std::sync::{Arc, Condvar, Mutex, PoisonError, RwLock};
use std::time::{Duration, Instant};

use cobscope_decoder::capture::{CaptureError, Merged, MergedCapture, MergedPosition, ReadOptions, Reader};
use cobscope_decoder::frame::Timestamp;
use cobscope_decoder::replay::{Index, Mark, World};
use cobscope_decoder::session::SessionOptions;

use super::matches::Matches;
use super::survey::Survey;
use crate::source::{Store, StoreReader};

/// Frames between two marks of a live bus, to begin with.
const LIVE_INTERVAL: u64 = 16_384;

/// One capture of a timeline.
pub struct Lane {
    /// Its bytes.
    pub store: Arc<Store>,
    /// Captures of one group are parts of one recording.
    pub group: usize,
    /// Nanoseconds added to its stamps.
    pub shift: i64,
    /// Title of its format.
    pub format: &'static str,
    /// It is being recorded now, and its beginning may be dropped.
    pub is_live: bool,
}

/// Captures, what is known of them so far, and whether anybody still wants to know.
pub struct Shared {
    pub(super) lanes: Vec<Lane>,
    pub(super) options: SessionOptions,
    pub(super) read_options: ReadOptions,
    pub(super) index: RwLock<Index>,
    pub(super) survey: RwLock<Survey>,
    pub(super) matches: RwLock<Option<Arc<Matches>>>,
    /// The world at the end, once the index is complete.
    pub(super) end: Mutex<Option<Arc<World>>>,
    /// Why reading ended early.
    pub(super) failure: Mutex<Option<String>>,
    pub(super) progress: Progress,
    /// How many threads follow signals.
    pub(super) tracing: AtomicUsize,
    /// Growth was told, and not seen yet.
    pub(super) has_told_growth: AtomicBool,
    is_over: AtomicBool,
    /// Whether what can wait for the index may begin.
    may_begin: Mutex<bool>,
    begins: Condvar,
}

/// How far the index has come.
#[derive(Default)]
pub struct Progress {
    frames: AtomicU64,
    bytes: AtomicU64,
    is_complete: AtomicBool,
    zero: AtomicI64,
    time: AtomicI64,
    has_times: AtomicBool,
}

impl Progress {
    pub(super) fn tell(&self, world: &World, bytes: u64) {
        if let (Some(zero), Some(time)) = (world.zero(), world.time()) {
            self.zero.store(zero.0, Ordering::Relaxed);
            self.time.store(time.0, Ordering::Relaxed);
            self.has_times.store(true, Ordering::Relaxed);
        }
        self.bytes.store(bytes, Ordering::Relaxed);
        self.frames.store(world.frames(), Ordering::Release);
    }

    pub(super) fn complete(&self) {
        self.is_complete.store(true, Ordering::Release);
    }

    /// Frames whose state is known.
    pub fn frames(&self) -> u64 {
        self.frames.load(Ordering::Acquire)
    }

    /// Decompressed bytes read.
    pub fn bytes(&self) -> u64 {
        self.bytes.load(Ordering::Relaxed)
    }

    /// Whether all of it was read.
    pub fn is_complete(&self) -> bool {
        self.is_complete.load(Ordering::Acquire)
    }

    /// Times of the first frame and of the last one so far.
    pub fn times(&self) -> Option<(Timestamp, Timestamp)> {
        self.has_times.load(Ordering::Relaxed).then(|| {
            (Timestamp(self.zero.load(Ordering::Relaxed)), Timestamp(self.time.load(Ordering::Relaxed)))
        })
    }
}

impl Shared {
    pub(super) fn new(lanes: Vec<Lane>, options: SessionOptions, read_options: ReadOptions) -> Self {
        // Of what is dropped at its beginning the first mark must not be far.
        let is_live = lanes.iter().any(|lane| lane.is_live);
        let index = if is_live { Index::every(LIVE_INTERVAL) } else { Index::default() };
        Self {
            lanes,
            options,
            read_options,
            index: RwLock::new(index),
            survey: RwLock::default(),
            matches: RwLock::default(),
            end: Mutex::default(),
            failure: Mutex::default(),
            progress: Progress::default(),
            tracing: AtomicUsize::new(0),
            has_told_growth: AtomicBool::new(false),
            is_over: AtomicBool::new(false),
            may_begin: Mutex::new(false),
            begins: Condvar::new(),
        }
    }

    /// Captures from their beginning.
    pub(super) fn open(&self) -> Result<Merged<StoreReader>, CaptureError> {
        let capture = |lane: &Lane| {
            let reader = Reader::open(lane.store.reader(0), &self.read_options)?;
            Ok(MergedCapture { reader, group: lane.group, shift: lane.shift })
        };
        Ok(Merged::new(self.lanes.iter().map(capture).collect::<Result<_, CaptureError>>()?))
    }

    /// The first place that is kept, where the beginning is not.
    pub(super) fn first_kept(&self) -> Option<Mark> {
        let is_cut = self.kept_from() > 0;
        let index = self.index.read().unwrap_or_else(PoisonError::into_inner);
        index.marks().first().filter(|_| is_cut).cloned()
    }

    /// Byte of a single capture from which on it is kept.
    pub(super) fn kept_from(&self) -> u64 {
        if let [lane] = self.lanes.as_slice() { lane.store.start() } else { 0 }
    }

    /// Forgets places that are not kept any more.
    pub(super) fn forget(&self) {
        let start = self.kept_from();
        if start > 0 {
            self.index.write().unwrap_or_else(PoisonError::into_inner).forget_before(start);
        }
    }

    /// Captures from a place on.
    pub(super) fn resume(&self, position: &MergedPosition) -> Result<Merged<StoreReader>, CaptureError> {
        let sources = self.lanes.iter().zip(position.offsets());
        Merged::resume(sources.map(|(lane, offset)| lane.store.reader(offset)).collect(), position)
    }

    /// Whether more frames are still coming, and these are all by now.
    pub(super) fn is_at_head(&self, frames: u64) -> bool {
        frames >= self.progress.frames() && self.grows()
    }

    pub(super) fn fail(&self, error: &CaptureError) {
        let mut failure = self.failure.lock().unwrap_or_else(PoisonError::into_inner);
        failure.get_or_insert_with(|| error.to_string());
    }

    /// Whether more of a capture may come.
    pub(super) fn grows(&self) -> bool {
        self.lanes.iter().any(|lane| !lane.store.length().1)
    }

    /// Leaves the processors to the index until it is complete; of what still grows nobody waits for the end.
    pub(super) fn wait_for_index(&self) {
        if self.grows() {
            return;
        }
        let mut may_begin = self.may_begin.lock().unwrap_or_else(PoisonError::into_inner);
        while !*may_begin {
            may_begin = self.begins.wait(may_begin).unwrap_or_else(PoisonError::into_inner);
        }
    }

    /// Lets the index come to its first frames, `most` at most.
    pub(super) fn wait_for_first(&self, most: Duration) {
        let start = Instant::now();
        while self.progress.frames() == 0 && !self.progress.is_complete() && start.elapsed() < most {
            std::thread::sleep(Duration::from_millis(1));
        }
    }

    /// The index is complete, or nobody needs it any more.
    pub(super) fn begin(&self) {
        *self.may_begin.lock().unwrap_or_else(PoisonError::into_inner) = true;
        self.begins.notify_all();
    }

    pub(super) fn is_over(&self) -> bool {
        self.is_over.load(Ordering::Relaxed)
    }

    /// Nobody wants to know any more.
    pub(super) fn stop(&self) {
        self.is_over.store(true, Ordering::Relaxed);
        self.begin();
        for lane in &self.lanes {
            lane.store.abandon();
        }
    }
}
