//! SDO (CiA 301 §7.2.4.3): read or write access to one object by expedited, segmented or block transfer.
//!
//! ```text
//! byte 0  command specifier (bits 7..5) and flags   bytes 1..3 index   byte 3 sub-index   bytes 4..8 data
//! ```
//!
//! The meaning of byte 0 depends on sender and phase. Within the segments of a block transfer, every first
//! byte except 0x80 is a sequence number: 0x81 is the last segment, not an abort. The caller passes sender
//! and phase.

mod message;
mod words;

use nom::Parser;
use nom::bytes::complete::take;
use nom::number::complete::{le_u16, le_u32, u8 as byte};

pub use message::{BlockEnd, Payload, Sdo, Segment};

use super::ObjectAddress;
use crate::wire::Malformed;
use crate::wire::parser::{Parsed, bit_field, field_sequence, parse_message};

/// Sender of the frame.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash)]
pub enum Side {
    /// The client sends requests.
    Client,
    /// The server sends responses.
    Server,
}

/// Phase of a transfer, as far as it affects decoding.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Phase {
    /// Any message except a segment of a block.
    Commands,
    /// The sender is sending the segments of a block.
    BlockSegments,
}

/// This first byte is an abort in every phase, if the frame has eight bytes.
const ABORT: u8 = 0x80;

/// Bytes of a message, including the command.
const LENGTH: usize = 8;

/// Reads one message.
///
/// # Errors
/// If the message is shorter than its command needs. A message of fewer than eight bytes is accepted if it
/// contains all fields of its command.
pub fn parse(data: &[u8], side: Side, phase: Phase) -> Result<Sdo<'_>, Malformed> {
    parse_message("sdo", data, |data| parse_fields(data, side, phase))
}

#[inline]
fn parse_fields(data: &[u8], side: Side, phase: Phase) -> Parsed<'_, Sdo<'_>> {
    let (rest, command) = byte(data)?;
    if phase == Phase::BlockSegments && (command != ABORT || data.len() < LENGTH) {
        let segment =
            Sdo::BlockSegment { sequence: bit_field(command, 0, 7), last: command & 0x80 != 0, data: rest };
        return Ok((rest, segment));
    }
    field_sequence(|rest| by_command(command, rest, side)).parse(rest)
}

fn by_command(command: u8, rest: &[u8], side: Side) -> Parsed<'_, Sdo<'_>> {
    match side {
        _ if command == ABORT => abort(rest),
        Side::Client => client(command, rest),
        Side::Server => server(command, rest),
    }
}

fn client(command: u8, rest: &[u8]) -> Parsed<'_, Sdo<'_>> {
    match command >> 5 {
        0 => segment(command, rest).map(|(rest, segment)| (rest, Sdo::DownloadSegment(segment))),
        1 => {
            let (rest, object) = multiplexer(rest)?;
            let (rest, payload) = payload(command, rest)?;
            Ok((rest, Sdo::InitiateDownload { object, payload }))
        }
        2 => multiplexer(rest).map(|(rest, object)| (rest, Sdo::InitiateUpload { object })),
        3 => Ok((rest, Sdo::RequestUploadSegment { toggle: command & 0x10 != 0 })),
        5 => client_block_upload(command, rest),
        6 if command & 1 == 0 => {
            let (rest, object) = multiplexer(rest)?;
            let (rest, size) = block_size_indication(command, rest)?;
            Ok((rest, Sdo::InitiateBlockDownload { object, crc: command & 4 != 0, size }))
        }
        6 => block_end(command, rest).map(|(rest, end)| (rest, Sdo::EndBlockDownload(end))),
        _ => Ok((rest, Sdo::Unknown { command })),
    }
}

fn client_block_upload(command: u8, rest: &[u8]) -> Parsed<'_, Sdo<'_>> {
    match command & 3 {
        0 => {
            let (rest, object) = multiplexer(rest)?;
            let (rest, (block_size, switch_threshold)) = (byte, byte).parse(rest)?;
            let crc = command & 4 != 0;
            Ok((rest, Sdo::InitiateBlockUpload { object, crc, block_size, switch_threshold }))
        }
        1 => Ok((rest, Sdo::BlockUploadEnded)),
        2 => {
            let (rest, (sequence, block_size)) = (byte, byte).parse(rest)?;
            Ok((rest, Sdo::BlockUploadAcknowledged { sequence, block_size }))
        }
        _ => Ok((rest, Sdo::StartBlockUpload)),
    }
}

fn server(command: u8, rest: &[u8]) -> Parsed<'_, Sdo<'_>> {
    match command >> 5 {
        0 => segment(command, rest).map(|(rest, segment)| (rest, Sdo::UploadSegment(segment))),
        1 => Ok((rest, Sdo::DownloadSegmentAccepted { toggle: command & 0x10 != 0 })),
        2 => {
            let (rest, object) = multiplexer(rest)?;
            let (rest, payload) = payload(command, rest)?;
            Ok((rest, Sdo::UploadInitiated { object, payload }))
        }
        3 => multiplexer(rest).map(|(rest, object)| (rest, Sdo::DownloadInitiated { object })),
        5 => server_block_download(command, rest),
        6 if command & 1 == 0 => {
            let (rest, object) = multiplexer(rest)?;
            let (rest, size) = block_size_indication(command, rest)?;
            Ok((rest, Sdo::BlockUploadInitiated { object, crc: command & 4 != 0, size }))
        }
        6 => block_end(command, rest).map(|(rest, end)| (rest, Sdo::EndBlockUpload(end))),
        _ => Ok((rest, Sdo::Unknown { command })),
    }
}

fn server_block_download(command: u8, rest: &[u8]) -> Parsed<'_, Sdo<'_>> {
    match command & 3 {
        0 => {
            let (rest, object) = multiplexer(rest)?;
            let (rest, block_size) = byte(rest)?;
            Ok((rest, Sdo::BlockDownloadInitiated { object, crc: command & 4 != 0, block_size }))
        }
        1 => Ok((rest, Sdo::BlockDownloadEnded)),
        2 => {
            let (rest, (sequence, block_size)) = (byte, byte).parse(rest)?;
            Ok((rest, Sdo::BlockDownloadAcknowledged { sequence, block_size }))
        }
        _ => Ok((rest, Sdo::Unknown { command })),
    }
}

fn abort(rest: &[u8]) -> Parsed<'_, Sdo<'_>> {
    let (rest, object) = multiplexer(rest)?;
    let (rest, code) = le_u32(rest)?;
    Ok((rest, Sdo::Abort { object, code }))
}

fn multiplexer(rest: &[u8]) -> Parsed<'_, ObjectAddress> {
    (le_u16, byte).map(|(index, sub)| ObjectAddress { index, sub }).parse(rest)
}

/// Initiate message: bits 3..2 are n, bit 1 is e, bit 0 is s.
fn payload(command: u8, rest: &[u8]) -> Parsed<'_, Payload<'_>> {
    let (expedited, sized) = (command & 2 != 0, command & 1 != 0);
    if !expedited {
        let (rest, size) = if sized { le_u32.map(Some).parse(rest)? } else { (rest, None) };
        return Ok((rest, Payload::Segmented { size }));
    }
    let available = rest.len().min(4);
    let wanted = if sized { 4 - bit_field::<usize>(command, 2, 2) } else { available };
    let (rest, data) = take(wanted).parse(rest)?;
    Ok((rest, Payload::Expedited { data, sized }))
}

/// Segment: bit 4 is the toggle, bits 3..1 are n, bit 0 is c.
fn segment(command: u8, rest: &[u8]) -> Parsed<'_, Segment<'_>> {
    let wanted = 7 - bit_field::<usize>(command, 1, 3);
    let (rest, data) = take(wanted).parse(rest)?;
    Ok((rest, Segment { toggle: command & 0x10 != 0, last: command & 1 != 0, data }))
}

fn block_size_indication(command: u8, rest: &[u8]) -> Parsed<'_, Option<u32>> {
    if command & 2 == 0 { Ok((rest, None)) } else { le_u32.map(Some).parse(rest) }
}

/// End of a block transfer: bits 4..2 of byte 0 are n, bytes 1..3 are the CRC.
fn block_end(command: u8, rest: &[u8]) -> Parsed<'_, BlockEnd> {
    let (rest, crc) = le_u16(rest)?;
    Ok((rest, BlockEnd { unused: bit_field(command, 2, 3), crc }))
}

#[cfg(test)]
mod tests {
    use super::*;

    const OBJECT: ObjectAddress = ObjectAddress::new(0x1017, 0);

    fn client(data: &[u8]) -> Sdo<'_> {
        parse(data, Side::Client, Phase::Commands).unwrap()
    }

    fn server(data: &[u8]) -> Sdo<'_> {
        parse(data, Side::Server, Phase::Commands).unwrap()
    }

    #[test]
    fn expedited_download_with_size() {
        // 0x2B: specifier 1, n = 2, e, s; 1017:00; 1000 = 0x03E8.
        let expected = Payload::Expedited { data: &[0xE8, 0x03], sized: true };
        assert_eq!(
            client(&[0x2B, 0x17, 0x10, 0x00, 0xE8, 0x03, 0, 0]),
            Sdo::InitiateDownload { object: OBJECT, payload: expected }
        );
        assert_eq!(server(&[0x60, 0x17, 0x10, 0, 0, 0, 0, 0]), Sdo::DownloadInitiated { object: OBJECT });
    }

    #[test]
    fn expedited_without_size_gives_all_bytes_sent() {
        // 0x22: e without s; a short frame of six bytes contains two data bytes.
        let expected = Payload::Expedited { data: &[0xE8, 0x03], sized: false };
        assert_eq!(
            client(&[0x22, 0x17, 0x10, 0x00, 0xE8, 0x03]),
            Sdo::InitiateDownload { object: OBJECT, payload: expected }
        );
    }

    #[test]
    fn segments_hold_seven_less_n() {
        // 0x15: upload segment, toggle set, n = 2, last.
        assert_eq!(
            server(&[0x15, 1, 2, 3, 4, 5, 0, 0]),
            Sdo::UploadSegment(Segment { toggle: true, last: true, data: &[1, 2, 3, 4, 5] })
        );
        assert_eq!(client(&[0x70, 0, 0, 0, 0, 0, 0, 0]), Sdo::RequestUploadSegment { toggle: true });
    }

    #[test]
    fn within_a_block_only_0x80_is_an_abort() {
        let block = |data| parse(data, Side::Server, Phase::BlockSegments).unwrap();
        assert_eq!(
            block(&[0x81, 1, 2, 3, 4, 5, 6, 7]),
            Sdo::BlockSegment { sequence: 1, last: true, data: &[1, 2, 3, 4, 5, 6, 7] }
        );
        let code = 0x0504_0000;
        assert_eq!(block(&[0x80, 0x17, 0x10, 0, 0, 0, 4, 5]), Sdo::Abort { object: OBJECT, code });
        assert!(matches!(
            block(&[0xC1, 0, 0, 0, 0, 0, 0, 0]),
            Sdo::BlockSegment { sequence: 0x41, last: true, .. }
        ));
    }

    #[test]
    fn outside_a_block_0x81_is_no_abort_either() {
        assert_eq!(server(&[0x81, 1, 2, 3, 4, 5, 6, 7]), Sdo::Unknown { command: 0x81 });
    }

    #[test]
    fn block_download_messages() {
        // 0xC6: initiate, CRC offered, size indicated: 16.
        assert_eq!(
            client(&[0xC6, 0x17, 0x10, 0, 16, 0, 0, 0]),
            Sdo::InitiateBlockDownload { object: OBJECT, crc: true, size: Some(16) }
        );
        assert_eq!(
            server(&[0xA4, 0x17, 0x10, 0, 127, 0, 0, 0]),
            Sdo::BlockDownloadInitiated { object: OBJECT, crc: true, block_size: 127 }
        );
        assert_eq!(
            server(&[0xA2, 3, 127, 0, 0, 0, 0, 0]),
            Sdo::BlockDownloadAcknowledged { sequence: 3, block_size: 127 }
        );
        // 0xD5: end, n = 5, CRC 0x1234.
        assert_eq!(
            client(&[0xD5, 0x34, 0x12, 0, 0, 0, 0, 0]),
            Sdo::EndBlockDownload(BlockEnd { unused: 5, crc: 0x1234 })
        );
        assert_eq!(server(&[0xA1, 0, 0, 0, 0, 0, 0, 0]), Sdo::BlockDownloadEnded);
    }

    #[test]
    fn block_upload_messages() {
        assert_eq!(
            client(&[0xA4, 0x17, 0x10, 0, 32, 0, 0, 0]),
            Sdo::InitiateBlockUpload { object: OBJECT, crc: true, block_size: 32, switch_threshold: 0 }
        );
        assert_eq!(client(&[0xA3, 0, 0, 0, 0, 0, 0, 0]), Sdo::StartBlockUpload);
        assert_eq!(client(&[0xA1, 0, 0, 0, 0, 0, 0, 0]), Sdo::BlockUploadEnded);
        assert_eq!(
            server(&[0xC2, 0x17, 0x10, 0, 9, 0, 0, 0]),
            Sdo::BlockUploadInitiated { object: OBJECT, crc: false, size: Some(9) }
        );
    }

    #[test]
    fn too_short_says_where_and_how_much() {
        let error = parse(&[0x40, 0x17], Side::Client, Phase::Commands).unwrap_err();
        assert_eq!(error.layer, "sdo");
        assert_eq!((error.offset, error.available), (1, 1));
        assert_eq!(error.needed, 3, "index and sub-index");
        let error = parse(&[0x23, 0x00, 0x20, 1, 9], Side::Client, Phase::Commands).unwrap_err();
        assert_eq!((error.offset, error.needed, error.available), (4, 4, 1));
        assert!(parse(&[0x80, 0, 0, 0], Side::Server, Phase::Commands).is_err());
        assert!(parse(&[], Side::Client, Phase::Commands).is_err());
    }
}
