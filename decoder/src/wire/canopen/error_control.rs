//! Error control (CiA 301 §7.2.8.3.2): heartbeat, boot-up and node guarding on 0x700 + node-ID.
//!
//! ```text
//! byte 0  bit 7 toggle (guarding; 0 in a heartbeat)  bits 6..0 NMT state, 0 = boot-up
//! ```

use nom::Parser;
use nom::number::complete::u8 as byte;

use super::NmtState;
use crate::wire::MalformedPayload;
use crate::wire::parser::{bit_field, parse_message};

/// Byte sent by the NMT slave.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct ErrorControlByte {
    /// Bit 7, the toggle bit of guarding.
    pub toggle: bool,
    /// NMT state; `None` if CiA 301 does not define the code.
    pub state: Option<NmtState>,
    /// The code as sent, seven bits.
    pub code: u8,
}

/// Reads the byte; further bytes are ignored.
///
/// # Errors
/// If there is no byte.
pub fn parse(data: &[u8]) -> Result<ErrorControlByte, MalformedPayload> {
    let message = byte.map(|byte| {
        let code = bit_field(byte, 0, 7);
        ErrorControlByte { toggle: byte & 0x80 != 0, state: NmtState::from_code(code), code }
    });
    parse_message("error-control", data, message)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn state_and_toggle() {
        // 0x85: toggle set, operational.
        let byte = parse(&[0x85]).unwrap();
        assert!(byte.toggle);
        assert_eq!(byte.state, Some(NmtState::Operational));
        assert_eq!(parse(&[0x00]).unwrap().state, Some(NmtState::Initialising));
        assert_eq!(parse(&[0x7F]).unwrap().state, Some(NmtState::PreOperational));
    }

    #[test]
    fn an_undefined_state_keeps_its_code() {
        assert_eq!(parse(&[0x06]).unwrap(), ErrorControlByte { toggle: false, state: None, code: 6 });
        assert!(parse(&[]).is_err());
    }
}
