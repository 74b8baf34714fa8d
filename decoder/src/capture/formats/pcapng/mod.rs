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

use block::{BlockContent, BlockType, PcapngBlock, START};
use section::PcapngSection;

use crate::capture::byte_order::ByteOrder;
use crate::capture::{
    Batch, BusNames, CaptureError, CaptureFormat, CapturePlace, FormatCapabilities, FormatParser,
    LARGEST_RECORD, Notice, WritableFormat,
};

pub(super) const FORMAT: CaptureFormat = CaptureFormat {
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
    section: PcapngSection,
    /// Bytes used so far.
    offset: u64,
    skip: Option<SkippedBlock>,
    garbage: Option<StrayBytes>,
    has_ended: bool,
}

/// A long block being skipped.
#[derive(Debug, Clone, Copy)]
struct SkippedBlock {
    /// Offset of the block.
    start: u64,
    length: u64,
    order: ByteOrder,
    /// Bytes left before its second length.
    left: u64,
}

/// Bytes outside of blocks.
#[derive(Debug, Clone, Copy)]
struct StrayBytes {
    /// Offset of the first of these bytes.
    start: u64,
    why: &'static str,
}

/// Result of one step of the parser.
enum PcapngStep {
    /// Number of bytes used.
    Took(usize),
    /// Nothing used, but the state changed.
    Turned,
    /// Nothing used: more input is needed.
    More,
}

impl PcapNg {
    /// Performs the next step of skipping, searching or parsing.
    fn parse_step(&mut self, at: u64, rest: &[u8], at_end: bool, batch: &mut Batch) -> PcapngStep {
        if let Some(skip) = self.skip {
            return self.pass_over(skip, rest, at_end);
        }
        if let Some(garbage) = self.garbage {
            return self.search_block(garbage, at, rest, at_end, batch);
        }
        let common = match self.section.order {
            ByteOrder::Big => self.section.parse_run::<true>(rest, batch),
            ByteOrder::Little => self.section.parse_run::<false>(rest, batch),
        };
        if common > 0 { PcapngStep::Took(common) } else { self.parse_block(at, rest, at_end, batch) }
    }

    /// Handles one block of any type.
    fn parse_block(&mut self, at: u64, rest: &[u8], at_end: bool, batch: &mut Batch) -> PcapngStep {
        if rest.is_empty() {
            return PcapngStep::More;
        }
        let why = match block::find_block(rest, self.section.order, at_end) {
            BlockContent::More => return PcapngStep::More,
            BlockContent::Block(block) | BlockContent::Large(block) if self.is_shifted(&block, rest) => {
                "bytes between blocks"
            }
            BlockContent::Block(block) => {
                self.section.take_block(&block, CapturePlace::Offset(at), batch);
                return PcapngStep::Took(usize::try_from(block.length).unwrap_or(usize::MAX));
            }
            BlockContent::Large(block)
                if block.length <= LARGEST_BLOCK && self.section.is_plausible(&block) =>
            {
                self.section.take_block(&block, CapturePlace::Offset(at), batch);
                let PcapngBlock { length, order, .. } = block;
                self.skip = Some(SkippedBlock { start: at, length, order, left: length.saturating_sub(4) });
                return PcapngStep::Turned;
            }
            BlockContent::Large(_) => "block of invalid length",
            BlockContent::Nothing(why) => why,
        };
        // The first byte is used at once, so that the search does not find it again.
        self.garbage = Some(StrayBytes { start: at, why });
        PcapngStep::Took(1)
    }

    /// Whether an unknown block is a known block that begins up to three bytes later. This is likely with
    /// packets of equal size: after one extra byte, 256 of them look like one block with both lengths.
    fn is_shifted(&self, block: &PcapngBlock<'_>, rest: &[u8]) -> bool {
        let length = usize::try_from(block.length).unwrap_or(usize::MAX).min(LARGEST_RECORD);
        block.kind == BlockType::Unknown
            && (1..4).any(|shift| {
                let rest = rest.get(shift..length).unwrap_or_default();
                match block::find_block(rest, self.section.order, true) {
                    BlockContent::Block(block) => {
                        block.kind != BlockType::Unknown && self.section.is_plausible(&block)
                    }
                    _ => false,
                }
            })
    }

    fn pass_over(&mut self, skip: SkippedBlock, rest: &[u8], at_end: bool) -> PcapngStep {
        if rest.is_empty() {
            return PcapngStep::More;
        }
        if skip.left > 0 {
            let count = usize::try_from(skip.left).unwrap_or(usize::MAX).min(rest.len());
            self.skip = Some(SkippedBlock { left: skip.left.saturating_sub(count as u64), ..skip });
            return PcapngStep::Took(count);
        }
        let Some(again) = skip.order.u32(rest, 0) else {
            return if at_end { PcapngStep::Took(rest.len()) } else { PcapngStep::More };
        };
        self.skip = None;
        if u64::from(again) == skip.length {
            return PcapngStep::Took(4);
        }
        self.garbage = Some(StrayBytes { start: skip.start, why: "block with two different lengths" });
        PcapngStep::Turned
    }

    /// Searches the next plausible block.
    fn search_block(
        &mut self,
        garbage: StrayBytes,
        at: u64,
        rest: &[u8],
        at_end: bool,
        batch: &mut Batch,
    ) -> PcapngStep {
        for position in 0..rest.len() {
            let candidate = rest.get(position..).unwrap_or_default();
            // Waiting for a complete unknown block would delay the frames of known blocks.
            if BlockType::kind_at(candidate, self.section.order) == Some(BlockType::Unknown) {
                continue;
            }
            match block::find_block(candidate, self.section.order, at_end) {
                BlockContent::Block(block) if self.section.is_plausible(&block) => {
                    self.garbage = None;
                    let (place, reason) = garbage.into_notice(at.saturating_add(position as u64));
                    batch.push_unreadable(place, reason);
                }
                BlockContent::More => {}
                _ => continue,
            }
            return match position {
                0 if self.garbage.is_none() => PcapngStep::Turned,
                0 => PcapngStep::More,
                _ => PcapngStep::Took(position),
            };
        }
        if rest.is_empty() { PcapngStep::More } else { PcapngStep::Took(rest.len()) }
    }

    fn end_capture(&mut self, batch: &mut Batch) {
        if std::mem::replace(&mut self.has_ended, true) {
            return;
        }
        if let Some(SkippedBlock { start, length, .. }) = self.skip {
            let reason = format!("the capture ends inside a block of {length} bytes");
            batch.add_notice(Notice::CutOff { place: CapturePlace::Offset(start), reason });
        }
        if let Some(garbage) = self.garbage {
            let (place, reason) = garbage.into_notice(self.offset);
            // A block with an invalid length also appears cut off, until another block is found after it.
            let is_cut = garbage.why == block::CUT_OFF;
            batch.add_notice(if is_cut {
                Notice::CutOff { place, reason }
            } else {
                Notice::Unreadable { place, reason }
            });
        }
        self.section.report_other_packets(batch);
    }
}

impl StrayBytes {
    /// Position and text of the notice.
    fn into_notice(self, end: u64) -> (CapturePlace, String) {
        let (why, count) = (self.why, end.saturating_sub(self.start));
        let bytes = if count == 1 { "byte" } else { "bytes" };
        (CapturePlace::Offset(self.start), format!("{why}: {count} {bytes} skipped"))
    }
}

impl FormatParser for PcapNg {
    fn parse(&mut self, input: &[u8], at_end: bool, batch: &mut Batch) -> Result<usize, CaptureError> {
        let mut taken = 0;
        while !batch.is_full() {
            let rest = input.get(taken..).unwrap_or_default();
            let at = self.offset.saturating_add(taken as u64);
            match self.parse_step(at, rest, at_end, batch) {
                PcapngStep::Took(count) => taken += count,
                PcapngStep::Turned => {}
                PcapngStep::More => break,
            }
        }
        self.offset = self.offset.saturating_add(taken as u64);
        if at_end && taken == input.len() && !batch.is_full() {
            self.end_capture(batch);
        }
        Ok(taken)
    }

    fn buses(&self) -> &BusNames {
        &self.section.buses
    }

    fn clone_box(&self) -> Box<dyn FormatParser> {
        Box::new(self.clone())
    }
}

#[cfg(test)]
mod tests;
