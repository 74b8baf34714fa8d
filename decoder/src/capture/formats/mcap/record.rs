//! Records of MCAP: <https://mcap.dev/spec#records>.
//!
//! ```text
//! record   type (1)  length of the content (8)  content            numbers are little-endian
//! text     length (4)  UTF-8              map   length in bytes (4)  text text  text text …
//! ```

use nom::bytes::complete::take;
use nom::combinator::{all_consuming, rest};
use nom::multi::{length_data, many0};
use nom::number::complete::{le_u16, le_u32, le_u64};
use nom::{IResult, Parser};

/// Size of the record head in bytes.
pub(super) const HEAD: usize = 9;

/// Record types that are read, and the last one in the specification.
const HEADER: u8 = 0x01;
const FOOTER: u8 = 0x02;
const SCHEMA: u8 = 0x03;
const CHANNEL: u8 = 0x04;
const MESSAGE: u8 = 0x05;
const CHUNK: u8 = 0x06;
const STATISTICS: u8 = 0x0B;
const LAST: u8 = 0x0F;

/// First of the types for private use.
const PRIVATE: u8 = 0x80;

/// Record types that the reader distinguishes.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum RecordType {
    /// First record: the program that wrote the file.
    Header,
    /// Last record of a finished file.
    Footer,
    /// Layout of messages.
    Schema,
    /// Channel of a topic.
    Channel,
    /// A message.
    Message,
    /// Compressed records.
    Chunk,
    /// Number of messages.
    Statistics,
    /// Indexes, attachments and private records.
    Other,
    /// Type without a definition in the specification.
    Unknown(u8),
}

/// Parses type and length of the record at the start of `input`; `None` if `input` is too short.
pub(super) fn parse_head(input: &[u8]) -> Option<(RecordType, u64)> {
    let kind = match *input.first()? {
        HEADER => RecordType::Header,
        FOOTER => RecordType::Footer,
        SCHEMA => RecordType::Schema,
        CHANNEL => RecordType::Channel,
        MESSAGE => RecordType::Message,
        CHUNK => RecordType::Chunk,
        STATISTICS => RecordType::Statistics,
        1..=LAST | PRIVATE.. => RecordType::Other,
        unknown => RecordType::Unknown(unknown),
    };
    let length = u64::from_le_bytes(*input.get(1..)?.first_chunk()?);
    Some((kind, length))
}

/// Layout of the messages of a channel.
pub(super) struct TopicSchema<'a> {
    pub(super) id: u16,
    pub(super) name: &'a [u8],
    pub(super) encoding: &'a [u8],
    pub(super) data: &'a [u8],
}

/// Channel of a topic.
pub(super) struct TopicChannel<'a> {
    pub(super) id: u16,
    pub(super) schema: u16,
    pub(super) topic: &'a [u8],
    pub(super) encoding: &'a [u8],
    metadata: Vec<(&'a [u8], &'a [u8])>,
}

impl<'a> TopicChannel<'a> {
    /// Value of a key in the metadata.
    pub(super) fn metadata_value(&self, key: &str) -> Option<&'a [u8]> {
        self.metadata.iter().find(|(known, _)| *known == key.as_bytes()).map(|(_, value)| *value)
    }
}

pub(super) struct McapMessage<'a> {
    pub(super) channel: u16,
    /// Time of recording, in nanoseconds.
    pub(super) log_time: u64,
    pub(super) data: &'a [u8],
}

/// A chunk of records.
pub(super) struct RecordChunk<'a> {
    /// Size of the decompressed records in bytes.
    pub(super) size: u64,
    /// CRC-32 of the decompressed records; 0 if unset.
    pub(super) checksum: u32,
    /// Compression: empty, `lz4` or `zstd`.
    pub(super) packing: &'a [u8],
    /// Declared size of the compressed records in bytes.
    pub(super) packed_size: u64,
    /// The available compressed records.
    pub(super) packed: &'a [u8],
}

fn parse_text(input: &[u8]) -> IResult<&[u8], &[u8]> {
    length_data(le_u32).parse(input)
}

/// Library that wrote the file, from a header record; `None` if the record is too short.
pub(super) fn parse_library(contents: &[u8]) -> Option<&[u8]> {
    let (_, (_profile, library)) = (parse_text, parse_text).parse(contents).ok()?;
    Some(library)
}

/// Number of messages, from a statistics record; `None` if the record is too short.
pub(super) fn parse_message_count(contents: &[u8]) -> Option<u64> {
    let (_, count) = le_u64::<_, nom::error::Error<_>>(contents).ok()?;
    Some(count)
}

/// Parses a schema record; `None` if it is too short.
pub(super) fn parse_schema(contents: &[u8]) -> Option<TopicSchema<'_>> {
    let (_, (id, name, encoding, data)) =
        (le_u16, parse_text, parse_text, parse_text).parse(contents).ok()?;
    Some(TopicSchema { id, name, encoding, data })
}

/// Parses a channel record; `None` if it is too short.
pub(super) fn parse_channel(contents: &[u8]) -> Option<TopicChannel<'_>> {
    let (_, (id, schema, topic, encoding, map)) =
        (le_u16, le_u16, parse_text, parse_text, parse_text).parse(contents).ok()?;
    let (_, metadata) = all_consuming(many0((parse_text, parse_text))).parse(map).ok()?;
    Some(TopicChannel { id, schema, topic, encoding, metadata })
}

/// Parses a message record; `None` if it is too short.
pub(super) fn parse_message(contents: &[u8]) -> Option<McapMessage<'_>> {
    let (_, (channel, _sequence, log_time, _publish_time, data)) =
        (le_u16, le_u32, le_u64, le_u64, rest::<_, nom::error::Error<_>>).parse(contents).ok()?;
    Some(McapMessage { channel, log_time, data })
}

/// Parses a chunk record whose end may be missing; `None` if it is shorter than the fields before the
/// records.
pub(super) fn parse_chunk(contents: &[u8]) -> Option<RecordChunk<'_>> {
    let times = take::<_, _, nom::error::Error<_>>(16_usize);
    let (_, (_, size, checksum, packing, packed_size, packed)) =
        (times, le_u64, le_u32, parse_text, le_u64, rest).parse(contents).ok()?;
    let end = usize::try_from(packed_size).unwrap_or(usize::MAX).min(packed.len());
    Some(RecordChunk { size, checksum, packing, packed_size, packed: packed.get(..end).unwrap_or(packed) })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_channel_with_its_metadata() {
        let contents = b"\x01\0\x02\0\x04\0\0\0/can\x03\0\0\0cdr\x0B\0\0\0\x03\0\0\0bus\0\0\0\0";
        let channel = parse_channel(contents).unwrap();
        assert_eq!(
            (channel.id, channel.schema, channel.topic, channel.encoding),
            (1, 2, &b"/can"[..], &b"cdr"[..])
        );
        assert_eq!(channel.metadata_value("bus"), Some(&b""[..]));
        assert_eq!(channel.metadata_value("fd"), None);
    }

    #[test]
    fn lengths_that_lie_are_refused() {
        assert!(parse_channel(b"\x01\0\x02\0\xFF\xFF\xFF\xFF/can").is_none());
        assert!(parse_channel(b"\x01\0\x02\0\0\0\0\0\0\0\0\0\x05\0\0\0\x03\0\0\0b").is_none());
        assert!(parse_schema(b"\x01\0\x01\0\0\0").is_none());
        assert!(parse_message(b"\x01\0").is_none());
        assert!(parse_head(b"\x05\x01\0\0").is_none());
    }

    #[test]
    fn of_a_chunk_that_is_cut_what_is_there_is_given() {
        let mut contents = vec![0; 16];
        contents.extend_from_slice(&[9, 0, 0, 0, 0, 0, 0, 0]);
        contents.extend_from_slice(&[1, 2, 3, 4]);
        contents.extend_from_slice(b"\x03\0\0\0lz4");
        contents.extend_from_slice(&[5, 0, 0, 0, 0, 0, 0, 0, 7, 8]);
        let chunk = parse_chunk(&contents).unwrap();
        assert_eq!((chunk.size, chunk.checksum, chunk.packing), (9, 0x0403_0201, &b"lz4"[..]));
        assert_eq!((chunk.packed_size, chunk.packed), (5, &[7, 8][..]));
    }

    #[test]
    fn kinds_of_records() {
        let kind = |byte: u8| parse_head(&[byte, 1, 0, 0, 0, 0, 0, 0, 0]).unwrap();
        assert_eq!(kind(5), (RecordType::Message, 1));
        assert_eq!(kind(0x0A), (RecordType::Other, 1));
        assert_eq!(kind(0x90), (RecordType::Other, 1));
        assert_eq!(kind(0), (RecordType::Unknown(0), 1));
        assert_eq!(kind(0x10), (RecordType::Unknown(0x10), 1));
    }
}
