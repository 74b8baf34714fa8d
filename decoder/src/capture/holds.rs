//! Data that formats can store, and the data that a capture loses when it is converted to a format.

use super::bus_error::{
    ControllerState, Counters, ProtocolViolation, Violation, controller_frame, counter_frame,
    reported_counters, reported_state, reported_violation, violation_frame,
};
use crate::frame::{Frame, FrameFlags, Timestamp};

/// Part of an error frame that a format stores.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum ErrorFrames {
    /// All of a SocketCAN error frame.
    Whole,
    /// The protocol violation, its location in the frame, and whether this controller was transmitting. Other
    /// error frames are stored without details.
    Violations,
    /// One of: a controller state; a protocol violation with its location and the error counters (both 0 if
    /// unknown); the error counters alone. Other error frames are stored without details.
    Reports,
    /// A marker without class and details.
    Mark,
    /// Nothing: error frames are dropped.
    None,
}

/// Information on a frame's direction that a format stores.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum DirectionSupport {
    /// Received, transmitted or unknown.
    Whole,
    /// Received or transmitted; unknown is written as received.
    Assumed,
    /// Nothing: directions are dropped.
    None,
}

/// Data that a format can store, in addition to identifier, data and time of classic frames and remote
/// frames.
#[derive(Debug, Clone, Copy)]
pub struct FormatCapabilities {
    /// Resolution of timestamps in nanoseconds.
    pub resolution: i64,
    /// Frames without timestamp; otherwise they get the timestamp of the frame before.
    pub untimed: bool,
    /// Timestamps before that of the first frame; otherwise they are set to that of the first frame.
    pub backwards: bool,
    /// Negative timestamps (before 1970); otherwise they are written as zero.
    pub negative: bool,
    /// CAN FD frames with both of their flags; otherwise they are dropped.
    pub fd: bool,
    /// Stored part of error frames.
    pub errors: ErrorFrames,
    /// DLCs above 8 of classic frames.
    pub raw_dlc: bool,
    /// Direction of frames: received or transmitted.
    pub directions: DirectionSupport,
    /// Bus names as part of each frame; otherwise frames have numbers from 1, and comments name the buses.
    pub bus_names: bool,
    /// Notices of lost frames, link changes and quiet periods.
    pub notices: bool,
    /// A comment at a frame.
    pub comments: bool,
}

impl ErrorFrames {
    /// Whether the details of error frames are stored in part.
    fn is_part(self) -> bool {
        matches!(self, Self::Violations | Self::Reports)
    }

    /// The error frame as it is read back; `None` if it is dropped. Error frames stored in part lose their
    /// direction.
    fn kept_error_frame(self, frame: &Frame) -> Option<Frame> {
        let mark = violation_frame(Violation::Other, false, 0, None);
        let found = match self {
            Self::None => return None,
            Self::Whole => return Some(*frame),
            Self::Mark => Frame { flags: frame.flags, ..mark },
            Self::Violations => match reported_violation(frame) {
                Some(ProtocolViolation { kind: Violation::Overload, .. }) => {
                    violation_frame(Violation::Overload, false, 0, None)
                }
                Some(ProtocolViolation { kind, sending, place }) => {
                    violation_frame(kind, sending, place, None)
                }
                None => mark,
            },
            Self::Reports => ErrorReportContent::report_of(frame).to_frame(),
        };
        Some(Frame { number: frame.number, time: frame.time, bus: frame.bus, ..found })
    }
}

/// Content of an error report in a format with [`ErrorFrames::Reports`].
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum ErrorReportContent {
    /// State of the controller.
    State(ControllerState),
    /// A bit, form or stuff error, or another violation at a location, and the error counters. Counters that
    /// are both 0 are `None`: a counted error leaves at least one counter above 0.
    Broken(ProtocolViolation, Option<Counters>),
    /// The error counters.
    Counters(Counters),
}

impl ErrorReportContent {
    /// The report for an error frame. A state takes precedence because it is the rarest.
    pub(super) fn report_of(frame: &Frame) -> Self {
        let counters = reported_counters(frame);
        match (reported_state(frame), reported_violation(frame), counters) {
            (Some(state), _, _) => Self::State(state),
            (None, None, Some(counters)) => Self::Counters(counters),
            (None, found, _) => {
                let nothing = ProtocolViolation { kind: Violation::Other, sending: false, place: 0 };
                let found = found.unwrap_or(nothing);
                let kind = match found.kind {
                    kind @ (Violation::Bit | Violation::Form | Violation::Stuff) => kind,
                    _ => Violation::Other,
                };
                Self::Broken(ProtocolViolation { kind, ..found }, counters.and_then(Counters::of_error))
            }
        }
    }

    /// The error frame as it is read back.
    fn to_frame(self) -> Frame {
        match self {
            Self::State(state) => controller_frame(state),
            Self::Counters(counted) => counter_frame(counted),
            Self::Broken(ProtocolViolation { kind, sending, place }, counters) => {
                violation_frame(kind, sending, place, counters)
            }
        }
    }
}

impl FormatCapabilities {
    /// A format that can store all data.
    pub const ALL: Self = Self {
        resolution: 1,
        untimed: true,
        backwards: true,
        negative: true,
        fd: true,
        errors: ErrorFrames::Whole,
        raw_dlc: true,
        directions: DirectionSupport::Whole,
        bus_names: true,
        notices: true,
        comments: true,
    };

    /// The frame as it is read back; `None` if it is dropped. Of the format's limits on timestamps, only
    /// resolution and sign are applied.
    pub fn kept_frame(&self, frame: &Frame) -> Option<Frame> {
        let is_error = frame.flags.contains(FrameFlags::ERROR);
        if frame.flags.contains(FrameFlags::FD) && !self.fd {
            return None;
        }
        let mut kept = if is_error { self.errors.kept_error_frame(frame)? } else { *frame };
        kept.time =
            frame.time.map(|time| self.round_time(if self.negative { time } else { time.max(Timestamp(0)) }));
        if !self.raw_dlc {
            kept.raw_dlc = 0;
        }
        if is_error && self.errors.is_part() {
            return Some(kept);
        }
        let directions = FrameFlags::TRANSMITTED.with(FrameFlags::RECEIVED);
        match self.directions {
            DirectionSupport::Whole => {}
            DirectionSupport::Assumed if kept.flags.0 & directions.0 != 0 => {}
            DirectionSupport::Assumed => kept.flags = kept.flags.with(FrameFlags::RECEIVED),
            DirectionSupport::None => kept.flags = FrameFlags(kept.flags.0 & !directions.0),
        }
        Some(kept)
    }

    /// Names of the data that the format cannot store.
    pub fn missing_data(&self) -> Vec<String> {
        let errors = match self.errors {
            ErrorFrames::Whole => None,
            ErrorFrames::Violations => {
                Some("error frame details except the protocol violation and its location")
            }
            ErrorFrames::Reports => Some(
                "error frame details except the controller state, or the protocol violation and error counters (0 if unknown), or the error counters alone",
            ),
            ErrorFrames::Mark => Some("class and details of error frames"),
            ErrorFrames::None => Some("error frames"),
        };
        let directions = match self.directions {
            DirectionSupport::Whole => None,
            DirectionSupport::Assumed => Some("unknown direction of frames"),
            DirectionSupport::None => Some("direction of frames"),
        };
        let time =
            (self.resolution > 1).then(|| format!("timestamps finer than {}", unit_name(self.resolution)));
        let others = [
            (!self.untimed).then_some("frames without timestamp"),
            (!self.backwards).then_some("timestamps before the first frame"),
            (!self.negative).then_some("negative timestamps"),
            (!self.fd).then_some("CAN FD frames"),
            errors,
            (!self.raw_dlc).then_some("DLCs above 8 of classic frames"),
            directions,
            (!self.bus_names).then_some("bus names, except in comments"),
            (!self.notices).then_some("lost frames, link changes and quiet periods"),
            (!self.comments).then_some("comments"),
        ];
        time.into_iter().chain(others.into_iter().flatten().map(str::to_owned)).collect()
    }

    /// A time rounded down to the format's resolution.
    pub fn round_time(&self, time: Timestamp) -> Timestamp {
        Timestamp(time.0.saturating_sub(time.0.rem_euclid(self.resolution.max(1))))
    }
}

/// Data of a frame that the format cannot store.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum Loss {
    FdFrame,
    ErrorFrame,
    ErrorDetail,
    ErrorCounters,
    Resolution,
    NoTime,
    Backwards,
    Negative,
    RawDlc,
    Direction,
    DirectionAssumed,
}

/// Text for each loss, printed after the number of frames.
const STATED: [(Loss, &str); 11] = [
    (Loss::FdFrame, "CAN FD frames dropped"),
    (Loss::ErrorFrame, "error frames dropped"),
    (Loss::ErrorDetail, "error frames written without class and details"),
    (Loss::ErrorCounters, "error frames with unknown error counters, written as 0"),
    (Loss::Resolution, "timestamps truncated to"),
    (Loss::NoTime, "frames without timestamp, written with that of the frame before"),
    (Loss::Backwards, "timestamps before the first frame, written as that of the first frame"),
    (Loss::Negative, "negative timestamps, written as 0"),
    (Loss::RawDlc, "DLCs above 8, written as 8"),
    (Loss::Direction, "frames written without direction"),
    (Loss::DirectionAssumed, "frames of unknown direction, written as received"),
];

/// Counts what frames lose in a format.
#[derive(Debug, Clone)]
pub struct LossCounter {
    holds: FormatCapabilities,
    first: Option<Timestamp>,
    counts: [u64; STATED.len()],
    notices: u64,
}

impl LossCounter {
    /// Creates counters at zero for a format that can store `holds`.
    pub fn new(holds: FormatCapabilities) -> Self {
        Self { holds, first: None, counts: [0; STATED.len()], notices: 0 }
    }

    /// Begins another file of the same capture; timestamps are then compared with its first frame.
    pub fn begin_file(&mut self) {
        self.first = None;
    }

    /// Counts the losses of a frame. Frames must be passed in the order in which they are written.
    #[inline]
    pub fn count_frame(&mut self, frame: &Frame) {
        // Of most frames, only the time can be lost.
        let is_plain = frame.flags.is_classic_data() && frame.raw_dlc <= 8;
        match frame.time.filter(|_| is_plain && self.holds.directions == DirectionSupport::Whole) {
            Some(time) => self.see_time(time),
            None => self.count_losses(frame),
        }
    }

    #[inline(never)]
    fn count_losses(&mut self, frame: &Frame) {
        let (holds, flags) = (self.holds, frame.flags);
        let is_error = flags.contains(FrameFlags::ERROR);
        if flags.contains(FrameFlags::FD) && !holds.fd {
            return self.count_loss(Loss::FdFrame);
        }
        if is_error {
            let Some(kept) = holds.errors.kept_error_frame(frame) else {
                return self.count_loss(Loss::ErrorFrame);
            };
            // A marker cannot express that details existed, so each error frame counts, even without details.
            if holds.errors == ErrorFrames::Mark || (kept.id, kept.data()) != (frame.id, frame.data()) {
                self.count_loss(Loss::ErrorDetail);
            }
            // Counters of 0 are read back as unknown, but other programs show them as 0.
            let writes_counters = holds.errors == ErrorFrames::Reports
                && matches!(ErrorReportContent::report_of(frame), ErrorReportContent::Broken(_, None))
                && reported_counters(frame).is_none();
            if writes_counters {
                self.count_loss(Loss::ErrorCounters);
            }
        }
        match frame.time {
            None if !holds.untimed => self.count_loss(Loss::NoTime),
            None => {}
            Some(time) => self.see_time(time),
        }
        if frame.raw_dlc > 8 && !flags.contains(FrameFlags::FD) && !holds.raw_dlc {
            self.count_loss(Loss::RawDlc);
        }
        let has_direction = flags.contains(FrameFlags::TRANSMITTED) || flags.contains(FrameFlags::RECEIVED);
        match holds.directions {
            _ if is_error && holds.errors.is_part() && has_direction => self.count_loss(Loss::Direction),
            DirectionSupport::None if has_direction => self.count_loss(Loss::Direction),
            DirectionSupport::Assumed if !has_direction && !is_error => {
                self.count_loss(Loss::DirectionAssumed);
            }
            _ => {}
        }
    }

    fn see_time(&mut self, time: Timestamp) {
        if self.holds.resolution > 1 && self.holds.round_time(time) != time {
            self.count_loss(Loss::Resolution);
        }
        let first = *self.first.get_or_insert(time);
        if time < first && !self.holds.backwards {
            self.count_loss(Loss::Backwards);
        }
        if time.0 < 0 && !self.holds.negative {
            self.count_loss(Loss::Negative);
        }
    }

    /// Counts a notice that the format cannot store.
    pub fn miss_notice(&mut self) {
        self.notices += 1;
    }

    fn count_loss(&mut self, loss: Loss) {
        if let Some(count) =
            STATED.iter().position(|(stated, _)| *stated == loss).and_then(|at| self.counts.get_mut(at))
        {
            *count += 1;
        }
    }

    /// Text of each loss with its count.
    pub fn loss_texts(&self) -> Vec<String> {
        let mut all = Vec::new();
        for ((loss, text), count) in STATED.iter().zip(self.counts).filter(|(_, count)| *count > 0) {
            all.push(match loss {
                Loss::Resolution => format!("{count} {text} {}", unit_name(self.holds.resolution)),
                Loss::ErrorDetail if self.holds.errors != ErrorFrames::Mark => {
                    format!("{count} error frames written with only part of their class and details")
                }
                _ => format!("{count} {text}"),
            });
        }
        if self.notices > 0 {
            all.push(format!("{} notices dropped (lost frames, link changes, quiet periods)", self.notices));
        }
        all
    }
}

/// Name of a time unit given in nanoseconds.
fn unit_name(nanoseconds: i64) -> String {
    match nanoseconds {
        1_000 => "microseconds".into(),
        1_000_000 => "milliseconds".into(),
        1_000_000_000 => "seconds".into(),
        other if other % 1_000 == 0 => format!("multiples of {} microseconds", other / 1_000),
        other => format!("multiples of {other} nanoseconds"),
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::frame::CanId;

    const POOR: FormatCapabilities = FormatCapabilities {
        resolution: 1_000,
        untimed: false,
        backwards: false,
        negative: false,
        fd: false,
        errors: ErrorFrames::Mark,
        raw_dlc: false,
        directions: DirectionSupport::None,
        bus_names: false,
        notices: false,
        comments: false,
    };

    fn to_frame(time: i64) -> Frame {
        Frame { time: Some(Timestamp(time)), ..Frame::data_frame(CanId::from_standard(1), &[1; 8]) }
    }

    #[test]
    fn nothing_is_lost_where_there_is_a_place_for_everything() {
        let mut losses = LossCounter::new(FormatCapabilities::ALL);
        let odd = Frame { raw_dlc: 15, flags: FrameFlags::TRANSMITTED, ..to_frame(1_001) };
        losses.count_frame(&odd);
        losses.count_frame(&Frame { time: None, flags: FrameFlags::FD, ..odd });
        assert_eq!(losses.loss_texts(), [] as [&str; 0]);
        assert_eq!(FormatCapabilities::ALL.kept_frame(&odd), Some(odd));
    }

    #[test]
    fn each_loss_is_counted_and_reported() {
        let mut losses = LossCounter::new(POOR);
        losses.count_frame(&to_frame(5_000));
        losses.count_frame(&Frame { raw_dlc: 9, flags: FrameFlags::RECEIVED, ..to_frame(4_999) });
        losses.count_frame(&Frame { time: None, ..to_frame(0) });
        losses.count_frame(&Frame { flags: FrameFlags::FD, ..to_frame(6_000) });
        losses.count_frame(&Frame { flags: FrameFlags::ERROR, ..to_frame(6_000) });
        losses.count_frame(&to_frame(-1_000));
        losses.miss_notice();
        assert_eq!(
            losses.loss_texts(),
            [
                "1 CAN FD frames dropped",
                "1 error frames written without class and details",
                "1 timestamps truncated to microseconds",
                "1 frames without timestamp, written with that of the frame before",
                "2 timestamps before the first frame, written as that of the first frame",
                "1 negative timestamps, written as 0",
                "1 DLCs above 8, written as 8",
                "1 frames written without direction",
                "1 notices dropped (lost frames, link changes, quiet periods)",
            ]
        );
    }

    #[test]
    fn error_frames_are_held_in_part() {
        let error = |class: u32, bytes: [u8; 8]| Frame {
            flags: FrameFlags::ERROR,
            ..Frame::data_frame(CanId::from_extended(class), &bytes)
        };
        let violations = FormatCapabilities { errors: ErrorFrames::Violations, ..FormatCapabilities::ALL };
        let reports = FormatCapabilities {
            errors: ErrorFrames::Reports,
            directions: DirectionSupport::Assumed,
            ..FormatCapabilities::ALL
        };
        let mark = error(0x88, [0; 8]);
        let stuffing = error(0x288, [0, 0, 0x84, 2, 0, 0, 7, 9]);
        let passive = error(0x204, [0, 0x10, 0, 0, 0, 0, 130, 0]);
        let overload = error(0x88, [0, 0, 0x20, 3, 0, 0, 0, 0]);
        let timeout = error(0x001, [0; 8]);
        let uncounted = error(0x288, [0; 8]);
        let counters = error(0x200, [0, 0, 0, 0, 0, 0, 3, 2]);
        for (holds, given, kept) in [
            (violations, stuffing, error(0x88, [0, 0, 0x84, 2, 0, 0, 0, 0])),
            (violations, passive, mark),
            (violations, overload, error(0x08, [0, 0, 0x20, 0, 0, 0, 0, 0])),
            (violations, timeout, mark),
            (reports, stuffing, stuffing),
            (reports, passive, error(0x04, [0, 0x30, 0, 0, 0, 0, 0, 0])),
            (reports, overload, error(0x88, [0, 0, 0, 3, 0, 0, 0, 0])),
            (reports, timeout, mark),
            (reports, uncounted, mark),
            (reports, counters, counters),
        ] {
            let sent = Frame { flags: given.flags.with(FrameFlags::TRANSMITTED), number: 5, ..given };
            assert_eq!(holds.kept_frame(&sent), Some(Frame { number: 5, ..kept }), "{given:?}");
            let mut losses = LossCounter::new(holds);
            losses.count_frame(&given);
            let lost = "1 error frames written with only part of their class and details".to_owned();
            let mut stated = losses.loss_texts();
            stated.retain(|stated| !stated.ends_with("with unknown error counters, written as 0"));
            assert_eq!(stated, if given == kept { vec![] } else { vec![lost] });
            losses.count_frame(&sent);
            assert_eq!(losses.loss_texts().last().unwrap(), "1 frames written without direction");
        }
    }

    #[test]
    fn unknown_counters_are_none_and_reported() {
        let reports = FormatCapabilities { errors: ErrorFrames::Reports, ..FormatCapabilities::ALL };
        let stuffing = violation_frame(Violation::Stuff, false, 2, None);
        assert_eq!(reports.kept_frame(&stuffing), Some(stuffing));
        let mut losses = LossCounter::new(reports);
        for frame in
            [stuffing, violation_frame(Violation::Form, true, 2, Some(Counters { receive: 0, transmit: 8 }))]
        {
            losses.count_frame(&frame);
        }
        assert_eq!(losses.loss_texts(), ["1 error frames with unknown error counters, written as 0"]);
    }

    #[test]
    fn what_is_kept_is_what_is_read_again() {
        let odd = Frame { raw_dlc: 9, flags: FrameFlags::RECEIVED, ..to_frame(-1) };
        let kept = Frame { raw_dlc: 0, flags: FrameFlags(0), ..to_frame(0) };
        assert_eq!(POOR.kept_frame(&odd), Some(kept));
        let since = FormatCapabilities { resolution: 1_000, ..FormatCapabilities::ALL };
        assert_eq!(since.kept_frame(&odd).unwrap().time, Some(Timestamp(-1_000)));
        assert_eq!(POOR.kept_frame(&Frame { flags: FrameFlags::FD, ..odd }), None);
        let error = Frame {
            flags: FrameFlags::ERROR,
            ..Frame::data_frame(CanId::from_extended(0x204), &[0, 4, 0, 0, 0, 0, 0, 96])
        };
        let mark = POOR.kept_frame(&error).unwrap();
        assert_eq!((mark.id, mark.data()), (CanId::from_extended(0x88), &[0; 8][..]));
        let assumed = FormatCapabilities { directions: DirectionSupport::Assumed, ..FormatCapabilities::ALL };
        assert!(assumed.kept_frame(&to_frame(0)).unwrap().flags.contains(FrameFlags::RECEIVED));
        assert!(
            !assumed
                .kept_frame(&Frame { flags: FrameFlags::TRANSMITTED, ..to_frame(0) })
                .unwrap()
                .flags
                .contains(FrameFlags::RECEIVED)
        );
    }
}
