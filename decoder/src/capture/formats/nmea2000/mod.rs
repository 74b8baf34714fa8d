//! Texts with one NMEA 2000 message per line, as gateways and canboat write them.
//!
//! ```text
//! A173321.107 23FF7 1F513 012F3070002F30709F                     Actisense N2K ASCII: time, source, destination and
//!                                                                priority, PGN, data
//! 2011-11-24-22:42:04.388,2,127251,36,255,8,7d,0b,7d,02,00,ff,ff,ff     canboat: time, priority, PGN, source, destination,
//!                                                                length, data
//! ```
//!
//! Sources: Actisense, "NMEA 2000 ASCII output format" (W2K-1 manual); canboat, `common/parse.c`, `parseRawFormatPlain` and
//! `parseRawFormatFast`. A message of more than eight bytes was several frames of NMEA 2000's fast packet on the bus: these
//! are built again, with the time of the message.

mod message;

use message::{ADDRESS, DATA, PGN, PacketBuilder, PgnMessage};

use crate::capture::CaptureFormat;
use crate::capture::calendar::from_utc;
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
const ZONE: &str = "dates without time zone: read as UTC";

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
    detect: |head| is_proven(head, |line| class_of(line, parse_canboat(line).is_ok())),
    parser: |_| Box::new(LineParser::new(MessageText::new(parse_canboat))),
};

fn class_of(line: &[u8], is_message: bool) -> LineClass {
    match is_message {
        true => LineClass::Proof,
        false if line.starts_with(b"#") => LineClass::Related,
        false => LineClass::Misfit,
    }
}

/// Time of a message.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum MessageTime {
    /// Nanoseconds since 1970, and whether the text states UTC.
    Date(i64, bool),
    /// Nanoseconds since midnight.
    OfDay(i64),
}

type ParsedMessage = Result<(MessageTime, PgnMessage), &'static str>;

/// State that affects later lines.
#[derive(Clone)]
struct MessageText {
    parse: fn(&[u8]) -> ParsedMessage,
    days: TimesOfDay,
    packets: PacketBuilder,
}

impl MessageText {
    fn new(parse: fn(&[u8]) -> ParsedMessage) -> Self {
        Self { parse, days: TimesOfDay::default(), packets: PacketBuilder::default() }
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
                if !is_utc {
                    assumptions.add_assumption(ZONE);
                }
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

/// Parses a line of canboat's `actisense-serial` and `candump2analyzer`.
fn parse_canboat(line: &[u8]) -> ParsedMessage {
    const TIME: &str = "time: expected a date such as 2011-11-24-22:42:04.388";
    const LENGTH: &str = "length: expected as many bytes as follow";
    let mut fields = line.split(|byte| *byte == b',').map(<[u8]>::trim_ascii);
    let time = fields.next().and_then(parse_date).ok_or(TIME)?;
    let mut number = || fields.next().and_then(|field| NumberBase::Decimal.parse_number(field));
    let priority = number().and_then(|number| u8::try_from(number).ok()).ok_or(ADDRESS)?;
    let pgn = number().ok_or(PGN)?;
    let mut address = || number().and_then(|number| u8::try_from(number).ok());
    let (source, destination) = (address().ok_or(ADDRESS)?, address().ok_or(ADDRESS)?);
    let length = number().ok_or(LENGTH)?;
    let data: Option<Vec<u8>> =
        fields.map(|field| NumberBase::Hex.parse_byte(field).filter(|_| field.len() == 2)).collect();
    let data = data.ok_or(DATA)?;
    if u32::try_from(data.len()) != Ok(length) {
        return Err(LENGTH);
    }
    Ok((time, PgnMessage::new(priority, pgn, source, destination, data)?))
}

/// Parses `2011-11-24-22:42:04.388`, or with T or Z between date and time, and Z at the end.
fn parse_date(field: &[u8]) -> Option<MessageTime> {
    let (text, is_utc) = match field.strip_suffix(b"Z") {
        Some(text) => (text, true),
        None => (field, false),
    };
    let (date, clock) = text.split_at_checked(10)?;
    let (mark, clock) = clock.split_first()?;
    let is_utc = is_utc || *mark == b'Z';
    let [y3, y2, y1, y0, b'-', o1, o0, b'-', d1, d0] = date else { return None };
    let number = |digits: &[u8]| NumberBase::Decimal.parse_number(digits).map(i64::from);
    let (year, month, day) = (number(&[*y3, *y2, *y1, *y0])?, number(&[*o1, *o0])?, number(&[*d1, *d0])?);
    let midnight = from_utc([year, month, day, 0, 0, 0], 0)?;
    let of_day = time_of_day(clock).filter(|_| matches!(mark, b'-' | b'T' | b'Z' | b' '))?;
    Some(MessageTime::Date(midnight.checked_add(of_day)?, is_utc))
}

#[cfg(test)]
mod tests;
