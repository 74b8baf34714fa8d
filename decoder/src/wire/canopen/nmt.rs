//! NMT node control (CiA 301 §7.2.8.3.1): identifier 0, from the NMT master.
//!
//! ```text
//! byte 0  command specifier    byte 1  node-ID, 0 = all nodes
//! ```

use nom::Parser;
use nom::number::complete::u8 as byte;

use crate::wire::MalformedPayload;
use crate::wire::parser::{field_group, parse_message};

/// Command specifier of the master.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash)]
pub enum NmtService {
    /// Command specifier 1.
    Start,
    /// Command specifier 2.
    Stop,
    /// Command specifier 128.
    EnterPreOperational,
    /// Command specifier 129.
    ResetNode,
    /// Command specifier 130.
    ResetCommunication,
    /// A command specifier that CiA 301 does not define.
    Unknown(u8),
}

impl NmtService {
    const fn from_specifier(specifier: u8) -> Self {
        match specifier {
            1 => Self::Start,
            2 => Self::Stop,
            128 => Self::EnterPreOperational,
            129 => Self::ResetNode,
            130 => Self::ResetCommunication,
            other => Self::Unknown(other),
        }
    }

    /// Name used in all output.
    pub const fn name(self) -> &'static str {
        match self {
            Self::Start => "start",
            Self::Stop => "stop",
            Self::EnterPreOperational => "enter-pre-operational",
            Self::ResetNode => "reset-node",
            Self::ResetCommunication => "reset-communication",
            Self::Unknown(_) => "unknown",
        }
    }
}

/// One NMT command.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct NmtCommand {
    /// Requested state change or reset.
    pub service: NmtService,
    /// Node-ID, 0 for all; above 127 no node is addressed.
    pub target: u8,
}

/// Reads a command; further bytes are ignored.
///
/// # Errors
/// If there are fewer than two bytes.
pub fn parse(data: &[u8]) -> Result<NmtCommand, MalformedPayload> {
    let command = (byte, byte)
        .map(|(specifier, target)| NmtCommand { service: NmtService::from_specifier(specifier), target });
    parse_message("nmt", data, field_group(command))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_five_commands() {
        for (specifier, service) in [
            (0x01, NmtService::Start),
            (0x02, NmtService::Stop),
            (0x80, NmtService::EnterPreOperational),
            (0x81, NmtService::ResetNode),
            (0x82, NmtService::ResetCommunication),
            (0x03, NmtService::Unknown(3)),
        ] {
            assert_eq!(parse(&[specifier, 4]), Ok(NmtCommand { service, target: 4 }));
        }
    }

    #[test]
    fn one_byte_is_too_short() {
        assert_eq!(parse(&[1]), Err(MalformedPayload { layer: "nmt", offset: 0, needed: 2, available: 1 }));
    }
}
