//! Messages of ROS: CDR (ROS 2, OMG DDS-XTypes 7.4.1) and the packed form of ROS 1.
//!
//! ```text
//! CDR    0 order: 0x0000 big-endian, 0x0001 little-endian (2)  options (2)  4 fields, aligned to their size
//! ROS 1  fields, little-endian, without gaps
//! ```
//! Lengths of strings and arrays have four bytes; the length of a string in CDR includes its final NUL.

use super::layout::{CanMessageLayout, ElementCount, FieldRole, MessageField, MessageFieldType};
use crate::capture::byte_order::ByteOrder;
use crate::frame::{CanId, Frame, FrameFlags, MAX_DATA, fd_length};

/// Maximum length of a string in bytes; the rest is ignored.
const LONGEST_TEXT: usize = 64;

/// Flags of SocketCAN in an identifier.
const EXTENDED: u32 = 0x8000_0000;
const REMOTE: u32 = 0x4000_0000;
const ERROR: u32 = 0x2000_0000;

/// Encoding of fields.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum FieldEncoding {
    Cdr,
    Ros1,
}

/// Content of a message.
#[derive(Debug, PartialEq)]
pub(super) struct MessageFrame<'a> {
    /// The frame, without bus, number and time.
    pub(super) frame: Frame,
    /// Timestamp in nanoseconds, if present.
    pub(super) stamp: Option<i64>,
    /// Bus name in the message.
    pub(super) bus: &'a [u8],
}

/// Parses the frame in a message.
///
/// # Errors
/// Description of the invalid part.
pub(super) fn read_message<'a>(
    layout: &CanMessageLayout,
    encoding: FieldEncoding,
    bytes: &'a [u8],
) -> Result<MessageFrame<'a>, &'static str> {
    let mut fields = MessageFieldReader::new(encoding, bytes)?;
    let mut values = FrameFieldValues::default();
    for field in &layout.fields {
        fields.read_field(*field, &mut values).ok_or("the message ends inside a field")?;
    }
    values.found_frame(layout.is_fd)
}

/// Values of the fields with a meaning.
#[derive(Default)]
struct FrameFieldValues<'a> {
    seconds: i64,
    nanoseconds: i64,
    bus: &'a [u8],
    id: u32,
    extended: Option<bool>,
    remote: bool,
    error: bool,
    length: Option<u8>,
    data: &'a [u8],
    fd: Option<bool>,
    switched: bool,
    passive: bool,
}

impl<'a> FrameFieldValues<'a> {
    fn set_number(&mut self, role: FieldRole, value: u64) {
        let is_set = value != 0;
        match role {
            FieldRole::Seconds => self.seconds = i64::try_from(value).unwrap_or(0),
            FieldRole::Nanoseconds => self.nanoseconds = i64::try_from(value).unwrap_or(0),
            FieldRole::Id => self.id = u32::try_from(value).unwrap_or(u32::MAX),
            FieldRole::Extended => self.extended = Some(is_set),
            FieldRole::Remote => self.remote = is_set,
            FieldRole::Error => self.error = is_set,
            FieldRole::Length => self.length = Some(u8::try_from(value).unwrap_or(u8::MAX)),
            FieldRole::Fd => self.fd = Some(is_set),
            FieldRole::BitRateSwitch => self.switched = is_set,
            FieldRole::ErrorState => self.passive = is_set,
            FieldRole::Bus | FieldRole::Data => {}
        }
    }

    fn found_frame(self, may_be_fd: bool) -> Result<MessageFrame<'a>, &'static str> {
        let is_error = self.error || self.extended.is_none() && self.id & ERROR != 0;
        let is_remote = self.remote || self.extended.is_none() && self.id & REMOTE != 0;
        let is_fd = self.fd.unwrap_or(may_be_fd) && !is_error && !is_remote;
        let number = self.id & 0x1FFF_FFFF;
        let is_extended = self.extended.unwrap_or(self.id & EXTENDED != 0 || number > 0x7FF);
        let id = match number {
            _ if is_error || is_extended => CanId::from_extended(number),
            0..=0x7FF => CanId::from_standard(u16::try_from(number).unwrap_or(0)),
            _ => return Err("identifier: expected up to 7FF in a base frame"),
        };
        let reported = self.length.unwrap_or(u8::try_from(self.data.len()).unwrap_or(u8::MAX));
        let (length, raw_dlc) = frame_length(reported, is_fd, self.data.len())?;
        let mut flags = FrameFlags::default();
        let set = [
            (is_error, FrameFlags::ERROR),
            (is_remote, FrameFlags::REMOTE),
            (is_fd, FrameFlags::FD),
            (is_fd && self.switched, FrameFlags::BIT_RATE_SWITCH),
            (is_fd && self.passive, FrameFlags::ERROR_STATE),
        ];
        for (_, flag) in set.iter().filter(|(is_set, _)| *is_set) {
            flags = flags.with(*flag);
        }
        let data = self.data.get(..usize::from(length)).filter(|_| !is_remote);
        if data.is_none() && !is_remote {
            return Err("data: fewer bytes than the length");
        }
        let mut frame = Frame::data_frame(id, data.unwrap_or_default());
        (frame.flags, frame.length, frame.raw_dlc) = (flags, length, raw_dlc);
        let stamp = self.seconds.saturating_mul(1_000_000_000).saturating_add(self.nanoseconds);
        Ok(MessageFrame { frame, stamp: (stamp != 0).then_some(stamp), bus: self.bus })
    }
}

/// Length in bytes, and the DLC of a classic frame if above 8. The field contains a length; for FD frames
/// some writers store the DLC.
fn frame_length(reported: u8, is_fd: bool, available: usize) -> Result<(u8, u8), &'static str> {
    match reported {
        0..=8 => Ok((reported, 0)),
        9..=15 if !is_fd => Ok((8, reported)),
        9..=15 if available == usize::from(fd_length(reported)) => Ok((fd_length(reported), 0)),
        12 | 16 | 20 | 24 | 32 | 48 | 64 if is_fd => Ok((reported, 0)),
        _ => Err("length: expected 0 to 8, or 12, 16, 20, 24, 32, 48 or 64 in CAN FD"),
    }
}

/// Reads the fields of a message in order.
struct MessageFieldReader<'a> {
    bytes: &'a [u8],
    at: usize,
    order: ByteOrder,
    encoding: FieldEncoding,
}

impl<'a> MessageFieldReader<'a> {
    fn new(encoding: FieldEncoding, bytes: &'a [u8]) -> Result<Self, &'static str> {
        let order = match (encoding, bytes) {
            (FieldEncoding::Ros1, _) | (FieldEncoding::Cdr, [0, 1, _, _, ..]) => ByteOrder::Little,
            (FieldEncoding::Cdr, [0, 0, _, _, ..]) => ByteOrder::Big,
            _ => return Err("CDR: expected 00 00 or 00 01 at the start"),
        };
        let bytes = if encoding == FieldEncoding::Cdr { bytes.get(4..).unwrap_or_default() } else { bytes };
        Ok(Self { bytes, at: 0, order, encoding })
    }

    fn align_to(&mut self, size: usize) {
        if self.encoding == FieldEncoding::Cdr {
            self.at = self.at.next_multiple_of(size);
        }
    }

    fn take_bytes(&mut self, count: usize) -> Option<&'a [u8]> {
        let taken = self.bytes.get(self.at..)?.get(..count)?;
        self.at += count;
        Some(taken)
    }

    fn read_number(&mut self, size: usize) -> Option<u64> {
        self.align_to(size);
        let bytes = self.take_bytes(size)?;
        match size {
            1 => bytes.first().map(|byte| (*byte).into()),
            2 => self.order.u16(bytes, 0).map(Into::into),
            4 => self.order.u32(bytes, 0).map(Into::into),
            _ => self.order.u64(bytes, 0),
        }
    }

    fn read_text(&mut self) -> Option<&'a [u8]> {
        let length = usize::try_from(self.read_number(4)?).ok()?;
        let text = self.take_bytes(length)?;
        let text =
            if self.encoding == FieldEncoding::Cdr { text.strip_suffix(b"\0").unwrap_or(text) } else { text };
        Some(text.get(..LONGEST_TEXT).unwrap_or(text))
    }

    fn read_field(&mut self, field: MessageField, values: &mut FrameFieldValues<'a>) -> Option<()> {
        let count = match field.count {
            ElementCount::One => 1,
            ElementCount::Fixed(count) => count,
            ElementCount::Stored => usize::try_from(self.read_number(4)?).ok()?,
        };
        match (field.kind, field.role) {
            (MessageFieldType::Number(1), Some(FieldRole::Data)) => {
                let data = self.take_bytes(count)?;
                values.data = data.get(..MAX_DATA).unwrap_or(data);
            }
            (MessageFieldType::Number(size), Some(role)) => values.set_number(role, self.read_number(size)?),
            (MessageFieldType::Number(size), None) => {
                self.align_to(if count == 0 { 1 } else { size });
                self.take_bytes(size.checked_mul(count)?)?;
            }
            (MessageFieldType::Text, Some(FieldRole::Bus)) => values.bus = self.read_text()?,
            // Each string uses at least its length field, so the data bounds the number of iterations.
            (MessageFieldType::Text, _) => (0..count).try_for_each(|_| self.read_text().map(|_| ()))?,
        }
        Some(())
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn ros2() -> CanMessageLayout {
        CanMessageLayout::parse_definition(include_bytes!("frame.msg")).unwrap()
    }

    #[test]
    fn a_frame_of_ros2() {
        // Second 1, nanosecond 2, "can0", 0x18FECA80 extended, 3 bytes.
        let bytes = b"\0\x01\0\0\x01\0\0\0\x02\0\0\0\x05\0\0\0can0\0\0\0\0\x80\xCA\xFE\x18\0\x01\0\x03\x11\x22\x33\0\0\0\0\0";
        let found = read_message(&ros2(), FieldEncoding::Cdr, bytes).unwrap();
        assert_eq!(found.frame, Frame::data_frame(CanId::from_extended(0x18FE_CA80), &[0x11, 0x22, 0x33]));
        assert_eq!((found.stamp, found.bus), (Some(1_000_000_002), &b"can0"[..]));
        for end in 0..bytes.len() {
            assert!(read_message(&ros2(), FieldEncoding::Cdr, &bytes[..end]).is_err(), "{end}");
        }
    }

    #[test]
    fn big_endian_and_a_remote_frame() {
        let bytes = b"\0\0\0\0\0\0\0\0\0\0\0\0\0\0\0\x01\0\0\0\0\0\0\x07\x01\x01\0\0\x02\0\0\0\0\0\0\0\0";
        let found = read_message(&ros2(), FieldEncoding::Cdr, bytes).unwrap();
        assert_eq!(found.frame.flags, FrameFlags::REMOTE);
        assert_eq!((found.frame.id, found.frame.length), (CanId::from_standard(0x701), 2));
        assert_eq!((found.stamp, found.bus), (None, &b""[..]));
    }

    #[test]
    fn a_frame_of_ros1_has_no_gaps() {
        let text = "Header header\nuint32 id\nbool is_rtr\nbool is_extended\nbool is_error\nuint8 dlc\nuint8[8] data\n\
                    ====\nMSG: std_msgs/Header\nuint32 seq\ntime stamp\nstring frame_id\n";
        let layout = CanMessageLayout::parse_definition(text.as_bytes()).unwrap();
        let bytes =
            b"\x09\0\0\0\x01\0\0\0\0\0\0\0\x03\0\0\0canW\x01\0\0\0\0\0\x09\x01\x02\x03\x04\x05\x06\x07\x08";
        let found = read_message(&layout, FieldEncoding::Ros1, bytes).unwrap();
        let expected =
            Frame { raw_dlc: 9, ..Frame::data_frame(CanId::from_standard(0x157), &[1, 2, 3, 4, 5, 6, 7, 8]) };
        assert_eq!((found.frame, found.bus, found.stamp), (expected, &b"can"[..], Some(1_000_000_000)));
    }

    #[test]
    fn lengths_that_no_frame_has_are_refused() {
        assert_eq!(frame_length(15, false, 8), Ok((8, 15)));
        assert_eq!(frame_length(15, true, 64), Ok((64, 0)));
        assert_eq!(frame_length(12, true, 12), Ok((12, 0)));
        assert_eq!(
            frame_length(10, true, 64),
            Err("length: expected 0 to 8, or 12, 16, 20, 24, 32, 48 or 64 in CAN FD")
        );
        assert!(frame_length(65, true, 64).is_err());
        assert!(frame_length(16, false, 64).is_err());
    }
}
