//! Segments of a segmented transfer (CiA 301 §7.2.4.3.4, §7.2.4.3.7).
//!
//! The toggle bit alternates between segments, and the server repeats the bit of the client. Three observations
//! distinguish a capture with missing frames from a violation of the protocol:
//!
//! ```text
//! client continues without a response          the response was not captured: it had a whole segment
//! response without a segment of the client     the segment was not captured
//! both sides skip a bit, with other data       an odd number of segments was not captured
//! ```
//! Bytes that were not captured are a gap. If all announced bytes were captured, nothing is missing, and a skipped bit is a
//! violation after all.

use super::segments::{WHOLE, segment_content};
use super::transfer::SdoTransferState;
use crate::event::SdoIrregularityKind;
use crate::wire::canopen::sdo::{SdoSegment, SdoSide};

/// Data bytes of two segments: without them the toggle bits still alternate.
const UNNOTICED: u64 = 14;

impl SdoTransferState {
    /// Applies a request of the client for a segment of an upload.
    pub(super) fn asks_segment(&mut self, toggle: bool) {
        if self.on_client_segment(toggle) && !self.last_seen {
            self.skip_segment(!toggle);
        }
    }

    /// Applies a segment of an upload.
    pub(super) fn answers_with_segment(&mut self, segment: &SdoSegment<'_>, frame: u64) {
        // The server repeats the bit of a request, so the client skipped it.
        let side = if self.segments.asked.is_some() { SdoSide::Client } else { SdoSide::Server };
        let is_doubtful = self.is_doubtful(segment.toggle, frame);
        if is_doubtful && !self.ends_with(segment) {
            self.skip_segment(!segment.toggle);
        }
        self.take_segment(segment, side, frame);
    }

    /// Whether a segment is the last one and reaches the announced size exactly, so that none before it is missing.
    fn ends_with(&self, segment: &SdoSegment<'_>) -> bool {
        let size = self.size.saturating_add(segment.data.len() as u64);
        segment.last && self.announced.is_some_and(|announced| u64::from(announced) == size)
    }

    /// Applies a segment of a download.
    pub(super) fn take_client_segment(&mut self, segment: &SdoSegment<'_>, frame: u64) {
        self.on_client_segment(segment.toggle);
        self.take_segment(segment, SdoSide::Client, frame);
    }

    /// Applies the confirmation of a segment of a download.
    pub(super) fn confirms_segment(&mut self, toggle: bool, frame: u64) {
        let was_asked = self.segments.asked.is_some();
        let is_doubtful = self.is_doubtful(toggle, frame);
        let lacks_segment = is_doubtful || !was_asked && toggle == self.segments.next;
        if lacks_segment && !self.last_seen && !self.cut_start {
            self.skip_segment(toggle);
        }
    }

    /// Registers a message of the client; `true` if the server responded to the one before, and this was not captured.
    fn on_client_segment(&mut self, toggle: bool) -> bool {
        if let Some((wrong, frame)) = self.segments.doubt.take()
            && wrong == toggle
        {
            self.segments.is_violated = true;
            self.note_irregularity(SdoIrregularityKind::Toggle, SdoSide::Server, frame);
        }
        self.segments.asked.replace(toggle).is_some_and(|before| before != toggle)
    }

    /// Whether the server responds with another toggle bit than that of the client.
    fn is_doubtful(&mut self, toggle: bool, frame: u64) -> bool {
        let is_doubtful = self.segments.asked.take().is_some_and(|asked| asked != toggle);
        if is_doubtful {
            self.segments.doubt = Some((toggle, frame));
            self.segments.skipped.get_or_insert((SdoSide::Server, frame));
        }
        is_doubtful
    }

    /// A segment that was transferred and not captured, with its toggle bit. It is the last one if it reaches the announced
    /// size.
    fn skip_segment(&mut self, toggle: bool) {
        let rest = self.announced.map(|size| u64::from(size).saturating_sub(self.size));
        let count = rest.and_then(|rest| usize::try_from(rest).ok()).map_or(WHOLE, |rest| rest.min(WHOLE));
        self.skip_data(count);
        self.segments.missing += 1;
        self.segments.gaps += 1;
        self.segments.last = None;
        self.segments.next = !toggle;
        self.last_seen = rest.is_some_and(|rest| rest <= WHOLE as u64);
    }

    fn take_segment(&mut self, segment: &SdoSegment<'_>, side: SdoSide, frame: u64) {
        if self.last_seen || self.segments.is_repeated(segment) {
            return;
        }
        let is_first = self.size == 0 && self.cut_start;
        if segment.toggle != self.segments.next && !is_first {
            self.skip_data(WHOLE);
            self.segments.missing += 1;
            self.segments.gaps += 1;
            self.segments.skipped.get_or_insert((side, frame));
        }
        self.segments.next = !segment.toggle;
        self.segments.last = Some(segment_content(segment));
        self.keep_data(segment.data);
        self.last_seen = segment.last;
    }

    /// Compares a complete transfer with its announced size.
    pub(super) fn settle_segments(&mut self) {
        let seen = self.size.saturating_sub(self.unseen);
        let is_whole = self.announced.map_or(self.segments.doubt.is_some(), |size| u64::from(size) == seen);
        if let Some((side, frame)) = self.segments.skipped
            && (is_whole || self.segments.is_violated)
            && !self.cut_start
        {
            self.join_ranges();
            self.segments.missing = 0;
            self.note_irregularity(SdoIrregularityKind::Toggle, side, frame);
            return;
        }
        let Some(announced) = self.announced.map(u64::from) else { return };
        let absent = announced.saturating_sub(self.size);
        // With an even number of segments missing the toggle bits still alternate.
        if absent == 0 || !absent.is_multiple_of(UNNOTICED) || self.cut_start {
            return;
        }
        self.segments.missing += absent / WHOLE as u64;
        match self.segments.gaps {
            0 => self.truncated = true,
            gaps => self.widen_gap(absent, gaps == 1),
        }
    }

    /// Removes gaps where nothing was missing.
    fn join_ranges(&mut self) {
        for range in std::mem::take(&mut self.later_data) {
            self.data.extend_from_slice(&range.data);
        }
        self.size = self.size.saturating_sub(self.unseen);
        (self.unseen, self.later_bytes) = (0, 0);
        self.truncated = self.data.len() as u64 != self.size;
    }

    /// Moves data after a gap by `absent` bytes: the last segment ends at the announced size. With several gaps of unknown
    /// size only the data after the last one has a known position.
    fn widen_gap(&mut self, absent: u64, is_single: bool) {
        self.size = self.size.saturating_add(absent);
        self.unseen = self.unseen.saturating_add(absent);
        let first = if is_single { 0 } else { self.later_data.len().saturating_sub(1) };
        for range in self.later_data.drain(..first) {
            self.unseen = self.unseen.saturating_add(range.data.len() as u64);
            self.later_bytes = self.later_bytes.saturating_sub(range.data.len());
        }
        for range in &mut self.later_data {
            range.offset = range.offset.saturating_add(absent);
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::event::{SdoDirection, SdoMode};
    use crate::frame::{CanId, Frame};

    fn upload(announced: Option<u32>) -> SdoTransferState {
        let mut transfer =
            SdoTransferState::new(0, None, &Frame::data_frame(CanId::from_standard(0x605), &[]));
        (transfer.direction, transfer.mode) = (Some(SdoDirection::Upload), Some(SdoMode::Segmented));
        transfer.announced = announced;
        transfer
    }

    fn segment(toggle: bool, last: bool, data: &[u8]) -> SdoSegment<'_> {
        SdoSegment { toggle, last, data }
    }

    /// A response that was not captured had seven bytes: the client asked for a further segment.
    #[test]
    fn a_missing_response_is_a_gap_of_one_segment() {
        let mut transfer = upload(Some(16));
        transfer.asks_segment(false);
        transfer.answers_with_segment(&segment(false, false, &[1; 7]), 1);
        transfer.asks_segment(true);
        transfer.asks_segment(false);
        transfer.answers_with_segment(&segment(false, true, &[3; 2]), 2);
        transfer.complete_transfer();
        assert_eq!((transfer.size, transfer.unseen, transfer.segments.missing), (16, 7, 1));
        assert_eq!((transfer.data.as_slice(), transfer.later_data[0].offset), (&[1; 7][..], 14));
        assert_eq!(transfer.irregularity, None);
    }

    /// Three segments missing before the last one of 30 bytes: 30 = 7 + 21 + 2.
    #[test]
    fn a_skipped_bit_is_a_gap_up_to_the_announced_size() {
        let mut transfer = upload(Some(30));
        transfer.asks_segment(false);
        transfer.answers_with_segment(&segment(false, false, &[1; 7]), 1);
        transfer.asks_segment(false);
        transfer.answers_with_segment(&segment(false, true, &[3; 2]), 2);
        transfer.complete_transfer();
        assert_eq!((transfer.size, transfer.unseen, transfer.segments.missing), (30, 21, 3));
        assert_eq!(transfer.later_data[0].offset, 28);
    }

    /// All nine announced bytes were captured: the client did not alternate its toggle bit.
    #[test]
    fn a_skipped_bit_without_a_loss_is_a_violation() {
        let mut transfer = upload(Some(9));
        transfer.asks_segment(false);
        transfer.answers_with_segment(&segment(false, false, &[1; 7]), 1);
        transfer.asks_segment(false);
        transfer.answers_with_segment(&segment(false, true, &[3; 2]), 2);
        transfer.complete_transfer();
        assert_eq!((transfer.size, transfer.unseen, transfer.segments.missing), (9, 0, 0));
        assert_eq!(transfer.data, [1, 1, 1, 1, 1, 1, 1, 3, 3]);
        assert!(transfer.irregularity.is_some_and(|found| found.by_client && found.frame == 2));
    }

    /// The server repeats the bit of the segment before in the last one; the announced size leaves no gap.
    #[test]
    fn a_wrong_bit_in_the_last_segment_is_a_violation() {
        let mut transfer = upload(Some(9));
        transfer.asks_segment(false);
        transfer.answers_with_segment(&segment(false, false, &[1; 7]), 1);
        transfer.asks_segment(true);
        transfer.answers_with_segment(&segment(false, true, &[3; 2]), 2);
        transfer.complete_transfer();
        assert_eq!((transfer.size, transfer.unseen, transfer.segments.missing), (9, 0, 0));
        assert_eq!(transfer.data, [1, 1, 1, 1, 1, 1, 1, 3, 3]);
        assert!(transfer.irregularity.is_some_and(|found| !found.by_client && found.frame == 2));
    }

    #[test]
    fn a_repeated_segment_is_taken_once() {
        let mut transfer = upload(Some(8));
        for _ in 0..2 {
            transfer.asks_segment(false);
            transfer.answers_with_segment(&segment(false, false, &[1; 7]), 1);
        }
        transfer.asks_segment(true);
        transfer.answers_with_segment(&segment(true, true, &[2]), 2);
        transfer.complete_transfer();
        assert_eq!((transfer.size, transfer.unseen, transfer.irregularity), (8, 0, None));
    }

    /// The confirmations of three segments were captured, the second segment was not; the last one has two bytes.
    #[test]
    fn a_confirmation_without_its_segment_is_a_gap() {
        let mut transfer = upload(Some(16));
        transfer.direction = Some(SdoDirection::Download);
        transfer.take_client_segment(&segment(false, false, &[1; 7]), 1);
        transfer.confirms_segment(false, 2);
        transfer.confirms_segment(true, 3);
        assert_eq!((transfer.size, transfer.unseen, transfer.last_seen), (14, 7, false));
        transfer.confirms_segment(false, 4);
        transfer.complete_transfer();
        assert_eq!((transfer.size, transfer.unseen, transfer.last_seen), (16, 9, true));
        assert_eq!((transfer.data.len(), transfer.later_data.len()), (7, 0));
    }
}
