//! Cached starts of PDO lines: node, KIND and name of the PDO, which are equal in all lines of an identifier.
//!
//! ```text
//!    0.412  32/20 boom         PDO    TPDO1 08 A0 1F 00 20: status 08h pressure control {118}
//!         └──────────────── head ─────────┘
//! ```

use super::parts::{push_columns, push_node};
use super::pdo::{push_name, push_payload, push_text};
use crate::escape::{is_plain, push_escaped};
use crate::event::{DecodedPdo, Event};
use crate::frame::{BusIndex, CanId};
use crate::session::Bus;
use crate::sink::line_key::{PDO_SLOTS, pdo_key, pdo_slot};
use crate::wire::NodeId;

/// KIND column of a PDO.
pub(super) const KIND: &str = "PDO";

/// Maximum number of PDOs whose missing mapping is printed once only.
const UNMAPPED: usize = 256;

/// Start of a line after its time, with everything that determines it.
struct PdoHead {
    /// PDO and node.
    key: u64,
    bus: BusIndex,
    bus_name: Box<str>,
    node_name: Option<Box<str>>,
    /// Whether a frame of the node was received.
    is_known: bool,
    text: Vec<u8>,
    /// Whether the missing mapping is already printed.
    is_unmapped: bool,
}

/// Heads of the lines written so far.
#[derive(Default)]
pub(super) struct PdoHeads {
    slots: Vec<Option<Box<PdoHead>>>,
    /// PDOs whose missing mapping is already printed.
    unmapped: Vec<(BusIndex, CanId)>,
}

impl PdoHeads {
    /// Appends the line of a PDO between its time and its frames, with control characters escaped.
    pub(super) fn push_line(&mut self, pdo: &DecodedPdo, event: &Event, bus: &Bus, line: &mut Vec<u8>) {
        if self.slots.is_empty() {
            self.slots.resize_with(PDO_SLOTS, || None);
        }
        let Some(slot) = self.slots.get_mut(pdo_slot(pdo, bus)) else { return };
        let head = match slot {
            Some(head) if head.is_of(pdo, event, bus) => head,
            _ => slot.insert(Box::new(PdoHead::head_of(pdo, event, bus))),
        };
        line.extend_from_slice(&head.text);
        push_payload(pdo, line);
        let lacks_mapping = pdo.layout.is_none() && !head.is_unmapped;
        let is_first = lacks_mapping && is_first_without_mapping(&mut self.unmapped, (event.bus, pdo.cob_id));
        // Beyond the maximum, the missing mapping is printed in each line.
        head.is_unmapped |= lacks_mapping && !is_first;
        let text = line.len();
        push_text(pdo, event, bus, is_first, line);
        if line.len() != text && line.get(text..).is_some_and(|text| !is_plain(text)) {
            let text = line.split_off(text);
            push_escaped(line, &text);
        }
        if event.presumed {
            line.push(b'?');
        }
    }
}

/// Whether the missing mapping of a PDO is not printed yet.
fn is_first_without_mapping(unmapped: &mut Vec<(BusIndex, CanId)>, pdo: (BusIndex, CanId)) -> bool {
    if unmapped.contains(&pdo) {
        return false;
    }
    if unmapped.len() < UNMAPPED {
        unmapped.push(pdo);
    }
    true
}

impl PdoHead {
    #[cold]
    fn head_of(pdo: &DecodedPdo, event: &Event, bus: &Bus) -> Self {
        let mut who = Vec::new();
        push_who(event.node, bus, &mut who);
        let mut text = Vec::new();
        push_columns(bus, &who, KIND, "", &mut text);
        push_name(pdo.name, &mut text);
        let node = event.node.and_then(|node| bus.node(node));
        Self {
            key: pdo_key(pdo, event.node),
            bus: bus.index(),
            bus_name: bus.name().into(),
            node_name: node.and_then(|node| node.name()).map(Into::into),
            is_known: node.is_some(),
            text,
            is_unmapped: false,
        }
    }

    /// Whether the lines of an event start with this head.
    #[inline]
    fn is_of(&self, pdo: &DecodedPdo, event: &Event, bus: &Bus) -> bool {
        let node = event.node.and_then(|node| bus.node(node));
        self.key == pdo_key(pdo, event.node)
            && self.bus == bus.index()
            && self.is_known == node.is_some()
            && self.node_name.as_deref() == node.and_then(|node| node.name())
            // Lines of the first bus do not contain its name.
            && (self.bus.0 == 0 || *self.bus_name == *bus.name())
    }
}

/// Appends the node of a PDO; `?` if only the predefined connection set assigns the PDO to it.
pub(super) fn push_who(node: Option<NodeId>, bus: &Bus, who: &mut Vec<u8>) {
    let Some(node) = node else { return };
    push_node(node, bus, who);
    if bus.node(node).is_none() {
        who.push(b'?');
    }
}

#[cfg(test)]
mod tests {
    use std::sync::Arc;

    use super::*;
    use crate::event::{EventKind, FrameRange};
    use crate::frame::{Frame, MAX_DATA};
    use crate::profile::{PdoDirection, PdoName};
    use crate::session::{BusDecoder, SessionOptions};

    fn bus(index: u8) -> BusDecoder {
        let node_names = vec![(NodeId::Canopen(2), "boom\u{1}".into())];
        let options = Arc::new(SessionOptions { node_names, ..SessionOptions::default() });
        BusDecoder::new(BusIndex(index), "can1", options)
    }

    fn line(heads: &mut PdoHeads, bus: &BusDecoder, first_byte: u8) -> String {
        let mut bytes = [0; MAX_DATA];
        bytes[0] = first_byte;
        let pdo = DecodedPdo {
            name: PdoName { direction: PdoDirection::Transmit, number: 1 },
            cob_id: CanId::from_standard(0x182),
            is_request: false,
            length: 2,
            bytes,
            layout: None,
        };
        let event = Event::new(bus.bus().index(), FrameRange::default(), EventKind::Pdo(pdo.clone()));
        let event = Event { node: Some(NodeId::Canopen(2)), presumed: true, ..event };
        let mut line = Vec::new();
        heads.push_line(&pdo, &event, bus.bus(), &mut line);
        String::from_utf8(line).unwrap()
    }

    #[test]
    fn a_head_is_used_until_the_node_changes() {
        let mut heads = PdoHeads::default();
        let (mut first, second) = (bus(0), bus(1));
        assert_eq!(line(&mut heads, &first, 1), "  2/02?             PDO    TPDO1 01 00?");
        assert_eq!(line(&mut heads, &first, 0xAB), "  2/02?             PDO    TPDO1 AB 00?");
        assert_eq!(line(&mut heads, &second, 1), "  can1 2/02?        PDO    TPDO1 01 00?");
        first.push(&Frame::data_frame(CanId::from_standard(0x702), &[5]), &mut |_: &Event, _: &Bus| {});
        assert_eq!(line(&mut heads, &first, 1), "  2/02 boom\\u{1}        PDO    TPDO1 01 00?");
    }

    #[test]
    fn a_missing_mapping_is_printed_once_up_to_a_maximum() {
        let mut unmapped = Vec::new();
        let mut is_first =
            |id| is_first_without_mapping(&mut unmapped, (BusIndex(0), CanId::from_extended(id)));
        assert!((0..256).all(&mut is_first));
        assert!(!(0..256).any(&mut is_first));
        assert!(is_first(256) && is_first(256));
    }
}
