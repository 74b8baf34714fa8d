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
pub(super) enum Kind {
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
pub(super) fn head(input: &[u8]) -> Option<(Kind, u64)> {
    let kind = match *input.first()? {
        HEADER => Kind::Header,
        FOOTER => Kind::Footer,
        SCHEMA => Kind::Schema,
        CHANNEL => Kind::Channel,
        MESSAGE => Kind::Message,
        CHUNK => Kind::Chunk,
        STATISTICS => Kind::Statistics,
        1..=LAST | PRIVATE.. => Kind::Other,
        unknown => Kind::Unknown(unknown),
    };
    let length = u64::from_le_bytes(*input.get(1..)?.first_chunk()?);
    Some((kind, length))
}

/// Layout of the messages of a channel.
pub(super) struct Schema<'a> {
    pub(super) id: u16,
    pub(super) name: &'a [u8],
    pub(super) encoding: &'a [u8],
    pub(super) data: &'a [u8],
}

/// Channel of a topic.
pub(super) struct Channel<'a> {
    pub(super) id: u16,
    pub(super) schema: u16,
    pub(super) topic: &'a [u8],
    pub(super) encoding: &'a [u8],
    metadata: Vec<(&'a [u8], &'a [u8])>,
}

impl<'a> Channel<'a> {
    /// Value of a key in the metadata.
    pub(super) fn says(&self, key: &str) -> Option<&'a [u8]> {
        self.metadata.iter().find(|(known, _)| *known == key.as_bytes()).map(|(_, value)| *value)
    }
}

pub(super) struct Message<'a> {
    pub(super) channel: u16,
    /// Time of recording, in nanoseconds.
    pub(super) log_time: u64,
    pub(super) data: &'a [u8],
}

/// A chunk of records.
pub(super) struct Chunk<'a> {
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

fn text(input: &[u8]) -> IResult<&[u8], &[u8]> {
    length_data(le_u32).parse(input)
}

/// Library that wrote the file, from a header record; `None` if the record is too short.
pub(super) fn library(contents: &[u8]) -> Option<&[u8]> {
    let (_, (_profile, library)) = (text, text).parse(contents).ok()?;
    Some(library)
}

/// Number of messages, from a statistics record; `None` if the record is too short.
pub(super) fn messages(contents: &[u8]) -> Option<u64> {
    let (_, count) = le_u64::<_, nom::error::Error<_>>(contents).ok()?;
    Some(count)
}

/// Parses a schema record; `None` if it is too short.
pub(super) fn schema(contents: &[u8]) -> Option<Schema<'_>> {
    let (_, (id, name, encoding, data)) = (le_u16, text, text, text).parse(contents).ok()?;
    Some(Schema { id, name, encoding, data })
}

/// Parses a channel record; `None` if it is too short.
pub(super) fn channel(contents: &[u8]) -> Option<Channel<'_>> {
    let (_, (id, schema, topic, encoding, map)) = (le_u16, le_u16, text, text, text).parse(contents).ok()?;
    let (_, metadata) = all_consuming(many0((text, text))).parse(map).ok()?;
    Some(Channel { id, schema, topic, encoding, metadata })
}

/// Parses a message record; `None` if it is too short.
pub(super) fn message(contents: &[u8]) -> Option<Message<'_>> {
    let (_, (channel, _sequence, log_time, _publish_time, data)) =
        (le_u16, le_u32, le_u64, le_u64, rest::<_, nom::error::Error<_>>).parse(contents).ok()?;
    Some(Message { channel, log_time, data })
}

/// Parses a chunk record whose end may be missing; `None` if it is shorter than the fields before the
/// records.
pub(super) fn chunk(contents: &[u8]) -> Option<Chunk<'_>> {
    let times = take::<_, _, nom::error::Error<_>>(16_usize);
    let (_, (_, size, checksum, packing, packed_size, packed)) =
        (times, le_u64, le_u32, text, le_u64, rest).parse(contents).ok()?;
    let end = usize::try_from(packed_size).unwrap_or(usize::MAX).min(packed.len());
    Some(Chunk { size, checksum, packing, packed_size, packed: packed.get(..end).unwrap_or(packed) })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_channel_with_its_metadata() {
        let contents = b"\x01\0\x02\0\x04\0\0\0/can\x03\0\0\0cdr\x0B\0\0\0\x03\0\0\0bus\0\0\0\0";
        let channel = channel(contents).unwrap();
        assert_eq!(
            (channel.id, channel.schema, channel.topic, channel.encoding),
            (1, 2, &b"/can"[..], &b"cdr"[..])
        );
        assert_eq!(channel.says("bus"), Some(&b""[..]));
        assert_eq!(channel.says("fd"), None);
    }

    #[test]
    fn lengths_that_lie_are_refused() {
        assert!(channel(b"\x01\0\x02\0\xFF\xFF\xFF\xFF/can").is_none());
        assert!(channel(b"\x01\0\x02\0\0\0\0\0\0\0\0\0\x05\0\0\0\x03\0\0\0b").is_none());
        assert!(schema(b"\x01\0\x01\0\0\0").is_none());
        assert!(message(b"\x01\0").is_none());
        assert!(head(b"\x05\x01\0\0").is_none());
    }

    #[test]
    fn of_a_chunk_that_is_cut_what_is_there_is_given() {
        let mut contents = vec![0; 16];
        contents.extend_from_slice(&[9, 0, 0, 0, 0, 0, 0, 0]);
        contents.extend_from_slice(&[1, 2, 3, 4]);
        contents.extend_from_slice(b"\x03\0\0\0lz4");
        contents.extend_from_slice(&[5, 0, 0, 0, 0, 0, 0, 0, 7, 8]);
        let chunk = chunk(&contents).unwrap();
        assert_eq!((chunk.size, chunk.checksum, chunk.packing), (9, 0x0403_0201, &b"lz4"[..]));
        assert_eq!((chunk.packed_size, chunk.packed), (5, &[7, 8][..]));
    }

    #[test]
    fn kinds_of_records() {
        let kind = |byte: u8| head(&[byte, 1, 0, 0, 0, 0, 0, 0, 0]).unwrap();
        assert_eq!(kind(5), (Kind::Message, 1));
        assert_eq!(kind(0x0A), (Kind::Other, 1));
        assert_eq!(kind(0x90), (Kind::Other, 1));
        assert_eq!(kind(0), (Kind::Unknown(0), 1));
        assert_eq!(kind(0x10), (Kind::Unknown(0x10), 1));
    }
}
