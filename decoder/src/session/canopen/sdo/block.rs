//! Blocks of a block transfer (CiA 301 §7.2.4.3.9 to §7.2.4.3.15).
//!
//! Only acknowledged segments are valid. Segments that the receiver did not acknowledge are sent again,
//! numbered from 1. So the segments of the present block are buffered until the acknowledgement. Bytes of
//! acknowledged segments that the capture lacks are gaps.

use crate::event::CrcCheck;

/// Data bytes per segment.
const SEGMENT: usize = 7;

/// Max segments per block.
const MOST_SEGMENTS: usize = 127;

/// Max distance of frames that a capture stores in another order than they were sent.
const REORDERED: u8 = 2;

/// Data of a transfer in its order.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum DataPart<'a> {
    /// Captured bytes.
    Bytes(&'a [u8]),
    /// Number of bytes that were transferred, but not captured.
    Gap(usize),
}

/// A segment as captured; length 0 if it was not.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq)]
struct CapturedSegment {
    bytes: [u8; SEGMENT],
    length: u8,
}

impl CapturedSegment {
    fn from_data(data: &[u8]) -> Self {
        let mut segment = Self::default();
        for (target, source) in segment.bytes.iter_mut().zip(data) {
            *target = *source;
            segment.length += 1;
        }
        segment
    }

    fn is_seen(self) -> bool {
        self.length > 0
    }
}

/// First acknowledgement of a block that excludes segments of the block.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) struct BlockLoss {
    /// Sequence number of the first segment without acknowledgement.
    pub(super) sequence: u8,
    /// Frame of the acknowledgement; `None` if it was not captured.
    pub(super) frame: Option<u64>,
}

/// State of the blocks of one transfer.
#[derive(Debug, Clone, Default)]
pub(super) struct BlockProgress {
    /// Segments of the present block, by sequence number.
    present: Vec<CapturedSegment>,
    /// Segments that were sent, but not acknowledged: the sender repeats them from number 1.
    repeated: Vec<CapturedSegment>,
    /// Number of the final segment among `repeated`.
    repeated_last: Option<u8>,
    /// Latest sequence number of the present block.
    latest: u8,
    /// Sequence number of the final segment, if it is in the present block.
    last_sequence: Option<u8>,
    /// Last acknowledged segment; the end message contains the number of unused bytes.
    tail: Option<CapturedSegment>,
    /// Segments per block, as last requested by the receiver.
    pub(super) size: Option<u8>,
    /// The final segment was acknowledged.
    pub(super) is_complete: bool,
    /// Segments acknowledged by the receiver, but missing in the capture.
    pub(super) missing: u64,
    /// Blocks of which the receiver did not acknowledge all segments.
    pub(super) losses: u64,
    pub(super) first_loss: Option<BlockLoss>,
    /// Short acknowledgement that is a loss if the sender continues with segments; the end message instead shows
    /// that the final segment is missing in the capture.
    possible_loss: Option<BlockLoss>,
    /// An acknowledgement is missing in the capture, so the position of later segments is presumed.
    is_presumed: bool,
    /// The start of the data is not captured, so segments before the first one seen are not a gap.
    pub(super) starts_late: bool,
    /// Bytes are missing in the capture.
    has_gap: bool,
    /// CRC support of client and server.
    client_crc: Option<bool>,
    server_crc: Option<bool>,
    crc: u16,
    verdict: Option<CrcCheck>,
}

impl BlockProgress {
    /// Sets the CRC support of the client.
    pub(super) fn client_offers(&mut self, crc: bool) {
        self.client_crc = Some(crc);
    }

    /// Sets the CRC support of the server.
    pub(super) fn server_offers(&mut self, crc: bool) {
        self.server_crc = Some(crc);
    }

    /// Adds a segment of the present block. A sequence number that starts again shows that an acknowledgement
    /// is missing in the capture: the earlier segments go to `keep` and are never overwritten.
    pub(super) fn add_segment(
        &mut self,
        sequence: u8,
        last: bool,
        data: &[u8],
        keep: impl FnMut(DataPart<'_>),
    ) {
        let place = usize::from(sequence);
        if place == 0 || place > MOST_SEGMENTS {
            return;
        }
        if let Some(loss) = self.possible_loss.take() {
            self.add_loss(loss);
        }
        let segment = CapturedSegment::from_data(data);
        let known = self.present.get(place - 1).copied().filter(|known| known.is_seen());
        if sequence == self.latest && known == Some(segment) {
            // The same frame twice.
            return;
        }
        if self.starts_again(sequence, known.is_some()) {
            self.presume_acknowledged(sequence, segment, keep);
        }
        if self.present.len() < place {
            self.present.resize(place, CapturedSegment::default());
        }
        if let Some(slot) = self.present.get_mut(place - 1) {
            *slot = segment;
        }
        self.latest = self.latest.max(sequence);
        if last {
            self.last_sequence = Some(sequence);
        }
    }

    /// Whether a sequence number belongs to another block than the segments before it.
    fn starts_again(&self, sequence: u8, is_known: bool) -> bool {
        let is_full = self.last_sequence.is_some() || self.size.is_some_and(|size| self.latest >= size);
        let is_reordered = !is_full && sequence.saturating_add(REORDERED) >= self.latest;
        is_known || sequence < self.latest && !is_reordered
    }

    /// Applies an acknowledgement that is missing in the capture. After the final segment, the sender only
    /// repeats what the receiver did not acknowledge; otherwise the block is presumed to be acknowledged.
    fn presume_acknowledged(
        &mut self,
        sequence: u8,
        segment: CapturedSegment,
        keep: impl FnMut(DataPart<'_>),
    ) {
        let count = match self.last_sequence {
            Some(last) => {
                let is_repeat = |count: &u8| {
                    self.present.get(usize::from(*count) + usize::from(sequence) - 1) == Some(&segment)
                };
                (0..last).find(is_repeat).unwrap_or(0)
            }
            None => self.size.unwrap_or(0).max(self.latest),
        };
        self.is_presumed = true;
        self.apply_segments(count, None, keep);
        // The acknowledgement may have changed the block size.
        self.size = None;
    }

    /// Acknowledges the segments up to `sequence`; `keep` receives the data. An acknowledgement of more than
    /// 127 segments (CiA 301 §7.2.4.3.9) is treated as 0.
    pub(super) fn acknowledge_segments(&mut self, sequence: u8, frame: u64, keep: impl FnMut(DataPart<'_>)) {
        if usize::from(sequence) > MOST_SEGMENTS {
            self.clear_block();
            return;
        }
        self.apply_segments(sequence, Some(frame), keep);
    }

    fn apply_segments(&mut self, count: u8, frame: Option<u64>, mut keep: impl FnMut(DataPart<'_>)) {
        self.count_loss(count, frame);
        for place in 0..usize::from(count) {
            let segment = self.segment_at(place);
            if !segment.is_seen() {
                if self.starts_late && self.tail.is_none() {
                    continue;
                }
                self.missing += 1;
            }
            self.flush_segment(0, &mut keep);
            self.tail = Some(segment);
        }
        let last = self.last_sequence.or(self.repeated_last);
        self.is_complete = count > 0 && last == Some(count);
        self.repeated_last = last.and_then(|last| last.checked_sub(count)).filter(|rest| *rest > 0);
        let end = self.present.len().max(self.repeated.len());
        self.repeated = (usize::from(count)..end).map(|place| self.segment_at(place)).collect();
        self.clear_block();
    }

    /// A segment of the present block; if it was captured only when it was first sent, that one.
    fn segment_at(&self, place: usize) -> CapturedSegment {
        let in_list = |list: &[CapturedSegment]| list.get(place).copied().filter(|it| it.is_seen());
        in_list(&self.present).or_else(|| in_list(&self.repeated)).unwrap_or_default()
    }

    /// Counts segments that were sent, but not acknowledged: they were lost on the bus.
    fn count_loss(&mut self, count: u8, frame: Option<u64>) {
        let loss = BlockLoss { sequence: count.saturating_add(1), frame };
        if count < self.latest {
            self.add_loss(loss);
        } else if self.last_sequence.is_none()
            && self.latest > 0
            && self.size.is_some_and(|size| count < size)
        {
            self.possible_loss = Some(loss);
        }
    }

    fn add_loss(&mut self, loss: BlockLoss) {
        self.losses += 1;
        self.first_loss.get_or_insert(loss);
    }

    fn clear_block(&mut self) {
        self.present.clear();
        self.latest = 0;
        self.last_sequence = None;
    }

    /// Whether the next frame of the sender may be the end message: the final segment was sent, or may be one
    /// that is missing in the capture.
    pub(super) fn expects_end(&self) -> bool {
        let lacks_tail = self.present.is_empty() && self.tail.is_some_and(|tail| !tail.is_seen());
        self.last_sequence.is_some() || lacks_tail
    }

    /// Applies the end message: unused bytes of the last segment, and the CRC.
    pub(super) fn end_block(&mut self, unused: u8, crc: u16, mut keep: impl FnMut(DataPart<'_>)) {
        self.presume_rest(&mut keep);
        self.flush_segment(usize::from(unused), &mut keep);
        let used = self.client_crc.unwrap_or(true) && self.server_crc.unwrap_or(true);
        self.verdict = Some(if !used {
            CrcCheck::NotUsed
        } else if self.has_gap || self.starts_late {
            CrcCheck::Unchecked
        } else if crc == self.crc {
            CrcCheck::Correct
        } else if self.is_presumed {
            CrcCheck::Unchecked
        } else {
            CrcCheck::Wrong
        });
    }

    /// Registers that the data is shorter than announced. If the CRC does not confirm it, whole blocks are missing
    /// in the capture.
    pub(super) fn lacks_bytes(&mut self, count: u64) {
        if count > 0 && matches!(self.verdict, Some(CrcCheck::Wrong | CrcCheck::Unchecked)) {
            self.missing += count.div_ceil(SEGMENT as u64);
            self.verdict = Some(CrcCheck::Unchecked);
            self.is_presumed = true;
        }
    }

    /// Acknowledges the rest of the present block, whose acknowledgement is missing in the capture.
    pub(super) fn presume_rest(&mut self, keep: impl FnMut(DataPart<'_>)) {
        self.possible_loss = None;
        if !self.present.is_empty() {
            self.is_presumed = true;
            self.apply_segments(self.last_sequence.unwrap_or(self.latest), None, keep);
            self.possible_loss = None;
        }
    }

    /// Ends the data without the end message; `unused` bytes of the last segment are not data.
    pub(super) fn end_tail(&mut self, unused: usize, mut keep: impl FnMut(DataPart<'_>)) {
        self.flush_segment(unused, &mut keep);
    }

    /// Ends a transfer without an end message. All captured segments are kept.
    pub(super) fn give_up(&mut self, mut keep: impl FnMut(DataPart<'_>)) {
        for place in 0..self.present.len() {
            let segment = self.segment_at(place);
            if segment.is_seen() || !self.starts_late || self.tail.is_some() {
                self.flush_segment(0, &mut keep);
                self.tail = Some(segment);
            }
        }
        self.flush_segment(0, &mut keep);
        self.clear_block();
    }

    /// Result of the CRC check; `None` before the end message.
    pub(super) fn crc_verdict(&self) -> Option<CrcCheck> {
        self.verdict
    }

    /// Whether the value is not reliable: bytes are missing, or positions are presumed and not confirmed by
    /// the CRC.
    pub(super) fn is_unreliable(&self) -> bool {
        self.has_gap || self.is_presumed && self.verdict != Some(CrcCheck::Correct)
    }

    /// Passes the last segment to `keep`, without its `unused` bytes.
    fn flush_segment(&mut self, unused: usize, keep: &mut impl FnMut(DataPart<'_>)) {
        let Some(tail) = self.tail.take() else { return };
        let used = SEGMENT.saturating_sub(unused);
        let seen = usize::from(tail.length).min(used);
        if let Some(bytes) = tail.bytes.get(..seen).filter(|bytes| !bytes.is_empty()) {
            self.crc = crc16(self.crc, bytes);
            keep(DataPart::Bytes(bytes));
        }
        if seen < used {
            self.has_gap = true;
            keep(DataPart::Gap(used - seen));
        }
    }

    /// Bytes held by the buffers.
    pub(super) fn footprint(&self) -> usize {
        (self.present.capacity() + self.repeated.capacity()) * size_of::<CapturedSegment>()
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

    /// Collects parts; a gap is written as one `?` per byte.
    fn into(text: &mut Vec<u8>) -> impl FnMut(DataPart<'_>) {
        |part| match part {
            DataPart::Bytes(bytes) => text.extend_from_slice(bytes),
            DataPart::Gap(count) => text.resize(text.len() + count, b'?'),
        }
    }

    fn segments(blocks: &mut BlockProgress, text: &mut Vec<u8>, list: &[(u8, &[u8])]) {
        for (byte, data) in list {
            blocks.add_segment(byte & 0x7F, byte & 0x80 != 0, data, into(text));
        }
    }

    #[test]
    fn the_check_value_of_the_standard() {
        // CiA 301 §7.2.4.3.16: the CRC of "123456789" is 0x31C3.
        assert_eq!(crc16(0, b"123456789"), 0x31C3);
    }

    #[test]
    fn two_segments_in_one_block() {
        let (mut blocks, mut data) = (BlockProgress::default(), Vec::new());
        blocks.client_offers(true);
        blocks.server_offers(true);
        segments(&mut blocks, &mut data, &[(1, b"1234567"), (0x82, b"89\0\0\0\0\0")]);
        blocks.acknowledge_segments(2, 9, into(&mut data));
        assert!(blocks.is_complete);
        blocks.end_block(5, 0x31C3, into(&mut data));
        assert_eq!((data.as_slice(), blocks.crc_verdict()), (&b"123456789"[..], Some(CrcCheck::Correct)));
        assert_eq!((blocks.missing, blocks.losses), (0, 0));
    }

    #[test]
    fn segments_without_acknowledgement_are_repeated() {
        // §7.2.4.3.9: after ackseq 1 the sender continues with the next segment as number 1.
        let (mut blocks, mut data) = (BlockProgress::default(), Vec::new());
        segments(&mut blocks, &mut data, &[(1, b"1234567"), (0x82, b"89\0\0\0\0\0")]);
        blocks.acknowledge_segments(1, 9, into(&mut data));
        assert!(!blocks.is_complete);
        segments(&mut blocks, &mut data, &[(0x81, b"89\0\0\0\0\0")]);
        blocks.acknowledge_segments(1, 11, into(&mut data));
        assert!(blocks.is_complete);
        blocks.end_block(5, 0x31C3, into(&mut data));
        assert_eq!((data.as_slice(), blocks.crc_verdict()), (&b"123456789"[..], Some(CrcCheck::Correct)));
        assert_eq!((blocks.missing, blocks.losses), (0, 1));
        assert_eq!(blocks.first_loss, Some(BlockLoss { sequence: 2, frame: Some(9) }));
    }

    #[test]
    fn a_repeated_segment_that_is_not_captured_is_known_from_its_first_transmission() {
        let (mut blocks, mut data) = (BlockProgress::default(), Vec::new());
        segments(&mut blocks, &mut data, &[(1, b"1234567"), (0x82, b"89\0\0\0\0\0")]);
        blocks.acknowledge_segments(1, 9, into(&mut data));
        blocks.acknowledge_segments(1, 11, into(&mut data));
        assert!(blocks.is_complete);
        blocks.end_block(5, 0x31C3, into(&mut data));
        assert_eq!((data.as_slice(), blocks.missing), (&b"123456789"[..], 0));
    }

    #[test]
    fn an_acknowledged_segment_that_was_not_captured_is_a_gap() {
        let (mut blocks, mut data) = (BlockProgress::default(), Vec::new());
        segments(&mut blocks, &mut data, &[(0x82, b"89\0\0\0\0\0")]);
        blocks.acknowledge_segments(2, 9, into(&mut data));
        blocks.end_block(5, 0x31C3, into(&mut data));
        assert_eq!((data.as_slice(), blocks.crc_verdict()), (&b"???????89"[..], Some(CrcCheck::Unchecked)));
        assert_eq!((blocks.missing, blocks.losses), (1, 0));
    }

    #[test]
    fn a_final_segment_that_was_not_captured_is_a_gap() {
        let (mut blocks, mut data) = (BlockProgress::default(), Vec::new());
        segments(&mut blocks, &mut data, &[(1, b"1234567")]);
        blocks.acknowledge_segments(2, 9, into(&mut data));
        assert!(!blocks.is_complete && blocks.expects_end());
        blocks.end_block(5, 0x31C3, into(&mut data));
        assert_eq!((data.as_slice(), blocks.missing), (&b"1234567??"[..], 1));
    }

    #[test]
    fn a_sequence_that_starts_again_overwrites_nothing() {
        // Blocks of 2 segments; the first acknowledgement is missing in the capture. The CRC confirms it.
        let (mut blocks, mut data) =
            (BlockProgress { size: Some(2), ..BlockProgress::default() }, Vec::new());
        let list: [(u8, &[u8]); 3] = [(1, b"abcdefg"), (2, b"hijklmn"), (0x81, b"op\0\0\0\0\0")];
        segments(&mut blocks, &mut data, &list);
        blocks.acknowledge_segments(1, 9, into(&mut data));
        blocks.end_block(5, crc16(0, b"abcdefghijklmnop"), into(&mut data));
        assert_eq!(
            (data.as_slice(), blocks.crc_verdict()),
            (&b"abcdefghijklmnop"[..], Some(CrcCheck::Correct))
        );
        assert!(!blocks.is_unreliable());
    }

    #[test]
    fn a_hole_over_an_acknowledgement_is_a_gap_and_no_loss() {
        // Blocks of 3; segment 3, the acknowledgement and segment 1 of the next block are missing.
        let (mut blocks, mut data) =
            (BlockProgress { size: Some(3), ..BlockProgress::default() }, Vec::new());
        segments(&mut blocks, &mut data, &[(1, b"abcdefg"), (2, b"hijklmn"), (2, b"vwxyz01")]);
        blocks.acknowledge_segments(2, 9, into(&mut data));
        blocks.give_up(into(&mut data));
        assert_eq!(data, b"abcdefghijklmn??????????????vwxyz01");
        assert_eq!((blocks.missing, blocks.losses), (2, 0));
        assert!(blocks.is_unreliable());
    }

    #[test]
    fn an_end_without_acknowledgement_keeps_the_last_block() {
        let (mut blocks, mut data) = (BlockProgress::default(), Vec::new());
        segments(&mut blocks, &mut data, &[(1, b"1234567"), (0x82, b"89\0\0\0\0\0")]);
        assert!(blocks.expects_end());
        blocks.end_block(5, 0x31C3, into(&mut data));
        assert_eq!((data.as_slice(), blocks.crc_verdict()), (&b"123456789"[..], Some(CrcCheck::Correct)));
    }

    #[test]
    fn a_frame_twice_and_a_short_segment() {
        let (mut blocks, mut data) = (BlockProgress::default(), Vec::new());
        segments(&mut blocks, &mut data, &[(1, b"1234567"), (1, b"1234567"), (2, b"89"), (0x83, b"x")]);
        blocks.acknowledge_segments(3, 9, into(&mut data));
        blocks.end_block(6, 0, into(&mut data));
        assert_eq!(data, b"123456789?????x", "bytes that were not sent are not invented");
    }

    #[test]
    fn an_acknowledgement_of_more_than_a_block_has_acknowledges_nothing() {
        let (mut blocks, mut data) = (BlockProgress::default(), Vec::new());
        segments(&mut blocks, &mut data, &[(0x81, b"1234567")]);
        blocks.acknowledge_segments(128, 9, into(&mut data));
        assert!(data.is_empty() && !blocks.is_complete);
    }

    #[test]
    fn a_wrong_crc_is_seen() {
        let (mut blocks, mut data) = (BlockProgress::default(), Vec::new());
        segments(&mut blocks, &mut data, &[(0x81, b"1234567")]);
        blocks.acknowledge_segments(1, 9, into(&mut data));
        blocks.end_block(0, 0, into(&mut data));
        assert_eq!(blocks.crc_verdict(), Some(CrcCheck::Wrong));
    }
}
