//! SocketCAN error frames (linux/can/error.h): bus errors that the CAN controller reports.
//!
//! ```text
//! identifier  class bits     byte 0  bit of lost arbitration   byte 1  controller   byte 2  protocol
//! byte 3  location           byte 4  transceiver               byte 6  TX counter   byte 7  RX counter
//! ```

/// Fields of an error frame; their names are in `lookups/can_error_classes.toml`.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
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
    let byte = |index: usize| data.get(index).copied().unwrap_or(0);
    ErrorFrame {
        classes: id & 0x1FFF_FFFF,
        arbitration_bit: byte(0),
        controller: byte(1),
        protocol: byte(2),
        location: byte(3),
        transceiver: byte(4),
        transmit_errors: byte(6),
        receive_errors: byte(7),
    }
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
