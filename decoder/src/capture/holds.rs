//! What formats have a place for, and what a capture loses in one that has less.

use super::bus_error::{
    Broken, ControllerState, Counters, Violation, broken, controller, counted, counters, state, violation,
};
use crate::frame::{Frame, FrameFlags, Timestamp};

/// What of error frames a format holds.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum ErrorFrames {
    /// All that SocketCAN says of them.
    Whole,
    /// How the protocol was broken, where in the frame, and who was sending; of others that there was one.
    Violations,
    /// Either a state of the controller, or how and where the protocol was broken and the error counters (both 0
    /// where they are not known), or these counters alone; of others that there was an error.
    Reports,
    /// That there was one, without its class and details.
    Mark,
    /// Nothing: they are left out.
    None,
}

/// What of a frame's direction a format holds.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Directions {
    /// Whether it was received or sent, or that this is not known.
    Whole,
    /// Received or sent: what is not known is written as received.
    Assumed,
    /// Nothing.
    None,
}

/// What a format has a place for, besides identifier, data and time of classic frames and remote frames.
#[derive(Debug, Clone, Copy)]
pub struct Holds {
    /// Unit of its times in nanoseconds.
    pub resolution: i64,
    /// Frames without time; otherwise they get the time of the frame before.
    pub untimed: bool,
    /// Times before that of the first frame; otherwise they are written as that one.
    pub backwards: bool,
    /// Times below zero (before 1970); otherwise they are written as zero.
    pub negative: bool,
    /// CAN FD frames with both their flags; otherwise they are left out.
    pub fd: bool,
    /// Error frames.
    pub errors: ErrorFrames,
    /// DLCs above 8 of classic frames.
    pub raw_dlc: bool,
    /// Received or sent.
    pub directions: Directions,
    /// Names of buses; otherwise they are numbered from 1.
    pub bus_names: bool,
    /// Lost frames, links, and times in which nothing came.
    pub notices: bool,
    /// A text with a frame.
    pub comments: bool,
}

impl ErrorFrames {
    /// Whether some of what they say is held.
    fn is_part(self) -> bool {
        matches!(self, Self::Violations | Self::Reports)
    }

    /// An error frame as it is read again; none where it is left out. What is held in part has no direction.
    fn kept(self, frame: &Frame) -> Option<Frame> {
        let mark = violation(Violation::Other, false, 0, None);
        let found = match self {
            Self::None => return None,
            Self::Whole => return Some(*frame),
            Self::Mark => Frame { flags: frame.flags, ..mark },
            Self::Violations => match broken(frame) {
                Some(Broken { kind: Violation::Overload, .. }) => {
                    violation(Violation::Overload, false, 0, None)
                }
                Some(Broken { kind, sending, place }) => violation(kind, sending, place, None),
                None => mark,
            },
            Self::Reports => Report::of(frame).frame(),
        };
        Some(Frame { number: frame.number, time: frame.time, bus: frame.bus, ..found })
    }
}

/// One of the things that lines of [`ErrorFrames::Reports`] say.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum Report {
    /// The controller changed its state.
    State(ControllerState),
    /// The protocol was broken. It is a bit, its form or its stuffing, or something else at a place. Counters that are
    /// both 0 stand for none: an error that is counted leaves one of them above.
    Broken(Broken, Option<Counters>),
    /// The error counters.
    Counters(Counters),
}

impl Report {
    /// What of an error frame can be said: the state first, it is the rarest.
    pub(super) fn of(frame: &Frame) -> Self {
        let counters = counted(frame);
        match (state(frame), broken(frame), counters) {
            (Some(state), _, _) => Self::State(state),
            (None, None, Some(counters)) => Self::Counters(counters),
            (None, found, _) => {
                let nothing = Broken { kind: Violation::Other, sending: false, place: 0 };
                let found = found.unwrap_or(nothing);
                let kind = match found.kind {
                    kind @ (Violation::Bit | Violation::Form | Violation::Stuff) => kind,
                    _ => Violation::Other,
                };
                Self::Broken(Broken { kind, ..found }, counters.and_then(Counters::of_error))
            }
        }
    }

    /// The error frame that is read again.
    fn frame(self) -> Frame {
        match self {
            Self::State(state) => controller(state),
            Self::Counters(counted) => counters(counted),
            Self::Broken(Broken { kind, sending, place }, counters) => {
                violation(kind, sending, place, counters)
            }
        }
    }
}

impl Holds {
    /// A format that has a place for everything.
    pub const ALL: Self = Self {
        resolution: 1,
        untimed: true,
        backwards: true,
        negative: true,
        fd: true,
        errors: ErrorFrames::Whole,
        raw_dlc: true,
        directions: Directions::Whole,
        bus_names: true,
        notices: true,
        comments: true,
    };

    /// What of a frame is read again; none where it is left out. Its time is not looked at beyond the resolution.
    pub fn kept(&self, frame: &Frame) -> Option<Frame> {
        let is_error = frame.flags.contains(FrameFlags::ERROR);
        if frame.flags.contains(FrameFlags::FD) && !self.fd {
            return None;
        }
        let mut kept = if is_error { self.errors.kept(frame)? } else { *frame };
        kept.time =
            frame.time.map(|time| self.cut(if self.negative { time } else { time.max(Timestamp(0)) }));
        if !self.raw_dlc {
            kept.raw_dlc = 0;
        }
        if is_error && self.errors.is_part() {
            return Some(kept);
        }
        let directions = FrameFlags::TRANSMITTED.with(FrameFlags::RECEIVED);
        match self.directions {
            Directions::Whole => {}
            Directions::Assumed if kept.flags.0 & directions.0 != 0 => {}
            Directions::Assumed => kept.flags = kept.flags.with(FrameFlags::RECEIVED),
            Directions::None => kept.flags = FrameFlags(kept.flags.0 & !directions.0),
        }
        Some(kept)
    }

    /// What it has no place for, a text each.
    pub fn lacks(&self) -> Vec<String> {
        let errors = match self.errors {
            ErrorFrames::Whole => None,
            ErrorFrames::Violations => Some("of error frames, all but how and where the protocol was broken"),
            ErrorFrames::Reports => Some(
                "of error frames, all but the controller's state, how the protocol was broken and the counters (0 where not known), or these alone",
            ),
            ErrorFrames::Mark => Some("class and details of error frames"),
            ErrorFrames::None => Some("error frames"),
        };
        let directions = match self.directions {
            Directions::Whole => None,
            Directions::Assumed => Some("that it is not known whether a frame was received or sent"),
            Directions::None => Some("whether a frame was received or sent"),
        };
        let time = (self.resolution > 1).then(|| format!("times finer than {}", unit(self.resolution)));
        let others = [
            (!self.untimed).then_some("frames without time"),
            (!self.backwards).then_some("times before that of the first frame"),
            (!self.negative).then_some("times below zero"),
            (!self.fd).then_some("CAN FD frames"),
            errors,
            (!self.raw_dlc).then_some("DLCs above 8 of classic frames"),
            directions,
            (!self.bus_names).then_some("names of buses"),
            (!self.notices).then_some("lost frames, links and quiet times"),
            (!self.comments).then_some("comments"),
        ];
        time.into_iter().chain(others.into_iter().flatten().map(str::to_owned)).collect()
    }

    /// A time in the format's unit, cut towards the past.
    pub fn cut(&self, time: Timestamp) -> Timestamp {
        Timestamp(time.0.saturating_sub(time.0.rem_euclid(self.resolution.max(1))))
    }
}

/// Something a frame had and the format has no place for.
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

/// What is said of each, behind the number of frames.
const SAID: [(Loss, &str); 11] = [
    (Loss::FdFrame, "CAN FD frames left out"),
    (Loss::ErrorFrame, "error frames left out"),
    (Loss::ErrorDetail, "error frames without their class and details"),
    (Loss::ErrorCounters, "error frames whose counters are not known, written as 0"),
    (Loss::Resolution, "times cut to"),
    (Loss::NoTime, "frames without time got the time of the frame before"),
    (Loss::Backwards, "times before that of the first frame written as that one"),
    (Loss::Negative, "times below zero written as zero"),
    (Loss::RawDlc, "DLCs above 8 written as 8"),
    (Loss::Direction, "frames without being received or sent"),
    (Loss::DirectionAssumed, "frames not known to be received or sent, written as received"),
];

/// Counts what frames lose in a format.
#[derive(Debug, Clone)]
pub struct Losses {
    holds: Holds,
    first: Option<Timestamp>,
    counts: [u64; SAID.len()],
    notices: u64,
}

impl Losses {
    /// Nothing is lost yet in a format that holds this.
    pub fn new(holds: Holds) -> Self {
        Self { holds, first: None, counts: [0; SAID.len()], notices: 0 }
    }

    /// Another file of the same capture begins: its first frame is the first of it.
    pub fn begin(&mut self) {
        self.first = None;
    }

    /// Counts what a frame loses, in the order in which frames are written.
    pub fn see(&mut self, frame: &Frame) {
        let (holds, flags) = (self.holds, frame.flags);
        let is_error = flags.contains(FrameFlags::ERROR);
        if flags.contains(FrameFlags::FD) && !holds.fd {
            return self.count(Loss::FdFrame);
        }
        if is_error {
            let Some(kept) = holds.errors.kept(frame) else { return self.count(Loss::ErrorFrame) };
            // That is what a mark says of itself: that it knows no more.
            if holds.errors == ErrorFrames::Mark || (kept.id, kept.data()) != (frame.id, frame.data()) {
                self.count(Loss::ErrorDetail);
            }
            // Read again they are none, but other programs show them.
            let writes_counters = holds.errors == ErrorFrames::Reports
                && matches!(Report::of(frame), Report::Broken(_, None))
                && counted(frame).is_none();
            if writes_counters {
                self.count(Loss::ErrorCounters);
            }
        }
        match frame.time {
            None if !holds.untimed => self.count(Loss::NoTime),
            None => {}
            Some(time) => self.see_time(time),
        }
        if frame.raw_dlc > 8 && !flags.contains(FrameFlags::FD) && !holds.raw_dlc {
            self.count(Loss::RawDlc);
        }
        let has_direction = flags.contains(FrameFlags::TRANSMITTED) || flags.contains(FrameFlags::RECEIVED);
        match holds.directions {
            _ if is_error && holds.errors.is_part() && has_direction => self.count(Loss::Direction),
            Directions::None if has_direction => self.count(Loss::Direction),
            Directions::Assumed if !has_direction && !is_error => self.count(Loss::DirectionAssumed),
            _ => {}
        }
    }

    fn see_time(&mut self, time: Timestamp) {
        if self.holds.resolution > 1 && self.holds.cut(time) != time {
            self.count(Loss::Resolution);
        }
        let first = *self.first.get_or_insert(time);
        if time < first && !self.holds.backwards {
            self.count(Loss::Backwards);
        }
        if time.0 < 0 && !self.holds.negative {
            self.count(Loss::Negative);
        }
    }

    /// Counts a notice that had no place.
    pub fn miss_notice(&mut self) {
        self.notices += 1;
    }

    fn count(&mut self, loss: Loss) {
        if let Some(count) =
            SAID.iter().position(|(said, _)| *said == loss).and_then(|at| self.counts.get_mut(at))
        {
            *count += 1;
        }
    }

    /// What was lost, a text each, with how often.
    pub fn said(&self) -> Vec<String> {
        let mut all = Vec::new();
        for ((loss, text), count) in SAID.iter().zip(self.counts).filter(|(_, count)| *count > 0) {
            all.push(match loss {
                Loss::Resolution => format!("{count} {text} {}", unit(self.holds.resolution)),
                Loss::ErrorDetail if self.holds.errors != ErrorFrames::Mark => {
                    format!("{count} error frames with a part of their class and details only")
                }
                _ => format!("{count} {text}"),
            });
        }
        if self.notices > 0 {
            all.push(format!("{} notes of lost frames, links and quiet times left out", self.notices));
        }
        all
    }
}

/// A unit of time by its nanoseconds.
fn unit(nanoseconds: i64) -> String {
    match nanoseconds {
        1_000 => "microseconds".into(),
        1_000_000 => "milliseconds".into(),
        1_000_000_000 => "seconds".into(),
        other if other % 1_000 == 0 => format!("steps of {} microseconds", other / 1_000),
        other => format!("steps of {other} nanoseconds"),
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::frame::CanId;

    const POOR: Holds = Holds {
        resolution: 1_000,
        untimed: false,
        backwards: false,
        negative: false,
        fd: false,
        errors: ErrorFrames::Mark,
        raw_dlc: false,
        directions: Directions::None,
        bus_names: false,
        notices: false,
        comments: false,
    };

    fn frame(time: i64) -> Frame {
        Frame { time: Some(Timestamp(time)), ..Frame::data_frame(CanId::standard(1), &[1; 8]) }
    }

    #[test]
    fn nothing_is_lost_where_there_is_a_place_for_everything() {
        let mut losses = Losses::new(Holds::ALL);
        let odd = Frame { raw_dlc: 15, flags: FrameFlags::TRANSMITTED, ..frame(1_001) };
        losses.see(&odd);
        losses.see(&Frame { time: None, flags: FrameFlags::FD, ..odd });
        assert_eq!(losses.said(), [] as [&str; 0]);
        assert_eq!(Holds::ALL.kept(&odd), Some(odd));
    }

    #[test]
    fn each_loss_is_counted_and_said() {
        let mut losses = Losses::new(POOR);
        losses.see(&frame(5_000));
        losses.see(&Frame { raw_dlc: 9, flags: FrameFlags::RECEIVED, ..frame(4_999) });
        losses.see(&Frame { time: None, ..frame(0) });
        losses.see(&Frame { flags: FrameFlags::FD, ..frame(6_000) });
        losses.see(&Frame { flags: FrameFlags::ERROR, ..frame(6_000) });
        losses.see(&frame(-1_000));
        losses.miss_notice();
        assert_eq!(
            losses.said(),
            [
                "1 CAN FD frames left out",
                "1 error frames without their class and details",
                "1 times cut to microseconds",
                "1 frames without time got the time of the frame before",
                "2 times before that of the first frame written as that one",
                "1 times below zero written as zero",
                "1 DLCs above 8 written as 8",
                "1 frames without being received or sent",
                "1 notes of lost frames, links and quiet times left out",
            ]
        );
    }

    #[test]
    fn error_frames_are_held_in_part() {
        let error = |class: u32, bytes: [u8; 8]| Frame {
            flags: FrameFlags::ERROR,
            ..Frame::data_frame(CanId::extended(class), &bytes)
        };
        let violations = Holds { errors: ErrorFrames::Violations, ..Holds::ALL };
        let reports = Holds { errors: ErrorFrames::Reports, directions: Directions::Assumed, ..Holds::ALL };
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
            assert_eq!(holds.kept(&sent), Some(Frame { number: 5, ..kept }), "{given:?}");
            let mut losses = Losses::new(holds);
            losses.see(&given);
            let lost = "1 error frames with a part of their class and details only".to_owned();
            let mut said = losses.said();
            said.retain(|said| !said.ends_with("whose counters are not known, written as 0"));
            assert_eq!(said, if given == kept { vec![] } else { vec![lost] });
            losses.see(&sent);
            assert_eq!(losses.said().last().unwrap(), "1 frames without being received or sent");
        }
    }

    #[test]
    fn counters_nobody_knows_are_none_and_said_to_be_written() {
        let reports = Holds { errors: ErrorFrames::Reports, ..Holds::ALL };
        let stuffing = violation(Violation::Stuff, false, 2, None);
        assert_eq!(reports.kept(&stuffing), Some(stuffing));
        let mut losses = Losses::new(reports);
        for frame in
            [stuffing, violation(Violation::Form, true, 2, Some(Counters { receive: 0, transmit: 8 }))]
        {
            losses.see(&frame);
        }
        assert_eq!(losses.said(), ["1 error frames whose counters are not known, written as 0"]);
    }

    #[test]
    fn what_is_kept_is_what_is_read_again() {
        let odd = Frame { raw_dlc: 9, flags: FrameFlags::RECEIVED, ..frame(-1) };
        let kept = Frame { raw_dlc: 0, flags: FrameFlags(0), ..frame(0) };
        assert_eq!(POOR.kept(&odd), Some(kept));
        let since = Holds { resolution: 1_000, ..Holds::ALL };
        assert_eq!(since.kept(&odd).unwrap().time, Some(Timestamp(-1_000)));
        assert_eq!(POOR.kept(&Frame { flags: FrameFlags::FD, ..odd }), None);
        let error = Frame {
            flags: FrameFlags::ERROR,
            ..Frame::data_frame(CanId::extended(0x204), &[0, 4, 0, 0, 0, 0, 0, 96])
        };
        let mark = POOR.kept(&error).unwrap();
        assert_eq!((mark.id, mark.data()), (CanId::extended(0x88), &[0; 8][..]));
        let assumed = Holds { directions: Directions::Assumed, ..Holds::ALL };
        assert!(assumed.kept(&frame(0)).unwrap().flags.contains(FrameFlags::RECEIVED));
        assert!(
            !assumed
                .kept(&Frame { flags: FrameFlags::TRANSMITTED, ..frame(0) })
                .unwrap()
                .flags
                .contains(FrameFlags::RECEIVED)
        );
    }
}
