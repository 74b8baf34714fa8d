//! Days of partitions, in UTC.

use std::fmt;

use jiff::civil::Date;

use crate::frame::Timestamp;

/// Nanoseconds per day.
const DAY: i64 = 86_400_000_000_000;

/// Day of a partition.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord)]
pub(super) enum PartitionDay {
    /// The row has no date: its capture has none, or the row is about the whole capture.
    Unknown,
    /// Date, UTC.
    Date(Date),
}

impl fmt::Display for PartitionDay {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::Unknown => f.write_str("unknown"),
            Self::Date(date) => date.fmt(f),
        }
    }
}

/// Converts times to days; most rows have the day of the row before them.
pub(super) struct DayCalendar {
    /// Day of everything without a date.
    undated: PartitionDay,
    /// Last day, as a number since 1970 and as a date.
    last: Option<(i64, PartitionDay)>,
}

impl DayCalendar {
    /// `given` is the day of a capture without a date.
    pub(super) fn new(given: Option<Date>) -> Self {
        Self { undated: given.map_or(PartitionDay::Unknown, PartitionDay::Date), last: None }
    }

    pub(super) fn day_of(&mut self, time: Option<Timestamp>) -> PartitionDay {
        let Some(time) = time.filter(|time| time.has_date()) else { return self.undated };
        let number = time.0.div_euclid(DAY);
        match self.last {
            Some((last, day)) if last == number => day,
            _ => {
                // 64 bits of nanoseconds end in the year 2262, within the range of dates.
                let instant = jiff::Timestamp::from_nanosecond(time.0.into());
                let day = instant.map_or(self.undated, |at| {
                    PartitionDay::Date(at.to_zoned(jiff::tz::TimeZone::UTC).date())
                });
                self.last = Some((number, day));
                day
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn days_are_those_of_utc() {
        let mut calendar = DayCalendar::new(None);
        let mut day = |seconds: i64, nanoseconds: i64| {
            calendar.day_of(Some(Timestamp(seconds * 1_000_000_000 + nanoseconds))).to_string()
        };
        // 2023-11-14T22:13:20Z is 1700000000; midnight follows 6,400 s later.
        assert_eq!(day(1_700_000_000, 0), "2023-11-14");
        assert_eq!(day(1_700_006_399, 999_999_999), "2023-11-14");
        assert_eq!(day(1_700_006_400, 0), "2023-11-15");
        assert_eq!(day(1_700_000_000, 0), "2023-11-14");
        assert_eq!(day(12, 0), "unknown");
        assert_eq!(calendar.day_of(None), PartitionDay::Unknown);
        assert_eq!(calendar.day_of(Some(Timestamp(i64::MAX))).to_string(), "2262-04-11");
    }

    #[test]
    fn a_given_day_is_that_of_times_without_a_date() {
        let mut calendar = DayCalendar::new(Some(jiff::civil::date(2024, 2, 29)));
        assert_eq!(calendar.day_of(Some(Timestamp(5))).to_string(), "2024-02-29");
        assert_eq!(calendar.day_of(None).to_string(), "2024-02-29");
        assert_eq!(calendar.day_of(Some(Timestamp(1_700_000_000_000_000_000))).to_string(), "2023-11-14");
    }
}
