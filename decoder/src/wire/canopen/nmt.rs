//! NMT node control (CiA 301 §7.2.8.3.1): identifier 0, from the NMT master.
//!
//! ```text
//! byte 0  command specifier    byte 1  node-ID, 0 = all nodes
//! ```

use crate::wire::Malformed;

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
pub fn parse(data: &[u8]) -> Result<NmtCommand, Malformed> {
    let [specifier, target, ..] = *data else { return Err(Malformed::at("nmt", 0, 2, data.len())) };
    let service = match specifier {
        1 => NmtService::Start,
        2 => NmtService::Stop,
        128 => NmtService::EnterPreOperational,
        129 => NmtService::ResetNode,
        130 => NmtService::ResetCommunication,
        other => NmtService::Unknown(other),
    };
    Ok(NmtCommand { service, target })
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
        assert_eq!(parse(&[1]), Err(Malformed { layer: "nmt", offset: 0, needed: 2, available: 1 }));
    }
}
