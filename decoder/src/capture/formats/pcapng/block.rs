//! Blocks: detection, start and length.
//!
//! ```text
//! block            0 type (4)       4 block length (4)       8 body   length - 4 length again (4)
//! section header   0 0x0A0D0D0A     8 magic 0x1A2B3C4D (4): byte order of the section
//! ```

use pcap_file::pcapng::blocks::{
    CUSTOM_BLOCK_COPIABLE, CUSTOM_BLOCK_NON_COPIABLE, ENHANCED_PACKET_BLOCK, INTERFACE_DESCRIPTION_BLOCK,
    INTERFACE_STATISTIC_BLOCK, NAME_RESOLUTION_BLOCK, PACKET_BLOCK, SECTION_HEADER_BLOCK,
    SIMPLE_PACKET_BLOCK, SYSTEMD_JOURNAL_EXPORT_BLOCK,
};

use crate::capture::LARGEST_RECORD;
use crate::capture::byte_order::ByteOrder;

/// Size of the type and length fields at the start of each block, in bytes.
pub(super) const START: usize = 8;
/// Size of a block without body, in bytes.
const SHORTEST: usize = 12;
/// Option code for a comment, valid in all blocks.
pub(super) const COMMENT: u16 = 1;
const TLS_SECRETS_BLOCK: u32 = 0x0A;
const MAGIC: u32 = 0x1A2B_3C4D;

/// Type of a block.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum BlockType {
    Section,
    Interface,
    Packet,
    ObsoletePacket,
    SimplePacket,
    Statistics,
    /// A known type that is skipped.
    Unread,
    Unknown,
}

impl BlockType {
    /// Type of the block at the start of `rest`; `None` if `rest` is too short.
    pub(super) fn kind_at(rest: &[u8], order: ByteOrder) -> Option<Self> {
        order.u32(rest, 0).map(Self::from_number)
    }

    fn from_number(number: u32) -> Self {
        match number {
            SECTION_HEADER_BLOCK => Self::Section,
            INTERFACE_DESCRIPTION_BLOCK => Self::Interface,
            ENHANCED_PACKET_BLOCK => Self::Packet,
            PACKET_BLOCK => Self::ObsoletePacket,
            SIMPLE_PACKET_BLOCK => Self::SimplePacket,
            INTERFACE_STATISTIC_BLOCK => Self::Statistics,
            NAME_RESOLUTION_BLOCK
            | TLS_SECRETS_BLOCK
            | SYSTEMD_JOURNAL_EXPORT_BLOCK
            | CUSTOM_BLOCK_COPIABLE
            | CUSTOM_BLOCK_NON_COPIABLE => Self::Unread,
            _ => Self::Unknown,
        }
    }
}

/// One block, or the start of a block that is too long.
#[derive(Debug, Clone, Copy)]
pub(super) struct PcapngBlock<'a> {
    pub(super) kind: BlockType,
    /// Byte order of the section; of a section header the order that it declares.
    pub(super) order: ByteOrder,
    /// Available part of the body between the two lengths.
    pub(super) body: &'a [u8],
    /// Size of the complete block in bytes.
    pub(super) length: u64,
}

/// Content at the start of the input.
#[derive(Debug, Clone, Copy)]
pub(super) enum BlockContent<'a> {
    /// A complete block with two equal lengths.
    Block(PcapngBlock<'a>),
    /// The start of a block of more than [`LARGEST_RECORD`] bytes.
    Large(PcapngBlock<'a>),
    /// More input is needed to decide.
    More,
    /// Not a block; contains the reason.
    Nothing(&'static str),
}

/// Reason if the capture ends inside a block.
pub(super) const CUT_OFF: &str = "the capture ends inside a block";

/// Content at the start of `rest`, in a section of the given byte order.
pub(super) fn find_block(rest: &[u8], section: ByteOrder, at_end: bool) -> BlockContent<'_> {
    let more = |why| if at_end { BlockContent::Nothing(why) } else { BlockContent::More };
    let Some(kind) = BlockType::kind_at(rest, section) else {
        return more(CUT_OFF);
    };
    let order = match (kind, ByteOrder::Big.u32(rest, START)) {
        (BlockType::Section, Some(MAGIC)) => ByteOrder::Big,
        (BlockType::Section, Some(magic)) if magic == MAGIC.swap_bytes() => ByteOrder::Little,
        (BlockType::Section, Some(_)) => return BlockContent::Nothing("section header without magic"),
        (_, None) => return more(CUT_OFF),
        _ => section,
    };
    let length = order.u32(rest, 4).unwrap_or(0);
    let size = usize::try_from(length).unwrap_or(usize::MAX);
    if size < SHORTEST || !size.is_multiple_of(4) {
        return BlockContent::Nothing("block of invalid length");
    }
    let body_size = size - SHORTEST;
    if size > LARGEST_RECORD {
        let Some(body) = rest.get(START..LARGEST_RECORD) else {
            return more(CUT_OFF);
        };
        return BlockContent::Large(PcapngBlock { kind, order, body, length: u64::from(length) });
    }
    let (Some(body), Some(again)) =
        (rest.get(START..).and_then(|body| body.get(..body_size)), order.u32(rest, START + body_size))
    else {
        return more(CUT_OFF);
    };
    if again != length {
        return BlockContent::Nothing("block with two different lengths");
    }
    BlockContent::Block(PcapngBlock { kind, order, body, length: u64::from(length) })
}

#[cfg(test)]
mod tests {
    use super::*;

    fn found(rest: &[u8], at_end: bool) -> String {
        match find_block(rest, ByteOrder::Little, at_end) {
            BlockContent::Block(block) => format!("{:?} {:?} {:?}", block.kind, block.order, block.body),
            BlockContent::Large(block) => format!("large {:?} {}", block.kind, block.length),
            BlockContent::More => "more".into(),
            BlockContent::Nothing(why) => why.into(),
        }
    }

    #[test]
    fn a_block_is_whole_and_says_its_length_twice() {
        let block = b"\x06\0\0\0\x10\0\0\0body\x10\0\0\0";
        assert_eq!(found(block, false), "Packet Little [98, 111, 100, 121]");
        assert_eq!(found(&block[..15], false), "more");
        assert_eq!(found(&block[..15], true), "the capture ends inside a block");
        assert_eq!(found(b"\x06\0\0\0\x10\0\0\0body\x11\0\0\0", false), "block with two different lengths");
    }

    #[test]
    fn lengths_no_block_can_have_are_no_block() {
        for length in [0u8, 3, 8, 11, 13] {
            let block = [6, 0, 0, 0, length, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0];
            assert_eq!(found(&block, false), "block of invalid length");
        }
    }

    #[test]
    fn a_section_header_brings_its_own_order() {
        let big = b"\x0A\x0D\x0D\x0A\0\0\0\x10\x1A\x2B\x3C\x4D\0\0\0\x10";
        assert_eq!(found(big, false), "Section Big [26, 43, 60, 77]");
        let none = b"\x0A\x0D\x0D\x0A\0\0\0\x10\x1A\x2B\x3C\x4E\0\0\0\x10";
        assert_eq!(found(none, false), "section header without magic");
    }

    #[test]
    fn a_large_block_is_looked_at_as_far_as_a_record_may_be_long() {
        let mut block = vec![0; LARGEST_RECORD];
        block[..8].copy_from_slice(b"\x77\x77\0\0\0\0\x04\0");
        assert_eq!(found(&block[..LARGEST_RECORD - 1], false), "more");
        assert_eq!(found(&block, false), "large Unknown 262144");
    }
}
