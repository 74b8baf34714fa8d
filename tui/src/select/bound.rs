//! Start or end of a printed range, as typed by the user.

use std::str::FromStr;

use anyhow::{Context as _, anyhow, bail, ensure};
use cobscope_decoder::frame::{Frame, Timestamp};

use super::clock::{BoundSide, ClockTime};

/// Decimals of a second in nanoseconds.
const NANOSECOND_DIGITS: usize = 9;

/// Start or end of the printed range.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum RangeBound {
    /// Nanoseconds from the first frame of the capture.
    Offset(i64),
    /// Number of a frame.
    Frame(u64),
    /// Absolute time in ns since 1970.
    Moment(Timestamp),
    /// A wall-clock time whose moment depends on the capture: a time of day, a date, or a local time.
    Clock(ClockTime),
}

/// Earliest and latest timestamp of a capture; `None` for a pipe, which can be read only once.
pub type Span<'a> = &'a mut dyn FnMut() -> Option<(Timestamp, Timestamp)>;

/// `12.5`, `#1234`, `22:13:25`, `2024-01-31`, `2024-01-31T12:00:00Z`; without a zone UTC, as printed by
/// `-t A`, with `local` the time zone of the computer.
impl FromStr for RangeBound {
    type Err = &'static str;

    fn from_str(text: &str) -> Result<Self, Self::Err> {
        if let Some(number) = text.strip_prefix('#') {
            return number
                .parse()
                .map(Self::Frame)
                .map_err(|_| "expected # and a frame number, such as #1234");
        }
        if let Some(offset) = parse_nanoseconds(text) {
            return Ok(Self::Offset(offset));
        }
        let moment = text.parse::<jiff::Timestamp>().ok();
        let moment = moment.and_then(|moment| i64::try_from(moment.as_nanosecond()).ok());
        if let Some(moment) = moment {
            return Ok(Self::Moment(Timestamp(moment)));
        }
        let clock = ClockTime::parse(text).map(|clock| match clock.fixed_moment() {
            Some(moment) => Self::Moment(moment),
            None => Self::Clock(clock),
        });
        clock.ok_or("expected seconds (12.5), a frame (#1234) or a time (22:13:25, 2024-01-31T12:00:00Z)")
    }
}

impl RangeBound {
    /// A wall-clock time in the time zone of the computer; None if the text is not one, or names a zone.
    pub fn local_time(text: &str) -> Option<Self> {
        ClockTime::parse_local(text).map(Self::Clock)
    }

    /// The bound without a wall-clock time, for a capture that begins with the frame `first`.
    ///
    /// # Errors
    /// The capture has no timestamps or no dates, or the wall-clock time is ambiguous.
    pub fn resolve_bound(self, side: BoundSide, first: &Frame, span: Span<'_>) -> anyhow::Result<Self> {
        let option = side.option_name();
        let Self::Clock(clock) = self else {
            ensure!(
                first.time.is_some() || matches!(self, Self::Frame(_)),
                "has no timestamps; use frame numbers, such as {option} #1234"
            );
            return Ok(self);
        };
        let Some(time) = first.time else {
            bail!("has no timestamps; use frame numbers, such as {option} #1234");
        };
        ensure!(
            time.has_date(),
            "times count from the start of the capture, without a date; give seconds, such as {option} 12.5"
        );
        let (first, last) = match span() {
            Some(span) => span,
            None if clock.has_date() => (time, time),
            None => bail!("a pipe can be read only once, so a time of day needs a date: {option} DATE TIME"),
        };
        let moment = clock.resolve_side(side, first, last).map_err(|error| anyhow!(error));
        moment.map(Self::Moment).context(option)
    }

    /// The bound as text: `12.500 s` after `first`, the time of the first frame; `frame 12`.
    pub fn bound_text(self, first: Option<Timestamp>) -> String {
        let nanoseconds = match (self, first) {
            (Self::Frame(number), _) => return format!("frame {number}"),
            (Self::Offset(offset), _) => offset,
            (Self::Clock(_), _) => 0,
            (Self::Moment(moment), first) => moment.since(first.unwrap_or(moment)),
        };
        let sign = if nanoseconds < 0 { "-" } else { "" };
        let milliseconds = nanoseconds.unsigned_abs() / 1_000_000;
        format!("{sign}{}.{:03} s", milliseconds / 1_000, milliseconds % 1_000)
    }

    /// Whether the bound is after `frame`. `first` is the time of the first frame. A frame without a
    /// timestamp precedes every time.
    pub fn is_behind(self, frame: &Frame, first: Option<Timestamp>) -> bool {
        match self {
            Self::Frame(number) => frame.number < number,
            Self::Moment(moment) => frame.time.is_none_or(|time| time < moment),
            Self::Offset(offset) => {
                frame.time.zip(first).is_none_or(|(time, first)| time.since(first) < offset)
            }
            Self::Clock(_) => false,
        }
    }

    /// Whether the bound is before `frame`. `first` is the time of the first frame. A frame without a
    /// timestamp is never after a time.
    pub fn is_before(self, frame: &Frame, first: Option<Timestamp>) -> bool {
        let behind = match self {
            Self::Frame(number) => Some(frame.number > number),
            Self::Moment(moment) => frame.time.map(|time| time > moment),
            Self::Offset(offset) => frame.time.zip(first).map(|(time, first)| time.since(first) > offset),
            Self::Clock(_) => None,
        };
        behind.unwrap_or(false)
    }
}

/// Checks the order of the bounds. Bounds of different kinds cannot be compared.
///
/// # Errors
/// `--from` is after `--to`.
pub fn ensure_order(from: Option<RangeBound>, to: Option<RangeBound>) -> anyhow::Result<()> {
    let is_behind = match (from, to) {
        (Some(RangeBound::Offset(from)), Some(RangeBound::Offset(to))) => from > to,
        (Some(RangeBound::Frame(from)), Some(RangeBound::Frame(to))) => from > to,
        (Some(RangeBound::Moment(from)), Some(RangeBound::Moment(to))) => from > to,
        _ => false,
    };
    ensure!(!is_behind, "--from is after --to; the range is empty");
    Ok(())
}

/// Seconds with at most nine decimals, as nanoseconds.
fn parse_nanoseconds(text: &str) -> Option<i64> {
    let (seconds, fraction) = text.split_once('.').unwrap_or((text, "0"));
    let is_number = [seconds, fraction]
        .iter()
        .all(|digits| !digits.is_empty() && digits.bytes().all(|digit| digit.is_ascii_digit()));
    if !is_number || fraction.len() > NANOSECOND_DIGITS {
        return None;
    }
    format!("{seconds}{fraction:0<NANOSECOND_DIGITS$}").parse().ok()
}

#[cfg(test)]
mod tests {
    use super::*;

    fn bound(text: &str) -> Result<RangeBound, &'static str> {
        text.parse()
    }

    #[test]
    fn seconds_frames_and_moments() {
        assert_eq!(bound("12.5"), Ok(RangeBound::Offset(12_500_000_000)));
        assert_eq!(bound("0"), Ok(RangeBound::Offset(0)));
        assert_eq!(bound("1.000000001"), Ok(RangeBound::Offset(1_000_000_001)));
        assert_eq!(bound("#1234"), Ok(RangeBound::Frame(1234)));
        let moment = Ok(RangeBound::Moment(Timestamp(1_700_000_000_020_000_000)));
        assert_eq!(bound("2023-11-14T22:13:20.02Z"), moment);
        assert_eq!(bound("2023-11-14T23:13:20.02+01:00"), moment);
        assert_eq!(bound("2023-11-14 22:13:20.02"), moment);
        assert_eq!(bound("2023-11-14 23:13:20.02 +01:00"), moment);
    }

    #[test]
    fn wall_clock_times_need_the_capture() {
        for text in
            ["22:13:25", "22:13", "22:13:25Z", "22:13:25 local", "2023-11-14", "2023-11-14 22:13 local"]
        {
            assert!(matches!(bound(text), Ok(RangeBound::Clock(_))), "{text}");
        }
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
