//! Lines without a time in an ASC capture: start date, base of numbers, meaning of times.
//!
//! ```text
//! date Sam Sep 30 15:06:13.191 2017          or 03:06:13.191 pm 2017; months in the language of Windows
//! base hex  timestamps absolute              or dec, relative
//! internal events logged
//! // version 9.0.0
//! Begin Triggerblock Sam Sep 30 15:06:13.191 2017
//! End TriggerBlock
//! ```

use nom::bytes::complete::{tag_no_case, take_till1};
use nom::character::complete::{char, digit1, space0, space1};
use nom::combinator::{all_consuming, map_opt, opt, verify};
use nom::sequence::{preceded, terminated};
use nom::{IResult, Parser};

use crate::capture::calendar::from_utc;
use crate::capture::text::columns::{ColumnWords, NumberBase, parse_time};

/// Unit of time in nanoseconds.
const SECOND: i64 = 1_000_000_000;

/// First letters of the months in lower case, in the languages of Windows that write a Latin alphabet: English, German,
/// French, Italian, Spanish, Portuguese, Dutch; accents in Latin-1 and in UTF-8. A longer beginning precedes a shorter one.
const MONTHS: &[(&[u8], i64)] = &[
    (b"jan", 1),
    (b"gen", 1),
    (b"ene", 1),
    (b"feb", 2),
    (b"fev", 2),
    (b"f\xE9v", 2),
    (b"f\xC3\xA9v", 2),
    (b"mar", 3),
    (b"m\xE4r", 3),
    (b"m\xC3\xA4r", 3),
    (b"mrz", 3),
    (b"mrt", 3),
    (b"maa", 3),
    (b"apr", 4),
    (b"avr", 4),
    (b"abr", 4),
    (b"may", 5),
    (b"mai", 5),
    (b"mag", 5),
    (b"mei", 5),
    (b"juin", 6),
    (b"jun", 6),
    (b"giu", 6),
    (b"juil", 7),
    (b"jul", 7),
    (b"lug", 7),
    (b"aug", 8),
    (b"ao\xFB", 8),
    (b"ao\xC3\xBB", 8),
    (b"aou", 8),
    (b"ago", 8),
    (b"sep", 9),
    (b"set", 9),
    (b"oct", 10),
    (b"okt", 10),
    (b"ott", 10),
    (b"out", 10),
    (b"nov", 11),
    (b"dec", 12),
    (b"dez", 12),
    (b"dic", 12),
    (b"d\xE9c", 12),
    (b"d\xC3\xA9c", 12),
];

/// Signs after the number of a month in Chinese and Japanese: `9月` in UTF-8, GBK and Shift JIS.
const MONTH_SIGNS: &[&[u8]] = &[b"\xE6\x9C\x88", b"\xD4\xC2", b"\x8C\x8E"];

/// Start of ignored lines, in lower case.
const SILENT: &[&[u8]] =
    &[b"internal events logged", b"no internal events logged", b"end triggerblock", b"//"];

/// Content of a line without a time.
#[derive(Debug, PartialEq, Eq)]
pub(super) enum AscHeader {
    /// Start of the measurement, in nanoseconds since 1970, read as UTC.
    Date(i64),
    /// Start of a block by a trigger; the date is optional.
    TriggerBlock(Option<i64>),
    /// Format of numbers and times.
    Base {
        /// Base of identifiers and data.
        base: NumberBase,
        /// Whether times are relative to the previous line.
        relative: bool,
    },
    /// Ignored line.
    Silent,
}

/// Parses a line that does not begin with a time; the error contains the expected content.
pub(super) fn parse_header(line: &[u8]) -> Result<AscHeader, &'static str> {
    const DATE: &str = "date: expected weekday, month, day, time and year";
    if SILENT.iter().any(|start| begins_with(line, start)) {
        return Ok(AscHeader::Silent);
    }
    let mut words = ColumnWords::new(line);
    let first = words.next().unwrap_or_default();
    if first.eq_ignore_ascii_case(b"date") {
        return parse_date(words.remaining_text()).map(AscHeader::Date).ok_or(DATE);
    }
    if first.eq_ignore_ascii_case(b"base") {
        return parse_base(words).ok_or("base: expected hex or dec");
    }
    let second = words.next().unwrap_or_default();
    if first.eq_ignore_ascii_case(b"begin") && second.eq_ignore_ascii_case(b"triggerblock") {
        let rest = words.remaining_text().trim_ascii();
        let date = parse_date(rest);
        let is_blank = rest.is_empty();
        return if date.is_some() || is_blank { Ok(AscHeader::TriggerBlock(date)) } else { Err(DATE) };
    }
    Err("expected a time in seconds or a header line")
}

fn begins_with(line: &[u8], start: &[u8]) -> bool {
    line.get(..start.len()).is_some_and(|found| found.eq_ignore_ascii_case(start))
}

/// Parses `hex  timestamps absolute`; without `timestamps` the times are absolute.
fn parse_base(mut words: ColumnWords<'_>) -> Option<AscHeader> {
    let base = match words.next()?.to_ascii_lowercase().as_slice() {
        b"hex" => NumberBase::Hex,
        b"dec" => NumberBase::Decimal,
        _ => return None,
    };
    let stamps = words.next().is_some_and(|word| word.eq_ignore_ascii_case(b"timestamps"));
    let relative = stamps && words.next().is_some_and(|word| word.eq_ignore_ascii_case(b"relative"));
    Some(AscHeader::Base { base, relative })
}

type Parsed<'a, T> = IResult<&'a [u8], T>;

/// Parses a date as UTC: `Sam Sep 30 15:06:13.191 2017`, `Fri May 18 12:14:42 am 2012`.
fn parse_date(input: &[u8]) -> Option<i64> {
    let fields = (
        preceded(space0, parse_word),
        map_opt(parse_word, month_number),
        terminated(parse_number(2), space1),
        parse_clock,
        opt(terminated(half_of_day, space1)),
        terminated(parse_number(4), space0),
    );
    let (_, (_, month, day, [hour, minute, second, fraction], half, year)) =
        all_consuming(fields).parse(input).ok()?;
    let hour = match half {
        // Some locales write am or pm after 24-hour times; it is then ignored.
        Some(true) if hour < 12 => hour + 12,
        Some(false) if hour == 12 => 0,
        _ => hour,
    };
    from_utc([year, month, day, hour, minute, second], fraction)
}

fn parse_word(input: &[u8]) -> Parsed<'_, &[u8]> {
    terminated(take_till1(|byte: u8| byte.is_ascii_whitespace()), space1).parse(input)
}

fn month_number(word: &[u8]) -> Option<i64> {
    let word = word.to_ascii_lowercase();
    if let Some(digits) = MONTH_SIGNS.iter().find_map(|sign| word.strip_suffix(*sign)) {
        return NumberBase::Decimal.parse_byte(digits).map(i64::from);
    }
    MONTHS.iter().find(|(start, _)| word.starts_with(start)).map(|(_, month)| *month)
}

fn parse_number<'a>(most: usize) -> impl Parser<&'a [u8], Output = i64, Error = nom::error::Error<&'a [u8]>> {
    verify(digit1, move |digits: &[u8]| digits.len() <= most)
        .map(|digits: &[u8]| digits.iter().fold(0, |value, digit| value * 10 + i64::from(digit - b'0')))
}

/// Parses `15:06:13.191` into hour, minute, second and nanoseconds.
fn parse_clock(input: &[u8]) -> Parsed<'_, [i64; 4]> {
    let (rest, (hour, _, minute, _)) =
        (parse_number(2), char(':'), parse_number(2), char(':')).parse(input)?;
    let second = map_opt(parse_word, |text| parse_time(text, SECOND));
    let (rest, second) = verify(second, |second| *second < 61 * SECOND).parse(rest)?;
    Ok((rest, [hour, minute, second / SECOND, second % SECOND]))
}

/// Whether the time is pm.
fn half_of_day(input: &[u8]) -> Parsed<'_, bool> {
    let am = tag_no_case("am").map(|_| false);
    let pm = tag_no_case("pm").map(|_| true);
    nom::branch::alt((am, pm)).parse(input)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn dates_in_both_languages_and_both_clocks() {
        // `date -u -d '2017-09-30 15:06:13.191' +%s%N`
        let expected = Ok(AscHeader::Date(1_506_783_973_191_000_000));
        for line in [
            "date Sam Sep 30 15:06:13.191 2017",
            "date Sat Sep 30 15:06:13.191 2017",
            "date Sat Sep 30 03:06:13.191 pm 2017",
            "Date Samstag September 30 03:06:13.191 PM 2017",
            "date Sat Sep 30 15:06:13.191 pm 2017",
        ] {
            assert_eq!(parse_header(line.as_bytes()), expected, "{line}");
        }
        let midnight = parse_header(b"date Fri May 18 12:14:42 am 2012");
        assert_eq!(midnight, Ok(AscHeader::Date(1_337_300_082_000_000_000)));
        for march in [&b"M\xE4r"[..], b"M\xC3\xA4rz", b"Mrz", b"Mar"] {
            let line = [b"date Mit ", march, b" 1 00:00:00 2017"].concat();
            assert_eq!(
                parse_header(&line),
                Ok(AscHeader::Date(1_488_326_400_000_000_000)),
                "{}",
                line.escape_ascii()
            );
        }
    }

    #[test]
    fn months_in_other_languages() {
        for (word, month) in [
            (&b"sept."[..], 9),
            (b"ao\xC3\xBBt", 8),
            (b"f\xE9vr.", 2),
            (b"juin", 6),
            (b"juillet", 7),
            (b"Gen", 1),
            (b"ott", 10),
            (b"Dez", 12),
            (b"mei", 5),
            (b"9\xE6\x9C\x88", 9),
            (b"12\xD4\xC2", 12),
        ] {
            assert_eq!(month_number(word), Some(month), "{}", word.escape_ascii());
        }
        // `date -u -d '2024-03-21 10:10:10.123' +%s%N`
        let chinese = "date 周四 3月 21 10:10:10.123 2024".as_bytes();
        assert_eq!(parse_header(chinese), Ok(AscHeader::Date(1_711_015_810_123_000_000)));
        assert_eq!(month_number(b"13\xE6\x9C\x88"), Some(13), "refused as a date");
        assert!(parse_header("date 周四 13月 21 10:10:10.123 2024".as_bytes()).is_err());
    }

    #[test]
    fn dates_that_are_none() {
        for line in
            ["date Sat Foo 30 15:06:13 2017", "date Sat Feb 30 15:06:13 2017", "date", "date Sat Sep 30"]
        {
            assert!(parse_header(line.as_bytes()).is_err(), "{line}");
        }
    }

    #[test]
    fn base_and_kind_of_times() {
        let absolute = AscHeader::Base { base: NumberBase::Hex, relative: false };
        assert_eq!(parse_header(b"base hex  timestamps absolute"), Ok(absolute));
        let relative = AscHeader::Base { base: NumberBase::Decimal, relative: true };
        assert_eq!(parse_header(b"base dec timestamps relative"), Ok(relative));
        let bare = AscHeader::Base { base: NumberBase::Hex, relative: false };
        assert_eq!(parse_header(b"base hex  no internal events logged"), Ok(bare));
        assert!(parse_header(b"base oct").is_err());
    }

    #[test]
    fn trigger_blocks_and_silent_lines() {
        let date = Some(1_506_809_173_191_000_000);
        let line = b"Begin Triggerblock Sat Sep 30 10:06:13.191 PM 2017";
        assert_eq!(parse_header(line), Ok(AscHeader::TriggerBlock(date)));
        assert_eq!(parse_header(b"Begin TriggerBlock"), Ok(AscHeader::TriggerBlock(None)));
        for line in ["no internal events logged", "End TriggerBlock", "// version 9.0.0"] {
            assert_eq!(parse_header(line.as_bytes()), Ok(AscHeader::Silent), "{line}");
        }
        assert!(parse_header(b"anything else").is_err());
    }
}
