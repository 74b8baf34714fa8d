//! One line of a BUSMASTER capture that carries a time.
//!
//! ```text
//! 22:20:14:9920 Rx 1 0x21A s 8 FE 36 12 FE 69 05 07 AD       s, sr, x, xr, s-fd, x-fd
//! 22:20:14:9920 Rx 1 0x000 ERR STUFF_ERROR                   error frame, described by its text
//! 13:19:55:2009 1 1cea2000 0x00EA00 RQST 00 20 007 Tx 3 00 00 00
//! time          channel id PGN type source destination priority direction length data
//! ```

use crate::capture::bus_error::{Violation, violation_frame};
use crate::capture::text::columns::{ColumnWords, NumberBase, parse_identifier, parse_time};
use crate::capture::text::payload::{LENGTH, SHORT, build_frame, by_either};
use crate::frame::{Frame, FrameFlags, MAX_DATA};

/// Nanoseconds of a second.
const SECOND: i64 = 1_000_000_000;

/// Nanoseconds of a millisecond.
const MILLISECOND: i64 = 1_000_000;

/// Nanoseconds of a day.
pub(super) const DAY: i64 = 86_400 * SECOND;

const IDENTIFIER: &str = "identifier: expected a value valid for the type, in the base of the header";
const DIRECTION: &str = "direction: expected Rx or Tx";
const CHANNEL: &str = "channel: expected a number";

/// Types of CAN frames: name, whether the identifier is extended, and flags.
const TYPES: &[(&[u8], bool, FrameFlags)] = &[
    (b"s", false, FrameFlags(0)),
    (b"x", true, FrameFlags(0)),
    (b"sr", false, FrameFlags::REMOTE),
    (b"xr", true, FrameFlags::REMOTE),
    (b"s-fd", false, FrameFlags::FD),
    (b"x-fd", true, FrameFlags::FD),
];

/// Words in the text of an error, in lower case.
const ERRORS: &[(&[u8], Violation)] = &[
    (b"stuff", Violation::Stuff),
    (b"form", Violation::Form),
    (b"crc", Violation::Checksum),
    (b"ack", Violation::Acknowledgement),
    (b"bit", Violation::Bit),
];

/// Content of a line.
#[derive(Debug, PartialEq, Eq)]
pub(super) enum BusmasterLine<'a> {
    /// Channel and frame; number, time and bus of the frame are not set.
    Frame(&'a [u8], Frame),
    /// A message of several frames, each of which also has its own line.
    Transfer,
}

/// Parses a line: its time in nanoseconds and its content. The error contains the expected content.
pub(super) fn parse_line(
    line: &[u8],
    is_j1939: bool,
    base: NumberBase,
) -> Result<(i64, BusmasterLine<'_>), &'static str> {
    let mut words = ColumnWords::new(line);
    let stamp = parse_clock(words.next().unwrap_or_default());
    let stamp = stamp.ok_or("time: expected hours:minutes:seconds:fraction")?;
    let content = if is_j1939 { parse_j1939(words, base) } else { parse_can(words, base) };
    Ok((stamp, content?))
}

/// Parses `22:20:14:9920`. BUSMASTER writes four digits in units of 100 µs. Up to three digits are
/// milliseconds without leading zeros, as SavvyCAN writes them; Wireshark reads those in units of 100 µs too.
fn parse_clock(word: &[u8]) -> Option<i64> {
    let mut parts = word.splitn(4, |byte| *byte == b':');
    let mut number = || parts.next().and_then(|part| NumberBase::Decimal.parse_number(part)).map(i64::from);
    let (hours, minutes, seconds) = (number()?, number()?, number()?);
    let fraction = match parts.next()? {
        digits if digits.len() <= 3 => i64::from(NumberBase::Decimal.parse_number(digits)?) * MILLISECOND,
        digits if digits.iter().all(u8::is_ascii_digit) => parse_time(&[b"0.", digits].concat(), SECOND)?,
        _ => return None,
    };
    let seconds = hours.checked_mul(3_600)?.checked_add(minutes.checked_mul(60)?)?.checked_add(seconds)?;
    seconds.checked_mul(SECOND)?.checked_add(fraction)
}

fn parse_direction(word: Option<&[u8]>) -> Result<FrameFlags, &'static str> {
    match word {
        Some(b"Rx") => Ok(FrameFlags::RECEIVED),
        Some(b"Tx") => Ok(FrameFlags::TRANSMITTED),
        _ => Err(DIRECTION),
    }
}

fn parse_channel(word: Option<&[u8]>) -> Result<&[u8], &'static str> {
    word.filter(|word| word.iter().all(u8::is_ascii_digit)).ok_or(CHANNEL)
}

/// Parses a number in the base of the header, with or without 0x.
fn parse_number(word: &[u8], base: NumberBase) -> Option<u32> {
    match word {
        [b'0', b'x' | b'X', digits @ ..] => NumberBase::Hex.parse_number(digits),
        digits => base.parse_number(digits),
    }
}

fn parse_can(mut words: ColumnWords<'_>, base: NumberBase) -> Result<BusmasterLine<'_>, &'static str> {
    let way = parse_direction(words.next())?;
    let bus = parse_channel(words.next())?;
    let id = words.next().and_then(|word| parse_number(word, base));
    let kind = words.next().unwrap_or_default();
    if kind.starts_with(b"ERR") {
        let frame = error_frame(words.remaining_text(), way.contains(FrameFlags::TRANSMITTED));
        return Ok(BusmasterLine::Frame(bus, Frame { flags: frame.flags.with(way), ..frame }));
    }
    let kind = TYPES.iter().find(|(name, _, _)| *name == kind);
    let (_, extended, flags) = *kind.ok_or("type: expected s, x, sr, xr, s-fd, x-fd or ERR")?;
    let id = id.and_then(|id| parse_identifier(id, extended)).ok_or(IDENTIFIER)?;
    let count = words.next().and_then(|word| NumberBase::Decimal.parse_byte(word)).ok_or(LENGTH)?;
    let there = words.clone().take(MAX_DATA + 1).count();
    let lengths = by_either(count, there, flags).ok_or(LENGTH)?;
    Ok(BusmasterLine::Frame(bus, build_frame(id, flags.with(way), lengths, words, base).ok_or(SHORT)?))
}

/// Error frame from a text that describes the error.
fn error_frame(text: &[u8], sending: bool) -> Frame {
    let text = text.to_ascii_lowercase();
    let kind = ERRORS.iter().find(|(word, _)| memchr::memmem::find(&text, word).is_some());
    violation_frame(kind.map_or(Violation::Other, |(_, kind)| *kind), sending, 0, None)
}

fn parse_j1939(mut words: ColumnWords<'_>, base: NumberBase) -> Result<BusmasterLine<'_>, &'static str> {
    let bus = parse_channel(words.next())?;
    let id = words.next().and_then(|word| parse_number(word, base));
    let id = id.and_then(|id| parse_identifier(id, true)).ok_or(IDENTIFIER)?;
    // Group, addresses and priority are part of the identifier, so their columns are skipped.
    let way = parse_direction(words.by_ref().nth(5))?;
    let count = words.next().and_then(|word| NumberBase::Decimal.parse_number(word)).ok_or(LENGTH)?;
    if count > 8 {
        return Ok(BusmasterLine::Transfer);
    }
    let count = u8::try_from(count).map_err(|_| LENGTH)?;
    Ok(BusmasterLine::Frame(bus, build_frame(id, way, (count, 0), words, base).ok_or(SHORT)?))
}

#[cfg(test)]
mod tests {
    use super::*;

    fn read(line: &str) -> String {
        match parse_line(line.as_bytes(), false, NumberBase::Hex).unwrap() {
            (stamp, BusmasterLine::Frame(bus, frame)) => format!("{stamp} {} {frame:?}", bus.escape_ascii()),
            (_, content) => panic!("{content:?}"),
        }
    }

    #[test]
    fn frames_of_every_type() {
        for (line, expected) in [
            ("00:00:00:0010 Rx 1 0x21A s 2 FE 36", "1000000 1 {0} bus0 21A#FE36 flags=40 dlc=0"),
            ("00:00:00:001 Tx 2 18FEF100 x 1 0A", "1000000 2 {0} bus0 18FEF100#0A flags=20 dlc=0"),
            ("01:01:01:0 Rx 1 021 sr 3", "3661000000000 1 {0} bus0 021#R3 flags=41 dlc=0"),
            ("0:0:0:0 Rx 1 21 xr 0 00 00", "0 1 {0} bus0 00000021#R0 flags=41 dlc=0"),
            (
                "0:0:0:0 Rx 1 21 s-fd 12 1 2 3 4 5 6 7 8 9 A B C",
                "0 1 {0} bus0 021#0102030405060708090A0B0C flags=44 dlc=0",
            ),
            (
                "0:0:0:0 Rx 1 21 x-fd 9 1 2 3 4 5 6 7 8 9 A B C",
                "0 1 {0} bus0 00000021#0102030405060708090A0B0C flags=44 dlc=0",
            ),
        ] {
            assert_eq!(read(line), expected, "{line}");
        }
    }

    #[test]
    fn fractions_of_a_second_in_both_programs() {
        for (word, expected) in
            [("0:0:1:0002", 1_000_200_000), ("0:0:1:2", 1_002_000_000), ("0:0:1:992", 1_992_000_000)]
        {
            assert_eq!(parse_clock(word.as_bytes()), Some(expected), "{word}");
        }
    }

    #[test]
    fn errors_are_reported_as_text() {
        let found = read("0:0:0:0 Tx 1 0x000 ERR Acknowledgement error");
        assert_eq!(found, "0 1 {0} bus0 000000A8#0000801900000000 flags=22 dlc=0");
        let found = read("0:0:0:0 Rx 1 0x000 ERR");
        assert_eq!(found, "0 1 {0} bus0 00000088#0000000000000000 flags=42 dlc=0");
    }

    #[test]
    fn messages_the_recorder_put_together_are_no_frames() {
        let line = b"0:0:0:0 1 1cebff00 0x00EB00 BROADCAST 00 FF 007 Rx 14 01 02 03 04 05 06 07 08 09 0A 0B 0C 0D 0E";
        assert_eq!(parse_line(line, true, NumberBase::Hex), Ok((0, BusmasterLine::Transfer)));
    }

    #[test]
    fn broken_lines_say_what_was_expected() {
        for (line, part) in [
            ("0:0:0 Rx 1 1 s 0", "time"),
            ("0:0:0:x Rx 1 1 s 0", "time"),
            ("99999999999:0:0:0 Rx 1 1 s 0", "time"),
            ("0:0:0:0 Qx 1 1 s 0", "direction"),
            ("0:0:0:0 Rx a 1 s 0", "channel"),
            ("0:0:0:0 Rx 1 800 s 0", "identifier"),
            ("0:0:0:0 Rx 1 20000000 x 0", "identifier"),
            ("0:0:0:0 Rx 1 1 q 0", "type"),
            ("0:0:0:0 Rx 1 1 s 16", "length"),
            ("0:0:0:0 Rx 1 1 s 2 00", "data"),
        ] {
            let reason = parse_line(line.as_bytes(), false, NumberBase::Hex).unwrap_err();
            assert!(reason.starts_with(part), "{line}: {reason}");
        }
        let reason = parse_line(b"0:0:0:0 1 1cea2000 0 RQST 00 20 007 Xx 3 00 00 00", true, NumberBase::Hex)
            .unwrap_err();
        assert_eq!(reason, DIRECTION);
    }
}
