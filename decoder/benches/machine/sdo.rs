//! SDO transfers (CiA 301 §7.2.4): frames of client and server.

use std::collections::VecDeque;

use super::Message;

/// Maximum number of segments in a block.
const BLOCK: usize = 32;

/// Frames of queued transfers, one transfer after the other.
#[derive(Default)]
pub(super) struct Transfers {
    frames: VecDeque<Message>,
    count: u64,
}

/// Both COB-IDs of a node's channel, and the object's address as in a command.
#[derive(Clone, Copy)]
struct Object {
    request: u16,
    response: u16,
    address: [u8; 3],
}

impl Transfers {
    /// Whether another transfer may begin.
    pub(super) fn is_idle(&self) -> bool {
        self.frames.is_empty()
    }

    /// The next frame.
    pub(super) fn next(&mut self) -> Option<Message> {
        self.frames.pop_front()
    }

    /// Queues the configuration that the NMT master writes before it starts a node.
    pub(super) fn configure(&mut self, node: u16, mapping: bool) {
        // Device type I/O (CiA 401): a drive would be decoded with its profile, at higher cost.
        self.upload(object(node, 0x1000, 0), &[0x91, 0x01, 0x0F, 0x00]);
        self.upload_segments(object(node, 0x1008, 0), b"Servo drive, axis controller");
        if !mapping {
            return;
        }
        let maps: [(u16, &[u32]); 6] = [
            (0x1A00, &[0x6041_0010, 0x6064_0020, 0x606C_0010]),
            (0x1A01, &[0x6077_0010, 0x60FD_0010]),
            (0x1A02, &[0x2100_0110, 0x2100_0210]),
            (0x1A03, &[0x60FD_0020, 0x2100_0110, 0x2100_0310]),
            (0x1600, &[0x6040_0010, 0x607A_0020]),
            (0x1601, &[0x60FF_0020]),
        ];
        for (index, entries) in maps {
            self.download(object(node, index, 0), &[0]);
            for (sub, entry) in (1..).zip(entries) {
                self.download(object(node, index, sub), &entry.to_le_bytes());
            }
            self.download(object(node, index, 0), &[u8::try_from(entries.len()).unwrap_or(0)]);
        }
    }

    /// Begins a transfer; `kind`, below 64, selects its type, mostly expedited.
    pub(super) fn begin(&mut self, node: u16, kind: u64, storm: bool) {
        self.count += 1;
        let bytes: Vec<u8> =
            (0..300_u16).map(|index| index.to_le_bytes()[0] ^ kind.to_le_bytes()[0]).collect();
        if storm && self.count.is_multiple_of(2) || kind == 63 {
            return self.abort(object(node, 0x2000 + node, 1));
        }
        match kind {
            0..20 => self.upload(object(node, 0x6041, 0), &[0x27, 0x06]),
            20..40 => self.upload(object(node, 0x1001, 0), &[0]),
            40..54 => self.download(object(node, 0x6081, 0), &[kind.to_le_bytes()[0], 1, 0, 0]),
            54..57 => self.upload_segments(object(node, 0x1008, 0), b"Servo drive, axis controller"),
            57..60 => self.download_segments(object(node, 0x2000, 2), b"recipe 17: slow start"),
            60 => self.upload_blocks(object(node, 0x1021, 0), &bytes),
            _ => self.download_blocks(object(node, 0x1F50, 1), &bytes),
        }
    }

    fn client(&mut self, object: Object, payload: &[u8]) {
        self.frames.push_back(padded(object.request, payload));
    }

    fn server(&mut self, object: Object, payload: &[u8]) {
        self.frames.push_back(padded(object.response, payload));
    }

    fn upload(&mut self, object: Object, data: &[u8]) {
        let unused = 4_u8.saturating_sub(length(data));
        self.client(object, &command(0x40, object, &[]));
        self.server(object, &command(0x43 | unused << 2, object, data));
    }

    fn download(&mut self, object: Object, data: &[u8]) {
        let unused = 4_u8.saturating_sub(length(data));
        self.client(object, &command(0x23 | unused << 2, object, data));
        self.server(object, &command(0x60, object, &[]));
    }

    fn abort(&mut self, object: Object) {
        self.client(object, &command(0x40, object, &[]));
        self.server(object, &command(0x80, object, &0x0602_0000_u32.to_le_bytes()));
    }

    fn upload_segments(&mut self, object: Object, data: &[u8]) {
        self.client(object, &command(0x40, object, &[]));
        self.server(object, &command(0x41, object, &size(data)));
        for (toggle, segment, last) in segments(data) {
            self.client(object, &[0x60 | toggle << 4]);
            let head = toggle << 4 | (7 - length(segment)) << 1 | u8::from(last);
            self.server(object, &[&[head], segment].concat());
        }
    }

    fn download_segments(&mut self, object: Object, data: &[u8]) {
        self.client(object, &command(0x21, object, &size(data)));
        self.server(object, &command(0x60, object, &[]));
        for (toggle, segment, last) in segments(data) {
            let head = toggle << 4 | (7 - length(segment)) << 1 | u8::from(last);
            self.client(object, &[&[head], segment].concat());
            self.server(object, &[0x20 | toggle << 4]);
        }
    }

    fn upload_blocks(&mut self, object: Object, data: &[u8]) {
        let most = u8::try_from(BLOCK).unwrap_or(127);
        self.client(object, &command(0xA4, object, &[most, 0]));
        self.server(object, &command(0xC6, object, &size(data)));
        self.client(object, &[0xA3]);
        self.blocks(object.response, object.request, data, most);
        self.server(object, &block_end(data));
        self.client(object, &[0xA1]);
    }

    fn download_blocks(&mut self, object: Object, data: &[u8]) {
        let most = u8::try_from(BLOCK).unwrap_or(127);
        self.client(object, &command(0xC6, object, &size(data)));
        self.server(object, &command(0xA4, object, &[most]));
        self.blocks(object.request, object.response, data, most);
        self.client(object, &block_end(data));
        self.server(object, &[0xA1]);
    }

    fn blocks(&mut self, sender: u16, receiver: u16, data: &[u8], most: u8) {
        let total = data.len().div_ceil(7 * BLOCK);
        for (number, block) in data.chunks(7 * BLOCK).enumerate() {
            let segments = block.chunks(7);
            let count = u8::try_from(segments.len()).unwrap_or(0);
            for (sequence, segment) in (1..).zip(segments) {
                let last = number + 1 == total && sequence == count;
                let head = sequence | u8::from(last) << 7;
                self.frames.push_back(padded(sender, &[&[head], segment].concat()));
            }
            self.frames.push_back(padded(receiver, &[0xA2, count, most]));
        }
    }
}

fn object(node: u16, index: u16, sub: u8) -> Object {
    let [low, high] = index.to_le_bytes();
    Object { request: 0x600 + node, response: 0x580 + node, address: [low, high, sub] }
}

fn padded(id: u16, payload: &[u8]) -> Message {
    Message { length: 8, ..Message::new(id, payload) }
}

fn command(head: u8, object: Object, data: &[u8]) -> Vec<u8> {
    [&[head], object.address.as_slice(), data].concat()
}

fn length(data: &[u8]) -> u8 {
    u8::try_from(data.len()).unwrap_or(0)
}

fn size(data: &[u8]) -> [u8; 4] {
    u32::try_from(data.len()).unwrap_or(0).to_le_bytes()
}

/// Splits data into segments: toggle bit, data, and whether it is the last segment.
fn segments(data: &[u8]) -> impl Iterator<Item = (u8, &[u8], bool)> {
    let count = data.len().div_ceil(7);
    data.chunks(7)
        .enumerate()
        .map(move |(index, segment)| (u8::from(index % 2 == 1), segment, index + 1 == count))
}

fn block_end(data: &[u8]) -> [u8; 3] {
    let in_last = (data.len() + 6) % 7 + 1;
    let unused = u8::try_from(7 - in_last).unwrap_or(0);
    let [low, high] = crc(data).to_le_bytes();
    [0xC1 | unused << 2, low, high]
}

/// CRC of block transfers: polynomial 0x1021 from 0 (CiA 301 §7.2.4.3.16).
fn crc(data: &[u8]) -> u16 {
    data.iter().fold(0, |crc, byte| {
        (0..8).fold(
            crc ^ u16::from(*byte) << 8,
            |crc, _| {
                if crc & 0x8000 == 0 { crc << 1 } else { crc << 1 ^ 0x1021 }
            },
        )
    })
}
