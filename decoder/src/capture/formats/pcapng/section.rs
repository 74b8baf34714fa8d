//! A section: its interfaces and the contents of its blocks.
//!
//! ```text
//! enhanced packet   0 interface (4)  4 time, high (4)  8 low (4)  12 captured (4)  16 on the wire (4)
//!                  20 data, padded to a multiple of four, then options
//! obsolete packet   0 interface (2)  2 lost before it (2)  then as above
//! simple packet     0 on the wire (4)  4 data; of the first interface, without time
//! statistics        0 interface (4)  4 time (8)  12 options
//! ```

use super::block::COMMENT;
use super::block::{BlockType, PcapngBlock, START};
use super::interface::{BlockOptions, PcapngInterface};
use crate::capture::byte_order::ByteOrder;
use crate::capture::link::{PacketHeader, PacketOutput, parse_common};
use crate::capture::remark::CommentRemark;
use crate::capture::{Batch, BusNames, CapturePlace, Notice};
use crate::frame::{BusIndex, FrameFlags};

/// Maximum number of interfaces in a section; packets of further ones are unreadable.
const MAX_INTERFACES: usize = 1_024;
/// Offset of the packet data in the block body.
const DATA: usize = 20;
/// Size of the largest block on the fast path, in bytes: a frame of 16 bytes.
const COMMON: usize = 48;
/// Overhead of such a block in addition to the packet, in bytes.
const AROUND_PACKET: u32 = 32;
const ENHANCED_PACKET: u32 = pcap_file::pcapng::blocks::ENHANCED_PACKET_BLOCK;

const EPB_FLAGS: u16 = 2;
const EPB_DROPCOUNT: u16 = 4;
const ISB_IFDROP: u16 = 5;
const ISB_OSDROP: u16 = 7;
/// Value of an obsolete packet's loss counter that means unknown.
const LOSS_UNKNOWN: u16 = 0xFFFF;

/// The current section, and counters over all sections.
#[derive(Clone)]
pub(super) struct PcapngSection {
    pub(super) order: ByteOrder,
    interfaces: Vec<PcapngInterface>,
    frames: u64,
    pub(super) buses: BusNames,
}

impl Default for PcapngSection {
    fn default() -> Self {
        Self { order: ByteOrder::Little, interfaces: Vec::new(), frames: 0, buses: BusNames::default() }
    }
}

impl PcapngSection {
    /// Parses consecutive common packets; returns the number of bytes used.
    #[inline]
    pub(super) fn parse_run<const BIG: bool>(&mut self, input: &[u8], batch: &mut Batch) -> usize {
        let number =
            |bytes: &[u8; 4]| if BIG { u32::from_be_bytes(*bytes) } else { u32::from_le_bytes(*bytes) };
        let mut taken = 0;
        // Data of the last packet's interface, which the next packet usually shares.
        let mut last = None;
        while let Some(window) = input.get(taken..).and_then(<[u8]>::first_chunk::<COMMON>) {
            let ([kind, total, interface, high, low, captured, _, ..], []) = window.as_chunks::<4>() else {
                break;
            };
            let (total, captured) = (number(total), number(captured));
            let interface = number(interface);
            let (bus, order, clock) = match last {
                Some((number, known)) if number == interface => known,
                _ => {
                    let Some(known) =
                        self.interfaces.get(interface as usize).and_then(PcapngInterface::fast_path)
                    else {
                        break;
                    };
                    last = Some((interface, known));
                    known
                }
            };
            let (Some(packet), Some(slot)) =
                (window.get(START + DATA..).and_then(<[u8]>::first_chunk), batch.free_slot())
            else {
                break;
            };
            if number(kind) != ENHANCED_PACKET || !parse_common(packet, captured, order, slot) {
                break;
            }
            let size = total as usize;
            let is_bare = total == AROUND_PACKET + captured.next_multiple_of(4);
            let again = window.get(size.wrapping_sub(4)..).and_then(<[u8]>::first_chunk);
            if !is_bare || again.map(number) != Some(total) {
                break;
            }
            self.frames += 1;
            slot.number = self.frames;
            slot.time = Some(clock.tick_time(number(high), number(low)));
            slot.bus = bus;
            batch.commit_slot();
            taken += size;
        }
        taken
    }

    /// Whether a block is plausible in this section; distinguishes blocks from invalid bytes.
    pub(super) fn is_plausible(&self, block: &PcapngBlock<'_>) -> bool {
        let PcapngBlock { body, order, .. } = *block;
        let interface = match block.kind {
            BlockType::Packet | BlockType::Statistics => order.u32(body, 0),
            BlockType::ObsoletePacket => order.u16(body, 0).map(u32::from),
            BlockType::SimplePacket => Some(0),
            BlockType::Interface => return body.len() >= PcapngInterface::SHORTEST,
            BlockType::Section | BlockType::Unread | BlockType::Unknown => return true,
        };
        let Some(interface) = interface.and_then(|number| self.interfaces.get(number as usize)) else {
            return false;
        };
        if matches!(block.kind, BlockType::Statistics | BlockType::SimplePacket) {
            return true;
        }
        let captured = u64::from(order.u32(body, 12).unwrap_or(u32::MAX));
        let is_too_large = body.len() as u64 + 12 < block.length && interface.channel.may_hold_can();
        captured.saturating_add(u64::from(AROUND_PACKET)) <= block.length && !is_too_large
    }

    pub(super) fn take_block(&mut self, block: &PcapngBlock<'_>, place: CapturePlace, batch: &mut Batch) {
        match block.kind {
            BlockType::Section => {
                self.order = block.order;
                self.report_other_packets(batch);
                self.interfaces.clear();
            }
            BlockType::Interface => self.on_interface(block, place, batch),
            BlockType::Packet => {
                let number = block.order.u32(block.body, 0);
                self.on_packet(number, block, place, batch);
            }
            BlockType::ObsoletePacket => {
                let lost = block.order.u16(block.body, 2).filter(|lost| *lost != LOSS_UNKNOWN);
                let number = block.order.u16(block.body, 0).map(u32::from);
                if let Some(lost) = lost.filter(|lost| *lost > 0) {
                    let bus = self.bus_of(number);
                    report_lost(u64::from(lost), bus, place, batch);
                }
                self.on_packet(number, block, place, batch);
            }
            BlockType::SimplePacket => self.simple_packet(block, place, batch),
            BlockType::Statistics => self.on_statistics(block, place, batch),
            BlockType::Unread | BlockType::Unknown => {}
        }
    }

    fn on_interface(&mut self, block: &PcapngBlock<'_>, place: CapturePlace, batch: &mut Batch) {
        if block.body.len() < PcapngInterface::SHORTEST {
            let reason = "interface description: too short".to_owned();
            batch.add_notice(Notice::Unreadable { place, reason });
        }
        if self.interfaces.len() < MAX_INTERFACES {
            self.interfaces.push(PcapngInterface::parse_interface(
                block.body,
                block.order,
                self.interfaces.len(),
            ));
        }
    }

    /// Handles an enhanced or obsolete packet: their bodies differ only before the time.
    fn on_packet(
        &mut self,
        number: Option<u32>,
        block: &PcapngBlock<'_>,
        place: CapturePlace,
        batch: &mut Batch,
    ) {
        let PcapngBlock { body, order, .. } = *block;
        let fields =
            (number, order.u32(body, 4), order.u32(body, 8), order.u32(body, 12), order.u32(body, 16));
        let (Some(number), Some(high), Some(low), Some(captured), Some(_)) = fields else {
            batch.push_unreadable(place, "packet block: too short".into());
            return;
        };
        let Some(interface) = self.interfaces.get_mut(number as usize) else {
            batch.push_unreadable(place, format!("packet of undefined interface {number}"));
            return;
        };
        if !interface.channel.may_hold_can() {
            interface.channel.count_skipped();
            return;
        }
        let data = body.get(DATA..).unwrap_or_default();
        let Some(packet) = data.get(..captured as usize) else {
            let reason = format!("packet block: found {} of {captured} captured bytes", data.len());
            batch.push_unreadable(place, reason);
            return;
        };
        let mut flags = FrameFlags::default();
        if block.kind == BlockType::Packet {
            let options = data.get((captured as usize).next_multiple_of(4)..).unwrap_or_default();
            let lost;
            (flags, lost) = packet_options(options, order);
            if lost > 0 {
                let bus = interface.channel.own_bus(&mut self.buses).unwrap_or_default();
                report_lost(lost, bus, place, batch);
            }
        }
        let head = PacketHeader { time: Some(interface.clock.tick_time(high, low)), flags, place };
        let mut out = PacketOutput { batch, frames: &mut self.frames, buses: &mut self.buses };
        interface.channel.on_packet(packet, head, &mut out);
    }

    fn simple_packet(&mut self, block: &PcapngBlock<'_>, place: CapturePlace, batch: &mut Batch) {
        let Some(interface) = self.interfaces.first_mut() else {
            batch.push_unreadable(place, "packet of undefined interface 0".into());
            return;
        };
        let Some(on_the_wire) = block.order.u32(block.body, 0) else {
            batch.push_unreadable(place, "packet block: too short".into());
            return;
        };
        let longest = if interface.longest == 0 { u32::MAX } else { interface.longest };
        let data = block.body.get(4..).unwrap_or_default();
        // The data are padded; only these fields state their length.
        let packet = data.get(..on_the_wire.min(longest) as usize).unwrap_or(data);
        let head = PacketHeader { time: None, flags: FrameFlags::default(), place };
        let mut out = PacketOutput { batch, frames: &mut self.frames, buses: &mut self.buses };
        interface.channel.on_packet(packet, head, &mut out);
    }

    /// Reports new losses: loss counters of an interface are cumulative.
    fn on_statistics(&mut self, block: &PcapngBlock<'_>, place: CapturePlace, batch: &mut Batch) {
        let number = block.order.u32(block.body, 0).unwrap_or(u32::MAX);
        let Some(interface) = self.interfaces.get_mut(number as usize) else { return };
        let options = || BlockOptions::new(block.body.get(12..).unwrap_or_default(), block.order);
        let lost = options()
            .filter(|(code, _)| matches!(*code, ISB_IFDROP | ISB_OSDROP))
            .filter_map(|(_, value)| block.order.u64(value, 0))
            .fold(0u64, u64::saturating_add);
        if !interface.channel.may_hold_can() {
            return;
        }
        let newly = lost.saturating_sub(interface.lost);
        interface.lost = interface.lost.max(lost);
        let comment =
            options().find(|(code, _)| *code == COMMENT).and_then(|(_, text)| CommentRemark::parse(text));
        if newly == 0 && comment.is_none() {
            return;
        }
        let time = (block.order.u32(block.body, 4), block.order.u32(block.body, 8));
        let (Some(bus), (Some(high), Some(low))) = (interface.channel.own_bus(&mut self.buses), time) else {
            return;
        };
        report_lost(newly, bus, place, batch);
        let time = interface.clock.tick_time(high, low);
        match comment {
            Some(CommentRemark::Link(state, bit_rate)) => {
                batch.add_notice(Notice::Link { bus, time, state, bit_rate });
            }
            Some(CommentRemark::Quiet) => batch.add_notice(Notice::Quiet(time)),
            Some(CommentRemark::ClockSet(step)) => batch.add_notice(Notice::ClockSet { bus, time, step }),
            Some(CommentRemark::Lost(count)) => batch.add_notice(Notice::LostFrames { place, bus, count }),
            None => {}
        }
    }

    fn bus_of(&mut self, number: Option<u32>) -> BusIndex {
        let interface = number.and_then(|number| self.interfaces.get_mut(number as usize));
        interface.and_then(|interface| interface.channel.own_bus(&mut self.buses)).unwrap_or_default()
    }

    /// Reports the packets of the section that are not CAN.
    pub(super) fn report_other_packets(&self, batch: &mut Batch) {
        for notice in self.interfaces.iter().filter_map(|interface| interface.channel.skipped_notice()) {
            batch.add_notice(notice);
        }
    }
}

/// Direction of a packet, and number of packets lost before it.
fn packet_options(options: &[u8], order: ByteOrder) -> (FrameFlags, u64) {
    let (mut flags, mut lost) = (FrameFlags::default(), 0u64);
    for (code, value) in BlockOptions::new(options, order) {
        match (code, order.u32(value, 0).map(|bits| bits & 3), order.u64(value, 0)) {
            (EPB_FLAGS, Some(1), _) => flags = flags.with(FrameFlags::RECEIVED),
            (EPB_FLAGS, Some(2), _) => flags = flags.with(FrameFlags::TRANSMITTED),
            (EPB_DROPCOUNT, _, Some(count)) => lost = lost.saturating_add(count),
            _ => {}
        }
    }
    (flags, lost)
}

fn report_lost(lost: u64, bus: BusIndex, place: CapturePlace, batch: &mut Batch) {
    if lost > 0 {
        batch.add_notice(Notice::LostFrames { place, bus, count: Some(lost) });
    }
}
