//! A gs_usb adapter for tests, as a device of USB/IP: the kernel's `vhci_hcd` makes a USB device of it.
//!
//! USB/IP: Linux, Documentation/usb/usbip_protocol.rst. gs_usb: Linux, drivers/net/can/usb/gs_usb.c. That driver is also the
//! judge of this simulation: it must be able to use it.

use std::collections::VecDeque;
use std::io::{self, Read, Write};

use crate::SimulatedAdapter;
use crate::scenario::{QueueItem, Scenario};

/// Number of bus and device in USB/IP.
pub const DEVICE: u32 = 0x0001_0002;
/// Serial number of the adapter.
pub const SERIAL: &str = "0042001A";
/// Product of the adapter.
pub const PRODUCT: &str = "candleLight USB to CAN adapter";

// Commands of USB/IP and their answers.
const SUBMIT: u32 = 1;
const UNLINK: u32 = 2;
const SUBMITTED: u32 = 3;
const UNLINKED: u32 = 4;
/// Length of the header of each of them.
const HEADER: usize = 48;

/// Error numbers of Linux, negative.
const STALL: i32 = -32;
const UNLINK_DONE: i32 = -104;

/// Device (USB 2.0, 9.6.1): 1D50:606F, product and serial number as texts 2 and 3.
const DEVICE_DESCRIPTOR: [u8; 18] = [18, 1, 0, 2, 0, 0, 0, 64, 0x50, 0x1D, 0x6F, 0x60, 0, 0, 1, 2, 3, 1];
/// Configuration with one interface and the bulk endpoints 81 and 02 of 64 bytes.
const CONFIGURATION: [u8; 32] = [
    9, 2, 32, 0, 1, 1, 0, 0x80, 50, //
    9, 4, 0, 0, 2, 0xFF, 0xFF, 0xFF, 0, //
    7, 5, 0x81, 2, 64, 0, 0, //
    7, 5, 0x02, 2, 64, 0, 0,
];

// Requests (`GS_USB_BREQ_…`).
const BYTE_ORDER: u8 = 0;
const TIMING: u8 = 1;
const MODE: u8 = 2;
const CONSTANTS: u8 = 4;
const CONFIG: u8 = 5;
const STATE: u8 = 14;

/// Listen-only mode, timestamps, bus errors, state.
const FEATURES: u32 = 1 | 1 << 4 | 1 << 12 | 1 << 13;
const OVERFLOW: u8 = 1;

/// The simulated adapter; it keeps its state while it is unplugged.
pub struct GsUsbDevice {
    adapter: SimulatedAdapter,
    /// Sequence numbers of the reads that wait for frames.
    reads: VecDeque<u32>,
    is_overrun: bool,
    has_reported_bus_off: bool,
}

/// A command of USB/IP.
struct SubmittedCommand {
    sequence: u32,
    is_in: bool,
    endpoint: u32,
    length: u32,
    setup: [u8; 8],
}

fn read_word(bytes: &[u8], index: usize) -> u32 {
    let (words, _) = bytes.as_chunks::<4>();
    words.get(index).copied().map_or(0, u32::from_be_bytes)
}

impl GsUsbDevice {
    /// An adapter with a scenario, as `frames=100,listen=refuse`.
    pub fn new(scenario: &str) -> Self {
        Self {
            adapter: SimulatedAdapter::new(Scenario::parse(scenario)),
            reads: VecDeque::new(),
            is_overrun: false,
            has_reported_bus_off: false,
        }
    }

    /// Commands so far: modes and bit timings.
    pub fn calls(&self) -> &[String] {
        &self.adapter.calls
    }

    /// Answers the kernel until one of them ends the connection: the kernel, or the scenario by unplugging.
    ///
    /// # Errors
    /// The connection fails.
    pub fn serve_kernel(&mut self, mut stream: impl Read + Write) -> io::Result<()> {
        self.reads.clear();
        let mut header = [0; HEADER];
        loop {
            match stream.read_exact(&mut header) {
                Err(error) if error.kind() == io::ErrorKind::UnexpectedEof => return Ok(()),
                result => result?,
            }
            let sequence = read_word(&header, 1);
            match read_word(&header, 0) {
                SUBMIT => {
                    let mut setup = [0; 8];
                    setup.iter_mut().zip(header.iter().skip(40)).for_each(|(to, from)| *to = *from);
                    let (is_in, endpoint, length) =
                        (read_word(&header, 3) == 1, read_word(&header, 4), read_word(&header, 6));
                    self.on_submit(
                        &mut stream,
                        &SubmittedCommand { sequence, is_in, endpoint, length, setup },
                    )?;
                }
                UNLINK => {
                    let wanted = read_word(&header, 5);
                    let before = self.reads.len();
                    self.reads.retain(|read| *read != wanted);
                    let status = if self.reads.len() < before { UNLINK_DONE } else { 0 };
                    write_answer(&mut stream, UNLINKED, sequence, status, 0, &[])?;
                }
                _ => return Err(io::ErrorKind::InvalidData.into()),
            }
            if !self.play_items(&mut stream)? {
                return Ok(());
            }
        }
    }

    fn on_submit(&mut self, stream: &mut (impl Read + Write), command: &SubmittedCommand) -> io::Result<()> {
        let mut data = Vec::new();
        if !command.is_in {
            stream.take(command.length.into()).read_to_end(&mut data)?;
        }
        match (command.endpoint, command.is_in) {
            (0, true) => match self.answer_question(command.setup) {
                Some(mut data) => {
                    data.truncate(usize::try_from(command.length).unwrap_or(usize::MAX));
                    write_answer(stream, SUBMITTED, command.sequence, 0, data.len(), &data)
                }
                None => write_answer(stream, SUBMITTED, command.sequence, STALL, 0, &[]),
            },
            (0, false) => {
                let status = if self.carry_out(command.setup, &data) { 0 } else { STALL };
                write_answer(stream, SUBMITTED, command.sequence, status, data.len(), &[])
            }
            (1, true) => {
                self.reads.push_back(command.sequence);
                Ok(())
            }
            _ => {
                self.adapter.record_call(&format!("transmitted {data:02X?}"));
                write_answer(stream, SUBMITTED, command.sequence, 0, data.len(), &[])
            }
        }
    }

    fn answer_question(&self, setup: [u8; 8]) -> Option<Vec<u8>> {
        let [kind, request, index, value, ..] = setup;
        let words = |words: &[u32]| Some(words.iter().flat_map(|word| word.to_le_bytes()).collect());
        match (kind, request) {
            (0x80, 6) => usb_descriptor(value, index),
            (0x80..=0x82, 0) => Some(vec![0, 0]),
            (0x80, 8) => Some(vec![1]),
            (0xC1, CONFIG) => words(&[0, 2, 1]),
            (0xC1, CONSTANTS) => {
                let features = if self.adapter.scenario.is_light { FEATURES & !1 } else { FEATURES };
                words(&[features, 48_000_000, 1, 16, 1, 8, 4, 1, 1_024, 1])
            }
            (0xC1, STATE) if self.adapter.is_bus_off() => words(&[3, 0, 248]),
            (0xC1, STATE) => words(&[0, 0, 0]),
            _ => None,
        }
    }

    fn carry_out(&mut self, setup: [u8; 8], data: &[u8]) -> bool {
        let [kind, request, ..] = setup;
        let words: Vec<u32> = data.as_chunks::<4>().0.iter().map(|word| u32::from_le_bytes(*word)).collect();
        match (kind, request, &words[..]) {
            // Configuration, interface, cleared halt.
            (0x00, 9, _) | (0x01, 11, _) | (0x02, 1, _) | (0x41, BYTE_ORDER, _) => true,
            (0x41, TIMING, [propagation, phase_1, phase_2, _, prescaler]) => {
                let quanta = 1 + propagation + phase_1 + phase_2;
                let bit_rate = 48_000_000 / (quanta * prescaler).max(1);
                self.adapter.record_call(&format!("bit rate {bit_rate}"));
                true
            }
            (0x41, MODE, [0, _]) => {
                self.adapter.is_on_bus = false;
                self.adapter.record_call("off the bus");
                true
            }
            (0x41, MODE, [1, flags]) => {
                self.adapter.is_listen_only = flags & 1 != 0;
                self.adapter.go_on_bus();
                true
            }
            _ => false,
        }
    }

    /// Answers waiting reads with the items of the scenario; false once the adapter is unplugged.
    fn play_items(&mut self, stream: &mut impl Write) -> io::Result<bool> {
        while self.adapter.is_on_bus && !self.reads.is_empty() {
            let number = self.adapter.next;
            if self.adapter.is_bus_off() && !self.has_reported_bus_off {
                self.has_reported_bus_off = true;
                let bytes = self.host_frame(0x2000_0040, 8, [0; 8], number);
                self.answer_transfer(stream, &bytes)?;
                continue;
            }
            let bytes = match self.adapter.next_item() {
                QueueItem::Unplugged => return Ok(false),
                QueueItem::Empty if number >= self.adapter.scenario.frames => return Ok(true),
                QueueItem::Empty => continue,
                QueueItem::Overrun => {
                    self.is_overrun = true;
                    continue;
                }
                QueueItem::Invalid => self.host_frame(0x181, 200, [0; 8], number),
                QueueItem::Error(number) => self.host_frame(0x2000_0088, 8, [0, 0, 4, 0, 0, 0, 0, 0], number),
                QueueItem::Frame(number) => self.host_frame(0x181, 8, number.to_le_bytes(), number),
            };
            self.answer_transfer(stream, &bytes)?;
        }
        Ok(true)
    }

    /// `gs_host_frame` with its timestamp.
    fn host_frame(&mut self, id: u32, length: u8, data: [u8; 8], number: u64) -> Vec<u8> {
        let flags = if std::mem::take(&mut self.is_overrun) { OVERFLOW } else { 0 };
        let stamp = self.adapter.frame_time(number) & u64::from(u32::MAX);
        let mut bytes = u32::MAX.to_le_bytes().to_vec();
        bytes.extend(id.to_le_bytes());
        bytes.extend([length, 0, flags, 0]);
        bytes.extend(data);
        bytes.extend(stamp.to_le_bytes().iter().take(4));
        bytes
    }

    fn answer_transfer(&mut self, stream: &mut impl Write, bytes: &[u8]) -> io::Result<()> {
        match self.reads.pop_front() {
            Some(read) => write_answer(stream, SUBMITTED, read, 0, bytes.len(), bytes),
            None => Ok(()),
        }
    }
}

fn usb_descriptor(kind: u8, index: u8) -> Option<Vec<u8>> {
    match (kind, index) {
        (1, 0) => Some(DEVICE_DESCRIPTOR.to_vec()),
        (2, 0) => Some(CONFIGURATION.to_vec()),
        // The languages of texts: English.
        (3, 0) => Some(vec![4, 3, 9, 4]),
        (3, 1) => Some(text_descriptor("bytewerk")),
        (3, 2) => Some(text_descriptor(PRODUCT)),
        (3, 3) => Some(text_descriptor(SERIAL)),
        _ => None,
    }
}

fn text_descriptor(text: &str) -> Vec<u8> {
    let units: Vec<u8> = text.encode_utf16().flat_map(u16::to_le_bytes).collect();
    let length = u8::try_from(units.len() + 2).unwrap_or(u8::MAX);
    [vec![length, 3], units].concat()
}

/// Writes an answer with its data; `length` is the number of bytes transferred in either direction.
fn write_answer(
    stream: &mut impl Write,
    command: u32,
    sequence: u32,
    status: i32,
    length: usize,
    data: &[u8],
) -> io::Result<()> {
    let length = u32::try_from(length).unwrap_or(u32::MAX);
    let mut bytes: Vec<u8> = [command, sequence, 0, 0, 0].into_iter().flat_map(u32::to_be_bytes).collect();
    bytes.extend(status.to_be_bytes());
    bytes.extend(length.to_be_bytes());
    bytes.resize(HEADER, 0);
    bytes.extend(data);
    stream.write_all(&bytes)
}
