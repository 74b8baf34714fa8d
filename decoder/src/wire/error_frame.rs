//! SocketCAN error frames (linux/can/error.h): bus errors that the CAN controller reports.
//!
//! ```text
//! identifier  class bits     byte 0  bit of lost arbitration   byte 1  controller   byte 2  protocol
//! byte 3  location           byte 4  transceiver               byte 6  TX counter   byte 7  RX counter
//! ```

use nom::Parser;
use nom::combinator::success;
use nom::number::complete::u8 as byte;

use super::parser::{Parsed, bit_field};

/// Fields of an error frame; their names are in `lookups/can_error_classes.toml`.
#[derive(Debug, Default, Clone, Copy, PartialEq, Eq)]
pub struct ErrorFrameFields {
    /// Class bits of the identifier, error flag removed.
    pub classes: u32,
    /// Bit at which arbitration was lost, 0 = unspecified.
    pub arbitration_bit: u8,
    /// Controller bits.
    pub controller: u8,
    /// Protocol violation bits.
    pub protocol: u8,
    /// Location of the protocol violation in the frame.
    pub location: u8,
    /// Transceiver status.
    pub transceiver: u8,
    /// Transmit error counter.
    pub transmit_errors: u8,
    /// Receive error counter.
    pub receive_errors: u8,
}

impl ErrorFrameFields {
    /// Whether the capturing interface lost received frames.
    pub fn is_receive_overflow(&self) -> bool {
        self.classes & Self::CONTROLLER != 0 && self.controller & Self::RECEIVE_OVERFLOW != 0
    }

    /// Whether it reports nothing but lost frames of the capturing interface: no error on the bus.
    pub fn is_only_receive_overflow(&self) -> bool {
        let classes = self.classes & !Self::COUNTERS;
        classes == Self::CONTROLLER && self.controller == Self::RECEIVE_OVERFLOW
    }

    /// Whether it reports nothing but the error counters of the controller: a state, no error on the bus.
    pub const fn is_only_counters(&self) -> bool {
        self.classes == Self::COUNTERS
    }

    /// Class bit of lost arbitration.
    pub const LOST_ARBITRATION: u32 = 0x002;
    /// Class bit of `controller`.
    pub const CONTROLLER: u32 = 0x004;
    /// Class bit of `protocol` and `location`.
    pub const PROTOCOL: u32 = 0x008;
    /// Class bit of `transceiver`.
    pub const TRANSCEIVER: u32 = 0x010;
    /// Class bit of a controller that is bus-off.
    pub const BUS_OFF: u32 = 0x040;
    /// Class bit of valid error counters.
    pub const COUNTERS: u32 = 0x200;
    /// Bit of `controller`: the receive buffer of the capturing interface overflowed (`CAN_ERR_CRTL_RX_OVERFLOW`).
    pub const RECEIVE_OVERFLOW: u8 = 0x01;

    /// Controller bits of an error-passive controller, by receive and by transmit errors.
    const PASSIVE: u8 = 0x10 | 0x20;

    /// Whether the controller is error-passive or bus-off.
    pub const fn is_grave(&self) -> bool {
        self.classes & Self::BUS_OFF != 0
            || self.classes & Self::CONTROLLER != 0 && self.controller & Self::PASSIVE != 0
    }
}

/// Reads an error frame; missing bytes read as 0, "unspecified".
pub fn parse_error_frame(id: u32, data: &[u8]) -> ErrorFrameFields {
    parse_fields(id, data).map(|(_, frame)| frame).unwrap_or_default()
}

fn parse_fields(id: u32, data: &[u8]) -> Parsed<'_, ErrorFrameFields> {
    let byte = || byte.or(success(0));
    let (rest, (arbitration_bit, controller, protocol, location)) =
        (byte(), byte(), byte(), byte()).parse(data)?;
    let (rest, (transceiver, _, transmit_errors, receive_errors)) =
        (byte(), byte(), byte(), byte()).parse(rest)?;
    let frame = ErrorFrameFields {
        classes: bit_field(id, 0, 29),
        arbitration_bit,
        controller,
        protocol,
        location,
        transceiver,
        transmit_errors,
        receive_errors,
    };
    Ok((rest, frame))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn controller_problem_with_counters() {
        // Class controller (0x004) and counters (0x200); receive warning (0x04); TX 96, RX 128.
        let frame = parse_error_frame(0x2000_0204, &[0, 0x04, 0, 0, 0, 0, 96, 128]);
        assert_eq!(frame.classes, 0x204);
        assert_eq!((frame.controller, frame.transmit_errors, frame.receive_errors), (4, 96, 128));
    }
}
