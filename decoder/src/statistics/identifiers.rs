//! Last payload, frequency and regularity of each identifier: one row per bus, identifier and remote flag.

use std::sync::Arc;

use super::IntervalStatistics;
use super::identifier_index::IdentifierIndex;
use crate::event::{Event, EventKind};
use crate::frame::{BusIndex, CanId, Frame, FrameFlags, MAX_DATA, Timestamp};
use crate::profile::{PayloadLayout, PdoName};
use crate::wire::NodeId;

/// Maximum number of rows on all buses; frames of further identifiers are only counted.
pub const MOST_ROWS: usize = 4096;

/// Row of one identifier on one bus; remote frames have a separate row.
#[derive(Debug, Clone)]
pub struct IdentifierRow {
    /// Bus.
    pub bus: BusIndex,
    /// Identifier.
    pub id: CanId,
    /// Whether the row is for remote frames.
    pub is_remote: bool,
    /// Number of frames.
    pub count: u64,
    /// Time between frames.
    pub intervals: IntervalStatistics,
    /// Number of the last frame.
    pub last_frame: u64,
    /// Time of the last frame.
    pub last_time: Option<Timestamp>,
    /// Time between the last two frames, in ns.
    pub last_gap: Option<i64>,
    /// Payload bytes that differ from the previous frame, one bit per byte, bit 0 for the first byte.
    pub changed: u64,
    /// Payload bytes that have ever changed, in the same form.
    pub ever_changed: u64,
    /// Node, if known from events.
    pub node: Option<NodeId>,
    /// Name, if the identifier belongs to a PDO.
    pub pdo: Option<PdoName>,
    /// Layout of the payload, if known.
    pub layout: Option<Arc<PayloadLayout>>,
    length: u8,
    bytes: [u8; MAX_DATA],
    previous_length: u8,
    previous_bytes: [u8; MAX_DATA],
}

impl IdentifierRow {
    /// Payload of the last frame.
    pub fn payload(&self) -> &[u8] {
        self.bytes.get(..usize::from(self.length)).unwrap_or(&self.bytes)
    }

    /// Payload of the frame before the last one; None after the first frame.
    pub fn previous_payload(&self) -> Option<&[u8]> {
        let bytes = self.previous_bytes.get(..usize::from(self.previous_length));
        bytes.filter(|_| self.count > 1)
    }

    fn new(frame: &Frame) -> Self {
        Self {
            bus: frame.bus,
            id: frame.id,
            is_remote: frame.flags.contains(FrameFlags::REMOTE),
            count: 0,
            intervals: IntervalStatistics::default(),
            last_frame: 0,
            last_time: None,
            last_gap: None,
            changed: 0,
            ever_changed: 0,
            node: None,
            pdo: None,
            layout: None,
            length: 0,
            bytes: [0; MAX_DATA],
            previous_length: 0,
            previous_bytes: [0; MAX_DATA],
        }
    }

    /// Sets the new length. Bytes that only one of the payloads contains count as changed; unused bytes
    /// become zero.
    #[cold]
    fn set_length(&mut self, before: usize, now: usize) {
        self.changed |= byte_mask(before.min(now), before.max(now));
        if let Some(rest) = self.bytes.get_mut(now..) {
            rest.fill(0);
        }
        self.length = u8::try_from(now).unwrap_or(0);
    }

    fn take_frame(&mut self, frame: &Frame) {
        let data = frame.data();
        let before = usize::from(self.length);
        self.changed = 0;
        (self.previous_length, self.previous_bytes) = (self.length, self.bytes);
        // Words of eight bytes are faster than slice comparison, because most frames have one.
        for (place, (kept, now)) in self.bytes.chunks_exact_mut(WORD).zip(data.chunks(WORD)).enumerate() {
            let mut word = [0; WORD];
            word.iter_mut().zip(now).for_each(|(to, from)| *to = *from);
            let kept: &mut [u8; WORD] = match kept.try_into() {
                Ok(kept) => kept,
                Err(_) => continue,
            };
            let differing = u64::from_le_bytes(*kept) ^ u64::from_le_bytes(word);
            if differing != 0 {
                self.changed |= bytes_of(differing) << (place * WORD);
                *kept = word;
            }
        }
        if before != data.len() {
            self.set_length(before, data.len());
        }
        if self.count == 0 {
            self.changed = 0;
        }
        self.ever_changed |= self.changed;
        self.count += 1;
        self.last_frame = frame.number;
        if let Some(time) = frame.time {
            self.last_gap = self.last_time.map(|last| time.since(last));
            self.intervals.add_time(time.0);
        }
        self.last_time = frame.time;
    }
}

/// Size of a word in bytes.
const WORD: usize = 8;

/// Bit mask of the bytes of a word that are not zero.
fn bytes_of(word: u64) -> u64 {
    word.to_le_bytes().iter().enumerate().fold(0, |bits, (at, byte)| bits | u64::from(*byte != 0) << at)
}

/// Bit mask of the bytes `from` to `to`, exclusive.
fn byte_mask(from: usize, to: usize) -> u64 {
    (from..to.min(MAX_DATA)).fold(0, |bits, at| bits | 1 << at)
}

/// Rows of all identifiers, in order of appearance.
#[derive(Debug, Clone, Default)]
pub struct IdentifierRows {
    rows: Vec<IdentifierRow>,
    /// By bus.
    indexes: Vec<IdentifierIndex>,
    others: u64,
}

impl IdentifierRows {
    /// Counts a frame; returns the index of its row.
    pub fn count_frame(&mut self, frame: &Frame) -> Option<usize> {
        if frame.flags.contains(FrameFlags::ERROR) {
            return None;
        }
        let place = self.place_of(frame);
        match place.and_then(|place| self.rows.get_mut(place)) {
            Some(row) => row.take_frame(frame),
            None => self.others += 1,
        }
        place
    }

    /// Updates the row at `place` with an event of its frame.
    #[inline]
    pub fn update_row(&mut self, place: usize, event: &Event) {
        let (layout, name) = match &event.kind {
            EventKind::Pdo(pdo) => (&pdo.layout, Some(pdo.name)),
            EventKind::J1939Message(message) => (&message.layout, None),
            EventKind::Frame(undecoded) => {
                let layout = undecoded.message.as_ref().map(|message| &message.layout);
                return self.set_layout(place, layout, None, event.node);
            }
            EventKind::Heartbeat { .. } | EventKind::GuardReply { .. } | EventKind::Emcy(_) => {
                return self.set_layout(place, None, None, event.node);
            }
            _ => return,
        };
        self.set_layout(place, layout.as_ref(), name, event.node);
    }

    fn set_layout(
        &mut self,
        place: usize,
        layout: Option<&Arc<PayloadLayout>>,
        pdo: Option<PdoName>,
        node: Option<NodeId>,
    ) {
        let Some(row) = self.rows.get_mut(place) else { return };
        (row.node, row.pdo) = (node, pdo);
        let is_known = match (&row.layout, layout) {
            (Some(known), Some(layout)) => Arc::ptr_eq(known, layout),
            (None, None) => true,
            _ => false,
        };
        if !is_known {
            row.layout = layout.cloned();
        }
    }

    fn place_of(&mut self, frame: &Frame) -> Option<usize> {
        let bus = usize::from(frame.bus.0);
        if self.indexes.len() <= bus {
            self.indexes.resize_with(bus + 1, IdentifierIndex::default);
        }
        let rows = self.rows.len();
        let place = self.indexes.get_mut(bus)?.row_of(frame, rows, MOST_ROWS)?;
        if place == rows {
            self.rows.push(IdentifierRow::new(frame));
        }
        Some(place)
    }

    /// Rows in order of appearance.
    pub fn rows(&self) -> &[IdentifierRow] {
        &self.rows
    }

    /// Number of frames of identifiers beyond [`MOST_ROWS`].
    pub fn other_frames(&self) -> u64 {
        self.others
    }

    /// Memory in use, in bytes.
    pub fn footprint(&self) -> usize {
        self.rows.len() * size_of::<IdentifierRow>()
            + self.indexes.iter().map(IdentifierIndex::footprint).sum::<usize>()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn frame(number: u64, id: CanId, data: &[u8]) -> Frame {
        let milliseconds = i64::try_from(number).unwrap();
        Frame { number, time: Some(Timestamp(milliseconds * 1_000_000)), ..Frame::data_frame(id, data) }
    }

    #[test]
    fn a_row_contains_the_last_payload_and_its_changes() {
        let mut all = IdentifierRows::default();
        let id = CanId::from_standard(0x185);
        all.count_frame(&frame(10, id, &[1, 2, 3]));
        all.count_frame(&frame(20, id, &[1, 9, 3]));
        all.count_frame(&frame(35, id, &[1, 9, 3, 4]));
        let row = &all.rows()[0];
        assert_eq!((row.count, row.payload()), (3, &[1, 9, 3, 4][..]));
        // The fourth byte is new; the second changed before.
        assert_eq!((row.changed, row.ever_changed), (0b1000, 0b1010));
        assert_eq!(row.previous_payload(), Some(&[1, 9, 3][..]));
        assert_eq!((row.last_gap, row.intervals.mean()), (Some(15_000_000), Some(12_500_000)));
        all.count_frame(&frame(45, id, &[1, 9, 3, 4]));
        assert_eq!((all.rows()[0].changed, all.rows()[0].previous_payload()), (0, Some(&[1, 9, 3, 4][..])));
        all.count_frame(&frame(50, CanId::from_standard(0x186), &[7]));
        assert_eq!(all.rows()[1].previous_payload(), None, "the first frame");
    }

    #[test]
    fn remote_frames_and_long_identifiers_are_rows_of_their_own() {
        let mut all = IdentifierRows::default();
        let mut remote = frame(1, CanId::from_standard(0x705), &[]);
        remote.flags = FrameFlags::REMOTE;
        all.count_frame(&remote);
        all.count_frame(&frame(2, CanId::from_standard(0x705), &[5]));
        all.count_frame(&frame(3, CanId::from_extended(0x705), &[5]));
        assert_eq!(all.rows().iter().map(|row| row.count).collect::<Vec<_>>(), [1, 1, 1]);
    }

    #[test]
    fn rows_are_bounded() {
        let mut all = IdentifierRows::default();
        for id in 0..5_000 {
            all.count_frame(&frame(u64::from(id), CanId::from_extended(id), &[]));
        }
        all.count_frame(&frame(1, CanId::from_standard(1), &[]));
        assert_eq!((all.rows().len(), all.other_frames()), (MOST_ROWS, 5_001 - MOST_ROWS as u64));
        assert!(all.footprint() < 2 * 1024 * 1024);
    }
}
