//! Merges several captures: frames in the order of their timestamps.
//!
//! ```text
//! a.log  ──1───────3──4──▶ ┐
//! b.log  ─────2───────────▶┘──▶ 1 2 3 4       by each capture's latest time, ties by command-line order
//! ```
//!
//! A single capture passes through unchanged. Frames of several captures are renumbered in common order, and
//! each capture's interfaces are separate buses unless the captures are parts of one group
//! ([`MergedCapture::group`]). A capture that continues the one before it starts after its last frame,
//! whatever the timestamps ([`MergedCapture::continues`]).

use std::io::Read;

use super::{Batch, BusNames, CaptureError, CaptureReader, Notice, ReaderPosition};
use crate::frame::{BusIndex, Frame, Timestamp};

/// A capture to be merged.
pub struct MergedCapture<R> {
    /// Reader of the capture.
    pub reader: CaptureReader<R>,
    /// Group of the capture: within a group, interfaces of the same name are one bus.
    pub group: usize,
    /// Nanoseconds added to each timestamp.
    pub shift: i64,
    /// The capture before this one is the previous part of the same capture.
    pub continues: bool,
}

/// Several captures read as one.
pub struct MergedReader<R> {
    parts: Vec<MergedPart<R>>,
    names: BusNames,
    /// Group and name of each bus, in order of bus index.
    buses: Vec<(usize, String)>,
    number: u64,
    /// Pending error of a capture, returned by the next `read`, after the frames that precede it.
    failure: Option<CaptureError>,
    failed: usize,
    /// Index of the capture of each notice of the last batch.
    tellers: Vec<usize>,
}

struct MergedPart<R> {
    reader: CaptureReader<R>,
    lane: MergeLane,
    batch: Batch,
    /// Position of the reader before `batch`.
    before: ReaderPosition,
    /// Frames and notices of `batch` already used.
    frames: usize,
    notices: usize,
}

/// State of a capture in addition to its reader.
#[derive(Clone)]
struct MergeLane {
    group: usize,
    shift: i64,
    continues: bool,
    /// Latest timestamp so far.
    clock: Option<Timestamp>,
    /// Merged bus index of each bus of the capture.
    buses: Vec<BusIndex>,
    is_done: bool,
}

/// A position in merged captures from which reading can resume.
#[derive(Clone)]
pub struct MergedPosition {
    parts: Vec<CapturePosition>,
    names: BusNames,
    buses: Vec<(usize, String)>,
    number: u64,
}

#[derive(Clone)]
struct CapturePosition {
    position: ReaderPosition,
    lane: MergeLane,
    frames: usize,
    notices: usize,
}

impl MergedPosition {
    /// Position in the only capture; `None` for several captures or a capture with shifted timestamps.
    pub fn only_position(&self) -> Option<ReaderPosition> {
        match self.parts.as_slice() {
            [part] if part.lane.shift == 0 => Some(part.position.clone()),
            _ => None,
        }
    }

    /// Byte offset in each decompressed capture at which reading resumes.
    pub fn offsets(&self) -> impl Iterator<Item = u64> {
        self.parts.iter().map(|part| part.position.offset)
    }
}

impl<R: Read> MergedReader<R> {
    /// Reads captures from the start.
    pub fn new(captures: Vec<MergedCapture<R>>) -> Self {
        let part = |MergedCapture { reader, group, shift, continues }| {
            let before = reader.position();
            let lane = MergeLane { group, shift, continues, clock: None, buses: Vec::new(), is_done: false };
            MergedPart { reader, lane, batch: Batch::new(), before, frames: 0, notices: 0 }
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

    /// Resumes at `position`; each source must be at its offset.
    ///
    /// # Errors
    /// If a source cannot be read.
    pub fn resume(sources: Vec<R>, position: &MergedPosition) -> Result<Self, CaptureError> {
        let mut parts = Vec::new();
        for (source, part) in sources.into_iter().zip(&position.parts) {
            let reader = CaptureReader::resume(source, &part.position);
            let mut part = MergedPart {
                before: reader.position(),
                reader,
                lane: part.lane.clone(),
                batch: Batch::new(),
                frames: part.frames,
                notices: part.notices,
            };
            part.skip_used()?;
            parts.push(part);
        }
        let (names, buses) = (position.names.clone(), position.buses.clone());
        let number = position.number;
        Ok(Self { parts, names, buses, number, failure: None, failed: 0, tellers: Vec::new() })
    }

    /// The current position, after the last batch.
    pub fn position(&self) -> MergedPosition {
        let is_alone = self.parts.len() == 1;
        let part = |part: &MergedPart<R>| {
            let (position, frames, notices) = if is_alone {
                (part.reader.position(), 0, 0)
            } else {
                (part.before.clone(), part.frames, part.notices)
            };
            CapturePosition { position, lane: part.lane.clone(), frames, notices }
        };
        MergedPosition {
            parts: self.parts.iter().map(part).collect(),
            names: self.names.clone(),
            buses: self.buses.clone(),
            number: self.number,
        }
    }

    /// Replaces the content of `batch` with the next frames and notices; `false` at the end.
    ///
    /// # Errors
    /// If a source or its content cannot be read further: returned once per capture, after the frames before
    /// the error. The failed capture is then at its end; reading of the others can continue.
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
            if let Err(error) = self.fill_batches() {
                if batch.is_empty() {
                    return Err(error);
                }
                self.failure = Some(error);
                return Ok(true);
            }
            let Some(index) = self.next_part() else { break };
            let Some(part) = self.parts.get_mut(index) else { break };
            if let Some(mut notice) = part.next_notice() {
                if let Notice::LostFrames { bus, .. }
                | Notice::Link { bus, .. }
                | Notice::ClockSet { bus, .. } = &mut notice
                {
                    let own = part.reader.buses();
                    *bus = bus_of(&mut part.lane, own, *bus, &mut self.names, &mut self.buses);
                }
                if let Notice::Link { time, .. } | Notice::Quiet(time) | Notice::ClockSet { time, .. } =
                    &mut notice
                {
                    *time = time.plus(part.lane.shift);
                }
                batch.add_notice(notice);
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

    /// Index of the capture with the next frame; among simultaneous frames the first capture.
    fn next_part(&self) -> Option<usize> {
        let mut next: Option<(Option<Timestamp>, usize)> = None;
        let mut is_before_done = true;
        for (index, part) in self.parts.iter().enumerate() {
            let may_start = !part.lane.continues || is_before_done;
            if !part.lane.is_done && may_start && next.is_none_or(|(due, _)| part.due_time() < due) {
                next = Some((part.due_time(), index));
            }
            is_before_done = part.lane.is_done;
        }
        next.map(|(_, index)| index)
    }

    /// Refills the batch of each capture that is used up.
    fn fill_batches(&mut self) -> Result<(), CaptureError> {
        for (index, part) in self.parts.iter_mut().enumerate() {
            if let Err(error) = part.fill_batch() {
                self.failed = index;
                return Err(error);
            }
        }
        Ok(())
    }

    /// Index of the capture of a notice of the last batch, from 0 in command-line order. `notice` is the
    /// index of the notice.
    pub fn notice_capture(&self, notice: usize) -> usize {
        self.tellers.get(notice).copied().unwrap_or(0)
    }

    /// Index of the capture of the last error, from 0 in command-line order.
    pub fn failed_capture(&self) -> usize {
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

/// The merged bus for a bus of a capture; if too many buses exist, the last one.
fn bus_of(
    lane: &mut MergeLane,
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

impl<R: Read> MergedPart<R> {
    /// Reads the next batch if the current one is used up.
    fn fill_batch(&mut self) -> Result<(), CaptureError> {
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

    /// Skips the frames and notices that were used before the position was stored.
    fn skip_used(&mut self) -> Result<(), CaptureError> {
        let (frames, notices) = (self.frames, self.notices);
        (self.frames, self.notices) = (0, 0);
        let (mut frames, mut notices) = (frames, notices);
        while frames > 0 || notices > 0 {
            // A batch may be shorter than before because the buffer ends elsewhere.
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

    /// Time at which the next frame is due; not before an earlier frame of the capture.
    fn due_time(&self) -> Option<Timestamp> {
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
        let reader = CaptureReader::open(text, &ReadOptions::default()).unwrap();
        MergedCapture { reader, group, shift, continues: false }
    }

    fn all(merged: &mut MergedReader<&[u8]>) -> Vec<String> {
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
        let mut merged = MergedReader::new(vec![part(A, 0, 0), part(B, 1, 0)]);
        // 105 has an earlier timestamp than 102 but follows it; at 10.3 the first capture takes precedence.
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
            reader: CaptureReader::open(Source(text, is_broken), &ReadOptions::default()).unwrap(),
            group: 0,
            shift: 0,
            continues: false,
        };
        let mut merged = MergedReader::new(vec![part(A, false), part(B, true), part(REST, false)]);
        let (mut batch, mut found) = (Batch::new(), Vec::new());
        loop {
            match merged.read(&mut batch) {
                Ok(true) => found.extend(batch.frames().iter().map(|frame| frame.id.to_string())),
                Ok(false) => break,
                Err(error) => found.push(format!("{} {error}", merged.failed_capture())),
            }
        }
        let expected = ["101", "102", "105", "107", "103", "106", "1 reading failed: broken", "104", "108"];
        assert_eq!(found, expected);
    }

    #[test]
    fn parts_of_one_recording_share_their_buses() {
        let mut merged = MergedReader::new(vec![part(A, 0, 0), part(B, 0, 1_000_000_000)]);
        let found = all(&mut merged);
        assert_eq!(found.last().map(String::as_str), Some("6 can0 106"));
        assert_eq!(merged.buses().names(), ["can0", "can1"]);
    }

    #[test]
    fn a_part_starts_after_the_part_before_it_whatever_its_times() {
        // The clock of B steps back to 10.1 s; A ends at 10.4 s. By time alone, 102 would precede 103.
        let next = MergedCapture { continues: true, ..part(B, 0, 0) };
        let mut merged = MergedReader::new(vec![part(A, 0, 0), next]);
        let expected = ["1 can0 101", "2 can0 103", "3 can1 104", "4 can0 102", "5 can0 105", "6 can0 106"];
        assert_eq!(all(&mut merged), expected);
    }

    #[test]
    fn reading_resumes_from_any_position() {
        // One line per second; one line every other second, offset by half a second.
        let lines = |seconds: i64, step: usize, rest: &str| {
            let stamps = (0..seconds).step_by(step);
            let text: Vec<_> = stamps.map(|n| format!("(17{n:08}.{rest}#{n:04X}\n")).collect();
            &*text.concat().leak()
        };
        let (long, other) = (lines(2_000, 1, "000000) can0 101"), lines(1_800, 2, "500000) can0 102"));
        let open = || MergedReader::new(vec![part(long.as_bytes(), 0, 0), part(other.as_bytes(), 1, 0)]);
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
            let mut rest = MergedReader::resume(sources, &position).unwrap();
            assert_eq!(all(&mut rest), whole[taken..]);
        }
    }
}
