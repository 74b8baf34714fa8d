//! LSS (CiA 305): sets node-ID and bit rate of devices, which are addressed by their identity. The master
//! uses 0x7E5, slaves use 0x7E4. All messages have eight bytes.
//!
//! ```text
//! byte 0  command specifier   bytes 1..8  depend on the command, unused bytes are 0
//! ```

use nom::Parser;
use nom::number::complete::{le_u16, le_u32, u8 as byte};

use crate::wire::MalformedPayload;
use crate::wire::parser::{Parsed, field_group, parse_message};

/// One LSS message. Names and result texts are in `standard/cia305.toml`.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct LssMessage {
    /// Command specifier.
    pub command: u8,
    /// Decoded fields of the command.
    pub content: LssContent,
}

/// Fields of a message; the command determines the variant.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum LssContent {
    /// No fields.
    Nothing,
    /// Mode of switch state global: 0 waiting, 1 configuration.
    Mode(u8),
    /// Node-ID to set, or node-ID in a response; 255 = not configured.
    NodeId(u8),
    /// Bit timing table and entry.
    BitTiming {
        /// 0 = the standard table.
        table: u8,
        /// Entry of the table.
        entry: u8,
    },
    /// Delay before and after the change of bit rate, in ms.
    Delay(u16),
    /// One part of an identity, or one limit of a range.
    Number(u32),
    /// Result of a configuration.
    Result {
        /// 0 = success, 255 = see `specific`.
        code: u8,
        /// Manufacturer-specific error code.
        specific: u8,
    },
    /// Fast scan step.
    FastScan {
        /// Value of the identity part that slaves compare.
        number: u32,
        /// Lowest bit compared; 128 = all slaves without a node-ID respond.
        bit: u8,
        /// Identity part compared, 0..=3.
        sub: u8,
        /// Identity part compared next.
        next: u8,
    },
}

/// Layout of the seven bytes after a command.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum LssLayout {
    /// Unused.
    Nothing,
    /// [`LssContent::Mode`].
    Mode,
    /// [`LssContent::NodeId`].
    NodeId,
    /// [`LssContent::BitTiming`].
    BitTiming,
    /// [`LssContent::Delay`].
    Delay,
    /// [`LssContent::Number`].
    Number,
    /// [`LssContent::Result`].
    Result,
    /// [`LssContent::FastScan`].
    FastScan,
}

/// Layout for a command (CiA 305 §3.8 to §3.11); request and response of one command differ.
pub const fn message_layout(command: u8, from_master: bool) -> LssLayout {
    match (command, from_master) {
        (0x04, _) => LssLayout::Mode,
        (0x11, true) | (0x5E, false) => LssLayout::NodeId,
        (0x13, true) => LssLayout::BitTiming,
        (0x15, _) => LssLayout::Delay,
        (0x40..=0x43 | 0x46..=0x4B, _) | (0x5A..=0x5D, false) => LssLayout::Number,
        (0x11 | 0x13 | 0x17, false) => LssLayout::Result,
        (0x51, true) => LssLayout::FastScan,
        _ => LssLayout::Nothing,
    }
}

/// Whether a command is defined for this sender (CiA 305 §3.8 to §3.11).
pub const fn is_defined_command(command: u8, from_master: bool) -> bool {
    match (command, from_master) {
        (0x11 | 0x13 | 0x17 | 0x5A..=0x5E, _) => true,
        (command, true) => matches!(command, 0x04 | 0x15 | 0x40..=0x43 | 0x46..=0x4C | 0x51),
        (command, false) => matches!(command, 0x44 | 0x4F | 0x50),
    }
}

/// Reads one message.
///
/// # Errors
/// If it is shorter than its command needs.
pub fn parse(data: &[u8], from_master: bool) -> Result<LssMessage, MalformedPayload> {
    parse_message("lss", data, |data| parse_fields(data, from_master))
}

fn parse_fields(data: &[u8], from_master: bool) -> Parsed<'_, LssMessage> {
    let (rest, command) = byte(data)?;
    let layout = message_layout(command, from_master);
    field_group(|rest| parse_content(layout, rest)).map(|content| LssMessage { command, content }).parse(rest)
}

fn parse_content(layout: LssLayout, rest: &[u8]) -> Parsed<'_, LssContent> {
    match layout {
        LssLayout::Nothing => Ok((rest, LssContent::Nothing)),
        LssLayout::Mode => byte.map(LssContent::Mode).parse(rest),
        LssLayout::NodeId => byte.map(LssContent::NodeId).parse(rest),
        LssLayout::BitTiming => {
            (byte, byte).map(|(table, entry)| LssContent::BitTiming { table, entry }).parse(rest)
        }
        LssLayout::Delay => le_u16.map(LssContent::Delay).parse(rest),
        LssLayout::Number => le_u32.map(LssContent::Number).parse(rest),
        LssLayout::Result => {
            (byte, byte).map(|(code, specific)| LssContent::Result { code, specific }).parse(rest)
        }
        LssLayout::FastScan => (le_u32, byte, byte, byte)
            .map(|(number, bit, sub, next)| LssContent::FastScan { number, bit, sub, next })
            .parse(rest),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn configure_node_id_and_its_answer() {
        assert_eq!(parse(&[0x11, 5, 0, 0, 0, 0, 0, 0], true).unwrap().content, LssContent::NodeId(5));
        assert_eq!(
            parse(&[0x11, 1, 0, 0, 0, 0, 0, 0], false).unwrap().content,
            LssContent::Result { code: 1, specific: 0 }
        );
    }

    #[test]
    fn selective_switch_and_fast_scan() {
        assert_eq!(
            parse(&[0x40, 0x78, 0x56, 0x34, 0x12, 0, 0, 0], true).unwrap(),
            LssMessage { command: 0x40, content: LssContent::Number(0x1234_5678) }
        );
        assert_eq!(
            parse(&[0x51, 0x78, 0x56, 0x34, 0x12, 31, 1, 2], true).unwrap().content,
            LssContent::FastScan { number: 0x1234_5678, bit: 31, sub: 1, next: 2 }
        );
    }

    #[test]
    fn commands_are_of_the_master_or_of_slaves() {
        let defined =
            |from_master| (0..=255_u8).filter(move |command| is_defined_command(*command, from_master));
        // Switch state, configuration, identification, fast scan, inquiry (CiA 305 §3.9 to §3.11).
        assert_eq!(defined(true).count(), 1 + 4 + 4 + 7 + 1 + 5);
        assert_eq!(
            defined(false).collect::<Vec<_>>(),
            [0x11, 0x13, 0x17, 0x44, 0x4F, 0x50, 0x5A, 0x5B, 0x5C, 0x5D, 0x5E]
        );
    }

    #[test]
    fn a_short_message_says_what_is_missing() {
        let error = parse(&[0x40, 1, 2], true).unwrap_err();
        assert_eq!((error.offset, error.needed, error.available), (1, 4, 2));
    }
}
