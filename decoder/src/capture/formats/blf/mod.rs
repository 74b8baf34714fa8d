//! BLF: the binary captures of Vector's programs.
//!
//! ```text
//! header, 144 bytes                      ─▶ containers ─▶ objects, some of which are frames
//!  0 LOGG (4)   4 size of the header (4)
//! 40 start: year, month, day of the week, day, hour, minute, second, millisecond (2 each), local time
//! ```
//! Layouts: [`container`] and [`object`]; contents of the supported objects: [`frame`] and [`error`]. Objects
//! may also occur outside of containers.
//!
//! At most one container is decompressed at a time. A stored position does not include its content: it
//! consists of the offset of the container, the position in its content, and the remaining bytes of the
//! previous container.

mod container;
mod error;
mod frame;
mod object;
mod objects;

use container::{Container, LARGEST_CONTAINER};
use object::{BASE, FILL, Head, ObjectContent, find, is_followed};
use objects::{LARGEST_OBJECT, LOG_CONTAINER, Objects, is_read};

use crate::capture::byte_order::ByteOrder::Little;
use crate::capture::{Batch, BusNames, CaptureError, CapturePlace, Format, Notice, Parser, calendar};

const MAGIC: &[u8] = b"LOGG";
/// Size of the header in all known versions, and the part of it that is read, in bytes.
const HEADER: usize = 144;
const READ_OF_HEADER: usize = 56;
/// A longer header is treated as damage.
const LONGEST_HEADER: usize = 64 * 1024;
const START: usize = 40;

pub(super) const FORMAT: Format = Format {
    name: "blf",
    title: object::TITLE,
    is_text: false,
    is_packed: true,
    detect: |head| head.starts_with(MAGIC),
    parser: |_| Box::new(Blf::default()),
};

/// Parser of BLF.
#[derive(Clone, Default)]
struct Blf {
    objects: Objects,
    has_header: bool,
    /// Bytes used so far.
    offset: u64,
    /// Bytes left to skip of an object outside of containers.
    skip: usize,
    gap: Gap,
    inner: Inner,
    open: OpenContainer,
    has_ended: bool,
}

/// Position in a container, and the state carried to the next container.
#[derive(Debug, Clone, Default)]
struct Inner {
    /// Bytes used of `tail` and the content.
    at: usize,
    /// Start of an object that ends in the next container.
    tail: Vec<u8>,
    /// Bytes left to skip of an object.
    skip: usize,
    gap: Gap,
}

/// Content of the current container; rebuilt if missing.
#[derive(Default)]
struct OpenContainer(Option<Container>);

impl Clone for OpenContainer {
    fn clone(&self) -> Self {
        Self(None)
    }
}

/// Bytes between objects that are not part of an object.
#[derive(Debug, Clone, Copy, Default)]
struct Gap {
    /// Offset of the first of these bytes.
    start: u64,
    count: u64,
    /// Whether the cause was already reported.
    is_told: bool,
}

impl Gap {
    fn add(&mut self, at: u64, count: usize) {
        if self.count == 0 {
            self.start = at;
        }
        self.count = self.count.saturating_add(count as u64);
    }

    /// Reports the gap, if any: an object or the end of the capture follows.
    fn close(&mut self, batch: &mut Batch) {
        let Self { start, count, is_told } = std::mem::take(self);
        if count > FILL as u64 && !is_told {
            let reason = format!("{count} bytes outside of objects skipped");
            batch.push_unreadable(CapturePlace::Offset(start), reason);
        }
    }
}

/// Result of one step of the parser.
enum ParserStep {
    /// Number of bytes used.
    Took(usize),
    /// Nothing used: more input is needed, or the batch is full.
    Stop,
}

/// Reason why the reading of a container stopped.
enum Ending {
    /// The batch is full.
    Full,
    /// The content is complete.
    End,
    /// Another container begins this number of bytes before the end.
    Container(usize),
}

impl Blf {
    fn step(
        &mut self,
        rest: &[u8],
        at: u64,
        at_end: bool,
        batch: &mut Batch,
    ) -> Result<ParserStep, CaptureError> {
        if rest.is_empty() {
            return Ok(ParserStep::Stop);
        }
        if !self.has_header {
            return Ok(self.header(rest, at_end, batch));
        }
        if self.skip > 0 {
            let count = self.skip.min(rest.len());
            self.skip -= count;
            return Ok(ParserStep::Took(count));
        }
        match find(rest) {
            ObjectContent::Object(head) if head.kind == LOG_CONTAINER => {
                self.container(head, rest, at, at_end, batch)
            }
            ObjectContent::Object(head) => Ok(self.lone(head, rest, at, at_end, batch)),
            ObjectContent::More if !at_end => Ok(ParserStep::Stop),
            ObjectContent::More => {
                self.gap.close(batch);
                cut_off(at, batch);
                Ok(ParserStep::Took(rest.len()))
            }
            ObjectContent::Gap(count) => Ok(self.passed_over(at, count)),
        }
    }

    fn passed_over(&mut self, at: u64, count: usize) -> ParserStep {
        self.gap.add(at, count);
        ParserStep::Took(count)
    }

    fn header(&mut self, rest: &[u8], at_end: bool, batch: &mut Batch) -> ParserStep {
        let size = Little.u32(rest, 4).and_then(|size| usize::try_from(size).ok()).unwrap_or(HEADER);
        let is_usual = (READ_OF_HEADER..=LONGEST_HEADER).contains(&size);
        let size = if is_usual { size } else { HEADER };
        if !at_end && rest.len() < size.max(HEADER) {
            return ParserStep::Stop;
        }
        self.has_header = true;
        if !is_usual {
            batch.push_unreadable(CapturePlace::Offset(4), "invalid header size".into());
        }
        if rest.len() < size {
            let reason = format!("the capture ends inside its header: found {} of {size} bytes", rest.len());
            batch.notice(Notice::CutOff { place: CapturePlace::Offset(0), reason });
        }
        self.start(rest, batch);
        ParserStep::Took(size.min(rest.len()))
    }

    fn start(&mut self, header: &[u8], batch: &mut Batch) {
        let field = |index: usize| Little.u16(header, START + 2 * index).map(i64::from);
        let fields = [field(0), field(1), field(3), field(4), field(5), field(6), field(7)];
        let [Some(year), Some(month), Some(day), Some(hour), Some(minute), Some(second), Some(ms)] = fields
        else {
            return;
        };
        // Writers without a clock leave the date empty.
        if (year, month, day) == (0, 0, 0) {
            return;
        }
        let start = calendar::utc([year, month, day, hour, minute, second], ms * 1_000_000);
        if let Some(start) = start {
            self.objects.start = start;
            let text = "start date without time zone: times read as UTC";
            batch.notice(Notice::Assumption(text.into()));
        } else {
            let reason = "invalid start date: times count from 1970".into();
            batch.push_unreadable(CapturePlace::Offset(START as u64), reason);
        }
    }

    /// Handles an object outside of containers.
    fn lone(&mut self, head: Head, rest: &[u8], at: u64, at_end: bool, batch: &mut Batch) -> ParserStep {
        if is_read(head.kind) && head.size <= LARGEST_OBJECT {
            // The bytes after the object are checked too.
            if rest.len() < head.size + BASE && !at_end {
                return ParserStep::Stop;
            }
            self.gap.close(batch);
            if rest.len() < head.size {
                cut_off(at, batch);
                return ParserStep::Took(rest.len());
            }
            self.objects.take(
                head,
                rest.get(..head.size).unwrap_or_default(),
                CapturePlace::Offset(at),
                batch,
            );
            return ParserStep::Took(if is_followed(rest, head.size) { head.size } else { BASE });
        }
        self.gap.close(batch);
        too_long(head, at, batch);
        self.objects.pass_over(head.kind);
        self.skip = head.size;
        ParserStep::Took(0)
    }

    fn container(
        &mut self,
        head: Head,
        rest: &[u8],
        at: u64,
        at_end: bool,
        batch: &mut Batch,
    ) -> Result<ParserStep, CaptureError> {
        if head.size > LARGEST_CONTAINER {
            return Ok(self.passed_over(at, BASE));
        }
        if rest.len() < head.size && !at_end {
            return Ok(ParserStep::Stop);
        }
        self.gap.close(batch);
        let container = match self.open.0.take() {
            Some(container) => container,
            None => Container::open(head, rest, &self.inner.tail, at)?,
        };
        let ending = self.inner.read(&container, at, &mut self.objects, batch);
        if matches!(ending, Ending::Full) {
            self.open.0 = Some(container);
            return Ok(ParserStep::Stop);
        }
        let mut length = container.length;
        if let Ending::Container(left) = ending {
            self.inner.at = container.bytes.len();
            length = length.saturating_sub(left).max(BASE);
            let reason =
                format!("container of {} bytes: another container begins after {length} bytes", head.size);
            batch.push_unreadable(CapturePlace::Offset(at), reason);
        }
        self.inner.close(&container);
        if let Some(reason) = container.damage {
            let place = CapturePlace::Offset(at);
            let is_cut = container.is_cut;
            batch.notice(if is_cut {
                Notice::CutOff { place, reason }
            } else {
                Notice::Unreadable { place, reason }
            });
        }
        Ok(ParserStep::Took(length))
    }

    fn end(&mut self, batch: &mut Batch) {
        if std::mem::replace(&mut self.has_ended, true) {
            return;
        }
        self.gap.close(batch);
        self.inner.gap.close(batch);
        if self.skip > 0 || self.inner.skip > 0 || !self.inner.tail.is_empty() {
            cut_off(self.offset, batch);
        }
        self.objects.end(batch);
    }
}

impl Inner {
    /// Reads objects until the batch is full.
    fn read(&mut self, open: &Container, at: u64, objects: &mut Objects, batch: &mut Batch) -> Ending {
        loop {
            if batch.is_full() {
                return Ending::Full;
            }
            let rest = open.bytes.get(self.at..).unwrap_or_default();
            if self.skip > 0 {
                let count = self.skip.min(rest.len());
                if count == 0 {
                    return Ending::End;
                }
                self.skip -= count;
                self.at += count;
                continue;
            }
            match find(rest) {
                ObjectContent::More => return Ending::End,
                ObjectContent::Gap(count) => {
                    self.gap.add(at, count);
                    self.at += count;
                }
                ObjectContent::Object(head) => {
                    self.gap.close(batch);
                    if head.kind == LOG_CONTAINER && open.is_stored {
                        return Ending::Container(rest.len());
                    }
                    if !self.object(head, rest, at, objects, batch) {
                        return Ending::End;
                    }
                }
            }
        }
    }

    /// Handles the object at the start of `rest`; `false` if it ends in the next container.
    fn object(&mut self, head: Head, rest: &[u8], at: u64, objects: &mut Objects, batch: &mut Batch) -> bool {
        let size = if is_followed(rest, head.size) { head.size } else { BASE };
        if !is_read(head.kind) || head.size > LARGEST_OBJECT {
            too_long(head, at, batch);
            objects.pass_over(head.kind);
            self.skip = size;
            return true;
        }
        let Some(object) = rest.get(..head.size) else { return false };
        objects.take(head, object, CapturePlace::Offset(at), batch);
        self.at += size;
        true
    }

    /// Keeps the bytes of an object that continues in the next container.
    fn close(&mut self, open: &Container) {
        let rest = open.bytes.get(self.at..).unwrap_or_default();
        self.at = 0;
        self.tail.clear();
        if open.is_broken {
            self.skip = 0;
            self.gap = Gap { is_told: true, ..Gap::default() };
        } else if matches!(
            find(rest),
            ObjectContent::More | ObjectContent::Object(Head { size: ..=LARGEST_OBJECT, .. })
        ) {
            self.tail.extend_from_slice(rest);
        }
    }
}

fn too_long(head: Head, at: u64, batch: &mut Batch) {
    if is_read(head.kind) {
        let reason = format!("object type {}: {} bytes are too long for the type", head.kind, head.size);
        batch.push_unreadable(CapturePlace::Offset(at), reason);
    }
}

fn cut_off(at: u64, batch: &mut Batch) {
    let reason = "the capture ends inside an object".into();
    batch.notice(Notice::CutOff { place: CapturePlace::Offset(at), reason });
}

impl Parser for Blf {
    fn parse(&mut self, input: &[u8], at_end: bool, batch: &mut Batch) -> Result<usize, CaptureError> {
        let mut taken = 0;
        while !batch.is_full() {
            let rest = input.get(taken..).unwrap_or_default();
            match self.step(rest, self.offset.saturating_add(taken as u64), at_end, batch) {
                Ok(ParserStep::Took(count)) => taken += count,
                Ok(ParserStep::Stop) => break,
                // Earlier frames are emitted first; the next call returns the error again.
                Err(_) if !batch.is_empty() => break,
                Err(error) => return Err(error),
            }
        }
        self.offset = self.offset.saturating_add(taken as u64);
        if at_end && taken == input.len() && !batch.is_full() {
            self.end(batch);
        }
        Ok(taken)
    }

    fn largest(&self) -> usize {
        LARGEST_CONTAINER
    }

    fn buses(&self) -> &BusNames {
        &self.objects.buses
    }

    fn clone_box(&self) -> Box<dyn Parser> {
        Box::new(self.clone())
    }
}

#[cfg(test)]
mod tests;
