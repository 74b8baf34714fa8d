//! LSS: devices get their node-ID and bit rate.

use crate::event::EventKind;
use crate::frame::Frame;
use crate::profile;
use crate::session::bus::Bus;
use crate::session::context::Context;
use crate::session::device::{Announcement, emit_announcement};
use crate::session::machine::Machine;
use crate::wire::NodeId;
use crate::wire::canopen::ObjectAddress;
use crate::wire::canopen::lss::{self, Content};

/// The LSS exchange between master and slaves.
#[derive(Debug, Clone, Default)]
pub(in crate::session) struct Lss {
    /// Node-ID asked for, until the slave accepts it.
    requested: Option<u8>,
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

impl Machine for Lss {
    /// Whether the master sends the identifier.
    type Route<'a> = bool;
    type Product = ();

    fn on_frame(&mut self, from_master: bool, frame: &Frame, cx: &mut Context<'_>) {
        self.weigh(from_master, frame, &mut cx.bus);
        if !cx.is_decoded(frame) {
            return;
        }
        let message = match lss::parse(frame.data(), from_master) {
            Ok(message) => message,
            Err(error) => return cx.emit_malformed(frame, None, error, "too short for its LSS command"),
        };
        let is_scan_step = matches!(message.content, Content::FastScan { .. });
        let routine = if from_master {
            std::mem::replace(&mut self.scanning, is_scan_step) && is_scan_step
        } else {
            self.scanning
        };
        let kind = EventKind::Lss { command: message.command, from_master, content: message.content };
        cx.emit(frame, None, routine, kind);
        self.follow_node_id(message, from_master, frame, cx);
        self.follow_bit_rate(message, from_master, frame, cx);
    }
}

impl Lss {
    /// What the bus goes to when the master activates what it configured (CiA 305 §3.9.3.2).
    fn follow_bit_rate(&mut self, message: lss::Lss, from_master: bool, frame: &Frame, cx: &mut Context<'_>) {
        match (message.content, from_master) {
            (Content::BitTiming { table: 0, entry }, true) => {
                self.bit_rate.asked = profile::lss().bit_rate(entry);
            }
            (Content::Result { code: 0, .. }, false) if message.command == BIT_TIMING => {
                self.bit_rate.accepted = self.bit_rate.asked.take();
            }
            (Content::Delay(delay), true) => {
                if let Some(rate) = self.bit_rate.accepted.take() {
                    // Silence for the delay before the switch, and for the delay again after it.
                    let text =
                        format!("bus goes to {rate} kbit/s after {delay} ms, no frame for {delay} ms more");
                    let change =
                        Announcement { procedure: "bit-rate change", word: "RATE", finished: false, text };
                    emit_announcement(None, change, frame, cx);
                }
            }
            _ => {}
        }
    }

    /// An answer that fits the question is evidence of CANopen. Cars use these identifiers for UDS, whose
    /// first bytes are small, so only the commands from 0x40 on count.
    fn weigh(&mut self, from_master: bool, frame: &Frame, bus: &mut Bus) {
        let command = frame.data().first().copied().filter(|_| frame.length == 8);
        if from_master {
            self.asked = command;
            return;
        }
        let fits = match (self.asked, command) {
            (Some(0x43), Some(0x44)) | (Some(0x4B | 0x51), Some(0x4F)) | (Some(0x4C), Some(0x50)) => true,
            (Some(asked @ 0x5A..=0x5E), Some(answer)) => asked == answer,
            _ => false,
        };
        if fits {
            bus.canopen.add_evidence();
        }
    }

    /// The node that said these numbers of itself (1018): all that are known must fit, the serial number
    /// must be known.
    fn node_of_address(bus: &Bus, address: [Option<u32>; 4]) -> Option<u8> {
        let mut fitting = bus.nodes().filter(|node| {
            let told = |sub: u8| node.store().number(ObjectAddress::new(0x1018, sub));
            let same =
                |(sub, number): (u8, Option<u32>)| told(sub).is_none() || told(sub) == number.map(u64::from);
            told(4).is_some() && (1..).zip(address).all(same)
        });
        fitting.next().and_then(|node| node.id().canopen()).filter(|_| fitting.next().is_none())
    }

    /// Remembers a node-ID that is inquired, asked for, accepted.
    fn follow_node_id(&mut self, message: lss::Lss, from_master: bool, frame: &Frame, cx: &mut Context<'_>) {
        match (message.content, from_master) {
            (Content::Number(number), true) => {
                if let Some(slot) = message
                    .command
                    .checked_sub(SELECTIVE)
                    .and_then(|at| self.address.get_mut(usize::from(at)))
                {
                    *slot = Some(number);
                }
            }
            (Content::Nothing, false) if message.command == SELECTED => {
                self.present = Self::node_of_address(&cx.bus, self.address);
            }
            (Content::Mode(_), true) => self.address = [None; 4],
            (Content::NodeId(id), true) => self.requested = Some(id),
            (Content::NodeId(id), false) => self.present = Some(id),
            (Content::Result { code: 0, .. }, false) if message.command == 0x11 => {
                // One that has none says so (255); other numbers are no node-IDs (CiA 305: 1 to 127, 255).
                let from = self.present.take().filter(|id| (1..=127).contains(id));
                let to = self.requested.take().filter(|to| (1..=127).contains(to));
                cx.bus.node_id_changes.by_lss = to.filter(|to| from != Some(*to)).map(|to| (from, to));
                if let Some((from, to)) = cx.bus.node_id_changes.by_lss {
                    let text = format!("node-ID {to} after its next start");
                    let change =
                        Announcement { procedure: "node-ID change", word: "IDENT", finished: false, text };
                    emit_announcement(from.map(NodeId::Canopen), change, frame, cx);
                }
            }
            _ => {}
        }
    }
}
