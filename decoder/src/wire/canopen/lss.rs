//! LSS (CiA 305): node-ID and bit rate of devices addressed by their identity; 0x7E5 from the master,
//! 0x7E4 from slaves, always eight bytes.
//!
//! ```text
//! byte 0  command specifier   bytes 1..8  by command, unused ones 0
//! ```

use nom::Parser;
use nom::number::complete::{le_u32, u8 as byte};

use crate::wire::Malformed;

/// One LSS message. Names and result texts are in `standard/cia305.toml`.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Lss {
    /// Command specifier.
    pub command: u8,
    /// What it carries.
    pub content: Content,
}

/// The fields of a message, by the shape its command has.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Content {
    /// No fields.
    Nothing,
    /// Mode of switch state global: 0 waiting, 1 configuration.
    Mode(u8),
    /// Node-ID to set, or answered; 255 = not configured.
    NodeId(u8),
    /// Bit timing table and entry.
    BitTiming {
        /// 0 = the standard table.
        table: u8,
        /// Entry of the table.
        entry: u8,
    },
    /// Milliseconds before and after the change of bit rate.
    Delay(u16),
    /// One number of an identity, or one bound of a range of them.
    Number(u32),
    /// Result of a configuration.
    Result {
        /// 0 = done, 255 = see `specific`.
        code: u8,
        /// Manufacturer's code.
        specific: u8,
    },
    /// Fast scan step.
    FastScan {
        /// Number asked about.
        number: u32,
        /// Lowest bit compared; 128 = all slaves without a node-ID answer.
        bit: u8,
        /// Which number of the identity, 0..=3.
        sub: u8,
        /// Which number is asked about next.
        next: u8,
    },
}

/// How the seven bytes after a command are laid out.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Shape {
    /// Unused.
    Nothing,
    /// [`Content::Mode`].
    Mode,
    /// [`Content::NodeId`].
    NodeId,
    /// [`Content::BitTiming`].
    BitTiming,
    /// [`Content::Delay`].
    Delay,
    /// [`Content::Number`].
    Number,
    /// [`Content::Result`].
    Result,
    /// [`Content::FastScan`].
    FastScan,
}

/// The shape of a command (CiA 305 §3.8 to §3.11); requests and replies of one command differ.
pub const fn shape(command: u8, from_master: bool) -> Shape {
    match (command, from_master) {
        (0x04, _) => Shape::Mode,
        (0x11, true) | (0x5E, false) => Shape::NodeId,
        (0x13, true) => Shape::BitTiming,
        (0x15, _) => Shape::Delay,
        (0x40..=0x43 | 0x46..=0x4B, _) | (0x5A..=0x5D, false) => Shape::Number,
        (0x11 | 0x13 | 0x17, false) => Shape::Result,
        (0x51, true) => Shape::FastScan,
        _ => Shape::Nothing,
    }
}

/// Reads one message.
///
/// # Errors
/// When it is shorter than its command needs.
pub fn parse(data: &[u8], from_master: bool) -> Result<Lss, Malformed> {
    let [command, rest @ ..] = data else { return Err(Malformed::at("lss", 0, 1, 0)) };
    let shape = shape(*command, from_master);
    match content(shape, rest) {
        Ok((_, content)) => Ok(Lss { command: *command, content }),
        Err(_) => Err(Malformed::at("lss", 1, needed(shape), data.len())),
    }
}

const fn needed(shape: Shape) -> usize {
    match shape {
        Shape::Nothing => 0,
        Shape::Mode | Shape::NodeId => 1,
        Shape::BitTiming | Shape::Delay | Shape::Result => 2,
        Shape::Number => 4,
        Shape::FastScan => 7,
    }
}

fn content(shape: Shape, rest: &[u8]) -> nom::IResult<&[u8], Content> {
    match shape {
        Shape::Nothing => Ok((rest, Content::Nothing)),
        Shape::Mode => byte.map(Content::Mode).parse(rest),
        Shape::NodeId => byte.map(Content::NodeId).parse(rest),
        Shape::BitTiming => {
            (byte, byte).map(|(table, entry)| Content::BitTiming { table, entry }).parse(rest)
        }
        Shape::Delay => nom::number::complete::le_u16.map(Content::Delay).parse(rest),
        Shape::Number => le_u32.map(Content::Number).parse(rest),
        Shape::Result => (byte, byte).map(|(code, specific)| Content::Result { code, specific }).parse(rest),
        Shape::FastScan => (le_u32, byte, byte, byte)
            .map(|(number, bit, sub, next)| Content::FastScan { number, bit, sub, next })
            .parse(rest),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn configure_node_id_and_its_answer() {
        assert_eq!(parse(&[0x11, 5, 0, 0, 0, 0, 0, 0], true).unwrap().content, Content::NodeId(5));
        assert_eq!(
            parse(&[0x11, 1, 0, 0, 0, 0, 0, 0], false).unwrap().content,
            Content::Result { code: 1, specific: 0 }
        );
    }

    #[test]
    fn selective_switch_and_fast_scan() {
        assert_eq!(
            parse(&[0x40, 0x78, 0x56, 0x34, 0x12, 0, 0, 0], true).unwrap(),
            Lss { command: 0x40, content: Content::Number(0x1234_5678) }
        );
        assert_eq!(
            parse(&[0x51, 0x78, 0x56, 0x34, 0x12, 31, 1, 2], true).unwrap().content,
            Content::FastScan { number: 0x1234_5678, bit: 31, sub: 1, next: 2 }
        );
    }

    #[test]
    fn a_short_message_says_what_is_missing() {
        let error = parse(&[0x40, 1, 2], true).unwrap_err();
        assert_eq!((error.offset, error.needed, error.available), (1, 4, 2));
    }
}
