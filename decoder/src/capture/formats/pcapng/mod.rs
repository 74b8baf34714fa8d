//! pcapng: Wireshark's capture.
//!
//! ```text
//! section header ─▶ interface description … ─▶ packets, statistics, others … ─▶ section header …
//! ```
//! [`block`] shows how a block is told from other bytes, [`interface`] and [`section`] what is in it.
//!
//! Unknown blocks are passed over. Where no block is, the next one that is plausible is searched for and
//! the bytes between are reported.
//!
//! `pcap-file` knows the numbers of the blocks; the reading is done here. Its own refuses an interface,
//! and every packet after it, for a clock finer than nanoseconds or a name that is not UTF-8; it ends at
//! the first byte that is no block; and its state cannot be copied, which a place in a capture needs.

mod block;
mod interface;
mod section;
mod write;

use block::{Block, Found, Kind, START};
use section::Section;

use crate::capture::byte_order::ByteOrder;
use crate::capture::{
    Batch, BusNames, CaptureError, Format, Holds, LARGEST_RECORD, Notice, Parser, Place, WritableFormat,
};

pub(super) const FORMAT: Format = Format {
    name: "pcapng",
    title: "pcapng",
    is_text: false,
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
    holds: Holds { untimed: false, negative: false, ..Holds::ALL },
    writer: |output, _| Box::new(write::PcapngWriter::new(output)),
};

/// Longer blocks are taken for damage: skipping them would lose the rest of the capture.
const LARGEST_BLOCK: u64 = 64 * 1024 * 1024;

/// Reader of pcapng.
#[derive(Clone, Default)]
struct PcapNg {
    section: Section,
    /// Bytes taken so far.
    offset: u64,
    skip: Option<Skip>,
    garbage: Option<Garbage>,
    has_ended: bool,
}

/// A long block being passed over.
#[derive(Debug, Clone, Copy)]
struct Skip {
    /// Where it begins.
    start: u64,
    length: u64,
    order: ByteOrder,
    /// Bytes before its second length.
    left: u64,
}

/// Bytes that are no block.
#[derive(Debug, Clone, Copy)]
struct Garbage {
    /// Where they begin.
    start: u64,
    why: &'static str,
}

/// What a step of the parser did.
enum Step {
    /// Took so many bytes.
    Took(usize),
    /// Took none, but goes on differently.
    Turned,
    /// Nothing: more input is needed.
    More,
}

impl PcapNg {
    /// The next step in whatever is being done.
    fn step(&mut self, at: u64, rest: &[u8], at_end: bool, batch: &mut Batch) -> Step {
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
        if common > 0 { Step::Took(common) } else { self.block(at, rest, at_end, batch) }
    }

    /// One block of any kind.
    fn block(&mut self, at: u64, rest: &[u8], at_end: bool, batch: &mut Batch) -> Step {
        if rest.is_empty() {
            return Step::More;
        }
        let why = match block::find(rest, self.section.order, at_end) {
            Found::More => return Step::More,
            Found::Block(block) | Found::Large(block) if self.is_shifted(&block, rest) => {
                "bytes between blocks"
            }
            Found::Block(block) => {
                self.section.take(&block, Place::Offset(at), batch);
                return Step::Took(usize::try_from(block.length).unwrap_or(usize::MAX));
            }
            Found::Large(block) if block.length <= LARGEST_BLOCK && self.section.is_plausible(&block) => {
                self.section.take(&block, Place::Offset(at), batch);
                let Block { length, order, .. } = block;
                self.skip = Some(Skip { start: at, length, order, left: length.saturating_sub(4) });
                return Step::Turned;
            }
            Found::Large(_) => "a block of impossible length",
            Found::Nothing(why) => why,
        };
        // Its first byte is taken at once, so that the search cannot come back to it.
        self.garbage = Some(Garbage { start: at, why });
        Step::Took(1)
    }

    /// Whether an unknown block is a known one that begins some bytes later. Packets of one size make
    /// this likely: behind one odd byte, 256 of them look like one block with both its lengths.
    fn is_shifted(&self, block: &Block<'_>, rest: &[u8]) -> bool {
        let length = usize::try_from(block.length).unwrap_or(usize::MAX).min(LARGEST_RECORD);
        block.kind == Kind::Unknown
            && (1..4).any(|shift| {
                let rest = rest.get(shift..length).unwrap_or_default();
                match block::find(rest, self.section.order, true) {
                    Found::Block(block) => block.kind != Kind::Unknown && self.section.is_plausible(&block),
                    _ => false,
                }
            })
    }

    fn pass_over(&mut self, skip: Skip, rest: &[u8], at_end: bool) -> Step {
        if rest.is_empty() {
            return Step::More;
        }
        if skip.left > 0 {
            let count = usize::try_from(skip.left).unwrap_or(usize::MAX).min(rest.len());
            self.skip = Some(Skip { left: skip.left.saturating_sub(count as u64), ..skip });
            return Step::Took(count);
        }
        let Some(again) = skip.order.u32(rest, 0) else {
            return if at_end { Step::Took(rest.len()) } else { Step::More };
        };
        self.skip = None;
        if u64::from(again) == skip.length {
            return Step::Took(4);
        }
        self.garbage = Some(Garbage { start: skip.start, why: "a block whose two lengths differ" });
        Step::Turned
    }

    /// Looks for the next block that can be one.
    fn search(&mut self, garbage: Garbage, at: u64, rest: &[u8], at_end: bool, batch: &mut Batch) -> Step {
        for position in 0..rest.len() {
            let candidate = rest.get(position..).unwrap_or_default();
            // Waiting for the whole of an unknown block would hold back what is known.
            if Kind::at(candidate, self.section.order) == Some(Kind::Unknown) {
                continue;
            }
            match block::find(candidate, self.section.order, at_end) {
                Found::Block(block) if self.section.is_plausible(&block) => {
                    self.garbage = None;
                    let (place, reason) = garbage.told(at.saturating_add(position as u64));
                    batch.push_unreadable(place, reason);
                }
                Found::More => {}
                _ => continue,
            }
            return match position {
                0 if self.garbage.is_none() => Step::Turned,
                0 => Step::More,
                _ => Step::Took(position),
            };
        }
        if rest.is_empty() { Step::More } else { Step::Took(rest.len()) }
    }

    fn end(&mut self, batch: &mut Batch) {
        if std::mem::replace(&mut self.has_ended, true) {
            return;
        }
        if let Some(Skip { start, length, .. }) = self.skip {
            let reason = format!("the capture ends inside a block of {length} bytes");
            batch.notice(Notice::CutOff { place: Place::Offset(start), reason });
        }
        if let Some(garbage) = self.garbage {
            let (place, reason) = garbage.told(self.offset);
            // A block with a length that is wrong seems to be cut off too, until another one is found behind it.
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
    /// Where it stands, and what is said of it.
    fn told(self, end: u64) -> (Place, String) {
        let (why, count) = (self.why, end.saturating_sub(self.start));
        let bytes = if count == 1 { "byte" } else { "bytes" };
        (Place::Offset(self.start), format!("{why}: {count} {bytes} passed over"))
    }
}

impl Parser for PcapNg {
    fn parse(&mut self, input: &[u8], at_end: bool, batch: &mut Batch) -> Result<usize, CaptureError> {
        let mut taken = 0;
        while !batch.is_full() {
            let rest = input.get(taken..).unwrap_or_default();
            let at = self.offset.saturating_add(taken as u64);
            match self.step(at, rest, at_end, batch) {
                Step::Took(count) => taken += count,
                Step::Turned => {}
                Step::More => break,
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
