//! Cached parts of repeated lines: PDO, heartbeat, guarding and SYNC, which make up most of a capture.
//!
//! ```text
//! {"t":1700000000.123456000,"bus":"can0","frames":[118,118],"kind":"pdo",…,"cob_id":"185","data":"0102"}
//!      └ cached ┘└ digits ┘└──── head of the bus ────┘└ digits ┘└──── tail of the event ───────┘└ hex ┘
//! ```
//!
//! Head and tail are cut from a line of the general writer, so they cannot differ from it. The key of a tail
//! contains everything that determines the tail. A property test compares whole lines.

use super::object::{Marks, Object};
use super::signals::Signals;
use std::sync::Arc;

use crate::ascii::{push_decimal, push_hex, push_hex_word, push_nine, push_part, push_seconds, push_twice};
use crate::event::{Event, EventKind, FrameRange, Pdo, Protocol};
use crate::frame::{CanId, Timestamp};
use crate::profile::{Layout, PdoName};
use crate::query::record::signals;
use crate::session::Bus;
use crate::wire::NodeId;
use crate::wire::canopen::NmtState;

/// Slots for the tails of PDOs; each predefined COB-ID (0x180 to 0x57F) has its own slot.
const PDO_TAILS: usize = 1024;

/// Slots for all other tails.
const OTHER_TAILS: usize = 256;

/// Maximum length of the cached `{"t":` and seconds, in bytes.
const SECOND_TEXT: usize = 32;

/// Everything that determines a tail, except the node name.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
struct Key {
    protocol: Protocol,
    node: Option<NodeId>,
    presumed: bool,
    what: PreparedKey,
}

#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum PreparedKey {
    Pdo { name: PdoName, cob_id: CanId },
    Heartbeat { state: Option<NmtState>, code: u8 },
    GuardRequest,
    GuardReply { state: Option<NmtState>, code: u8, toggle: bool, toggle_error: bool },
    Sync { counter: Option<u8>, expected: Option<u8> },
}

#[derive(Default)]
struct Tail {
    key: Option<Key>,
    node_name: Option<Box<str>>,
    text: Vec<u8>,
    signals: Option<Signals>,
}

#[derive(Default)]
struct Head {
    bus: String,
    text: Vec<u8>,
}

/// Cached parts of earlier lines.
pub(super) struct LineCache {
    tails: Vec<Tail>,
    /// By bus index.
    heads: Vec<Head>,
    second: i64,
    second_text: [u8; SECOND_TEXT],
    second_length: usize,
}

impl Default for LineCache {
    fn default() -> Self {
        Self {
            tails: Vec::new(),
            heads: Vec::new(),
            second: -1,
            second_text: [0; SECOND_TEXT],
            second_length: 0,
        }
    }
}

impl Key {
    /// `None` for an event whose lines are not cached.
    #[inline]
    fn of(event: &Event) -> Option<Self> {
        let what = match event.kind {
            EventKind::Pdo(ref pdo) if !pdo.is_request => {
                PreparedKey::Pdo { name: pdo.name, cob_id: pdo.cob_id }
            }
            EventKind::Heartbeat { state, code } => PreparedKey::Heartbeat { state, code },
            EventKind::GuardRequest => PreparedKey::GuardRequest,
            EventKind::GuardReply { state, code, toggle, toggle_error } => {
                PreparedKey::GuardReply { state, code, toggle, toggle_error }
            }
            EventKind::Sync { counter, expected } => PreparedKey::Sync { counter, expected },
            _ => return None,
        };
        Some(Self { protocol: event.protocol, node: event.node, presumed: event.presumed, what })
    }

    /// Index of the slot for the tail. Collisions are harmless but slow.
    #[inline]
    fn place(&self, bus: &Bus) -> usize {
        let bus = usize::from(bus.index().0);
        let node = self.node.map_or(0, NodeId::place);
        let other = |place: usize| PDO_TAILS + (place + bus * 83) % OTHER_TAILS;
        match self.what {
            PreparedKey::Pdo { cob_id, .. } => (cob_id.number() as usize + bus * 83) % PDO_TAILS,
            PreparedKey::Sync { counter, .. } => other(usize::from(counter.unwrap_or(0))),
            PreparedKey::Heartbeat { code, .. } => other(node + usize::from(code)),
            PreparedKey::GuardRequest => other(node + 128),
            PreparedKey::GuardReply { toggle, code, .. } => {
                other(node + 32 + 128 * usize::from(toggle) + usize::from(code))
            }
        }
    }
}

impl LineCache {
    /// Appends the line of an event; `false` if no cached parts exist, with `line` in an undefined state.
    #[inline]
    pub(super) fn write(&mut self, event: &Event, bus: &Bus, line: &mut Vec<u8>) -> bool {
        let (Some(key), Some(time)) = (Key::of(event), event.time) else { return false };
        let Some(tail) = self.tails.get_mut(key.place(bus)) else { return false };
        if tail.key != Some(key) || tail.node_name.as_deref() != node_name(event, bus) {
            return false;
        }
        let Some(head) = self.heads.get(usize::from(bus.index().0)) else { return false };
        if head.bus != bus.name() || head.text.is_empty() {
            return false;
        }
        push_time(&mut self.second, &mut self.second_text, &mut self.second_length, time, line);
        line.extend_from_slice(&head.text);
        let FrameRange { first, last } = event.frames;
        if first == last {
            push_twice(line, first);
        } else {
            push_decimal(line, first);
            line.push(b',');
            push_decimal(line, last);
        }
        line.extend_from_slice(&tail.text);
        if let EventKind::Pdo(pdo) = &event.kind {
            push_payload(pdo, &mut tail.signals, line);
        }
        true
    }

    /// Caches the parts of a line of the general writer.
    #[cold]
    pub(super) fn learn(&mut self, event: &Event, bus: &Bus, line: &[u8], marks: Marks) {
        let (Some(key), Some(_)) = (Key::of(event), event.time) else { return };
        let end = if marks.data == 0 { line.len() } else { marks.data };
        let (Some(head), Some(tail)) =
            (line.get(marks.behind_time..marks.frames), line.get(marks.behind_frames..end))
        else {
            return;
        };
        let index = usize::from(bus.index().0);
        if self.heads.len() <= index {
            self.heads.resize_with(index + 1, Head::default);
        }
        if let Some(kept) = self.heads.get_mut(index) {
            bus.name().clone_into(&mut kept.bus);
            head.clone_into(&mut kept.text);
        }
        if self.tails.is_empty() {
            self.tails.resize_with(PDO_TAILS + OTHER_TAILS, Tail::default);
        }
        if let Some(kept) = self.tails.get_mut(key.place(bus)) {
            kept.key = Some(key);
            kept.node_name = node_name(event, bus).map(Into::into);
            tail.clone_into(&mut kept.text);
            kept.signals = None;
        }
    }
}

#[inline]
fn node_name<'a>(event: &Event, bus: &'a Bus) -> Option<&'a str> {
    bus.node(event.node?)?.name()
}

/// Appends `{"t":` and the time.
#[inline]
fn push_time(
    second: &mut i64,
    text: &mut [u8; SECOND_TEXT],
    length: &mut usize,
    time: Timestamp,
    line: &mut Vec<u8>,
) {
    const BEGIN: &[u8] = b"{\"t\":";
    if time.0 < 0 {
        line.extend_from_slice(BEGIN);
        return push_seconds(line, time.0);
    }
    let now = time.0 / 1_000_000_000;
    if now != *second {
        let mut fresh = BEGIN.to_vec();
        push_decimal(&mut fresh, now.unsigned_abs());
        fresh.push(b'.');
        *second = now;
        *length = fresh.len().min(SECOND_TEXT);
        for (target, byte) in text.iter_mut().zip(fresh) {
            *target = byte;
        }
    }
    push_part(line, *text, *length);
    push_nine(line, (time.0 % 1_000_000_000).unsigned_abs());
}

#[inline]
fn push_payload(pdo: &Pdo, prepared: &mut Option<Signals>, line: &mut Vec<u8>) {
    match pdo.bytes.first_chunk() {
        Some(bytes) if pdo.length <= 8 => push_hex_word(line, *bytes, usize::from(pdo.length)),
        _ => push_hex(line, pdo.payload()),
    }
    line.push(b'"');
    let Some(layout) = &pdo.layout else { return line.extend_from_slice(b"}\n") };
    let length = usize::from(pdo.length);
    if let (Some(signals), Some(bytes)) = (&mut *prepared, pdo.bytes.first_chunk())
        && signals.are_of(layout, length)
    {
        signals.write(*bytes, line);
        return line.extend_from_slice(b"}\n");
    }
    push_signals(pdo, layout, prepared, line);
}

/// Writes signals with the general writer, and prepares the cache for the next ones.
#[cold]
fn push_signals(pdo: &Pdo, layout: &Arc<Layout>, prepared: &mut Option<Signals>, line: &mut Vec<u8>) {
    let mut object = Object::resume(line);
    signals(layout, pdo.payload(), &mut object);
    object.end();
    if !prepared.as_ref().is_some_and(|prepared| prepared.is_of(layout)) {
        *prepared = Signals::of(layout);
    }
}

#[cfg(test)]
mod tests {
    use std::sync::Arc;

    use proptest::option;
    use proptest::prelude::*;

    use super::super::{Jsonl, write_line};
    use super::*;
    use crate::frame::{BusIndex, Frame};
    use crate::profile::{DataType, Field, Layout, Meaning, PdoDirection};
    use crate::session::{BusDecoder, SessionOptions};
    use crate::sink::EventSink as _;
    use crate::wire::canopen::ObjectAddress;

    /// A bus with nodes 1 to 3; nodes 2 and 3 have names.
    fn bus(index: u8, name: &str) -> BusDecoder {
        let node_names =
            vec![(NodeId::Canopen(2), "boom \"\u{1}".into()), (NodeId::Canopen(3), format!("jib{index}"))];
        let options = Arc::new(SessionOptions { node_names, ..SessionOptions::default() });
        let mut bus = BusDecoder::new(BusIndex(index), name, options);
        for node in 1..=3 {
            bus.push(&Frame::data_frame(CanId::standard(0x700 + node), &[5]), &mut |_: &Event, _: &Bus| {});
        }
        bus
    }

    fn layout() -> Arc<Layout> {
        let field = |bit, bits, data_type| Field {
            meaning: Some(Arc::new(Meaning { name: "Statusword".into(), ..Meaning::default() })),
            ..Field::of_object(ObjectAddress::new(0x6041, 0), bit, bits, data_type)
        };
        let fields = vec![field(0, 16, DataType::Unsigned16), field(16, 32, DataType::Real32)];
        Arc::new(Layout { fields, bits: 48, origin: "wire", assumed: true, ..Layout::default() })
    }

    fn pdo() -> impl Strategy<Value = EventKind> {
        let names = (any::<bool>(), 1_u16..6).prop_map(|(sends, number)| PdoName {
            direction: if sends { PdoDirection::Transmit } else { PdoDirection::Receive },
            number,
        });
        let ids = prop_oneof![
            4 => (0x180_u16..0x188).prop_map(CanId::standard),
            1 => any::<u32>().prop_map(CanId::extended),
        ];
        let rest =
            (prop_oneof![4 => 0_u8..=8, 1 => 9_u8..=64], any::<[u8; 32]>(), any::<bool>(), any::<bool>());
        (names, ids, rest).prop_map(|(name, cob_id, (length, half, is_request, has_layout))| {
            let mut bytes = [0; 64];
            bytes[..32].copy_from_slice(&half);
            let layout = has_layout.then(layout);
            EventKind::Pdo(Pdo { name, cob_id, is_request, length, bytes, layout })
        })
    }

    fn kind() -> impl Strategy<Value = EventKind> {
        let code = || prop_oneof![Just(5_u8), Just(127), 0_u8..128];
        prop_oneof![
            4 => pdo(),
            1 => code().prop_map(|code| EventKind::Heartbeat { state: NmtState::from_code(code), code }),
            1 => Just(EventKind::GuardRequest),
            1 => (code(), any::<bool>(), any::<bool>()).prop_map(|(code, toggle, toggle_error)| {
                EventKind::GuardReply { state: NmtState::from_code(code), code, toggle, toggle_error }
            }),
            1 => (option::of(0_u8..4), option::of(0_u8..4))
                .prop_map(|(counter, expected)| EventKind::Sync { counter, expected }),
            1 => any::<i64>().prop_map(|step| EventKind::ClockStep { step }),
        ]
    }

    fn event() -> impl Strategy<Value = Event> {
        let time = option::weighted(0.9, prop_oneof![any::<i64>(), 0..3_000_000_000_i64]);
        let frames = prop_oneof![any::<u64>(), 0..200_000_000_u64];
        let node = option::weighted(0.9, 1_u8..=4);
        (time, frames, 0_u64..2, node, any::<bool>(), kind()).prop_map(
            |(time, last, before, node, presumed, kind)| Event {
                time: time.map(Timestamp),
                bus: BusIndex(0),
                frames: FrameRange { first: last.saturating_sub(before), last },
                protocol: Protocol::Canopen,
                node: node.map(NodeId::Canopen),
                presumed,
                routine: false,
                kind,
            },
        )
    }

    proptest! {
        #![proptest_config(ProptestConfig { failure_persistence: None, ..ProptestConfig::default() })]

        #[test]
        fn prepared_lines_equal_those_of_the_general_writer(
            events in prop::collection::vec((event(), 0_usize..3), 1..60),
        ) {
            let buses = [bus(0, "can0"), bus(1, "can1"), bus(0, "a \"bus\"")];
            for capture in [None, Some("two.log")] {
                let mut jsonl = Jsonl::new(Vec::new());
                if let Some(name) = capture {
                    jsonl.begin_capture(name);
                }
                let mut expected = Vec::new();
                // Twice, so that most lines are cached in the second pass.
                for (event, place) in events.iter().chain(&events) {
                    jsonl.write(event, buses[*place].bus());
                    write_line(event, buses[*place].bus(), capture, &mut expected);
                }
                prop_assert_eq!(String::from_utf8(jsonl.output).unwrap(), String::from_utf8(expected).unwrap());
            }
        }
    }
}
