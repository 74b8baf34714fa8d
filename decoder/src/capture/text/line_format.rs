//! Captures of a frame a line: what all of them have in common.
//!
//! ```text
//! bytes ─Lines─▶ a line ─LineFormat─▶ Seen ─LineParser─▶ Frame with number, time and bus; notices
//! ```
//!
//! A format says what a line means; numbering frames, naming buses, and saying what could not be read
//! and what is assumed is done here once.

use std::borrow::Cow;

use super::lines::{Lines, Step, excerpt};
use crate::capture::{Batch, BusNames, CaptureError, MAX_BUSES, Notice, Parser, Place};
use crate::frame::{Frame, Timestamp};

/// Name of the bus where a format has but one, or leaves its name out.
pub(in crate::capture) const ONLY_BUS: &[u8] = b"1";

/// A frame with what its place in the capture decides left open.
#[derive(Debug, PartialEq, Eq)]
pub(in crate::capture) struct Seen<'a> {
    /// When, in nanoseconds; none where the capture has no times.
    pub(in crate::capture) time: Option<i64>,
    /// Name of the bus.
    pub(in crate::capture) bus: &'a [u8],
    /// The frame without number, time and bus.
    pub(in crate::capture) frame: Frame,
    /// The line says that frames were lost before this one.
    pub(in crate::capture) lost: bool,
}

impl<'a> Seen<'a> {
    /// A frame before which none were lost.
    pub(in crate::capture) fn new(time: Option<i64>, bus: &'a [u8], frame: Frame) -> Self {
        Self { time, bus, frame, lost: false }
    }
}

/// Why a line says nothing.
#[derive(Debug, PartialEq, Eq)]
pub(in crate::capture) enum Fault {
    /// It should be a frame; the text says what was expected. The next line may be better.
    Unreadable(Cow<'static, str>),
    /// No later line can be understood either.
    Header {
        /// What stands there.
        found: String,
        /// What should stand there.
        expected: &'static str,
    },
}

impl From<&'static str> for Fault {
    fn from(expected: &'static str) -> Self {
        Self::Unreadable(expected.into())
    }
}

/// What was assumed of the whole capture: each assumption is said once.
#[derive(Debug, Clone, Default)]
pub(in crate::capture) struct Assumptions {
    said: Vec<&'static str>,
    told: usize,
}

impl Assumptions {
    /// Says `text`, unless it was said before.
    pub(in crate::capture) fn say(&mut self, text: &'static str) {
        if !self.said.contains(&text) {
            self.said.push(text);
        }
    }

    /// Those not handed out yet.
    fn fresh(&mut self) -> &[&'static str] {
        let fresh = self.said.get(self.told..).unwrap_or_default();
        self.told = self.said.len();
        fresh
    }
}

/// A format of a frame a line: what it keeps from line to line, and what a line means by it.
pub(in crate::capture) trait LineFormat: Clone + Send + Sync + 'static {
    /// What people call it.
    const TITLE: &'static str;

    /// What `text`, a line that is not blank, says: a frame, or nothing as a line of the header does.
    fn line<'a>(
        &'a mut self,
        text: &'a [u8],
        assumptions: &mut Assumptions,
    ) -> Result<Option<Seen<'a>>, Fault>;
}

/// Reader of such a format.
#[derive(Clone, Default)]
pub(in crate::capture) struct LineParser<L> {
    format: L,
    lines: Lines,
    buses: BusNames,
    assumptions: Assumptions,
    frames: u64,
    offset: u64,
}

impl<L: LineFormat> LineParser<L> {
    /// A reader at the start of a capture.
    pub(in crate::capture) fn new(format: L) -> Self {
        Self {
            format,
            lines: Lines::default(),
            buses: BusNames::default(),
            assumptions: Assumptions::default(),
            frames: 0,
            offset: 0,
        }
    }

    fn line(&mut self, text: &[u8], batch: &mut Batch) -> Result<(), CaptureError> {
        if text.trim_ascii().is_empty() {
            return Ok(());
        }
        let place = Place::Line(self.lines.number());
        let found = self.format.line(text, &mut self.assumptions);
        for text in self.assumptions.fresh() {
            batch.notice(Notice::Assumption((*text).to_owned()));
        }
        let seen = match found {
            Ok(None) => return Ok(()),
            Ok(Some(seen)) => seen,
            Err(Fault::Unreadable(reason)) => {
                let reason = format!("{reason}; found {}", excerpt(text.trim_ascii()));
                batch.notice(Notice::Unreadable { place, reason });
                return Ok(());
            }
            Err(Fault::Header { found, expected }) => {
                return Err(CaptureError::Header { format: L::TITLE, offset: self.offset, found, expected });
            }
        };
        let Some(bus) = self.buses.index_of(seen.bus) else {
            batch.notice(Notice::Unreadable { place, reason: format!("more than {MAX_BUSES} buses") });
            return Ok(());
        };
        if seen.lost {
            batch.notice(Notice::LostFrames { place, bus, count: None });
        }
        self.frames += 1;
        batch.push(Frame { number: self.frames, time: seen.time.map(Timestamp), bus, ..seen.frame });
        Ok(())
    }
}

impl<L: LineFormat> Parser for LineParser<L> {
    fn parse(&mut self, input: &[u8], at_end: bool, batch: &mut Batch) -> Result<usize, CaptureError> {
        let mut taken = 0;
        while !batch.is_full() {
            let rest = input.get(taken..).unwrap_or_default();
            let length = match self.lines.next(rest, at_end) {
                Step::Line(line, length) => {
                    self.line(line, batch)?;
                    length
                }
                Step::Skip(length) => length,
                Step::More => break,
            };
            taken += length;
            self.offset += length as u64;
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

/// The first lines of a capture, without byte order mark, line ends and blanks around them; of a line
/// still coming in the end may be anything, and blank lines are left out.
pub(in crate::capture) fn first_lines(head: &[u8], most: usize) -> impl Iterator<Item = &[u8]> {
    let head = head.strip_prefix(b"\xEF\xBB\xBF").unwrap_or(head);
    let lines = head.split(|byte| matches!(byte, b'\n' | b'\r')).take(most);
    lines.map(<[u8]>::trim_ascii).filter(|line| !line.is_empty())
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::frame::CanId;

    /// `bus id`, or a word.
    #[derive(Clone, Default)]
    struct Sample;

    impl LineFormat for Sample {
        const TITLE: &'static str = "sample";

        fn line<'a>(
            &'a mut self,
            text: &'a [u8],
            assumptions: &mut Assumptions,
        ) -> Result<Option<Seen<'a>>, Fault> {
            match text {
                b"said" => {
                    assumptions.say("said once");
                    Ok(None)
                }
                b"bad" => Err("expected better".into()),
                b"end" => Err(Fault::Header { found: "end".into(), expected: "no end" }),
                bus => {
                    let frame = Frame::data_frame(CanId::standard(1), &[]);
                    Ok(Some(Seen { lost: bus == b"lossy", ..Seen::new(Some(5), bus, frame) }))
                }
            }
        }
    }

    fn read(text: &str) -> (Batch, Result<usize, CaptureError>, Vec<String>) {
        let (mut parser, mut batch) = (LineParser::new(Sample), Batch::new());
        let taken = parser.parse(text.as_bytes(), true, &mut batch);
        let buses = parser.buses().names().to_vec();
        (batch, taken, buses)
    }

    #[test]
    fn frames_are_numbered_and_buses_named_as_they_come() {
        let (batch, taken, buses) = read("can1\n\n   \ncan0\r\nlossy\n");
        assert_eq!(taken.unwrap(), 22);
        assert_eq!(buses, ["can1", "can0", "lossy"]);
        let found: Vec<_> = batch.frames().iter().map(|frame| (frame.number, frame.bus.0)).collect();
        assert_eq!(found, [(1, 0), (2, 1), (3, 2)]);
        let [(2, notice)] = batch.notices() else { panic!("{:?}", batch.notices()) };
        assert_eq!(notice.to_string(), "line 5: frames lost");
    }

    #[test]
    fn an_assumption_is_said_once_and_reading_goes_on_behind_a_bad_line() {
        let (batch, _, _) = read("said\nsaid\nbad\ncan0\nsaid\n");
        let notices: Vec<_> = batch.notices().iter().map(|(at, notice)| (*at, notice.to_string())).collect();
        assert_eq!(
            notices,
            [(0, "said once".to_owned()), (0, "line 3: expected better; found \"bad\"".to_owned())]
        );
        assert_eq!(batch.frames().len(), 1);
    }

    #[test]
    fn a_header_that_cannot_be_used_ends_the_reading_with_its_place() {
        let (batch, taken, _) = read("can0\nend\ncan0\n");
        assert_eq!(taken.unwrap_err().to_string(), "sample: byte 5: found end, expected no end");
        assert_eq!(batch.frames().len(), 1);
    }

    #[test]
    fn buses_beyond_the_last_are_unreadable() {
        let text: Vec<_> = (0..=MAX_BUSES).map(|bus| format!("can{bus}\n")).collect();
        let (batch, _, _) = read(&text.concat());
        assert_eq!(batch.frames().len(), MAX_BUSES);
        assert_eq!(batch.notices()[0].1.to_string(), "line 65: more than 64 buses");
    }
}
