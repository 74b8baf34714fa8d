//! slcan text: what an adapter with the protocol of Lawicel sends, as a terminal or a logger stored it.
//!
//! ```text
//! t1E380000000000000142          base identifier, DLC, data
//! T18FEF1008FFFFFFFFFFFFFFFF     extended identifier
//! t58184B41600037020000EA5F      the same with a timestamp in milliseconds
//! 13:22:10.885 t1F512A0F         time of the logger
//! S6 O F00 z                     commands and responses, skipped
//! ```
//!
//! Sources: Lawicel, CAN232 manual version 3; `drivers/net/can/slcan` of Linux; lawicel_serial.cpp of SavvyCAN. The
//! timestamp restarts each minute (CAN232 manual, command Z), in some firmware after 65,536 ms.

use crate::capture::adapter::slcan::{frame_of_line, report_of_line};
use crate::capture::text::columns::ColumnWords;
use crate::capture::text::day::TimesOfDay;
use crate::capture::text::evidence::{LineClass, is_proven};
use crate::capture::text::line_format::{
    CaptureAssumptions, LineFault, LineFormat, LineParser, ONLY_BUS, ParsedLine,
};
use crate::capture::text::lines::SkippedLines;
use crate::capture::text::stamp::WrittenTime;
use crate::capture::{Batch, CaptureFormat};
use crate::frame::Frame;

/// Unit of the adapter's timestamps in nanoseconds.
const MILLISECOND: i64 = 1_000_000;

/// Milliseconds after which the timestamps restart, and in firmware that counts 16 bits.
const PERIODS: [i64; 2] = [60_000, 65_536];

const ADAPTER_TIMES: &str =
    "times of the adapter in milliseconds, which restart each minute: later minutes counted";

const LONGER: &str = "digits after the data that are not milliseconds ignored";

pub(super) const FORMAT: CaptureFormat = CaptureFormat {
    name: "lawicel",
    title: Lawicel::TITLE,
    is_text: true,
    is_packed: false,
    detect: detect_lawicel,
    parser: |_| Box::new(LineParser::new(Lawicel::default())),
};

/// A frame with data proves the format; a shorter one could be a word.
fn detect_lawicel(head: &[u8]) -> bool {
    is_proven(head, |line| match SlcanLine::parse(line).map(|line| line.content) {
        Some(SlcanContent::Frame(frame, _) | SlcanContent::Longer(frame)) if frame.length > 0 => {
            LineClass::Proof
        }
        Some(_) => LineClass::Related,
        None => LineClass::Misfit,
    })
}

/// A line with an optional time of the logger.
struct SlcanLine {
    time: Option<WrittenTime>,
    content: SlcanContent,
}

enum SlcanContent {
    /// A frame, and the milliseconds of the adapter.
    Frame(Frame, Option<u16>),
    /// A frame before digits that are not milliseconds.
    Longer(Frame),
    /// The error frame of a state or of bus errors.
    Report(Frame),
    /// A command, or its response.
    Command,
    /// A line with the letter of a frame, and the content expected.
    Broken(&'static str),
}

impl SlcanLine {
    /// `None` if the line is not of the protocol.
    fn parse(line: &[u8]) -> Option<Self> {
        let mut words = ColumnWords::new(line);
        let first = words.next()?;
        let (time, word) = match words.next() {
            Some(word) => (Some(WrittenTime::parse(first)?), word),
            None => (None, first),
        };
        if words.next().is_some() {
            return None;
        }
        // BEL refuses the command before it, without a line end.
        let bells = word.iter().take_while(|byte| **byte == BEL).count();
        let content = SlcanContent::parse(word.get(bells..)?)?;
        Some(Self { time, content })
    }
}

/// Response that refuses a command.
const BEL: u8 = 0x07;

impl SlcanContent {
    fn parse(word: &[u8]) -> Option<Self> {
        if word.is_empty() || is_command(word) {
            return Some(Self::Command);
        }
        if let Some(frame) = report_of_line(word) {
            return Some(Self::Report(frame));
        }
        // A response to a transmission may precede a frame: `zt1230`.
        let word = word.strip_prefix(b"z").or(word.strip_prefix(b"Z")).unwrap_or(word);
        Some(match frame_of_line(word)? {
            Ok((frame, milliseconds)) => Self::Frame(frame, milliseconds),
            Err(expected) => frame_before_digits(word).map_or(Self::Broken(expected), Self::Longer),
        })
    }
}

/// Most digits after the data that are ignored: some loggers append a number of their own.
const MOST_DIGITS: usize = 8;

/// A frame before hex digits that are neither its data nor milliseconds.
fn frame_before_digits(word: &[u8]) -> Option<Frame> {
    (1..=MOST_DIGITS).find_map(|count| {
        let (start, digits) = word.split_at_checked(word.len().checked_sub(count)?)?;
        let frame = frame_of_line(start)?.ok()?;
        digits.iter().all(u8::is_ascii_hexdigit).then_some(frame.0)
    })
}

/// Commands without a frame and their responses: letter, and numbers of digits after it.
const COMMANDS: &[(u8, &[usize])] = &[
    (b'O', &[0]),
    (b'L', &[0]),
    (b'l', &[0]),
    (b'C', &[0]),
    (b'A', &[0]),
    (b'P', &[0]),
    (b'z', &[0]),
    (b'Z', &[0, 1]),
    (b'S', &[1]),
    (b's', &[4]),
    (b'F', &[0, 2]),
    (b'V', &[0, 4]),
    (b'N', &[0, 4]),
    (b'X', &[1]),
    (b'Y', &[1]),
    (b'M', &[8]),
    (b'm', &[8]),
];

fn is_command(word: &[u8]) -> bool {
    let Some((letter, digits)) = word.split_first() else { return false };
    let known = COMMANDS.iter().find(|(known, _)| known == letter);
    known.is_some_and(|(_, counts)| counts.contains(&digits.len()))
        && digits.iter().all(u8::is_ascii_alphanumeric)
}

/// State that affects later lines.
#[derive(Clone, Default)]
struct Lawicel {
    clock: AdapterClock,
    days: TimesOfDay,
    skipped: SkippedLines,
    line: u64,
}

/// Milliseconds that restart.
#[derive(Clone, Default)]
struct AdapterClock {
    /// Start of the current period, in milliseconds.
    start: i64,
    last: i64,
    has_long_period: bool,
}

impl AdapterClock {
    /// Milliseconds since the start of the first period. A step back of more than half a period starts the next one.
    fn elapsed(&mut self, milliseconds: u16) -> i64 {
        let now = i64::from(milliseconds);
        let [short, long] = PERIODS;
        self.has_long_period |= now >= short;
        let period = if self.has_long_period { long } else { short };
        if now + period / 2 < self.last {
            self.start = self.start.saturating_add(period);
        }
        self.last = now;
        self.start.saturating_add(now)
    }
}

impl LineFormat for Lawicel {
    const TITLE: &'static str = "slcan text (Lawicel)";

    fn parse_line<'a>(
        &'a mut self,
        text: &'a [u8],
        assumptions: &mut CaptureAssumptions,
    ) -> Result<Option<ParsedLine<'a>>, LineFault> {
        let line = SlcanLine::parse(text).ok_or("expected a frame (t, T, r, R, d, D, b, B) or a command")?;
        let (frame, milliseconds) = match line.content {
            SlcanContent::Frame(frame, milliseconds) => (frame, milliseconds),
            SlcanContent::Report(frame) => (frame, None),
            SlcanContent::Longer(frame) => {
                assumptions.add_assumption(LONGER);
                (frame, None)
            }
            SlcanContent::Broken(expected) => return Err(expected.into()),
            SlcanContent::Command => {
                self.skipped.add_line("with commands or responses of the adapter", self.line);
                return Ok(None);
            }
        };
        let adapter = milliseconds.map(|stamp| self.clock.elapsed(stamp).saturating_mul(MILLISECOND));
        let written = line.time.map(|time| time.elapsed(&mut self.days));
        if written.is_none() && adapter.is_some() {
            assumptions.add_assumption(ADAPTER_TIMES);
        }
        Ok(Some(ParsedLine::new(written.or(adapter), ONLY_BUS, frame)))
    }

    fn at_line(&mut self, number: u64) {
        self.line = number;
    }

    fn report_skipped(&mut self, batch: &mut Batch) {
        self.skipped.report_lines(batch);
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::capture::testing::{read_capture, read_in_pieces};

    #[test]
    fn frames_of_all_kinds() {
        let text = "t1F512A0F\nT18FEF1002FFFE\nr7011\nR18EEFF018\nd12390102030405060708090A0B0C\n";
        assert_eq!(
            read_capture(text.as_bytes()).items,
            [
                LONGER,
                "{1} bus0 1F5#2A flags=00 dlc=0",
                "{2} bus0 18FEF100#FFFE flags=00 dlc=0",
                "{3} bus0 701#R1 flags=01 dlc=0",
                "{4} bus0 18EEFF01#R8 flags=01 dlc=0",
                "{5} bus0 123#0102030405060708090A0B0C flags=04 dlc=0",
            ]
        );
    }

    #[test]
    fn times_of_the_adapter_continue_after_a_minute() {
        // 7530h = 30,000 ms; EA5Fh = 59,999 ms; then 1 ms of the second minute.
        let text = "t7011057530\rt701105EA5F\rt7011050001\r";
        assert_eq!(
            read_capture(text.as_bytes()).items,
            [
                ADAPTER_TIMES,
                "{1} (30.000000000) bus0 701#05 flags=00 dlc=0",
                "{2} (59.999000000) bus0 701#05 flags=00 dlc=0",
                "{3} (60.001000000) bus0 701#05 flags=00 dlc=0",
            ]
        );
        let mut clock = AdapterClock::default();
        let found = [59_000, 58_990, 10, 30_000, 5].map(|stamp| clock.elapsed(stamp));
        assert_eq!(found, [59_000, 58_990, 60_010, 90_000, 60_005]);
        let mut clock = AdapterClock::default();
        assert_eq!([65_000, 10].map(|stamp| clock.elapsed(stamp)), [65_000, 65_546]);
    }

    #[test]
    fn times_of_the_logger_precede_those_of_the_adapter() {
        let text = "23:59:59.9 t7011050001\n00:00:00.1 t7011050002\n";
        let times: Vec<_> =
            read_capture(text.as_bytes()).frames.iter().map(|frame| frame.time.unwrap().0).collect();
        assert_eq!(times, [86_399_900_000_000, 86_400_100_000_000]);
    }

    #[test]
    fn commands_are_counted_and_broken_lines_say_what_was_expected() {
        let text = "S6\r\nO\r\n\x07t701105\r\nt70110\r\nt80010\r\nt123105x\r\nF00\r\nz\r\nhello\r\nt701106\r\nt701106\r\n\
                    t701106\r\nt701106\r\nt701106\r\nt701106\r\nt701106\r\nt701106\r\nt701106\r\nt70";
        let whole = read_capture(text.as_bytes());
        assert_eq!(whole, read_in_pieces(text.as_bytes(), &[1, 5, 2]));
        let bad: Vec<_> = whole.items.iter().filter(|item| item.starts_with("line ")).collect();
        let expected = [
            "line 4: data: fewer",
            "line 5: identifier: expected at most 7FF",
            "line 6: after the data",
            "line 9: expected a frame",
            "line 19: frame: ends before",
        ];
        assert_eq!(bad.len(), expected.len(), "{bad:?}");
        for (found, expected) in bad.iter().zip(expected) {
            assert!(found.starts_with(expected), "{found}");
        }
        let last = whole.items.last().unwrap();
        assert_eq!(last, "4 lines with commands or responses of the adapter skipped (first: line 1)");
        assert_eq!(whole.frames.len() + bad.len() + 4, text.lines().count(), "read + skipped = all");
    }

    #[test]
    fn other_texts_are_not_slcan() {
        for other in [
            "",
            "hello\n",
            "t12\n",
            "t1230\nt1230\n",
            "hello\nt701105\n",
            "S6\nO\n",
            "12 t701105\n",
            "t701105 x\nt701105 x\n",
            "123#11\n",
        ] {
            assert!(!detect_lawicel(other.as_bytes()), "{other}");
        }
        assert!(detect_lawicel(b"S6\nt1230\nt701105"));
    }
}
