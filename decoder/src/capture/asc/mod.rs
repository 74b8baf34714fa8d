//! Vector's ASCII captures (ASC), as Vector's programs, python-can and converters write them.
//!
//! ```text
//! date Sam Sep 30 15:06:13.191 2017
//! base hex  timestamps absolute
//! internal events logged
//! Begin Triggerblock Sam Sep 30 15:06:13.191 2017
//!    0.000000 Start of measurement
//!   17.876708 1  6F9             Rx   d 8 05 0C 00 00 00 00 00 00  Length = 240015 BitCount = 124 ID = 1785
//!   30.005021 CANFD   1 Rx        300   1 0 8  8 11 c2 03 04 05 06 07 08   102203  133   303000 …
//! End TriggerBlock
//! ```
//!
//! No line of the header is needed, and a frame may follow at once: python-can takes the first line that
//! is none of its header's for a part of it, and loses a frame where `internal events logged` is missing.

mod error;
mod event;
mod frame;
mod header;
mod write;

use event::Content;
use header::Header;

use super::columns::Base;
use super::text::{Lines, Step, excerpt};
use super::{
    Batch, BusNames, CaptureError, Directions, ErrorFrames, Format, Holds, Notice, Parser, Place,
    WritableFormat,
};
use crate::frame::{Frame, Timestamp};

/// Lines at the start among which one must be of the header.
const DETECTING_LINES: usize = 50;

pub(super) const FORMAT: Format =
    Format { name: "asc", title: "Vector ASC", is_text: true, detect, parser: |_| Box::new(Asc::default()) };

pub(super) const WRITABLE: WritableFormat = WritableFormat {
    name: FORMAT.name,
    suffix: "asc",
    title: FORMAT.title,
    holds: Holds {
        untimed: false,
        backwards: false,
        errors: ErrorFrames::Violations,
        directions: Directions::Assumed,
        bus_names: false,
        notices: false,
        ..Holds::ALL
    },
    writer: |output, _| Box::new(write::AscWriter::new(output)),
};

/// A line of the header, whole: of one still coming in, the end may be anything.
fn detect(head: &[u8]) -> bool {
    let head = head.strip_prefix(b"\xEF\xBB\xBF").unwrap_or(head);
    let whole = memchr::memrchr(b'\n', head).and_then(|end| head.get(..end)).unwrap_or_default();
    let mut lines = whole.split(|byte| *byte == b'\n').take(DETECTING_LINES).map(<[u8]>::trim_ascii);
    lines.any(|line| matches!(header::parse(line), Ok(Header::Date(_) | Header::Base { .. })))
}

/// Reader of ASC.
#[derive(Clone, Default)]
struct Asc {
    lines: Lines,
    buses: BusNames,
    base: Base,
    clock: Clock,
    frames: u64,
    said_zone: bool,
    said_request: bool,
}

/// What times stand for.
#[derive(Clone, Default)]
struct Clock {
    relative: bool,
    elapsed: i64,
    start: Option<i64>,
    /// Date of a further header, while it is open whether times begin anew behind it.
    again: Option<i64>,
    /// Date of a block whose `Start of measurement` has not come yet.
    block: Option<i64>,
}

impl Clock {
    /// A header gives the date. Recordings behind one another in a file have one each.
    fn date(&mut self, date: i64) {
        if self.relative || self.start.is_none() {
            (self.start, self.elapsed) = (Some(date), 0);
        } else {
            self.again = Some(date);
        }
    }

    /// Counts a line with a time: differences are to the line before, whatever it was.
    fn advance(&mut self, stamp: i64) {
        if let (Some(date), Some(start)) = (self.again.take(), self.start) {
            // BUSMASTER repeats the header at each pause, but its times go on. A time that has room for
            // what lies between the two dates is one of those.
            let goes_on = stamp >= self.elapsed && stamp >= date.saturating_sub(start);
            self.start = Some(if goes_on { start } else { date });
        }
        self.elapsed = if self.relative { self.elapsed.saturating_add(stamp) } else { stamp };
    }

    /// The measurement starts here: the date of its block is the zero of the times. A block that a
    /// trigger began later has no such line; its times go on counting from the header's date.
    fn start_of_measurement(&mut self) {
        if let Some(block) = self.block.take() {
            self.start = Some(block.saturating_sub(self.elapsed));
        }
    }

    /// The time of the line counted last.
    fn now(&self) -> Timestamp {
        Timestamp(self.start.or(self.block).unwrap_or(0)).plus(self.elapsed)
    }
}

impl Asc {
    fn line(&mut self, text: &[u8], batch: &mut Batch) {
        let text = text.trim_ascii();
        if text.is_empty() {
            return;
        }
        let Some(event) = event::parse(text, self.base) else {
            self.header(text, batch);
            return;
        };
        self.clock.advance(event.stamp);
        match event.content {
            Ok(Content::Frame(channel, frame)) => self.frame(channel, &frame, batch),
            Ok(Content::Start) => self.clock.start_of_measurement(),
            Ok(Content::Request) if !std::mem::replace(&mut self.said_request, true) => {
                batch.notice(Notice::Assumption("requests to send (TxRq) are not taken for frames".into()));
            }
            Ok(Content::Request | Content::Nothing) => {}
            Err(reason) => self.unreadable(reason, text, batch),
        }
    }

    fn header(&mut self, text: &[u8], batch: &mut Batch) {
        match header::parse(text) {
            Ok(Header::Date(date)) => {
                self.clock.date(date);
                self.say_zone(batch);
            }
            Ok(Header::TriggerBlock(date)) => {
                self.clock.block = date;
                if date.is_some() {
                    self.say_zone(batch);
                }
            }
            Ok(Header::Base { base, relative }) => {
                self.base = base;
                self.clock.relative = relative;
            }
            Ok(Header::Silent) => {}
            Err(reason) => self.unreadable(reason, text, batch),
        }
    }

    fn say_zone(&mut self, batch: &mut Batch) {
        if !std::mem::replace(&mut self.said_zone, true) {
            let text = "the start date carries no time zone: times read as UTC";
            batch.notice(Notice::Assumption(text.into()));
        }
    }

    fn frame(&mut self, channel: &[u8], frame: &Frame, batch: &mut Batch) {
        let Some(bus) = self.buses.index_of(channel) else {
            let reason = format!("more than {} channels", super::MAX_BUSES);
            batch.notice(Notice::Unreadable { place: Place::Line(self.lines.number()), reason });
            return;
        };
        self.frames += 1;
        batch.push(Frame { number: self.frames, time: Some(self.clock.now()), bus, ..*frame });
    }

    fn unreadable(&self, reason: &str, text: &[u8], batch: &mut Batch) {
        let reason = format!("{reason}; found {}", excerpt(text));
        batch.notice(Notice::Unreadable { place: Place::Line(self.lines.number()), reason });
    }
}

impl Parser for Asc {
    fn parse(&mut self, input: &[u8], at_end: bool, batch: &mut Batch) -> Result<usize, CaptureError> {
        let mut taken = 0;
        while !batch.is_full() {
            let rest = input.get(taken..).unwrap_or_default();
            taken += match self.lines.next(rest, at_end) {
                Step::Line(line, length) => {
                    self.line(line, batch);
                    length
                }
                Step::Skip(length) => length,
                Step::More => break,
            };
        }
        Ok(taken)
    }

    fn buses(&self) -> &BusNames {
        &self.buses
    }

    fn line(&self) -> Option<u64> {
        Some(self.lines.number())
    }

    fn clone_box(&self) -> Box<dyn Parser> {
        Box::new(self.clone())
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn read(text: &str) -> Batch {
        let mut batch = Batch::new();
        assert_eq!(Asc::default().parse(text.as_bytes(), true, &mut batch).unwrap(), text.len());
        batch
    }

    fn times(batch: &Batch) -> Vec<String> {
        batch.frames().iter().map(|frame| frame.time.unwrap().to_string()).collect()
    }

    const DATE: &str = "date Thu Jan 1 00:01:40 1970\n";

    #[test]
    fn a_frame_may_follow_the_base_at_once() {
        let batch = read("base hex  timestamps absolute\n  348.161550 1 123  Rx d 0 \n");
        assert_eq!(times(&batch), ["348.161550000"]);
        assert!(batch.notices().is_empty());
    }

    #[test]
    fn absolute_times_count_from_the_start_of_the_measurement() {
        let batch = read(&format!("{DATE}base hex\n 0.5 1 123 Rx d 0\n 0.75 1 123 Rx d 0\n"));
        assert_eq!(times(&batch), ["100.500000000", "100.750000000"]);
        assert!(matches!(batch.notices(), [(0, Notice::Assumption(_))]), "{:?}", batch.notices());
    }

    #[test]
    fn a_block_with_the_start_of_measurement_dates_it() {
        let block = "Begin Triggerblock Thu Jan 1 00:05:00 1970\n";
        let batch = read(&format!("{DATE}{block} 0.0 Start of measurement\n 0.5 1 123 Rx d 0\n"));
        assert_eq!(times(&batch), ["300.500000000"]);
        let later = read(&format!("{DATE}{block} 200.5 1 123 Rx d 0\n"));
        assert_eq!(times(&later), ["300.500000000"]);
        let alone = read(&format!("base hex\n{block} 0.5 1 123 Rx d 0\n"));
        assert_eq!(times(&alone), ["300.500000000"]);
    }

    #[test]
    fn a_second_header_begins_anew_unless_times_go_on() {
        let second = "date Thu Jan 1 00:05:00 1970\n";
        let batch = read(&format!("{DATE} 2.5 1 1 Rx d 0\n{second} 0.5 1 1 Rx d 0\n"));
        assert_eq!(times(&batch), ["102.500000000", "300.500000000"]);
        let batch = read(&format!("{DATE} 2.5 1 1 Rx d 0\n{second} 210.5 1 1 Rx d 0\n"));
        assert_eq!(times(&batch), ["102.500000000", "310.500000000"]);
    }

    #[test]
    fn relative_times_add_up_over_every_line_with_a_time() {
        let text = "base dec  timestamps relative\n 0.1 1 291 Rx d 0\n 0.05 1 Statistic: D 0\n 0.1 what\n 0.05 2 100x Tx d 1 16\n";
        let batch = read(text);
        assert_eq!(times(&batch), ["0.100000000", "0.300000000"]);
        assert_eq!(batch.frames()[1].data(), [16]);
        let [(1, notice)] = batch.notices() else { panic!("{:?}", batch.notices()) };
        assert!(notice.to_string().starts_with("line 4: expected a channel number"), "{notice}");
    }

    #[test]
    fn channels_are_buses() {
        let mut batch = Batch::new();
        let mut reader = Asc::default();
        reader
            .parse(b" 0.1 2 1 Rx d 0\n 0.1 CANFD 1 Rx 1 0 0 0 0\n 0.1 2 1 TxRq d 0\n", true, &mut batch)
            .unwrap();
        assert_eq!(reader.buses().names(), ["2", "1"]);
        assert_eq!(batch.notices().len(), 1);
    }

    #[test]
    fn captures_are_recognised_by_their_header() {
        for head in [
            "date Sam Sep 30 15:06:13.191 2017\n",
            "\u{FEFF}base hex  timestamps absolute\r\n",
            "// generated\n\nbase dec\n",
        ] {
            assert!(detect(head.as_bytes()), "{head}");
        }
        for head in [
            "",
            "base hex",
            "date now\n",
            "(1.0) can0 123#11\n",
            ";$FILEVERSION=1.1\n",
            "// only a comment\n",
        ] {
            assert!(!detect(head.as_bytes()), "{head}");
        }
    }
}
