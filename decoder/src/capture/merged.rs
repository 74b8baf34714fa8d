//! Several captures as one: frames in the order of their times.
//!
//! ```text
//! a.log  ──1───────3──4──▶ ┐
//! b.log  ─────2───────────▶┘──▶ 1 2 3 4       by each capture's latest time, ties by order of naming
//! ```
//!
//! A capture alone passes through untouched. Of several, frames are numbered anew in common order, and each
//! capture's interfaces are buses of their own unless it is a part of one recording
//! ([`MergedCapture::group`]).

use std::io::Read;

use super::{Batch, BusNames, CaptureError, Notice, Position, Reader};
use crate::frame::{BusIndex, Frame, Timestamp};

/// A capture to be merged.
pub struct MergedCapture<R> {
    /// Its frames.
    pub reader: Reader<R>,
    /// Captures of one group share their buses: interfaces of the same name are one bus.
    pub group: usize,
    /// Nanoseconds added to its stamps.
    pub shift: i64,
}

/// Captures read as one.
pub struct Merged<R> {
    parts: Vec<Part<R>>,
    names: BusNames,
    /// Group and name of each bus, in order of its index.
    buses: Vec<(usize, String)>,
    number: u64,
    /// What broke a capture, told when it is asked for more: frames of the others stood before it.
    failure: Option<CaptureError>,
    failed: usize,
    /// Capture of each notice of the last batch.
    tellers: Vec<usize>,
}

struct Part<R> {
    reader: Reader<R>,
    lane: Lane,
    batch: Batch,
    /// Place of the reader before `batch`.
    before: Position,
    /// Frames and notices of `batch` that were taken.
    frames: usize,
    notices: usize,
}

/// What is known of a capture besides its reader.
#[derive(Clone)]
struct Lane {
    group: usize,
    shift: i64,
    /// Latest stamp so far.
    clock: Option<Timestamp>,
    /// Index here of each of its own buses.
    buses: Vec<BusIndex>,
    is_done: bool,
}

/// A place in merged captures from which reading can go on.
#[derive(Clone)]
pub struct MergedPosition {
    parts: Vec<PartPosition>,
    names: BusNames,
    buses: Vec<(usize, String)>,
    number: u64,
}

#[derive(Clone)]
struct PartPosition {
    position: Position,
    lane: Lane,
    frames: usize,
    notices: usize,
}

impl MergedPosition {
    /// The place in the one capture there is, if there is only one and its stamps are as recorded.
    pub fn alone(&self) -> Option<Position> {
        match self.parts.as_slice() {
            [part] if part.lane.shift == 0 => Some(part.position.clone()),
            _ => None,
        }
    }

    /// Byte of each decompressed capture from which it is read again.
    pub fn offsets(&self) -> impl Iterator<Item = u64> {
        self.parts.iter().map(|part| part.position.offset)
    }
}

impl<R: Read> Merged<R> {
    /// Reads captures from their beginnings.
    pub fn new(captures: Vec<MergedCapture<R>>) -> Self {
        let part = |MergedCapture { reader, group, shift }| {
            let before = reader.position();
            let lane = Lane { group, shift, clock: None, buses: Vec::new(), is_done: false };
            Part { reader, lane, batch: Batch::new(), before, frames: 0, notices: 0 }
        };
        let parts = captures.into_iter().map(part).collect();
        Self {
            parts,
            names: BusNames::default(),
            buses: Vec::new(),
            number: 0,
            failure: None,
            failed: 0,
            tellers: Vec::new(),
        }
    }

    /// Goes on at `position`; each source stands at its offset.
    ///
    /// # Errors
    /// When a source fails.
    pub fn resume(sources: Vec<R>, position: &MergedPosition) -> Result<Self, CaptureError> {
        let mut parts = Vec::new();
        for (source, part) in sources.into_iter().zip(&position.parts) {
            let reader = Reader::resume(source, &part.position);
            let mut part = Part {
                before: reader.position(),
                reader,
                lane: part.lane.clone(),
                batch: Batch::new(),
                frames: part.frames,
                notices: part.notices,
            };
            part.skip()?;
            parts.push(part);
        }
        let (names, buses) = (position.names.clone(), position.buses.clone());
        let number = position.number;
        Ok(Self { parts, names, buses, number, failure: None, failed: 0, tellers: Vec::new() })
    }

    /// The present place, behind the last batch.
    pub fn position(&self) -> MergedPosition {
        let is_alone = self.parts.len() == 1;
        let part = |part: &Part<R>| {
            let (position, frames, notices) = if is_alone {
                (part.reader.position(), 0, 0)
            } else {
                (part.before.clone(), part.frames, part.notices)
            };
            PartPosition { position, lane: part.lane.clone(), frames, notices }
        };
        MergedPosition {
            parts: self.parts.iter().map(part).collect(),
            names: self.names.clone(),
            buses: self.buses.clone(),
            number: self.number,
        }
    }

    /// Replaces the content of `batch` by the next frames and notices; `false` at the end.
    ///
    /// # Errors
    /// When a source fails, or its format allows no going on: once, after all that stood before. The others can be
    /// read on: its capture is at its end then.
    pub fn read(&mut self, batch: &mut Batch) -> Result<bool, CaptureError> {
        if let [part] = self.parts.as_mut_slice()
            && part.lane.shift == 0
        {
            return part.reader.read(batch);
        }
        batch.clear();
        self.tellers.clear();
        if let Some(error) = self.failure.take() {
            return Err(error);
        }
        while !batch.is_full() {
            if let Err(error) = self.fill() {
                if batch.is_empty() {
                    return Err(error);
                }
                self.failure = Some(error);
                return Ok(true);
            }
            // The first of equals.
            let left = self.parts.iter_mut().enumerate().filter(|(_, part)| !part.lane.is_done);
            let Some((index, part)) = left.min_by_key(|(_, part)| part.due()) else { break };
            if let Some(mut notice) = part.next_notice() {
                if let Notice::LostFrames { bus, .. } | Notice::Link { bus, .. } = &mut notice {
                    let own = part.reader.buses();
                    *bus = bus_of(&mut part.lane, own, *bus, &mut self.names, &mut self.buses);
                }
                if let Notice::Link { time, .. } | Notice::Quiet(time) = &mut notice {
                    *time = time.plus(part.lane.shift);
                }
                batch.notice(notice);
                self.tellers.push(index);
            } else if let Some(mut frame) = part.next_frame() {
                self.number += 1;
                frame.number = self.number;
                frame.bus =
                    bus_of(&mut part.lane, part.reader.buses(), frame.bus, &mut self.names, &mut self.buses);
                batch.push(frame);
            }
        }
        Ok(!batch.is_empty())
    }

    /// Reads on in captures of which nothing is left.
    fn fill(&mut self) -> Result<(), CaptureError> {
        for (index, part) in self.parts.iter_mut().enumerate() {
            if let Err(error) = part.fill() {
                self.failed = index;
                return Err(error);
            }
        }
        Ok(())
    }

    /// Which capture a notice of the last batch is of, by its place among them, from 0 in order of naming.
    pub fn teller(&self, notice: usize) -> usize {
        self.tellers.get(notice).copied().unwrap_or(0)
    }

    /// Which capture the last error is of, from 0 in order of naming.
    pub fn failed(&self) -> usize {
        self.failed
    }

    /// Buses seen so far.
    pub fn buses(&self) -> &BusNames {
        match self.parts.as_slice() {
            [part] if part.lane.shift == 0 => part.reader.buses(),
            _ => &self.names,
        }
    }

    /// Bytes of all decompressed captures read so far.
    pub fn offset(&self) -> u64 {
        self.parts.iter().map(|part| part.reader.offset()).sum()
    }
}

/// The bus here of a capture's own bus; beyond the last one possible, that one.
fn bus_of(
    lane: &mut Lane,
    own: &BusNames,
    bus: BusIndex,
    names: &mut BusNames,
    buses: &mut Vec<(usize, String)>,
) -> BusIndex {
    while lane.buses.len() <= usize::from(bus.0) {
        let name = own.names().get(lane.buses.len()).cloned().unwrap_or_default();
        let key = (lane.group, name);
        let index = buses.iter().position(|known| *known == key).unwrap_or_else(|| {
            buses.push(key.clone());
            buses.len() - 1
        });
        let twins = buses.iter().take(index).filter(|(_, name)| *name == key.1).count();
        let name = if twins == 0 { key.1 } else { format!("{}@{}", key.1, twins + 1) };
        lane.buses.push(names.index_of(name.as_bytes()).unwrap_or(BusIndex(u8::MAX)));
    }
    lane.buses.get(usize::from(bus.0)).copied().unwrap_or_default()
}

impl<R: Read> Part<R> {
    /// Reads on if nothing is left.
    fn fill(&mut self) -> Result<(), CaptureError> {
        while !self.lane.is_done && self.is_used_up() {
            (self.frames, self.notices) = (0, 0);
            self.before = self.reader.position();
            match self.reader.read(&mut self.batch) {
                Ok(more) => self.lane.is_done = !more,
                Err(error) => {
                    self.lane.is_done = true;
                    return Err(error);
                }
            }
        }
        Ok(())
    }

    fn is_used_up(&self) -> bool {
        self.frames >= self.batch.frames().len() && self.notices >= self.batch.notices().len()
    }

    /// Takes again what was taken of the batch behind the place.
    fn skip(&mut self) -> Result<(), CaptureError> {
        let (frames, notices) = (self.frames, self.notices);
        (self.frames, self.notices) = (0, 0);
        let (mut frames, mut notices) = (frames, notices);
        while frames > 0 || notices > 0 {
            // A batch may be shorter than it was: the buffer ends elsewhere.
            self.before = self.reader.position();
            if !self.reader.read(&mut self.batch)? {
                break;
            }
            self.frames = frames.min(self.batch.frames().len());
            self.notices = notices.min(self.batch.notices().len());
            frames -= self.frames;
            notices -= self.notices;
        }
        Ok(())
    }

    /// When its next frame is due: never before one of its earlier ones.
    fn due(&self) -> Option<Timestamp> {
        let next = self.batch.frames().get(self.frames).and_then(|frame| frame.time);
        next.map(|time| time.plus(self.lane.shift)).max(self.lane.clock)
    }

    fn next_notice(&mut self) -> Option<Notice> {
        let (before, notice) = self.batch.notices().get(self.notices)?;
        if *before > self.frames {
            return None;
        }
        self.notices += 1;
        Some(notice.clone())
    }

    fn next_frame(&mut self) -> Option<Frame> {
        let mut frame = *self.batch.frames().get(self.frames)?;
        self.frames += 1;
        frame.time = frame.time.map(|time| time.plus(self.lane.shift));
        self.lane.clock = self.lane.clock.max(frame.time);
        Some(frame)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::capture::ReadOptions;

    const A: &[u8] =
        b"(1700000010.000000) can0 101#01\n(1700000010.300000) can0 103#01\n(1700000010.400000) can1 104#01\n";
    const B: &[u8] =
        b"(1700000010.200000) can0 102#01\nrubbish\n(1700000010.100000) can0 105#01\n(1700000010.300000) can0 106#01\n";

    fn part(text: &'static [u8], group: usize, shift: i64) -> MergedCapture<&'static [u8]> {
        MergedCapture { reader: Reader::open(text, &ReadOptions::default()).unwrap(), group, shift }
    }

    fn all(merged: &mut Merged<&[u8]>) -> Vec<String> {
        let mut batch = Batch::new();
        let mut found = Vec::new();
        while merged.read(&mut batch).unwrap() {
            let names = merged.buses().names();
            found.extend(
                batch.frames().iter().map(|frame| {
                    format!("{} {} {}", frame.number, names[usize::from(frame.bus.0)], frame.id)
                }),
            );
        }
        found
    }

    #[test]
    fn frames_come_by_time_and_never_before_an_earlier_one_of_their_capture() {
        let mut merged = Merged::new(vec![part(A, 0, 0), part(B, 1, 0)]);
        // 105 is stamped before 102, behind which it stands; at 10.3 the first capture goes first.
        let expected =
            ["1 can0 101", "2 can0@2 102", "3 can0@2 105", "4 can0 103", "5 can0@2 106", "6 can1 104"];
        assert_eq!(all(&mut merged), expected);
    }

    #[test]
    fn a_capture_that_breaks_costs_nothing_of_the_others() {
        use std::io::{Error, Read};
        const REST: &[u8] = b"(1700000010.250000) can0 107#01\n(1700000010.500000) can0 108#01\n";
        struct Source(&'static [u8], bool);
        impl Read for Source {
            fn read(&mut self, room: &mut [u8]) -> std::io::Result<usize> {
                match self.0.read(room)? {
                    0 if self.1 => Err(Error::other("broken")),
                    count => Ok(count),
                }
            }
        }
        let part = |text, is_broken| MergedCapture {
            reader: Reader::open(Source(text, is_broken), &ReadOptions::default()).unwrap(),
            group: 0,
            shift: 0,
        };
        let mut merged = Merged::new(vec![part(A, false), part(B, true), part(REST, false)]);
        let (mut batch, mut found) = (Batch::new(), Vec::new());
        loop {
            match merged.read(&mut batch) {
                Ok(true) => found.extend(batch.frames().iter().map(|frame| frame.id.to_string())),
                Ok(false) => break,
                Err(error) => found.push(format!("{} {error}", merged.failed())),
            }
        }
        let expected = ["101", "102", "105", "107", "103", "106", "1 reading failed: broken", "104", "108"];
        assert_eq!(found, expected);
    }

    #[test]
    fn parts_of_one_recording_share_their_buses() {
        let mut merged = Merged::new(vec![part(A, 0, 0), part(B, 0, 1_000_000_000)]);
        let found = all(&mut merged);
        assert_eq!(found.last().map(String::as_str), Some("6 can0 106"));
        assert_eq!(merged.buses().names(), ["can0", "can1"]);
    }

    #[test]
    fn reading_goes_on_from_any_place() {
        // A line a second, and one every other second half a second later.
        let lines = |seconds: i64, step: usize, rest: &str| {
            let stamps = (0..seconds).step_by(step);
            let text: Vec<_> = stamps.map(|n| format!("(17{n:08}.{rest}#{n:04X}\n")).collect();
            &*text.concat().leak()
        };
        let (long, other) = (lines(2_000, 1, "000000) can0 101"), lines(1_800, 2, "500000) can0 102"));
        let open = || Merged::new(vec![part(long.as_bytes(), 0, 0), part(other.as_bytes(), 1, 0)]);
        let whole = all(&mut open());
        let mut merged = open();
        let mut batch = Batch::new();
        let mut taken = 0;
        while merged.read(&mut batch).unwrap() {
            taken += batch.frames().len();
            let position = merged.position();
            let sources: Vec<&[u8]> = [long.as_bytes(), other.as_bytes()]
                .into_iter()
                .zip(position.offsets())
                .map(|(text, offset)| &text[usize::try_from(offset).unwrap()..])
                .collect();
            let mut rest = Merged::resume(sources, &position).unwrap();
            assert_eq!(all(&mut rest), whole[taken..]);
        }
    }
}
