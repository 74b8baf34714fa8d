//! Random faults of buses and recorders, added to any traffic.

use super::{Message, Random};

/// One message in this number has a fault.
const ONE_IN: u64 = 64;

/// Maximum gap, and maximum backward step of the clock, in milliseconds.
const MOST_MILLISECONDS: u64 = 3_000;

/// Adds faults to messages: lost, doubled, changed, late, early or out of order.
pub struct Faulty<I> {
    messages: I,
    random: Random,
    /// Message to emit before the next one.
    held: Option<Message>,
    /// Sum of all gaps, in nanoseconds.
    later: u64,
}

impl<I: Iterator<Item = Message>> Faulty<I> {
    /// Adds faults to `messages` that depend on the seed only.
    pub fn new(messages: I, seed: u64) -> Self {
        Self { messages, random: Random(seed ^ 0xFA17), held: None, later: 0 }
    }

    fn fault(&mut self, mut message: Message) -> Option<Message> {
        let [byte, place, id @ .., _, _] = self.random.next().to_le_bytes();
        let bit = place & 7;
        match self.random.below(10) {
            0 => return None,
            1 => self.held = Some(message),
            2 => message.data.iter_mut().skip(usize::from(byte & 7)).take(1).for_each(|it| *it ^= 1 << bit),
            3 => message.length = byte % 9,
            4 => message.id ^= 1 << bit,
            5 => message.id = u32::from(byte) << 3 | u32::from(bit),
            6 => (message.extended, message.id) = (true, u32::from_le_bytes(id) & 0x1FFF_FFFF),
            7 => message.remote = true,
            8 => self.later += self.random.below(MOST_MILLISECONDS) * 1_000_000,
            _ => message.time = message.time.saturating_sub(self.random.below(MOST_MILLISECONDS) * 1_000_000),
        }
        Some(message)
    }
}

impl<I: Iterator<Item = Message>> Iterator for Faulty<I> {
    type Item = Message;

    fn next(&mut self) -> Option<Message> {
        if let Some(message) = self.held.take() {
            return Some(message);
        }
        loop {
            let mut message = self.messages.next()?;
            message.time += self.later;
            if self.random.below(ONE_IN) != 0 {
                return Some(message);
            }
            if let Some(message) = self.fault(message) {
                return Some(message);
            }
        }
    }
}
