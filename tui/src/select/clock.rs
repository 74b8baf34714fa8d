//! Wall-clock times: a date, a time of day, or both, in UTC, in the time zone of the computer, or with an
//! offset.

use cobscope_decoder::frame::Timestamp;
use jiff::civil::{Date, DateTime, Time};
use jiff::tz::{AmbiguousOffset, Offset, TimeZone};

/// Maximum number of days in which a time of day is searched.
const MOST_DAYS: usize = 4_000;

/// Maximum number of candidates that an error lists.
const LISTED: usize = 6;

/// Use of a bound.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum BoundSide {
    /// `--from`.
    From,
    /// `--to`.
    To,
    /// `--at`.
    At,
}

impl BoundSide {
    pub(super) const fn option_name(self) -> &'static str {
        match self {
            Self::From => "--from",
            Self::To => "--to",
            Self::At => "--at",
        }
    }
}

/// A wall-clock time; without a date, its day is that of the capture.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct ClockTime {
    date: Option<Date>,
    time: Option<Time>,
    zone: ClockZone,
}

/// Form of a date.
const DATE: &str = "YYYY-MM-DD";

/// Time zone of a wall-clock time.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum ClockZone {
    Utc,
    /// The time zone of the computer.
    Local,
    Offset(Offset),
}

impl ClockZone {
    fn time_zone(self) -> TimeZone {
        match self {
            Self::Utc => TimeZone::UTC,
            Self::Local => TimeZone::system(),
            Self::Offset(offset) => TimeZone::fixed(offset),
        }
    }
}

impl ClockTime {
    /// Parses `22:13:25`, `22:13`, `2024-01-31`, `2024-01-31 22:13:25`; UTC unless `local` or an offset such as
    /// `+01:00` follows.
    pub(super) fn parse(text: &str) -> Option<Self> {
        let (text, zone) = zone_of(text.trim());
        let has_date = text.as_bytes().get(4) == Some(&b'-');
        let (date, time) = match (has_date, text.contains(':')) {
            (true, true) => {
                let both: DateTime = text.parse().ok()?;
                (Some(both.date()), Some(both.time()))
            }
            // The parser of dates drops an hour without minutes.
            (true, false) if text.len() == DATE.len() => (Some(text.parse().ok()?), None),
            (false, true) => (None, Some(text.parse().ok()?)),
            (_, false) => return None,
        };
        Some(Self { date, time, zone })
    }

    /// As [`Self::parse`], in the time zone of the computer; None if the text names a zone.
    pub(super) fn parse_local(text: &str) -> Option<Self> {
        let text = text.trim();
        let is_bare = zone_of(text).0.len() == text.len();
        Self::parse(text).filter(|_| is_bare).map(|clock| Self { zone: ClockZone::Local, ..clock })
    }

    /// The moment of a date and time in UTC or with an offset, which does not depend on a capture.
    pub(super) fn fixed_moment(self) -> Option<Timestamp> {
        if self.zone == ClockZone::Local {
            return None;
        }
        let local = self.date?.to_datetime(self.time?);
        local_instants(local, &self.zone.time_zone()).first().copied()
    }

    /// The moment in a capture with timestamps from `first` to `last`.
    ///
    /// # Errors
    /// If the capture has no dates, or the time occurs several times or never.
    pub fn moment_in(self, first: Timestamp, last: Timestamp) -> Result<Timestamp, String> {
        if !first.has_date() {
            return Err("times count from the start of the capture; enter seconds".into());
        }
        self.resolve_side(BoundSide::At, first, last)
    }

    /// Whether the day is known without the capture.
    pub(super) fn has_date(self) -> bool {
        self.date.is_some()
    }

    /// The moment in a capture with timestamps from `first` to `last`. A date is its first instant, as the end
    /// of a range its last one.
    ///
    /// # Errors
    /// If the time occurs several times, or never; the text lists the candidates.
    pub(super) fn resolve_side(
        self,
        side: BoundSide,
        first: Timestamp,
        last: Timestamp,
    ) -> Result<Timestamp, String> {
        let zone = self.zone.time_zone();
        match (self.date, self.time) {
            (Some(date), None) => {
                day_edge(date, side, &zone).ok_or_else(|| format!("{date}: date out of range"))
            }
            (Some(date), Some(time)) => {
                let shown = format!("{date} {time}");
                let all = local_instants(date.to_datetime(time), &zone);
                if all.is_empty() {
                    return Err(format!("{shown} does not exist: the clock was set forward"));
                }
                choose_moment(&shown, &all, (first, last), &zone)
            }
            (None, Some(time)) => {
                let all = on_each_day(time, first, last, &zone);
                choose_moment(&time.to_string(), &all, (first, last), &zone)
            }
            (None, None) => Err("neither a date nor a time".into()),
        }
    }
}

/// A moment as a time of day with `decimals` of a second; with `has_date` month and day before it.
pub fn wall_clock(time: Timestamp, is_local: bool, has_date: bool, decimals: u32) -> String {
    let zone = if is_local { TimeZone::system() } else { TimeZone::UTC };
    written_clock(time, zone, has_date, decimals)
}

fn written_clock(time: Timestamp, zone: TimeZone, has_date: bool, decimals: u32) -> String {
    let zoned = to_moment(time).to_zoned(zone);
    let format = if has_date { "%m-%d %H:%M:%S" } else { "%H:%M:%S" };
    let fraction = time.0.rem_euclid(1_000_000_000);
    let fraction = fraction / 10_i64.pow(9_u32.saturating_sub(decimals));
    format!("{}.{fraction:0width$}", zoned.strftime(format), width = decimals.min(9) as usize)
}

/// Whether two moments are on different days.
pub fn spans_days(first: Timestamp, last: Timestamp, is_local: bool) -> bool {
    let zone = if is_local { TimeZone::system() } else { TimeZone::UTC };
    to_moment(first).to_zoned(zone.clone()).date() != to_moment(last).to_zoned(zone).date()
}

/// Text without its time zone.
fn zone_of(text: &str) -> (&str, ClockZone) {
    if let Some(text) = text.strip_suffix("local") {
        return (text.trim_end(), ClockZone::Local);
    }
    for suffix in ["UTC", "Z", "z"] {
        if let Some(text) = text.strip_suffix(suffix) {
            return (text.trim_end(), ClockZone::Utc);
        }
    }
    let after_time = text.find(':').unwrap_or(text.len());
    let sign = text.rfind(['+', '-']).filter(|at| *at > after_time);
    let parts = sign.and_then(|at| Some((text.get(..at)?, text.get(at..)?)));
    match parts.and_then(|(text, offset)| Some((text, offset_of(offset)?))) {
        Some((text, offset)) => (text.trim_end(), ClockZone::Offset(offset)),
        None => (text, ClockZone::Utc),
    }
}

/// `+01:00`, `-0330`, `+2`.
fn offset_of(text: &str) -> Option<Offset> {
    let digits: String = text.get(1..)?.chars().filter(|character| *character != ':').collect();
    let is_number = !digits.is_empty() && digits.bytes().all(|digit| digit.is_ascii_digit());
    let number: i32 = digits.parse().ok().filter(|_| is_number)?;
    let (hours, minutes) = if digits.len() > 2 { (number / 100, number % 100) } else { (number, 0) };
    let seconds = (hours * 60 + minutes) * 60;
    Offset::from_seconds(if text.starts_with('-') { -seconds } else { seconds }).ok()
}

fn to_nanoseconds(moment: jiff::Timestamp) -> Option<Timestamp> {
    i64::try_from(moment.as_nanosecond()).ok().map(Timestamp)
}

fn to_moment(time: Timestamp) -> jiff::Timestamp {
    jiff::Timestamp::from_nanosecond(time.0.into()).unwrap_or_default()
}

/// First or last instant of a day.
fn day_edge(date: Date, side: BoundSide, zone: &TimeZone) -> Option<Timestamp> {
    let start = |date: Date| to_nanoseconds(date.to_zoned(zone.clone()).ok()?.timestamp());
    match side {
        BoundSide::To => Some(start(date.tomorrow().ok()?)?.plus(-1)),
        BoundSide::From | BoundSide::At => start(date),
    }
}

/// Instants of a local date and time: two if the clock was set back, none if it was set forward.
fn local_instants(local: DateTime, zone: &TimeZone) -> Vec<Timestamp> {
    let offsets = match zone.to_ambiguous_timestamp(local).offset() {
        AmbiguousOffset::Unambiguous { offset } => vec![offset],
        AmbiguousOffset::Fold { before, after } => vec![before, after],
        AmbiguousOffset::Gap { .. } => Vec::new(),
    };
    offsets.into_iter().filter_map(|offset| to_nanoseconds(offset.to_timestamp(local).ok()?)).collect()
}

/// Instants of a time of day on all days of the capture.
fn on_each_day(time: Time, first: Timestamp, last: Timestamp, zone: &TimeZone) -> Vec<Timestamp> {
    let date = |time: Timestamp| to_moment(time).to_zoned(zone.clone()).date();
    let end = date(last);
    let days = std::iter::successors(Some(date(first)), |day| day.tomorrow().ok());
    let days = days.take_while(|day| *day <= end).take(MOST_DAYS);
    days.flat_map(|day| local_instants(day.to_datetime(time), zone)).collect()
}

/// The only candidate in the capture, or the only one at all.
fn choose_moment(
    shown: &str,
    all: &[Timestamp],
    (first, last): (Timestamp, Timestamp),
    zone: &TimeZone,
) -> Result<Timestamp, String> {
    let inside: Vec<Timestamp> = all.iter().copied().filter(|time| (first..=last).contains(time)).collect();
    match (inside.as_slice(), all) {
        ([one], _) | ([], [one]) => return Ok(*one),
        _ => {}
    }
    let written = |time: &Timestamp| {
        let zoned = to_moment(*time).to_zoned(zone.clone());
        format!("{}{}", zoned.datetime(), written_offset(zoned.offset()))
    };
    let range = format!("{} to {}", written(&first), written(&last));
    let (candidates, reason) = if inside.is_empty() {
        (all, format!("{shown} does not occur in the capture ({range})"))
    } else {
        (inside.as_slice(), format!("{shown} occurs {} times in the capture", inside.len()))
    };
    let mut texts: Vec<String> = candidates.iter().take(LISTED).map(written).collect();
    if candidates.len() > LISTED {
        texts.push("…".into());
    }
    if texts.is_empty() {
        return Err(format!("{reason}; give a date"));
    }
    Err(format!("{reason}; give one of {}", texts.join(", ")))
}

/// `Z`, `+01:00`.
fn written_offset(offset: Offset) -> String {
    let minutes = offset.seconds() / 60;
    if minutes == 0 {
        return "Z".to_owned();
    }
    let sign = if minutes < 0 { '-' } else { '+' };
    format!("{sign}{:02}:{:02}", minutes.abs() / 60, minutes.abs() % 60)
}

#[cfg(test)]
mod tests {
    use super::*;

    const HOUR: i64 = 3_600_000_000_000;

    fn moment_in(text: &str) -> Timestamp {
        to_nanoseconds(text.parse().unwrap()).unwrap()
    }

    fn resolved(text: &str, first: &str, last: &str) -> Result<Timestamp, String> {
        ClockTime::parse(text).unwrap().resolve_side(BoundSide::From, moment_in(first), moment_in(last))
    }

    #[test]
    fn a_time_of_day_is_that_of_the_capture() {
        let (first, last) = ("2023-11-14T22:13:20Z", "2023-11-14T22:30:00Z");
        assert_eq!(resolved("22:13:25", first, last), Ok(moment_in("2023-11-14T22:13:25Z")));
        assert_eq!(resolved("22:14", first, last), Ok(moment_in("2023-11-14T22:14:00Z")));
        assert_eq!(resolved("23:13:25.5+01:00", first, last), Ok(moment_in("2023-11-14T22:13:25.5Z")));
        // Outside a capture of one day: before it, or after it.
        assert_eq!(resolved("22:00", first, last), Ok(moment_in("2023-11-14T22:00:00Z")));
    }

    #[test]
    fn an_hour_without_minutes_is_no_date() {
        for text in ["2023-11-15T22", "2023-11-15 22", "2023-11-15T22 local", "2023-11-15T22Z", "2023-11-155"]
        {
            assert!(ClockTime::parse(text).is_none_or(|clock| clock.time.is_some()), "{text}");
        }
        assert!(ClockTime::parse("2023-11-15").is_some_and(|clock| clock.time.is_none()));
        assert!(ClockTime::parse("2023-11-15 local").is_some_and(|clock| clock.time.is_none()));
    }

    #[test]
    fn a_time_of_several_days_is_an_error_with_the_candidates() {
        let (first, last) = ("2023-11-14T22:13:20Z", "2023-11-16T01:00:00Z");
        let error = resolved("22:30", first, last).unwrap_err();
        assert_eq!(
            error,
            "22:30:00 occurs 2 times in the capture; give one of 2023-11-14T22:30:00Z, 2023-11-15T22:30:00Z"
        );
        assert_eq!(resolved("12:00", first, last), Ok(moment_in("2023-11-15T12:00:00Z")));
        // Over midnight: neither noon is in the capture.
        let error = resolved("12:00", first, "2023-11-15T01:00:00Z").unwrap_err();
        assert!(error.contains("does not occur in the capture (2023-11-14T22:13:20Z to"), "{error}");
        assert!(error.ends_with("give one of 2023-11-14T12:00:00Z, 2023-11-15T12:00:00Z"), "{error}");
    }

    #[test]
    fn a_moment_is_written_in_its_zone() {
        let time = moment_in("2023-11-14T23:13:20.0125Z");
        let berlin = || TimeZone::posix("CET-1CEST,M3.5.0,M10.5.0/3").unwrap();
        assert_eq!(written_clock(time, TimeZone::UTC, false, 3), "23:13:20.012");
        assert_eq!(written_clock(time, berlin(), true, 6), "11-15 00:13:20.012500");
        assert!(!spans_days(time, time.plus(1), false) && spans_days(time, time.plus(HOUR), false));
    }

    #[test]
    fn a_time_without_zone_is_local_on_request() {
        let local = ClockTime::parse_local(" 22:13:25.5 ").unwrap();
        assert_eq!(local, ClockTime::parse("22:13:25.5 local").unwrap());
        for text in ["22:13:25Z", "22:13:25+01:00", "22:13 local", "12.5"] {
            assert_eq!(ClockTime::parse_local(text), None, "{text}");
        }
    }

    #[test]
    fn a_date_is_a_whole_day() {
        let date = ClockTime::parse("2023-11-14").unwrap();
        let of = |side| date.resolve_side(side, Timestamp(0), Timestamp(0));
        assert_eq!(of(BoundSide::From), Ok(moment_in("2023-11-14T00:00:00Z")));
        assert_eq!(of(BoundSide::To), Ok(moment_in("2023-11-15T00:00:00Z").plus(-1)));
    }

    #[test]
    fn a_clock_change_makes_an_hour_ambiguous_and_another_one_impossible() {
        // Berlin, 2026: set forward on 29 March at 02:00, set back on 25 October at 03:00.
        let zone = TimeZone::posix("CET-1CEST,M3.5.0,M10.5.0/3").unwrap();
        let local = |text: &str| local_instants(text.parse().unwrap(), &zone);
        assert_eq!(local("2026-03-29T02:30:00"), []);
        let both = [moment_in("2026-10-25T00:30:00Z"), moment_in("2026-10-25T01:30:00Z")];
        assert_eq!(local("2026-10-25T02:30:00"), both);
        let span = (both[0].plus(-HOUR), both[1].plus(HOUR));
        let error = choose_moment("02:30:00", &both, span, &zone).unwrap_err();
        assert_eq!(
            error,
            "02:30:00 occurs 2 times in the capture; give one of 2026-10-25T02:30:00+02:00, \
             2026-10-25T02:30:00+01:00"
        );
        // A capture that ends between the two contains one of them.
        assert_eq!(choose_moment("02:30:00", &both, (both[0], both[0].plus(1)), &zone), Ok(both[0]));
    }

    #[test]
    fn anything_else_is_refused() {
        for text in ["25:00", "22:13:25 mars", "2023-13-01", "12", "local", "22:13+99:00x"] {
            assert_eq!(ClockTime::parse(text), None, "{text}");
        }
    }
}
