//! Selection of the shown events: a filter or only changes, applied to the whole capture while the index
//! grows.
//!
//! One bit per frame marks a match. With few matches the rows are kept too, so that a screen of them costs
//! nothing; with many matches the rows near a position are decoded again.

use std::sync::atomic::{AtomicBool, AtomicU64, Ordering};
use std::sync::{PoisonError, RwLock};

use cobscope_decoder::query::Filter;
use cobscope_decoder::replay::{EventPosition, PlacedEvent, ReplayRow, RowPattern};

/// Maximum number of rows kept.
pub(super) const MOST_ROWS: usize = 10_000;

/// Conditions for a shown event.
#[derive(Debug, Clone, Default, PartialEq)]
pub struct RowMatcher {
    /// Filter expression.
    pub filter: Option<Filter>,
    /// Changes only.
    pub only_news: bool,
    /// Pattern for the text of the row.
    pub text: Option<RowPattern>,
}

impl RowMatcher {
    /// Whether every event matches.
    pub fn takes_all(&self) -> bool {
        self.filter.is_none() && !self.only_news && self.text.is_none()
    }

    /// Whether an event matches.
    pub fn matches_event(&self, reported: &PlacedEvent<'_>) -> bool {
        if self.only_news && !reported.is_news {
            return false;
        }
        if self
            .filter
            .as_ref()
            .is_some_and(|filter| !filter.matches_event(reported.event, reported.bus, None))
        {
            return false;
        }
        self.text
            .as_ref()
            .is_none_or(|text| text.is_match(&ReplayRow::new(reported, self.only_news).row_text()))
    }
}

/// Result of a search, filled while it runs.
pub struct SearchMatches {
    pub(super) matcher: RowMatcher,
    found: RwLock<MatchingRows>,
    count: AtomicU64,
    scanned: AtomicU64,
    is_complete: AtomicBool,
    is_over: AtomicBool,
}

#[derive(Default)]
struct MatchingRows {
    /// One bit per frame.
    bits: Vec<u64>,
    /// Rows of all matches; empty if there are too many.
    rows: Vec<ReplayRow>,
}

impl SearchMatches {
    pub(super) fn new(matcher: RowMatcher) -> Self {
        Self {
            matcher,
            found: RwLock::default(),
            count: AtomicU64::new(0),
            scanned: AtomicU64::new(0),
            is_complete: AtomicBool::new(false),
            is_over: AtomicBool::new(false),
        }
    }

    /// Number of matches so far.
    pub fn match_count(&self) -> u64 {
        self.count.load(Ordering::Relaxed)
    }

    /// Number of frames searched so far.
    pub fn scanned_frames(&self) -> u64 {
        self.scanned.load(Ordering::Acquire)
    }

    /// Whether the whole capture is searched.
    pub fn is_complete(&self) -> bool {
        self.is_complete.load(Ordering::Acquire)
    }

    pub(super) fn stop_search(&self) {
        self.is_over.store(true, Ordering::Relaxed);
    }

    pub(super) fn is_stopped(&self) -> bool {
        self.is_over.load(Ordering::Relaxed)
    }

    pub(super) fn set_scanned(&self, frames: u64) {
        self.scanned.store(frames, Ordering::Release);
    }

    pub(super) fn complete_search(&self) {
        self.is_complete.store(true, Ordering::Release);
    }

    pub(super) fn add_match(&self, reported: &PlacedEvent<'_>) {
        let count = self.count.fetch_add(1, Ordering::Relaxed);
        let mut found = self.found.write().unwrap_or_else(PoisonError::into_inner);
        let (word, bit) = match_place(reported.spot.frame);
        if found.bits.len() <= word {
            found.bits.resize(word + 1, 0);
        }
        if let Some(bits) = found.bits.get_mut(word) {
            *bits |= 1 << bit;
        }
        if count < MOST_ROWS as u64 {
            found.rows.push(ReplayRow::new(reported, self.matcher.only_news));
        } else {
            found.rows = Vec::new();
        }
    }

    /// Matching rows around a position: at most `before` up to it and `after` after it. None if not all rows
    /// are kept.
    pub(super) fn matching_rows(
        &self,
        at: EventPosition,
        before: usize,
        after: usize,
    ) -> Option<Vec<ReplayRow>> {
        if self.match_count() > MOST_ROWS as u64 {
            return None;
        }
        let found = self.found.read().unwrap_or_else(PoisonError::into_inner);
        let middle = found.rows.partition_point(|row| row.spot <= at);
        let range = middle.saturating_sub(before)..middle.saturating_add(after).min(found.rows.len());
        Some(found.rows.get(range)?.to_vec())
    }

    /// The frame of the `count`-th match up to `frame`, counted backwards; 0 with fewer matches.
    pub(super) fn frame_before(&self, frame: u64, count: usize) -> u64 {
        let found = self.found.read().unwrap_or_else(PoisonError::into_inner);
        let (last, bit) = match_place(frame);
        let mut wanted = u32::try_from(count).unwrap_or(u32::MAX);
        for word in (0..=last.min(found.bits.len().saturating_sub(1))).rev() {
            let mask = if word == last { u64::MAX >> (63 - bit) } else { u64::MAX };
            let mut bits = found.bits.get(word).copied().unwrap_or(0) & mask;
            if bits.count_ones() < wanted {
                wanted -= bits.count_ones();
                continue;
            }
            while bits != 0 {
                let highest = bits.ilog2();
                wanted -= 1;
                if wanted == 0 {
                    return word as u64 * 64 + u64::from(highest);
                }
                bits &= !(1 << highest);
            }
        }
        0
    }

    /// Whether an event matches. With many matches: whether its frame has one. True if not searched yet.
    pub fn has_match(&self, spot: EventPosition) -> bool {
        if spot.frame > self.scanned_frames() && !self.is_complete() {
            return true;
        }
        match self.matching_rows(spot, 1, 0) {
            Some(rows) => rows.iter().any(|row| row.spot == spot),
            None => self.has_frame(spot.frame),
        }
    }

    /// Whether a frame has a match.
    pub fn has_frame(&self, frame: u64) -> bool {
        let found = self.found.read().unwrap_or_else(PoisonError::into_inner);
        let (word, bit) = match_place(frame);
        found.bits.get(word).is_some_and(|bits| bits >> bit & 1 == 1)
    }

    /// The first frame with a match, from `frame`.
    pub(super) fn next_frame(&self, frame: u64) -> Option<u64> {
        let found = self.found.read().unwrap_or_else(PoisonError::into_inner);
        let (first, bit) = match_place(frame);
        let masked = found.bits.get(first).map(|bits| bits & (u64::MAX << bit));
        let rest = found.bits.iter().skip(first + 1).copied();
        let words = masked.into_iter().chain(rest).enumerate();
        let mut hits = words.filter(|(_, bits)| *bits != 0);
        let (offset, bits) = hits.next()?;
        Some((first + offset) as u64 * 64 + u64::from(bits.trailing_zeros()))
    }
}

fn match_place(frame: u64) -> (usize, u32) {
    let bit = (frame % 64) as u32;
    (usize::try_from(frame / 64).unwrap_or(usize::MAX), bit)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn frames_with_hits_are_found_in_both_directions() {
        let matches = SearchMatches::new(RowMatcher::default());
        {
            let mut found = matches.found.write().unwrap();
            found.bits = vec![0; 4];
            for frame in [3_u64, 63, 64, 130, 200] {
                let (word, bit) = match_place(frame);
                found.bits[word] |= 1 << bit;
            }
        }
        assert!(matches.has_frame(63) && !matches.has_frame(62) && !matches.has_frame(1_000));
        assert_eq!(matches.next_frame(0), Some(3));
        assert_eq!(matches.next_frame(4), Some(63));
        assert_eq!(matches.next_frame(65), Some(130));
        assert_eq!(matches.next_frame(201), None);
        assert_eq!(matches.frame_before(200, 1), 200);
        assert_eq!(matches.frame_before(199, 1), 130);
        assert_eq!(matches.frame_before(130, 3), 63);
        assert_eq!(matches.frame_before(1_000, 5), 3);
        assert_eq!(matches.frame_before(1_000, 6), 0);
    }
}
