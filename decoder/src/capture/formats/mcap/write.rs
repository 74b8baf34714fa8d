//! Writer of MCAP, based on the `mcap` crate.

use std::collections::BTreeMap;
use std::io::{self, Write};

use mcap::records::MessageHeader;
use mcap::write::{Metadata, NoSeek};
use mcap::{Attachment, Compression, McapError, McapResult};
use serde_json::json;

use super::key::{self, LIBRARY};
use crate::capture::remark::CommentRemark;
use crate::capture::{CaptureCompression, FrameWriter, Notice};
use crate::frame::{CanId, Frame, FrameFlags, Timestamp};

/// Size of a chunk before compression, in bytes: the usual size of other writers.
const CHUNK: u64 = 1024 * 1024;

/// Overhead of a message in bytes: record head, header and index entry.
const AROUND_MESSAGE: u64 = 9 + 22 + 16;

/// Overhead of a chunk in bytes, with its index.
const AROUND_CHUNK: u64 = 256;

/// Levels of `foxglove.Log`.
const INFO: u8 = 2;
const WARNING: u8 = 3;

/// Writer of MCAP: frames and other messages.
pub(crate) struct McapWriter<W: Write> {
    /// The file, or the error that prevented its start (`None` once returned).
    file: Result<mcap::Writer<NoSeek<W>>, Option<io::Error>>,
    sources: Vec<FrameChannel>,
    /// Index of the source of the previous frame.
    last: usize,
    log: Option<WrittenTopic>,
    time: u64,
    pending: u64,
    has_finished: bool,
}

/// A topic to which messages are written.
#[derive(Debug, Clone, Copy)]
pub(crate) struct WrittenTopic {
    channel: u16,
    sequence: u32,
}

/// A channel of frames.
struct FrameChannel {
    bus: String,
    kind: MessageTemplate,
    topic: WrittenTopic,
    /// Template of its messages; the fields of a frame are filled in.
    message: Vec<u8>,
}

/// Properties of a frame that are stored in its channel.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
struct MessageTemplate {
    flags: u8,
    has_time: bool,
}

/// Flags stored in the channel; the other flags are stored in the message.
const OF_CHANNEL: FrameFlags = FrameFlags::FD
    .with(FrameFlags::BIT_RATE_SWITCH)
    .with(FrameFlags::ERROR_STATE)
    .with(FrameFlags::TRANSMITTED)
    .with(FrameFlags::RECEIVED);

impl MessageTemplate {
    fn template_of(frame: &Frame) -> Self {
        Self { flags: frame.flags.0 & OF_CHANNEL.0, has_time: frame.time.is_some() }
    }

    fn is_fd(self) -> bool {
        self.flags & FrameFlags::FD.0 != 0
    }
}

impl<W: Write> McapWriter<W> {
    /// Starts a file. An error is returned by the first write.
    pub fn new(output: W, packing: CaptureCompression) -> Self {
        let compression = match packing {
            CaptureCompression::None => None,
            CaptureCompression::Lz4 => Some(Compression::Lz4),
            CaptureCompression::Zstd => Some(Compression::Zstd),
        };
        let options = mcap::WriteOptions::new()
            .compression(compression)
            .compression_threads(0)
            .compression_level(u32::from(packing == CaptureCompression::Zstd))
            .chunk_size(Some(CHUNK))
            // Each chunk has its own checksum; a second checksum of the same bytes would double the cost.
            .calculate_data_section_crc(false)
            .library(LIBRARY)
            .disable_seeking(true);
        let file = options.create(NoSeek::new(output)).map_err(|error| Some(to_io(error)));
        Self { file, sources: Vec::new(), last: 0, log: None, time: 0, pending: 0, has_finished: false }
    }

    fn open_file(&mut self) -> io::Result<&mut mcap::Writer<NoSeek<W>>> {
        match &mut self.file {
            Ok(file) if !self.has_finished => Ok(file),
            Ok(_) => Err(io::Error::other("the capture is finished")),
            Err(error) => {
                Err(error.take().unwrap_or_else(|| io::Error::other("the capture could not be started")))
            }
        }
    }

    /// Creates a topic of JSON objects. `schema` is their JSON Schema, `name` its name.
    ///
    /// # Errors
    /// If the output fails, or if there are more than 65,535 topics.
    pub(crate) fn json_topic(&mut self, topic: &str, name: &str, schema: &str) -> io::Result<WrittenTopic> {
        self.add_topic(topic, name, ("jsonschema", schema), "json", &BTreeMap::new())
    }

    fn add_topic(
        &mut self,
        topic: &str,
        name: &str,
        (encoding, schema): (&str, &str),
        messages: &str,
        metadata: &BTreeMap<String, String>,
    ) -> io::Result<WrittenTopic> {
        let file = self.open_file()?;
        let schema = file.add_schema(name, encoding, schema.as_bytes()).map_err(to_io)?;
        let channel = file.add_channel(schema, topic, messages, metadata).map_err(to_io)?;
        self.pending += 1024;
        Ok(WrittenTopic { channel, sequence: 0 })
    }

    /// Writes a message. The file uses the clock of the frames: negative times are written as zero, missing
    /// times as the previous time.
    ///
    /// # Errors
    /// If the output fails.
    pub fn write_message(
        &mut self,
        topic: &mut WrittenTopic,
        time: Option<Timestamp>,
        data: &[u8],
    ) -> io::Result<()> {
        if let Some(Timestamp(time)) = time {
            self.time = u64::try_from(time).unwrap_or(0);
        }
        let time = self.time;
        self.pending += AROUND_MESSAGE + data.len() as u64;
        topic.sequence = topic.sequence.wrapping_add(1);
        let WrittenTopic { channel: channel_id, sequence } = *topic;
        let header = MessageHeader { channel_id, sequence, log_time: time, publish_time: time };
        self.open_file()?.write_to_known_channel(&header, data).map_err(to_io)
    }

    /// Writes a message to the topic `/log`: level 1 (debug) to 5 (fatal), name of the subject, and text.
    ///
    /// # Errors
    /// If the output fails.
    pub fn write_log(
        &mut self,
        time: Option<Timestamp>,
        level: u8,
        name: &str,
        message: &str,
    ) -> io::Result<()> {
        let mut topic = if let Some(topic) = self.log {
            topic
        } else {
            let metadata = BTreeMap::from([(key::COBSCOPE.to_owned(), key::NOTICES.to_owned())]);
            let schema = ("jsonschema", include_str!("log.json"));
            self.add_topic("/log", "foxglove.Log", schema, "json", &metadata)?
        };
        let nanoseconds = time.map_or(self.time, |Timestamp(time)| u64::try_from(time).unwrap_or(0));
        let stamp = json!({"sec": nanoseconds / 1_000_000_000, "nsec": nanoseconds % 1_000_000_000});
        let line = json!({
            "timestamp": stamp, "level": level, "message": message, "name": name, "file": "", "line": 0,
        });
        let written = self.write_message(&mut topic, time, line.to_string().as_bytes());
        self.log = Some(topic);
        written
    }

    /// Writes a metadata record about the file.
    ///
    /// # Errors
    /// If the output fails.
    pub fn write_metadata(&mut self, name: &str, values: BTreeMap<String, String>) -> io::Result<()> {
        self.open_file()?.write_metadata(&Metadata { name: name.into(), metadata: values }).map_err(to_io)
    }

    /// Attaches a complete file.
    ///
    /// # Errors
    /// If the output fails.
    pub fn attach_file(&mut self, name: &str, media_type: &str, bytes: &[u8]) -> io::Result<()> {
        let attachment = Attachment {
            log_time: self.time,
            create_time: 0,
            name: name.into(),
            media_type: media_type.into(),
            data: bytes.into(),
        };
        self.open_file()?.attach(&attachment).map_err(to_io)
    }

    /// Index of the channel for frames with these properties; created if new.
    fn source_index(&mut self, frame: &Frame, bus: &str) -> io::Result<usize> {
        let kind = MessageTemplate::template_of(frame);
        let fits = |source: &FrameChannel| source.kind == kind && source.bus == bus;
        if self.sources.get(self.last).is_some_and(fits) {
            return Ok(self.last);
        }
        if let Some(index) = self.sources.iter().position(fits) {
            self.last = index;
            return Ok(index);
        }
        let schema = if kind.is_fd() { include_str!("fd_frame.msg") } else { include_str!("frame.msg") };
        let name = if kind.is_fd() { "ros2_socketcan_msgs/msg/FdFrame" } else { "can_msgs/msg/Frame" };
        let shown = if bus.is_empty() { "can" } else { bus };
        let topic = if kind.is_fd() { format!("/can/{shown}/fd") } else { format!("/can/{shown}") };
        let topic = self.add_topic(&topic, name, ("ros2msg", schema), "cdr", &write_metadata(kind, bus))?;
        self.sources.push(FrameChannel { bus: bus.into(), kind, topic, message: begin_message(shown) });
        self.last = self.sources.len().saturating_sub(1);
        Ok(self.last)
    }

    fn write_frame(&mut self, frame: &Frame, bus: &str) -> io::Result<()> {
        let index = self.source_index(frame, bus)?;
        let Some(source) = self.sources.get_mut(index) else { return Ok(()) };
        let mut topic = source.topic;
        let mut message = std::mem::take(&mut source.message);
        let start = message.len();
        let stamp = frame.time.map_or(0, |Timestamp(time)| u64::try_from(time).unwrap_or(0));
        complete_message(frame, stamp, source.kind.is_fd(), &mut message);
        let written = self.write_message(&mut topic, frame.time, &message);
        message.truncate(start);
        if let Some(source) = self.sources.get_mut(index) {
            (source.topic, source.message) = (topic, message);
        }
        written
    }

    fn flush_chunk(&mut self) -> io::Result<()> {
        if self.has_finished {
            return Ok(());
        }
        self.pending = 0;
        self.open_file()?.flush().map_err(to_io)
    }
}

/// Metadata of the channel of such frames.
fn write_metadata(kind: MessageTemplate, bus: &str) -> BTreeMap<String, String> {
    let has = |flag: FrameFlags| kind.flags & flag.0 != 0;
    let stated = [
        (true, key::COBSCOPE, key::FRAMES),
        (true, key::BUS, bus),
        (has(FrameFlags::RECEIVED), key::DIRECTION, "rx"),
        (has(FrameFlags::TRANSMITTED), key::DIRECTION, "tx"),
        (has(FrameFlags::BIT_RATE_SWITCH), key::SWITCHED, "1"),
        (has(FrameFlags::ERROR_STATE), key::PASSIVE, "1"),
        (!kind.has_time, key::TIME, "none"),
    ];
    stated.iter().filter(|(says, ..)| *says).map(|(_, key, value)| ((*key).into(), (*value).into())).collect()
}

/// Start of a message up to the identifier: little-endian CDR, space for the timestamp, bus name.
fn begin_message(bus: &str) -> Vec<u8> {
    let mut message = vec![0, 1, 0, 0];
    message.extend_from_slice(&[0; 8]);
    message.extend_from_slice(&u32::try_from(bus.len() + 1).unwrap_or(u32::MAX).to_le_bytes());
    message.extend_from_slice(bus.as_bytes());
    message.push(0);
    // Alignment counts from the end of the four-byte encapsulation header, itself a multiple of 4.
    message.resize(message.len().next_multiple_of(4), 0);
    message
}

/// Completes the start of a message with a frame.
fn complete_message(frame: &Frame, stamp: u64, is_fd: bool, message: &mut Vec<u8>) {
    let [seconds, nanoseconds] = [stamp / 1_000_000_000, stamp % 1_000_000_000];
    // Seconds have 32 bits in ROS.
    let seconds = u32::try_from(seconds).unwrap_or(u32::MAX).to_le_bytes();
    let nanoseconds = u32::try_from(nanoseconds).unwrap_or(0).to_le_bytes();
    if let Some(room) = message.get_mut(4..12) {
        room.copy_from_slice([seconds, nanoseconds].as_flattened());
    }
    let is_error = frame.flags.contains(FrameFlags::ERROR);
    let is_extended = !is_error && matches!(frame.id, CanId::Extended(_));
    let is_remote = frame.flags.contains(FrameFlags::REMOTE);
    message.extend_from_slice(&frame.id.number().to_le_bytes());
    if is_fd {
        message.extend_from_slice(&[is_extended.into(), is_error.into(), frame.length, 0]);
        message.extend_from_slice(&u32::from(frame.length).to_le_bytes());
        message.extend_from_slice(frame.data());
    } else {
        let dlc = if frame.raw_dlc > 8 { frame.raw_dlc } else { frame.length };
        message.extend_from_slice(&[is_remote.into(), is_extended.into(), is_error.into(), dlc]);
        let data = frame.data();
        message.extend_from_slice(data.get(..8).unwrap_or(data));
        message.resize(message.len() + 8_usize.saturating_sub(data.len()), 0);
    }
}

fn to_io(error: McapError) -> io::Error {
    match error {
        McapError::Io(error) => error,
        other => io::Error::other(other),
    }
}

impl<W: Write + Send> FrameWriter for McapWriter<W> {
    fn write(&mut self, frame: &Frame, bus: &str) -> io::Result<()> {
        self.write_frame(frame, bus)
    }

    fn notice(&mut self, notice: &Notice, bus: &str) -> io::Result<bool> {
        let (time, level, remark) = match *notice {
            Notice::LostFrames { count, .. } => (None, WARNING, CommentRemark::Lost(count)),
            Notice::Link { time, state, bit_rate, .. } => {
                (Some(time), INFO, CommentRemark::Link(state, bit_rate))
            }
            Notice::Quiet(time) => (Some(time), INFO, CommentRemark::Quiet),
            Notice::ClockSet { time, step, .. } => (Some(time), INFO, CommentRemark::ClockSet(step)),
            Notice::Unreadable { .. } | Notice::CutOff { .. } | Notice::Assumption(_) => return Ok(false),
        };
        self.write_log(time, level, bus, &remark.comment_text())?;
        Ok(true)
    }

    fn pending(&self) -> u64 {
        if self.pending == 0 { 0 } else { self.pending + AROUND_CHUNK }
    }

    fn flush(&mut self) -> io::Result<()> {
        self.flush_chunk()
    }

    fn finish(&mut self) -> io::Result<()> {
        if self.has_finished {
            return Ok(());
        }
        let finished: McapResult<_> = self.open_file()?.finish();
        self.has_finished = true;
        finished.map(|_| ()).map_err(to_io)
    }
}
