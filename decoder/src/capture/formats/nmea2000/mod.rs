//! Texts with one NMEA 2000 message per line, as gateways and canboat write them.
//!
//! ```text
//! A173321.107 23FF7 1F513 012F3070002F30709F                     Actisense N2K ASCII: time, source, destination and
//!                                                                priority, PGN, data
//! 2011-11-24-22:42:04.388,2,127251,36,255,8,7d,0b,7d,02,00,ff,ff,ff     canboat: time, priority, PGN, source, destination,
//!                                                                length, data
//! ```
//!
//! JSON of canboat's analyzer and of canboatjs: [`canboat`].
//!
//! Sources: Actisense, "NMEA 2000 ASCII output format" (W2K-1 manual); canboat, `common/parse.c`, `parseRawFormatPlain` and
//! `parseRawFormatFast`. A message of more than eight bytes was several frames of NMEA 2000's fast packet on the bus: these
//! are built again, with the time of the message.

mod canboat;
mod message;

use canboat::{parse_json, parse_text};
use message::{ADDRESS, DATA, MessageTime, PGN, PacketBuilder, ParsedMessage, PgnMessage};

use crate::capture::CaptureFormat;
use crate::capture::local_time::TimeOrigin;
use crate::capture::text::columns::{NumberBase, time_of_day};
use crate::capture::text::day::TimesOfDay;
use crate::capture::text::evidence::{LineClass, is_proven};
use crate::capture::text::line_format::{
    CaptureAssumptions, LineFault, LineFormat, LineParser, ONLY_BUS, ParsedLine,
};
use crate::frame::Frame;

const BUILT: &str =
    "messages of more than 8 bytes: frames of the fast packet built again, with the time of the message";
const OF_DAY: &str = "times of day without a date: times count from the midnight before the first message";

pub(super) const ACTISENSE: CaptureFormat = CaptureFormat {
    name: "n2k-ascii",
    title: "Actisense N2K ASCII",
    is_text: true,
    is_packed: false,
    detect: |head| is_proven(head, |line| class_of(line, parse_actisense(line).is_ok())),
    parser: |_| Box::new(LineParser::new(MessageText::new(parse_actisense))),
};

pub(super) const CANBOAT: CaptureFormat = CaptureFormat {
    name: "canboat",
    title: "canboat text",
    is_text: true,
    is_packed: false,
    detect: |head| is_proven(head, |line| class_of(line, parse_text(line).is_ok())),
    parser: |options| Box::new(LineParser::with_zones(MessageText::new(parse_text), options)),
};

pub(super) const CANBOAT_JSON: CaptureFormat = CaptureFormat {
    name: "canboat-json",
    title: "canboat JSON",
    is_text: true,
    is_packed: false,
    detect: |head| is_proven(head, |line| class_of(line, parse_json(line).is_ok())),
    parser: |options| Box::new(LineParser::with_zones(MessageText::new(parse_json), options)),
};

fn class_of(line: &[u8], is_message: bool) -> LineClass {
    match is_message {
        true => LineClass::Proof,
        false if line.starts_with(b"#") => LineClass::Related,
        false => LineClass::Misfit,
    }
}

/// State that affects later lines.
#[derive(Clone)]
struct MessageText {
    parse: fn(&[u8]) -> ParsedMessage,
    days: TimesOfDay,
    packets: PacketBuilder,
    /// Whether the last date has no time zone.
    is_local: bool,
}

impl MessageText {
    fn new(parse: fn(&[u8]) -> ParsedMessage) -> Self {
        Self { parse, days: TimesOfDay::default(), packets: PacketBuilder::default(), is_local: false }
    }
}

impl LineFormat for MessageText {
    const TITLE: &'static str = "NMEA 2000 text";

    fn parse_line<'a>(
        &'a mut self,
        text: &'a [u8],
        assumptions: &mut CaptureAssumptions,
    ) -> Result<Option<ParsedLine<'a>>, LineFault> {
        let text = text.trim_ascii();
        if text.starts_with(b"#") {
            return Ok(None);
        }
        let (time, message) = (self.parse)(text)?;
        let time = match time {
            MessageTime::Date(time, is_utc) => {
                self.is_local = !is_utc;
                time
            }
            MessageTime::OfDay(time) => {
                assumptions.add_assumption(OF_DAY);
                self.days.elapsed_since_midnight(time)
            }
        };
        if message.is_long() {
            assumptions.add_assumption(BUILT);
        }
        let frame = self.packets.first_frame(message);
        Ok(Some(ParsedLine::new(Some(time), ONLY_BUS, frame)))
    }

    fn next_frame(&mut self) -> Option<Frame> {
        self.packets.next_frame()
    }

    fn time_origin(&self) -> TimeOrigin {
        if self.is_local { TimeOrigin::LocalDates } else { TimeOrigin::Universal }
    }
}

/// Parses a line of Actisense's text: `A173321.107 23FF7 1F513 012F3070002F30709F`.
fn parse_actisense(line: &[u8]) -> ParsedMessage {
    const TIME: &str = "time: expected A and hhmmss.fff";
    let mut words = line.split(u8::is_ascii_whitespace).filter(|word| !word.is_empty());
    let time = words.next().and_then(|word| word.strip_prefix(b"A")).and_then(digits_of_day).ok_or(TIME)?;
    let addresses = words.next().filter(|word| word.len() == 5).ok_or(ADDRESS)?;
    let numbers = NumberBase::Hex.parse_number(addresses).ok_or(ADDRESS)?;
    let [_, high, middle, low] = numbers.to_be_bytes();
    let (source, destination, priority) = (high << 4 | middle >> 4, middle << 4 | low >> 4, low & 0x0F);
    let pgn = words.next().filter(|word| word.len() <= 5);
    let pgn = pgn.and_then(|word| NumberBase::Hex.parse_number(word)).ok_or(PGN)?;
    let digits = words.next().filter(|word| word.len().is_multiple_of(2)).ok_or(DATA)?;
    let data: Option<Vec<u8>> = digits.chunks_exact(2).map(|pair| NumberBase::Hex.parse_byte(pair)).collect();
    if words.next().is_some() {
        return Err("expected nothing after the data");
    }
    let message = PgnMessage::new(priority, pgn, source, destination, data.ok_or(DATA)?)?;
    Ok((MessageTime::OfDay(time), message))
}

/// Nanoseconds since midnight of `hhmmss.fff`.
fn digits_of_day(digits: &[u8]) -> Option<i64> {
    let (whole, fraction) = digits.split_at_checked(6)?;
    whole.iter().all(u8::is_ascii_digit).then_some(())?;
    let [h1, h0, m1, m0, seconds @ ..] = whole else { return None };
    time_of_day(&[&[*h1, *h0, b':', *m1, *m0, b':'][..], seconds, fraction].concat())
}

#[cfg(test)]
mod tests;
