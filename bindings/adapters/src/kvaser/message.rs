//! Messages of CANlib.

use super::api::Received;
use crate::{BusError, Reading, ReceivedFrame, Violation};

// Flags of a message (`canMSG_…`, `canFDMSG_FDF`).
const REMOTE: u32 = 0x0001;
const EXTENDED: u32 = 0x0004;
const ERROR: u32 = 0x0020;
const TRANSMITTED: u32 = 0x0040 | 0x0080;
const FD: u32 = 0x0001_0000;

/// Lost messages, by controller or driver (`canMSGERR_OVERRUN`).
const OVERRUN: u32 = 0x0600;

/// Kinds of errors (`canMSGERR_…`).
const VIOLATIONS: &[(u32, Violation)] = &[
    (0x0800, Violation::Stuff),
    (0x1000, Violation::Form),
    (0x2000, Violation::Checksum),
    (0xC000, Violation::Bit),
];

/// Whether messages before this one are lost.
pub(super) fn is_overrun(received: &Received) -> bool {
    received.flags & OVERRUN != 0
}

/// The reading of a message; `None` if it is not from the bus. `scale` is the unit of its time in µs.
pub(super) fn reading(received: &Received, scale: u32) -> Option<Reading> {
    // The lowest 32 bits of the time in µs.
    let [a, b, c, d, ..] = received.time.to_le_bytes();
    let stamp = u32::from_le_bytes([a, b, c, d]).wrapping_mul(scale);
    if received.flags & ERROR != 0 {
        let kind = VIOLATIONS.iter().find(|(bits, _)| received.flags & bits != 0);
        return Some(Reading::Error(BusError {
            violation: Some(kind.map_or(Violation::Other, |(_, violation)| *violation)),
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
        return Some(Reading::Invalid("FD frame from a driver in classic mode".into()));
    }
    let Ok(id) = u32::try_from(received.id) else {
        return Some(Reading::Invalid(format!(
            "identifier {} from the driver; expected 0 or more",
            received.id
        )));
    };
    let (Ok(length), Some(data)) = (u8::try_from(received.length), received.data.first_chunk()) else {
        return Some(Reading::Invalid(format!(
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
    Some(frame.checked())
}

#[cfg(test)]
mod tests {
    use super::*;

    fn received(id: i64, flags: u32, length: u32) -> Received {
        let mut data = [0xEE; 64];
        data[..8].copy_from_slice(&[1, 2, 3, 4, 5, 6, 7, 8]);
        Received { id, data, length, flags, time: 2_345 }
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
        assert_eq!(reading(&received(0x181, 2, 8), 1), Some(Reading::Frame(frame)));
        let extended = ReceivedFrame { id: 0x18FE_F100, is_extended: true, length: 3, ..frame };
        assert_eq!(reading(&received(0x18FE_F100, 4, 3), 1), Some(Reading::Frame(extended)));
        let remote = ReceivedFrame { is_remote: true, length: 0, stamp: 23_450, ..frame };
        assert_eq!(reading(&received(0x181, 3, 0), 10), Some(Reading::Frame(remote)));
        assert_eq!(reading(&received(0x181, 0x42, 8), 1), None);
        assert!(is_overrun(&received(0x181, 0x0402, 8)) && is_overrun(&received(0x181, 0x0202, 8)));
        assert!(!is_overrun(&received(0x181, 2, 8)));
    }

    #[test]
    fn values_that_no_frame_can_have_are_reported() {
        let invalid = |received: Received, text: &str| {
            assert_eq!(reading(&received, 1), Some(Reading::Invalid(text.into())));
        };
        invalid(received(-1, 2, 8), "identifier -1 from the driver; expected 0 or more");
        invalid(received(0x800, 2, 8), "identifier 800 from the driver; expected 0 to 7FF");
        invalid(received(1, 2, 9), "length 9 from the driver; expected 0 to 8");
        invalid(received(1, 2, u32::MAX), "length 4294967295 from the driver; expected 0 to 8");
        invalid(received(1, 0x1_0002, 8), "FD frame from a driver in classic mode");
    }

    #[test]
    fn errors_have_a_kind() {
        let kind = |flags: u32| match reading(&received(0, 0x20 | flags, 0), 1) {
            Some(Reading::Error(error)) => error.violation,
            other => panic!("{other:?}"),
        };
        assert_eq!(kind(0x0800), Some(Violation::Stuff));
        assert_eq!(kind(0x1000), Some(Violation::Form));
        assert_eq!(kind(0x2000), Some(Violation::Checksum));
        assert_eq!(kind(0x4000), Some(Violation::Bit));
        assert_eq!(kind(0x8000), Some(Violation::Bit));
        assert_eq!(kind(0), Some(Violation::Other));
    }

    #[test]
    fn only_the_lowest_32_bits_of_a_time_are_used() {
        let long = Received { time: 0x7_0000_0001, ..received(1, 2, 8) };
        let Some(Reading::Frame(frame)) = reading(&long, 1) else { panic!("a frame") };
        assert_eq!(frame.stamp, 1);
    }
}
