//! Bus errors of recorders as SocketCAN error frames (linux/can/error.h).
//!
//! ```text
//! identifier  0x004 controller  0x008 protocol  0x020 no acknowledgement  0x040 bus off
//!             0x080 bus error   0x200 counters valid
//! byte 1  controller   byte 2  protocol violation   byte 3  location in the frame
//! byte 6  transmit error counter   byte 7  receive error counter
//! ```
//!
//! Locations in the frame are the segment codes of the SJA1000. SocketCAN, PEAK and Vector use the same
//! codes, so they are copied unchanged.

use crate::frame::{CanId, Frame, FrameFlags};

const CONTROLLER: u32 = 0x004;
const PROTOCOL: u32 = 0x008;
const NO_ACKNOWLEDGEMENT: u32 = 0x020;
const BUS_OFF: u32 = 0x040;
const BUS_ERROR: u32 = 0x080;
const RESTARTED: u32 = 0x100;
const COUNTERS: u32 = 0x200;

/// Protocol violation bit: the error occurred while this controller was transmitting.
const WHILE_SENDING: u8 = 0x80;

/// Segment code of the acknowledge slot.
const ACKNOWLEDGE_SLOT: u8 = 0x19;

/// Protocol violation of a frame.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Violation {
    /// Bit error: the bit read back differs from the bit sent.
    Bit,
    /// Form error: invalid bit in a field of fixed form.
    Form,
    /// Stuff error: more than five consecutive equal bits.
    Stuff,
    /// CRC error. SocketCAN has no violation bit for it, only the location.
    Checksum,
    /// Missing acknowledgement.
    Acknowledgement,
    /// Invalid acknowledge delimiter.
    AcknowledgeDelimiter,
    /// Overload frame.
    Overload,
    /// Other violation, or type not recorded.
    Other,
}

impl Violation {
    /// Violation bit, and the location that the violation implies.
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
pub struct Counters {
    /// Receive error counter; 255 if above.
    pub receive: u8,
    /// Transmit error counter; 255 if above.
    pub transmit: u8,
}

impl Counters {
    /// Counters of an error record; `None` if both are 0. A counted error leaves at least one counter above 0
    /// (ISO 11898-1, fault confinement), and recorders without counter values write 0.
    pub(super) fn of_error(self) -> Option<Self> {
        (self.receive > 0 || self.transmit > 0).then_some(self)
    }
}

/// State of a controller, or a change of it.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum ControllerState {
    /// Recovered to error active.
    Active,
    /// An error counter reached the warning limit.
    Warning,
    /// Error passive.
    Passive,
    /// Off the bus.
    BusOff,
    /// Overrun: a frame was lost because the controller was read too late.
    Overrun,
}

/// Error frame of a violation at segment code `place` (0 = unknown).
pub(super) fn violation_frame(
    kind: Violation,
    sending: bool,
    place: u8,
    counters: Option<Counters>,
) -> Frame {
    let (bit, implied) = kind.code();
    let place = if place == 0 { implied } else { place };
    let mut classes = PROTOCOL;
    if kind != Violation::Overload {
        classes |= BUS_ERROR;
    }
    // Missing acknowledgement: a transmitter's unclassified error in the acknowledge slot.
    let unanswered = kind == Violation::Other && sending && place == ACKNOWLEDGE_SLOT;
    if kind == Violation::Acknowledgement || unanswered {
        classes |= NO_ACKNOWLEDGEMENT;
    }
    let sending = if sending { WHILE_SENDING } else { 0 };
    build_error_frame(classes, [0, 0, bit | sending, place, 0, 0], counters)
}

/// Error frame of a state change. The counter that caused it is unknown, so the bits of both counters are
/// set.
pub(super) fn controller_frame(state: ControllerState) -> Frame {
    let (classes, detail) = match state {
        ControllerState::Active => (CONTROLLER, 0x40),
        ControllerState::Warning => (CONTROLLER, 0x0C),
        ControllerState::Passive => (CONTROLLER, 0x30),
        ControllerState::BusOff => (BUS_OFF, 0),
        ControllerState::Overrun => (CONTROLLER, 0x01),
    };
    build_error_frame(classes, [0, detail, 0, 0, 0, 0], None)
}

/// Error frame with only new values of a controller's counters.
pub(super) fn counter_frame(counters: Counters) -> Frame {
    build_error_frame(0, [0; 6], Some(counters))
}

/// Bits of byte 2 and their violations, the most specific first. A bit that could not be sent is a bit error.
const VIOLATIONS: [(u8, Violation); 4] =
    [(0x04, Violation::Stuff), (0x02, Violation::Form), (0x19, Violation::Bit), (0x20, Violation::Overload)];

/// Bits of byte 1 and their states, the most severe first.
const STATES: [(u8, ControllerState); 4] = [
    (0x30, ControllerState::Passive),
    (0x0C, ControllerState::Warning),
    (0x03, ControllerState::Overrun),
    (0x40, ControllerState::Active),
];

/// Protocol violation in an error frame.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) struct ProtocolViolation {
    pub(super) kind: Violation,
    /// Whether this controller was transmitting.
    pub(super) sending: bool,
    /// Segment code of the location in the frame, 0 if unknown.
    pub(super) place: u8,
}

/// Protocol violation reported by an error frame, if any.
pub(super) fn reported_violation(frame: &Frame) -> Option<ProtocolViolation> {
    let classes = frame.id.number();
    if classes & (PROTOCOL | BUS_ERROR | NO_ACKNOWLEDGEMENT) == 0 {
        return None;
    }
    let [_, _, bits, place, ..] = error_bytes(frame);
    let place = if place > 0x1F { 0 } else { place };
    let sending = bits & WHILE_SENDING != 0;
    let kind = VIOLATIONS.iter().find(|(known, _)| bits & known != 0).map(|(_, kind)| *kind);
    Some(match kind {
        Some(kind) => ProtocolViolation { kind, sending, place },
        None if classes & NO_ACKNOWLEDGEMENT == 0 => {
            ProtocolViolation { kind: Violation::Other, sending, place }
        }
        // Only a transmitter detects a missing acknowledgement, in the acknowledge slot. Drivers often set
        // neither.
        None => {
            ProtocolViolation { kind: Violation::Acknowledgement, sending: true, place: ACKNOWLEDGE_SLOT }
        }
    })
}

/// Controller state reported by an error frame, if any.
pub(super) fn reported_state(frame: &Frame) -> Option<ControllerState> {
    let classes = frame.id.number();
    if classes & BUS_OFF != 0 {
        return Some(ControllerState::BusOff);
    }
    let [_, detail, ..] = error_bytes(frame);
    let state = STATES.iter().find(|(bits, _)| classes & CONTROLLER != 0 && detail & bits != 0);
    state.map(|(_, state)| *state).or((classes & RESTARTED != 0).then_some(ControllerState::Active))
}

/// Error counters reported by an error frame, if any.
pub(super) fn reported_counters(frame: &Frame) -> Option<Counters> {
    let [.., transmit, receive] = error_bytes(frame);
    (frame.id.number() & COUNTERS != 0).then_some(Counters { receive, transmit })
}

/// The eight bytes of an error frame, padded with zeros.
fn error_bytes(frame: &Frame) -> [u8; 8] {
    let mut bytes = [0; 8];
    for (byte, found) in bytes.iter_mut().zip(frame.data()) {
        *byte = *found;
    }
    bytes
}

fn build_error_frame(classes: u32, bytes: [u8; 6], counters: Option<Counters>) -> Frame {
    let [b0, b1, b2, b3, b4, b5] = bytes;
    let (classes, transmit, receive) = match counters {
        Some(Counters { receive, transmit }) => (classes | COUNTERS, transmit, receive),
        None => (classes, 0, 0),
    };
    let mut frame =
        Frame::data_frame(CanId::from_extended(classes), &[b0, b1, b2, b3, b4, b5, transmit, receive]);
    frame.flags = FrameFlags::ERROR;
    frame
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_stuff_error_while_receiving_with_counters() {
        let counters = Counters { receive: 8, transmit: 2 };
        let frame = violation_frame(Violation::Stuff, false, 0x02, Some(counters));
        assert_eq!(frame.id, CanId::Extended(0x288));
        assert_eq!(frame.data(), [0, 0, 0x04, 0x02, 0, 0, 2, 8]);
        assert_eq!(frame.flags, FrameFlags::ERROR);
    }

    #[test]
    fn a_missing_acknowledgement_is_detected_by_its_position() {
        let frame = violation_frame(Violation::Other, true, ACKNOWLEDGE_SLOT, None);
        assert_eq!(frame.id, CanId::Extended(0x0A8));
        assert_eq!(frame.data(), [0, 0, 0x80, 0x19, 0, 0, 0, 0]);
        assert_eq!(
            violation_frame(Violation::Other, false, ACKNOWLEDGE_SLOT, None).id,
            CanId::Extended(0x088)
        );
        assert_eq!(violation_frame(Violation::Acknowledgement, true, 0, None).data(), frame.data());
    }

    #[test]
    fn a_reported_error_is_found_again() {
        let counters = Counters { receive: 8, transmit: 2 };
        for (kind, sending, place) in [
            (Violation::Bit, true, 0x0A),
            (Violation::Form, false, 0x1B),
            (Violation::Stuff, false, 0),
            (Violation::Acknowledgement, true, 0x19),
            (Violation::Overload, false, 0),
            (Violation::Other, false, 0x08),
        ] {
            let frame = violation_frame(kind, sending, place, Some(counters));
            assert_eq!(reported_violation(&frame), Some(ProtocolViolation { kind, sending, place }));
            assert_eq!((reported_counters(&frame), reported_state(&frame)), (Some(counters), None));
        }
        for reported in [
            ControllerState::Active,
            ControllerState::Warning,
            ControllerState::Passive,
            ControllerState::BusOff,
            ControllerState::Overrun,
        ] {
            let frame = controller_frame(reported);
            assert_eq!(
                (reported_state(&frame), reported_violation(&frame), reported_counters(&frame)),
                (Some(reported), None, None)
            );
        }
        let short =
            Frame { flags: FrameFlags::ERROR, ..Frame::data_frame(CanId::from_extended(0x104), &[0]) };
        assert_eq!(reported_state(&short), Some(ControllerState::Active), "restarted");
        let unanswered = Frame::data_frame(CanId::from_extended(0x20), &[0; 8]);
        let reported = ProtocolViolation { kind: Violation::Acknowledgement, sending: true, place: 0x19 };
        assert_eq!(reported_violation(&unanswered), Some(reported));
        // A driver that could not send a recessive bit, and an invalid segment code.
        let odd = Frame::data_frame(CanId::from_extended(0x08), &[0, 0, 0x90, 0xFF, 0, 0, 0, 0]);
        assert_eq!(
            reported_violation(&odd),
            Some(ProtocolViolation { kind: Violation::Bit, sending: true, place: 0 })
        );
    }

    #[test]
    fn bus_off_is_a_class_of_its_own() {
        assert_eq!(controller_frame(ControllerState::BusOff).id, CanId::Extended(0x040));
        assert_eq!(controller_frame(ControllerState::Warning).data()[1], 0x0C);
    }
}
