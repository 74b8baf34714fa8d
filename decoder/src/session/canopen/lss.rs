//! LSS: devices get their node-ID and bit rate.

use crate::event::EventKind;
use crate::frame::Frame;
use crate::profile;
use crate::session::device::Announcement;
use crate::session::{Bus, Observer};
use crate::wire::NodeId;
use crate::wire::canopen::ObjectAddress;
use crate::wire::canopen::lss::{self, Content};

/// What is known of the LSS exchange.
#[derive(Debug, Clone, Default)]
pub(in crate::session) struct LssState {
    /// Node-ID asked for, until the slave accepts it.
    requested: Option<u8>,
    /// Node-ID accepted, and the one before if it was inquired: in force from the next boot-up on.
    accepted: Option<(Option<u8>, u8)>,
    /// Node-ID the slave answered to an inquiry: its present one.
    present: Option<u8>,
    /// A fast scan runs; its steps repeat.
    scanning: bool,
    /// Command of the master's last message.
    asked: Option<u8>,
    /// Bit rate asked for and accepted, in kbit/s.
    bit_rate: BitRate,
    /// Numbers of switch state selective, so far.
    address: [Option<u32>; 4],
}

/// Configure bit timing parameters (CiA 305 §3.9.3.2).
const BIT_TIMING: u8 = 0x13;

/// First of the four numbers of switch state selective, and its answer (CiA 305 §3.9.2.1).
const SELECTIVE: u8 = 0x40;
const SELECTED: u8 = 0x44;

#[derive(Debug, Clone, Copy, Default)]
struct BitRate {
    asked: Option<u32>,
    accepted: Option<u32>,
}

impl LssState {
    /// The change of node-ID that was accepted, if it leads to `id`: from, to.
    pub(in crate::session) fn take_accepted(&mut self, id: u8) -> Option<(Option<u8>, u8)> {
        self.accepted.take_if(|(_, to)| *to == id)
    }
}

impl Bus {
    pub(in crate::session) fn on_lss(&mut self, from_master: bool, frame: &Frame, out: &mut dyn Observer) {
        self.weigh_lss(from_master, frame);
        if !self.is_decoded(frame, out) {
            return;
        }
        let message = match lss::parse(frame.data(), from_master) {
            Ok(message) => message,
            Err(error) => return self.malformed(frame, None, error, "too short for its LSS command", out),
        };
        let is_scan_step = matches!(message.content, Content::FastScan { .. });
        let routine = if from_master {
            std::mem::replace(&mut self.lss.scanning, is_scan_step) && is_scan_step
        } else {
            self.lss.scanning
        };
        let kind = EventKind::Lss { command: message.command, from_master, content: message.content };
        self.emit(frame, None, routine, kind, out);
        self.follow_node_id(message, from_master, frame, out);
        self.follow_bit_rate(message, from_master, frame, out);
    }

    /// What the bus goes to when the master activates what it configured (CiA 305 §3.9.3.2).
    fn follow_bit_rate(
        &mut self,
        message: lss::Lss,
        from_master: bool,
        frame: &Frame,
        out: &mut dyn Observer,
    ) {
        match (message.content, from_master) {
            (Content::BitTiming { table: 0, entry }, true) => {
                self.lss.bit_rate.asked = profile::lss().bit_rate(entry);
            }
            (Content::Result { code: 0, .. }, false) if message.command == BIT_TIMING => {
                self.lss.bit_rate.accepted = self.lss.bit_rate.asked.take();
            }
            (Content::Delay(delay), true) => {
                if let Some(rate) = self.lss.bit_rate.accepted.take() {
                    // Silence for the delay before the switch, and for the delay again after it.
                    let text =
                        format!("bus goes to {rate} kbit/s after {delay} ms, no frame for {delay} ms more");
                    let change =
                        Announcement { procedure: "bit-rate change", word: "RATE", finished: false, text };
                    self.announce(None, change, frame, out);
                }
            }
            _ => {}
        }
    }

    /// An answer that fits the question is evidence of CANopen. Cars use these identifiers for UDS, whose
    /// first bytes are small, so only the commands from 0x40 on count.
    fn weigh_lss(&mut self, from_master: bool, frame: &Frame) {
        let command = frame.data().first().copied().filter(|_| frame.length == 8);
        if from_master {
            self.lss.asked = command;
            return;
        }
        let fits = match (self.lss.asked, command) {
            (Some(0x43), Some(0x44)) | (Some(0x4B | 0x51), Some(0x4F)) | (Some(0x4C), Some(0x50)) => true,
            (Some(asked @ 0x5A..=0x5E), Some(answer)) => asked == answer,
            _ => false,
        };
        if fits {
            self.belief.support();
        }
    }

    /// The node that said these numbers of itself (1018): all that are known must fit, the serial number
    /// must be known.
    fn node_of_address(&self, address: [Option<u32>; 4]) -> Option<u8> {
        let mut fitting = self.nodes().filter(|node| {
            let told = |sub: u8| node.store().number(ObjectAddress::new(0x1018, sub));
            let same =
                |(sub, number): (u8, Option<u32>)| told(sub).is_none() || told(sub) == number.map(u64::from);
            told(4).is_some() && (1..).zip(address).all(same)
        });
        fitting.next().and_then(|node| node.id().canopen()).filter(|_| fitting.next().is_none())
    }

    /// Remembers a node-ID that is inquired, asked for, accepted.
    fn follow_node_id(
        &mut self,
        message: lss::Lss,
        from_master: bool,
        frame: &Frame,
        out: &mut dyn Observer,
    ) {
        match (message.content, from_master) {
            (Content::Number(number), true) => {
                if let Some(slot) = message
                    .command
                    .checked_sub(SELECTIVE)
                    .and_then(|at| self.lss.address.get_mut(usize::from(at)))
                {
                    *slot = Some(number);
                }
            }
            (Content::Nothing, false) if message.command == SELECTED => {
                self.lss.present = self.node_of_address(self.lss.address);
            }
            (Content::Mode(_), true) => self.lss.address = [None; 4],
            (Content::NodeId(id), true) => self.lss.requested = Some(id),
            (Content::NodeId(id), false) => self.lss.present = Some(id),
            (Content::Result { code: 0, .. }, false) if message.command == 0x11 => {
                // One that has none says so (255); other numbers are no node-IDs (CiA 305: 1 to 127, 255).
                let from = self.lss.present.take().filter(|id| (1..=127).contains(id));
                let to = self.lss.requested.take().filter(|to| (1..=127).contains(to));
                self.lss.accepted = to.filter(|to| from != Some(*to)).map(|to| (from, to));
                if let Some((from, to)) = self.lss.accepted {
                    let text = format!("node-ID {to} after its next start");
                    let change =
                        Announcement { procedure: "node-ID change", word: "IDENT", finished: false, text };
                    self.announce(from.map(NodeId::Canopen), change, frame, out);
                }
            }
            _ => {}
        }
    }
}
