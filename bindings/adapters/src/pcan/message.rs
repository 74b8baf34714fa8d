//! Messages of PCAN-Basic.

use crate::{BusError, ErrorCounters, ReceivedFrame, ReceivedItem, ViolationKind};

// Kinds of messages (`PCAN_MESSAGE_…`), as bits.
const REMOTE: u8 = 0x01;
const EXTENDED: u8 = 0x02;
const FD: u8 = 0x04;
const ECHO: u8 = 0x20;
const ERROR: u8 = 0x40;
const STATUS: u8 = 0x80;

/// A kind with all bits, which the driver never writes.
const NOT_WRITTEN: u8 = 0xFF;

/// `TPCANMsg`, followed by room for a driver that writes more than the header states.
#[derive(Debug, Clone, Copy)]
#[repr(C)]
pub(super) struct PcanMessage {
    id: u32,
    kind: u8,
    length: u8,
    data: [u8; 8],
    room: [u8; 64],
}

/// `TPCANTimestamp`.
#[derive(Debug, Clone, Copy, Default)]
#[repr(C)]
pub(super) struct PcanTimestamp {
    milliseconds: u32,
    overflows: u16,
    microseconds: u16,
}

impl PcanTimestamp {
    /// The time in µs, of which the lowest 32 bits are kept. Overflows count 2³² ms, which are a multiple of 2³² µs.
    fn low_bits(self) -> u32 {
        self.milliseconds.wrapping_mul(1_000).wrapping_add(u32::from(self.microseconds))
    }
}

/// Content of a message.
#[derive(Debug, PartialEq, Eq)]
pub(super) enum PcanContent {
    Reading(ReceivedItem),
    /// A report of status bits.
    Status(u32),
    /// Nothing from the bus.
    None,
}

impl PcanMessage {
    /// A message that the driver has not written.
    pub(super) const UNWRITTEN: Self =
        Self { id: 0, kind: NOT_WRITTEN, length: 0, data: [0; 8], room: [0; 64] };

    pub(super) fn is_written(&self) -> bool {
        self.kind != NOT_WRITTEN
    }

    pub(super) fn message_content(&self, stamp: PcanTimestamp) -> PcanContent {
        let stamp = stamp.low_bits();
        if self.kind & STATUS != 0 {
            let [a, b, c, d, ..] = self.data;
            return PcanContent::Status(u32::from_be_bytes([a, b, c, d]));
        }
        if self.kind & ERROR != 0 {
            return PcanContent::Reading(ReceivedItem::Error(self.bus_error(stamp)));
        }
        if self.kind & ECHO != 0 {
            return PcanContent::None;
        }
        if self.kind & FD != 0 {
            return PcanContent::Reading(ReceivedItem::Invalid(
                "FD frame from a driver in classic mode".into(),
            ));
        }
        let frame = ReceivedFrame {
            id: self.id,
            is_extended: self.kind & EXTENDED != 0,
            is_remote: self.kind & REMOTE != 0,
            length: self.length,
            data: self.data,
            stamp,
        };
        PcanContent::Reading(frame.check_frame())
    }

    fn bus_error(&self, stamp: u32) -> BusError {
        let [direction, place, receive, transmit, ..] = self.data;
        let violation = match self.id {
            0 => None,
            1 => Some(ViolationKind::Bit),
            2 => Some(ViolationKind::Form),
            4 => Some(ViolationKind::Stuff),
            _ => Some(ViolationKind::Other),
        };
        BusError {
            violation,
            is_transmitting: direction == 0 && violation.is_some(),
            place: place & 0x1F,
            counters: Some(ErrorCounters { receive, transmit }),
            stamp,
        }
    }
}

#[cfg(test)]
mod tests {
    use std::mem::{offset_of, size_of};

    use super::*;

    const STAMP: PcanTimestamp = PcanTimestamp { milliseconds: 2, overflows: 0, microseconds: 345 };

    fn message(id: u32, kind: u8, data: &[u8]) -> PcanMessage {
        let mut bytes = [0; 8];
        bytes[..data.len()].copy_from_slice(data);
        PcanMessage {
            id,
            kind,
            length: data.len().try_into().unwrap(),
            data: bytes,
            ..PcanMessage::UNWRITTEN
        }
    }

    #[test]
    fn the_structures_have_the_layout_of_the_header() {
        assert_eq!((offset_of!(PcanMessage, kind), offset_of!(PcanMessage, data)), (4, 6));
        assert_eq!((size_of::<PcanTimestamp>(), offset_of!(PcanTimestamp, microseconds)), (8, 6));
    }

    #[test]
    fn frames_of_each_kind() {
        let frame = ReceivedFrame {
            id: 0x181,
            is_extended: false,
            is_remote: false,
            length: 2,
            data: [1, 2, 0, 0, 0, 0, 0, 0],
            stamp: 2_345,
        };
        let expected = |frame| PcanContent::Reading(ReceivedItem::Frame(frame));
        assert_eq!(message(0x181, 0, &[1, 2]).message_content(STAMP), expected(frame));
        let extended = ReceivedFrame { id: 0x18FE_F100, is_extended: true, ..frame };
        assert_eq!(message(0x18FE_F100, 2, &[1, 2]).message_content(STAMP), expected(extended));
        let remote = ReceivedFrame { id: 0x701, is_remote: true, length: 1, data: [0; 8], ..frame };
        assert_eq!(message(0x701, 1, &[0]).message_content(STAMP), expected(remote));
        assert_eq!(message(0x701, 0x20, &[0]).message_content(STAMP), PcanContent::None);
        let PcanContent::Reading(ReceivedItem::Invalid(_)) = message(0x701, 4, &[0]).message_content(STAMP)
        else {
            panic!("an FD frame")
        };
        assert!(!PcanMessage::UNWRITTEN.is_written() && message(0, 0, &[]).is_written());
    }

    /// "Error Frames": the identifier is the kind; direction, position, receive and transmit error counter follow.
    #[test]
    fn errors_have_kind_position_and_counters() {
        let error = BusError {
            violation: Some(ViolationKind::Stuff),
            is_transmitting: false,
            place: 10,
            counters: Some(ErrorCounters { receive: 96, transmit: 0 }),
            stamp: 2_345,
        };
        let expected = |error| PcanContent::Reading(ReceivedItem::Error(error));
        assert_eq!(message(4, 0x40, &[1, 10, 96, 0]).message_content(STAMP), expected(error));
        let counters = BusError {
            violation: None,
            place: 0,
            counters: Some(ErrorCounters { receive: 1, transmit: 2 }),
            ..error
        };
        assert_eq!(message(0, 0x40, &[0, 0, 1, 2]).message_content(STAMP), expected(counters));
    }

    #[test]
    fn a_status_has_its_most_significant_byte_first() {
        assert_eq!(message(1, 0x80, &[0, 0, 0, 0x40]).message_content(STAMP), PcanContent::Status(0x40));
        assert_eq!(message(1, 0x80, &[0, 4, 0, 0]).message_content(STAMP), PcanContent::Status(0x4_0000));
    }

    /// 4,294,967 ms and 296 µs are 2³² µs.
    #[test]
    fn stamps_continue_with_0_after_32_bits() {
        let stamp = |milliseconds, microseconds| {
            PcanTimestamp { milliseconds, overflows: 7, microseconds }.low_bits()
        };
        assert_eq!(stamp(4_294_967, 295), u32::MAX);
        assert_eq!(stamp(4_294_967, 296), 0);
        assert_eq!(stamp(u32::MAX, 999), u32::MAX);
    }
}
