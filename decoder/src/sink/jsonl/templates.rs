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

use super::key::{KeyedEvent, LineTemplateKey, SLOTS};
use super::object::{JsonObjectWriter, LineOffsets};
use super::signals::SignalTemplates;
use std::sync::Arc;

use crate::ascii::{long_digits, nine_digits, push_hex, push_hex_word, short_digits};
use crate::event::{DecodedPdo, Event, EventKind};
use crate::profile::PayloadLayout;
use crate::query::record::visit_signals;
use crate::session::{Bus, Node};

/// Nanoseconds per second.
const SECOND: u64 = 1_000_000_000;

/// Decimals of a time.
const DECIMALS: usize = 9;

/// Length of `{"t":`, in bytes.
const SECONDS_START: usize = 5;

/// Names of the node that occur in a line.
#[derive(Debug, PartialEq, Eq)]
struct NodeNames {
    node: Option<Box<str>>,
    device: Option<Box<str>>,
}

/// Last line with its key and names.
struct LineTemplate {
    key: LineTemplateKey,
    names: NodeNames,
    /// Start of the second in the line, in ns.
    second: u64,
    /// Offset of the nine decimals of the time.
    decimals: usize,
    marks: LineOffsets,
    frames: FrameNumbers,
    line: Vec<u8>,
    signals: Option<SignalTemplates>,
}

/// Place of both frame numbers in a line, `118,118]`. Each number is written as eight bytes, with the constant bytes
/// after it.
struct FrameNumbers {
    start: usize,
    /// Digits of a number.
    digits: usize,
    /// Bytes after the digits of the first number, and after those of the second; zero in place of the digits.
    after: [u64; 2],
}

/// Templates of the lines written so far.
#[derive(Default)]
pub(super) struct LineTemplates {
    slots: Vec<Option<Box<LineTemplate>>>,
}

impl NodeNames {
    fn names_of(node: Option<&Node>) -> Self {
        Self {
            node: node.and_then(|node| node.name()).map(Into::into),
            device: node.and_then(|node| node.device_id()).map(Into::into),
        }
    }

    #[inline]
    fn are_of(&self, node: Option<&Node>) -> bool {
        self.node.as_deref() == node.and_then(|node| node.name())
            && self.device.as_deref() == node.and_then(|node| node.device_id())
    }
}

impl LineTemplates {
    /// Turns a template into the line of an event; `false` without a suitable template.
    #[inline]
    pub(super) fn fill_template(&mut self, keyed: &KeyedEvent, event: &Event, bus: &Bus) -> bool {
        let Some(Some(template)) = self.slots.get_mut(keyed.slot) else { return false };
        let is_filled = template.key == keyed.key
            && template.names.are_of(event.node.and_then(|node| bus.node(node)))
            && template.set_time(keyed.time)
            && template.set_frame(event.frames.last);
        if is_filled && let EventKind::Pdo(pdo) = &event.kind {
            template.set_payload(pdo);
        }
        is_filled
    }

    /// The line in a slot.
    #[inline]
    pub(super) fn line_in_slot(&self, slot: usize) -> &[u8] {
        match self.slots.get(slot) {
            Some(Some(template)) => &template.line,
            _ => &[],
        }
    }

    /// Makes a template of a line of the general writer.
    #[cold]
    pub(super) fn learn_template(
        &mut self,
        keyed: &KeyedEvent,
        event: &Event,
        bus: &Bus,
        line: &[u8],
        marks: LineOffsets,
    ) {
        if self.slots.is_empty() {
            self.slots.resize_with(SLOTS, || None);
        }
        let Some(slot) = self.slots.get_mut(keyed.slot) else { return };
        *slot = Some(Box::new(LineTemplate {
            key: keyed.key,
            names: NodeNames::names_of(event.node.and_then(|node| bus.node(node))),
            second: keyed.time - keyed.time % SECOND,
            decimals: marks.behind_time.saturating_sub(DECIMALS),
            marks,
            frames: FrameNumbers::numbers_in(line, marks),
            line: line.to_vec(),
            signals: slot.take().and_then(|earlier| earlier.signals),
        }));
    }
}

impl LineTemplate {
    /// Overwrites the time; `false` if the number of digits differs.
    #[inline]
    fn set_time(&mut self, time: u64) -> bool {
        let mut nanoseconds = time.wrapping_sub(self.second);
        if nanoseconds >= SECOND {
            nanoseconds = time % SECOND;
            if !self.set_second(time - nanoseconds) {
                return false;
            }
        }
        let decimals = self.line.get_mut(self.decimals..).and_then(|rest| rest.first_chunk_mut());
        decimals.map(|decimals| *decimals = nine_digits(nanoseconds)).is_some()
    }

    /// Overwrites the seconds; `false` if the number of digits differs.
    #[inline(never)]
    fn set_second(&mut self, second: u64) -> bool {
        self.second = second;
        self.set_number(SECONDS_START, self.decimals.saturating_sub(1), second / SECOND)
    }

    /// Overwrites both frame numbers; `false` if the number of digits differs.
    #[inline]
    fn set_frame(&mut self, frame: u64) -> bool {
        let FrameNumbers { start, digits, after: [after_first, after_second] } = self.frames;
        let Some((text, length)) = short_digits(frame) else { return self.set_long_frame(frame) };
        length == digits
            && self.set_word(start, text | after_first)
            && self.set_word(start + digits + 1, text | after_second)
    }

    /// Overwrites eight bytes of the line.
    #[inline]
    fn set_word(&mut self, start: usize, word: u64) -> bool {
        let bytes = self.line.get_mut(start..).and_then(|rest| rest.first_chunk_mut());
        bytes.map(|bytes| *bytes = word.to_le_bytes()).is_some()
    }

    #[inline(never)]
    fn set_long_frame(&mut self, frame: u64) -> bool {
        let FrameNumbers { start, digits, .. } = self.frames;
        let second = start + digits + 1;
        self.set_number(start, start + digits, frame) && self.set_number(second, second + digits, frame)
    }

    /// Overwrites a number of the line; `false` if it has another number of digits.
    fn set_number(&mut self, start: usize, end: usize, number: u64) -> bool {
        let (digits, first) = long_digits(number);
        let digits = digits.get(first..).unwrap_or_default();
        let part = self.line.get_mut(start..end).filter(|part| part.len() == digits.len());
        part.map(|part| part.copy_from_slice(digits)).is_some()
    }

    /// Replaces the payload and all after it.
    #[inline]
    fn set_payload(&mut self, pdo: &DecodedPdo) {
        let line = &mut self.line;
        line.truncate(self.marks.data);
        match pdo.bytes.first_chunk() {
            Some(bytes) if pdo.length <= 8 => push_hex_word(line, *bytes, usize::from(pdo.length)),
            _ => push_hex(line, pdo.payload()),
        }
        match &pdo.layout {
            None => line.extend_from_slice(b"\"}\n"),
            Some(layout) => self.push_signals(pdo, layout),
        }
    }

    /// Appends the end of the payload, and the signals.
    #[inline(never)]
    fn push_signals(&mut self, pdo: &DecodedPdo, layout: &Arc<PayloadLayout>) {
        self.line.push(b'"');
        if let (Some(signals), Some(bytes)) = (&mut self.signals, pdo.bytes.first_chunk())
            && signals.are_of(layout, usize::from(pdo.length))
        {
            signals.write_signals(*bytes, &mut self.line);
            return self.line.extend_from_slice(b"}\n");
        }
        push_new_signals(pdo, layout, &mut self.signals, &mut self.line);
    }
}

impl FrameNumbers {
    fn numbers_in(line: &[u8], marks: LineOffsets) -> Self {
        let start = marks.frames;
        let digits = marks.behind_frames.saturating_sub(start) / 2;
        let after = |number: usize| {
            let word = line.get(number..).and_then(|rest| rest.first_chunk());
            let kept = u64::MAX.unbounded_shl(u32::try_from(digits * 8).unwrap_or(u32::MAX));
            word.map_or(0, |word| u64::from_le_bytes(*word) & kept)
        };
        Self { start, digits, after: [after(start), after(start + digits + 1)] }
    }
}

/// Writes signals with the general writer, and prepares the cache for the next ones.
#[cold]
fn push_new_signals(
    pdo: &DecodedPdo,
    layout: &Arc<PayloadLayout>,
    prepared: &mut Option<SignalTemplates>,
    line: &mut Vec<u8>,
) {
    let mut object = JsonObjectWriter::resume_object(line);
    visit_signals(layout, pdo.payload(), &mut object);
    object.end_object();
    if !prepared.as_ref().is_some_and(|prepared| prepared.is_of(layout)) {
        *prepared = SignalTemplates::templates_of(layout);
    }
}

#[cfg(test)]
mod tests {
    use std::sync::Arc;

    use proptest::option;
    use proptest::prelude::*;

    use super::super::{JsonlSink, write_line};
    use super::*;
    use crate::event::{EventProtocol, FrameRange};
    use crate::frame::{BusIndex, CanId, Frame, Timestamp};
    use crate::profile::{
        DataType, LayoutOrigin, ObjectMeaning, PayloadLayout, PdoDirection, PdoName, SignalField,
    };
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
            bus.push(
                &Frame::data_frame(CanId::from_standard(0x700 + node), &[5]),
                &mut |_: &Event, _: &Bus| {},
            );
        }
        bus
    }

    fn layout() -> Arc<PayloadLayout> {
        let field = |bit, bits, data_type| SignalField {
            meaning: Some(Arc::new(ObjectMeaning { name: "Statusword".into(), ..ObjectMeaning::default() })),
            ..SignalField::of_object(ObjectAddress::new(0x6041, 0), bit, bits, data_type)
        };
        let fields = vec![field(0, 16, DataType::Unsigned16), field(16, 32, DataType::Real32)];
        Arc::new(PayloadLayout {
            fields,
            bits: 48,
            origin: LayoutOrigin::Wire,
            assumed: true,
            ..PayloadLayout::default()
        })
    }

    #[test]
    fn a_template_is_for_lines_with_equal_names() {
        let bus = bus(0, "can0");
        let names = |node: Option<&str>, device: Option<&str>| NodeNames {
            node: node.map(Into::into),
            device: device.map(Into::into),
        };
        let node = bus.bus().node(3);
        assert!(names(Some("jib0"), None).are_of(node));
        assert!(!names(Some("jib1"), None).are_of(node) && !names(None, None).are_of(node));
        assert!(names(None, None).are_of(None));
        // The device is assigned later, when the node is identified.
        assert!(!names(Some("jib0"), Some("cia402")).are_of(node));
    }

    #[test]
    fn numbers_are_overwritten_if_their_length_is_equal() {
        let event = |nanoseconds, frame| Event {
            time: Some(Timestamp(nanoseconds)),
            frames: FrameRange { first: frame, last: frame },
            protocol: EventProtocol::Canopen,
            ..Event::new(BusIndex(0), FrameRange::default(), EventKind::GuardRequest)
        };
        let bus = bus(0, "can0");
        let mut templates = LineTemplates::default();
        let mut line = Vec::new();
        let first = event(1_999_999_999, 98);
        let marks = write_line(&first, bus.bus(), None, &mut line);
        let keyed = |event: &Event| KeyedEvent::key_event(event, bus.bus()).unwrap();
        templates.learn_template(&keyed(&first), &first, bus.bus(), &line, marks);
        let mut filled = |nanoseconds, frame| {
            let event = event(nanoseconds, frame);
            let is_filled = templates.fill_template(&keyed(&event), &event, bus.bus());
            let line = || String::from_utf8(templates.line_in_slot(keyed(&event).slot).to_vec()).unwrap();
            is_filled.then(line)
        };
        let expected = "{\"t\":2.000000001,\"bus\":\"can0\",\"frames\":[99,99],\"kind\":\"guard-request\",\
                        \"protocol\":\"canopen\"}\n";
        assert_eq!(filled(2_000_000_001, 99).unwrap(), expected);
        assert_eq!(filled(2_000_000_002, 100), None);
        assert_eq!(filled(10_000_000_000, 99), None);

        let long = event(1, 12_345_678);
        line.clear();
        let marks = write_line(&long, bus.bus(), None, &mut line);
        templates.learn_template(&keyed(&long), &long, bus.bus(), &line, marks);
        let next = event(2, 99_999_999);
        assert!(templates.fill_template(&keyed(&next), &next, bus.bus()));
        let mut expected = Vec::new();
        write_line(&next, bus.bus(), None, &mut expected);
        assert_eq!(templates.line_in_slot(keyed(&next).slot), expected);
        assert!(!templates.fill_template(&keyed(&event(2, 100_000_000)), &event(2, 100_000_000), bus.bus()));
    }

    fn pdo() -> impl Strategy<Value = EventKind> {
        let names = (any::<bool>(), 1_u16..6).prop_map(|(sends, number)| PdoName {
            direction: if sends { PdoDirection::Transmit } else { PdoDirection::Receive },
            number,
        });
        let ids = prop_oneof![
            4 => (0x180_u16..0x188).prop_map(CanId::from_standard),
            1 => any::<u32>().prop_map(CanId::from_extended),
        ];
        let rest =
            (prop_oneof![4 => 0_u8..=8, 1 => 9_u8..=64], any::<[u8; 32]>(), any::<bool>(), any::<bool>());
        (names, ids, rest).prop_map(|(name, cob_id, (length, half, is_request, has_layout))| {
            let mut bytes = [0; 64];
            bytes[..32].copy_from_slice(&half);
            let layout = has_layout.then(layout);
            EventKind::Pdo(DecodedPdo { name, cob_id, is_request, length, bytes, layout })
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
                protocol: EventProtocol::Canopen,
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
            let buses = [bus(0, "can0"), bus(1, "can1"), bus(2, "a \"bus\"")];
            for capture in [None, Some("two.log")] {
                let mut jsonl = JsonlSink::new(Vec::new());
                if let Some(name) = capture {
                    jsonl.begin_capture(name);
                }
                let mut expected = Vec::new();
                // Twice, so that most lines are cached in the second pass.
                for (event, place) in events.iter().chain(&events) {
                    jsonl.write_event(event, buses[*place].bus());
                    write_line(event, buses[*place].bus(), capture, &mut expected);
                }
                prop_assert_eq!(String::from_utf8(jsonl.output).unwrap(), String::from_utf8(expected).unwrap());
            }
        }
    }
}
