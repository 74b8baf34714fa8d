//! Traffic of a J1939 bus: six control units, twenty groups every 10 to 1000 ms, DTCs every second, and
//! occasional multi-packet messages.
//!
//! ```text
//! every 10 ms two groups, 20 ms two, 50 ms four, 100 ms six, 1 s six with DM1; every 5 s a BAM of 6 packets,
//! every 2 s an RTS/CTS transfer to another address; every 3 s a request
//! ```

use super::{CYCLE, Message, Random, START};

/// Priority, group, source and cycles between two messages; the groups have no meaning.
const GROUPS: [(u32, u32, u32, u64); 20] = [
    (3, 0xF004, 0x00, 1),
    (3, 0xF003, 0x00, 1),
    (3, 0xF005, 0x03, 2),
    (6, 0xF010, 0x0B, 2),
    (6, 0xF011, 0x0B, 5),
    (6, 0xFE5B, 0x0F, 5),
    (6, 0xFF20, 0x27, 5),
    (6, 0xFF21, 0x27, 5),
    (6, 0xFEF1, 0x00, 10),
    (6, 0xFEF2, 0x00, 10),
    (6, 0xFF22, 0x27, 10),
    (6, 0xFF23, 0x21, 10),
    (6, 0xFF24, 0x21, 10),
    (6, 0xFF25, 0x03, 10),
    (6, 0xFEEE, 0x00, 100),
    (6, 0xFEEF, 0x00, 100),
    (6, 0xFEF7, 0x21, 100),
    (6, 0xFEFC, 0x21, 100),
    (6, 0xFECA, 0x00, 100),
    (6, 0xFECA, 0x0B, 100),
];

/// Endless traffic.
pub struct Engine {
    random: Random,
    cycle: u64,
    queue: std::collections::VecDeque<Message>,
    speed: u16,
}

impl Engine {
    /// Creates traffic that depends on the seed only.
    pub fn new(seed: u64) -> Self {
        Self { random: Random(seed), cycle: 0, queue: std::collections::VecDeque::new(), speed: 6_400 }
    }

    fn push(&mut self, id: u32, payload: [u8; 8], length: u8) {
        // At 500 kbit/s a frame with 29 bits and eight bytes takes about 0.27 ms.
        let time = START + self.cycle * CYCLE + self.queue.len() as u64 * 270_000;
        self.queue.push_back(Message { time, id, extended: true, remote: false, length, data: payload });
    }

    fn cycle(&mut self) {
        self.cycle += 1;
        let dice = self.random.next();
        self.speed = self.speed.wrapping_add(u16::from(dice.to_le_bytes()[0] % 16));
        let [low, high] = self.speed.to_le_bytes();
        for (place, (priority, group, source, cycles)) in (0_u64..).zip(GROUPS) {
            if !(self.cycle + place).is_multiple_of(cycles) {
                continue;
            }
            // Fast groups change in each message, slow ones rarely, DM1 never.
            let data = match cycles {
                1 | 2 => [0xF0, dice.to_le_bytes()[1], 0x7D, low, high, 0, 0xFF, 0xFF],
                100 if group == 0xFECA => [0, 0xFF, 0, 0, 0, 0, 0xFF, 0xFF],
                _ => [self.cycle.to_le_bytes()[1], 0xFF, 0x10, 0x27, 0xFF, 0xFF, 0xFF, 0xFF],
            };
            self.push(priority << 26 | group << 8 | source, data, 8);
        }
        if self.cycle.is_multiple_of(500) {
            self.push(0x1CEC_FF00, [32, 39, 0, 6, 0xFF, 0xE3, 0xFE, 0], 8);
            (1..=6).for_each(|number| self.push(0x1CEB_FF00, [number, 1, 2, 3, 4, 5, 6, 7], 8));
        }
        if self.cycle.is_multiple_of(200) {
            self.push(0x1CEC_2100, [16, 20, 0, 3, 0xFF, 0xCB, 0xFE, 0], 8);
            self.push(0x1CEC_0021, [17, 3, 1, 0xFF, 0xFF, 0xCB, 0xFE, 0], 8);
            (1..=3).for_each(|number| self.push(0x1CEB_2100, [number, 1, 2, 3, 4, 5, 6, 7], 8));
            self.push(0x1CEC_0021, [19, 20, 0, 3, 0xFF, 0xCB, 0xFE, 0], 8);
        }
        if self.cycle.is_multiple_of(300) {
            self.push(0x18EA_0021, [0xEB, 0xFE, 0, 0, 0, 0, 0, 0], 3);
        }
    }
}

impl Iterator for Engine {
    type Item = Message;

    fn next(&mut self) -> Option<Message> {
        while self.queue.is_empty() {
            self.cycle();
        }
        self.queue.pop_front()
    }
}
