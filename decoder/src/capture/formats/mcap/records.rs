//! Converts schemas, channels and messages to frames.

use std::collections::HashMap;
use std::sync::Arc;

use super::key::{self, LIBRARY};
use super::layout::CanMessageLayout;
use super::message::{self, FieldEncoding};
use super::record::{self, HEAD, RecordType};
use crate::capture::remark::CommentRemark;
use crate::capture::{Batch, BusNames, CapturePlace, MAX_BUS_NAME, MAX_BUSES, Notice};
use crate::frame::{BusIndex, Frame, FrameFlags, Timestamp};
use crate::words::count_noun;

/// Last parts of topic names that describe the content and not the bus, from ros2_socketcan and the ROS 1
/// package socketcan_bridge. The directions are those of the host.
const ENDS: &[(&[u8], Option<FrameFlags>)] = &[
    (b"from_can_bus", Some(FrameFlags::RECEIVED)),
    (b"from_can_bus_fd", Some(FrameFlags::RECEIVED)),
    (b"to_can_bus", Some(FrameFlags::TRANSMITTED)),
    (b"to_can_bus_fd", Some(FrameFlags::TRANSMITTED)),
    (b"received_messages", Some(FrameFlags::RECEIVED)),
    (b"sent_messages", Some(FrameFlags::TRANSMITTED)),
    (b"can_rx", Some(FrameFlags::RECEIVED)),
    (b"can_tx", Some(FrameFlags::TRANSMITTED)),
];

/// State of the topics of a file.
#[derive(Clone, Default)]
pub(super) struct TopicRecords {
    pub(super) buses: BusNames,
    layouts: Arc<HashMap<u16, Option<Arc<CanMessageLayout>>>>,
    channels: Arc<HashMap<u16, ChannelContent>>,
    frames: u64,
    /// Number of messages.
    messages: u64,
    /// Number of messages without a CAN frame.
    others: u64,
    stated_others: bool,
    /// Whether the file was written by cobscope, so that its metadata has a known meaning.
    is_own: bool,
}

/// Content of a channel.
#[derive(Clone)]
enum ChannelContent {
    /// CAN frames.
    Frames(TopicSource),
    /// Notices written by cobscope.
    Notices,
    /// Other content.
    Other,
}

#[derive(Clone)]
struct TopicSource {
    layout: Arc<CanMessageLayout>,
    encoding: FieldEncoding,
    /// Bus name, if the channel states it; then the bus index, set by the first frame.
    name: Vec<u8>,
    bus: Option<BusIndex>,
    flags: FrameFlags,
    stamp: FrameTimeSource,
}

/// Source of a frame's time.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum FrameTimeSource {
    /// Header of the message; if it is empty, the time of recording.
    Header,
    /// Time of recording, in nanoseconds.
    Logged,
    /// The frame has no time.
    None,
}

impl TopicRecords {
    /// Handles a record other than a chunk.
    pub(super) fn on_record(&mut self, kind: RecordType, contents: &[u8], at: u64, batch: &mut Batch) {
        let known = match kind {
            RecordType::Schema => record::parse_schema(contents).map(|schema| self.on_schema(&schema)),
            RecordType::Channel => record::parse_channel(contents).map(|channel| self.on_channel(&channel)),
            RecordType::Message => {
                record::parse_message(contents).map(|message| self.on_message(&message, at, batch))
            }
            RecordType::Header => {
                record::parse_library(contents).map(|library| self.is_own = library == LIBRARY.as_bytes())
            }
            RecordType::Statistics => {
                record::parse_message_count(contents).map(|count| self.compare_count(count, at, batch))
            }
            RecordType::Footer | RecordType::Chunk | RecordType::Other | RecordType::Unknown(_) => Some(()),
        };
        if known.is_none() {
            let what = match kind {
                RecordType::Schema => "schema",
                RecordType::Channel => "channel",
                RecordType::Header => "header",
                RecordType::Statistics => "statistics",
                _ => "message",
            };
            batch.push_unreadable(CapturePlace::Offset(at), format!("{what}: shorter than its fields"));
        }
    }

    /// Handles the records of a chunk from offset `done`; `false` if the batch is full before the last
    /// record.
    pub(super) fn run_chunk(&mut self, records: &[u8], done: &mut usize, at: u64, batch: &mut Batch) -> bool {
        while let Some(rest) = records.get(*done..).filter(|rest| !rest.is_empty()) {
            if batch.is_full() {
                return false;
            }
            let head = record::parse_head(rest).and_then(|(kind, length)| {
                let end = HEAD.checked_add(usize::try_from(length).ok()?)?;
                Some((kind, rest.get(HEAD..end)?, end))
            });
            let Some((kind, contents, end)) = head else {
                let left = rest.len();
                batch.push_unreadable(
                    CapturePlace::Offset(at),
                    format!("chunk: incomplete record of {left} bytes at its end"),
                );
                *done = records.len();
                return true;
            };
            self.on_record(kind, contents, at, batch);
            *done = done.saturating_add(end);
        }
        true
    }

    /// Compares the declared number of messages: an unreadable chunk is only visible in this number.
    fn compare_count(&self, count: u64, at: u64, batch: &mut Batch) {
        let found = self.messages;
        if count > found {
            batch.push_unreadable(
                CapturePlace::Offset(at),
                format!("statistics: found {found} messages; expected {count}"),
            );
        }
    }

    fn on_schema(&mut self, schema: &record::TopicSchema<'_>) {
        let layout = match schema.encoding {
            b"ros2msg" | b"ros1msg" => CanMessageLayout::parse_definition(schema.data).map(Arc::new),
            _ => None,
        };
        // The name is ignored: other names such as `dataspeed_can_msgs/msg/Frame` are accepted.
        let _ = schema.name;
        Arc::make_mut(&mut self.layouts).insert(schema.id, layout);
    }

    fn on_channel(&mut self, channel: &record::TopicChannel<'_>) {
        let layout = self.layouts.get(&channel.schema).cloned().flatten();
        let encoding = match channel.encoding {
            b"cdr" => Some(FieldEncoding::Cdr),
            b"ros1" => Some(FieldEncoding::Ros1),
            _ => None,
        };
        let own = channel.metadata_value(key::COBSCOPE);
        let known = match (layout.zip(encoding), own) {
            (_, Some(own)) if own == key::NOTICES.as_bytes() => ChannelContent::Notices,
            (Some((layout, encoding)), Some(_)) => {
                ChannelContent::Frames(own_source(channel, layout, encoding))
            }
            (Some((layout, encoding)), None) => {
                ChannelContent::Frames(foreign_source(channel.topic, layout, encoding))
            }
            (None, _) => ChannelContent::Other,
        };
        // Files repeat their channels; keep the bus index of a repeated one.
        if let (Some(ChannelContent::Frames(before)), ChannelContent::Frames(now)) =
            (self.channels.get(&channel.id), &known)
            && before.name == now.name
            && before.flags == now.flags
        {
            return;
        }
        Arc::make_mut(&mut self.channels).insert(channel.id, known);
    }

    fn on_message(&mut self, message: &record::McapMessage<'_>, at: u64, batch: &mut Batch) {
        self.messages += 1;
        match self.channels.get(&message.channel) {
            Some(ChannelContent::Frames(source)) => {
                let found = message::read_message(&source.layout, source.encoding, message.data);
                match found {
                    Ok(found) => self.add_frame(message, &found, at, batch),
                    Err(reason) => batch.push_unreadable(CapturePlace::Offset(at), reason.into()),
                }
            }
            Some(ChannelContent::Notices) => self.add_notice(message, at, batch),
            Some(ChannelContent::Other) => self.others += 1,
            None => {
                let number = message.channel;
                batch.push_unreadable(
                    CapturePlace::Offset(at),
                    format!("message of undefined channel {number}"),
                );
            }
        }
    }

    fn add_frame(
        &mut self,
        message: &record::McapMessage<'_>,
        found: &message::MessageFrame<'_>,
        at: u64,
        batch: &mut Batch,
    ) {
        let Some(ChannelContent::Frames(source)) = self.channels.get(&message.channel) else { return };
        let known = source.bus;
        let name = if source.name.is_empty() { found.bus } else { &source.name };
        let logged = Timestamp(i64::try_from(message.log_time).unwrap_or(i64::MAX));
        let time = match source.stamp {
            FrameTimeSource::None => None,
            FrameTimeSource::Logged => Some(logged),
            FrameTimeSource::Header => Some(found.stamp.map_or(logged, Timestamp)),
        };
        let flags = found.frame.flags.with(source.flags);
        let is_fixed = !source.name.is_empty();
        let bus = known.or_else(|| self.buses.index_of(if name.is_empty() { b"can" } else { name }));
        let Some(bus) = bus else {
            return batch.push_unreadable(CapturePlace::Offset(at), format!("more than {MAX_BUSES} buses"));
        };
        if known.is_none()
            && is_fixed
            && let Some(ChannelContent::Frames(source)) =
                Arc::make_mut(&mut self.channels).get_mut(&message.channel)
        {
            source.bus = Some(bus);
        }
        self.frames += 1;
        batch.push(Frame { number: self.frames, time, bus, flags, ..found.frame });
    }

    fn add_notice(&mut self, message: &record::McapMessage<'_>, at: u64, batch: &mut Batch) {
        let value: serde_json::Value = serde_json::from_slice(message.data).unwrap_or_default();
        let text = |key: &str| value.get(key).and_then(serde_json::Value::as_str).unwrap_or_default();
        let time = Timestamp(i64::try_from(message.log_time).unwrap_or(i64::MAX));
        // Messages for people also refer to nodes, whose names are not bus names.
        let Some(remark) = CommentRemark::parse(text("message").as_bytes()) else { return };
        let Some(bus) = self.buses.index_of(text("name").as_bytes()) else { return };
        let place = CapturePlace::Offset(at);
        batch.add_notice(match remark {
            CommentRemark::Link(state, bit_rate) => Notice::Link { bus, time, state, bit_rate },
            CommentRemark::Quiet => Notice::Quiet(time),
            CommentRemark::ClockSet(step) => Notice::ClockSet { bus, time, step },
            CommentRemark::Lost(count) => Notice::LostFrames { place, bus, count },
        });
    }

    /// Reports the skipped messages at the end.
    pub(super) fn report_skipped(&mut self, batch: &mut Batch) {
        if self.others > 0 && !self.is_own && !std::mem::replace(&mut self.stated_others, true) {
            let text = format!("{} of topics without CAN frames skipped", count_noun(self.others, "message"));
            batch.add_notice(Notice::Assumption(text));
        }
    }
}

/// Source of frames written by cobscope.
fn own_source(
    channel: &record::TopicChannel<'_>,
    layout: Arc<CanMessageLayout>,
    encoding: FieldEncoding,
) -> TopicSource {
    let is = |key, value: &[u8]| channel.metadata_value(key) == Some(value);
    let set = [
        (is(key::DIRECTION, b"rx"), FrameFlags::RECEIVED),
        (is(key::DIRECTION, b"tx"), FrameFlags::TRANSMITTED),
        (layout.is_fd && is(key::SWITCHED, b"1"), FrameFlags::BIT_RATE_SWITCH),
        (layout.is_fd && is(key::PASSIVE, b"1"), FrameFlags::ERROR_STATE),
    ];
    let flags = set
        .iter()
        .filter(|(is_set, _)| *is_set)
        .fold(FrameFlags::default(), |all, (_, flag)| all.with(*flag));
    let stamp = if is(key::TIME, b"none") { FrameTimeSource::None } else { FrameTimeSource::Logged };
    let name = cut_name(channel.metadata_value(key::BUS).unwrap_or_default());
    TopicSource { layout, encoding, name, bus: None, flags, stamp }
}

/// Source of frames from a topic of ROS, which is named after the bus.
fn foreign_source(topic: &[u8], layout: Arc<CanMessageLayout>, encoding: FieldEncoding) -> TopicSource {
    let topic = topic.strip_prefix(b"/").unwrap_or(topic);
    let end = memchr::memrchr(b'/', topic).map_or(0, |at| at + 1);
    let (before, last) = topic.split_at_checked(end).unwrap_or_default();
    let found = ENDS.iter().find(|(end, _)| *end == last);
    let name = if found.is_some() { before.strip_suffix(b"/").unwrap_or_default() } else { topic };
    let flags = found.and_then(|(_, direction)| *direction).unwrap_or_default();
    TopicSource { layout, encoding, name: cut_name(name), bus: None, flags, stamp: FrameTimeSource::Header }
}

fn cut_name(name: &[u8]) -> Vec<u8> {
    name.get(..MAX_BUS_NAME).unwrap_or(name).to_vec()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn buses_of_ros_are_called_after_their_topics() {
        let layout = Arc::new(CanMessageLayout::parse_definition(include_bytes!("frame.msg")).unwrap());
        for (topic, name, flags) in [
            ("/can0/from_can_bus", "can0", FrameFlags::RECEIVED),
            ("/front/can1/to_can_bus", "front/can1", FrameFlags::TRANSMITTED),
            ("/from_can_bus_fd", "", FrameFlags::RECEIVED),
            ("/vehicle/can", "vehicle/can", FrameFlags::default()),
            ("sent_messages", "", FrameFlags::TRANSMITTED),
        ] {
            let source = foreign_source(topic.as_bytes(), Arc::clone(&layout), FieldEncoding::Cdr);
            assert_eq!((source.name.as_slice(), source.flags), (name.as_bytes(), flags), "{topic}");
        }
    }
}
