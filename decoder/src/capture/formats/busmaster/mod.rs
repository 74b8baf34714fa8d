//! Captures of BUSMASTER: CAN and J1939.
//!
//! ```text
//! ***BUSMASTER Ver 2.4.0***
//! ***PROTOCOL CAN***                                    or J1939; LIN is skipped
//! ***[START LOGGING SESSION]***
//! ***START DATE AND TIME 23:9:2015 22:17:28:928***      day first
//! ***HEX***                                             or DEC: identifiers and data, never the DLC
//! ***SYSTEM MODE***                                     or ABSOLUTE, RELATIVE
//! 22:20:14:9920 Rx 1 0x21A s 8 FE 36 12 FE 69 05 07 AD
//! ***END DATE AND TIME 23:9:2015 22:20:28:001***
//! ***[STOP LOGGING SESSION]***                          further sessions may follow
//! ```
//!
//! Times are the time of day in system mode, the time since the start in absolute mode, and the time since
//! the frame before in relative mode.

mod line;

use line::{BusmasterLine, DAY};

use crate::capture::CaptureFormat;
use crate::capture::calendar::from_utc;
use crate::capture::local_time::TimeOrigin;
use crate::capture::text::columns::{ColumnWords, NumberBase};
use crate::capture::text::line_format::{
    CaptureAssumptions, LineFault, LineFormat, LineParser, ParsedLine, first_lines,
};

/// A smaller backward step of the time of day is not a new day: frames are out of order, or the clock was
/// set.
const HALF_A_DAY: i64 = DAY / 2;

/// Start and end of header lines.
const STARS: &[u8] = b"***";

pub(super) const FORMAT: CaptureFormat = CaptureFormat {
    name: "busmaster",
    title: BusMaster::TITLE,
    is_text: true,
    is_packed: false,
    detect: |head| first_lines(head, 5).next().is_some_and(|line| line.starts_with(b"***BUSMASTER")),
    parser: |options| Box::new(LineParser::with_zones(BusMaster::default(), options)),
};

/// Protocol of a session.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
enum SessionProtocol {
    #[default]
    Can,
    J1939,
    /// Another bus system.
    Foreign,
}

/// Meaning of times.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
enum BusmasterTimeMode {
    /// Time of day.
    #[default]
    System,
    /// Time since the start of the session.
    Absolute,
    /// Time since the frame before.
    Relative,
}

/// Header of the current session.
#[derive(Clone, Default)]
struct BusMaster {
    protocol: SessionProtocol,
    base: NumberBase,
    mode: Option<BusmasterTimeMode>,
    /// Day of the start of the session, in nanoseconds since 1970, and the time of the start within that day.
    day: i64,
    start: i64,
    /// Whether the header states the start.
    is_dated: bool,
    /// Time of day, or time since the start, of the frame before.
    last: Option<i64>,
}

impl BusMaster {
    fn on_header(&mut self, text: &[u8], assumptions: &mut CaptureAssumptions) -> Result<(), LineFault> {
        match text {
            b"HEX" => self.base = NumberBase::Hex,
            b"DEC" => self.base = NumberBase::Decimal,
            b"SYSTEM MODE" => self.mode = Some(BusmasterTimeMode::System),
            b"ABSOLUTE MODE" => self.mode = Some(BusmasterTimeMode::Absolute),
            b"RELATIVE MODE" => self.mode = Some(BusmasterTimeMode::Relative),
            b"PROTOCOL CAN" => self.protocol = SessionProtocol::Can,
            b"PROTOCOL J1939" => self.protocol = SessionProtocol::J1939,
            _ if text.starts_with(b"BUSMASTER") => *self = Self::default(),
            _ if text.starts_with(b"PROTOCOL") => {
                self.protocol = SessionProtocol::Foreign;
                assumptions.add_assumption("sessions of bus systems other than CAN skipped");
            }
            _ => {
                if let Some(date) = text.strip_prefix(b"START DATE AND TIME") {
                    self.parse_start(date)?;
                }
            }
        }
        Ok(())
    }

    /// Parses ` 23:9:2015 22:17:28:928`; milliseconds are not padded.
    fn parse_start(&mut self, text: &[u8]) -> Result<(), LineFault> {
        const DATE: &str = "start date: expected day:month:year hour:minute:second:millisecond";
        let mut words = ColumnWords::new(text);
        let date = parse_numbers(words.next().unwrap_or_default()).ok_or(DATE)?;
        let time = parse_numbers(words.next().unwrap_or_default()).ok_or(DATE)?;
        let ([day, month, year], [hour, minute, second, millisecond]) = (date, time);
        let nanoseconds = millisecond.saturating_mul(1_000_000);
        self.day = from_utc([year, month, day, 0, 0, 0], 0).ok_or(DATE)?;
        let start = from_utc([year, month, day, hour, minute, second], nanoseconds).ok_or(DATE)?;
        self.start = start.saturating_sub(self.day);
        self.is_dated = true;
        self.last = None;
        Ok(())
    }

    /// Converts a timestamp of a line to a time.
    fn convert_stamp(&mut self, stamp: i64) -> i64 {
        match self.mode.unwrap_or_default() {
            BusmasterTimeMode::System => {
                if stamp.saturating_add(HALF_A_DAY) < self.last.unwrap_or(self.start) {
                    self.day = self.day.saturating_add(DAY);
                }
                self.last = Some(stamp);
                self.day.saturating_add(stamp)
            }
            BusmasterTimeMode::Absolute => self.day.saturating_add(self.start).saturating_add(stamp),
            BusmasterTimeMode::Relative => {
                let elapsed = self.last.unwrap_or(0).saturating_add(stamp);
                self.last = Some(elapsed);
                self.day.saturating_add(self.start).saturating_add(elapsed)
            }
        }
    }
}

/// Parses `N` numbers separated by colons.
fn parse_numbers<const N: usize>(word: &[u8]) -> Option<[i64; N]> {
    let mut parts = word.split(|byte| *byte == b':');
    let mut found = [0; N];
    for slot in &mut found {
        *slot = NumberBase::Decimal.parse_number(parts.next()?)?.into();
    }
    parts.next().is_none().then_some(found)
}

impl LineFormat for BusMaster {
    const TITLE: &'static str = "BUSMASTER";

    fn parse_line<'a>(
        &'a mut self,
        text: &'a [u8],
        assumptions: &mut CaptureAssumptions,
    ) -> Result<Option<ParsedLine<'a>>, LineFault> {
        let text = text.trim_ascii();
        if let Some(text) = text.strip_prefix(STARS) {
            let text = text.strip_suffix(STARS).unwrap_or(text).trim_ascii();
            return self.on_header(text, assumptions).map(|()| None);
        }
        let is_j1939 = match self.protocol {
            SessionProtocol::Can => false,
            SessionProtocol::J1939 => true,
            SessionProtocol::Foreign => return Ok(None),
        };
        if self.mode.is_none() {
            self.mode = Some(BusmasterTimeMode::System);
            assumptions.add_assumption("header without time mode: times read as time of day");
        }
        let (stamp, content) = line::parse_line(text, is_j1939, self.base)?;
        let time = Some(self.convert_stamp(stamp));
        match content {
            BusmasterLine::Frame(bus, frame) => Ok(Some(ParsedLine::new(time, bus, frame))),
            BusmasterLine::Transfer => {
                assumptions
                    .add_assumption("J1939 messages over 8 bytes, reassembled by the recorder, skipped");
                Ok(None)
            }
        }
    }

    fn time_origin(&self) -> TimeOrigin {
        match self.mode {
            _ if !self.is_dated => TimeOrigin::Universal,
            Some(BusmasterTimeMode::System) => TimeOrigin::LocalDates,
            _ => TimeOrigin::LocalStart(self.day.saturating_add(self.start)),
        }
    }
}

#[cfg(test)]
mod tests {
    use crate::capture::testing::read_capture;
    use crate::words::UNKNOWN_ZONE;

    fn session(protocol: &str, modes: &str, lines: &str) -> String {
        format!(
            "***BUSMASTER Ver 2.4.0***\r\n***PROTOCOL {protocol}***\n***NOTE: PLEASE DO NOT EDIT THIS DOCUMENT***\n\
             ***[START LOGGING SESSION]***\n***START DATE AND TIME 2:1:1970 23:59:58:5***\n{modes}\
             ***CHANNEL 1 - Kvaser - 500000 bps***\n{lines}***END DATE AND TIME ***\n***[STOP LOGGING SESSION]***\n"
        )
    }

    fn times(text: &str) -> Vec<String> {
        read_capture(text.as_bytes()).frames.iter().map(|frame| frame.time.unwrap().to_string()).collect()
    }

    const LINES: &str = "23:59:59:9999 Rx 1 001 s 0\n00:00:00:0001 Rx 1 001 s 0\n";

    #[test]
    fn system_mode_is_the_time_of_day_over_midnight() {
        let text = session("CAN", "***HEX***\n***SYSTEM MODE***\n", LINES);
        assert_eq!(times(&text), ["172799.999900000", "172800.000100000"]);
        let text = session("CAN", "***SYSTEM MODE***\n", "00:00:00:0001 Rx 1 001 s 0\n");
        assert_eq!(times(&text), ["172800.000100000"]);
    }

    #[test]
    fn absolute_mode_counts_from_the_start_and_relative_mode_from_the_frame_before() {
        let lines = "00:00:01:0000 Rx 1 001 s 0\n00:00:01:5000 Rx 1 001 s 0\n";
        let text = session("CAN", "***HEX***\n***ABSOLUTE MODE***\n", lines);
        assert_eq!(times(&text), ["172799.005000000", "172799.505000000"]);
        let text = session("CAN", "***HEX***\n***RELATIVE MODE***\n", lines);
        assert_eq!(times(&text), ["172799.005000000", "172800.505000000"]);
    }

    #[test]
    fn decimal_sessions_and_sessions_without_a_mode() {
        let text = session("CAN", "***DEC***\n", "10:00:00:0000 Tx 2 291 s 2 16 255\n");
        let content = read_capture(text.as_bytes());
        assert_eq!(
            content.items,
            [
                "header without time mode: times read as time of day",
                UNKNOWN_ZONE,
                "{1} (208800.000000000) bus0 123#10FF flags=20 dlc=0",
            ]
        );
        assert_eq!(content.buses, ["2"]);
    }

    #[test]
    fn every_session_has_a_header_of_its_own() {
        let first = session("CAN", "***DEC***\n***ABSOLUTE MODE***\n", "00:00:01:0000 Rx 1 16 s 0\n");
        let lin = session("LIN", "***HEX***\n***SYSTEM MODE***\n", "23:59:59:0000 Rx 1 what ever\n");
        let last = session(
            "J1939",
            "***HEX***\n***SYSTEM MODE***\n",
            "23:59:59:0000 1 1cea2000 0x00EA00 RQST 00  20  007 Tx 3 00 00 00\n",
        );
        let content = read_capture([first, lin, last].concat().as_bytes());
        assert_eq!(
            content.items,
            [
                UNKNOWN_ZONE,
                "{1} (172799.005000000) bus0 010# flags=40 dlc=0",
                "sessions of bus systems other than CAN skipped",
                "{2} (172799.000000000) bus0 1CEA2000#000000 flags=20 dlc=0",
            ]
        );
    }

    #[test]
    fn a_start_that_is_no_date_is_named() {
        let content = read_capture(
            b"***BUSMASTER Ver 1***\n***START DATE AND TIME 30:2:2013 0:0:0:0***\n10:00:00:0000 Rx 1 1 s 0\n",
        );
        assert!(content.items[0].starts_with("line 2: start date: expected"), "{:?}", content.items);
        assert_eq!(content.frames.len(), 1);
    }
}
