//! Traffic of a hydraulic machine whose devices have profiles: a pump (SYDFEC, node 2), a valve with flow
//! and pressure control (IAC-P, node 5), an amplifier (MD2, node 1), an actuator (PVEA, node 32).
//!
//! ```text
//! boot-up, start, then every 10 ms: SYNC, one RPDO and one TPDO per node; set points change every second,
//! measured values in each frame; states change occasionally
//! ```

use super::{CYCLE, Message, Random, START};

/// Profile of each node.
pub const DEVICES: [(u8, &str); 4] =
    [(2, "rexroth-sydfec"), (5, "rexroth-ifb-iac"), (1, "wandfluh-md2"), (32, "danfoss-pve-ci")];

/// Cycles between two changes of the set points.
const STEP: u64 = 100;

/// Endless traffic.
pub struct Devices {
    random: Random,
    cycle: u64,
    queue: std::collections::VecDeque<Message>,
    set: [i16; 4],
}

impl Devices {
    /// Creates traffic that depends on the seed only.
    pub fn new(seed: u64) -> Self {
        let mut devices =
            Self { random: Random(seed), cycle: 0, queue: std::collections::VecDeque::new(), set: [0; 4] };
        devices.begin();
        devices
    }

    fn push(&mut self, id: u16, payload: &[u8]) {
        let time = START + self.cycle * CYCLE + self.queue.len() as u64 * 200_000;
        self.queue.push_back(Message { time, ..Message::new(id, payload) });
    }

    /// Queues the boot-ups, the modes that determine the PDO layouts, and the NMT start.
    fn begin(&mut self) {
        for node in [1, 5, 32] {
            self.push(0x700 + node, &[0]);
        }
        self.push(0x082, &[]);
        // 5208:02 = 250 bar, 6043:00 = -3 (pQ), 6043:00 = 1 (spool position).
        let reads: [(u16, [u8; 8], [u8; 8]); 3] = [
            (2, [0x40, 0x08, 0x52, 2, 0, 0, 0, 0], [0x4B, 0x08, 0x52, 2, 0xFA, 0, 0, 0]),
            (5, [0x40, 0x43, 0x60, 0, 0, 0, 0, 0], [0x4F, 0x43, 0x60, 0, 0xFD, 0, 0, 0]),
            (1, [0x40, 0x43, 0x60, 0, 0, 0, 0, 0], [0x4F, 0x43, 0x60, 0, 1, 0, 0, 0]),
        ];
        for (node, request, answer) in reads {
            self.push(0x600 + node, &request);
            self.push(0x580 + node, &answer);
        }
        self.push(0x000, &[1, 0]);
    }

    fn cycle(&mut self) {
        self.cycle += 1;
        if self.cycle.is_multiple_of(STEP) {
            for place in 0..self.set.len() {
                let value = i16::try_from(self.random.below(8192)).unwrap_or(0);
                if let Some(set) = self.set.get_mut(place) {
                    *set = value;
                }
            }
        }
        let active = self.cycle % (20 * STEP) > 4;
        let (control, status) = if active { (0x0F, 0x0F) } else { (0x01, 0x09) };
        let noise = |random: &mut Random, set: i16| {
            set.saturating_add(i16::try_from(random.below(64)).unwrap_or(0) - 32).to_le_bytes()
        };
        let [pump, flow, amplifier, spool] = self.set;
        let measured = [pump, flow, amplifier, spool].map(|set| noise(&mut self.random, set));
        let ([p0, p1], [f0, f1], [a0, a1], [s0, s1]) =
            (pump.to_le_bytes(), flow.to_le_bytes(), amplifier.to_le_bytes(), spool.to_le_bytes());
        let [[mp0, mp1], [mf0, mf1], _, [ms0, ms1]] = measured;
        self.push(0x080, &[]);
        self.push(0x202, &[0x08, p0, p1, p0, p1]);
        self.push(0x182, &[0x08, mp0, mp1, mp0, mp1]);
        self.push(0x205, &[control, 0, f0, f1 & 7, 0xDC, 5]);
        self.push(0x185, &[status, 1, mf0, mf1 & 7, 0xD8, 5]);
        self.push(0x201, &[control, 0, a0, a1]);
        self.push(0x181, &[status, 0]);
        self.push(0x220, &[control, 0, s0, s1]);
        self.push(0x1A0, &[status, 0, ms0, ms1]);
    }
}

impl Iterator for Devices {
    type Item = Message;

    fn next(&mut self) -> Option<Message> {
        if self.queue.is_empty() {
            self.cycle();
        }
        self.queue.pop_front()
    }
}
