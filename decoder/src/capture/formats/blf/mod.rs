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

use container::{LARGEST_CONTAINER, LogContainer};
use object::{BASE, FILL, ObjectContent, ObjectHeader, find_object, is_followed};
use objects::{LARGEST_OBJECT, LOG_CONTAINER, ObjectState, is_read};

use crate::capture::byte_order::ByteOrder::Little;
use crate::capture::local_time::LocalClock;
use crate::capture::{
    Batch, BusNames, CaptureError, CaptureFormat, CapturePlace, FormatParser, Notice, ReadOptions, calendar,
};

const MAGIC: &[u8] = b"LOGG";
/// Size of the header in all known versions, and the part of it that is read, in bytes.
const HEADER: usize = 144;
const READ_OF_HEADER: usize = 56;
/// A longer header is treated as damage.
const LONGEST_HEADER: usize = 64 * 1024;
const START: usize = 40;

pub(super) const FORMAT: CaptureFormat = CaptureFormat {
    name: "blf",
    title: object::TITLE,
    is_text: false,
    is_packed: true,
    detect: |head| head.starts_with(MAGIC),
    parser: |options| Box::new(BlfParser::new(options)),
};

/// Parser of BLF.
#[derive(Clone, Default)]
struct BlfParser {
    objects: ObjectState,
    has_header: bool,
    /// Bytes used so far.
    offset: u64,
    /// Bytes left to skip of an object outside of containers.
    skip: usize,
    gap: ObjectGap,
    inner: ContainerPosition,
    open: OpenContainer,
    has_ended: bool,
}

/// Position in a container, and the state carried to the next container.
#[derive(Debug, Clone, Default)]
struct ContainerPosition {
    /// Bytes used of `tail` and the content.
    at: usize,
    /// Start of an object that ends in the next container.
    tail: Vec<u8>,
    /// Bytes left to skip of an object.
    skip: usize,
    gap: ObjectGap,
}

/// Content of the current container; rebuilt if missing.
#[derive(Default)]
struct OpenContainer(Option<LogContainer>);

impl Clone for OpenContainer {
    fn clone(&self) -> Self {
        Self(None)
    }
}

/// Bytes between objects that are not part of an object.
#[derive(Debug, Clone, Copy, Default)]
struct ObjectGap {
    /// Offset of the first of these bytes.
    start: u64,
    count: u64,
    /// Whether the cause was already reported.
    is_reported: bool,
}

impl ObjectGap {
    fn add_bytes(&mut self, at: u64, count: usize) {
        if self.count == 0 {
            self.start = at;
        }
        self.count = self.count.saturating_add(count as u64);
    }

    /// Reports the gap, if any: an object or the end of the capture follows.
    fn report_gap(&mut self, batch: &mut Batch) {
        let Self { start, count, is_reported } = std::mem::take(self);
        if count > FILL as u64 && !is_reported {
            let reason = format!("{count} bytes outside of objects skipped");
            batch.push_unreadable(CapturePlace::Offset(start), reason);
        }
    }
}

/// Result of one step of the parser.
enum BlfStep {
    /// Number of bytes used.
    Took(usize),
    /// Nothing used: more input is needed, or the batch is full.
    Stop,
}

/// Reason why the reading of a container stopped.
enum ContainerEnding {
    /// The batch is full.
    Full,
    /// The content is complete.
    End,
    /// Another container begins this number of bytes before the end.
    Container(usize),
}

impl BlfParser {
    fn new(options: &ReadOptions) -> Self {
        Self { objects: ObjectState::new(LocalClock::new(&options.time_zones)), ..Self::default() }
    }

    fn parse_step(
        &mut self,
        rest: &[u8],
        at: u64,
        at_end: bool,
        batch: &mut Batch,
    ) -> Result<BlfStep, CaptureError> {
        if rest.is_empty() {
            return Ok(BlfStep::Stop);
        }
        if !self.has_header {
            return Ok(self.parse_header(rest, at_end, batch));
        }
        if self.skip > 0 {
            let count = self.skip.min(rest.len());
            self.skip -= count;
            return Ok(BlfStep::Took(count));
        }
        match find_object(rest) {
            ObjectContent::Object(head) if head.kind == LOG_CONTAINER => {
                self.open_container(head, rest, at, at_end, batch)
            }
            ObjectContent::Object(head) => Ok(self.parse_lone_object(head, rest, at, at_end, batch)),
            ObjectContent::More if !at_end => Ok(BlfStep::Stop),
            ObjectContent::More => {
                self.gap.report_gap(batch);
                cut_off(at, batch);
                Ok(BlfStep::Took(rest.len()))
            }
            ObjectContent::Gap(count) => Ok(self.passed_over(at, count)),
        }
    }

    fn passed_over(&mut self, at: u64, count: usize) -> BlfStep {
        self.gap.add_bytes(at, count);
        BlfStep::Took(count)
    }

    fn parse_header(&mut self, rest: &[u8], at_end: bool, batch: &mut Batch) -> BlfStep {
        let size = Little.u32(rest, 4).and_then(|size| usize::try_from(size).ok()).unwrap_or(HEADER);
        let is_usual = (READ_OF_HEADER..=LONGEST_HEADER).contains(&size);
        let size = if is_usual { size } else { HEADER };
        if !at_end && rest.len() < size.max(HEADER) {
            return BlfStep::Stop;
        }
        self.has_header = true;
        if !is_usual {
            batch.push_unreadable(CapturePlace::Offset(4), "invalid header size".into());
        }
        if rest.len() < size {
            let reason = format!("the capture ends inside its header: found {} of {size} bytes", rest.len());
            batch.add_notice(Notice::CutOff { place: CapturePlace::Offset(0), reason });
        }
        self.start_capture(rest, batch);
        BlfStep::Took(size.min(rest.len()))
    }

    fn start_capture(&mut self, header: &[u8], batch: &mut Batch) {
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
        let start = calendar::from_utc([year, month, day, hour, minute, second], ms * 1_000_000);
        if let Some(start) = start {
            self.objects.start = Some(start);
        } else {
            let reason = "invalid start date: times count from 1970".into();
            batch.push_unreadable(CapturePlace::Offset(START as u64), reason);
        }
    }

    /// Handles an object outside of containers.
    fn parse_lone_object(
        &mut self,
        head: ObjectHeader,
        rest: &[u8],
        at: u64,
        at_end: bool,
        batch: &mut Batch,
    ) -> BlfStep {
        if is_read(head.kind) && head.size <= LARGEST_OBJECT {
            // The bytes after the object are checked too.
            if rest.len() < head.size + BASE && !at_end {
                return BlfStep::Stop;
            }
            self.gap.report_gap(batch);
            if rest.len() < head.size {
                cut_off(at, batch);
                return BlfStep::Took(rest.len());
            }
            self.objects.parse_object(
                head,
                rest.get(..head.size).unwrap_or_default(),
                CapturePlace::Offset(at),
                batch,
            );
            return BlfStep::Took(if is_followed(rest, head.size) { head.size } else { BASE });
        }
        self.gap.report_gap(batch);
        too_long(head, at, batch);
        self.objects.pass_over(head.kind, CapturePlace::Offset(at), batch);
        self.skip = head.size;
        BlfStep::Took(0)
    }

    fn open_container(
        &mut self,
        head: ObjectHeader,
        rest: &[u8],
        at: u64,
        at_end: bool,
        batch: &mut Batch,
    ) -> Result<BlfStep, CaptureError> {
        if head.size > LARGEST_CONTAINER {
            return Ok(self.passed_over(at, BASE));
        }
        if rest.len() < head.size && !at_end {
            return Ok(BlfStep::Stop);
        }
        self.gap.report_gap(batch);
        let container = match self.open.0.take() {
            Some(container) => container,
            None => LogContainer::open(head, rest, &self.inner.tail, at)?,
        };
        let ending = self.inner.read_objects(&container, at, &mut self.objects, batch);
        if matches!(ending, ContainerEnding::Full) {
            self.open.0 = Some(container);
            return Ok(BlfStep::Stop);
        }
        let mut length = container.length;
        if let ContainerEnding::Container(left) = ending {
            self.inner.at = container.bytes.len();
            length = length.saturating_sub(left).max(BASE);
            let reason =
                format!("container of {} bytes: another container begins after {length} bytes", head.size);
            batch.push_unreadable(CapturePlace::Offset(at), reason);
        }
        self.inner.keep_remainder(&container);
        if let Some(reason) = container.damage {
            let place = CapturePlace::Offset(at);
            let is_cut = container.is_cut;
            batch.add_notice(if is_cut {
                Notice::CutOff { place, reason }
            } else {
                Notice::Unreadable { place, reason }
            });
        }
        Ok(BlfStep::Took(length))
    }

    fn end_capture(&mut self, batch: &mut Batch) {
        if std::mem::replace(&mut self.has_ended, true) {
            return;
        }
        self.gap.report_gap(batch);
        self.inner.gap.report_gap(batch);
        if self.skip > 0 || self.inner.skip > 0 || !self.inner.tail.is_empty() {
            cut_off(self.offset, batch);
        }
        self.objects.end_capture(batch);
    }
}

impl ContainerPosition {
    /// Reads objects until the batch is full.
    fn read_objects(
        &mut self,
        open: &LogContainer,
        at: u64,
        objects: &mut ObjectState,
        batch: &mut Batch,
    ) -> ContainerEnding {
        loop {
            if batch.is_full() {
                return ContainerEnding::Full;
            }
            let rest = open.bytes.get(self.at..).unwrap_or_default();
            if self.skip > 0 {
                let count = self.skip.min(rest.len());
                if count == 0 {
                    return ContainerEnding::End;
                }
                self.skip -= count;
                self.at += count;
                continue;
            }
            match find_object(rest) {
                ObjectContent::More => return ContainerEnding::End,
                ObjectContent::Gap(count) => {
                    self.gap.add_bytes(at, count);
                    self.at += count;
                }
                ObjectContent::Object(head) => {
                    self.gap.report_gap(batch);
                    if head.kind == LOG_CONTAINER && open.is_stored {
                        return ContainerEnding::Container(rest.len());
                    }
                    if !self.parse_object(head, rest, at, objects, batch) {
                        return ContainerEnding::End;
                    }
                }
            }
        }
    }

    /// Handles the object at the start of `rest`; `false` if it ends in the next container.
    fn parse_object(
        &mut self,
        head: ObjectHeader,
        rest: &[u8],
        at: u64,
        objects: &mut ObjectState,
        batch: &mut Batch,
    ) -> bool {
        let size = if is_followed(rest, head.size) { head.size } else { BASE };
        if !is_read(head.kind) || head.size > LARGEST_OBJECT {
            too_long(head, at, batch);
            objects.pass_over(head.kind, CapturePlace::Offset(at), batch);
            self.skip = size;
            return true;
        }
        let Some(object) = rest.get(..head.size) else { return false };
        objects.parse_object(head, object, CapturePlace::Offset(at), batch);
        self.at += size;
        true
    }

    /// Keeps the bytes of an object that continues in the next container.
    fn keep_remainder(&mut self, open: &LogContainer) {
        let rest = open.bytes.get(self.at..).unwrap_or_default();
        self.at = 0;
        self.tail.clear();
        if open.is_broken {
            self.skip = 0;
            self.gap = ObjectGap { is_reported: true, ..ObjectGap::default() };
        } else if matches!(
            find_object(rest),
            ObjectContent::More | ObjectContent::Object(ObjectHeader { size: ..=LARGEST_OBJECT, .. })
        ) {
            self.tail.extend_from_slice(rest);
        }
    }
}

fn too_long(head: ObjectHeader, at: u64, batch: &mut Batch) {
    if is_read(head.kind) {
        let reason = format!("object type {}: {} bytes are too long for the type", head.kind, head.size);
        batch.push_unreadable(CapturePlace::Offset(at), reason);
    }
}

fn cut_off(at: u64, batch: &mut Batch) {
    let reason = "the capture ends inside an object".into();
    batch.add_notice(Notice::CutOff { place: CapturePlace::Offset(at), reason });
}

impl FormatParser for BlfParser {
    fn parse(&mut self, input: &[u8], at_end: bool, batch: &mut Batch) -> Result<usize, CaptureError> {
        let mut taken = 0;
        while !batch.is_full() {
            let rest = input.get(taken..).unwrap_or_default();
            match self.parse_step(rest, self.offset.saturating_add(taken as u64), at_end, batch) {
                Ok(BlfStep::Took(count)) => taken += count,
                Ok(BlfStep::Stop) => break,
                // Earlier frames are emitted first; the next call returns the error again.
                Err(_) if !batch.is_empty() => break,
                Err(error) => return Err(error),
            }
        }
        self.offset = self.offset.saturating_add(taken as u64);
        if at_end && taken == input.len() && !batch.is_full() {
            self.end_capture(batch);
        }
        Ok(taken)
    }

    fn largest_input(&self) -> usize {
        LARGEST_CONTAINER
    }

    fn buses(&self) -> &BusNames {
        &self.objects.buses
    }

    fn clone_box(&self) -> Box<dyn FormatParser> {
        Box::new(self.clone())
    }
}

#[cfg(test)]
mod tests;
