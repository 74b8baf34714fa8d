//! Timestamps at the start of candump lines: seconds, or a date without time zone.

use nom::branch::alt;
use nom::bytes::complete::take_while_m_n;
use nom::character::complete::{char, digit1, space0, space1};
use nom::combinator::{opt, verify};
use nom::sequence::{delimited, preceded};
use nom::{IResult, Parser};

use crate::capture::calendar::from_utc;

type Parsed<'a, T> = IResult<&'a [u8], T>;

/// Parses the timestamp in nanoseconds, if any, and whether it is a date.
pub(in crate::capture::formats) fn leading_stamp(line: &[u8]) -> Parsed<'_, (Option<i64>, bool)> {
    let (rest, _) = space0(line)?;
    if rest.first() != Some(&b'(') {
        return Ok((rest, (None, false)));
    }
    let (rest, stamp) =
        delimited(char('('), alt((parse_seconds, parse_date)), (char(')'), space1)).parse(rest)?;
    Ok((rest, (Some(stamp.0), stamp.1)))
}

fn parse_seconds(input: &[u8]) -> Parsed<'_, (i64, bool)> {
    let (rest, negative) = opt(char('-')).parse(input)?;
    let (rest, whole) = verify(digit1, |digits: &[u8]| digits.len() <= 10).parse(rest)?;
    let (rest, nanoseconds) = parse_fraction(rest)?;
    let value = decimal_value(whole).saturating_mul(1_000_000_000).saturating_add(nanoseconds);
    Ok((rest, (if negative.is_some() { -value } else { value }, false)))
}

fn parse_fraction(input: &[u8]) -> Parsed<'_, i64> {
    let (rest, digits) = preceded(char('.'), verify(digit1, |d: &[u8]| d.len() <= 9)).parse(input)?;
    let scale = 10_i64.pow(9_u32.saturating_sub(u32::try_from(digits.len()).unwrap_or(9)));
    Ok((rest, decimal_value(digits).saturating_mul(scale)))
}

pub(super) fn decimal_value(digits: &[u8]) -> i64 {
    digits.iter().fold(0_i64, |value, digit| {
        value.saturating_mul(10).saturating_add(i64::from(digit.wrapping_sub(b'0')))
    })
}

/// Parses `2024-05-01 08:17:32.249713` as UTC.
fn parse_date(input: &[u8]) -> Parsed<'_, (i64, bool)> {
    let number = |count| take_while_m_n(count, count, |c: u8| c.is_ascii_digit()).map(decimal_value);
    let invalid = || nom::Err::Error(nom::error::Error::new(input, nom::error::ErrorKind::Verify));
    let (rest, (year, _, month, _, day)) =
        (number(4), char('-'), number(2), char('-'), number(2)).parse(input)?;
    let (rest, _) = alt((char(' '), char('T'))).parse(rest)?;
    let (rest, (hour, _, minute, _, second)) =
        (number(2), char(':'), number(2), char(':'), number(2)).parse(rest)?;
    let (rest, nanoseconds) = parse_fraction(rest)?;
    let stamp = from_utc([year, month, day, hour, minute, second], nanoseconds).ok_or_else(invalid)?;
    Ok((rest, (stamp, true)))
}
