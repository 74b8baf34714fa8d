//! Traffic of a machine of eight CANopen nodes that depends on the seed only.
//!
//! ```text
//! NMT reset, boot-up, configuration by SDO, NMT start, then every 10 ms:
//!   SYNC, TPDO1..4 (every 1st, 2nd, 5th, 10th SYNC), RPDO1..2; in addition
//!   heartbeats (100 ms to 1 s), guarding (two nodes), SDO transfers of all types, EMCY, TIME
//! ```

pub mod devices;
pub mod engine;
#[allow(dead_code, reason = "captures for benchmarks have no faults")]
pub mod faults;
pub mod formats;
mod sdo;

use std::collections::VecDeque;

use sdo::Transfers;

/// Start of the capture, in nanoseconds since 1970.
const START: u64 = 1_700_000_000_000_000_000;

/// Nanoseconds between two SYNC messages.
const CYCLE: u64 = 10_000_000;

/// Typical error codes of drives, and their error registers.
const ERRORS: [(u16, u8); 6] =
    [(0x2310, 0x03), (0x3210, 0x05), (0x4210, 0x09), (0x7121, 0x21), (0x8611, 0x21), (0x8130, 0x11)];

/// Options of the traffic.
#[derive(Debug, Clone, Copy)]
pub struct Options {
    /// Seed of the pseudo-random numbers.
    pub seed: u64,
    /// Whether every second SDO transfer is aborted and every tenth frame is an EMCY.
    pub storm: bool,
    /// Whether the SDO configuration includes the PDO mappings, so that signals can be decoded.
    pub mapping: bool,
}

/// One frame.
#[derive(Debug, Clone, Copy, Default)]
pub struct Message {
    /// Time in nanoseconds since 1970, in whole microseconds.
    pub time: u64,
    /// Identifier.
    pub id: u32,
    /// Whether the identifier has 29 bits.
    pub extended: bool,
    /// Whether the frame is a remote frame.
    pub remote: bool,
    /// Number of data bytes; of a remote frame the number requested.
    pub length: u8,
    /// Data bytes; those after `length` are unused.
    pub data: [u8; 8],
}

impl Message {
    fn new(id: u16, payload: &[u8]) -> Self {
        let mut message = Self { id: id.into(), ..Self::default() };
        for (target, byte) in message.data.iter_mut().zip(payload) {
            *target = *byte;
            message.length += 1;
        }
        message
    }

    /// The data; empty for a remote frame.
    pub fn payload(&self) -> &[u8] {
        let length = if self.remote { 0 } else { usize::from(self.length) };
        self.data.get(..length).unwrap_or(&self.data)
    }
}

/// Generator of small pseudo-random numbers (`SplitMix64`).
struct Random(u64);

impl Random {
    fn next(&mut self) -> u64 {
        self.0 = self.0.wrapping_add(0x9E37_79B9_7F4A_7C15);
        let mixed = (self.0 ^ self.0 >> 30).wrapping_mul(0xBF58_476D_1CE4_E5B9);
        let mixed = (mixed ^ mixed >> 27).wrapping_mul(0x94D0_49BB_1331_11EB);
        mixed ^ mixed >> 31
    }

    fn below(&mut self, limit: u64) -> u64 {
        self.next() % limit
    }
}

/// Process values of a node.
struct Node {
    id: u16,
    /// Cycles between heartbeats; 0 means guarding instead.
    heartbeat: u64,
    position: i32,
    velocity: i16,
    torque: i16,
    temperature: u16,
    inputs: u16,
    toggle: bool,
    error: Option<u64>,
}

/// Endless traffic.
pub struct Machine {
    options: Options,
    random: Random,
    nodes: Vec<Node>,
    transfers: Transfers,
    cycle: u64,
    now: u64,
    count: u64,
    ready: VecDeque<Message>,
}

impl Machine {
    /// A machine before power-on.
    pub fn new(options: Options) -> Self {
        let heartbeats = [10, 10, 20, 50, 50, 100, 0, 0];
        let nodes = (1..).zip(heartbeats).map(|(id, heartbeat)| Node {
            id,
            heartbeat,
            position: i32::from(id.cast_signed()) * 10_000,
            velocity: 0,
            torque: 0,
            temperature: 350,
            inputs: 0x0010,
            toggle: false,
            error: None,
        });
        let mut machine = Self {
            options,
            random: Random(options.seed),
            nodes: nodes.collect(),
            transfers: Transfers::default(),
            cycle: 0,
            now: START,
            count: 0,
            ready: VecDeque::new(),
        };
        machine.switch_on();
        machine
    }

    /// Queues a message, with its transmission time at 1 Mbit/s.
    fn send(&mut self, mut message: Message) {
        let bits = 50 + 9 * u64::from(message.length) + self.random.below(20);
        self.now += bits * 1_000;
        message.time = self.now;
        self.ready.push_back(message);
        self.count += 1;
        if self.options.storm && self.count % 10 == 9 {
            self.storm_emergency();
        }
    }

    fn switch_on(&mut self) {
        self.send(Message::new(0x000, &[0x82, 0]));
        for index in 0..8 {
            self.now += 20_000_000;
            self.send(Message::new(0x701 + index, &[0]));
        }
        for index in 0..8 {
            self.transfers.configure(index + 1, self.options.mapping);
        }
        while let Some(message) = self.transfers.next() {
            self.now += 300_000;
            self.send(message);
        }
        self.send(Message::new(0x000, &[0x01, 0]));
        self.now += CYCLE;
    }

    fn cycle(&mut self) {
        let begin = self.now.next_multiple_of(CYCLE);
        self.now = begin + self.random.below(20) * 1_000;
        self.cycle += 1;
        self.send(Message::new(0x080, &[]));
        for index in 0..self.nodes.len() {
            self.process_data(index);
        }
        for index in 0..self.nodes.len() {
            self.error_control(index);
            self.emergency(index);
        }
        if self.cycle.is_multiple_of(2) && self.transfers.is_idle() {
            let (node, kind) = (self.random.below(8) + 1, self.random.below(64));
            self.transfers.begin(u16::try_from(node).unwrap_or(1), kind, self.options.storm);
        }
        for _ in 0..4 {
            let Some(message) = self.transfers.next() else { break };
            self.send(message);
        }
        if self.cycle.is_multiple_of(100) {
            // Milliseconds of the day and days since 1984, counted from START.
            let milliseconds = u32::try_from(80_000_000 + self.cycle * 10 % 6_400_000).unwrap_or(0);
            let [a, b, c, d] = milliseconds.to_le_bytes();
            let [low, high] = 14_562_u16.to_le_bytes();
            self.send(Message::new(0x100, &[a, b, c, d, low, high]));
        }
    }

    fn process_data(&mut self, index: usize) {
        let (cycle, dice) = (self.cycle, self.random.next());
        let Some(node) = self.nodes.get_mut(index) else { return };
        let id = node.id;
        // Half of the axes move at a time, for several seconds each.
        let moves = (cycle / 400 + u64::from(id)).is_multiple_of(2);
        node.velocity = if moves { 500 + i16::from(dice.to_le_bytes()[0] % 8) } else { 0 };
        node.position = node.position.wrapping_add(i32::from(node.velocity) / 10);
        if moves {
            node.torque = i16::from(dice.to_le_bytes()[1] % 64);
        }
        if dice.is_multiple_of(97) {
            node.temperature = 350 + u16::from(dice.to_le_bytes()[2] % 16);
        }
        if dice.is_multiple_of(151) {
            node.inputs ^= 1 << (dice >> 32 & 7);
        }
        let [p0, p1, p2, p3] = node.position.to_le_bytes();
        let [v0, v1] = node.velocity.to_le_bytes();
        let [q0, q1] = node.torque.to_le_bytes();
        let [t0, t1] = node.temperature.to_le_bytes();
        let [i0, i1] = node.inputs.to_le_bytes();
        let status = if moves { 0x27 } else { 0x37 };
        self.send(Message::new(0x180 + id, &[status, 0x06, p0, p1, p2, p3, v0, v1]));
        if cycle.is_multiple_of(2) {
            self.send(Message::new(0x280 + id, &[q0, q1, i0, i1]));
            self.send(Message::new(0x200 + id, &[0x0F, 0x00, p0, p1, p2, p3]));
        }
        if cycle % 5 == u64::from(id) % 5 {
            self.send(Message::new(0x380 + id, &[t0, t1, 0x30, 0x01]));
        }
        if cycle % 10 == u64::from(id) {
            self.send(Message::new(0x480 + id, &[i0, i1, 0, 0, t0, t1, 0, 0x80]));
            self.send(Message::new(0x300 + id, &[0x64, 0, 0, 0]));
        }
    }

    fn error_control(&mut self, index: usize) {
        let cycle = self.cycle;
        let Some(node) = self.nodes.get_mut(index) else { return };
        let id = 0x700 + node.id;
        if node.heartbeat != 0 {
            if (cycle + u64::from(node.id)).is_multiple_of(node.heartbeat) {
                self.send(Message::new(id, &[5]));
            }
        } else if (cycle + u64::from(node.id)).is_multiple_of(50) {
            let toggle = node.toggle;
            node.toggle = !toggle;
            self.send(Message { id: id.into(), remote: true, length: 1, ..Message::default() });
            self.send(Message::new(id, &[if toggle { 0x85 } else { 0x05 }]));
        }
    }

    /// Queues EMCY messages: about every 16 s an error occurs at one of the nodes; it is cleared after 3 s.
    fn emergency(&mut self, index: usize) {
        let (cycle, dice) = (self.cycle, self.random.next());
        let Some(node) = self.nodes.get_mut(index) else { return };
        let id = 0x080 + node.id;
        match node.error {
            Some(until) if cycle >= until => {
                node.error = None;
                self.send(Message::new(id, &[0, 0, 0, 0, 0, 0, 0, 0]));
            }
            None if dice.is_multiple_of(12_800) && !self.options.storm => {
                node.error = Some(cycle + 300);
                self.send(Message::new(id, &error_payload(dice >> 16)));
            }
            _ => {}
        }
    }

    fn storm_emergency(&mut self) {
        let dice = self.random.next();
        let id = 0x081 + u16::from(dice.to_le_bytes()[0] % 8);
        let payload = if (dice >> 8).is_multiple_of(4) { [0; 8] } else { error_payload(dice >> 16) };
        self.send(Message::new(id, &payload));
    }
}

fn error_payload(dice: u64) -> [u8; 8] {
    let place = usize::from(dice.to_le_bytes()[0]) % ERRORS.len();
    let (code, register) = ERRORS.get(place).copied().unwrap_or_default();
    let [low, high] = code.to_le_bytes();
    [low, high, register, dice.to_le_bytes()[1], 0, 0, 0, 0]
}

impl Iterator for Machine {
    type Item = Message;

    fn next(&mut self) -> Option<Message> {
        while self.ready.is_empty() {
            self.cycle();
        }
        self.ready.pop_front()
    }
}
