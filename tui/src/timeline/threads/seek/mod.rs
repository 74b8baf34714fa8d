//! Decodes the rows and the state at a position.
//!
//! ```text
//! mark ──decode──▶ │ up to `before` rows │ place │ up to `after` rows │
//! ```
//!
//! It keeps closely spaced marks of its own, so that moving nearby is cheap.

mod ahead;
mod lost;
mod search;

use std::collections::VecDeque;
use std::sync::mpsc::{Receiver, Sender, TryRecvError};
use std::sync::{Arc, PoisonError};
use std::time::Duration;

use cobscope_decoder::capture::CaptureError;
use cobscope_decoder::frame::Frame;
use cobscope_decoder::replay::{Checkpoint, EventPosition, PlacedEvent};

use crate::timeline::order::{RowWindow, SeekTarget, WindowRequest};
use crate::timeline::shared::SharedResults;
use crate::timeline::walk::{self, TimelineWalk};
use crate::timeline::{ReplayRow, RowMatcher, SearchMatches, TimelineNews};

/// Time the index may take for its first frames before the pane is shown as empty.
const FIRST_WAIT: Duration = Duration::from_millis(50);

/// Number of frames between two own marks.
const NEAR: u64 = 8_192;

/// Maximum number of own marks; the oldest are evicted.
const MOST_NEAR: usize = 64;

/// Initial number of frames decoded before a position if the number of matches is unknown.
const FIRST_SPAN: u64 = 512;

/// Maximum length of a transfer whose frames are collected, and maximum number of its frames.
const MOST_SPAN: u64 = 4_096;
const MOST_FRAMES: usize = 512;

/// Handles orders until the timeline ends; of several waiting orders only the last one.
pub(in crate::timeline) fn run_seeker(
    shared: &Arc<SharedResults>,
    orders: &Receiver<WindowRequest>,
    news: &Sender<TimelineNews>,
) {
    let mut seeker = Seeker { shared: Arc::clone(shared), near: VecDeque::new() };
    let mut next = orders.recv().ok();
    shared.wait_for_first(FIRST_WAIT);
    while let Some(order) = next.take() {
        let mut newer = None;
        let mut is_stale = || {
            while let Ok(order) = orders.try_recv() {
                newer = Some(order);
            }
            newer.is_some() || shared.is_over()
        };
        let answer = seeker.answer_request(&order, &mut is_stale);
        let message = match answer {
            Ok(Some(window)) => Some(TimelineNews::Window(Box::new(window))),
            Ok(None) => None,
            Err(error) => {
                shared.report_changes(news);
                Some(lost::lost_window(shared, &order, &error))
            }
        };
        if message.is_some_and(|message| news.send(message).is_err()) || shared.is_over() {
            return;
        }
        next = newer.or_else(|| latest_request(orders));
    }
}

fn latest_request(orders: &Receiver<WindowRequest>) -> Option<WindowRequest> {
    let mut last = orders.recv().ok()?;
    loop {
        match orders.try_recv() {
            Ok(order) => last = order,
            Err(TryRecvError::Empty | TryRecvError::Disconnected) => return Some(last),
        }
    }
}

struct Seeker {
    shared: Arc<SharedResults>,
    near: VecDeque<Checkpoint>,
}

/// Rows collected on both sides of a position.
#[derive(Default)]
struct NeighbourRows {
    before: VecDeque<ReplayRow>,
    after: Vec<ReplayRow>,
}

type Answer<T> = Result<Option<T>, CaptureError>;

impl Seeker {
    /// The window at a position; None if a newer order arrived.
    fn answer_request(
        &mut self,
        order: &WindowRequest,
        is_stale: &mut impl FnMut() -> bool,
    ) -> Answer<RowWindow> {
        let is_complete = self.shared.progress.is_complete();
        let frames = self.shared.progress.frames();
        let is_pending = !is_complete && self.is_behind(order.target, frames);
        if is_pending
            && let Some(window) = self.preview_window(order).filter(|window| !window.rows.is_empty())
        {
            return Ok(Some(window));
        }
        let Some(mut spot) = self.position_of(order.target, frames, is_stale)? else { return Ok(None) };
        let mut is_missed = false;
        if let Some(search) = &order.search {
            let Some(met) = self.search_next(order, search, spot, frames, is_stale)? else { return Ok(None) };
            is_missed = met.is_none();
            spot = met.unwrap_or(spot);
        }
        let matches = self.find_matches(&order.matcher);
        let mut span = FIRST_SPAN.max(order.before as u64 * 4);
        loop {
            let from = match &matches {
                Some(matches) => matches.frame_before(spot.frame, order.before + 1).saturating_sub(1),
                None => spot.frame.saturating_sub(span),
            };
            let Some(walk) = self.walk_to(from, is_stale)? else { return Ok(None) };
            let Some(window) = self.look_around(walk, order, spot, matches.as_deref(), is_stale)? else {
                return Ok(None);
            };
            if window.selected + 1 >= order.before || from == 0 || matches.is_some() {
                let Some(frames) = self.transfer_frames(&window, is_stale)? else { return Ok(None) };
                return Ok(Some(RowWindow { frames, is_pending, is_missed, ..window }));
            }
            span = span.saturating_mul(8);
        }
    }

    /// A preview of a position ahead of the index.
    fn preview_window(&self, order: &WindowRequest) -> Option<RowWindow> {
        let index = self.shared.index.read().unwrap_or_else(PoisonError::into_inner);
        let world = Arc::new(index.checkpoints().last()?.world.clone());
        drop(index);
        let rows = ahead::rows_ahead(&self.shared, order.target, order.before.max(1), &world)?;
        let selected = if order.target == SeekTarget::End { rows.len().checked_sub(1)? } else { 0 };
        let spot = EventPosition::after_frame(world.frames());
        let (is_pending, is_missed, frames) = (true, false, Vec::new());
        Some(RowWindow { serial: order.serial, rows, selected, spot, world, is_pending, is_missed, frames })
    }

    /// Whether a position is not indexed yet.
    fn is_behind(&self, target: SeekTarget, frames: u64) -> bool {
        match target {
            SeekTarget::Event(spot) => spot.frame > frames,
            SeekTarget::Time(time) => self.shared.progress.time_range().is_none_or(|(_, last)| time > last),
            // The end of a growing capture is its present end.
            SeekTarget::End => self.shared.lanes.iter().all(|lane| lane.store.length().1),
        }
    }

    /// Converts a target to the position of an event.
    fn position_of(
        &mut self,
        target: SeekTarget,
        frames: u64,
        is_stale: &mut impl FnMut() -> bool,
    ) -> Answer<EventPosition> {
        let time = match target {
            SeekTarget::Event(spot) if spot.frame <= frames => return Ok(Some(spot)),
            SeekTarget::Event(_) | SeekTarget::End => return Ok(Some(EventPosition::after_frame(frames))),
            SeekTarget::Time(time) => time,
        };
        let index = self.shared.index.read().unwrap_or_else(PoisonError::into_inner);
        let from = index.before_time(time).map_or(0, |mark| mark.frames);
        drop(index);
        let near = self.near.iter().filter(|mark| mark.time.is_some_and(|at| at < time));
        let from = near.map(|mark| mark.frames).max().unwrap_or(0).max(from);
        let Some(mut walk) = self.walk_to(from, is_stale)? else { return Ok(None) };
        while walk.world.frames() < frames {
            if walk.peek_frame()?.and_then(|next| next.time).is_some_and(|next| next > time) {
                break;
            }
            walk.step_item(&mut |_| ())?;
            if walk.world.frames().is_multiple_of(NEAR) {
                self.remember_walk(&walk);
            }
        }
        Ok(Some(EventPosition::after_frame(walk.world.frames())))
    }

    /// The complete search for this matcher.
    fn find_matches(&self, matcher: &RowMatcher) -> Option<Arc<SearchMatches>> {
        let found = self.shared.matches.read().unwrap_or_else(PoisonError::into_inner).clone()?;
        (found.matcher == *matcher && found.is_complete()).then_some(found)
    }

    /// A walk at a frame, started at the nearest mark before it.
    fn walk_to(&mut self, frame: u64, is_stale: &mut impl FnMut() -> bool) -> Answer<TimelineWalk> {
        let kept = self.shared.kept_from();
        self.near.retain(|mark| mark.position.offsets().next().is_some_and(|offset| offset >= kept));
        let near = self.near.iter().filter(|mark| mark.frames <= frame).max_by_key(|mark| mark.frames);
        let index = self.shared.index.read().unwrap_or_else(PoisonError::into_inner);
        let far = index.before_frame(frame);
        let mark = near.into_iter().chain(far).max_by_key(|mark| mark.frames).cloned();
        drop(index);
        let mut walk = match mark {
            Some(mark) => walk::resume_walk(&self.shared, &mark)?,
            None => walk::start_walk(&self.shared)?,
        };
        let mut next = walk.world.frames() + NEAR;
        while walk.world.frames() < frame {
            if !walk.skip_batch(frame, &mut |_| ())? {
                break;
            }
            if self.is_stale_at(&walk, &mut next, is_stale) {
                return Ok(None);
            }
        }
        Ok(Some(walk))
    }

    fn remember_walk(&mut self, walk: &TimelineWalk) {
        let frames = walk.world.frames();
        let is_known = self.near.iter().any(|mark| mark.frames.abs_diff(frames) < NEAR / 2);
        if is_known {
            return;
        }
        if let Some(mark) = walk.mark_position() {
            if self.near.len() >= MOST_NEAR {
                self.near.pop_front();
            }
            self.near.push_back(mark);
        }
    }

    /// Stores a mark at intervals and checks for a newer order.
    fn is_stale_at(
        &mut self,
        walk: &TimelineWalk,
        next: &mut u64,
        is_stale: &mut impl FnMut() -> bool,
    ) -> bool {
        if walk.world.frames() < *next {
            return false;
        }
        *next = walk.world.frames() + NEAR;
        self.remember_walk(walk);
        is_stale()
    }

    /// Walks past the position and collects the rows on both sides.
    fn look_around(
        &mut self,
        mut walk: TimelineWalk,
        order: &WindowRequest,
        spot: EventPosition,
        matches: Option<&SearchMatches>,
        is_stale: &mut impl FnMut() -> bool,
    ) -> Answer<RowWindow> {
        let mut found = NeighbourRows::default();
        let mut next = walk.world.frames() + NEAR;
        while !walk::is_at_head(&walk, &self.shared)
            && walk.peek_frame()?.is_none_or(|next| next.number <= spot.frame)
        {
            if !walk.step_item(&mut |reported: PlacedEvent<'_>| found.take_event(order, spot, &reported))? {
                break;
            }
            if self.is_stale_at(&walk, &mut next, is_stale) {
                return Ok(None);
            }
        }
        let world = Arc::new(walk.world.clone());
        let at_hand = matches.and_then(|matches| matches.matching_rows(spot, order.before, order.after));
        let (rows, selected) = if let Some(rows) = at_hand {
            let selected = rows.partition_point(|row| row.spot <= spot).saturating_sub(1);
            (rows, selected)
        } else {
            self.go_on(walk, order, matches, &mut found, is_stale)?;
            let selected = found.before.len().saturating_sub(1);
            let after = found.after.into_iter().take(order.after);
            (found.before.into_iter().chain(after).collect(), selected)
        };
        let (serial, frames) = (order.serial, Vec::new());
        Ok(Some(RowWindow {
            serial,
            rows,
            selected,
            spot,
            world,
            frames,
            is_pending: false,
            is_missed: false,
        }))
    }

    /// Frames of the transfer in the selected row.
    fn transfer_frames(
        &mut self,
        window: &RowWindow,
        is_stale: &mut impl FnMut() -> bool,
    ) -> Answer<Vec<Frame>> {
        let Some(row) = window.rows.get(window.selected).filter(|row| row.is_exchange()) else {
            return Ok(Some(Vec::new()));
        };
        let (first, last) = (row.event.frames.first, row.event.frames.last);
        if first == 0 || last.saturating_sub(first) > MOST_SPAN {
            return Ok(Some(Vec::new()));
        }
        let Some(mut walk) = self.walk_to(first - 1, is_stale)? else { return Ok(None) };
        let mut frames = Vec::new();
        while walk.world.frames() < last && frames.len() < MOST_FRAMES {
            if let Some(frame) = walk.peek_frame()?.filter(|frame| row.has_frame(frame)) {
                frames.push(*frame);
            }
            if !walk.step_item(&mut |_| ())? {
                break;
            }
        }
        Ok(Some(frames))
    }

    /// Whether the capture is completely indexed.
    fn is_whole(&self) -> bool {
        self.shared.progress.is_complete()
    }

    /// Collects the rows after the position.
    fn go_on(
        &mut self,
        mut walk: TimelineWalk,
        order: &WindowRequest,
        matches: Option<&SearchMatches>,
        found: &mut NeighbourRows,
        is_stale: &mut impl FnMut() -> bool,
    ) -> Result<(), CaptureError> {
        let mut next = walk.world.frames() + NEAR;
        while found.after.len() < order.after && !walk::is_at_head(&walk, &self.shared) {
            let place = walk.world.frames();
            if let Some(hit) = matches.and_then(|matches| matches.next_frame(place + 1))
                && hit > place + NEAR
            {
                match self.walk_to(hit - 1, is_stale)? {
                    Some(nearer) => walk = nearer,
                    None => return Ok(()),
                }
            }
            let mut see = |reported: PlacedEvent<'_>| {
                if order.matcher.matches_event(&reported) {
                    found.after.push(ReplayRow::new(&reported, order.matcher.only_news));
                }
            };
            if !walk.step_item(&mut see)? {
                break;
            }
            if walk.world.frames() >= next {
                next = walk.world.frames() + NEAR;
                if is_stale() {
                    break;
                }
            }
        }
        Ok(())
    }
}

impl NeighbourRows {
    /// Adds an event to its side of the position.
    fn take_event(&mut self, order: &WindowRequest, spot: EventPosition, reported: &PlacedEvent<'_>) {
        if !order.matcher.matches_event(reported) {
            return;
        }
        let row = ReplayRow::new(reported, order.matcher.only_news);
        if reported.spot > spot {
            return self.after.push(row);
        }
        if self.before.len() > order.before {
            self.before.pop_front();
        }
        self.before.push_back(row);
    }
}
