//! What recorders report of the bus, as the error frames SocketCAN makes of it (linux/can/error.h).
//!
//! ```text
//! identifier  0x004 controller  0x008 protocol  0x020 no acknowledgement  0x040 bus off
//!             0x080 bus error   0x200 counters are filled
//! byte 1  controller   byte 2  protocol violation   byte 3  place in the frame
//! byte 6  transmit error counter   byte 7  receive error counter
//! ```
//!
//! Places in the frame are the segment codes of the SJA1000, which SocketCAN took over, and which PEAK
//! and Vector record too; so they pass through unchanged.

use crate::frame::{CanId, Frame, FrameFlags};

const CONTROLLER: u32 = 0x004;
const PROTOCOL: u32 = 0x008;
const NO_ACKNOWLEDGEMENT: u32 = 0x020;
const BUS_OFF: u32 = 0x040;
const BUS_ERROR: u32 = 0x080;
const COUNTERS: u32 = 0x200;

/// Protocol violation bit: the error came while this controller was sending.
const WHILE_SENDING: u8 = 0x80;

/// Segment code of the acknowledge slot.
const ACKNOWLEDGE_SLOT: u8 = 0x19;

/// How a frame broke the protocol.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum Violation {
    /// A bit was read back other than it was sent.
    Bit,
    /// A field of fixed form was wrong.
    Form,
    /// More than five equal bits.
    Stuff,
    /// The checksum was wrong. SocketCAN has no bit for it, only the place.
    Checksum,
    /// Nobody acknowledged.
    Acknowledgement,
    /// The acknowledge delimiter was wrong.
    AcknowledgeDelimiter,
    /// An overload frame.
    Overload,
    /// Something else, or not recorded.
    Other,
}

impl Violation {
    /// Violation bit, and the place it implies.
    const fn code(self) -> (u8, u8) {
        match self {
            Self::Bit => (0x01, 0),
            Self::Form => (0x02, 0),
            Self::Stuff => (0x04, 0),
            Self::Checksum => (0, 0x08),
            Self::Acknowledgement => (0, ACKNOWLEDGE_SLOT),
            Self::AcknowledgeDelimiter => (0x02, 0x1B),
            Self::Overload => (0x20, 0),
            Self::Other => (0, 0),
        }
    }
}

/// Error counters of a controller.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) struct Counters {
    /// Receive error counter.
    pub(super) receive: u8,
    /// Transmit error counter.
    pub(super) transmit: u8,
}

/// State of a controller.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum ControllerState {
    /// Recovered to error active.
    Active,
    /// A counter reached the warning limit.
    Warning,
    /// Error passive.
    Passive,
    /// Off the bus.
    BusOff,
    /// A frame was lost: the controller was read too late.
    Overrun,
}

/// An error on the bus, at segment code `place` (0 = unknown).
pub(super) fn violation(kind: Violation, sending: bool, place: u8, counters: Option<Counters>) -> Frame {
    let (bit, implied) = kind.code();
    let place = if place == 0 { implied } else { place };
    let mut classes = PROTOCOL;
    if kind != Violation::Overload {
        classes |= BUS_ERROR;
    }
    // A sender's unclassified error in the acknowledge slot is the missing acknowledgement.
    let unanswered = kind == Violation::Other && sending && place == ACKNOWLEDGE_SLOT;
    if kind == Violation::Acknowledgement || unanswered {
        classes |= NO_ACKNOWLEDGEMENT;
    }
    let sending = if sending { WHILE_SENDING } else { 0 };
    report(classes, [0, 0, bit | sending, place, 0, 0], counters)
}

/// A change of a controller's state. Which of its counters caused it is not known, so the bits of
/// both are set.
pub(super) fn controller(state: ControllerState) -> Frame {
    let (classes, detail) = match state {
        ControllerState::Active => (CONTROLLER, 0x40),
        ControllerState::Warning => (CONTROLLER, 0x0C),
        ControllerState::Passive => (CONTROLLER, 0x30),
        ControllerState::BusOff => (BUS_OFF, 0),
        ControllerState::Overrun => (CONTROLLER, 0x01),
    };
    report(classes, [0, detail, 0, 0, 0, 0], None)
}

/// New values of a controller's counters, and nothing else.
pub(super) fn counters(counters: Counters) -> Frame {
    report(0, [0; 6], Some(counters))
}

fn report(classes: u32, bytes: [u8; 6], counters: Option<Counters>) -> Frame {
    let [b0, b1, b2, b3, b4, b5] = bytes;
    let (classes, transmit, receive) = match counters {
        Some(Counters { receive, transmit }) => (classes | COUNTERS, transmit, receive),
        None => (classes, 0, 0),
    };
    let mut frame = Frame::data_frame(CanId::extended(classes), &[b0, b1, b2, b3, b4, b5, transmit, receive]);
    frame.flags = FrameFlags::ERROR;
    frame
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_stuff_error_while_receiving_with_counters() {
        let counters = Counters { receive: 8, transmit: 2 };
        let frame = violation(Violation::Stuff, false, 0x02, Some(counters));
        assert_eq!(frame.id, CanId::Extended(0x288));
        assert_eq!(frame.data(), [0, 0, 0x04, 0x02, 0, 0, 2, 8]);
        assert_eq!(frame.flags, FrameFlags::ERROR);
    }

    #[test]
    fn a_missing_acknowledgement_is_told_by_its_place() {
        let frame = violation(Violation::Other, true, ACKNOWLEDGE_SLOT, None);
        assert_eq!(frame.id, CanId::Extended(0x0A8));
        assert_eq!(frame.data(), [0, 0, 0x80, 0x19, 0, 0, 0, 0]);
        assert_eq!(violation(Violation::Other, false, ACKNOWLEDGE_SLOT, None).id, CanId::Extended(0x088));
        assert_eq!(violation(Violation::Acknowledgement, true, 0, None).data(), frame.data());
    }

    #[test]
    fn bus_off_is_a_class_of_its_own() {
        assert_eq!(controller(ControllerState::BusOff).id, CanId::Extended(0x040));
        assert_eq!(controller(ControllerState::Warning).data()[1], 0x0C);
    }
}
