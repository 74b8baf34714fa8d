//! Numbers as written in the bus file, and problems with them.

use serde::Deserialize;
use toml::Spanned;

pub(super) use crate::profile::{NodeNumber, TextProblem, node_id};

use crate::frame::CanId;
use crate::wire::canopen::ObjectAddress;

#[derive(Deserialize)]
#[serde(untagged, expecting = "expected a CAN identifier: 0x1A0, \"1A0\" or \"000001A0\" as in candump")]
pub(super) enum WrittenNumber {
    Integer(i64),
    Text(String),
}

impl WrittenNumber {
    /// CAN identifier; 29 bits if `extended`, above 7FF or written with eight digits.
    pub(super) fn can_id(&self, extended: bool) -> Option<CanId> {
        let (number, extended) = match self {
            Self::Integer(number) => (u32::try_from(*number).ok()?, extended || *number > 0x7FF),
            Self::Text(text) => {
                let hex = matches!(text.len(), 3 | 8) && text.bytes().all(|byte| byte.is_ascii_hexdigit());
                let number = hex.then(|| u32::from_str_radix(text, 16).ok()).flatten()?;
                (number, extended || text.len() == 8)
            }
        };
        match (u16::try_from(number), extended) {
            (Ok(id), false) if id <= 0x7FF => Some(CanId::Standard(id)),
            (_, true) if number <= 0x1FFF_FFFF => Some(CanId::Extended(number)),
            _ => None,
        }
    }
}

/// Error message for an invalid CAN identifier.
pub(super) const NO_IDENTIFIER: &str =
    "invalid CAN identifier; expected 11 or 29 bits: 0x1A0, \"1A0\" or \"000001A0\" as in candump";

/// Parses the address of an object.
pub(super) fn parse_address(text: &Spanned<String>) -> Result<ObjectAddress, TextProblem> {
    text.get_ref().parse().map_err(|error| (text.span(), format!("{error}")))
}
