//! Quality of a capture: timestamps, gaps, lost frames.

use super::holes::{CaptureGaps, is_evidence};
use super::span::format_span;
use crate::event::{Event, EventKind};
use crate::frame::{BusIndex, Frame, FrameFlags, FrameRate, Timestamp};
use crate::profile;
use crate::wire::error_frame::ErrorFrameFields;
use crate::words::{NO_FRAMES, UNKNOWN_ZONE, count_noun};

/// Number of frames used to assess the timestamps.
const JUDGED: u64 = 1_000;

/// Minimum number of equal timestamps that are not a coincidence.
const EQUAL: u64 = 20;

/// Possible granularities of timestamps, in ns.
const STEPS: [i64; 10] =
    [1_000_000_000, 100_000_000, 10_000_000, 1_000_000, 100_000, 10_000, 1_000, 100, 10, 1];

/// Quality of a capture.
#[derive(Debug, Clone, Default)]
pub struct CaptureQuality {
    /// Number of frames, including error frames.
    pub frames: u64,
    /// First timestamp in ns.
    pub first: Option<i64>,
    /// Latest timestamp in ns.
    pub last: Option<i64>,
    /// Number of error frames.
    pub error_frames: u64,
    /// Error frames by class, in the order of SocketCAN's class bits.
    pub error_classes: Vec<(String, u64)>,
    /// Number of unreadable lines or records.
    pub unreadable: u64,
    /// Number of frames lost by the recorder; an unknown number counts as one.
    pub lost: u64,
    /// Segments of SDO block transfers that the receiver acknowledged, but that were not captured.
    pub missing_segments: u64,
    /// Number of backward steps of timestamps, and the largest one in ns (negative).
    pub clock_steps: (u64, i64),
    /// Number of times that the clock was set forward during a live capture.
    pub clock_sets: u64,
    /// Number of gaps without any frame, and the longest one in ns.
    pub silences: (u64, i64),
    /// Whether the dates are local times of an unknown zone.
    pub is_zone_unknown: bool,
    /// Whether the frames were built again from messages.
    pub has_no_frames: bool,
    holes: CaptureGaps,
    stamps: TimestampSource,
}

#[derive(Debug, Clone, Default)]
struct TimestampSource {
    count: u64,
    first: i64,
    last: i64,
    /// Index of the largest step in [`STEPS`] that divides all timestamps.
    step: usize,
    /// Interval between all timestamps so far.
    interval: Option<i64>,
    varies: bool,
    /// Rates of the buses.
    rates: Vec<(BusIndex, FrameRate)>,
}

impl CaptureQuality {
    /// Counts a frame.
    #[inline]
    pub fn count_frame(&mut self, frame: &Frame) {
        self.frames += 1;
        if frame.flags.contains(FrameFlags::ERROR) {
            self.error_frame(frame);
        }
        let Some(Timestamp(time)) = frame.time else { return };
        match &mut self.last {
            // A later timestamp changes nothing else, once enough of them were judged.
            Some(last) if time >= *last && self.stamps.count >= JUDGED => *last = time,
            _ => self.take_timestamp(time, frame),
        }
    }

    /// Counts a frame at a corrected time; its timestamp has the granularity.
    pub(super) fn count_frame_at(&mut self, frame: &Frame, time: Option<Timestamp>) {
        self.frames += 1;
        if frame.flags.contains(FrameFlags::ERROR) {
            self.error_frame(frame);
        }
        if let Some((Timestamp(stamp), Timestamp(time))) = frame.time.zip(time) {
            self.extend_to(time);
            self.stamps.add_timestamp(stamp, frame);
        }
    }

    /// Latest timestamp in ns, once a later one changes nothing else.
    pub(crate) fn latest_final(&self) -> Option<i64> {
        self.last.filter(|_| self.stamps.count >= JUDGED)
    }

    /// Counts frames without error frames; their timestamps follow [`Self::latest_final`] in order.
    pub(crate) fn count_frames(&mut self, frames: &[Frame]) {
        self.frames += frames.len() as u64;
        self.last = frames.last().and_then(|frame| frame.time).map_or(self.last, |time| Some(time.0));
    }

    /// Counts frames.
    pub(super) fn add_frames(&mut self, mut frames: &[Frame]) {
        while let Some((first, rest)) = frames.split_first() {
            self.count_frame(first);
            frames = rest;
            let Some(mut latest) = self.latest_final() else { continue };
            let is_counted = |frame: &&Frame| {
                let time = frame.time.map(|time| time.0).filter(|time| *time >= latest);
                latest = time.unwrap_or(latest);
                time.is_some() && !frame.flags.contains(FrameFlags::ERROR)
            };
            let count = frames.iter().take_while(is_counted).count();
            let (counted, others) = frames.split_at_checked(count).unwrap_or((frames, &[]));
            if !counted.is_empty() {
                self.count_frames(counted);
            }
            frames = others;
        }
    }

    #[cold]
    fn error_frame(&mut self, frame: &Frame) {
        self.error_frames += u64::from(frame.reports_error());
        let names = &profile::can_errors().classes;
        for name in names.set_names(frame.id.number() & !ErrorFrameFields::COUNTERS) {
            match self.error_classes.iter_mut().find(|(known, _)| known == name) {
                Some((_, count)) => *count += 1,
                None => self.error_classes.push((name.to_owned(), 1)),
            }
        }
    }

    #[inline(never)]
    fn take_timestamp(&mut self, time: i64, frame: &Frame) {
        self.extend_to(time);
        self.stamps.add_timestamp(time, frame);
    }

    fn extend_to(&mut self, time: i64) {
        self.first = Some(self.first.map_or(time, |first| first.min(time)));
        self.last = Some(self.last.map_or(time, |last| last.max(time)));
    }

    /// Counts an event.
    #[inline]
    pub fn count_event(&mut self, event: &Event) {
        // The most frequent kinds concern only their node.
        if !matches!(event.kind, EventKind::Pdo(_) | EventKind::Heartbeat { .. } | EventKind::J1939Message(_))
        {
            self.event_of_capture(event);
        }
    }

    fn event_of_capture(&mut self, event: &Event) {
        if is_evidence(&event.kind) {
            self.holes.take_event(event);
        }
        match &event.kind {
            EventKind::Unreadable { count, .. } => self.unreadable += count,
            EventKind::Note { text } if text == NO_FRAMES => self.has_no_frames = true,
            EventKind::Note { text } if text == UNKNOWN_ZONE => self.is_zone_unknown = true,
            EventKind::LostFrames { count } => self.lost += count.unwrap_or(1),
            EventKind::ClockStep { step: 0.. } => self.clock_sets += 1,
            EventKind::ClockStep { step } => {
                self.clock_steps = (self.clock_steps.0 + 1, self.clock_steps.1.min(*step));
            }
            // Transfers of a presumed protocol may be withdrawn.
            EventKind::SdoTransfer(transfer) if !event.presumed => {
                self.missing_segments = self.missing_segments.saturating_add(transfer.missing_segments);
            }
            EventKind::BusSilent { gap } => {
                self.silences = (self.silences.0 + 1, self.silences.1.max(*gap));
            }
            _ => {}
        }
    }

    /// Time from the first to the last timestamp, in ns.
    pub fn duration(&self) -> Option<i64> {
        Some(self.last?.saturating_sub(self.first?))
    }

    /// Properties of the capture that limit the verdicts, as text.
    pub fn limit_texts(&self) -> Vec<String> {
        let mut limits = Vec::new();
        if self.first.is_none() {
            limits.push("no timestamps: timing rules not exercised".to_owned());
        }
        if self.has_equal_stamps() {
            limits.push("all timestamps equal (no times): timing rules not exercised".to_owned());
        }
        if let Some(interval) = self.made_up_interval() {
            let interval = format_span(interval);
            limits.push(format!("timestamps synthetic (one every {interval}): timing rules not exercised"));
        }
        if self.has_no_frames {
            limits.push("no frames: messages of a test tool, transport and load not judged".to_owned());
        }
        if self.is_zone_unknown {
            limits.push("local time, zone unknown".to_owned());
        }
        limits.extend(self.stamps.rate_text().filter(|_| self.is_timed()));
        match self.lost {
            0 => {}
            lost => limits.push(format!("recorder lost {}", count_noun(lost, "frame"))),
        }
        match self.unreadable {
            0 => {}
            1 => limits.push("1 line or record unreadable".to_owned()),
            unreadable => limits.push(format!("{unreadable} lines or records unreadable")),
        }
        if self.missing_segments > 0 {
            let segments = count_noun(self.missing_segments, "segment");
            limits.push(format!("{segments} of SDO transfers not captured (the other side received them)"));
        }
        let (steps, largest) = self.clock_steps;
        let largest = format_span(largest.saturating_neg());
        match steps {
            0 => {}
            1 => limits.push(format!("timestamps jumped back once, by {largest}")),
            steps => limits.push(format!("timestamps jumped back {steps} times, by up to {largest}")),
        }
        match self.clock_sets {
            0 => {}
            1 => limits.push("clock set forward once".to_owned()),
            sets => limits.push(format!("clock set forward {sets} times")),
        }
        limits.extend(self.holes.gap_texts());
        if self.error_frames > 0 {
            limits.push(count_noun(self.error_frames, "error frame"));
        }
        limits
    }

    /// One statement per gap of a whole bus: duration, frames, presumed cause and its evidence.
    pub fn gap_texts(&self) -> impl Iterator<Item = String> {
        self.holes.gap_texts()
    }

    /// Whether at least 20 frames have a timestamp and all timestamps are equal: the recorder had no clock, or a
    /// converter filled in a value.
    pub fn has_equal_stamps(&self) -> bool {
        self.stamps.count >= EQUAL && self.first == self.last
    }

    /// Whether the timestamps are those of a recorder: neither missing, nor all equal, nor synthetic.
    pub fn is_timed(&self) -> bool {
        self.first.is_some() && !self.has_equal_stamps() && self.made_up_interval().is_none()
    }

    /// Estimated granularity of the timestamps in ns, from the first 1,000.
    pub fn granularity(&self) -> Option<i64> {
        (self.stamps.count > 1 && !self.has_equal_stamps())
            .then(|| STEPS.get(self.stamps.step).copied().unwrap_or(1))
    }

    /// Whether intervals between timestamps differ, that is, the timestamps are real.
    pub(crate) fn has_varied(&self) -> bool {
        self.stamps.varies
    }

    /// The constant interval between the first 1,000 timestamps; if there is one, the timestamps are
    /// synthetic and unsuitable for timing rules.
    pub fn made_up_interval(&self) -> Option<i64> {
        let stamps = &self.stamps;
        stamps.interval.filter(|interval| stamps.count >= JUDGED && !stamps.varies && *interval > 0)
    }
}

impl TimestampSource {
    fn add_timestamp(&mut self, stamp: i64, frame: &Frame) {
        if self.count >= JUDGED {
            return;
        }
        match self.rates.iter_mut().find(|(bus, _)| *bus == frame.bus) {
            Some((_, rate)) => rate.add_frame(Timestamp(stamp), frame),
            None => self.rates.push((frame.bus, FrameRate::new(Timestamp(stamp)))),
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

    /// Statement on times that no bus can have.
    fn rate_text(&self) -> Option<String> {
        let (_, rate) = self.rates.iter().find(|(_, rate)| !rate.is_possible(1))?;
        let bus = rate.fastest_bus();
        Some(match rate.frames_per_second() {
            Some((rate, most)) => {
                format!("{rate} frames/s at the start (max {most}/s on {bus}): unit of the timestamps wrong?")
            }
            None => format!("timestamps of a bus equal at the start, faster than {bus}"),
        })
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn spans_have_a_readable_unit() {
        let stated =
            [1_500, 20_000_000, 1_250_000_000, 90_000_000_000, 5_400_000_000_000, 1_197_906_557_000_000];
        assert_eq!(format_span(86_400_000_000_000), "1 day");
        assert_eq!(stated.map(format_span), ["1.5 µs", "20 ms", "1.25 s", "1.5 min", "1.5 h", "13.9 days"]);
    }

    #[test]
    fn limits_count_as_people_do() {
        let mut quality = CaptureQuality {
            first: Some(0),
            lost: 1,
            unreadable: 1,
            error_frames: 1,
            ..CaptureQuality::default()
        };
        quality.clock_steps = (1, -1_197_906_557_000_000);
        let once = [
            "recorder lost 1 frame",
            "1 line or record unreadable",
            "timestamps jumped back once, by 13.9 days",
            "1 error frame",
        ];
        assert_eq!(quality.limit_texts(), once);
        (quality.lost, quality.unreadable, quality.error_frames) = (2, 2, 2);
        quality.clock_steps = (2, -20_000_000);
        let often = [
            "recorder lost 2 frames",
            "2 lines or records unreadable",
            "timestamps jumped back 2 times, by up to 20 ms",
            "2 error frames",
        ];
        assert_eq!(quality.limit_texts(), often);
    }
    use crate::frame::{CanId, Timestamp};

    fn quality(stamps: impl Iterator<Item = i64>) -> CaptureQuality {
        let mut quality = CaptureQuality::default();
        for stamp in stamps {
            let mut frame = Frame::data_frame(CanId::from_standard(1), &[]);
            frame.time = Some(Timestamp(stamp));
            quality.count_frame(&frame);
        }
        quality
    }

    #[test]
    fn a_rate_above_every_bus_is_stated() {
        // 20 frames without data, each at least 47 µs at 1 Mbit/s: 21,276 frames/s.
        let fast = quality((0..20).map(|n| n * 3_600 + n % 2));
        let text =
            "277773 frames/s at the start (max 21276/s on CAN with 1 Mbit/s): unit of the timestamps wrong?";
        assert_eq!(fast.limit_texts(), [text]);
        let possible = quality((0..20).map(|n| n * 47_000 + n % 2));
        assert_eq!(possible.limit_texts(), [] as [&str; 0]);
        // The rate of each bus, not of all together.
        let mut two = CaptureQuality::default();
        for index in 0..40 {
            let id = CanId::from_standard(1);
            let time = Some(Timestamp(index / 2 * 47_000 + index % 2));
            let bus = BusIndex(u8::try_from(index % 2).unwrap());
            two.count_frame(&Frame { time, bus, ..Frame::data_frame(id, &[]) });
        }
        assert_eq!(two.limit_texts(), [] as [&str; 0]);
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
    fn equal_timestamps_are_not_times() {
        let equal = quality([1_700_000_000_000_000_000; 20].into_iter());
        assert!(equal.has_equal_stamps() && !equal.is_timed() && equal.granularity().is_none());
        let few = quality([0; 19].into_iter());
        assert!(!few.has_equal_stamps() && few.is_timed());
        let real = quality((0..20).map(|n| i64::from(n == 19)));
        assert!(!real.has_equal_stamps() && real.is_timed());
        assert!(!CaptureQuality::default().is_timed());
    }

    #[test]
    fn granularity_is_the_coarsest_step_all_stamps_fit() {
        assert_eq!(quality([5, 100_005, 300_005].into_iter()).granularity(), Some(100_000));
        assert_eq!(quality([0, 7].into_iter()).granularity(), Some(1));
        assert_eq!(quality([0].into_iter()).granularity(), None);
    }
}
