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
pub struct ErrorFrame {
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

/// Reads an error frame; missing bytes read as 0, "unspecified".
pub fn parse(id: u32, data: &[u8]) -> ErrorFrame {
    parse_fields(id, data).map(|(_, frame)| frame).unwrap_or_default()
}

fn parse_fields(id: u32, data: &[u8]) -> Parsed<'_, ErrorFrame> {
    let byte = || byte.or(success(0));
    let (rest, (arbitration_bit, controller, protocol, location)) =
        (byte(), byte(), byte(), byte()).parse(data)?;
    let (rest, (transceiver, _, transmit_errors, receive_errors)) =
        (byte(), byte(), byte(), byte()).parse(rest)?;
    let frame = ErrorFrame {
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
        let frame = parse(0x2000_0204, &[0, 0x04, 0, 0, 0, 0, 96, 128]);
        assert_eq!(frame.classes, 0x204);
        assert_eq!((frame.controller, frame.transmit_errors, frame.receive_errors), (4, 96, 128));
    }
}
