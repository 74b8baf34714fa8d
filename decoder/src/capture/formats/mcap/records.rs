//! Converts schemas, channels and messages to frames.

use std::collections::HashMap;
use std::sync::Arc;

use super::key::{self, LIBRARY};
use super::layout::Layout;
use super::message::{self, Encoding};
use super::record::{self, HEAD, Kind};
use crate::capture::remark::Remark;
use crate::capture::{Batch, BusNames, CapturePlace, MAX_BUS_NAME, MAX_BUSES, Notice};
use crate::frame::{BusIndex, Frame, FrameFlags, Timestamp};
use crate::words::plural;

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
pub(super) struct Records {
    pub(super) buses: BusNames,
    layouts: Arc<HashMap<u16, Option<Arc<Layout>>>>,
    channels: Arc<HashMap<u16, Channel>>,
    frames: u64,
    /// Number of messages.
    messages: u64,
    /// Number of messages without a CAN frame.
    others: u64,
    said_others: bool,
    /// Whether the file was written by cobscope, so that its metadata has a known meaning.
    is_own: bool,
}

/// Content of a channel.
#[derive(Clone)]
enum Channel {
    /// CAN frames.
    Frames(Source),
    /// Notices written by cobscope.
    Notices,
    /// Other content.
    Other,
}

#[derive(Clone)]
struct Source {
    layout: Arc<Layout>,
    encoding: Encoding,
    /// Bus name, if the channel states it; then the bus index, set by the first frame.
    name: Vec<u8>,
    bus: Option<BusIndex>,
    flags: FrameFlags,
    stamp: Stamp,
}

/// Source of a frame's time.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum Stamp {
    /// Header of the message; if it is empty, the time of recording.
    Header,
    /// Time of recording, in nanoseconds.
    Logged,
    /// The frame has no time.
    None,
}

impl Records {
    /// Handles a record other than a chunk.
    pub(super) fn take(&mut self, kind: Kind, contents: &[u8], at: u64, batch: &mut Batch) {
        let known = match kind {
            Kind::Schema => record::schema(contents).map(|schema| self.schema(&schema)),
            Kind::Channel => record::channel(contents).map(|channel| self.channel(&channel)),
            Kind::Message => record::message(contents).map(|message| self.message(&message, at, batch)),
            Kind::Header => {
                record::library(contents).map(|library| self.is_own = library == LIBRARY.as_bytes())
            }
            Kind::Statistics => record::messages(contents).map(|count| self.compare(count, at, batch)),
            Kind::Footer | Kind::Chunk | Kind::Other | Kind::Unknown(_) => Some(()),
        };
        if known.is_none() {
            let what = match kind {
                Kind::Schema => "schema",
                Kind::Channel => "channel",
                Kind::Header => "header",
                Kind::Statistics => "statistics",
                _ => "message",
            };
            batch.push_unreadable(CapturePlace::Offset(at), format!("{what}: shorter than its fields"));
        }
    }

    /// Handles the records of a chunk from offset `done`; `false` if the batch is full before the last
    /// record.
    pub(super) fn run(&mut self, records: &[u8], done: &mut usize, at: u64, batch: &mut Batch) -> bool {
        while let Some(rest) = records.get(*done..).filter(|rest| !rest.is_empty()) {
            if batch.is_full() {
                return false;
            }
            let head = record::head(rest).and_then(|(kind, length)| {
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
            self.take(kind, contents, at, batch);
            *done = done.saturating_add(end);
        }
        true
    }

    /// Compares the declared number of messages: an unreadable chunk is only visible in this number.
    fn compare(&self, count: u64, at: u64, batch: &mut Batch) {
        let found = self.messages;
        if count > found {
            batch.push_unreadable(
                CapturePlace::Offset(at),
                format!("statistics: found {found} messages; expected {count}"),
            );
        }
    }

    fn schema(&mut self, schema: &record::Schema<'_>) {
        let layout = match schema.encoding {
            b"ros2msg" | b"ros1msg" => Layout::of(schema.data).map(Arc::new),
            _ => None,
        };
        // The name is ignored: other names such as `dataspeed_can_msgs/msg/Frame` are accepted.
        let _ = schema.name;
        Arc::make_mut(&mut self.layouts).insert(schema.id, layout);
    }

    fn channel(&mut self, channel: &record::Channel<'_>) {
        let layout = self.layouts.get(&channel.schema).cloned().flatten();
        let encoding = match channel.encoding {
            b"cdr" => Some(Encoding::Cdr),
            b"ros1" => Some(Encoding::Ros1),
            _ => None,
        };
        let own = channel.says(key::COBSCOPE);
        let known = match (layout.zip(encoding), own) {
            (_, Some(own)) if own == key::NOTICES.as_bytes() => Channel::Notices,
            (Some((layout, encoding)), Some(_)) => Channel::Frames(own_source(channel, layout, encoding)),
            (Some((layout, encoding)), None) => {
                Channel::Frames(foreign_source(channel.topic, layout, encoding))
            }
            (None, _) => Channel::Other,
        };
        // Files repeat their channels; keep the bus index of a repeated one.
        if let (Some(Channel::Frames(before)), Channel::Frames(now)) =
            (self.channels.get(&channel.id), &known)
            && before.name == now.name
            && before.flags == now.flags
        {
            return;
        }
        Arc::make_mut(&mut self.channels).insert(channel.id, known);
    }

    fn message(&mut self, message: &record::Message<'_>, at: u64, batch: &mut Batch) {
        self.messages += 1;
        match self.channels.get(&message.channel) {
            Some(Channel::Frames(source)) => {
                let found = message::read(&source.layout, source.encoding, message.data);
                match found {
                    Ok(found) => self.frame(message, &found, at, batch),
                    Err(reason) => batch.push_unreadable(CapturePlace::Offset(at), reason.into()),
                }
            }
            Some(Channel::Notices) => self.notice(message, at, batch),
            Some(Channel::Other) => self.others += 1,
            None => {
                let number = message.channel;
                batch.push_unreadable(
                    CapturePlace::Offset(at),
                    format!("message of undefined channel {number}"),
                );
            }
        }
    }

    fn frame(
        &mut self,
        message: &record::Message<'_>,
        found: &message::MessageFrame<'_>,
        at: u64,
        batch: &mut Batch,
    ) {
        let Some(Channel::Frames(source)) = self.channels.get(&message.channel) else { return };
        let known = source.bus;
        let name = if source.name.is_empty() { found.bus } else { &source.name };
        let logged = Timestamp(i64::try_from(message.log_time).unwrap_or(i64::MAX));
        let time = match source.stamp {
            Stamp::None => None,
            Stamp::Logged => Some(logged),
            Stamp::Header => Some(found.stamp.map_or(logged, Timestamp)),
        };
        let flags = found.frame.flags.with(source.flags);
        let is_fixed = !source.name.is_empty();
        let bus = known.or_else(|| self.buses.index_of(if name.is_empty() { b"can" } else { name }));
        let Some(bus) = bus else {
            return batch.push_unreadable(CapturePlace::Offset(at), format!("more than {MAX_BUSES} buses"));
        };
        if known.is_none()
            && is_fixed
            && let Some(Channel::Frames(source)) = Arc::make_mut(&mut self.channels).get_mut(&message.channel)
        {
            source.bus = Some(bus);
        }
        self.frames += 1;
        batch.push(Frame { number: self.frames, time, bus, flags, ..found.frame });
    }

    fn notice(&mut self, message: &record::Message<'_>, at: u64, batch: &mut Batch) {
        let value: serde_json::Value = serde_json::from_slice(message.data).unwrap_or_default();
        let text = |key: &str| value.get(key).and_then(serde_json::Value::as_str).unwrap_or_default();
        let time = Timestamp(i64::try_from(message.log_time).unwrap_or(i64::MAX));
        // Messages for people also refer to nodes, whose names are not bus names.
        let Some(remark) = Remark::parse(text("message").as_bytes()) else { return };
        let Some(bus) = self.buses.index_of(text("name").as_bytes()) else { return };
        let place = CapturePlace::Offset(at);
        batch.notice(match remark {
            Remark::Link(state, bit_rate) => Notice::Link { bus, time, state, bit_rate },
            Remark::Quiet => Notice::Quiet(time),
            Remark::ClockSet(step) => Notice::ClockSet { bus, time, step },
            Remark::Lost(count) => Notice::LostFrames { place, bus, count },
        });
    }

    /// Reports the skipped messages at the end.
    pub(super) fn summarise(&mut self, batch: &mut Batch) {
        if self.others > 0 && !self.is_own && !std::mem::replace(&mut self.said_others, true) {
            let text = format!("{} of topics without CAN frames skipped", plural(self.others, "message"));
            batch.notice(Notice::Assumption(text));
        }
    }
}

/// Source of frames written by cobscope.
fn own_source(channel: &record::Channel<'_>, layout: Arc<Layout>, encoding: Encoding) -> Source {
    let is = |key, value: &[u8]| channel.says(key) == Some(value);
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
    let stamp = if is(key::TIME, b"none") { Stamp::None } else { Stamp::Logged };
    let name = cut(channel.says(key::BUS).unwrap_or_default());
    Source { layout, encoding, name, bus: None, flags, stamp }
}

/// Source of frames from a topic of ROS, which is named after the bus.
fn foreign_source(topic: &[u8], layout: Arc<Layout>, encoding: Encoding) -> Source {
    let topic = topic.strip_prefix(b"/").unwrap_or(topic);
    let end = memchr::memrchr(b'/', topic).map_or(0, |at| at + 1);
    let (before, last) = topic.split_at_checked(end).unwrap_or_default();
    let found = ENDS.iter().find(|(end, _)| *end == last);
    let name = if found.is_some() { before.strip_suffix(b"/").unwrap_or_default() } else { topic };
    let flags = found.and_then(|(_, direction)| *direction).unwrap_or_default();
    Source { layout, encoding, name: cut(name), bus: None, flags, stamp: Stamp::Header }
}

fn cut(name: &[u8]) -> Vec<u8> {
    name.get(..MAX_BUS_NAME).unwrap_or(name).to_vec()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn buses_of_ros_are_called_after_their_topics() {
        let layout = Arc::new(Layout::of(include_bytes!("frame.msg")).unwrap());
        for (topic, name, flags) in [
            ("/can0/from_can_bus", "can0", FrameFlags::RECEIVED),
            ("/front/can1/to_can_bus", "front/can1", FrameFlags::TRANSMITTED),
            ("/from_can_bus_fd", "", FrameFlags::RECEIVED),
            ("/vehicle/can", "vehicle/can", FrameFlags::default()),
            ("sent_messages", "", FrameFlags::TRANSMITTED),
        ] {
            let source = foreign_source(topic.as_bytes(), Arc::clone(&layout), Encoding::Cdr);
            assert_eq!((source.name.as_slice(), source.flags), (name.as_bytes(), flags), "{topic}");
        }
    }
}
