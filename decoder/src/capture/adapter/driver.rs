//! Reports of adapter drivers as the error frames that SocketCAN creates for them.

pub use super::slcan::{SlcanConfinement, SlcanControllerState};
pub use crate::capture::bus_error::{Counters, Violation};

use super::slcan::state_frame;
use crate::capture::bus_error::{self, ControllerState as State};
use crate::frame::Frame;

/// A bus error that a driver reports.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct BusErrorReport {
    /// Kind; `None` if only the counters changed.
    pub violation: Option<Violation>,
    /// The adapter was transmitting.
    pub is_transmitting: bool,
    /// Position in the frame as segment code of the SJA1000; 0 if unknown.
    pub place: u8,
    /// Error counters after it.
    pub counters: Option<Counters>,
}

impl BusErrorReport {
    /// The error frame; `None` without an error and without counters.
    pub fn to_frame(self) -> Option<Frame> {
        match (self.violation, self.counters) {
            (Some(kind), counters) => {
                Some(bus_error::violation_frame(kind, self.is_transmitting, self.place, counters))
            }
            (None, Some(counters)) => Some(bus_error::counter_frame(counters)),
            (None, None) => None,
        }
    }
}

/// The error frame of a new state of the controller.
pub fn frame_of_state(confinement: SlcanConfinement, counters: Option<Counters>) -> Frame {
    match counters {
        Some(Counters { receive, transmit }) => state_frame(SlcanControllerState {
            confinement,
            receive_errors: receive.into(),
            transmit_errors: transmit.into(),
        }),
        None => bus_error::controller_frame(match confinement {
            SlcanConfinement::Active => State::Active,
            SlcanConfinement::Warning => State::Warning,
            SlcanConfinement::Passive => State::Passive,
            SlcanConfinement::BusOff => State::BusOff,
        }),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn parts(frame: Frame) -> (u32, Vec<u8>) {
        (frame.id.number(), frame.data().to_vec())
    }

    /// linux/can/error.h: bus error and protocol violation, stuff error, data field, both counters in bytes 6 and 7.
    #[test]
    fn bus_errors_are_those_of_socketcan() {
        let report = BusErrorReport {
            violation: Some(Violation::Stuff),
            is_transmitting: false,
            place: 10,
            counters: Some(Counters { receive: 96, transmit: 1 }),
        };
        assert_eq!(report.to_frame().map(parts), Some((0x288, vec![0, 0, 4, 10, 0, 0, 1, 96])));
        let counters = BusErrorReport { violation: None, place: 0, ..report };
        assert_eq!(counters.to_frame().map(parts), Some((0x200, vec![0, 0, 0, 0, 0, 0, 1, 96])));
        assert_eq!(BusErrorReport { counters: None, ..counters }.to_frame(), None);
    }

    #[test]
    fn states_have_counters_only_if_they_are_known() {
        let counters = Some(Counters { receive: 130, transmit: 0 });
        let passive = frame_of_state(SlcanConfinement::Passive, counters);
        assert_eq!(parts(passive), (0x204, vec![0, 0x10, 0, 0, 0, 0, 0, 130]));
        let unknown = frame_of_state(SlcanConfinement::Passive, None);
        assert_eq!(parts(unknown), (0x004, vec![0, 0x30, 0, 0, 0, 0, 0, 0]));
        assert_eq!(parts(frame_of_state(SlcanConfinement::BusOff, None)), (0x040, vec![0; 8]));
    }
}
