//! pcapng: the capture format of Wireshark.
//!
//! ```text
//! section header ─▶ interface description … ─▶ packets, statistics, others … ─▶ section header …
//! ```
//! Detection of blocks: [`block`]; their contents: [`interface`] and [`section`].
//!
//! Unknown blocks are skipped. After invalid bytes, the parser searches the next plausible block and reports
//! the bytes between.
//!
//! `pcap-file` provides the block numbers only. Its reader rejects an interface and all packets after it if
//! the clock is finer than nanoseconds or the name is not UTF-8; it stops at the first byte outside of a
//! block; and its state cannot be cloned, as required for positions in a capture.

mod block;
mod interface;
mod section;
mod write;

use block::{Block, BlockContent, Kind, START};
use section::Section;

use crate::capture::byte_order::ByteOrder;
use crate::capture::{
    Batch, BusNames, CaptureError, CapturePlace, Format, FormatCapabilities, LARGEST_RECORD, Notice, Parser,
    WritableFormat,
};

pub(super) const FORMAT: Format = Format {
    name: "pcapng",
    title: "pcapng",
    is_text: false,
    is_packed: false,
    detect: |head| {
        head.starts_with(b"\x0A\x0D\x0D\x0A")
            && matches!(head.get(START..12), Some(b"\x1A\x2B\x3C\x4D" | b"\x4D\x3C\x2B\x1A"))
    },
    parser: |_| Box::new(PcapNg::default()),
};

pub(super) const WRITABLE: WritableFormat = WritableFormat {
    name: FORMAT.name,
    suffix: "pcapng",
    title: FORMAT.title,
    holds: FormatCapabilities { untimed: false, negative: false, ..FormatCapabilities::ALL },
    writer: |output, options| Box::new(write::PcapngWriter::new(output, options.comment)),
};

/// Longer blocks are treated as damage, because skipping them would lose the rest of the capture.
const LARGEST_BLOCK: u64 = 64 * 1024 * 1024;

/// Parser of pcapng.
#[derive(Clone, Default)]
struct PcapNg {
    section: Section,
    /// Bytes used so far.
    offset: u64,
    skip: Option<Skip>,
    garbage: Option<Garbage>,
    has_ended: bool,
}

/// A long block being skipped.
#[derive(Debug, Clone, Copy)]
struct Skip {
    /// Offset of the block.
    start: u64,
    length: u64,
    order: ByteOrder,
    /// Bytes left before its second length.
    left: u64,
}

/// Bytes outside of blocks.
#[derive(Debug, Clone, Copy)]
struct Garbage {
    /// Offset of the first of these bytes.
    start: u64,
    why: &'static str,
}

/// Result of one step of the parser.
enum ParserStep {
    /// Number of bytes used.
    Took(usize),
    /// Nothing used, but the state changed.
    Turned,
    /// Nothing used: more input is needed.
    More,
}

impl PcapNg {
    /// Performs the next step of skipping, searching or parsing.
    fn step(&mut self, at: u64, rest: &[u8], at_end: bool, batch: &mut Batch) -> ParserStep {
        if let Some(skip) = self.skip {
            return self.pass_over(skip, rest, at_end);
        }
        if let Some(garbage) = self.garbage {
            return self.search(garbage, at, rest, at_end, batch);
        }
        let common = match self.section.order {
            ByteOrder::Big => self.section.run::<true>(rest, batch),
            ByteOrder::Little => self.section.run::<false>(rest, batch),
        };
        if common > 0 { ParserStep::Took(common) } else { self.block(at, rest, at_end, batch) }
    }

    /// Handles one block of any type.
    fn block(&mut self, at: u64, rest: &[u8], at_end: bool, batch: &mut Batch) -> ParserStep {
        if rest.is_empty() {
            return ParserStep::More;
        }
        let why = match block::find(rest, self.section.order, at_end) {
            BlockContent::More => return ParserStep::More,
            BlockContent::Block(block) | BlockContent::Large(block) if self.is_shifted(&block, rest) => {
                "bytes between blocks"
            }
            BlockContent::Block(block) => {
                self.section.take(&block, CapturePlace::Offset(at), batch);
                return ParserStep::Took(usize::try_from(block.length).unwrap_or(usize::MAX));
            }
            BlockContent::Large(block)
                if block.length <= LARGEST_BLOCK && self.section.is_plausible(&block) =>
            {
                self.section.take(&block, CapturePlace::Offset(at), batch);
                let Block { length, order, .. } = block;
                self.skip = Some(Skip { start: at, length, order, left: length.saturating_sub(4) });
                return ParserStep::Turned;
            }
            BlockContent::Large(_) => "block of invalid length",
            BlockContent::Nothing(why) => why,
        };
        // The first byte is used at once, so that the search does not find it again.
        self.garbage = Some(Garbage { start: at, why });
        ParserStep::Took(1)
    }

    /// Whether an unknown block is a known block that begins up to three bytes later. This is likely with
    /// packets of equal size: after one extra byte, 256 of them look like one block with both lengths.
    fn is_shifted(&self, block: &Block<'_>, rest: &[u8]) -> bool {
        let length = usize::try_from(block.length).unwrap_or(usize::MAX).min(LARGEST_RECORD);
        block.kind == Kind::Unknown
            && (1..4).any(|shift| {
                let rest = rest.get(shift..length).unwrap_or_default();
                match block::find(rest, self.section.order, true) {
                    BlockContent::Block(block) => {
                        block.kind != Kind::Unknown && self.section.is_plausible(&block)
                    }
                    _ => false,
                }
            })
    }

    fn pass_over(&mut self, skip: Skip, rest: &[u8], at_end: bool) -> ParserStep {
        if rest.is_empty() {
            return ParserStep::More;
        }
        if skip.left > 0 {
            let count = usize::try_from(skip.left).unwrap_or(usize::MAX).min(rest.len());
            self.skip = Some(Skip { left: skip.left.saturating_sub(count as u64), ..skip });
            return ParserStep::Took(count);
        }
        let Some(again) = skip.order.u32(rest, 0) else {
            return if at_end { ParserStep::Took(rest.len()) } else { ParserStep::More };
        };
        self.skip = None;
        if u64::from(again) == skip.length {
            return ParserStep::Took(4);
        }
        self.garbage = Some(Garbage { start: skip.start, why: "block with two different lengths" });
        ParserStep::Turned
    }

    /// Searches the next plausible block.
    fn search(
        &mut self,
        garbage: Garbage,
        at: u64,
        rest: &[u8],
        at_end: bool,
        batch: &mut Batch,
    ) -> ParserStep {
        for position in 0..rest.len() {
            let candidate = rest.get(position..).unwrap_or_default();
            // Waiting for a complete unknown block would delay the frames of known blocks.
            if Kind::at(candidate, self.section.order) == Some(Kind::Unknown) {
                continue;
            }
            match block::find(candidate, self.section.order, at_end) {
                BlockContent::Block(block) if self.section.is_plausible(&block) => {
                    self.garbage = None;
                    let (place, reason) = garbage.into_notice(at.saturating_add(position as u64));
                    batch.push_unreadable(place, reason);
                }
                BlockContent::More => {}
                _ => continue,
            }
            return match position {
                0 if self.garbage.is_none() => ParserStep::Turned,
                0 => ParserStep::More,
                _ => ParserStep::Took(position),
            };
        }
        if rest.is_empty() { ParserStep::More } else { ParserStep::Took(rest.len()) }
    }

    fn end(&mut self, batch: &mut Batch) {
        if std::mem::replace(&mut self.has_ended, true) {
            return;
        }
        if let Some(Skip { start, length, .. }) = self.skip {
            let reason = format!("the capture ends inside a block of {length} bytes");
            batch.notice(Notice::CutOff { place: CapturePlace::Offset(start), reason });
        }
        if let Some(garbage) = self.garbage {
            let (place, reason) = garbage.into_notice(self.offset);
            // A block with an invalid length also appears cut off, until another block is found after it.
            let is_cut = garbage.why == block::CUT_OFF;
            batch.notice(if is_cut {
                Notice::CutOff { place, reason }
            } else {
                Notice::Unreadable { place, reason }
            });
        }
        self.section.summarise(batch);
    }
}

impl Garbage {
    /// Position and text of the notice.
    fn into_notice(self, end: u64) -> (CapturePlace, String) {
        let (why, count) = (self.why, end.saturating_sub(self.start));
        let bytes = if count == 1 { "byte" } else { "bytes" };
        (CapturePlace::Offset(self.start), format!("{why}: {count} {bytes} skipped"))
    }
}

impl Parser for PcapNg {
    fn parse(&mut self, input: &[u8], at_end: bool, batch: &mut Batch) -> Result<usize, CaptureError> {
        let mut taken = 0;
        while !batch.is_full() {
            let rest = input.get(taken..).unwrap_or_default();
            let at = self.offset.saturating_add(taken as u64);
            match self.step(at, rest, at_end, batch) {
                ParserStep::Took(count) => taken += count,
                ParserStep::Turned => {}
                ParserStep::More => break,
            }
        }
        self.offset = self.offset.saturating_add(taken as u64);
        if at_end && taken == input.len() && !batch.is_full() {
            self.end(batch);
        }
        Ok(taken)
    }

    fn buses(&self) -> &BusNames {
        &self.section.buses
    }

    fn clone_box(&self) -> Box<dyn Parser> {
        Box::new(self.clone())
    }
}

#[cfg(test)]
mod tests;
