//! Local times of recorders, and their conversion to UTC by the time zone that the user states.

use std::sync::Arc;

use jiff::Timestamp;
use jiff::civil::DateTime;
use jiff::tz::TimeZone;

use super::calendar::to_date;
use super::{Batch, Notice};
use crate::words::UNKNOWN_ZONE;

/// Size of a step back, in ns, from which the second of two equal hours is presumed; frames of several buses may be in disorder
/// by less.
const STEP_BACK: i64 = 60 * 1_000_000_000;

/// Time zones of recorders that store local times.
#[derive(Debug, Clone, Default)]
pub struct RecorderZones(Option<Arc<ZoneTable>>);

#[derive(Debug)]
struct ZoneTable {
    everywhere: Option<TimeZone>,
    buses: Vec<(String, TimeZone)>,
}

impl RecorderZones {
    /// No zone is known.
    pub const NONE: Self = Self(None);

    /// The zone of all captures, which takes precedence, and zones by bus name.
    pub fn new(everywhere: Option<TimeZone>, buses: Vec<(String, TimeZone)>) -> Self {
        let is_empty = everywhere.is_none() && buses.is_empty();
        Self((!is_empty).then(|| Arc::new(ZoneTable { everywhere, buses })))
    }

    fn zone_of(&self, bus: &str) -> Option<&TimeZone> {
        let table = self.0.as_deref()?;
        let of_bus = || table.buses.iter().find(|(name, _)| name == bus).map(|(_, zone)| zone);
        table.everywhere.as_ref().or_else(of_bus)
    }
}

/// Meaning of the times of a capture.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum TimeOrigin {
    /// UTC, or times without a date.
    Universal,
    /// Times count from this start, whose date is a local time: in nanoseconds since 1970, read as UTC.
    LocalStart(i64),
    /// Each time is a local date.
    LocalDates,
}

/// Converts local times to UTC.
#[derive(Debug, Clone, Default)]
pub(super) struct LocalClock {
    zones: RecorderZones,
    is_reported: bool,
    /// Start of the last conversion and its offset from UTC, in ns, if it is the same zone for all buses.
    start: Option<(i64, i64)>,
    /// Latest converted time.
    latest: Option<i64>,
}

impl LocalClock {
    pub(super) fn new(zones: &RecorderZones) -> Self {
        Self { zones: zones.clone(), ..Self::default() }
    }

    /// Converts a time of `bus`, in nanoseconds since 1970 read as UTC. An unknown zone is reported once.
    pub(super) fn convert_time(
        &mut self,
        time: i64,
        origin: TimeOrigin,
        bus: &str,
        batch: &mut Batch,
    ) -> i64 {
        let start = match origin {
            TimeOrigin::Universal => return time,
            TimeOrigin::LocalStart(start) => Some(start),
            TimeOrigin::LocalDates => None,
        };
        let Some(zone) = self.zones.zone_of(bus) else {
            if !std::mem::replace(&mut self.is_reported, true) {
                batch.add_notice(Notice::Assumption(UNKNOWN_ZONE.into()));
            }
            return time;
        };
        let Some(start) = start else {
            let converted = convert_date(zone, time, self.latest);
            self.latest = Some(self.latest.map_or(converted, |latest| latest.max(converted)));
            return converted;
        };
        // The clock of a recorder that counts from its start does not change within the capture.
        let is_known = |known: &&(i64, i64)| known.0 == start;
        let has_one_zone = self.zones.0.as_deref().is_some_and(|table| table.everywhere.is_some());
        let known = self.start.as_ref().filter(|_| has_one_zone).filter(is_known);
        let offset = known
            .map_or_else(|| start.saturating_sub(convert_date(zone, start, None)), |(_, offset)| *offset);
        self.start = Some((start, offset));
        time.saturating_sub(offset)
    }
}

/// UTC of a local date. Of the two times in a repeated hour, the earlier one, unless times then step back.
fn convert_date(zone: &TimeZone, local: i64, latest: Option<i64>) -> i64 {
    let date: DateTime = to_date(local);
    let found = zone.to_ambiguous_timestamp(date);
    let nanoseconds = |time: Timestamp| i64::try_from(time.as_nanosecond()).unwrap_or(local);
    let earlier = found.compatible().map_or(local, nanoseconds);
    let steps_back = latest.is_some_and(|latest| earlier.saturating_add(STEP_BACK) < latest);
    if steps_back && found.is_ambiguous() {
        return found.later().map_or(earlier, nanoseconds);
    }
    earlier
}

#[cfg(test)]
mod tests {
    use super::*;

    const HOUR: i64 = 3_600 * 1_000_000_000;
    const MINUTE: i64 = HOUR / 60;

    /// Zone of Berlin: UTC+1, and UTC+2 from the last Sunday of March, 02:00, to that of October, 03:00.
    fn berlin() -> TimeZone {
        TimeZone::posix("CET-1CEST,M3.5.0,M10.5.0/3").unwrap()
    }

    fn local(date: &str) -> i64 {
        let date: DateTime = date.parse().unwrap();
        let utc = date.to_zoned(TimeZone::UTC).unwrap();
        i64::try_from(utc.timestamp().as_nanosecond()).unwrap()
    }

    fn clock() -> (LocalClock, Batch) {
        (LocalClock::new(&RecorderZones::new(Some(berlin()), Vec::new())), Batch::new())
    }

    #[test]
    fn dates_are_converted_on_both_sides_of_daylight_saving_time() {
        let (mut clock, mut batch) = clock();
        for (date, hours) in [
            ("2024-01-15T12:00", 1),
            ("2024-03-31T01:59:59", 1),
            ("2024-03-31T03:00", 2),
            ("2024-07-01T12:00", 2),
            ("2024-10-27T01:59", 2),
            ("2024-10-27T03:00", 1),
        ] {
            let time = local(date);
            assert_eq!(
                clock.convert_time(time, TimeOrigin::LocalDates, "1", &mut batch),
                time - hours * HOUR
            );
        }
        assert!(batch.is_empty());
    }

    #[test]
    fn the_repeated_hour_is_later_once_the_times_step_back() {
        let (mut clock, mut batch) = clock();
        let start = local("2024-10-27T02:00");
        let minutes = [0, 30, 59, 58, 1, 40, 59];
        let found = minutes.map(|minute| {
            let time = clock.convert_time(start + minute * MINUTE, TimeOrigin::LocalDates, "1", &mut batch);
            (time - start + 2 * HOUR) / MINUTE
        });
        assert_eq!(found, [0, 30, 59, 58, 61, 100, 119]);
    }

    #[test]
    fn a_recorder_that_counts_from_its_start_has_one_offset() {
        let (mut clock, mut batch) = clock();
        let start = local("2024-03-31T01:30");
        let origin = TimeOrigin::LocalStart(start);
        for later in [0, HOUR, 24 * HOUR] {
            let time = clock.convert_time(start + later, origin, "1", &mut batch);
            assert_eq!(time, start - HOUR + later);
        }
        let summer = local("2024-04-01T00:00");
        let time = clock.convert_time(summer, TimeOrigin::LocalStart(summer), "1", &mut batch);
        assert_eq!(time, summer - 2 * HOUR, "a second start in one capture");
    }

    #[test]
    fn a_bus_has_its_own_zone_unless_one_is_stated_for_all() {
        let tokyo = TimeZone::posix("JST-9").unwrap();
        let buses = vec![("1".to_owned(), berlin()), ("2".to_owned(), tokyo)];
        let time = local("2024-01-15T12:00");
        let convert = |zones: &RecorderZones| {
            let (mut clock, mut batch) = (LocalClock::new(zones), Batch::new());
            let mut hours =
                |bus: &str, origin| (time - clock.convert_time(time, origin, bus, &mut batch)) / HOUR;
            let hours = [
                hours("1", TimeOrigin::LocalStart(time)),
                hours("2", TimeOrigin::LocalStart(time)),
                hours("3", TimeOrigin::LocalDates),
                hours("3", TimeOrigin::LocalDates),
                hours("1", TimeOrigin::Universal),
            ];
            (hours, batch.notices().len())
        };
        assert_eq!(convert(&RecorderZones::new(None, buses.clone())), ([1, 9, 0, 0, 0], 1));
        assert_eq!(convert(&RecorderZones::new(Some(TimeZone::UTC), buses)), ([0; 5], 0));
        assert_eq!(convert(&RecorderZones::NONE), ([0; 5], 1));
    }
}
