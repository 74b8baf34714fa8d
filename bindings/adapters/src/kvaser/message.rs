//! Messages of CANlib.

use super::api::CanlibMessage;
use crate::{BusError, ReceivedFrame, ReceivedItem, ViolationKind};

// Flags of a message (`canMSG_…`, `canFDMSG_FDF`).
const REMOTE: u32 = 0x0001;
const EXTENDED: u32 = 0x0004;
const ERROR: u32 = 0x0020;
const TRANSMITTED: u32 = 0x0040 | 0x0080;
const FD: u32 = 0x0001_0000;

/// Lost messages, by controller or driver (`canMSGERR_OVERRUN`).
const OVERRUN: u32 = 0x0600;

/// Kinds of errors (`canMSGERR_…`).
const VIOLATIONS: &[(u32, ViolationKind)] = &[
    (0x0800, ViolationKind::Stuff),
    (0x1000, ViolationKind::Form),
    (0x2000, ViolationKind::Checksum),
    (0xC000, ViolationKind::Bit),
];

/// Whether messages before this one are lost.
pub(super) fn is_overrun(received: &CanlibMessage) -> bool {
    received.flags & OVERRUN != 0
}

/// The reading of a message; `None` if it is not from the bus. `scale` is the unit of its time in µs.
pub(super) fn to_item(received: &CanlibMessage, scale: u32) -> Option<ReceivedItem> {
    // The lowest 32 bits of the time in µs.
    let [a, b, c, d, ..] = received.time.to_le_bytes();
    let stamp = u32::from_le_bytes([a, b, c, d]).wrapping_mul(scale);
    if received.flags & ERROR != 0 {
        let kind = VIOLATIONS.iter().find(|(bits, _)| received.flags & bits != 0);
        return Some(ReceivedItem::Error(BusError {
            violation: Some(kind.map_or(ViolationKind::Other, |(_, violation)| *violation)),
            is_transmitting: false,
            place: 0,
            counters: None,
            stamp,
        }));
    }
    if received.flags & TRANSMITTED != 0 {
        return None;
    }
    if received.flags & FD != 0 {
        return Some(ReceivedItem::Invalid("FD frame from a driver in classic mode".into()));
    }
    let Ok(id) = u32::try_from(received.id) else {
        return Some(ReceivedItem::Invalid(format!(
            "identifier {} from the driver; expected 0 or more",
            received.id
        )));
    };
    let (Ok(length), Some(data)) = (u8::try_from(received.length), received.data.first_chunk()) else {
        return Some(ReceivedItem::Invalid(format!(
            "length {} from the driver; expected 0 to 8",
            received.length
        )));
    };
    let frame = ReceivedFrame {
        id,
        is_extended: received.flags & EXTENDED != 0,
        is_remote: received.flags & REMOTE != 0,
        length,
        data: *data,
        stamp,
    };
    Some(frame.check_frame())
}

#[cfg(test)]
mod tests {
    use super::*;

    fn received(id: i64, flags: u32, length: u32) -> CanlibMessage {
        let mut data = [0xEE; 64];
        data[..8].copy_from_slice(&[1, 2, 3, 4, 5, 6, 7, 8]);
        CanlibMessage { id, data, length, flags, time: 2_345 }
    }

    #[test]
    fn frames_of_each_kind() {
        let frame = ReceivedFrame {
            id: 0x181,
            is_extended: false,
            is_remote: false,
            length: 8,
            data: [1, 2, 3, 4, 5, 6, 7, 8],
            stamp: 2_345,
        };
        assert_eq!(to_item(&received(0x181, 2, 8), 1), Some(ReceivedItem::Frame(frame)));
        let extended = ReceivedFrame { id: 0x18FE_F100, is_extended: true, length: 3, ..frame };
        assert_eq!(to_item(&received(0x18FE_F100, 4, 3), 1), Some(ReceivedItem::Frame(extended)));
        let remote = ReceivedFrame { is_remote: true, length: 0, stamp: 23_450, ..frame };
        assert_eq!(to_item(&received(0x181, 3, 0), 10), Some(ReceivedItem::Frame(remote)));
        assert_eq!(to_item(&received(0x181, 0x42, 8), 1), None);
        assert!(is_overrun(&received(0x181, 0x0402, 8)) && is_overrun(&received(0x181, 0x0202, 8)));
        assert!(!is_overrun(&received(0x181, 2, 8)));
    }

    #[test]
    fn values_that_no_frame_can_have_are_reported() {
        let invalid = |received: CanlibMessage, text: &str| {
            assert_eq!(to_item(&received, 1), Some(ReceivedItem::Invalid(text.into())));
        };
        invalid(received(-1, 2, 8), "identifier -1 from the driver; expected 0 or more");
        invalid(received(0x800, 2, 8), "identifier 800 from the driver; expected 0 to 7FF");
        invalid(received(1, 2, 9), "length 9 from the driver; expected 0 to 8");
        invalid(received(1, 2, u32::MAX), "length 4294967295 from the driver; expected 0 to 8");
        invalid(received(1, 0x1_0002, 8), "FD frame from a driver in classic mode");
    }

    #[test]
    fn errors_have_a_kind() {
        let kind = |flags: u32| match to_item(&received(0, 0x20 | flags, 0), 1) {
            Some(ReceivedItem::Error(error)) => error.violation,
            other => panic!("{other:?}"),
        };
        assert_eq!(kind(0x0800), Some(ViolationKind::Stuff));
        assert_eq!(kind(0x1000), Some(ViolationKind::Form));
        assert_eq!(kind(0x2000), Some(ViolationKind::Checksum));
        assert_eq!(kind(0x4000), Some(ViolationKind::Bit));
        assert_eq!(kind(0x8000), Some(ViolationKind::Bit));
        assert_eq!(kind(0), Some(ViolationKind::Other));
    }

    #[test]
    fn only_the_lowest_32_bits_of_a_time_are_used() {
        let long = CanlibMessage { time: 0x7_0000_0001, ..received(1, 2, 8) };
        let Some(ReceivedItem::Frame(frame)) = to_item(&long, 1) else { panic!("a frame") };
        assert_eq!(frame.stamp, 1);
    }
}
