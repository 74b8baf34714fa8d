//! Calendar dates in captures.

use jiff::Timestamp;
use jiff::civil::DateTime;
use jiff::tz::TimeZone;

/// Nanoseconds since 1970 of a UTC date `[year, month, day, hour, minute, second]`; `None` if the date is
/// invalid. Second 60 is read as 59.
pub(super) fn from_utc(date: [i64; 6], nanoseconds: i64) -> Option<i64> {
    let [year, month, day, hour, minute, second] = date;
    let date = DateTime::new(
        i16::try_from(year).ok()?,
        i8::try_from(month).ok()?,
        i8::try_from(day).ok()?,
        i8::try_from(hour).ok()?,
        i8::try_from(minute).ok()?,
        i8::try_from(second.min(59)).ok()?,
        i32::try_from(nanoseconds).ok()?,
    );
    let zoned = date.ok()?.to_zoned(TimeZone::UTC).ok()?;
    i64::try_from(zoned.timestamp().as_nanosecond()).ok()
}

/// The UTC date of a time in nanoseconds since 1970.
pub(super) fn to_date(nanoseconds: i64) -> DateTime {
    // An i64 of nanoseconds is always within the years 1677 to 2262.
    let time = Timestamp::from_nanosecond(nanoseconds.into()).unwrap_or_default();
    TimeZone::UTC.to_datetime(time)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn dates_count_from_1970() {
        assert_eq!(from_utc([1970, 1, 1, 0, 0, 1], 5), Some(1_000_000_005));
        // `date -u -d '2015-07-10 08:17:32' +%s`
        assert_eq!(from_utc([2015, 7, 10, 8, 17, 32], 0), Some(1_436_516_252_000_000_000));
        assert_eq!(to_date(1_436_516_252_000_000_005).to_string(), "2015-07-10T08:17:32.000000005");
    }

    #[test]
    fn there_is_no_thirtieth_of_february() {
        assert_eq!(from_utc([2024, 2, 30, 0, 0, 0], 0), None);
    }
}
