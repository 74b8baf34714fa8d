//! The blocks of a block transfer (CiA 301 §7.2.4.3.9 to §7.2.4.3.15).
//!
//! Segments count only once they are acknowledged: a receiver that acknowledges fewer than were sent
//! gets the rest again, numbered from 1. So the segments of the present block are kept apart until the
//! acknowledgement says how many of them stand.

use crate::event::Crc;

/// Bytes of a segment.
const SEGMENT: usize = 7;

/// Most segments of a block.
const MOST_SEGMENTS: usize = 127;

/// What is remembered of the blocks of one transfer.
#[derive(Debug, Clone, Default)]
pub(super) struct Blocks {
    /// Segments of the present block, by sequence number.
    present: Vec<u8>,
    /// Bit n: segment n of the present block was seen.
    seen: u128,
    /// Sequence number of the segment that is the last of all, in the present block.
    last_sequence: Option<u8>,
    /// The last acknowledged segment: how many of its bytes count, the end message says.
    tail: [u8; SEGMENT],
    tail_length: u8,
    /// Segments of a block by the receiver's last word.
    pub(super) size: Option<u8>,
    /// The segment that ends the data was acknowledged.
    pub(super) is_complete: bool,
    /// Segments were acknowledged that were not seen.
    pub(super) has_gap: bool,
    /// Both sides offer a CRC.
    client_crc: Option<bool>,
    server_crc: Option<bool>,
    crc: u16,
    verdict: Option<Crc>,
}

impl Blocks {
    /// What the client says of CRC support.
    pub(super) fn client_offers(&mut self, crc: bool) {
        self.client_crc = Some(crc);
    }

    /// What the server says of CRC support.
    pub(super) fn server_offers(&mut self, crc: bool) {
        self.server_crc = Some(crc);
    }

    /// A segment was sent.
    pub(super) fn segment(&mut self, sequence: u8, last: bool, data: &[u8]) {
        let place = usize::from(sequence);
        if place == 0 || place > MOST_SEGMENTS {
            return;
        }
        let start = (place - 1) * SEGMENT;
        if self.present.len() < start + SEGMENT {
            self.present.resize(start + SEGMENT, 0);
        }
        if let Some(slot) = self.present.get_mut(start..start + SEGMENT) {
            for (target, source) in slot.iter_mut().zip(data) {
                *target = *source;
            }
        }
        self.seen |= 1 << place;
        if last {
            self.last_sequence = Some(sequence);
        }
    }

    /// The receiver has the segments up to `sequence`; `keep` gets the bytes that are whole now. A block has 127
    /// segments at most (CiA 301 §7.2.4.3.9): what acknowledges more acknowledges nothing.
    pub(super) fn acknowledge(&mut self, sequence: u8, mut keep: impl FnMut(&[u8])) {
        let count = Some(usize::from(sequence)).filter(|count| *count <= MOST_SEGMENTS).unwrap_or(0);
        if count > 0 {
            let wanted = (u128::MAX >> (127 - count)) & !1;
            self.has_gap |= self.seen & wanted != wanted;
            self.present.resize(self.present.len().max(count * SEGMENT), 0);
            self.flush(&mut keep);
            let (whole, tail) = match self.present.get(..count * SEGMENT) {
                Some(bytes) => bytes.split_at(bytes.len().saturating_sub(SEGMENT)),
                None => (&[][..], &[][..]),
            };
            self.crc = crc16(self.crc, whole);
            keep(whole);
            for (target, source) in self.tail.iter_mut().zip(tail) {
                *target = *source;
            }
            self.tail_length = u8::try_from(SEGMENT).unwrap_or(7);
            self.is_complete = self.last_sequence.is_some_and(|last| last == sequence);
        }
        self.present.clear();
        self.seen = 0;
        self.last_sequence = None;
    }

    /// The end message: bytes of the last segment that do not count, and the sender's CRC.
    pub(super) fn end(&mut self, unused: u8, crc: u16, cut_start: bool, mut keep: impl FnMut(&[u8])) {
        self.tail_length = self.tail_length.saturating_sub(unused);
        self.flush(&mut keep);
        let used = self.client_crc.unwrap_or(true) && self.server_crc.unwrap_or(true);
        self.verdict = Some(if !used {
            Crc::NotUsed
        } else if self.has_gap || cut_start {
            Crc::Unchecked
        } else if crc == self.crc {
            Crc::Correct
        } else {
            Crc::Wrong
        });
    }

    /// The transfer ended before its end message: what was seen in order of the present block counts.
    pub(super) fn give_up(&mut self, mut keep: impl FnMut(&[u8])) {
        let in_order = u8::try_from((self.seen >> 1).trailing_ones()).unwrap_or(0);
        self.acknowledge(in_order, &mut keep);
        self.flush(&mut keep);
    }

    /// What the end message's CRC came to.
    pub(super) fn verdict(&self) -> Option<Crc> {
        self.verdict
    }

    fn flush(&mut self, keep: &mut impl FnMut(&[u8])) {
        if let Some(tail) = self.tail.get(..usize::from(self.tail_length)) {
            self.crc = crc16(self.crc, tail);
            keep(tail);
        }
        self.tail_length = 0;
    }

    /// Bytes held.
    pub(super) fn footprint(&self) -> usize {
        self.present.capacity()
    }
}

/// CRC-16 of CiA 301 §7.2.4.3.16: x^16 + x^12 + x^5 + 1, start 0.
fn crc16(start: u16, data: &[u8]) -> u16 {
    data.iter().fold(start, |crc, byte| {
        let mut x = (crc >> 8) ^ u16::from(*byte);
        x ^= x >> 4;
        (crc << 8) ^ (x << 12) ^ (x << 5) ^ x
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_check_value_of_the_standard() {
        // CiA 301 §7.2.4.3.16: "123456789" gives 0x31C3.
        assert_eq!(crc16(0, b"123456789"), 0x31C3);
    }

    #[test]
    fn two_segments_in_one_block() {
        let mut blocks = Blocks::default();
        let mut data = Vec::new();
        blocks.client_offers(true);
        blocks.server_offers(true);
        blocks.segment(1, false, b"1234567");
        blocks.segment(2, true, b"89\0\0\0\0\0");
        blocks.acknowledge(2, |bytes| data.extend_from_slice(bytes));
        assert!(blocks.is_complete);
        blocks.end(5, 0x31C3, false, |bytes| data.extend_from_slice(bytes));
        assert_eq!(data, b"123456789");
        assert_eq!(blocks.verdict(), Some(Crc::Correct));
    }

    #[test]
    fn segments_not_acknowledged_come_again() {
        let mut blocks = Blocks::default();
        let mut data = Vec::new();
        blocks.segment(1, false, b"1234567");
        blocks.segment(2, true, b"XX\0\0\0\0\0");
        blocks.acknowledge(1, |bytes| data.extend_from_slice(bytes));
        assert!(!blocks.is_complete);
        blocks.segment(1, true, b"89\0\0\0\0\0");
        blocks.acknowledge(1, |bytes| data.extend_from_slice(bytes));
        assert!(blocks.is_complete && !blocks.has_gap);
        blocks.end(5, 0x31C3, false, |bytes| data.extend_from_slice(bytes));
        assert_eq!(data, b"123456789");
    }

    #[test]
    fn a_segment_that_was_not_seen_leaves_the_crc_unchecked() {
        let mut blocks = Blocks::default();
        blocks.segment(2, true, b"89\0\0\0\0\0");
        blocks.acknowledge(2, |_| {});
        blocks.end(5, 0x31C3, false, |_| {});
        assert!(blocks.has_gap);
        assert_eq!(blocks.verdict(), Some(Crc::Unchecked));
    }

    #[test]
    fn an_acknowledgement_of_more_than_a_block_has_acknowledges_nothing() {
        let mut blocks = Blocks::default();
        let mut data = Vec::new();
        blocks.segment(1, true, b"1234567");
        blocks.acknowledge(128, |bytes| data.extend_from_slice(bytes));
        assert!(data.is_empty() && !blocks.is_complete);
    }

    #[test]
    fn a_wrong_crc_is_seen() {
        let mut blocks = Blocks::default();
        blocks.segment(1, true, b"1234567");
        blocks.acknowledge(1, |_| {});
        blocks.end(0, 0, false, |_| {});
        assert_eq!(blocks.verdict(), Some(Crc::Wrong));
    }
}
