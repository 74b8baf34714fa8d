//! Templates of repeated lines: PDO, heartbeat, guarding and SYNC, which make up most of a capture.
//!
//! ```text
//! {"t":1700000000.123456000,"bus":"can0","frames":[118,118],"kind":"pdo",…,"cob_id":"185","data":"0102"}
//!      └ seconds┘ └nanos ─┘                        └frames─┘                                      └ payload, signals
//! ```
//!
//! A template is a line of the general writer. The next line of the same key overwrites the marked parts, so all
//! others cannot differ from the general writer. The key and the names in a template determine these other parts.
//! If a number has more digits than in the template, the general writer writes a new template. A property test
//! compares whole lines.

use super::object::{Marks, Object};
use super::signals::Signals;
use std::sync::Arc;

use crate::ascii::{nine_digits, push_decimal, push_hex, push_hex_word, push_twice, twice};
use crate::event::{Event, EventKind, Pdo, Protocol};
use crate::frame::Timestamp;
use crate::profile::Layout;
use crate::query::record::signals;
use crate::session::Bus;
use crate::sink::line_key::{BUS_SLOTS, PDO_SLOTS, node_key, pdo_key, pdo_slot};
use crate::wire::NodeId;
use crate::wire::canopen::NmtState;

/// Slots for all other events.
const OTHER_SLOTS: usize = 256;

/// Nanoseconds per second.
const SECOND: u64 = 1_000_000_000;

/// Decimals of a time.
const DECIMALS: usize = 9;

/// Length of `{"t":`, in bytes.
const SECONDS_START: usize = 5;

/// Everything that determines the constant parts of a line, except names.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
struct Key {
    protocol: Protocol,
    presumed: bool,
    /// Kind, node and all values in the constant parts, packed.
    content: u64,
}

/// Kinds of events whose lines have templates, in the bits of a key above all other values.
const PDO: u64 = 1 << 58;
const HEARTBEAT: u64 = 2 << 58;
const GUARD_REQUEST: u64 = 3 << 58;
const GUARD_REPLY: u64 = 4 << 58;
const SYNC: u64 = 5 << 58;

/// Names that occur in a line.
#[derive(Debug, PartialEq, Eq)]
struct Names<T> {
    bus: T,
    node: Option<T>,
    device: Option<T>,
}

/// Last line with its key and names.
struct Template {
    key: Key,
    names: Names<Box<str>>,
    /// Start of the second in the line, in ns.
    second: u64,
    marks: Marks,
    line: Vec<u8>,
    signals: Option<Signals>,
}

/// Templates of the lines written so far.
#[derive(Default)]
pub(super) struct LineTemplates {
    slots: Vec<Option<Box<Template>>>,
    /// Digits of the number that replaces an earlier one.
    digits: Vec<u8>,
}

/// A key with its slot, and the time of the event in ns.
struct KeyedEvent {
    key: Key,
    slot: usize,
    time: u64,
}

impl KeyedEvent {
    /// `None` for an event whose lines have no template.
    #[inline]
    fn of(event: &Event, bus: &Bus) -> Option<Self> {
        let (content, slot) = match &event.kind {
            EventKind::Pdo(pdo) if !pdo.is_request => (PDO | pdo_key(pdo, event.node), pdo_slot(pdo, bus)),
            kind => {
                let (content, slot) = content_of(kind)?;
                let node = event.node.map_or(0, NodeId::place);
                let slot = slot + node + usize::from(bus.index().0) * BUS_SLOTS;
                (content | node_key(event.node) << 48, PDO_SLOTS + slot % OTHER_SLOTS)
            }
        };
        if event.frames.first != event.frames.last {
            return None;
        }
        let Timestamp(time) = event.time?;
        let key = Key { protocol: event.protocol, presumed: event.presumed, content };
        Some(Self { key, slot, time: u64::try_from(time).ok()? })
    }
}

/// Kind and values of an event other than a PDO, with an offset of its slot; `None` for an event whose lines
/// have no template.
fn content_of(kind: &EventKind) -> Option<(u64, usize)> {
    let state_key = |state: Option<NmtState>| state.map_or(0, |state| state as u64 + 1);
    // Beyond all values of a counter without a value.
    let counter_key = |counter: Option<u8>| counter.map_or(1 << 8, u64::from);
    Some(match *kind {
        EventKind::Heartbeat { state, code } => {
            (HEARTBEAT | state_key(state) | u64::from(code) << 8, usize::from(code))
        }
        EventKind::GuardRequest => (GUARD_REQUEST, 128),
        EventKind::GuardReply { state, code, toggle, toggle_error } => {
            let flags = u64::from(toggle) << 16 | u64::from(toggle_error) << 17;
            let slot = 32 + 128 * usize::from(toggle) + usize::from(code);
            (GUARD_REPLY | state_key(state) | u64::from(code) << 8 | flags, slot)
        }
        EventKind::Sync { counter, expected } => {
            (SYNC | counter_key(counter) | counter_key(expected) << 16, usize::from(counter.unwrap_or(0)))
        }
        _ => return None,
    })
}

impl<'a> Names<&'a str> {
    #[inline]
    fn of(event: &Event, bus: &'a Bus) -> Self {
        let node = event.node.and_then(|node| bus.node(node));
        Self {
            bus: bus.name(),
            node: node.and_then(|node| node.name()),
            device: node.and_then(|node| node.device_id()),
        }
    }

    fn owned(&self) -> Names<Box<str>> {
        Names { bus: self.bus.into(), node: self.node.map(Into::into), device: self.device.map(Into::into) }
    }
}

impl LineTemplates {
    /// Turns a template into the line of an event, and returns its slot; `None` without a suitable template.
    #[inline]
    pub(super) fn fill(&mut self, event: &Event, bus: &Bus) -> Option<usize> {
        let KeyedEvent { key, slot, time } = KeyedEvent::of(event, bus)?;
        let template = self.slots.get_mut(slot)?.as_deref_mut()?;
        let is_filled = template.key == key
            && template.names.are(&Names::of(event, bus))
            && template.set_time(time, &mut self.digits)
            && template.set_frame(event.frames.last, &mut self.digits);
        if !is_filled {
            return None;
        }
        if let EventKind::Pdo(pdo) = &event.kind {
            template.set_payload(pdo);
        }
        Some(slot)
    }

    /// The line in a slot.
    #[inline]
    pub(super) fn line(&self, slot: usize) -> &[u8] {
        match self.slots.get(slot) {
            Some(Some(template)) => &template.line,
            _ => &[],
        }
    }

    /// Makes a template of a line of the general writer.
    #[cold]
    pub(super) fn learn(&mut self, event: &Event, bus: &Bus, line: &[u8], marks: Marks) {
        let Some(KeyedEvent { key, slot, time }) = KeyedEvent::of(event, bus) else { return };
        if self.slots.is_empty() {
            self.slots.resize_with(PDO_SLOTS + OTHER_SLOTS, || None);
        }
        let Some(slot) = self.slots.get_mut(slot) else { return };
        let signals = slot.take().and_then(|earlier| earlier.signals);
        let (names, line) = (Names::of(event, bus).owned(), line.to_vec());
        *slot = Some(Box::new(Template { key, names, second: time - time % SECOND, marks, line, signals }));
    }
}

impl Names<Box<str>> {
    #[inline]
    fn are(&self, names: &Names<&str>) -> bool {
        self.node.as_deref() == names.node
            && self.device.as_deref() == names.device
            && *self.bus == *names.bus
    }
}

impl Template {
    /// Overwrites the time; `false` if the number of digits differs.
    #[inline]
    fn set_time(&mut self, time: u64, digits: &mut Vec<u8>) -> bool {
        let end = self.marks.behind_time;
        let start = end.saturating_sub(DECIMALS);
        let mut nanoseconds = time.wrapping_sub(self.second);
        if nanoseconds >= SECOND {
            nanoseconds = time % SECOND;
            self.second = time - nanoseconds;
            digits.clear();
            push_decimal(digits, time / SECOND);
            digits.push(b'.');
            if !self.replace(SECONDS_START, start, digits) {
                return false;
            }
        }
        let decimals = self.line.get_mut(start..end).and_then(|part| part.first_chunk_mut());
        decimals.map(|part| *part = nine_digits(nanoseconds)).is_some()
    }

    /// Overwrites both frame numbers; `false` if the number of digits differs.
    #[inline]
    fn set_frame(&mut self, frame: u64, digits: &mut Vec<u8>) -> bool {
        let (start, end) = (self.marks.frames, self.marks.behind_frames);
        if let Some((text, length)) = twice(frame) {
            return text.get(..length).is_some_and(|text| self.replace(start, end, text));
        }
        digits.clear();
        push_twice(digits, frame);
        self.replace(start, end, digits)
    }

    /// Overwrites a part of the line; `false` if it has another length.
    #[inline]
    fn replace(&mut self, start: usize, end: usize, text: &[u8]) -> bool {
        let part = self.line.get_mut(start..end).filter(|part| part.len() == text.len());
        part.map(|part| part.copy_from_slice(text)).is_some()
    }

    /// Replaces the payload and all after it.
    #[inline]
    fn set_payload(&mut self, pdo: &Pdo) {
        let line = &mut self.line;
        line.truncate(self.marks.data);
        match pdo.bytes.first_chunk() {
            Some(bytes) if pdo.length <= 8 => push_hex_word(line, *bytes, usize::from(pdo.length)),
            _ => push_hex(line, pdo.payload()),
        }
        let Some(layout) = &pdo.layout else { return line.extend_from_slice(b"\"}\n") };
        line.push(b'"');
        let length = usize::from(pdo.length);
        if let (Some(signals), Some(bytes)) = (&mut self.signals, pdo.bytes.first_chunk())
            && signals.are_of(layout, length)
        {
            signals.write(*bytes, line);
            return line.extend_from_slice(b"}\n");
        }
        push_signals(pdo, layout, &mut self.signals, line);
    }
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
    use crate::event::FrameRange;
    use crate::frame::{BusIndex, CanId, Frame};
    use crate::profile::{DataType, Field, Layout, Meaning, PdoDirection, PdoName};
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
