//! Fields of text captures: words separated by whitespace, and the numbers in them.

use nom::character::complete::{char, digit1, one_of};
use nom::combinator::{all_consuming, opt};
use nom::error::Error;
use nom::sequence::{preceded, terminated};
use nom::{IResult, Parser};

use crate::frame::{CanId, MAX_DATA};

/// Days from 1899-12-30, the epoch of Windows dates, to 1970-01-01.
pub(in crate::capture) const DAYS_BEFORE_1970: i128 = 25_569;

/// One day in nanoseconds.
pub(in crate::capture) const DAY: i128 = 86_400 * 1_000_000_000;

/// Words of a line, separated by spaces and tabs.
#[derive(Debug, Clone, Default)]
pub(in crate::capture) struct ColumnWords<'a> {
    rest: &'a [u8],
}

impl<'a> ColumnWords<'a> {
    /// Iterates over the words of `line`.
    pub(in crate::capture) fn new(line: &'a [u8]) -> Self {
        Self { rest: line }
    }

    /// Text after the words read so far.
    pub(in crate::capture) fn remaining_text(&self) -> &'a [u8] {
        self.rest
    }

    /// The next word, without advancing.
    pub(in crate::capture) fn peek(&self) -> Option<&'a [u8]> {
        self.clone().next()
    }
}

impl<'a> Iterator for ColumnWords<'a> {
    type Item = &'a [u8];

    #[inline]
    fn next(&mut self) -> Option<&'a [u8]> {
        let rest = self.rest.trim_ascii_start();
        let end = rest.iter().position(u8::is_ascii_whitespace).unwrap_or(rest.len());
        let (word, rest) = rest.split_at_checked(end)?;
        self.rest = rest;
        (!word.is_empty()).then_some(word)
    }
}

/// Number base of identifiers and data.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub(in crate::capture) enum NumberBase {
    /// Hexadecimal, without 0x.
    #[default]
    Hex,
    /// Decimal.
    Decimal,
}

impl NumberBase {
    /// Parses all of `word` as a number.
    #[inline]
    pub(in crate::capture) fn parse_number(self, word: &[u8]) -> Option<u32> {
        let radix: u32 = match self {
            Self::Hex => 16,
            Self::Decimal => 10,
        };
        if word.is_empty() {
            return None;
        }
        word.iter().try_fold(0_u32, |value, digit| {
            value.checked_mul(radix)?.checked_add(char::from(*digit).to_digit(radix)?)
        })
    }

    /// Parses `word` as a byte.
    pub(in crate::capture) fn parse_byte(self, word: &[u8]) -> Option<u8> {
        self.parse_number(word).and_then(|value| u8::try_from(value).ok())
    }
}

/// Parses the first `count` words as bytes; `None` if there are fewer.
pub(in crate::capture) fn parse_data<'a>(
    mut words: impl Iterator<Item = &'a [u8]>,
    count: usize,
    base: NumberBase,
) -> Option<[u8; MAX_DATA]> {
    let mut bytes = [0; MAX_DATA];
    for slot in bytes.get_mut(..count)? {
        *slot = base.parse_byte(words.next()?)?;
    }
    Some(bytes)
}

/// An identifier of the given type; `None` if the number exceeds its range.
pub(in crate::capture) fn parse_identifier(number: u32, extended: bool) -> Option<CanId> {
    match number {
        0..=0x7FF if !extended => Some(CanId::from_standard(u16::try_from(number).ok()?)),
        0..=0x1FFF_FFFF if extended => Some(CanId::from_extended(number)),
        _ => None,
    }
}

/// Parses `digits[.digits]` in units of `unit` nanoseconds into nanoseconds, truncated.
fn fixed_point(input: &[u8], unit: i128) -> IResult<&[u8], i128> {
    let (rest, (whole, fraction)) =
        all_consuming((digit1, opt(preceded(one_of(".,"), digit1)))).parse(input)?;
    let too_long = || nom::Err::Error(Error::new(input, nom::error::ErrorKind::TooLarge));
    let number = |digits: &[u8]| {
        (digits.len() <= 18)
            .then(|| digits.iter().fold(0_i128, |value, digit| value * 10 + i128::from(digit - b'0')))
    };
    let whole = number(whole).ok_or_else(too_long)?;
    let fraction: &[u8] = fraction.unwrap_or_default();
    // 18 decimals of a day resolve far below a nanosecond.
    let fraction = fraction.get(..18).unwrap_or(fraction);
    let parts = number(fraction).ok_or_else(too_long)?;
    let scale = 10_i128.pow(u32::try_from(fraction.len()).unwrap_or(18));
    Ok((rest, whole * unit + parts * unit / scale))
}

/// Parses a time such as `1234.5` in units of `unit` nanoseconds into nanoseconds.
pub(in crate::capture) fn parse_time(word: &[u8], unit: i64) -> Option<i64> {
    let (_, nanoseconds) = fixed_point(word, unit.into()).ok()?;
    i64::try_from(nanoseconds).ok()
}

/// Parses hours, minutes and seconds, such as `00:30:06.866`, into nanoseconds; the hours have no upper limit.
pub(in crate::capture) fn time_of_day(word: &[u8]) -> Option<i64> {
    const SECOND: i64 = 1_000_000_000;
    let number = || {
        terminated(
            digit1::<_, Error<&[u8]>>.map_opt(|digits| NumberBase::Decimal.parse_number(digits)),
            char(':'),
        )
    };
    let (seconds, (hours, minutes)) = (number(), number()).parse(word).ok()?;
    let minutes = i64::from(hours).checked_mul(60)?.checked_add(minutes.into())?;
    parse_time(seconds, SECOND)?.checked_add(minutes.checked_mul(60 * SECOND)?)
}

/// Converts days since 1899-12-30 (UTC) to nanoseconds since 1970.
///
/// The digits are parsed as integers: a double cannot represent both the date and microseconds.
pub(in crate::capture) fn windows_date(word: &[u8]) -> Option<i64> {
    let (_, nanoseconds) = fixed_point(word, DAY).ok()?;
    i64::try_from(nanoseconds - DAYS_BEFORE_1970 * DAY).ok()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn words_are_cut_at_blanks_and_tabs() {
        let mut words = ColumnWords::new(b"  1)\t 12.5 Rx  ");
        assert_eq!(words.peek(), Some(&b"1)"[..]));
        assert_eq!(words.by_ref().take(2).collect::<Vec<_>>(), [&b"1)"[..], b"12.5"]);
        assert_eq!(words.remaining_text(), b" Rx  ");
        assert_eq!(words.next(), Some(&b"Rx"[..]));
        assert_eq!(words.next(), None);
    }

    #[test]
    fn times_keep_every_digit() {
        assert_eq!(parse_time(b"17535.4", 1_000_000), Some(17_535_400_000));
        assert_eq!(parse_time(b"0.200", 1_000_000), Some(200_000));
        assert_eq!(parse_time(b"17535", 1_000_000), Some(17_535_000_000));
        assert_eq!(parse_time(b"30.806898123", 1_000_000_000), Some(30_806_898_123));
        for bad in ["", ".5", "1.", "1.5x", "-1", "9999999999999999999"] {
            assert_eq!(parse_time(bad.as_bytes(), 1_000_000), None, "{bad}");
        }
    }

    #[test]
    fn windows_dates_count_from_1970() {
        assert_eq!(windows_date(b"25569"), Some(0));
        assert_eq!(windows_date(b"25569.5"), Some(43_200_000_000_000));
        // `date -u -d '2021-12-18 14:28:07.062' +%s.%N`; ten digits of a day are 8.64 µs.
        let found = windows_date(b"44548.6028595139").unwrap();
        assert!((found - 1_639_837_687_062_000_000).abs() < 10_000, "{found}");
        assert_eq!(windows_date(b"43008.920986006946"), Some(1_506_809_173_191_000_134));
    }

    #[test]
    fn bytes_in_both_bases() {
        assert_eq!(NumberBase::Hex.parse_byte(b"fF"), Some(255));
        assert_eq!(NumberBase::Decimal.parse_byte(b"255"), Some(255));
        assert_eq!(NumberBase::Decimal.parse_byte(b"256"), None);
        assert_eq!(NumberBase::Decimal.parse_byte(b"1A"), None);
        assert_eq!(NumberBase::Hex.parse_number(b"1FFFFFFFF"), None);
        assert_eq!(parse_data(ColumnWords::new(b"01 02"), 3, NumberBase::Hex), None);
        assert_eq!(parse_data(ColumnWords::new(b"01 02"), 65, NumberBase::Hex), None);
    }
}
