//! Times of lines: numbers with a unit, times of day, dates.

use super::layout::TimeForm;
use super::token::{TokenKind, split_date, split_unit};
use crate::capture::calendar::from_utc;
use crate::capture::column_list::ColumnUnit;
use crate::capture::text::columns::{parse_time, time_of_day};

/// One second in nanoseconds.
const SECOND: i64 = 1_000_000_000;

/// Meaning of the time of a line.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum TimeMeaning {
    /// UTC, or a number without a date.
    Universal,
    /// A date without a time zone.
    LocalDate,
    /// A time of day without a date.
    OfDay,
}

/// Time of a line, as far as its columns are read.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub(super) struct RowTime {
    /// Midnight of the date, in nanoseconds since 1970.
    date: Option<i64>,
    /// Time, or time of day, in nanoseconds.
    time: Option<i64>,
    is_of_day: bool,
    has_zone: bool,
}

impl RowTime {
    /// Adds a column; `None` if it cannot be read. Without a form, times are ignored.
    pub(super) fn add_token(&mut self, text: &[u8], kind: TokenKind, form: Option<TimeForm>) -> Option<()> {
        let Some(form) = form else { return Some(()) };
        match kind {
            TokenKind::Date => {
                let (day, time, zone) = split_date(text);
                self.has_zone |= !zone.is_empty();
                self.date = form.has_date.then(|| parse_day(day)).flatten();
                if !time.is_empty() && self.time.is_none() {
                    self.time = Some(parse_clock(time)?.checked_sub(parse_zone(zone)?)?);
                    self.is_of_day = true;
                }
            }
            // A second column of the same kind is ignored.
            _ if self.time.is_some() => {}
            TokenKind::Clock => {
                self.time = Some(parse_clock(text)?);
                self.is_of_day = true;
            }
            TokenKind::Hex | TokenKind::Fraction | TokenKind::Quantity => {
                self.time = Some(parse_number(text, form.unit?)?);
            }
            TokenKind::Word => return None,
        }
        Some(())
    }

    /// Whether no time was found.
    pub(super) fn is_missing(&self) -> bool {
        self.time.is_none()
    }

    /// Time in nanoseconds with its meaning.
    pub(super) fn nanoseconds(&self) -> Option<(i64, TimeMeaning)> {
        let time = self.time?;
        let zone = if self.has_zone { TimeMeaning::Universal } else { TimeMeaning::LocalDate };
        match self.date {
            Some(date) if self.is_of_day => Some((date.checked_add(time)?, zone)),
            _ if self.is_of_day => Some((time, TimeMeaning::OfDay)),
            _ => Some((time, TimeMeaning::Universal)),
        }
    }
}

/// Parses a number with sign, fraction and unit into nanoseconds.
fn parse_number(text: &[u8], unit: ColumnUnit) -> Option<i64> {
    let (number, symbol) = split_unit(text);
    let unit = match std::str::from_utf8(symbol).ok()? {
        "" => unit,
        symbol => ColumnUnit::of_word(symbol)?,
    };
    let is_negative = number.starts_with(b"-");
    let digits = number.strip_prefix(b"-").or(number.strip_prefix(b"+")).unwrap_or(number);
    let nanoseconds = match digits {
        // The usual form: up to 9 digits before the point and up to 9 after it.
        [b'.', ..] => parse_time(&[b"0", digits].concat(), unit.nanoseconds())?,
        _ => quick_time(digits, unit.nanoseconds()).or_else(|| parse_time(digits, unit.nanoseconds()))?,
    };
    Some(if is_negative { -nanoseconds } else { nanoseconds })
}

/// Parses a number of up to 18 digits whose nanoseconds fit; `None` leaves it to the general parser.
fn quick_time(digits: &[u8], unit: i64) -> Option<i64> {
    let mut value = 0_i64;
    let mut scale = 1_i64;
    let mut has_point = false;
    if digits.len() > 18 {
        return None;
    }
    for digit in digits {
        match digit {
            b'0'..=b'9' => {
                value = value * 10 + i64::from(digit - b'0');
                scale = if has_point { scale * 10 } else { scale };
            }
            b'.' | b',' if !has_point => has_point = true,
            _ => return None,
        }
    }
    if scale <= unit && unit % scale == 0 {
        return value.checked_mul(unit / scale);
    }
    // More digits than nanoseconds are truncated.
    (scale % unit == 0).then(|| value / (scale / unit))
}

/// Parses `12:01:22.5`, `12:01:22:1234` or `01:22.5` into nanoseconds.
fn parse_clock(text: &[u8]) -> Option<i64> {
    let mut colons = text.iter().enumerate().filter(|(_, byte)| **byte == b':').map(|(at, _)| at);
    let (first, second, third) = (colons.next()?, colons.next(), colons.next());
    if second.is_none() {
        let minutes = parse_time(text.get(..first)?, 60 * SECOND)?;
        return parse_time(text.get(first + 1..)?, SECOND)?.checked_add(minutes);
    }
    let Some(third) = third else { return time_of_day(text) };
    let whole = time_of_day(text.get(..third)?)?;
    let fraction = text.get(third + 1..)?;
    let parts = quick_time(fraction, 1)?;
    let scale = 10_i64.checked_pow(u32::try_from(fraction.len()).ok()?)?;
    whole.checked_add(parts.checked_mul(SECOND)? / scale)
}

/// Parses a zone, `Z`, `+02:00` or `-0530`, into nanoseconds east of Greenwich.
fn parse_zone(zone: &[u8]) -> Option<i64> {
    let (sign, digits) = match zone {
        [] | [b'Z' | b'z'] => return Some(0),
        [b'+', digits @ ..] => (1, digits),
        [b'-', digits @ ..] => (-1, digits),
        _ => return None,
    };
    let (hours, minutes) = match digits {
        [_, _] => (digits, &b"0"[..]),
        [_, _, b':', minutes @ ..] | [_, _, minutes @ ..] => (digits.get(..2)?, minutes),
        _ => return None,
    };
    let minutes = quick_time(hours, 1)?.checked_mul(60)?.checked_add(quick_time(minutes, 1)?)?;
    minutes.checked_mul(60 * SECOND)?.checked_mul(sign)
}

/// Midnight of `2024-05-01` or `01.05.2024` in nanoseconds since 1970.
fn parse_day(day: &[u8]) -> Option<i64> {
    let separator = day.iter().copied().find(|byte| !byte.is_ascii_digit())?;
    let mut parts = day.split(|byte| *byte == separator);
    let mut number = || quick_time(parts.next()?, 1);
    let (first, second, third) = (number()?, number()?, number()?);
    let [year, month, day] = if first > 31 { [first, second, third] } else { [third, second, first] };
    from_utc([year, month, day, 0, 0, 0], 0)
}
