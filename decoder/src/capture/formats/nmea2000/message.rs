//! A message with its PGN, and its frames on the bus.

use std::collections::VecDeque;

use crate::frame::{CanId, Frame};

/// Longest message of the fast packet in bytes: 6 in the first frame, 7 in each of 31 further ones.
const LONGEST_MESSAGE: usize = 6 + 31 * 7;

/// Largest PGN: 18 bits.
const LARGEST_PGN: u32 = 0x3_FFFF;

/// Byte that fills the last frame.
const FILLER: u8 = 0xFF;

/// Expected content if the data are invalid.
pub(super) const DATA: &str = "data: expected 1 to 223 bytes in hex";

/// Expected content if the PGN is invalid.
pub(super) const PGN: &str = "PGN: expected a number up to 3FFFF (262143)";

/// Expected content if an address or the priority is invalid.
pub(super) const ADDRESS: &str = "addresses: expected numbers up to FF (255), and a priority up to 7";

/// Time of a message.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum MessageTime {
    /// Nanoseconds since 1970, and whether the text states UTC.
    Date(i64, bool),
    /// Nanoseconds since midnight.
    OfDay(i64),
}

/// A message with its time; the error is the content expected.
pub(super) type ParsedMessage = Result<(MessageTime, PgnMessage), &'static str>;

/// A message of NMEA 2000 or J1939.
#[derive(Debug, Clone, PartialEq, Eq)]
pub(super) struct PgnMessage {
    id: CanId,
    data: Vec<u8>,
}

impl PgnMessage {
    /// Builds a message; the error is the content expected.
    pub(super) fn new(
        priority: u8,
        pgn: u32,
        source: u8,
        destination: u8,
        data: Vec<u8>,
    ) -> Result<Self, &'static str> {
        if priority > 7 {
            return Err(ADDRESS);
        }
        if pgn > LARGEST_PGN {
            return Err(PGN);
        }
        if data.is_empty() || data.len() > LONGEST_MESSAGE {
            return Err(DATA);
        }
        // PDU1 (SAE J1939-21): below F0 the lower byte of the identifier's PGN is the destination.
        let is_addressed = pgn >> 8 & 0xFF < 0xF0;
        let specific = if is_addressed { pgn & !0xFF | u32::from(destination) } else { pgn };
        let id = CanId::from_extended(u32::from(priority) << 26 | specific << 8 | u32::from(source));
        Ok(Self { id, data })
    }

    /// Whether the message does not fit one frame.
    pub(super) fn is_long(&self) -> bool {
        self.data.len() > 8
    }
}

/// Builds the frames of messages.
#[derive(Debug, Clone, Default)]
pub(super) struct PacketBuilder {
    /// Sequence counter of each identifier.
    counters: Vec<(CanId, u8)>,
    pending: VecDeque<Frame>,
}

/// Maximum number of identifiers with an own sequence counter.
const MOST_COUNTERS: usize = 1_024;

impl PacketBuilder {
    /// The first frame of a message; [`Self::next_frame`] returns the others.
    pub(super) fn first_frame(&mut self, message: PgnMessage) -> Frame {
        let PgnMessage { id, data } = message;
        if data.len() <= 8 {
            return Frame::data_frame(id, &data);
        }
        let counter = self.next_counter(id) << 5;
        let (first, rest) = data.split_at_checked(6).unwrap_or((&data, &[]));
        let total = u8::try_from(data.len()).unwrap_or(u8::MAX);
        let head = Frame::data_frame(id, &[&[counter, total], first].concat());
        for (part, index) in rest.chunks(7).zip(1_u8..) {
            let mut bytes = [FILLER; 8];
            for (slot, byte) in bytes.iter_mut().zip([counter | index].iter().chain(part)) {
                *slot = *byte;
            }
            self.pending.push_back(Frame::data_frame(id, &bytes));
        }
        head
    }

    /// The next frame of the last message.
    pub(super) fn next_frame(&mut self) -> Option<Frame> {
        self.pending.pop_front()
    }

    fn next_counter(&mut self, id: CanId) -> u8 {
        if let Some((_, counter)) = self.counters.iter_mut().find(|(known, _)| *known == id) {
            *counter = (*counter + 1) & 7;
            return *counter;
        }
        if self.counters.len() < MOST_COUNTERS {
            self.counters.push((id, 0));
        }
        0
    }
}
