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

use crate::state::UiState;
use crate::timeline::{SignalKey, SignalPoints, SignalTraces};

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
pub(super) struct PlotView {
    /// Start and end; None for the whole capture.
    part: Option<(i64, i64)>,
    whole: Vec<Arc<SignalTraces>>,
    near: Option<Arc<SignalTraces>>,
    aim: Option<TimeTarget>,
}

impl PlotView {
    /// Times of the first and of the last known frame; None without timestamps.
    pub(super) fn whole_range(core: &UiState) -> Option<(i64, i64)> {
        let first = core.timeline.first_time()?;
        let (zero, last) = core.timeline.progress().time_range().unwrap_or((first, first));
        Some((zero.0.min(first.0), last.0.max(first.0.saturating_add(1))))
    }

    /// Start and end of the view.
    pub(super) fn view_range(&self, core: &UiState) -> Option<(i64, i64)> {
        self.part.or_else(|| Self::whole_range(core))
    }

    /// Whether the view is the whole capture.
    pub(super) fn is_whole(&self) -> bool {
        self.part.is_none()
    }

    /// Time of the cursor, or of the target the user selected.
    pub(super) fn cursor_time(&self, core: &UiState) -> Option<i64> {
        self.aim.map(|aim| aim.time).or_else(|| core.cursor_time().map(|time| time.0))
    }

    /// Sets the target time.
    pub(super) fn aim_at(&mut self, time: i64) {
        self.aim = Some(TimeTarget { time, spot: None });
    }

    /// Removes the target because the cursor moved elsewhere.
    pub(super) fn forget_aim(&mut self) {
        self.aim = None;
    }

    /// Halves or doubles the range around the cursor.
    pub(super) fn zoom_range(&mut self, core: &UiState, is_in: bool) -> Result<(), &'static str> {
        let (Some((from, to)), Some(whole)) = (self.view_range(core), Self::whole_range(core)) else {
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
        let middle = self.cursor_time(core).unwrap_or(from).clamp(from, to);
        let before = i128::from(middle.saturating_sub(from)) * i128::from(wanted) / i128::from(span);
        let start = middle.saturating_sub(i64::try_from(before).unwrap_or(wanted));
        self.part = range_within(start, wanted, whole);
        Ok(())
    }

    /// Moves the range to the cursor and starts sampling where the data is too coarse.
    pub(super) fn refresh_range(&mut self, core: &UiState, signals: &[SignalKey]) {
        self.bind_target(core);
        if let (Some((from, to)), Some(time)) = (self.part, self.cursor_time(core))
            && !(from..=to).contains(&time)
            && let Some(whole) = Self::whole_range(core)
        {
            let span = to.saturating_sub(from);
            self.part = range_within(time.saturating_sub(span / 2), span, whole);
        }
        self.start_sampling(core, signals);
        self.look_closer(core, signals);
    }

    /// Binds the target to the position of the cursor; removes it once the cursor is elsewhere.
    fn bind_target(&mut self, core: &UiState) {
        let Some(aim) = &mut self.aim else { return };
        if core.is_waiting() || core.is_pending() {
            return;
        }
        let is_there = *aim.spot.get_or_insert(core.cursor) == core.cursor;
        if !is_there || core.cursor_time().is_some_and(|time| time.0 > aim.time) {
            self.aim = None;
        }
    }

    /// Starts sampling the signals that have no samples of the whole capture.
    fn start_sampling(&mut self, core: &UiState, signals: &[SignalKey]) {
        let has = |traces: &Arc<SignalTraces>, key: &SignalKey| traces.signals().contains(key);
        let is_wanted = |traces: &Arc<SignalTraces>| signals.iter().any(|key| has(traces, key));
        self.whole.iter().filter(|traces| !is_wanted(traces)).for_each(|traces| traces.stop_sampling());
        self.whole.retain(is_wanted);
        let Some(first) = core.timeline.first_time() else { return };
        if signals.iter().all(|key| self.whole.iter().any(|traces| has(traces, key))) {
            return;
        }
        // Unfinished signals restart together with the new ones: one pass for all.
        self.whole.iter().filter(|traces| !traces.is_complete()).for_each(|traces| traces.stop_sampling());
        self.whole.retain(|traces| traces.is_complete());
        let is_missing = |key: &&SignalKey| !self.whole.iter().any(|traces| has(traces, key));
        let missing: Vec<_> = signals.iter().filter(is_missing).cloned().collect();
        self.whole.push(core.timeline.start_sampling(missing, first, None));
    }

    /// Samples the view again if the samples of the whole capture are too coarse for it.
    fn look_closer(&mut self, core: &UiState, signals: &[SignalKey]) {
        let part = self.part.filter(|_| !signals.is_empty());
        let Some((from, to)) = part else { return self.give_up_near() };
        let span = to.saturating_sub(from);
        let width = span / LEAST_BUCKETS;
        if self.whole.iter().all(|traces| traces.is_complete() && traces.is_fine(width)) {
            return self.give_up_near();
        }
        let will_do = |near: &Arc<SignalTraces>| {
            let has_all = signals.iter().all(|key| near.signals().contains(key));
            has_all && near.covers_range(from, to) && near.is_fine(width)
        };
        if self.near.as_ref().is_some_and(will_do) {
            return;
        }
        self.give_up_near();
        let (start, end) = (from.saturating_sub(span), to.saturating_add(span));
        self.near =
            Some(core.timeline.start_sampling(signals.to_vec(), Timestamp(start), Some(Timestamp(end))));
    }

    fn give_up_near(&mut self) {
        if let Some(near) = self.near.take() {
            near.stop_sampling();
        }
    }

    /// The finest complete samples of a signal.
    pub(super) fn finest_points(&self, core: &UiState, signal: &SignalKey) -> Option<SignalPoints> {
        let (from, to) = self.view_range(core)?;
        let near = self.near.as_ref().filter(|near| near.is_complete() && near.covers_range(from, to));
        let whole = || self.whole.iter().find_map(|traces| traces.signal_points(signal));
        near.and_then(|near| near.signal_points(signal)).or_else(whole)
    }

    /// Percent sampled so far; None when complete.
    pub(super) fn sampled_share(&self, core: &UiState) -> Option<i64> {
        let (_, last) = Self::whole_range(core)?;
        let unfinished = self.whole.iter().chain(&self.near).find(|traces| !traces.is_complete())?;
        Some(unfinished.sampled_share(last))
    }
}

/// A range within the capture; None if it is the whole capture.
fn range_within(start: i64, span: i64, (zero, last): (i64, i64)) -> Option<(i64, i64)> {
    if span >= last.saturating_sub(zero) {
        return None;
    }
    let start = start.clamp(zero, last.saturating_sub(span));
    Some((start, start.saturating_add(span)))
}
