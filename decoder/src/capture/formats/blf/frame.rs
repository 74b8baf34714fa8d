//! BLF objects that contain frames.
//!
//! ```text
//! CAN_MESSAGE, CAN_MESSAGE2     0 channel (2)  2 flags (1)  3 DLC (1)  4 identifier (4)  8 data (8)
//! CAN_FD_MESSAGE                the same, then 13 FD flags (1)  14 valid bytes (1)  20 data (64)
//! CAN_FD_MESSAGE_64             0 channel (1)  1 DLC (1)  2 valid bytes (1)  4 identifier (4)
//!                              12 flags (4)   34 direction (1)  35 offset of further data (1)  40 data
//!
//! identifier  bit 31: extended          flags      7 remote   6 5 line state          3…0 direction
//! direction   0 Rx   1 Tx   2 TxRq      FD flags   2 ESI   1 BRS   0 FD
//! flags of CAN_FD_MESSAGE_64            14 ESI   13 BRS   12 FD   4 remote
//! ```
//!
//! Sources: Vector's `binlog_objects.h`, Wireshark's `wiretap/blf.c`, python-can.

use crate::capture::byte_order::ByteOrder::Little;
use crate::frame::{CanId, Frame, FrameFlags, MAX_DATA, fd_length, is_fd_length};

const EXTENDED: u32 = 1 << 31;
const CLASSIC_DATA: usize = 8;
const FD_DATA: usize = 20;
const FD_64_DATA: usize = 40;

/// Content of a frame object.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) enum FrameObject {
    /// A frame on the bus.
    Frame(Frame),
    /// A request to send a frame; it is possible that the frame was never sent.
    Request,
}

/// Fields common to all frame objects.
struct FrameObjectFields {
    id: u32,
    dlc: u8,
    /// Number of valid data bytes; `None` if the object type has no such field.
    valid: Option<u8>,
    direction: u8,
    flags: FrameFlags,
}

/// Parses `CAN_MESSAGE` and `CAN_MESSAGE2`.
pub(super) fn parse_classic(body: &[u8]) -> Option<FrameObject> {
    let (flags, dlc) = (*body.get(2)?, *body.get(3)?);
    let fields = FrameObjectFields {
        id: Little.u32(body, 4)?,
        dlc,
        valid: None,
        direction: direction_bit(flags),
        flags: remote_flags(flags),
    };
    // The data field has a fixed size; a shorter object is cut off.
    fields.build_content(body.get(CLASSIC_DATA..CLASSIC_DATA + 8)?)
}

/// Parses `CAN_FD_MESSAGE`.
pub(super) fn parse_fd(body: &[u8]) -> Option<FrameObject> {
    let (flags, dlc, fd) = (*body.get(2)?, *body.get(3)?, *body.get(13)?);
    let flags_of_frame = if fd & 1 == 0 { remote_flags(flags) } else { fd_flags(fd & 2 != 0, fd & 4 != 0) };
    let fields = FrameObjectFields {
        id: Little.u32(body, 4)?,
        dlc,
        valid: Some(*body.get(14)?),
        direction: direction_bit(flags),
        flags: flags_of_frame,
    };
    fields.build_content(body.get(FD_DATA..)?)
}

/// Parses `CAN_FD_MESSAGE_64`; its offset of further data includes the `header` bytes before the body.
pub(super) fn fd_64(body: &[u8], header: usize) -> Option<FrameObject> {
    let flags = Little.u32(body, 12)?;
    let has = |bit: u32| flags & bit != 0;
    let fields = FrameObjectFields {
        id: Little.u32(body, 4)?,
        dlc: *body.get(1)?,
        valid: Some(*body.get(2)?),
        direction: *body.get(34)?,
        flags: match (has(0x1000), has(0x10)) {
            (true, _) => fd_flags(has(0x2000), has(0x4000)),
            (false, true) => FrameFlags::REMOTE,
            (false, false) => FrameFlags::default(),
        },
    };
    let further = usize::from(*body.get(35)?);
    let data = body.get(FD_64_DATA..)?;
    // Further data of the recorder may follow the frame data.
    let end = further.checked_sub(header + FD_64_DATA).unwrap_or(data.len());
    fields.build_content(data.get(..end).unwrap_or(data))
}

/// Direction from the flags of a frame. A request was not on the bus, so its line state is 0.
fn direction_bit(flags: u8) -> u8 {
    if flags & 0x6F == 2 { 2 } else { flags & 1 }
}

fn remote_flags(flags: u8) -> FrameFlags {
    if flags & 0x80 == 0 { FrameFlags::default() } else { FrameFlags::REMOTE }
}

fn fd_flags(switched: bool, error_state: bool) -> FrameFlags {
    let add = |flags: FrameFlags, flag, on| if on { flags.with(flag) } else { flags };
    let flags = add(FrameFlags::FD, FrameFlags::BIT_RATE_SWITCH, switched);
    add(flags, FrameFlags::ERROR_STATE, error_state)
}

impl FrameObjectFields {
    fn build_content(self, data: &[u8]) -> Option<FrameObject> {
        if self.direction == 2 {
            return Some(FrameObject::Request);
        }
        let way = if self.direction == 0 { FrameFlags::RECEIVED } else { FrameFlags::TRANSMITTED };
        let id = match self.id & EXTENDED {
            0 => CanId::from_standard(u16::try_from(self.id & 0x7FF).ok()?),
            _ => CanId::from_extended(self.id),
        };
        // The upper four bits have another meaning.
        let dlc = self.dlc & 0x0F;
        let is_fd = self.flags.contains(FrameFlags::FD);
        let is_remote = self.flags.contains(FrameFlags::REMOTE);
        let longest = if is_fd { fd_length(dlc) } else { dlc.min(8) };
        let length = if is_remote { longest } else { self.valid.map_or(longest, |valid| valid.min(longest)) };
        let length = if is_fd && !is_fd_length(length) { longest } else { length };
        let mut bytes = [0; MAX_DATA];
        // Some writers omit trailing bytes that are 0.
        let count = usize::from(length).min(data.len());
        if let (Some(target), Some(source), false) = (bytes.get_mut(..count), data.get(..count), is_remote) {
            target.copy_from_slice(source);
        }
        let raw_dlc = if dlc > 8 && !is_fd && length == 8 { dlc } else { 0 };
        Some(FrameObject::Frame(Frame {
            id,
            flags: self.flags.with(way),
            length,
            raw_dlc,
            bytes,
            ..Frame::EMPTY
        }))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn frame(content: Option<FrameObject>) -> Frame {
        match content {
            Some(FrameObject::Frame(frame)) => frame,
            other => panic!("{other:?}"),
        }
    }

    const CLASSIC: [u8; 16] = [1, 0, 1, 3, 0x81, 0x01, 0, 0, 0xAA, 0xBB, 0xCC, 0, 0, 0, 0, 0];

    #[test]
    fn a_classic_frame() {
        let sent = frame(parse_classic(&CLASSIC));
        assert_eq!((sent.id, sent.data()), (CanId::Standard(0x181), &[0xAA, 0xBB, 0xCC][..]));
        assert_eq!(sent.flags, FrameFlags::TRANSMITTED);
        let mut body = CLASSIC;
        (body[2], body[3], body[7]) = (0x80, 4, 0x80);
        let remote = frame(parse_classic(&body));
        assert_eq!((remote.id, remote.length, remote.data()), (CanId::Extended(0x181), 4, &[][..]));
        assert_eq!(remote.flags, FrameFlags::REMOTE.with(FrameFlags::RECEIVED));
        body[2..4].copy_from_slice(&[0, 15]);
        let long = frame(parse_classic(&body));
        assert_eq!((long.length, long.raw_dlc), (8, 15));
        assert_eq!(parse_classic(&CLASSIC[..15]), None);
    }

    #[test]
    fn a_request_to_send_is_none() {
        let mut body = CLASSIC;
        body[2] = 2;
        assert_eq!(parse_classic(&body), Some(FrameObject::Request));
        body[2] = 0x22;
        assert_eq!(frame(parse_classic(&body)).flags, FrameFlags::RECEIVED, "the line was looked at");
    }

    #[test]
    fn an_fd_frame() {
        let mut body = [0; 84];
        body[..8].copy_from_slice(&[2, 0, 0, 10, 0x10, 0, 0, 0]);
        (body[13], body[14]) = (0b111, 16);
        body[20..36].copy_from_slice(&[7; 16]);
        let content = frame(parse_fd(&body));
        assert_eq!(content.data(), [7; 16]);
        let flags = FrameFlags::FD.with(FrameFlags::BIT_RATE_SWITCH).with(FrameFlags::ERROR_STATE);
        assert_eq!(content.flags, flags.with(FrameFlags::RECEIVED));
        body[13] = 0;
        let classic = frame(parse_fd(&body));
        assert_eq!((classic.data(), classic.raw_dlc), (&[7; 8][..], 10), "a classic frame on an FD channel");
    }

    #[test]
    fn data_that_were_not_recorded_are_zero() {
        let mut body = vec![0; 44];
        (body[0], body[1], body[2], body[13], body[34]) = (1, 9, 12, 0x10, 1);
        body[40..44].copy_from_slice(&[5; 4]);
        let content = frame(fd_64(&body, 32));
        assert_eq!(content.data(), [5, 5, 5, 5, 0, 0, 0, 0, 0, 0, 0, 0]);
        assert!(content.flags.contains(FrameFlags::FD.with(FrameFlags::TRANSMITTED)));
        body[35] = 32 + 40 + 2;
        assert_eq!(frame(fd_64(&body, 32)).data()[..4], [5, 5, 0, 0], "further data follow");
        body[34] = 2;
        assert_eq!(fd_64(&body, 32), Some(FrameObject::Request));
    }
}
