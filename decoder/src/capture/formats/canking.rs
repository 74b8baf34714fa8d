//! Text of Kvaser CanKing's output window.
//!
//! ```text
//! Chn Identifier Flg   DLC  D0...1...2...3...4...5...6..D7       Time     Dir
//!  0    000007E8         8  03  59  02  FF  00  00  00  00     395.000970 R
//!  0    0CFBFFDB X       8  1B  31  20  EB  B3  FF  D9  FF     100.000139 R
//!  0    00000000            ErrorFrame                          29.095270 R
//! Logging stopped.
//! ```
//!
//! Kvaser does not publish the layout; this is the layout of captures in other projects. Identifiers and data
//! are read as hexadecimal, the default of CanKing.

use crate::capture::bus_error::{Violation, violation_frame};
use crate::capture::text::columns::{ColumnWords, NumberBase, parse_identifier, parse_time};
use crate::capture::text::line_format::{
    CaptureAssumptions, LineFault, LineFormat, LineParser, ParsedLine, first_lines,
};
use crate::capture::text::lines::SkippedLines;
use crate::capture::text::payload::{IDENTIFIER, LENGTH, SHORT, build_frame, by_either};
use crate::capture::{Batch, CaptureFormat};
use crate::frame::{Frame, FrameFlags, MAX_DATA};

/// Unit of time in nanoseconds.
const SECOND: i64 = 1_000_000_000;

/// Number of lines at the start within which the heading must occur.
const DETECTING_LINES: usize = 20;

pub(super) const FORMAT: CaptureFormat = CaptureFormat {
    name: "canking",
    title: CanKing::TITLE,
    is_text: true,
    is_packed: false,
    detect: |head| first_lines(head, DETECTING_LINES).any(is_heading),
    parser: |_| Box::new(LineParser::new(CanKing::default())),
};

fn is_heading(line: &[u8]) -> bool {
    let mut words = ColumnWords::new(line);
    [&b"Chn"[..], b"Identifier", b"Flg"].iter().all(|word| words.next() == Some(word))
}

/// Lines of text around the frames.
#[derive(Clone, Default)]
struct CanKing {
    skipped: SkippedLines,
    line: u64,
}

impl LineFormat for CanKing {
    const TITLE: &'static str = "Kvaser CanKing text";

    fn parse_line<'a>(
        &'a mut self,
        text: &'a [u8],
        _: &mut CaptureAssumptions,
    ) -> Result<Option<ParsedLine<'a>>, LineFault> {
        let mut words = ColumnWords::new(text);
        let bus = words.next().unwrap_or_default();
        if !bus.first().is_some_and(u8::is_ascii_digit) {
            // `Logging started.`, `Logging stopped.`
            if !is_heading(text) && bus != b"Logging" {
                self.skipped.add_line("of text", self.line);
            }
            return Ok(None);
        }
        if !bus.iter().all(u8::is_ascii_digit) {
            return Err("channel: expected a number".into());
        }
        let (time, sent) = end_of(text).ok_or("end of line: expected seconds and R or T")?;
        let number = words.next().and_then(|word| NumberBase::Hex.parse_number(word)).ok_or(IDENTIFIER)?;
        let behind = ColumnWords::new(words.remaining_text()).count().saturating_sub(2);
        let frame = parse_content(number, words.take(behind).collect::<Vec<_>>().as_slice())?;
        let flags = frame.flags.with(if sent { FrameFlags::TRANSMITTED } else { FrameFlags::RECEIVED });
        Ok(Some(ParsedLine::new(Some(time), bus, Frame { flags, ..frame })))
    }

    fn at_line(&mut self, number: u64) {
        self.line = number;
    }

    fn report_skipped(&mut self, batch: &mut Batch) {
        self.skipped.report_lines(batch);
    }
}

/// Time, and whether the frame was transmitted, from the last two words.
fn end_of(text: &[u8]) -> Option<(i64, bool)> {
    let mut words = ColumnWords::new(text);
    let last = words.clone().count().checked_sub(2)?;
    let stamp = words.nth(last).and_then(|word| parse_time(word, SECOND))?;
    match words.next()? {
        b"R" | b"r" => Some((stamp, false)),
        b"T" | b"t" => Some((stamp, true)),
        _ => None,
    }
}

/// The frame between identifier and time: optional flags, DLC and data.
fn parse_content(number: u32, words: &[&[u8]]) -> Result<Frame, LineFault> {
    let (marks, words) = match words {
        [b"ErrorFrame", ..] | [_, b"ErrorFrame", ..] => {
            return Ok(violation_frame(Violation::Other, false, 0, None));
        }
        [marks, rest @ ..] if marks.iter().all(u8::is_ascii_alphabetic) => (*marks, rest),
        words => (&b""[..], words),
    };
    let marked = |letter: u8| marks.iter().any(|mark| mark.eq_ignore_ascii_case(&letter));
    let id = parse_identifier(number, marked(b'X') || number > 0x7FF).ok_or(IDENTIFIER)?;
    let [number, words @ ..] = words else { return Err(LENGTH.into()) };
    let number = NumberBase::Decimal.parse_byte(number).ok_or(LENGTH)?;
    let flags = match (marked(b'R'), words.len() > 8) {
        (true, _) => FrameFlags::REMOTE,
        (false, true) => FrameFlags::FD,
        (false, false) => FrameFlags(0),
    };
    let lengths = by_either(number, words.len().min(MAX_DATA + 1), flags).ok_or(LENGTH)?;
    let words = words.iter().copied();
    Ok(build_frame(id, flags, lengths, words, NumberBase::Hex).ok_or(SHORT)?)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::capture::testing::read_capture;

    const HEADING: &str = "Chn Identifier Flg   DLC  D0...1...2...3...4...5...6..D7       Time     Dir\n";

    #[test]
    fn frames_with_and_without_flags() {
        let text = format!(
            "{HEADING} 0    000007E8         8  03  59  02  FF  00  00  00  00     395.000970 R\n \
             1    00002102 X       2  60  E2                             46055.090598 T\n \
             0    00000123 R       4                                         1.000000 R\n \
             0    00000014         0                                         2.000000 R\nLogging stopped.\n"
        );
        let content = read_capture(text.as_bytes());
        assert_eq!(
            content.items,
            [
                "{1} (395.000970000) bus0 7E8#035902FF00000000 flags=40 dlc=0",
                "{2} (46055.090598000) bus1 00002102#60E2 flags=20 dlc=0",
                "{3} (1.000000000) bus0 123#R4 flags=41 dlc=0",
                "{4} (2.000000000) bus0 014# flags=40 dlc=0",
            ]
        );
        assert_eq!(content.buses, ["0", "1"]);
    }

    #[test]
    fn an_error_frame_is_an_unspecified_bus_error() {
        let text =
            format!("{HEADING}0    00000000            ErrorFrame                          29.095270 R\n");
        let [frame] = read_capture(text.as_bytes()).frames[..] else { panic!("one frame") };
        assert_eq!(frame.flags, FrameFlags::ERROR.with(FrameFlags::RECEIVED));
        assert_eq!(frame.id.number(), 0x88);
    }

    #[test]
    fn broken_lines_say_what_was_expected() {
        let text = format!(
            "{HEADING}0 123 1 00 1.0 X\n0 123 2 00 1.0 R\n0 20000000 0 1.0 R\n0 123 x1 1.0 R\n0x 1 0 1.0 R\n0 123\n"
        );
        let items = read_capture(text.as_bytes()).items;
        let expected = ["end of line", "data", "identifier", "length", "channel", "end of line"];
        assert_eq!(items.len(), expected.len(), "{items:?}");
        for (item, part) in items.iter().zip(expected) {
            assert!(item.contains(&format!(": {part}:")), "{item}");
        }
    }
}
