//! LSS: configuration of node-ID and bit rate.

use crate::event::EventKind;
use crate::frame::Frame;
use crate::profile;
use crate::session::bus::Bus;
use crate::session::context::MachineContext;
use crate::session::device::{SettingAnnouncement, emit_announcement};
use crate::session::machine::ProtocolMachine;
use crate::wire::NodeId;
use crate::wire::canopen::ObjectAddress;
use crate::wire::canopen::lss::{self, LssContent};

/// State of the LSS communication between master and slaves.
#[derive(Debug, Clone, Default)]
pub(in crate::session) struct LssMachine {
    /// Requested node-ID, until the slave accepts it.
    requested: Option<u8>,
    /// Present node-ID of the slave, from its response to an inquiry.
    present: Option<u8>,
    /// A fast scan is running; its steps repeat.
    scanning: bool,
    /// Command of the last message from the master.
    asked: Option<u8>,
    /// Bit rate requested and accepted, in kbit/s.
    bit_rate: AnnouncedBitRate,
    /// Identity numbers of switch state selective received so far.
    address: [Option<u32>; 4],
}

/// Configure bit timing parameters (CiA 305 §3.9.3.2).
const BIT_TIMING: u8 = 0x13;

/// First of the four requests of switch state selective, and the response (CiA 305 §3.9.2.1).
const SELECTIVE: u8 = 0x40;
const SELECTED: u8 = 0x44;

#[derive(Debug, Clone, Copy, Default)]
struct AnnouncedBitRate {
    asked: Option<u32>,
    accepted: Option<u32>,
}

impl ProtocolMachine for LssMachine {
    /// Whether the LSS master uses the identifier.
    type Route<'a> = bool;
    type Product = ();

    fn on_frame(&mut self, from_master: bool, frame: &Frame, cx: &mut MachineContext<'_>) {
        self.weigh_evidence(from_master, frame, &mut cx.bus);
        if !cx.is_decoded(None, frame) {
            return;
        }
        let message = match lss::parse(frame.data(), from_master) {
            Ok(message) => message,
            Err(error) => return cx.emit_malformed(frame, None, error, "too short for its LSS command"),
        };
        let is_scan_step = matches!(message.content, LssContent::FastScan { .. });
        let routine = if from_master {
            std::mem::replace(&mut self.scanning, is_scan_step) && is_scan_step
        } else {
            self.scanning
        };
        let kind = EventKind::Lss { command: message.command, from_master, content: message.content };
        cx.emit_event(frame, None, routine, kind);
        self.follow_node_id(message, from_master, frame, cx);
        self.follow_bit_rate(message, from_master, frame, cx);
    }
}

impl LssMachine {
    /// Announces the new bit rate when the master activates it (CiA 305 §3.9.3.2).
    fn follow_bit_rate(
        &mut self,
        message: lss::LssMessage,
        from_master: bool,
        frame: &Frame,
        cx: &mut MachineContext<'_>,
    ) {
        match (message.content, from_master) {
            (LssContent::BitTiming { table: 0, entry }, true) => {
                self.bit_rate.asked = profile::lss_names().bit_rate(entry);
            }
            (LssContent::Result { code: 0, .. }, false) if message.command == BIT_TIMING => {
                self.bit_rate.accepted = self.bit_rate.asked.take();
            }
            (LssContent::Delay(delay), true) => {
                if let Some(rate) = self.bit_rate.accepted.take() {
                    // The bus is silent for the delay before the switch and again after it.
                    let text =
                        format!("bit rate {rate} kbit/s after {delay} ms, then no frames for {delay} ms");
                    let change = SettingAnnouncement {
                        procedure: "bit-rate change",
                        word: "RATE",
                        finished: false,
                        text,
                    };
                    emit_announcement(None, change, frame, cx);
                }
            }
            _ => {}
        }
    }

    /// Counts a response that matches its request as evidence of CANopen. Cars use these identifiers for UDS,
    /// which starts with small bytes, so only commands from 0x40 on are evaluated.
    fn weigh_evidence(&mut self, from_master: bool, frame: &Frame, bus: &mut Bus) {
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
            bus.protocols.canopen.add_evidence();
        }
    }

    /// Node with this identity (1018): all known numbers must be equal, and the serial number must be known.
    fn node_of_address(bus: &Bus, address: [Option<u32>; 4]) -> Option<u8> {
        let mut fitting = bus.nodes().filter(|node| {
            let reported = |sub: u8| node.store().number(ObjectAddress::new(0x1018, sub));
            let same = |(sub, number): (u8, Option<u32>)| {
                reported(sub).is_none() || reported(sub) == number.map(u64::from)
            };
            reported(4).is_some() && (1..).zip(address).all(same)
        });
        fitting.next().and_then(|node| node.id().canopen()).filter(|_| fitting.next().is_none())
    }

    /// Follows a node-ID from inquiry and request to acceptance.
    fn follow_node_id(
        &mut self,
        message: lss::LssMessage,
        from_master: bool,
        frame: &Frame,
        cx: &mut MachineContext<'_>,
    ) {
        match (message.content, from_master) {
            (LssContent::Number(number), true) => {
                if let Some(slot) = message
                    .command
                    .checked_sub(SELECTIVE)
                    .and_then(|at| self.address.get_mut(usize::from(at)))
                {
                    *slot = Some(number);
                }
            }
            (LssContent::Nothing, false) if message.command == SELECTED => {
                self.present = Self::node_of_address(&cx.bus, self.address);
            }
            (LssContent::Mode(_), true) => self.address = [None; 4],
            (LssContent::NodeId(id), true) => self.requested = Some(id),
            (LssContent::NodeId(id), false) => self.present = Some(id),
            (LssContent::Result { code: 0, .. }, false) if message.command == 0x17 => {
                cx.bus.node_id_changes.is_lss_stored = true;
            }
            (LssContent::Result { code: 0, .. }, false) if message.command == 0x11 => {
                // A slave without node-ID reports 255; other numbers are not valid (CiA 305: 1 to 127, 255).
                let from = self.present.take().filter(|id| (1..=127).contains(id));
                let to = self.requested.take().filter(|to| (1..=127).contains(to));
                cx.bus.node_id_changes.is_lss_stored = false;
                cx.bus.node_id_changes.by_lss = to.filter(|to| from != Some(*to)).map(|to| (from, to));
                if let Some((from, to)) = cx.bus.node_id_changes.by_lss {
                    let text = format!("node-ID {to} from the next boot-up");
                    let change = SettingAnnouncement {
                        procedure: "node-ID change",
                        word: "IDENT",
                        finished: false,
                        text,
                    };
                    emit_announcement(from.map(NodeId::Canopen), change, frame, cx);
                }
            }
            _ => {}
        }
    }
}
