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

pub use message::{BlockEnd, InitiateData, SdoMessage, SdoSegment};

use super::ObjectAddress;
use crate::wire::MalformedPayload;
use crate::wire::parser::{Parsed, bit_field, field_sequence, parse_message};

/// Sender of the frame.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash)]
pub enum SdoSide {
    /// The client sends requests.
    Client,
    /// The server sends responses.
    Server,
}

/// Phase of a transfer, as far as it affects decoding.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum TransferPhase {
    /// Any message except a segment of a block.
    Commands,
    /// The sender is sending the segments of a block.
    BlockSegments,
}

/// This first byte is an abort in every phase, if the frame has eight bytes.
const ABORT: u8 = 0x80;

/// Bytes of a message, including the command.
const LENGTH: usize = 8;

/// Whether the command of a frame is defined for its sender, with all reserved bits 0 (CiA 301 §7.2.4.3), outside of the
/// segments of a block. Every SDO message has eight bytes.
pub fn has_valid_command(data: &[u8], side: SdoSide) -> bool {
    let [command, _, _, _, _, _, _, _] = data else { return false };
    // Initiate with data: n and e and s; n counts only in expedited data of stated size.
    let is_initiate = |command: u8| matches!(command & 0x1F, 0..=3 | 0x07 | 0x0B | 0x0F);
    match (command >> 5, side) {
        (0, _) => true,
        (1, SdoSide::Client) | (2, SdoSide::Server) => is_initiate(*command),
        (1, SdoSide::Server) | (3, SdoSide::Client) => command.trailing_zeros() >= 4,
        (2, SdoSide::Client) | (3, SdoSide::Server) | (4, _) => command.trailing_zeros() >= 5,
        (5, SdoSide::Client) => command & 0x1B == 0 || matches!(command & 0x1F, 1..=3),
        (5, SdoSide::Server) => command & 0x1B == 0 || matches!(command & 0x1F, 1 | 2),
        (6, _) => command & 0x19 == 0 || command & 3 == 1,
        _ => false,
    }
}

/// Reads one message.
///
/// # Errors
/// If the message is shorter than its command needs. A message of fewer than eight bytes is accepted if it
/// contains all fields of its command.
pub fn parse(data: &[u8], side: SdoSide, phase: TransferPhase) -> Result<SdoMessage<'_>, MalformedPayload> {
    parse_message("sdo", data, |data| parse_fields(data, side, phase))
}

#[inline]
fn parse_fields(data: &[u8], side: SdoSide, phase: TransferPhase) -> Parsed<'_, SdoMessage<'_>> {
    let (rest, command) = byte(data)?;
    if phase == TransferPhase::BlockSegments && (command != ABORT || data.len() < LENGTH) {
        let segment = SdoMessage::BlockSegment {
            sequence: bit_field(command, 0, 7),
            last: command & 0x80 != 0,
            data: rest,
        };
        return Ok((rest, segment));
    }
    field_sequence(|rest| by_command(command, rest, side)).parse(rest)
}

fn by_command(command: u8, rest: &[u8], side: SdoSide) -> Parsed<'_, SdoMessage<'_>> {
    match side {
        _ if command == ABORT => parse_abort(rest),
        SdoSide::Client => parse_client(command, rest),
        SdoSide::Server => parse_server(command, rest),
    }
}

fn parse_client(command: u8, rest: &[u8]) -> Parsed<'_, SdoMessage<'_>> {
    match command >> 5 {
        0 => parse_segment(command, rest).map(|(rest, segment)| (rest, SdoMessage::DownloadSegment(segment))),
        1 => {
            let (rest, object) = parse_multiplexer(rest)?;
            let (rest, payload) = parse_payload(command, rest)?;
            Ok((rest, SdoMessage::InitiateDownload { object, payload }))
        }
        2 => parse_multiplexer(rest).map(|(rest, object)| (rest, SdoMessage::InitiateUpload { object })),
        3 => Ok((rest, SdoMessage::RequestUploadSegment { toggle: command & 0x10 != 0 })),
        5 => client_block_upload(command, rest),
        6 if command & 1 == 0 => {
            let (rest, object) = parse_multiplexer(rest)?;
            let (rest, size) = block_size_indication(command, rest)?;
            Ok((rest, SdoMessage::InitiateBlockDownload { object, crc: command & 4 != 0, size }))
        }
        6 => block_end(command, rest).map(|(rest, end)| (rest, SdoMessage::EndBlockDownload(end))),
        _ => Ok((rest, SdoMessage::Unknown { command })),
    }
}

fn client_block_upload(command: u8, rest: &[u8]) -> Parsed<'_, SdoMessage<'_>> {
    match command & 3 {
        0 => {
            let (rest, object) = parse_multiplexer(rest)?;
            let (rest, (block_size, switch_threshold)) = (byte, byte).parse(rest)?;
            let crc = command & 4 != 0;
            Ok((rest, SdoMessage::InitiateBlockUpload { object, crc, block_size, switch_threshold }))
        }
        1 => Ok((rest, SdoMessage::BlockUploadEnded)),
        2 => {
            let (rest, (sequence, block_size)) = (byte, byte).parse(rest)?;
            Ok((rest, SdoMessage::BlockUploadAcknowledged { sequence, block_size }))
        }
        _ => Ok((rest, SdoMessage::StartBlockUpload)),
    }
}

fn parse_server(command: u8, rest: &[u8]) -> Parsed<'_, SdoMessage<'_>> {
    match command >> 5 {
        0 => parse_segment(command, rest).map(|(rest, segment)| (rest, SdoMessage::UploadSegment(segment))),
        1 => Ok((rest, SdoMessage::DownloadSegmentAccepted { toggle: command & 0x10 != 0 })),
        2 => {
            let (rest, object) = parse_multiplexer(rest)?;
            let (rest, payload) = parse_payload(command, rest)?;
            Ok((rest, SdoMessage::UploadInitiated { object, payload }))
        }
        3 => parse_multiplexer(rest).map(|(rest, object)| (rest, SdoMessage::DownloadInitiated { object })),
        5 => server_block_download(command, rest),
        6 if command & 1 == 0 => {
            let (rest, object) = parse_multiplexer(rest)?;
            let (rest, size) = block_size_indication(command, rest)?;
            Ok((rest, SdoMessage::BlockUploadInitiated { object, crc: command & 4 != 0, size }))
        }
        6 => block_end(command, rest).map(|(rest, end)| (rest, SdoMessage::EndBlockUpload(end))),
        _ => Ok((rest, SdoMessage::Unknown { command })),
    }
}

fn server_block_download(command: u8, rest: &[u8]) -> Parsed<'_, SdoMessage<'_>> {
    match command & 3 {
        0 => {
            let (rest, object) = parse_multiplexer(rest)?;
            let (rest, block_size) = byte(rest)?;
            Ok((rest, SdoMessage::BlockDownloadInitiated { object, crc: command & 4 != 0, block_size }))
        }
        1 => Ok((rest, SdoMessage::BlockDownloadEnded)),
        2 => {
            let (rest, (sequence, block_size)) = (byte, byte).parse(rest)?;
            Ok((rest, SdoMessage::BlockDownloadAcknowledged { sequence, block_size }))
        }
        _ => Ok((rest, SdoMessage::Unknown { command })),
    }
}

fn parse_abort(rest: &[u8]) -> Parsed<'_, SdoMessage<'_>> {
    let (rest, object) = parse_multiplexer(rest)?;
    let (rest, code) = le_u32(rest)?;
    Ok((rest, SdoMessage::Abort { object, code }))
}

fn parse_multiplexer(rest: &[u8]) -> Parsed<'_, ObjectAddress> {
    (le_u16, byte).map(|(index, sub)| ObjectAddress { index, sub }).parse(rest)
}

/// Initiate message: bits 3..2 are n, bit 1 is e, bit 0 is s.
fn parse_payload(command: u8, rest: &[u8]) -> Parsed<'_, InitiateData<'_>> {
    let (expedited, sized) = (command & 2 != 0, command & 1 != 0);
    if !expedited {
        let (rest, size) = if sized { le_u32.map(Some).parse(rest)? } else { (rest, None) };
        return Ok((rest, InitiateData::Segmented { size }));
    }
    let available = rest.len().min(4);
    let wanted = if sized { 4 - bit_field::<usize>(command, 2, 2) } else { available };
    let (rest, data) = take(wanted).parse(rest)?;
    Ok((rest, InitiateData::Expedited { data, sized }))
}

/// Segment: bit 4 is the toggle, bits 3..1 are n, bit 0 is c.
fn parse_segment(command: u8, rest: &[u8]) -> Parsed<'_, SdoSegment<'_>> {
    let wanted = 7 - bit_field::<usize>(command, 1, 3);
    let (rest, data) = take(wanted).parse(rest)?;
    Ok((rest, SdoSegment { toggle: command & 0x10 != 0, last: command & 1 != 0, data }))
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

    /// Commands of CiA 301 §7.2.4.3.3 to §7.2.4.3.16, as tables of its clauses.
    #[test]
    fn commands_have_no_reserved_bits() {
        let valid = |side: SdoSide| -> Vec<u8> {
            (0..=255_u8).filter(|command| has_valid_command(&[*command, 0, 0, 0, 0, 0, 0, 0], side)).collect()
        };
        let segments: Vec<u8> = (0..0x20).collect();
        let block = [0xC0, 0xC1, 0xC2, 0xC4, 0xC5, 0xC6, 0xC9, 0xCD, 0xD1, 0xD5, 0xD9, 0xDD];
        let client =
            [0x20, 0x21, 0x22, 0x23, 0x27, 0x2B, 0x2F, 0x40, 0x60, 0x70, 0x80, 0xA0, 0xA1, 0xA2, 0xA3, 0xA4];
        let server =
            [0x20, 0x30, 0x40, 0x41, 0x42, 0x43, 0x47, 0x4B, 0x4F, 0x60, 0x80, 0xA0, 0xA1, 0xA2, 0xA4];
        assert_eq!(valid(SdoSide::Client), [&segments[..], &client, &block].concat());
        assert_eq!(valid(SdoSide::Server), [&segments[..], &server, &block].concat());
        assert!(!has_valid_command(&[0x40, 0, 0x10, 0], SdoSide::Client));
    }

    const OBJECT: ObjectAddress = ObjectAddress::new(0x1017, 0);

    fn parse_client(data: &[u8]) -> SdoMessage<'_> {
        parse(data, SdoSide::Client, TransferPhase::Commands).unwrap()
    }

    fn parse_server(data: &[u8]) -> SdoMessage<'_> {
        parse(data, SdoSide::Server, TransferPhase::Commands).unwrap()
    }

    #[test]
    fn expedited_download_with_size() {
        // 0x2B: specifier 1, n = 2, e, s; 1017:00; 1000 = 0x03E8.
        let expected = InitiateData::Expedited { data: &[0xE8, 0x03], sized: true };
        assert_eq!(
            parse_client(&[0x2B, 0x17, 0x10, 0x00, 0xE8, 0x03, 0, 0]),
            SdoMessage::InitiateDownload { object: OBJECT, payload: expected }
        );
        assert_eq!(
            parse_server(&[0x60, 0x17, 0x10, 0, 0, 0, 0, 0]),
            SdoMessage::DownloadInitiated { object: OBJECT }
        );
    }

    #[test]
    fn expedited_without_size_gives_all_bytes_sent() {
        // 0x22: e without s; a short frame of six bytes contains two data bytes.
        let expected = InitiateData::Expedited { data: &[0xE8, 0x03], sized: false };
        assert_eq!(
            parse_client(&[0x22, 0x17, 0x10, 0x00, 0xE8, 0x03]),
            SdoMessage::InitiateDownload { object: OBJECT, payload: expected }
        );
    }

    #[test]
    fn segments_hold_seven_less_n() {
        // 0x15: upload segment, toggle set, n = 2, last.
        assert_eq!(
            parse_server(&[0x15, 1, 2, 3, 4, 5, 0, 0]),
            SdoMessage::UploadSegment(SdoSegment { toggle: true, last: true, data: &[1, 2, 3, 4, 5] })
        );
        assert_eq!(
            parse_client(&[0x70, 0, 0, 0, 0, 0, 0, 0]),
            SdoMessage::RequestUploadSegment { toggle: true }
        );
    }

    #[test]
    fn within_a_block_only_0x80_is_an_abort() {
        let block = |data| parse(data, SdoSide::Server, TransferPhase::BlockSegments).unwrap();
        assert_eq!(
            block(&[0x81, 1, 2, 3, 4, 5, 6, 7]),
            SdoMessage::BlockSegment { sequence: 1, last: true, data: &[1, 2, 3, 4, 5, 6, 7] }
        );
        let code = 0x0504_0000;
        assert_eq!(block(&[0x80, 0x17, 0x10, 0, 0, 0, 4, 5]), SdoMessage::Abort { object: OBJECT, code });
        assert!(matches!(
            block(&[0xC1, 0, 0, 0, 0, 0, 0, 0]),
            SdoMessage::BlockSegment { sequence: 0x41, last: true, .. }
        ));
    }

    #[test]
    fn outside_a_block_0x81_is_no_abort_either() {
        assert_eq!(parse_server(&[0x81, 1, 2, 3, 4, 5, 6, 7]), SdoMessage::Unknown { command: 0x81 });
    }

    #[test]
    fn block_download_messages() {
        // 0xC6: initiate, CRC offered, size indicated: 16.
        assert_eq!(
            parse_client(&[0xC6, 0x17, 0x10, 0, 16, 0, 0, 0]),
            SdoMessage::InitiateBlockDownload { object: OBJECT, crc: true, size: Some(16) }
        );
        assert_eq!(
            parse_server(&[0xA4, 0x17, 0x10, 0, 127, 0, 0, 0]),
            SdoMessage::BlockDownloadInitiated { object: OBJECT, crc: true, block_size: 127 }
        );
        assert_eq!(
            parse_server(&[0xA2, 3, 127, 0, 0, 0, 0, 0]),
            SdoMessage::BlockDownloadAcknowledged { sequence: 3, block_size: 127 }
        );
        // 0xD5: end, n = 5, CRC 0x1234.
        assert_eq!(
            parse_client(&[0xD5, 0x34, 0x12, 0, 0, 0, 0, 0]),
            SdoMessage::EndBlockDownload(BlockEnd { unused: 5, crc: 0x1234 })
        );
        assert_eq!(parse_server(&[0xA1, 0, 0, 0, 0, 0, 0, 0]), SdoMessage::BlockDownloadEnded);
    }

    #[test]
    fn block_upload_messages() {
        assert_eq!(
            parse_client(&[0xA4, 0x17, 0x10, 0, 32, 0, 0, 0]),
            SdoMessage::InitiateBlockUpload {
                object: OBJECT,
                crc: true,
                block_size: 32,
                switch_threshold: 0
            }
        );
        assert_eq!(parse_client(&[0xA3, 0, 0, 0, 0, 0, 0, 0]), SdoMessage::StartBlockUpload);
        assert_eq!(parse_client(&[0xA1, 0, 0, 0, 0, 0, 0, 0]), SdoMessage::BlockUploadEnded);
        assert_eq!(
            parse_server(&[0xC2, 0x17, 0x10, 0, 9, 0, 0, 0]),
            SdoMessage::BlockUploadInitiated { object: OBJECT, crc: false, size: Some(9) }
        );
    }

    #[test]
    fn too_short_says_where_and_how_much() {
        let error = parse(&[0x40, 0x17], SdoSide::Client, TransferPhase::Commands).unwrap_err();
        assert_eq!(error.layer, "sdo");
        assert_eq!((error.offset, error.available), (1, 1));
        assert_eq!(error.needed, 3, "index and sub-index");
        let error = parse(&[0x23, 0x00, 0x20, 1, 9], SdoSide::Client, TransferPhase::Commands).unwrap_err();
        assert_eq!((error.offset, error.needed, error.available), (4, 4, 1));
        assert!(parse(&[0x80, 0, 0, 0], SdoSide::Server, TransferPhase::Commands).is_err());
        assert!(parse(&[], SdoSide::Client, TransferPhase::Commands).is_err());
    }
}
