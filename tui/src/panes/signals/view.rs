//! Which part of time is plotted, what is known of it, and where the cursors are.
//!
//! ```text
//! zero │─────────────── whole ───────────────│ last       coarse, followed once
//!            │──── near: view and beside ────│            finer, followed when zooming in shows too little
//!                   │── view ──│
//! ```

use std::sync::Arc;

use cobscope_decoder::frame::Timestamp;
use cobscope_decoder::replay::Spot;

use crate::state::Core;
use crate::timeline::{Points, SignalKey, Traces};

/// Shortest time that can be plotted, in nanoseconds.
const LEAST_SPAN: i64 = 100_000;

/// Pieces of time a view is made of at least; a screen of 250 columns shows no more.
const LEAST_BUCKETS: i64 = 512;

/// A time the user moved to, at which no event need be.
#[derive(Debug, Clone, Copy)]
struct Aim {
    time: i64,
    /// Where the cursor came to be, once that is known.
    spot: Option<Spot>,
}

/// What is plotted of time.
#[derive(Default)]
pub(super) struct View {
    /// From one time to another; all of it for none.
    part: Option<(i64, i64)>,
    whole: Vec<Arc<Traces>>,
    near: Option<Arc<Traces>>,
    aim: Option<Aim>,
}

impl View {
    /// Times of the first frame and of the last one known; nothing where there are no times.
    pub(super) fn whole(core: &Core) -> Option<(i64, i64)> {
        let first = core.timeline.first()?;
        let (zero, last) = core.timeline.progress().times().unwrap_or((first, first));
        Some((zero.0.min(first.0), last.0.max(first.0.saturating_add(1))))
    }

    /// What is in view.
    pub(super) fn range(&self, core: &Core) -> Option<(i64, i64)> {
        self.part.or_else(|| Self::whole(core))
    }

    /// Whether that is all of it.
    pub(super) fn is_whole(&self) -> bool {
        self.part.is_none()
    }

    /// Time of the cursor.
    pub(super) fn cursor(&self, core: &Core) -> Option<i64> {
        self.aim.map(|aim| aim.time).or_else(|| core.time().map(|time| time.0))
    }

    /// The user goes to a time.
    pub(super) fn aim(&mut self, time: i64) {
        self.aim = Some(Aim { time, spot: None });
    }

    /// The cursor goes somewhere else.
    pub(super) fn forget_aim(&mut self) {
        self.aim = None;
    }

    /// Half as much around the cursor, or twice.
    pub(super) fn zoom(&mut self, core: &Core, is_in: bool) -> Result<(), &'static str> {
        let (Some((from, to)), Some(whole)) = (self.range(core), Self::whole(core)) else {
            return Err("this capture has no times");
        };
        let span = to.saturating_sub(from).max(1);
        let wanted = if is_in { span / 2 } else { span.saturating_mul(2) };
        if is_in && wanted < LEAST_SPAN {
            return Err("this is as close as it goes");
        }
        if !is_in && self.part.is_none() {
            return Err("this is all of it");
        }
        let middle = self.cursor(core).unwrap_or(from).clamp(from, to);
        let before = i128::from(middle.saturating_sub(from)) * i128::from(wanted) / i128::from(span);
        let start = middle.saturating_sub(i64::try_from(before).unwrap_or(wanted));
        self.part = within(start, wanted, whole);
        Ok(())
    }

    /// Looks where the cursor is, and whether what is known will do.
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

    /// The place of a time that was gone to is where the cursor is now; gone from there, the time is over.
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

    /// Has all signals followed through the whole capture.
    fn follow(&mut self, core: &Core, signals: &[SignalKey]) {
        let has = |traces: &Arc<Traces>, key: &SignalKey| traces.signals().contains(key);
        let is_wanted = |traces: &Arc<Traces>| signals.iter().any(|key| has(traces, key));
        self.whole.iter().filter(|traces| !is_wanted(traces)).for_each(|traces| traces.stop());
        self.whole.retain(is_wanted);
        let Some(first) = core.timeline.first() else { return };
        if signals.iter().all(|key| self.whole.iter().any(|traces| has(traces, key))) {
            return;
        }
        // Those on their way begin again together with the new ones: one pass for all.
        self.whole.iter().filter(|traces| !traces.is_complete()).for_each(|traces| traces.stop());
        self.whole.retain(|traces| traces.is_complete());
        let is_missing = |key: &&SignalKey| !self.whole.iter().any(|traces| has(traces, key));
        let missing: Vec<_> = signals.iter().filter(is_missing).cloned().collect();
        self.whole.push(core.timeline.trace(missing, first, None));
    }

    /// Has a part followed once more where too little is known of it.
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

    /// The best that is known of a signal by now.
    pub(super) fn points(&self, core: &Core, signal: &SignalKey) -> Option<Points> {
        let (from, to) = self.range(core)?;
        let near = self.near.as_ref().filter(|near| near.is_complete() && near.covers(from, to));
        let whole = || self.whole.iter().find_map(|traces| traces.points(signal));
        near.and_then(|near| near.points(signal)).or_else(whole)
    }

    /// Percent of the capture that was followed, until all of it was.
    pub(super) fn share(&self, core: &Core) -> Option<i64> {
        let (_, last) = Self::whole(core)?;
        let unfinished = self.whole.iter().chain(&self.near).find(|traces| !traces.is_complete())?;
        Some(unfinished.share(last))
    }
}

/// A part of the whole; nothing if it is all of it.
fn within(start: i64, span: i64, (zero, last): (i64, i64)) -> Option<(i64, i64)> {
    if span >= last.saturating_sub(zero) {
        return None;
    }
    let start = start.clamp(zero, last.saturating_sub(span));
    Some((start, start.saturating_add(span)))
}
