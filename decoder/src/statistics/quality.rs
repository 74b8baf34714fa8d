//! How far a capture can be trusted: stamps, gaps, what the recorder lost.

use crate::event::{Event, EventKind};
use crate::frame::{Frame, FrameFlags};
use crate::profile;
use crate::words::plural;

/// Frames from which the stamps are judged.
const JUDGED: u64 = 1_000;

/// Coarsest and finest step of stamps looked for, in nanoseconds.
const STEPS: [i64; 10] =
    [1_000_000_000, 100_000_000, 10_000_000, 1_000_000, 100_000, 10_000, 1_000, 100, 10, 1];

/// What is known of the capture itself.
#[derive(Debug, Clone, Default)]
pub struct Quality {
    /// Frames, error frames among them.
    pub frames: u64,
    /// First and last stamp in nanoseconds.
    pub first: Option<i64>,
    /// Latest stamp.
    pub last: Option<i64>,
    /// Error frames.
    pub error_frames: u64,
    /// Error frames by class, in the order of SocketCAN's class bits.
    pub error_classes: Vec<(String, u64)>,
    /// Lines or records that could not be read.
    pub unreadable: u64,
    /// Frames the recorder says it lost; `None` counts as one.
    pub lost: u64,
    /// Backward steps of the stamps, and the largest in nanoseconds (negative).
    pub clock_steps: (u64, i64),
    /// Silences of all traffic, and the longest in nanoseconds.
    pub silences: (u64, i64),
    stamps: Stamps,
}

#[derive(Debug, Clone, Default)]
struct Stamps {
    count: u64,
    first: i64,
    last: i64,
    /// Largest step of [`STEPS`] of which every stamp is a multiple, as an index.
    step: usize,
    /// The one interval between all stamps so far.
    interval: Option<i64>,
    varies: bool,
}

impl Quality {
    /// Takes a frame.
    pub fn frame(&mut self, frame: &Frame) {
        self.frames += 1;
        if frame.flags.contains(FrameFlags::ERROR) {
            self.error_frames += 1;
            let names = &profile::can_errors().classes;
            for name in names.names(frame.id.number()).filter(|name| *name != "counters") {
                match self.error_classes.iter_mut().find(|(known, _)| known == name) {
                    Some((_, count)) => *count += 1,
                    None => self.error_classes.push((name.to_owned(), 1)),
                }
            }
        }
        if let Some(time) = frame.time {
            self.first = Some(self.first.map_or(time.0, |first| first.min(time.0)));
            self.last = Some(self.last.map_or(time.0, |last| last.max(time.0)));
            self.stamps.add(time.0);
        }
    }

    /// Takes an event.
    pub fn event(&mut self, event: &Event) {
        match &event.kind {
            EventKind::Unreadable { count, .. } => self.unreadable += count,
            EventKind::LostFrames { count } => self.lost += count.unwrap_or(1),
            EventKind::ClockStep { step } => {
                self.clock_steps = (self.clock_steps.0 + 1, self.clock_steps.1.min(*step));
            }
            EventKind::BusSilent { gap } => {
                self.silences = (self.silences.0 + 1, self.silences.1.max(*gap));
            }
            _ => {}
        }
    }

    /// Nanoseconds from the first stamp to the last.
    pub fn duration(&self) -> Option<i64> {
        Some(self.last?.saturating_sub(self.first?))
    }

    /// What limits verdicts on the capture, in words.
    pub fn limits(&self) -> Vec<String> {
        let mut limits = Vec::new();
        if self.first.is_none() {
            limits.push("the capture has no times: rules about times are not exercised".to_owned());
        }
        if let Some(interval) = self.made_up_interval() {
            let interval = span(interval);
            limits.push(format!(
                "the stamps are made up, one each {interval}: rules about times are not exercised"
            ));
        }
        match self.lost {
            0 => {}
            lost => limits.push(format!("the recorder lost {}", plural(lost, "frame"))),
        }
        match self.unreadable {
            0 => {}
            1 => limits.push("1 line or record could not be read".to_owned()),
            unreadable => limits.push(format!("{unreadable} lines or records could not be read")),
        }
        let (steps, largest) = self.clock_steps;
        let largest = span(largest.saturating_neg());
        match steps {
            0 => {}
            1 => limits.push(format!("stamps went back once, by {largest}")),
            steps => limits.push(format!("stamps went back {steps} times, by {largest} at most")),
        }
        if self.error_frames > 0 {
            limits.push(plural(self.error_frames, "error frame"));
        }
        limits
    }

    /// Estimated granularity of the stamps in nanoseconds, from the first 1,000.
    pub fn granularity(&self) -> Option<i64> {
        (self.stamps.count > 1).then(|| STEPS.get(self.stamps.step).copied().unwrap_or(1))
    }

    /// Whether two intervals between stamps differed: they are not made up.
    pub(crate) fn has_varied(&self) -> bool {
        self.stamps.varies
    }

    /// The interval between all of the first 1,000 stamps, if it is the same throughout: they were made
    /// up, and times say nothing.
    pub fn made_up_interval(&self) -> Option<i64> {
        let stamps = &self.stamps;
        stamps.interval.filter(|interval| stamps.count >= JUDGED && !stamps.varies && *interval > 0)
    }
}

impl Stamps {
    fn add(&mut self, stamp: i64) {
        if self.count >= JUDGED {
            return;
        }
        if self.count == 0 {
            self.first = stamp;
        } else {
            let interval = stamp.saturating_sub(self.last);
            self.varies |= *self.interval.get_or_insert(interval) != interval;
            let offset = stamp.saturating_sub(self.first);
            while STEPS.get(self.step).is_some_and(|step| offset % step != 0) {
                self.step += 1;
            }
        }
        self.last = stamp;
        self.count += 1;
    }
}

/// A span of time as people say it: in the largest unit of which it has one or more, with three digits.
pub fn span(nanoseconds: i64) -> String {
    const UNITS: [(i64, &str); 5] = [
        (86_400_000_000_000, "days"),
        (3_600_000_000_000, "h"),
        (60_000_000_000, "min"),
        (1_000_000_000, "s"),
        (1_000_000, "ms"),
    ];
    let fits = UNITS.iter().find(|(unit, _)| nanoseconds.saturating_abs() >= *unit);
    let (unit, name) = fits.copied().unwrap_or((1_000, "µs"));
    #[expect(clippy::cast_precision_loss, reason = "three digits of it")]
    let value = nanoseconds as f64 / unit as f64;
    let digits = if value.abs() < 9.995 { 2 } else { usize::from(value.abs() < 99.95) };
    let text = format!("{value:.digits$}");
    let text = if digits > 0 { text.trim_end_matches('0').trim_end_matches('.') } else { &text };
    let name = if (text, name) == ("1", "days") { "day" } else { name };
    format!("{text} {name}")
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn spans_are_said_in_the_unit_people_use() {
        let said =
            [1_500, 20_000_000, 1_250_000_000, 90_000_000_000, 5_400_000_000_000, 1_197_906_557_000_000];
        assert_eq!(span(86_400_000_000_000), "1 day");
        assert_eq!(said.map(span), ["1.5 µs", "20 ms", "1.25 s", "1.5 min", "1.5 h", "13.9 days"]);
    }

    #[test]
    fn limits_count_as_people_do() {
        let mut quality =
            Quality { first: Some(0), lost: 1, unreadable: 1, error_frames: 1, ..Quality::default() };
        quality.clock_steps = (1, -1_197_906_557_000_000);
        let once = [
            "the recorder lost 1 frame",
            "1 line or record could not be read",
            "stamps went back once, by 13.9 days",
            "1 error frame",
        ];
        assert_eq!(quality.limits(), once);
        (quality.lost, quality.unreadable, quality.error_frames) = (2, 2, 2);
        quality.clock_steps = (2, -20_000_000);
        let often = [
            "the recorder lost 2 frames",
            "2 lines or records could not be read",
            "stamps went back 2 times, by 20 ms at most",
            "2 error frames",
        ];
        assert_eq!(quality.limits(), often);
    }
    use crate::frame::{CanId, Timestamp};

    fn quality(stamps: impl Iterator<Item = i64>) -> Quality {
        let mut quality = Quality::default();
        for stamp in stamps {
            let mut frame = Frame::data_frame(CanId::standard(1), &[]);
            frame.time = Some(Timestamp(stamp));
            quality.frame(&frame);
        }
        quality
    }

    #[test]
    fn a_constant_step_is_made_up() {
        let constant = quality((0..1_000).map(|n| 1_600_000_001_000_000_000 + n * 1_000_000));
        assert_eq!(constant.made_up_interval(), Some(1_000_000));
        let short = quality((0..999).map(|n| n * 1_000_000));
        assert_eq!(short.made_up_interval(), None);
        let real = quality((0..1_000).map(|n| n * 1_000_000 + n % 3 * 1_000));
        assert_eq!(real.made_up_interval(), None);
    }

    #[test]
    fn granularity_is_the_coarsest_step_all_stamps_fit() {
        assert_eq!(quality([5, 100_005, 300_005].into_iter()).granularity(), Some(100_000));
        assert_eq!(quality([0, 7].into_iter()).granularity(), Some(1));
        assert_eq!(quality([0].into_iter()).granularity(), None);
    }
}
