//! The plotted time range, its sampled data and the cursors.
//!
//! ```text
//! zero │─────────────── whole ───────────────│ last       coarse, sampled once
//!            │──── near: view and margins ───│            finer, sampled when zooming in needs it
//!                   │── view ──│
//! ```

use std::sync::Arc;

use cobscope_decoder::frame::Timestamp;
use cobscope_decoder::replay::EventPosition;

use crate::state::Core;
use crate::timeline::{Points, SignalKey, Traces};

/// Shortest range that can be plotted, in ns.
const LEAST_SPAN: i64 = 100_000;

/// Minimum number of samples in a view; a screen of 250 columns shows no more.
const LEAST_BUCKETS: i64 = 512;

/// A time selected by the user; there may be no event at it.
#[derive(Debug, Clone, Copy)]
struct TimeTarget {
    time: i64,
    /// Position of the cursor at that time; None until it is known.
    spot: Option<EventPosition>,
}

/// The plotted range with its samples.
#[derive(Default)]
pub(super) struct View {
    /// Start and end; None for the whole capture.
    part: Option<(i64, i64)>,
    whole: Vec<Arc<Traces>>,
    near: Option<Arc<Traces>>,
    aim: Option<TimeTarget>,
}

impl View {
    /// Times of the first and of the last known frame; None without timestamps.
    pub(super) fn whole(core: &Core) -> Option<(i64, i64)> {
        let first = core.timeline.first()?;
        let (zero, last) = core.timeline.progress().times().unwrap_or((first, first));
        Some((zero.0.min(first.0), last.0.max(first.0.saturating_add(1))))
    }

    /// Start and end of the view.
    pub(super) fn range(&self, core: &Core) -> Option<(i64, i64)> {
        self.part.or_else(|| Self::whole(core))
    }

    /// Whether the view is the whole capture.
    pub(super) fn is_whole(&self) -> bool {
        self.part.is_none()
    }

    /// Time of the cursor, or of the target the user selected.
    pub(super) fn cursor(&self, core: &Core) -> Option<i64> {
        self.aim.map(|aim| aim.time).or_else(|| core.time().map(|time| time.0))
    }

    /// Sets the target time.
    pub(super) fn aim(&mut self, time: i64) {
        self.aim = Some(TimeTarget { time, spot: None });
    }

    /// Removes the target because the cursor moved elsewhere.
    pub(super) fn forget_aim(&mut self) {
        self.aim = None;
    }

    /// Halves or doubles the range around the cursor.
    pub(super) fn zoom(&mut self, core: &Core, is_in: bool) -> Result<(), &'static str> {
        let (Some((from, to)), Some(whole)) = (self.range(core), Self::whole(core)) else {
            return Err("this capture has no timestamps");
        };
        let span = to.saturating_sub(from).max(1);
        let wanted = if is_in { span / 2 } else { span.saturating_mul(2) };
        if is_in && wanted < LEAST_SPAN {
            return Err("shortest range reached");
        }
        if !is_in && self.part.is_none() {
            return Err("the whole capture is shown");
        }
        let middle = self.cursor(core).unwrap_or(from).clamp(from, to);
        let before = i128::from(middle.saturating_sub(from)) * i128::from(wanted) / i128::from(span);
        let start = middle.saturating_sub(i64::try_from(before).unwrap_or(wanted));
        self.part = within(start, wanted, whole);
        Ok(())
    }

    /// Moves the range to the cursor and starts sampling where the data is too coarse.
    pub(super) fn refresh(&mut self, core: &Core, signals: &[SignalKey]) {
        self.land(core);
        if let (Some((from, to)), Some(time)) = (self.part, self.cursor(core))
            && !(from..=to).contains(&time)
            && let Some(whole) = Self::whole(core)
        {
            let span = to.saturating_sub(from);
            self.part = within(time.saturating_sub(span / 2), span, whole);
        }
        self.follow(core, signals);
        self.look_closer(core, signals);
    }

    /// Binds the target to the position of the cursor; removes it once the cursor is elsewhere.
    fn land(&mut self, core: &Core) {
        let Some(aim) = &mut self.aim else { return };
        if core.is_waiting() || core.is_pending() {
            return;
        }
        let is_there = *aim.spot.get_or_insert(core.cursor) == core.cursor;
        if !is_there || core.time().is_some_and(|time| time.0 > aim.time) {
            self.aim = None;
        }
    }

    /// Starts sampling the signals that have no samples of the whole capture.
    fn follow(&mut self, core: &Core, signals: &[SignalKey]) {
        let has = |traces: &Arc<Traces>, key: &SignalKey| traces.signals().contains(key);
        let is_wanted = |traces: &Arc<Traces>| signals.iter().any(|key| has(traces, key));
        self.whole.iter().filter(|traces| !is_wanted(traces)).for_each(|traces| traces.stop());
        self.whole.retain(is_wanted);
        let Some(first) = core.timeline.first() else { return };
        if signals.iter().all(|key| self.whole.iter().any(|traces| has(traces, key))) {
            return;
        }
        // Unfinished signals restart together with the new ones: one pass for all.
        self.whole.iter().filter(|traces| !traces.is_complete()).for_each(|traces| traces.stop());
        self.whole.retain(|traces| traces.is_complete());
        let is_missing = |key: &&SignalKey| !self.whole.iter().any(|traces| has(traces, key));
        let missing: Vec<_> = signals.iter().filter(is_missing).cloned().collect();
        self.whole.push(core.timeline.trace(missing, first, None));
    }

    /// Samples the view again if the samples of the whole capture are too coarse for it.
    fn look_closer(&mut self, core: &Core, signals: &[SignalKey]) {
        let part = self.part.filter(|_| !signals.is_empty());
        let Some((from, to)) = part else { return self.give_up_near() };
        let span = to.saturating_sub(from);
        let width = span / LEAST_BUCKETS;
        if self.whole.iter().all(|traces| traces.is_complete() && traces.is_fine(width)) {
            return self.give_up_near();
        }
        let will_do = |near: &Arc<Traces>| {
            let has_all = signals.iter().all(|key| near.signals().contains(key));
            has_all && near.covers(from, to) && near.is_fine(width)
        };
        if self.near.as_ref().is_some_and(will_do) {
            return;
        }
        self.give_up_near();
        let (start, end) = (from.saturating_sub(span), to.saturating_add(span));
        self.near = Some(core.timeline.trace(signals.to_vec(), Timestamp(start), Some(Timestamp(end))));
    }

    fn give_up_near(&mut self) {
        if let Some(near) = self.near.take() {
            near.stop();
        }
    }

    /// The finest complete samples of a signal.
    pub(super) fn points(&self, core: &Core, signal: &SignalKey) -> Option<Points> {
        let (from, to) = self.range(core)?;
        let near = self.near.as_ref().filter(|near| near.is_complete() && near.covers(from, to));
        let whole = || self.whole.iter().find_map(|traces| traces.points(signal));
        near.and_then(|near| near.points(signal)).or_else(whole)
    }

    /// Percent sampled so far; None when complete.
    pub(super) fn share(&self, core: &Core) -> Option<i64> {
        let (_, last) = Self::whole(core)?;
        let unfinished = self.whole.iter().chain(&self.near).find(|traces| !traces.is_complete())?;
        Some(unfinished.share(last))
    }
}

/// A range within the capture; None if it is the whole capture.
fn within(start: i64, span: i64, (zero, last): (i64, i64)) -> Option<(i64, i64)> {
    if span >= last.saturating_sub(zero) {
        return None;
    }
    let start = start.clamp(zero, last.saturating_sub(span));
    Some((start, start.saturating_add(span)))
}
