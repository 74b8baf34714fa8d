//! Received packets of one transfer, in bounded memory.
//!
//! ```text
//! packet   1 … whole_to │ whole_to + 1 is missing   │ … highest
//! data     complete     │ at most 256 packets ahead │ only counted
//! seen     one bit for each of the last 256 packets up to `highest`
//! ```
//!
//! A receiver requests packets again only within the last window, which has at most 255 packets. So packets
//! more than 256 before the highest are never requested again; if one is received, it is counted as
//! repeated.

use crate::session::limits::TRANSFER_DATA_LIMIT;
use crate::wire::j1939::PACKET_SIZE;

/// Number of packets tracked individually.
const REACH: u32 = 256;

/// Received packets of one transfer.
#[derive(Debug, Clone)]
pub(super) struct ReceivedPackets {
    /// Packet at which `data` starts: 1, or the first one received if the start is missing.
    first: u32,
    /// Highest number received; `first` - 1 before the first packet.
    highest: u32,
    /// Bit k over both words: packet `highest` - k was received.
    seen: (u128, u128),
    /// All packets up to this one were received.
    whole_to: u32,
    /// Packets received, without repetitions.
    distinct: u32,
    repeated: u32,
    /// Bytes received, without repetitions.
    size: u64,
    data: Vec<u8>,
    /// The data was dropped because of the common limit; later data is not stored.
    is_given_up: bool,
}

impl ReceivedPackets {
    /// State of a transfer whose packets are numbered from `first`.
    pub(super) fn new(first: u32) -> Self {
        let before = first.saturating_sub(1);
        Self {
            first,
            highest: before,
            seen: (0, 0),
            whole_to: before,
            distinct: 0,
            repeated: 0,
            size: 0,
            data: Vec::new(),
            is_given_up: false,
        }
    }

    pub(super) fn first(&self) -> u32 {
        self.first
    }

    pub(super) fn highest(&self) -> u32 {
        self.highest
    }

    pub(super) fn distinct_count(&self) -> u32 {
        self.distinct
    }

    pub(super) fn repeated_count(&self) -> u32 {
        self.repeated
    }

    pub(super) fn size(&self) -> u64 {
        self.size
    }

    /// Missing packets between the first and the highest.
    pub(super) fn gap_count(&self) -> u32 {
        let span = self.highest.saturating_add(1).saturating_sub(self.first);
        span.saturating_sub(self.distinct)
    }

    /// Whether a packet was received; `None` if it is no longer tracked.
    fn was_received(&self, number: u32) -> Option<bool> {
        let Some(back) = self.highest.checked_sub(number) else { return Some(false) };
        match back {
            0..128 => Some(self.seen.0 >> back & 1 == 1),
            128..REACH => Some(self.seen.1 >> (back - 128) & 1 == 1),
            _ => None,
        }
    }

    /// Whether a packet is treated as received before.
    pub(super) fn was_received_before(&self, number: u32) -> bool {
        self.was_received(number).unwrap_or(true)
    }

    /// Adds a packet from `first` on; bytes after `announced` are padding. A packet that was requested again
    /// replaces the previous one.
    pub(super) fn take_packet(
        &mut self,
        number: u32,
        bytes: &[u8; 7],
        announced: Option<u32>,
        was_asked: bool,
    ) {
        let is_new = !self.was_received_before(number);
        if is_new {
            self.distinct = self.distinct.saturating_add(1);
            let begin = number.saturating_sub(1).saturating_mul(PACKET_SIZE);
            let length = announced.map_or(PACKET_SIZE, |size| size.saturating_sub(begin).min(PACKET_SIZE));
            self.size = self.size.saturating_add(u64::from(length));
            self.mark_received(number);
        } else {
            self.repeated = self.repeated.saturating_add(1);
        }
        if is_new || was_asked {
            self.keep_bytes(number, bytes);
        }
        while self.whole_to < self.highest && self.was_received(self.whole_to.saturating_add(1)) == Some(true)
        {
            self.whole_to = self.whole_to.saturating_add(1);
        }
    }

    fn mark_received(&mut self, number: u32) {
        if let Some(ahead) = number.checked_sub(self.highest) {
            let (low, high) = self.seen;
            self.seen = match ahead {
                0 => (low, high),
                1..128 => (low << ahead, high << ahead | low >> (128 - ahead)),
                128..REACH => (0, low << (ahead - 128)),
                _ => (0, 0),
            };
            self.highest = number;
        }
        match self.highest.saturating_sub(number) {
            back @ 0..128 => self.seen.0 |= 1 << back,
            back @ 128..REACH => self.seen.1 |= 1 << (back - 128),
            _ => {}
        }
    }

    /// Stores the bytes, unless a gap before them can no longer be filled.
    fn keep_bytes(&mut self, number: u32, bytes: &[u8; 7]) {
        if self.is_given_up || number.saturating_sub(self.whole_to) > REACH {
            return;
        }
        let place = number.saturating_sub(self.first).saturating_mul(PACKET_SIZE);
        let Ok(begin) = usize::try_from(place) else { return };
        let end = begin.saturating_add(bytes.len()).min(TRANSFER_DATA_LIMIT);
        if end <= begin {
            return;
        }
        if self.data.len() < end {
            self.data.resize(end, 0);
        }
        if let Some(target) = self.data.get_mut(begin..end) {
            target.iter_mut().zip(bytes).for_each(|(target, byte)| *target = *byte);
        }
    }

    /// Renumbers the packets of a transfer without start, so that the last one is `last`.
    pub(super) fn renumber_packets(&mut self, last: u32) {
        if let Some(shift) = last.checked_sub(self.highest) {
            for number in [&mut self.first, &mut self.highest, &mut self.whole_to] {
                *number = number.saturating_add(shift);
            }
        }
    }

    /// Drops the data; later data is only counted.
    pub(super) fn give_up_data(&mut self) {
        self.data = Vec::new();
        self.is_given_up = true;
    }

    /// Data bytes held.
    pub(super) fn held_bytes(&self) -> usize {
        self.data.len()
    }

    /// Bytes allocated.
    pub(super) fn footprint(&self) -> usize {
        self.data.capacity()
    }

    /// Removes and returns the data up to the first gap, the limit, or the end of the message.
    pub(super) fn take_data(&mut self, announced: Option<u32>) -> Vec<u8> {
        let mut data = std::mem::take(&mut self.data);
        let packets = self.whole_to.saturating_add(1).saturating_sub(self.first);
        let mut length = packets.saturating_mul(PACKET_SIZE);
        if let (Some(announced), 1) = (announced, self.first) {
            length = length.min(announced);
        }
        data.truncate(usize::try_from(length).unwrap_or(usize::MAX));
        data
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn packet(number: u32) -> [u8; 7] {
        [number.to_le_bytes()[0]; 7]
    }

    fn took(received: &mut ReceivedPackets, numbers: &[u32], announced: Option<u32>) {
        for number in numbers {
            received.take_packet(*number, &packet(*number), announced, false);
        }
    }

    #[test]
    fn padding_is_no_data() {
        let mut received = ReceivedPackets::new(1);
        took(&mut received, &[1, 2], Some(9));
        assert_eq!((received.size(), received.distinct_count(), received.gap_count()), (9, 2, 0));
        assert_eq!(received.take_data(Some(9)), [1, 1, 1, 1, 1, 1, 1, 2, 2]);
    }

    #[test]
    fn a_gap_is_filled_and_a_packet_that_is_there_is_repeated() {
        let mut received = ReceivedPackets::new(1);
        took(&mut received, &[1, 4, 2, 2], Some(28));
        assert_eq!(
            (received.distinct_count(), received.repeated_count(), received.gap_count(), received.size()),
            (3, 1, 1, 21)
        );
        assert_eq!(received.clone().take_data(Some(28)).len(), 14, "up to the gap");
        took(&mut received, &[3], Some(28));
        let data = received.take_data(Some(28));
        assert_eq!((data.len(), data[14], data[21]), (28, 3, 4));
    }

    #[test]
    fn what_was_asked_for_again_replaces() {
        let mut received = ReceivedPackets::new(1);
        received.take_packet(1, &[1; 7], None, false);
        received.take_packet(1, &[2; 7], None, false);
        received.take_packet(1, &[3; 7], None, true);
        assert_eq!(received.take_data(None), [3; 7]);
        assert_eq!(received.repeated_count(), 2);
    }

    #[test]
    fn bits_move_over_the_whole_reach() {
        // 1, 100, 200, 256: packet 1 is 255 before the highest and still tracked; after 257 it is not.
        let mut received = ReceivedPackets::new(1);
        took(&mut received, &[1, 100, 200, 256], None);
        assert_eq!(
            [1, 2, 100, 101, 200, 256].map(|number| received.was_received(number)),
            [true, false, true, false, true, true].map(Some)
        );
        took(&mut received, &[257], None);
        assert_eq!(
            (received.was_received(1), received.was_received(2), received.was_received(100)),
            (None, Some(false), Some(true))
        );
        took(&mut received, &[1000], None);
        assert_eq!(
            (received.was_received(257), received.was_received(999), received.was_received(1000)),
            (None, Some(false), Some(true))
        );
        assert_eq!(received.distinct_count(), 6);
    }

    #[test]
    fn far_packets_cost_no_memory_and_the_limit_holds() {
        let mut received = ReceivedPackets::new(1);
        took(&mut received, &[1, 9_000], None);
        assert_eq!(received.held_bytes(), 7);
        // 65,536 bytes are 9,362 packets and two bytes.
        let mut received = ReceivedPackets::new(1);
        (1..=20_000).for_each(|number| received.take_packet(number, &packet(number), None, false));
        assert_eq!((received.size(), received.held_bytes()), (140_000, TRANSFER_DATA_LIMIT));
        assert_eq!(received.take_data(None).len(), TRANSFER_DATA_LIMIT);
    }

    #[test]
    fn without_start_data_begins_with_the_first_packet_seen() {
        let mut received = ReceivedPackets::new(5);
        took(&mut received, &[5, 6, 8], None);
        assert_eq!((received.gap_count(), received.size()), (1, 21));
        received.renumber_packets(508);
        assert_eq!(
            (received.first(), received.highest(), received.was_received(507)),
            (505, 508, Some(false))
        );
        assert_eq!(received.take_data(None), [[5; 7], [6; 7]].concat());
    }
}
