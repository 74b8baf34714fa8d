//! Which events are shown: a filter, or only what says something new, looked for in the whole capture while the
//! index grows.
//!
//! Of each frame one bit says whether it brought such an event. Of few hits the rows themselves are kept, so that
//! a screen of them costs nothing; of many, those around a place are near it and are decoded again.

use std::sync::atomic::{AtomicBool, AtomicU64, Ordering};
use std::sync::{PoisonError, RwLock};

use cobscope_decoder::query::Filter;
use cobscope_decoder::replay::{Spot, Told};
use regex_lite::Regex;

use super::row::Row;

/// Rows kept of a search with few hits.
pub(super) const MOST_ROWS: usize = 10_000;

/// What an event must be like.
#[derive(Debug, Clone, Default)]
pub struct Matcher {
    /// Events this filter means.
    pub filter: Option<Filter>,
    /// Only what says something new.
    pub only_news: bool,
    /// Rows whose text this matches.
    pub text: Option<Regex>,
}

impl PartialEq for Matcher {
    fn eq(&self, other: &Self) -> bool {
        self.filter == other.filter
            && self.only_news == other.only_news
            && self.text.as_ref().map(Regex::as_str) == other.text.as_ref().map(Regex::as_str)
    }
}

impl Matcher {
    /// Whether every event does.
    pub fn takes_all(&self) -> bool {
        self.filter.is_none() && !self.only_news && self.text.is_none()
    }

    /// Whether this event does.
    pub fn takes(&self, told: &Told<'_>) -> bool {
        if self.only_news && !told.is_news {
            return false;
        }
        if self.filter.as_ref().is_some_and(|filter| !filter.matches(told.event, told.bus, None)) {
            return false;
        }
        self.text.as_ref().is_none_or(|text| text.is_match(&Row::new(told).text()))
    }
}

/// What was found so far.
pub struct Matches {
    pub(super) matcher: Matcher,
    found: RwLock<Found>,
    count: AtomicU64,
    scanned: AtomicU64,
    is_complete: AtomicBool,
    is_over: AtomicBool,
}

#[derive(Default)]
struct Found {
    /// A bit a frame.
    bits: Vec<u64>,
    /// All events, as long as there are few.
    rows: Vec<Row>,
}

impl Matches {
    pub(super) fn new(matcher: Matcher) -> Self {
        Self {
            matcher,
            found: RwLock::default(),
            count: AtomicU64::new(0),
            scanned: AtomicU64::new(0),
            is_complete: AtomicBool::new(false),
            is_over: AtomicBool::new(false),
        }
    }

    /// Events found so far.
    pub fn count(&self) -> u64 {
        self.count.load(Ordering::Relaxed)
    }

    /// Frames looked at so far.
    pub fn scanned(&self) -> u64 {
        self.scanned.load(Ordering::Acquire)
    }

    /// Whether all were looked at.
    pub fn is_complete(&self) -> bool {
        self.is_complete.load(Ordering::Acquire)
    }

    pub(super) fn stop(&self) {
        self.is_over.store(true, Ordering::Relaxed);
    }

    pub(super) fn is_stopped(&self) -> bool {
        self.is_over.load(Ordering::Relaxed)
    }

    pub(super) fn set_scanned(&self, frames: u64) {
        self.scanned.store(frames, Ordering::Release);
    }

    pub(super) fn complete(&self) {
        self.is_complete.store(true, Ordering::Release);
    }

    pub(super) fn add(&self, told: &Told<'_>) {
        let count = self.count.fetch_add(1, Ordering::Relaxed);
        let mut found = self.found.write().unwrap_or_else(PoisonError::into_inner);
        let (word, bit) = place(told.spot.frame);
        if found.bits.len() <= word {
            found.bits.resize(word + 1, 0);
        }
        if let Some(bits) = found.bits.get_mut(word) {
            *bits |= 1 << bit;
        }
        if count < MOST_ROWS as u64 {
            found.rows.push(Row::new(told));
        } else {
            found.rows = Vec::new();
        }
    }

    /// Rows around a place, at most `before` up to it and `after` behind, if they are all at hand; and
    /// whether there are none further on either side.
    pub(super) fn rows(&self, at: Spot, before: usize, after: usize) -> Option<Vec<Row>> {
        if self.count() > MOST_ROWS as u64 {
            return None;
        }
        let found = self.found.read().unwrap_or_else(PoisonError::into_inner);
        let middle = found.rows.partition_point(|row| row.spot <= at);
        let range = middle.saturating_sub(before)..middle.saturating_add(after).min(found.rows.len());
        Some(found.rows.get(range)?.to_vec())
    }

    /// The frame from which `count` hits lie before `frame`, frame 0 if there are fewer.
    pub(super) fn frame_before(&self, frame: u64, count: usize) -> u64 {
        let found = self.found.read().unwrap_or_else(PoisonError::into_inner);
        let (last, bit) = place(frame);
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

    /// Whether a frame brought a hit.
    pub fn has_frame(&self, frame: u64) -> bool {
        let found = self.found.read().unwrap_or_else(PoisonError::into_inner);
        let (word, bit) = place(frame);
        found.bits.get(word).is_some_and(|bits| bits >> bit & 1 == 1)
    }

    /// The first frame with a hit from `frame` on.
    pub(super) fn next_frame(&self, frame: u64) -> Option<u64> {
        let found = self.found.read().unwrap_or_else(PoisonError::into_inner);
        let (first, bit) = place(frame);
        let masked = found.bits.get(first).map(|bits| bits & (u64::MAX << bit));
        let rest = found.bits.iter().skip(first + 1).copied();
        let words = masked.into_iter().chain(rest).enumerate();
        let mut hits = words.filter(|(_, bits)| *bits != 0);
        let (offset, bits) = hits.next()?;
        Some((first + offset) as u64 * 64 + u64::from(bits.trailing_zeros()))
    }
}

fn place(frame: u64) -> (usize, u32) {
    let bit = (frame % 64) as u32;
    (usize::try_from(frame / 64).unwrap_or(usize::MAX), bit)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn frames_with_hits_are_found_in_both_directions() {
        let matches = Matches::new(Matcher::default());
        {
            let mut found = matches.found.write().unwrap();
            found.bits = vec![0; 4];
            for frame in [3_u64, 63, 64, 130, 200] {
                let (word, bit) = place(frame);
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
