//! Text captures of CARBUS Analyzer (canhacker.com), versions 2 and 3; they have PEAK's extension .trc.
//!
//! ```text
//! @ TEXT @ 2 @ 64 @ 0 @ 55 @ 10078 @ 00:00:10.078 @     version, …, lines, milliseconds, time
//! # $LocalTime=12:05:10.123                             version 3
//! 46,016  1  0004  45A  8  5A 04 00 00 00 00 00 00  00000000  Z
//! time    bus flags ID DLC data                     checksum  text
//! ```
//!
//! Lines end with a carriage return only, columns with a tab. Times are seconds and milliseconds
//! (version 2) or microseconds (version 3) within a minute; a backward step starts the next minute.

use crate::capture::CaptureFormat;
use crate::capture::text::columns::{ColumnWords, NumberBase, parse_identifier, parse_time};
use crate::capture::text::line_format::{
    CaptureAssumptions, LineFault, LineFormat, LineParser, ParsedLine, first_lines,
};
use crate::capture::text::payload::{IDENTIFIER, LENGTH, SHORT, build_frame, by_dlc};
use crate::frame::FrameFlags;

/// Unit of time in nanoseconds.
const SECOND: i64 = 1_000_000_000;

/// Times restart after this number of nanoseconds.
const MINUTE: i64 = 60 * SECOND;

/// A smaller backward step is a frame of another bus, out of order.
const DISORDER: i64 = MINUTE / 2;

/// Flags of a data frame without further attributes.
const PLAIN: u32 = 4;

pub(super) const FORMAT: CaptureFormat = CaptureFormat {
    name: "carbus",
    title: CarBus::TITLE,
    is_text: true,
    is_packed: false,
    detect: |head| first_lines(head, 5).next().is_some_and(|line| line.starts_with(b"@ TEXT @")),
    parser: |_| Box::new(LineParser::new(CarBus::default())),
};

/// State that affects later lines.
#[derive(Clone, Default)]
struct CarBus {
    minutes: i64,
    last: i64,
}

impl CarBus {
    /// Nanoseconds since the start of the first minute.
    fn time_from_start(&mut self, within_minute: i64) -> i64 {
        if within_minute.saturating_add(DISORDER) < self.last {
            self.minutes = self.minutes.saturating_add(MINUTE);
        }
        self.last = within_minute;
        self.minutes.saturating_add(within_minute)
    }
}

impl LineFormat for CarBus {
    const TITLE: &'static str = "CARBUS Analyzer text";

    fn parse_line<'a>(
        &'a mut self,
        text: &'a [u8],
        assumptions: &mut CaptureAssumptions,
    ) -> Result<Option<ParsedLine<'a>>, LineFault> {
        let text = text.trim_ascii();
        if text.starts_with(b"@") || text.starts_with(b"#") {
            return Ok(None);
        }
        let mut words = ColumnWords::new(text);
        let stamp = words.next().and_then(|word| parse_time(word, SECOND)).filter(|stamp| *stamp < MINUTE);
        let stamp = stamp.ok_or("time: expected seconds within a minute, such as 46,016")?;
        let bus = words.next().filter(|word| word.iter().all(u8::is_ascii_digit));
        let bus = bus.ok_or("bus: expected a number")?;
        let marks = words.next().and_then(|word| NumberBase::Hex.parse_number(word));
        if marks.ok_or("flags: expected hex digits")? != PLAIN {
            assumptions.add_assumption("flags other than 0004 undocumented: all lines read as data frames");
        }
        let digits = words.next().unwrap_or_default();
        let number = NumberBase::Hex.parse_number(digits);
        let id = number.and_then(|number| parse_identifier(number, digits.len() > 4 || number > 0x7FF));
        let dlc = words.next().and_then(|word| NumberBase::Hex.parse_byte(word));
        let lengths = dlc.and_then(|dlc| by_dlc(dlc, FrameFlags(0))).ok_or(LENGTH)?;
        let frame = build_frame(id.ok_or(IDENTIFIER)?, FrameFlags(0), lengths, words, NumberBase::Hex)
            .ok_or(SHORT)?;
        Ok(Some(ParsedLine::new(Some(self.time_from_start(stamp)), bus, frame)))
    }
}

#[cfg(test)]
mod tests {
    use crate::capture::testing::read_capture;

    const HEADER: &str = "@ TEXT @ 2 @ 64 @ 0 @ 55 @ 10078 @ 00:00:10.078 @\r";

    #[test]
    fn frames_of_both_versions() {
        let text =
            format!("{HEADER}46,016\t1\t0004\t45A\t8\t5A 04 00 00 00 00 00 00\t00000000\tZ       \t\r");
        assert_eq!(
            read_capture(text.as_bytes()).items,
            ["{1} (46.016000000) bus0 45A#5A04000000000000 flags=00 dlc=0"]
        );
        let text = "@ TEXT @ 3 @ 64 @ 0 @ 1 @ 0 @ 0 @\r# $LocalTime=12:05:10.123\r26,678369\t2\t00000004\t00000123\t1\tFF\t0\t \r";
        let content = read_capture(text.as_bytes());
        assert_eq!(content.items, ["{1} (26.678369000) bus0 00000123#FF flags=00 dlc=0"]);
        assert_eq!(content.buses, ["2"]);
    }

    #[test]
    fn minutes_are_counted_where_times_fall_back() {
        let line = |stamp| format!("{stamp}\t1\t0004\t001\t0\t\t0\t\r");
        let text: String = [HEADER.to_owned(), line("59,990"), line("59,980"), line("00,010")].concat();
        let times: Vec<_> =
            read_capture(text.as_bytes()).frames.iter().map(|frame| frame.time.unwrap().0).collect();
        assert_eq!(times, [59_990_000_000, 59_980_000_000, 60_010_000_000]);
    }

    #[test]
    fn other_flags_are_reported_and_broken_lines_named() {
        let text = format!(
            "{HEADER}1,0\t1\t80000004\t001\t0\t\t0\r61,0\t1\t0004\t001\t0\r1,0\t1\t0004\t001\t2\t5A\r"
        );
        let content = read_capture(text.as_bytes());
        assert!(content.items[0].starts_with("flags other than 0004"), "{:?}", content.items);
        assert!(content.items[2].starts_with("line 3: time: expected seconds within a minute"));
        assert!(content.items[3].starts_with("line 4: data: fewer bytes"), "{:?}", content.items);
    }
}
