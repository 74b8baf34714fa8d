//! Common parser of formats with one frame per line.
//!
//! ```text
//! bytes ─Lines─▶ a line ─LineFormat─▶ ParsedLine ─LineParser─▶ Frame with number, time and bus; notices
//! ```
//!
//! A format only parses lines. Frame numbers, bus names, and notices about unreadable lines and assumptions
//! are handled here.

use std::borrow::Cow;

use super::lines::{LineSplitter, LineStep, line_excerpt};
use crate::capture::{Batch, BusNames, CaptureError, CapturePlace, FormatParser, MAX_BUSES, Notice};
use crate::frame::{BusIndex, Frame, Timestamp};

/// Bus name for formats that have a single bus, or omit its name.
pub(in crate::capture) const ONLY_BUS: &[u8] = b"1";

/// A frame, without the properties that depend on its position in the capture.
#[derive(Debug, PartialEq, Eq)]
pub(in crate::capture) struct ParsedLine<'a> {
    /// Time in nanoseconds; `None` if the capture has no times.
    pub(in crate::capture) time: Option<i64>,
    /// Bus name.
    pub(in crate::capture) bus: &'a [u8],
    /// The frame, without number, time and bus.
    pub(in crate::capture) frame: Frame,
    /// Whether the line reports frames lost before this one.
    pub(in crate::capture) lost: bool,
}

impl<'a> ParsedLine<'a> {
    /// A frame without losses before it.
    pub(in crate::capture) fn new(time: Option<i64>, bus: &'a [u8], frame: Frame) -> Self {
        Self { time, bus, frame, lost: false }
    }
}

/// Reason why a line cannot be read.
#[derive(Debug, PartialEq, Eq)]
pub(in crate::capture) enum LineFault {
    /// Not a valid frame; contains the expected content. Later lines may be valid.
    Unreadable(Cow<'static, str>),
    /// No later line can be read either.
    Header {
        /// Content found.
        found: String,
        /// Content expected.
        expected: &'static str,
    },
}

impl From<&'static str> for LineFault {
    fn from(expected: &'static str) -> Self {
        Self::Unreadable(expected.into())
    }
}

/// Assumptions about the whole capture; each one is reported once.
#[derive(Debug, Clone, Default)]
pub(in crate::capture) struct CaptureAssumptions {
    stated: Vec<&'static str>,
    reported: usize,
}

impl CaptureAssumptions {
    /// Adds `text`, unless it was added before.
    pub(in crate::capture) fn add_assumption(&mut self, text: &'static str) {
        if !self.stated.contains(&text) {
            self.stated.push(text);
        }
    }

    /// Assumptions added since the last call.
    fn new_assumptions(&mut self) -> &[&'static str] {
        let fresh = self.stated.get(self.reported..).unwrap_or_default();
        self.reported = self.stated.len();
        fresh
    }
}

/// A format with one frame per line: its state between lines, and the parser of a line.
pub(in crate::capture) trait LineFormat: Clone + Send + Sync + 'static {
    /// Name for display.
    const TITLE: &'static str;

    /// Parses the non-blank line `text`: a frame, or `None` for lines such as a header line.
    fn parse_line<'a>(
        &'a mut self,
        text: &'a [u8],
        assumptions: &mut CaptureAssumptions,
    ) -> Result<Option<ParsedLine<'a>>, LineFault>;

    /// Returns a further frame of the last line, with the time and the bus of its first one.
    fn next_frame(&mut self) -> Option<Frame> {
        None
    }

    /// Receives the number of the line, from 1, before [`LineFormat::parse_line`].
    fn at_line(&mut self, _number: u64) {}

    /// Reports at the end of the capture what was skipped, once.
    fn report_skipped(&mut self, _batch: &mut Batch) {}
}

/// Parser of a [`LineFormat`].
#[derive(Clone, Default)]
pub(in crate::capture) struct LineParser<L> {
    format: L,
    lines: LineSplitter,
    buses: BusNames,
    assumptions: CaptureAssumptions,
    frames: u64,
    offset: u64,
    /// Time and bus of the last frame.
    last: (Option<Timestamp>, BusIndex),
}

impl<L: LineFormat> LineParser<L> {
    /// Creates a parser at the start of a capture.
    pub(in crate::capture) fn new(format: L) -> Self {
        Self {
            format,
            lines: LineSplitter::default(),
            buses: BusNames::default(),
            assumptions: CaptureAssumptions::default(),
            frames: 0,
            offset: 0,
            last: (None, BusIndex(0)),
        }
    }

    /// State of the format.
    pub(in crate::capture) fn format_state(&mut self) -> &mut L {
        &mut self.format
    }

    fn parse_line(&mut self, text: &[u8], batch: &mut Batch) -> Result<(), CaptureError> {
        if text.trim_ascii().is_empty() {
            return Ok(());
        }
        let place = CapturePlace::Line(self.lines.line_number());
        self.format.at_line(self.lines.line_number());
        let found = self.format.parse_line(text, &mut self.assumptions);
        for text in self.assumptions.new_assumptions() {
            batch.add_notice(Notice::Assumption((*text).to_owned()));
        }
        let seen = match found {
            Ok(None) => return Ok(()),
            Ok(Some(seen)) => seen,
            Err(LineFault::Unreadable(reason)) => {
                let reason = format!("{reason}; found {}", line_excerpt(text.trim_ascii()));
                batch.add_notice(Notice::Unreadable { place, reason });
                return Ok(());
            }
            Err(LineFault::Header { found, expected }) => {
                return Err(CaptureError::Header { format: L::TITLE, offset: self.offset, found, expected });
            }
        };
        let Some(bus) = self.buses.index_of(seen.bus) else {
            batch.add_notice(Notice::Unreadable { place, reason: format!("more than {MAX_BUSES} buses") });
            return Ok(());
        };
        if seen.lost {
            batch.add_notice(Notice::LostFrames { place, bus, count: None });
        }
        self.last = (seen.time.map(Timestamp), bus);
        let frame = seen.frame;
        self.push_frame(frame, batch);
        Ok(())
    }

    #[inline]
    fn push_frame(&mut self, frame: Frame, batch: &mut Batch) {
        self.frames += 1;
        let (time, bus) = self.last;
        batch.push(Frame { number: self.frames, time, bus, ..frame });
    }
}

impl<L: LineFormat> FormatParser for LineParser<L> {
    fn parse(&mut self, input: &[u8], at_end: bool, batch: &mut Batch) -> Result<usize, CaptureError> {
        let mut taken = 0;
        while !batch.is_full() {
            if let Some(frame) = self.format.next_frame() {
                self.push_frame(frame, batch);
                continue;
            }
            let rest = input.get(taken..).unwrap_or_default();
            let length = match self.lines.next(rest, at_end) {
                LineStep::Line(line, length) => {
                    self.parse_line(line, batch)?;
                    length
                }
                LineStep::Skip(length) => length,
                LineStep::More => break,
            };
            taken += length;
            self.offset += length as u64;
        }
        if at_end && taken == input.len() && !batch.is_full() {
            self.format.report_skipped(batch);
        }
        Ok(taken)
    }

    fn buses(&self) -> &BusNames {
        &self.buses
    }

    fn line_number(&self) -> Option<u64> {
        Some(self.lines.line_number())
    }

    fn clone_box(&self) -> Box<dyn FormatParser> {
        Box::new(self.clone())
    }
}

/// The bytes up to the last line end.
pub(in crate::capture) fn complete_lines(head: &[u8]) -> &[u8] {
    let end = head.iter().rposition(|byte| matches!(byte, b'\n' | b'\r')).map_or(0, |end| end + 1);
    head.get(..end).unwrap_or_default()
}

/// The first lines of a capture that are not blank, without byte order mark, line ends and surrounding
/// whitespace. The last one may be incomplete.
pub(in crate::capture) fn first_lines(head: &[u8], most: usize) -> impl Iterator<Item = &[u8]> {
    let head = head.strip_prefix(b"\xEF\xBB\xBF").unwrap_or(head);
    let lines = split_at(head, |text| memchr::memchr2(b'\n', b'\r', text));
    lines.take(most).map(<[u8]>::trim_ascii).filter(|line| !line.is_empty())
}

/// Pieces of a text between the bytes that `find` finds, also empty ones. The search of the library is several times as fast
/// as a test of each byte.
pub(in crate::capture) fn split_at(
    text: &[u8],
    find: impl Fn(&[u8]) -> Option<usize>,
) -> impl Iterator<Item = &[u8]> {
    let mut rest = Some(text);
    std::iter::from_fn(move || {
        let text = rest?;
        let end = find(text);
        rest = end.and_then(|end| text.get(end + 1..));
        text.get(..end.unwrap_or(text.len()))
    })
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::frame::CanId;

    #[test]
    fn pieces_between_line_ends() {
        let pieces = |text: &'static [u8]| split_at(text, |text| memchr::memchr(b'\n', text));
        for text in [&b""[..], b"\n", b"a", b"a\n", b"\n\nab\r\nc", b"a\nb"] {
            assert!(pieces(text).eq(text.split(|byte| *byte == b'\n')), "{text:?}");
        }
        assert_eq!(first_lines(b"\xEF\xBB\xBF a \r\n\r b", 4).collect::<Vec<_>>(), [&b"a"[..], b"b"]);
    }

    /// `bus id`, or a word.
    #[derive(Clone, Default)]
    struct Sample;

    impl LineFormat for Sample {
        const TITLE: &'static str = "sample";

        fn parse_line<'a>(
            &'a mut self,
            text: &'a [u8],
            assumptions: &mut CaptureAssumptions,
        ) -> Result<Option<ParsedLine<'a>>, LineFault> {
            match text {
                b"said" => {
                    assumptions.add_assumption("reported once");
                    Ok(None)
                }
                b"bad" => Err("expected better".into()),
                b"end" => Err(LineFault::Header { found: "end".into(), expected: "no end" }),
                bus => {
                    let frame = Frame::data_frame(CanId::from_standard(1), &[]);
                    Ok(Some(ParsedLine { lost: bus == b"lossy", ..ParsedLine::new(Some(5), bus, frame) }))
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
    fn an_assumption_is_reported_once_and_reading_continues_after_a_bad_line() {
        let (batch, _, _) = read("said\nsaid\nbad\ncan0\nsaid\n");
        let notices: Vec<_> = batch.notices().iter().map(|(at, notice)| (*at, notice.to_string())).collect();
        assert_eq!(
            notices,
            [(0, "reported once".to_owned()), (0, "line 3: expected better; found \"bad\"".to_owned())]
        );
        assert_eq!(batch.frames().len(), 1);
    }

    #[test]
    fn a_header_that_cannot_be_used_ends_the_reading_with_its_place() {
        let (batch, taken, _) = read("can0\nend\ncan0\n");
        assert_eq!(taken.unwrap_err().to_string(), "sample: byte 5: found end; expected no end");
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
