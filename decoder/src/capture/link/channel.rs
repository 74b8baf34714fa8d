//! One interface of a packet capture: its bus, and the state of its packets.

use super::socketcan::{self, IdOrder, InvalidFrame};
use super::{LinkPayload, LinkType, PacketContent, open_packet};
use crate::capture::byte_order::ByteOrder;
use crate::capture::text::lines::line_excerpt;
use crate::capture::{Batch, BusNames, CapturePlace, MAX_BUS_NAME, MAX_BUSES, Notice};
use crate::frame::{BusIndex, FrameFlags, Timestamp};

/// Link types of other bus systems (tcpdump.org, link-layer header types).
const OTHER_SYSTEMS: &[(u16, &str)] = &[
    (1, "Ethernet"),
    (105, "WLAN"),
    (127, "WLAN"),
    (189, "USB"),
    (210, "FlexRay"),
    (211, "MOST"),
    (212, "LIN"),
    (220, "USB"),
    (249, "USB"),
    (251, "Bluetooth"),
];

/// An interface of a packet capture.
#[derive(Debug, Clone)]
pub(in crate::capture) struct CaptureInterface {
    name: Vec<u8>,
    /// Whether the name belongs to a single device; `any` means all devices.
    is_one: bool,
    link: LinkType,
    order: IdOrder,
    bus: Option<BusIndex>,
    /// Buses of the interface numbers in cooked headers.
    numbered: Vec<(u32, BusIndex)>,
    skipped: u64,
    protocol: u16,
}

/// Properties of a packet outside of its data.
#[derive(Debug, Clone, Copy)]
pub(in crate::capture) struct PacketHeader {
    /// Time of recording.
    pub(in crate::capture) time: Option<Timestamp>,
    /// Direction, if known.
    pub(in crate::capture) flags: FrameFlags,
    /// Position of the packet.
    pub(in crate::capture) place: CapturePlace,
}

/// Destination of frames and notices.
pub(in crate::capture) struct PacketOutput<'a> {
    pub(in crate::capture) batch: &'a mut Batch,
    /// Number of frames emitted so far.
    pub(in crate::capture) frames: &'a mut u64,
    /// Buses seen so far.
    pub(in crate::capture) buses: &'a mut BusNames,
}

impl CaptureInterface {
    /// Creates an interface in a capture of this byte order. `name` is cut to the maximum of a bus name;
    /// without a name it is `can` and the interface number.
    pub(in crate::capture) fn new(
        link: LinkType,
        order: ByteOrder,
        name: Option<&[u8]>,
        number: usize,
    ) -> Self {
        let cut = |name: &[u8]| name.get(..MAX_BUS_NAME).unwrap_or(name).to_vec();
        Self {
            name: name.map_or_else(|| format!("can{number}").into_bytes(), cut),
            is_one: name.is_some_and(|name| name != b"any"),
            link,
            order: IdOrder::new(if link == LinkType::SocketCan { ByteOrder::Big } else { order }),
            bus: None,
            numbered: Vec::new(),
            skipped: 0,
            protocol: 0,
        }
    }

    /// Bus and identifier byte order if [`socketcan::common`] can read the packets; otherwise `None`.
    #[inline]
    pub(in crate::capture) fn fast_path(&self) -> Option<(BusIndex, IdOrder)> {
        match self.link {
            LinkType::SocketCan => self.bus.map(|bus| (bus, self.order)),
            _ => None,
        }
    }

    /// Whether packets of this link type can contain CAN frames.
    pub(in crate::capture) fn may_hold_can(&self) -> bool {
        !matches!(self.link, LinkType::Other(_))
    }

    /// Counts a skipped packet.
    pub(in crate::capture) fn count_skipped(&mut self) {
        if let LinkType::Other(number) = self.link {
            self.protocol = number;
        }
        self.skipped += 1;
    }

    /// Handles one packet of any type.
    pub(in crate::capture) fn on_packet(
        &mut self,
        packet: &[u8],
        head: PacketHeader,
        out: &mut PacketOutput<'_>,
    ) {
        match open_packet(self.link, packet) {
            PacketContent::Can(payload) => self.add_frame(&payload, head, out),
            PacketContent::NotCan(protocol) => {
                if self.skipped == 0 {
                    self.protocol = protocol;
                }
                self.skipped += 1;
            }
            PacketContent::Short { header } => {
                let found = packet.len();
                let reason = format!("packet header: found {found} bytes; expected at least {header}");
                out.batch.add_notice(Notice::Unreadable { place: head.place, reason });
            }
        }
    }

    fn add_frame(&mut self, payload: &LinkPayload<'_>, head: PacketHeader, out: &mut PacketOutput<'_>) {
        let Some(slot) = out.batch.free_slot() else { return };
        // An invalid frame must not change the order: the change could not be reported with a frame.
        let mut order = self.order;
        if let Err(bad) = socketcan::parse_frame(payload.bytes, payload.kind, &mut order, slot) {
            report_unreadable(bad, head.place, out.batch);
            return;
        }
        self.order = order;
        slot.flags = slot.flags.with(payload.flags).with(head.flags);
        slot.time = head.time;
        slot.number = out.frames.saturating_add(1);
        let Some(bus) = self.bus_index(payload.interface, out.buses) else {
            let reason = format!("more than {MAX_BUSES} interfaces");
            out.batch.add_notice(Notice::Unreadable { place: head.place, reason });
            return;
        };
        slot.bus = bus;
        *out.frames = out.frames.saturating_add(1);
        if let Some(order) = self.order.detected_order() {
            let name = line_excerpt(&self.name);
            let text = format!(
                "interface {name}: identifiers are {order}, contrary to the standard; read as {order}"
            );
            out.batch.add_notice(Notice::Assumption(text));
        }
        out.batch.commit_slot();
    }

    fn bus_index(&mut self, number: Option<u32>, buses: &mut BusNames) -> Option<BusIndex> {
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

    /// The bus of an interface with a single bus.
    pub(in crate::capture) fn own_bus(&mut self, buses: &mut BusNames) -> Option<BusIndex> {
        self.bus_index(None, buses)
    }

    /// Notice at the end about packets that were not CAN.
    pub(in crate::capture) fn skipped_notice(&self) -> Option<Notice> {
        if self.skipped == 0 {
            return None;
        }
        let (name, count) = (line_excerpt(&self.name), self.skipped);
        let packets = if count == 1 { "packet" } else { "packets" };
        Some(Notice::Assumption(match self.link {
            LinkType::Other(number) => {
                let system = OTHER_SYSTEMS.iter().find(|(known, _)| *known == number);
                let system =
                    system.map_or_else(|| "not CAN".to_owned(), |(_, name)| format!("{name}, not CAN"));
                format!("interface {name} is {system} (link type {number}): {count} {packets} skipped")
            }
            _ => format!(
                "interface {name}: {count} {packets} other than CAN skipped (first protocol 0x{:04X})",
                self.protocol
            ),
        }))
    }
}

fn report_unreadable(bad: InvalidFrame, place: CapturePlace, batch: &mut Batch) {
    batch.add_notice(Notice::Unreadable { place, reason: bad.to_string() });
}
