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
const RESTARTED: u32 = 0x100;
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

impl Counters {
    /// Those that a record of an error has a place for. Both 0 are none: an error that is counted leaves one of them
    /// above (ISO 11898-1, fault confinement), and who does not know them leaves them empty.
    pub(super) fn of_error(self) -> Option<Self> {
        (self.receive > 0 || self.transmit > 0).then_some(self)
    }
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

/// Bits of byte 2 by what they say, the plainest first. That a bit could not be sent is an error of a bit.
const VIOLATIONS: [(u8, Violation); 4] =
    [(0x04, Violation::Stuff), (0x02, Violation::Form), (0x19, Violation::Bit), (0x20, Violation::Overload)];

/// Bits of byte 1 by what they say, the worst first.
const STATES: [(u8, ControllerState); 4] = [
    (0x30, ControllerState::Passive),
    (0x0C, ControllerState::Warning),
    (0x03, ControllerState::Overrun),
    (0x40, ControllerState::Active),
];

/// How the protocol was broken, as an error frame tells it.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) struct Broken {
    /// How.
    pub(super) kind: Violation,
    /// While this controller was sending.
    pub(super) sending: bool,
    /// Segment code of the place in the frame, 0 if it is not known.
    pub(super) place: u8,
}

/// How the protocol was broken, if an error frame is about that.
pub(super) fn broken(frame: &Frame) -> Option<Broken> {
    let classes = frame.id.number();
    if classes & (PROTOCOL | BUS_ERROR | NO_ACKNOWLEDGEMENT) == 0 {
        return None;
    }
    let [_, _, bits, place, ..] = details(frame);
    let place = if place > 0x1F { 0 } else { place };
    let sending = bits & WHILE_SENDING != 0;
    let kind = VIOLATIONS.iter().find(|(known, _)| bits & known != 0).map(|(_, kind)| *kind);
    Some(match kind {
        Some(kind) => Broken { kind, sending, place },
        None if classes & NO_ACKNOWLEDGEMENT == 0 => Broken { kind: Violation::Other, sending, place },
        // Only who sends misses the acknowledgement, and in one place; drivers often leave both open.
        None => Broken { kind: Violation::Acknowledgement, sending: true, place: ACKNOWLEDGE_SLOT },
    })
}

/// The state of the controller, if an error frame tells it.
pub(super) fn state(frame: &Frame) -> Option<ControllerState> {
    let classes = frame.id.number();
    if classes & BUS_OFF != 0 {
        return Some(ControllerState::BusOff);
    }
    let [_, detail, ..] = details(frame);
    let state = STATES.iter().find(|(bits, _)| classes & CONTROLLER != 0 && detail & bits != 0);
    state.map(|(_, state)| *state).or((classes & RESTARTED != 0).then_some(ControllerState::Active))
}

/// The counters of the controller, if an error frame tells them.
pub(super) fn counted(frame: &Frame) -> Option<Counters> {
    let [.., transmit, receive] = details(frame);
    (frame.id.number() & COUNTERS != 0).then_some(Counters { receive, transmit })
}

/// The eight bytes of an error frame, zeros where it is shorter.
fn details(frame: &Frame) -> [u8; 8] {
    let mut bytes = [0; 8];
    for (byte, found) in bytes.iter_mut().zip(frame.data()) {
        *byte = *found;
    }
    bytes
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
    fn what_is_told_is_found_again() {
        let counters = Counters { receive: 8, transmit: 2 };
        for (kind, sending, place) in [
            (Violation::Bit, true, 0x0A),
            (Violation::Form, false, 0x1B),
            (Violation::Stuff, false, 0),
            (Violation::Acknowledgement, true, 0x19),
            (Violation::Overload, false, 0),
            (Violation::Other, false, 0x08),
        ] {
            let frame = violation(kind, sending, place, Some(counters));
            assert_eq!(broken(&frame), Some(Broken { kind, sending, place }));
            assert_eq!((counted(&frame), state(&frame)), (Some(counters), None));
        }
        for told in [
            ControllerState::Active,
            ControllerState::Warning,
            ControllerState::Passive,
            ControllerState::BusOff,
            ControllerState::Overrun,
        ] {
            let frame = controller(told);
            assert_eq!((state(&frame), broken(&frame), counted(&frame)), (Some(told), None, None));
        }
        let short = Frame { flags: FrameFlags::ERROR, ..Frame::data_frame(CanId::extended(0x104), &[0]) };
        assert_eq!(state(&short), Some(ControllerState::Active), "restarted");
        let unanswered = Frame::data_frame(CanId::extended(0x20), &[0; 8]);
        let told = Broken { kind: Violation::Acknowledgement, sending: true, place: 0x19 };
        assert_eq!(broken(&unanswered), Some(told));
        // A driver that could not send a recessive bit, and a place no controller codes.
        let odd = Frame::data_frame(CanId::extended(0x08), &[0, 0, 0x90, 0xFF, 0, 0, 0, 0]);
        assert_eq!(broken(&odd), Some(Broken { kind: Violation::Bit, sending: true, place: 0 }));
    }

    #[test]
    fn bus_off_is_a_class_of_its_own() {
        assert_eq!(controller(ControllerState::BusOff).id, CanId::Extended(0x040));
        assert_eq!(controller(ControllerState::Warning).data()[1], 0x0C);
    }
}
