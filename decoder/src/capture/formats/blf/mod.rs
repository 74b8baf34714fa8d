//! BLF: the binary captures of Vector's programs.
//!
//! ```text
//! header, 144 bytes                      ─▶ containers ─▶ objects in them, of which some are frames
//!  0 LOGG (4)   4 size of the header (4)
//! 40 start: year, month, day of the week, day, hour, minute, second, millisecond (2 each), local time
//! ```
//! [`container`] and [`object`] show how those are built, [`frame`] and [`error`] what is in the objects that
//! are read. Objects may also stand outside of containers.
//!
//! Only the content of a container is ever held at once, and a place in a capture does not hold it: it is the
//! place of the container, how far in it reading is, and what was left of the one before.

mod container;
mod error;
mod frame;
mod object;
mod objects;

use container::{Container, LARGEST_CONTAINER};
use object::{BASE, FILL, Found, Head, find, is_followed};
use objects::{LARGEST_OBJECT, LOG_CONTAINER, Objects, is_read};

use crate::capture::byte_order::ByteOrder::Little;
use crate::capture::{Batch, BusNames, CaptureError, Format, Notice, Parser, Place, calendar};

const MAGIC: &[u8] = b"LOGG";
/// Header as all known versions have it, and the part of it that is read.
const HEADER: usize = 144;
const READ_OF_HEADER: usize = 56;
/// A longer header is taken for damage.
const LONGEST_HEADER: usize = 64 * 1024;
const START: usize = 40;

pub(super) const FORMAT: Format = Format {
    name: "blf",
    title: object::TITLE,
    is_text: false,
    detect: |head| head.starts_with(MAGIC),
    parser: |_| Box::new(Blf::default()),
};

/// Reader of BLF.
#[derive(Clone, Default)]
struct Blf {
    objects: Objects,
    has_header: bool,
    /// Bytes taken so far.
    offset: u64,
    /// Bytes of an object outside of containers still to pass over.
    skip: usize,
    gap: Gap,
    inner: Inner,
    open: Open,
    has_ended: bool,
}

/// How far reading is in a container, and what goes on from one to the next.
#[derive(Debug, Clone, Default)]
struct Inner {
    /// Bytes taken of the content and of `tail` before it.
    at: usize,
    /// The beginning of an object that ends in the next container.
    tail: Vec<u8>,
    /// Bytes of an object still to pass over.
    skip: usize,
    gap: Gap,
}

/// The content of the container being read: made again where it is missing.
#[derive(Default)]
struct Open(Option<Container>);

impl Clone for Open {
    fn clone(&self) -> Self {
        Self(None)
    }
}

/// Bytes that are no object.
#[derive(Debug, Clone, Copy, Default)]
struct Gap {
    /// Where they begin.
    start: u64,
    count: u64,
    /// Whether it was said before why they are there.
    is_told: bool,
}

impl Gap {
    fn add(&mut self, at: u64, count: usize) {
        if self.count == 0 {
            self.start = at;
        }
        self.count = self.count.saturating_add(count as u64);
    }

    /// An object, or the end, follows.
    fn close(&mut self, batch: &mut Batch) {
        let Self { start, count, is_told } = std::mem::take(self);
        if count > FILL as u64 && !is_told {
            let reason = format!("{count} bytes that are no object passed over");
            batch.push_unreadable(Place::Offset(start), reason);
        }
    }
}

/// What a step of the parser did.
enum Step {
    /// Took so many bytes.
    Took(usize),
    /// Nothing: more input is needed, or there is no room for more frames.
    Stop,
}

/// How the reading of a container ended.
enum Ending {
    /// The batch is full.
    Full,
    /// All of it was read.
    End,
    /// A container begins in it, so many bytes before its end.
    Container(usize),
}

impl Blf {
    fn step(&mut self, rest: &[u8], at: u64, at_end: bool, batch: &mut Batch) -> Result<Step, CaptureError> {
        if rest.is_empty() {
            return Ok(Step::Stop);
        }
        if !self.has_header {
            return Ok(self.header(rest, at_end, batch));
        }
        if self.skip > 0 {
            let count = self.skip.min(rest.len());
            self.skip -= count;
            return Ok(Step::Took(count));
        }
        match find(rest) {
            Found::Object(head) if head.kind == LOG_CONTAINER => {
                self.container(head, rest, at, at_end, batch)
            }
            Found::Object(head) => Ok(self.lone(head, rest, at, at_end, batch)),
            Found::More if !at_end => Ok(Step::Stop),
            Found::More => {
                self.gap.close(batch);
                cut_off(at, batch);
                Ok(Step::Took(rest.len()))
            }
            Found::Gap(count) => Ok(self.passed_over(at, count)),
        }
    }

    fn passed_over(&mut self, at: u64, count: usize) -> Step {
        self.gap.add(at, count);
        Step::Took(count)
    }

    fn header(&mut self, rest: &[u8], at_end: bool, batch: &mut Batch) -> Step {
        let size = Little.u32(rest, 4).and_then(|size| usize::try_from(size).ok()).unwrap_or(HEADER);
        let is_usual = (READ_OF_HEADER..=LONGEST_HEADER).contains(&size);
        let size = if is_usual { size } else { HEADER };
        if !at_end && rest.len() < size.max(HEADER) {
            return Step::Stop;
        }
        self.has_header = true;
        if !is_usual {
            batch.push_unreadable(Place::Offset(4), "a header of impossible size".into());
        }
        if rest.len() < size {
            let reason = format!("the capture ends inside its header: found {} of {size} bytes", rest.len());
            batch.notice(Notice::CutOff { place: Place::Offset(0), reason });
        }
        self.start(rest, batch);
        Step::Took(size.min(rest.len()))
    }

    fn start(&mut self, header: &[u8], batch: &mut Batch) {
        let field = |index: usize| Little.u16(header, START + 2 * index).map(i64::from);
        let fields = [field(0), field(1), field(3), field(4), field(5), field(6), field(7)];
        let [Some(year), Some(month), Some(day), Some(hour), Some(minute), Some(second), Some(ms)] = fields
        else {
            return;
        };
        // Writers without a clock leave it empty.
        if (year, month, day) == (0, 0, 0) {
            return;
        }
        let start = calendar::utc([year, month, day, hour, minute, second], ms * 1_000_000);
        if let Some(start) = start {
            self.objects.start = start;
            let text = "the start date carries no time zone: times read as UTC";
            batch.notice(Notice::Assumption(text.into()));
        } else {
            let reason = "the start is no date: times count from 1970".into();
            batch.push_unreadable(Place::Offset(START as u64), reason);
        }
    }

    /// An object outside of containers.
    fn lone(&mut self, head: Head, rest: &[u8], at: u64, at_end: bool, batch: &mut Batch) -> Step {
        if is_read(head.kind) && head.size <= LARGEST_OBJECT {
            // What follows is looked at too.
            if rest.len() < head.size + BASE && !at_end {
                return Step::Stop;
            }
            self.gap.close(batch);
            if rest.len() < head.size {
                cut_off(at, batch);
                return Step::Took(rest.len());
            }
            self.objects.take(head, rest.get(..head.size).unwrap_or_default(), Place::Offset(at), batch);
            return Step::Took(if is_followed(rest, head.size) { head.size } else { BASE });
        }
        self.gap.close(batch);
        too_long(head, at, batch);
        self.objects.pass_over(head.kind);
        self.skip = head.size;
        Step::Took(0)
    }

    fn container(
        &mut self,
        head: Head,
        rest: &[u8],
        at: u64,
        at_end: bool,
        batch: &mut Batch,
    ) -> Result<Step, CaptureError> {
        if head.size > LARGEST_CONTAINER {
            return Ok(self.passed_over(at, BASE));
        }
        if rest.len() < head.size && !at_end {
            return Ok(Step::Stop);
        }
        self.gap.close(batch);
        let container = match self.open.0.take() {
            Some(container) => container,
            None => Container::open(head, rest, &self.inner.tail, at)?,
        };
        let ending = self.inner.read(&container, at, &mut self.objects, batch);
        if matches!(ending, Ending::Full) {
            self.open.0 = Some(container);
            return Ok(Step::Stop);
        }
        let mut length = container.length;
        if let Ending::Container(left) = ending {
            self.inner.at = container.bytes.len();
            length = length.saturating_sub(left).max(BASE);
            let reason =
                format!("a container of {} bytes, in which another begins after {length}", head.size);
            batch.push_unreadable(Place::Offset(at), reason);
        }
        self.inner.close(&container);
        if let Some(reason) = container.damage {
            let place = Place::Offset(at);
            let is_cut = container.is_cut;
            batch.notice(if is_cut {
                Notice::CutOff { place, reason }
            } else {
                Notice::Unreadable { place, reason }
            });
        }
        Ok(Step::Took(length))
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
                Found::More => return Ending::End,
                Found::Gap(count) => {
                    self.gap.add(at, count);
                    self.at += count;
                }
                Found::Object(head) => {
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

    /// The object at the front of `rest`; `false` if it ends in the next container.
    fn object(&mut self, head: Head, rest: &[u8], at: u64, objects: &mut Objects, batch: &mut Batch) -> bool {
        let size = if is_followed(rest, head.size) { head.size } else { BASE };
        if !is_read(head.kind) || head.size > LARGEST_OBJECT {
            too_long(head, at, batch);
            objects.pass_over(head.kind);
            self.skip = size;
            return true;
        }
        let Some(object) = rest.get(..head.size) else { return false };
        objects.take(head, object, Place::Offset(at), batch);
        self.at += size;
        true
    }

    /// Keeps what goes on in the next container.
    fn close(&mut self, open: &Container) {
        let rest = open.bytes.get(self.at..).unwrap_or_default();
        self.at = 0;
        self.tail.clear();
        if open.is_broken {
            self.skip = 0;
            self.gap = Gap { is_told: true, ..Gap::default() };
        } else if matches!(find(rest), Found::More | Found::Object(Head { size: ..=LARGEST_OBJECT, .. })) {
            self.tail.extend_from_slice(rest);
        }
    }
}

fn too_long(head: Head, at: u64, batch: &mut Batch) {
    if is_read(head.kind) {
        let reason =
            format!("an object of kind {} and {} bytes: too long for what it is", head.kind, head.size);
        batch.push_unreadable(Place::Offset(at), reason);
    }
}

fn cut_off(at: u64, batch: &mut Batch) {
    let reason = "the capture ends inside an object".into();
    batch.notice(Notice::CutOff { place: Place::Offset(at), reason });
}

impl Parser for Blf {
    fn parse(&mut self, input: &[u8], at_end: bool, batch: &mut Batch) -> Result<usize, CaptureError> {
        let mut taken = 0;
        while !batch.is_full() {
            let rest = input.get(taken..).unwrap_or_default();
            match self.step(rest, self.offset.saturating_add(taken as u64), at_end, batch) {
                Ok(Step::Took(count)) => taken += count,
                Ok(Step::Stop) => break,
                // What was read before it is given first; it comes again then.
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
