//! Samples of signals over time: lowest, highest and last value per interval.

use std::sync::atomic::{AtomicBool, AtomicI64, Ordering};
use std::sync::{PoisonError, RwLock};

use cobscope_decoder::frame::Timestamp;
use cobscope_decoder::replay::{SignalKey, SignalPoints};

/// Maximum number of signals sampled together.
pub const MOST_SIGNALS: usize = 12;

/// Signals sampled over a time range.
pub struct SignalTraces {
    pub(super) signals: Vec<SignalKey>,
    pub(super) from: i64,
    pub(super) to: Option<i64>,
    points: RwLock<Vec<SignalPoints>>,
    reached: AtomicI64,
    is_complete: AtomicBool,
    is_over: AtomicBool,
}

impl SignalTraces {
    /// Only the first [`MOST_SIGNALS`] signals are sampled.
    pub(super) fn new(mut signals: Vec<SignalKey>, from: Timestamp, to: Option<Timestamp>) -> Self {
        signals.truncate(MOST_SIGNALS);
        Self {
            signals,
            from: from.0,
            to: to.map(|to| to.0),
            points: RwLock::default(),
            reached: AtomicI64::new(from.0),
            is_complete: AtomicBool::new(false),
            is_over: AtomicBool::new(false),
        }
    }

    /// The sampled signals.
    pub fn signals(&self) -> &[SignalKey] {
        &self.signals
    }

    /// Samples of a signal; None if it is not sampled.
    pub fn signal_points(&self, signal: &SignalKey) -> Option<SignalPoints> {
        let place = self.signals.iter().position(|other| other == signal)?;
        self.points.read().unwrap_or_else(PoisonError::into_inner).get(place).cloned()
    }

    /// Whether the range includes `from` to `to`.
    pub fn covers_range(&self, from: i64, to: i64) -> bool {
        self.from <= from && self.to.is_none_or(|end| to <= end)
    }

    /// Whether all buckets are at most `width` long or contain single values.
    pub fn is_fine(&self, width: i64) -> bool {
        let points = self.points.read().unwrap_or_else(PoisonError::into_inner);
        points.iter().all(|points| points.is_exact || points.width <= width)
    }

    /// Percent of the range sampled so far; `end` is the end of the capture.
    pub fn sampled_share(&self, end: i64) -> i64 {
        let whole = self.to.unwrap_or(end).min(end).saturating_sub(self.from).max(1);
        let done = self.reached.load(Ordering::Relaxed).saturating_sub(self.from).clamp(0, whole);
        i64::try_from(i128::from(done) * 100 / i128::from(whole)).unwrap_or(100)
    }

    /// Whether sampling has ended.
    pub fn is_complete(&self) -> bool {
        self.is_complete.load(Ordering::Acquire)
    }

    /// Ends sampling.
    pub fn stop_sampling(&self) {
        self.is_over.store(true, Ordering::Relaxed);
    }

    pub(super) fn is_stopped(&self) -> bool {
        self.is_over.load(Ordering::Relaxed)
    }

    pub(super) fn set_points(&self, points: Vec<SignalPoints>) {
        *self.points.write().unwrap_or_else(PoisonError::into_inner) = points;
    }

    pub(super) fn set_reached(&self, time: i64) {
        self.reached.store(time, Ordering::Relaxed);
    }

    pub(super) fn complete_sampling(&self) {
        self.is_complete.store(true, Ordering::Release);
    }
}
