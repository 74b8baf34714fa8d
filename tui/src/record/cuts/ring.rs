//! Frames and notices of the recent past, with a limit in time and one in memory.
//!
//! ```text
//! evicted ◀─ chunk │ chunk │ … │ chunk ◀─ items
//!            ◀───── at least `reach` ─────▶
//! ```
//! Whole chunks are evicted, so that the memory of an evicted item never moves another one.

use std::collections::VecDeque;

use super::super::item::PendingItem;

/// Maximum number of items of a chunk.
const CHUNK: usize = 1_024;

/// Maximum duration of a chunk in ns, so that a quiet bus does not keep old items.
const CHUNK_TIME: i64 = 1_000_000_000;

/// An item with its place in the ring.
#[derive(Debug, Clone)]
pub(super) struct RingItem {
    /// Ring time in ns.
    pub time: i64,
    /// Number of the item, from 0, without gaps.
    pub sequence: u64,
    /// Frame or notice.
    pub item: PendingItem,
}

/// Items that are evicted together.
#[derive(Debug)]
pub(super) struct RingChunk {
    items: Vec<RingItem>,
    earliest: i64,
    latest: i64,
}

impl RingChunk {
    /// The items in order of arrival.
    pub(super) fn items(&self) -> &[RingItem] {
        &self.items
    }

    fn first_sequence(&self) -> u64 {
        self.items.first().map_or(0, |first| first.sequence)
    }

    fn memory_size(&self) -> usize {
        self.items.capacity().saturating_mul(size_of::<RingItem>())
    }

    fn has_room_for(&self, time: i64) -> bool {
        self.items.len() < CHUNK && time.saturating_sub(self.earliest) < CHUNK_TIME
    }
}

/// The ring.
#[derive(Debug)]
pub(super) struct ItemRing {
    chunks: VecDeque<RingChunk>,
    next: u64,
    /// Time for which items are kept, in ns.
    reach: i64,
    /// Maximum memory in bytes.
    most: usize,
    memory: usize,
    /// Number of frames that were evicted.
    evicted: u64,
}

impl ItemRing {
    /// An empty ring that keeps items for `reach` ns, in at most `most` bytes.
    pub(super) fn new(reach: i64, most: usize) -> Self {
        Self { chunks: VecDeque::new(), next: 0, reach, most, memory: 0, evicted: 0 }
    }

    /// Adds an item; returns its sequence number.
    pub(super) fn push(&mut self, time: i64, item: PendingItem) -> u64 {
        let sequence = self.next;
        self.next += 1;
        if !self.chunks.back().is_some_and(|chunk| chunk.has_room_for(time)) {
            self.chunks.push_back(RingChunk { items: Vec::new(), earliest: time, latest: time });
        }
        if let Some(chunk) = self.chunks.back_mut() {
            let before = chunk.memory_size();
            chunk.items.push(RingItem { time, sequence, item });
            chunk.earliest = chunk.earliest.min(time);
            chunk.latest = chunk.latest.max(time);
            self.memory = self.memory.saturating_sub(before).saturating_add(chunk.memory_size());
        }
        sequence
    }

    /// Removes and returns the oldest chunk if it is out of reach at the time `now`, or over the memory limit.
    /// The newest chunk stays.
    pub(super) fn evict_chunk(&mut self, now: i64) -> Option<RingChunk> {
        let oldest = self.chunks.front().filter(|_| self.chunks.len() > 1)?;
        if oldest.latest >= now.saturating_sub(self.reach) && self.memory <= self.most {
            return None;
        }
        let chunk = self.chunks.pop_front()?;
        self.memory = self.memory.saturating_sub(chunk.memory_size());
        let frames = chunk.items.iter().filter(|one| one.item.is_frame()).count() as u64;
        self.evicted = self.evicted.saturating_add(frames);
        Some(chunk)
    }

    /// Number of frames before the oldest item.
    pub(super) fn evicted_frames(&self) -> u64 {
        self.evicted
    }

    /// Sequence number of the oldest item, or of the next one if the ring is empty.
    pub(super) fn first_sequence(&self) -> u64 {
        self.chunks.front().map_or(self.next, RingChunk::first_sequence)
    }

    /// Time of the oldest item.
    pub(super) fn first_time(&self) -> Option<i64> {
        self.items_from(0).next().map(|item| item.time)
    }

    /// Items with this sequence number and later ones, in order of arrival.
    pub(super) fn items_from(&self, sequence: u64) -> impl Iterator<Item = &RingItem> {
        let place = self.chunks.partition_point(|chunk| chunk.first_sequence() <= sequence);
        let chunks = self.chunks.range(place.saturating_sub(1)..);
        chunks.enumerate().flat_map(move |(count, chunk)| {
            // Only the first chunk can contain earlier items; sequence numbers have no gaps.
            let skipped = sequence.saturating_sub(chunk.first_sequence());
            let skipped = if count == 0 { usize::try_from(skipped).unwrap_or(usize::MAX) } else { 0 };
            chunk.items.get(skipped..).unwrap_or_default()
        })
    }

    /// Ring time of the frame with this number; None if the ring does not contain it.
    pub(super) fn time_of(&self, number: u64) -> Option<i64> {
        let first = |chunk: &RingChunk| chunk.items.iter().find_map(|one| Some(one.item.frame()?.number));
        // Frame numbers increase; chunks with notices only have none.
        let chunk =
            self.chunks.iter().rev().find(|chunk| first(chunk).is_some_and(|first| first <= number))?;
        let is_it = |one: &&RingItem| one.item.frame().is_some_and(|frame| frame.number == number);
        chunk.items.iter().find(is_it).map(|one| one.time)
    }
}

#[cfg(test)]
mod tests {
    use cobscope_decoder::frame::Frame;

    use super::*;
    use crate::record::item::RecordItem;

    const SECOND: i64 = 1_000_000_000;

    fn frame(number: u64) -> PendingItem {
        PendingItem { bus: 0, what: RecordItem::Frame(Frame { number, ..Frame::EMPTY }) }
    }

    /// A ring with frames 1 to `last`, `step` ns apart, after eviction; and the numbers of the evicted ones.
    fn ring(last: u64, step: i64, reach: i64, most: usize) -> (ItemRing, Vec<u64>) {
        let (mut ring, mut evicted) = (ItemRing::new(reach, most), Vec::new());
        let mut time = 0;
        for number in 1..=last {
            ring.push(time, frame(number));
            while let Some(chunk) = ring.evict_chunk(time) {
                evicted.extend(chunk.items().iter().map(|one| one.item.frame().unwrap().number));
            }
            time += step;
        }
        (ring, evicted)
    }

    fn numbers<'a>(items: impl Iterator<Item = &'a RingItem>) -> Vec<u64> {
        items.map(|one| one.item.frame().unwrap().number).collect()
    }

    #[test]
    fn it_keeps_its_reach_and_evicts_in_order() {
        // Frame n has the time (n - 1) × 0.1 s: 60 s, of which 10 s and the rest of a chunk are kept.
        let (ring, evicted) = ring(601, SECOND / 10, 10 * SECOND, usize::MAX);
        let kept = numbers(ring.items_from(0));
        assert!(kept.len() >= 101 && kept.len() <= 111, "{}", kept.len());
        assert_eq!([evicted, kept].concat(), (1..=601).collect::<Vec<_>>());
        assert_eq!(ring.first_time(), Some(50 * SECOND));
        assert_eq!(ring.first_sequence(), 500);
    }

    #[test]
    fn its_memory_is_limited() {
        let limit = 100 * CHUNK * size_of::<RingItem>();
        let (ring, evicted) = ring(300_000, 1_000, i64::MAX, limit);
        let kept = numbers(ring.items_from(0)).len();
        assert!(kept > 98 * CHUNK && kept <= 100 * CHUNK, "{kept}");
        assert_eq!(evicted.len() + kept, 300_000);
        assert!(ring.memory <= limit);
    }

    #[test]
    fn items_and_frames_are_found() {
        let (ring, _) = ring(5_000, 1_000, 100 * SECOND, usize::MAX);
        for sequence in [0, 1, 1_023, 1_024, 1_025, 4_999] {
            assert_eq!(ring.items_from(sequence).next().unwrap().sequence, sequence);
            assert_eq!(ring.items_from(sequence).count() as u64, 5_000 - sequence);
        }
        assert_eq!(ring.items_from(5_000).count(), 0);
        assert_eq!(ring.time_of(1), Some(0));
        assert_eq!(ring.time_of(1_025), Some(1_024_000));
        assert_eq!([ring.time_of(0), ring.time_of(5_001)], [None, None]);
        let empty = ItemRing::new(0, 0);
        assert_eq!((empty.first_time(), empty.first_sequence()), (None, 0));
        assert_eq!(empty.items_from(0).count(), 0);
    }
}
