//! Which events are printed: `--filter`, `--from`, `--to`. What is learnt of the bus does not depend on it,
//! so a capture is read to its end whatever `--to` says: later frames can complete or time out what began
//! before, and stamps can step back.

use std::cmp::Ordering;
use std::str::FromStr;

use anyhow::ensure;
use cobscope_decoder::event::Event;
use cobscope_decoder::frame::{Frame, Timestamp};
use cobscope_decoder::query::Filter;
use cobscope_decoder::session::Bus;
use jiff::tz::TimeZone;

use crate::figures::seconds;

/// Digits behind the point that a nanosecond needs.
const NANOSECOND_DIGITS: usize = 9;

/// One end of what is printed.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Bound {
    /// Nanoseconds from the first frame of the capture.
    Offset(i64),
    /// Number of a frame.
    Frame(u64),
    /// Nanoseconds since 1970, as in captures with absolute times.
    Moment(Timestamp),
}

/// `12.5`, `#1234`, `2024-01-31T12:00:00Z`; a date and time without zone is UTC, as `-t A` prints it.
impl FromStr for Bound {
    type Err = &'static str;

    fn from_str(text: &str) -> Result<Self, Self::Err> {
        if let Some(number) = text.strip_prefix('#') {
            return number.parse().map(Self::Frame).map_err(|_| "a frame is # and its number, as #1234");
        }
        if let Some(offset) = nanoseconds(text) {
            return Ok(Self::Offset(offset));
        }
        let moment = text.parse::<jiff::Timestamp>().or_else(|_| {
            let local: jiff::civil::DateTime = text.parse()?;
            local.to_zoned(TimeZone::UTC).map(|zoned| zoned.timestamp())
        });
        let nanoseconds = moment.ok().and_then(|moment| i64::try_from(moment.as_nanosecond()).ok());
        let moment = nanoseconds.map(|time| Self::Moment(Timestamp(time)));
        moment.ok_or("neither seconds (12.5), a frame (#1234) nor a time (2024-01-31T12:00:00Z)")
    }
}

impl Bound {
    /// Whether it lies behind `frame` of a capture that begins at `first`; a frame without time lies before every time.
    pub fn is_behind(self, frame: &Frame, first: Option<Timestamp>) -> bool {
        match self {
            Self::Frame(number) => frame.number < number,
            Self::Moment(moment) => frame.time.is_none_or(|time| time < moment),
            Self::Offset(offset) => {
                frame.time.zip(first).is_none_or(|(time, first)| time.since(first) < offset)
            }
        }
    }

    /// Whether it lies before `frame` of a capture that begins at `first`; a frame without time is never
    /// behind a time.
    pub fn is_before(self, frame: &Frame, first: Option<Timestamp>) -> bool {
        let behind = match self {
            Self::Frame(number) => Some(frame.number > number),
            Self::Moment(moment) => frame.time.map(|time| time > moment),
            Self::Offset(offset) => frame.time.zip(first).map(|(time, first)| time.since(first) > offset),
        };
        behind.unwrap_or(false)
    }
}

/// Refuses bounds between which nothing lies. Bounds of two sorts are compared by no capture.
///
/// # Errors
/// When `--from` is behind `--to`.
pub fn ensure_order(from: Option<Bound>, to: Option<Bound>) -> anyhow::Result<()> {
    let is_behind = match (from, to) {
        (Some(Bound::Offset(from)), Some(Bound::Offset(to))) => from > to,
        (Some(Bound::Frame(from)), Some(Bound::Frame(to))) => from > to,
        (Some(Bound::Moment(from)), Some(Bound::Moment(to))) => from > to,
        _ => false,
    };
    ensure!(!is_behind, "--from is behind --to: nothing lies between them");
    Ok(())
}

/// Seconds with at most nine digits behind the point.
fn nanoseconds(text: &str) -> Option<i64> {
    let (seconds, fraction) = text.split_once('.').unwrap_or((text, "0"));
    let is_number = [seconds, fraction]
        .iter()
        .all(|digits| !digits.is_empty() && digits.bytes().all(|digit| digit.is_ascii_digit()));
    if !is_number || fraction.len() > NANOSECOND_DIGITS {
        return None;
    }
    format!("{seconds}{fraction:0<NANOSECOND_DIGITS$}").parse().ok()
}

/// What the options of one command select, capture by capture.
#[derive(Debug, Default)]
pub struct Selection {
    filter: Option<Filter>,
    from: Option<Bound>,
    to: Option<Bound>,
    capture: Option<String>,
    first: Option<Timestamp>,
    /// An event was late enough.
    is_reached: bool,
}

impl Selection {
    /// # Errors
    /// If `from` is after `to`.
    pub fn new(filter: Option<Filter>, from: Option<Bound>, to: Option<Bound>) -> anyhow::Result<Self> {
        ensure_order(from, to)?;
        Ok(Self { filter, from, to, ..Self::default() })
    }

    /// Whether a filter chooses.
    pub fn has_filter(&self) -> bool {
        self.filter.is_some()
    }

    /// Names the capture whose events follow.
    pub fn set_capture(&mut self, name: &str) {
        self.capture = Some(name.to_owned());
        self.first = None;
        self.is_reached = false;
    }

    /// The first frame of the capture.
    ///
    /// # Errors
    /// When a time is asked for in a capture without times.
    pub fn begin(&mut self, first: &Frame) -> anyhow::Result<()> {
        self.first = first.time;
        let wants_times =
            [self.from, self.to].iter().flatten().any(|bound| !matches!(bound, Bound::Frame(_)));
        ensure!(first.time.is_some() || !wants_times, "has no times; give frames as --from #1234");
        Ok(())
    }

    /// What is said of a capture of which nothing was late enough, whose last frame has this number and stamp.
    pub fn missed(&self, frame: u64, last: Option<Timestamp>) -> Option<String> {
        let from = self.from.filter(|_| !self.is_reached)?;
        let at = match (from, last, self.first) {
            (Bound::Moment(_), Some(last), _) => jiff::Timestamp::from_nanosecond(last.0.into())
                .map_or(String::new(), |at| format!(" at {at}")),
            (_, Some(last), Some(first)) => format!(" at {} s", seconds(last.since(first))),
            _ => String::new(),
        };
        Some(format!("nothing is as late as --from: its last frame is #{frame}{at}"))
    }

    /// Whether an event is to be printed. It counts by its last frame, and by its own time, which for a
    /// deadline is the deadline's; what comes before all times only has a beginning.
    pub fn admits(&mut self, event: &Event, bus: &Bus) -> bool {
        let is_late_enough =
            self.from.is_none_or(|from| self.order(event, from).is_some_and(Ordering::is_ge));
        self.is_reached |= is_late_enough;
        let is_early_enough = self.to.is_none_or(|to| self.order(event, to).is_none_or(Ordering::is_le));
        is_late_enough
            && is_early_enough
            && self.filter.as_ref().is_none_or(|filter| filter.matches(event, bus, self.capture.as_deref()))
    }

    /// Whether a frame lies between the bounds.
    pub fn admits_frame(&mut self, frame: &Frame) -> bool {
        let is_late_enough = !self.from.is_some_and(|from| from.is_behind(frame, self.first));
        self.is_reached |= is_late_enough;
        is_late_enough && !self.to.is_some_and(|to| to.is_before(frame, self.first))
    }

    /// On which side of a bound an event is; nothing for an event without time at a bound with one.
    fn order(&self, event: &Event, bound: Bound) -> Option<Ordering> {
        match bound {
            Bound::Frame(number) => Some(event.frames.last.cmp(&number)),
            Bound::Moment(moment) => Some(event.time?.cmp(&moment)),
            Bound::Offset(offset) => Some(event.time?.since(self.first?).cmp(&offset)),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn bound(text: &str) -> Result<Bound, &'static str> {
        text.parse()
    }

    #[test]
    fn seconds_frames_and_moments() {
        assert_eq!(bound("12.5"), Ok(Bound::Offset(12_500_000_000)));
        assert_eq!(bound("0"), Ok(Bound::Offset(0)));
        assert_eq!(bound("1.000000001"), Ok(Bound::Offset(1_000_000_001)));
        assert_eq!(bound("#1234"), Ok(Bound::Frame(1234)));
        let moment = Ok(Bound::Moment(Timestamp(1_700_000_000_020_000_000)));
        assert_eq!(bound("2023-11-14T22:13:20.02Z"), moment);
        assert_eq!(bound("2023-11-14T23:13:20.02+01:00"), moment);
        assert_eq!(bound("2023-11-14 22:13:20.02"), moment);
    }

    #[test]
    fn anything_else_is_refused() {
        for text in
            ["", "#", "#x", "#-1", "-1", "1.", ".5", "1.0000000001", "1e3", "yesterday", "99999999999"]
        {
            assert!(bound(text).is_err(), "{text}");
        }
    }
}
