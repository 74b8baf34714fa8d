//! One interface of a packet capture: its bus, and what was learnt about its packets.

use super::socketcan::{self, Bad, IdOrder};
use super::{Link, Opened, Payload, open};
use crate::capture::byte_order::ByteOrder;
use crate::capture::text::lines::excerpt;
use crate::capture::{Batch, BusNames, MAX_BUS_NAME, MAX_BUSES, Notice, Place};
use crate::frame::{BusIndex, FrameFlags, Timestamp};

/// An interface.
#[derive(Debug, Clone)]
pub(in crate::capture) struct Channel {
    name: Vec<u8>,
    /// Whether the name is that of one device: `any` is all of them.
    is_one: bool,
    link: Link,
    order: IdOrder,
    bus: Option<BusIndex>,
    /// Buses of the interface numbers that packets carry themselves.
    numbered: Vec<(u32, BusIndex)>,
    skipped: u64,
    protocol: u16,
}

/// What a packet's own header says.
#[derive(Debug, Clone, Copy)]
pub(in crate::capture) struct Head {
    /// When it was recorded.
    pub(in crate::capture) time: Option<Timestamp>,
    /// What is known of its direction.
    pub(in crate::capture) flags: FrameFlags,
    /// Where it stands.
    pub(in crate::capture) place: Place,
}

/// Where frames go.
pub(in crate::capture) struct Output<'a> {
    /// Frames and notices.
    pub(in crate::capture) batch: &'a mut Batch,
    /// Frames delivered so far.
    pub(in crate::capture) frames: &'a mut u64,
    /// Buses seen so far.
    pub(in crate::capture) buses: &'a mut BusNames,
}

impl Channel {
    /// An interface of which no packet was seen, in a capture of this byte order. `name` is cut where a
    /// bus name is; without one it is `can` and the interface's number.
    pub(in crate::capture) fn new(link: Link, order: ByteOrder, name: Option<&[u8]>, number: usize) -> Self {
        let cut = |name: &[u8]| name.get(..MAX_BUS_NAME).unwrap_or(name).to_vec();
        Self {
            name: name.map_or_else(|| format!("can{number}").into_bytes(), cut),
            is_one: name.is_some_and(|name| name != b"any"),
            link,
            order: IdOrder::new(if link == Link::SocketCan { ByteOrder::Big } else { order }),
            bus: None,
            numbered: Vec::new(),
            skipped: 0,
            protocol: 0,
        }
    }

    /// Whether all its packets are frames that [`socketcan::common`] may be asked to read, and how.
    #[inline]
    pub(in crate::capture) fn usual(&self) -> Option<(BusIndex, IdOrder)> {
        match self.link {
            Link::SocketCan => self.bus.map(|bus| (bus, self.order)),
            _ => None,
        }
    }

    /// Whether its packets can hold CAN frames.
    pub(in crate::capture) fn may_hold_can(&self) -> bool {
        !matches!(self.link, Link::Other(_))
    }

    /// Counts a packet nobody looked at.
    pub(in crate::capture) fn skip(&mut self) {
        if let Link::Other(number) = self.link {
            self.protocol = number;
        }
        self.skipped += 1;
    }

    /// One packet of any kind.
    pub(in crate::capture) fn packet(&mut self, packet: &[u8], head: Head, out: &mut Output<'_>) {
        match open(self.link, packet) {
            Opened::Can(payload) => self.frame(&payload, head, out),
            Opened::NotCan(protocol) => {
                if self.skipped == 0 {
                    self.protocol = protocol;
                }
                self.skipped += 1;
            }
            Opened::Short { header } => {
                let found = packet.len();
                let reason = format!("packet header: found {found} bytes, expected at least {header}");
                out.batch.notice(Notice::Unreadable { place: head.place, reason });
            }
        }
    }

    fn frame(&mut self, payload: &Payload<'_>, head: Head, out: &mut Output<'_>) {
        let Some(slot) = out.batch.slot() else { return };
        // What is no frame proves no order: it would be changed without a word, for none is left to say it with.
        let mut order = self.order;
        if let Err(bad) = socketcan::frame(payload.bytes, payload.kind, &mut order, slot) {
            unreadable(bad, head.place, out.batch);
            return;
        }
        self.order = order;
        slot.flags = slot.flags.with(payload.flags).with(head.flags);
        slot.time = head.time;
        slot.number = out.frames.saturating_add(1);
        let Some(bus) = self.bus(payload.interface, out.buses) else {
            let reason = format!("more than {MAX_BUSES} interfaces");
            out.batch.notice(Notice::Unreadable { place: head.place, reason });
            return;
        };
        slot.bus = bus;
        *out.frames = out.frames.saturating_add(1);
        if let Some(order) = self.order.news() {
            let name = excerpt(&self.name);
            let text =
                format!("interface {name}: identifiers are in {order} order, against the standard: read so");
            out.batch.notice(Notice::Assumption(text));
        }
        out.batch.commit();
    }

    fn bus(&mut self, number: Option<u32>, buses: &mut BusNames) -> Option<BusIndex> {
        let Some(number) = number.filter(|_| !self.is_one) else {
            if self.bus.is_none() {
                self.bus = buses.index_of(&self.name);
            }
            return self.bus;
        };
        if let Some((_, bus)) = self.numbered.iter().find(|(known, _)| *known == number) {
            return Some(*bus);
        }
        let bus = buses.index_of(format!("if{number}").as_bytes())?;
        self.numbered.push((number, bus));
        Some(bus)
    }

    /// The bus of an interface that is one bus.
    pub(in crate::capture) fn own_bus(&mut self, buses: &mut BusNames) -> Option<BusIndex> {
        self.bus(None, buses)
    }

    /// What to say at the end about packets that were no CAN.
    pub(in crate::capture) fn summary(&self) -> Option<Notice> {
        if self.skipped == 0 {
            return None;
        }
        let (name, count) = (excerpt(&self.name), self.skipped);
        let packets = if count == 1 { "packet" } else { "packets" };
        Some(Notice::Assumption(match self.link {
            Link::Other(number) => {
                format!("interface {name} is not CAN (link type {number}): {count} {packets} skipped")
            }
            _ => format!(
                "interface {name}: {count} {packets} skipped that are not CAN (protocol 0x{:04X})",
                self.protocol
            ),
        }))
    }
}

fn unreadable(bad: Bad, place: Place, batch: &mut Batch) {
    batch.notice(Notice::Unreadable { place, reason: bad.to_string() });
}
