//! Signals over time: the lowest, highest and last value of each piece of it, as the layout in force tells them.

use std::sync::atomic::{AtomicBool, AtomicI64, Ordering};
use std::sync::{Arc, PoisonError, RwLock};

use cobscope_decoder::frame::Timestamp;

use super::signal::SignalKey;
use crate::bucket::Bucket;

/// Signals that can be had at once.
pub const MOST_SIGNALS: usize = 12;

/// Signals over a range of time.
pub struct Traces {
    pub(super) signals: Vec<SignalKey>,
    pub(super) from: i64,
    pub(super) to: Option<i64>,
    points: RwLock<Vec<Points>>,
    reached: AtomicI64,
    is_complete: AtomicBool,
    is_over: AtomicBool,
}

/// What is known of one signal by now.
#[derive(Clone)]
pub struct Points {
    /// Its values, in the order of time; the first may be from before the range.
    pub buckets: Arc<Vec<Bucket>>,
    /// Nanoseconds of a bucket.
    pub width: i64,
    /// No bucket has more than one value.
    pub is_exact: bool,
    /// Some value rests on an assumption.
    pub is_assumed: bool,
}

impl Traces {
    /// Of more than [`MOST_SIGNALS`] the first are taken.
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

    /// What is traced.
    pub fn signals(&self) -> &[SignalKey] {
        &self.signals
    }

    /// What is known of a signal, if it is one of these.
    pub fn points(&self, signal: &SignalKey) -> Option<Points> {
        let place = self.signals.iter().position(|other| other == signal)?;
        self.points.read().unwrap_or_else(PoisonError::into_inner).get(place).cloned()
    }

    /// Whether a range lies within this one.
    pub fn covers(&self, from: i64, to: i64) -> bool {
        self.from <= from && self.to.is_none_or(|end| to <= end)
    }

    /// Whether all buckets are at most that long, or could not tell more if they were.
    pub fn is_fine(&self, width: i64) -> bool {
        let points = self.points.read().unwrap_or_else(PoisonError::into_inner);
        points.iter().all(|points| points.is_exact || points.width <= width)
    }

    /// Percent of the range that was looked at, if it ends at `end` at the latest.
    pub fn share(&self, end: i64) -> i64 {
        let whole = self.to.unwrap_or(end).min(end).saturating_sub(self.from).max(1);
        let done = self.reached.load(Ordering::Relaxed).saturating_sub(self.from).clamp(0, whole);
        i64::try_from(i128::from(done) * 100 / i128::from(whole)).unwrap_or(100)
    }

    /// Whether all of it was looked at, or nobody wants that any more.
    pub fn is_complete(&self) -> bool {
        self.is_complete.load(Ordering::Acquire)
    }

    /// Nobody wants to know any more.
    pub fn stop(&self) {
        self.is_over.store(true, Ordering::Relaxed);
    }

    pub(super) fn is_stopped(&self) -> bool {
        self.is_over.load(Ordering::Relaxed)
    }

    pub(super) fn set_points(&self, points: Vec<Points>) {
        *self.points.write().unwrap_or_else(PoisonError::into_inner) = points;
    }

    pub(super) fn set_reached(&self, time: i64) {
        self.reached.store(time, Ordering::Relaxed);
    }

    pub(super) fn complete(&self) {
        self.is_complete.store(true, Ordering::Release);
    }
}
