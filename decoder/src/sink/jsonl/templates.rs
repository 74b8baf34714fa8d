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

use super::key::{Key, KeyedEvent, SLOTS};
use super::object::{Marks, Object};
use super::signals::Signals;
use std::sync::Arc;

use crate::ascii::{nine_digits, push_decimal, push_hex, push_hex_word, push_twice, twice};
use crate::event::{Event, EventKind, Pdo};
use crate::profile::Layout;
use crate::query::record::signals;
use crate::session::Bus;

/// Nanoseconds per second.
const SECOND: u64 = 1_000_000_000;

/// Decimals of a time.
const DECIMALS: usize = 9;

/// Length of `{"t":`, in bytes.
const SECONDS_START: usize = 5;

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
    /// The 16 bytes of the line from the frame numbers on, with zeros in place of the numbers.
    after_frames: u128,
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
            self.slots.resize_with(SLOTS, || None);
        }
        let Some(slot) = self.slots.get_mut(slot) else { return };
        *slot = Some(Box::new(Template {
            key,
            names: Names::of(event, bus).owned(),
            second: time - time % SECOND,
            marks,
            after_frames: after_frames(line, marks),
            line: line.to_vec(),
            signals: slot.take().and_then(|earlier| earlier.signals),
        }));
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
        let Some((text, length)) = twice(frame) else {
            digits.clear();
            push_twice(digits, frame);
            return self.replace(start, end, digits);
        };
        if start + length != end {
            return false;
        }
        // One store of constant length; the bytes after the numbers are written again.
        let window = self.line.get_mut(start..).and_then(|rest| rest.first_chunk_mut());
        window.map(|window| *window = (text | self.after_frames).to_le_bytes()).is_some()
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

/// The 16 bytes of a line from the frame numbers on, with zeros in place of the numbers.
fn after_frames(line: &[u8], marks: Marks) -> u128 {
    let window = line.get(marks.frames..).and_then(|rest| rest.first_chunk());
    let numbers = u32::try_from(marks.behind_frames.saturating_sub(marks.frames) * 8).unwrap_or(u32::MAX);
    let kept = u128::MAX.checked_shl(numbers).unwrap_or(0);
    window.map_or(0, |window| u128::from_le_bytes(*window) & kept)
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
    use crate::event::{FrameRange, Protocol};
    use crate::frame::{BusIndex, CanId, Frame, Timestamp};
    use crate::profile::{DataType, Field, Layout, Meaning, PdoDirection, PdoName};
    use crate::session::{BusDecoder, SessionOptions};
    use crate::sink::EventSink as _;
    use crate::wire::NodeId;
    use crate::wire::canopen::{NmtState, ObjectAddress};

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

    #[test]
    fn a_template_is_for_lines_with_equal_names() {
        let names = |bus, node, device| Names { bus, node, device };
        let known = names("can0", Some("boom"), None).owned();
        assert!(known.are(&names("can0", Some("boom"), None)));
        // The device is assigned later, when the node is identified.
        assert!(!known.are(&names("can0", Some("boom"), Some("cia402"))));
        assert!(!known.are(&names("can0", None, None)));
        assert!(!known.are(&names("can1", Some("boom"), None)));
    }

    #[test]
    fn numbers_are_overwritten_if_their_length_is_equal() {
        let event = |nanoseconds, frame| Event {
            time: Some(Timestamp(nanoseconds)),
            frames: FrameRange { first: frame, last: frame },
            protocol: Protocol::Canopen,
            ..Event::new(BusIndex(0), FrameRange::default(), EventKind::GuardRequest)
        };
        let bus = bus(0, "can0");
        let mut templates = LineTemplates::default();
        let mut line = Vec::new();
        let first = event(1_999_999_999, 98);
        let marks = write_line(&first, bus.bus(), None, &mut line);
        templates.learn(&first, bus.bus(), &line, marks);
        let mut filled = |nanoseconds, frame| {
            let slot = templates.fill(&event(nanoseconds, frame), bus.bus())?;
            Some(String::from_utf8(templates.line(slot).to_vec()).unwrap())
        };
        let expected = "{\"t\":2.000000001,\"bus\":\"can0\",\"frames\":[99,99],\"kind\":\"guard-request\",\
                        \"protocol\":\"canopen\"}\n";
        assert_eq!(filled(2_000_000_001, 99).unwrap(), expected);
        assert_eq!(filled(2_000_000_002, 100), None);
        assert_eq!(filled(10_000_000_000, 99), None);
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
