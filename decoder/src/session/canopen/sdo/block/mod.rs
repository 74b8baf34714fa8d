//! Blocks of a block transfer (CiA 301 §7.2.4.3.9 to §7.2.4.3.15).
//!
//! Only acknowledged segments are valid. Segments that the receiver did not acknowledge are sent again,
//! numbered from 1. So the segments of the present block are buffered until the acknowledgement. Bytes of
//! acknowledged segments that the capture lacks are gaps.

mod captured;
#[cfg(test)]
mod tests;

use captured::{CapturedSegment, PartialBlock, SEGMENT};

use crate::event::CrcCheck;

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
    /// Last acknowledgement of only a part of a block, until the sender continues.
    partial: Option<PartialBlock>,
    /// Segments of the present block that an earlier acknowledgement covers: the sender did not restart at 1.
    base: u8,
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
        if sequence == 0 || usize::from(sequence) > MOST_SEGMENTS {
            return;
        }
        let segment = CapturedSegment::from_data(data);
        if self.continues_block(sequence, segment, last) {
            return;
        }
        if let Some(loss) = self.possible_loss.take() {
            self.add_loss(loss);
        }
        let Some(sequence) = sequence.checked_sub(self.base).filter(|sequence| *sequence > 0) else {
            return;
        };
        let place = usize::from(sequence);
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

    /// Evaluates the first segments after the acknowledgement of a part of a block; `true` if the segment is held.
    fn continues_block(&mut self, sequence: u8, segment: CapturedSegment, last: bool) -> bool {
        let Some(partial) = &mut self.partial else { return false };
        let next = usize::from(partial.sent).saturating_add(partial.held.len()).saturating_add(1);
        if usize::from(sequence) == next {
            partial.held.push((segment, last));
            return true;
        }
        let follows = sequence == partial.count.saturating_add(1) && partial.held.is_empty();
        if follows && self.repeated.first() == Some(&segment) {
            self.base = partial.count;
        }
        // The receiver did not accept the held ones: they are sent again.
        let unaccepted = std::mem::take(&mut partial.held);
        let after = usize::from(partial.sent.saturating_sub(partial.count));
        if !unaccepted.is_empty() {
            self.repeated.resize(after, CapturedSegment::default());
            self.repeated_last = unaccepted
                .iter()
                .position(|(_, last)| *last)
                .and_then(|place| u8::try_from(after.saturating_add(place).saturating_add(1)).ok());
            self.repeated.extend(unaccepted.into_iter().map(|(segment, _)| segment));
        }
        self.partial = None;
        false
    }

    /// The sender did not restart the numbers after the acknowledgement of a part of a block: the held segments follow
    /// the acknowledged ones.
    fn accept_held(&mut self) {
        let Some(partial) = self.partial.take() else { return };
        if partial.held.is_empty() || partial.count != partial.sent {
            return;
        }
        (self.base, self.possible_loss) = (partial.count, None);
        for (segment, last) in partial.held {
            self.present.push(segment);
            self.latest = self.latest.saturating_add(1);
            self.last_sequence = self.last_sequence.or(last.then_some(self.latest));
        }
    }

    /// Whether a sequence number belongs to another block than the segments before it.
    fn starts_again(&self, sequence: u8, is_known: bool) -> bool {
        let is_full = self.last_sequence.is_some()
            || self.size.is_some_and(|size| self.latest.saturating_add(self.base) >= size);
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
        if self.partial.as_ref().is_some_and(|partial| partial.is_exceeded_by(sequence)) {
            self.accept_held();
        }
        let (base, sent) = (self.base, self.latest.saturating_add(self.base));
        self.apply_segments(sequence.saturating_sub(base), Some(frame), keep);
        let is_partial = sequence > 0 && !self.is_complete && self.size.is_some_and(|size| sequence < size);
        self.partial = is_partial.then(|| PartialBlock::new(sequence, sent));
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
            && self.size.is_some_and(|size| count.saturating_add(self.base) < size)
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
        (self.latest, self.base) = (0, 0);
        self.last_sequence = None;
    }

    /// Whether the next frame of the sender may be the end message: the final segment was sent, or may be one
    /// that is missing in the capture.
    pub(super) fn expects_end(&self) -> bool {
        let lacks_tail = self.present.is_empty() && self.tail.is_some_and(|tail| !tail.is_seen());
        let is_held = self.partial.as_ref().is_some_and(PartialBlock::has_last);
        self.last_sequence.is_some() || lacks_tail || is_held
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
        self.accept_held();
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
        let held = self.partial.as_ref().map_or(0, PartialBlock::footprint);
        (self.present.capacity() + self.repeated.capacity()) * size_of::<CapturedSegment>() + held
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
