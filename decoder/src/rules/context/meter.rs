//! Frames of a bus second by second: how many, how many of them report errors, how much of the bit rate they take.
//!
//! How long a frame is with its stuff bits takes long to find out, so it is counted only while the bus may be busy:
//! otherwise the length without any and with as many as there can be tell enough.

use crate::event::FrameRange;
use crate::frame::{CanId, Frame, FrameFlags};
use crate::statistics::frame_bits;

/// A second in nanoseconds.
const SECOND: i64 = 1_000_000_000;

/// Classes of SocketCAN's error frames that report a disturbed frame: protocol, no acknowledgement, bus error. The
/// others report states, or what is no error (lost arbitration).
const DISTURBED: u32 = 0x008 | 0x020 | 0x080;

/// A second of a bus.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub struct Second {
    /// Which one, from 1; 0 before the first is over.
    pub number: u64,
    /// Its first and last frame.
    pub frames: FrameRange,
    /// Frames.
    pub count: u64,
    /// Frames that report a disturbed one.
    pub errors: u64,
    /// Bits without stuff bits.
    pub least: u64,
    /// Bits with as many stuff bits as there can be.
    pub most: u64,
    /// Bits, if they were counted.
    pub bits: Option<u64>,
}

/// What is known of the frames of a bus.
#[derive(Debug, Clone, Default)]
pub struct Meter {
    /// Bits a second, where the user said it.
    pub bit_rate: Option<u32>,
    /// Frames, error frames among them.
    pub frames: u64,
    /// Frames that report a disturbed one.
    pub errors: u64,
    /// Two intervals between stamps differed: they are not made up.
    pub has_varied: bool,
    /// The last second that is over.
    pub last: Second,
    current: Second,
    began: i64,
    time: Option<i64>,
    interval: Option<i64>,
    /// A second is over since it was asked.
    is_over: bool,
}

impl Meter {
    pub(in crate::rules) fn new(bit_rate: Option<u32>) -> Self {
        Self { bit_rate: bit_rate.filter(|rate| *rate > 0), ..Self::default() }
    }

    /// Whether a second is over since the last question.
    #[inline]
    pub(in crate::rules) fn take_over(&mut self) -> bool {
        std::mem::take(&mut self.is_over)
    }

    #[inline]
    pub(in crate::rules) fn frame(&mut self, frame: &Frame) {
        self.frames += 1;
        if let Some(time) = frame.time {
            self.move_to(time.0, frame.number);
        }
        self.current.frames.last = frame.number;
        self.current.count += 1;
        if frame.flags.contains(FrameFlags::ERROR) {
            let is_disturbed = frame.id.number() & DISTURBED != 0;
            self.errors += u64::from(is_disturbed);
            self.current.errors += u64::from(is_disturbed);
        } else if self.bit_rate.is_some() {
            self.count_bits(frame);
        }
    }

    #[inline]
    fn move_to(&mut self, time: i64, frame: u64) {
        if !self.has_varied
            && let Some(before) = self.time
        {
            let interval = time.saturating_sub(before);
            self.has_varied = *self.interval.get_or_insert(interval) != interval;
        }
        let is_first = self.time.is_none();
        self.time = Some(time);
        let since = time.saturating_sub(self.began);
        if is_first || !(0..SECOND).contains(&since) {
            self.next_second(time, frame, is_first || since < 0);
        }
    }

    #[cold]
    fn next_second(&mut self, time: i64, frame: u64, is_anew: bool) {
        let mut is_busy = false;
        // A second in which the clock was set back is none.
        if !is_anew {
            let number = self.last.number + 1;
            self.last = Second { number, ..self.current };
            self.is_over = true;
            is_busy = self.bit_rate.is_some_and(|rate| self.last.most > u64::from(rate) / 2);
        }
        self.began = time;
        self.current =
            Second { frames: FrameRange::one(frame), bits: is_busy.then_some(0), ..Second::default() };
    }

    fn count_bits(&mut self, frame: &Frame) {
        if frame.flags.contains(FrameFlags::FD) {
            return;
        }
        // ISO 11898-1 §10.4, §10.5: fixed fields, the payload, and a stuff bit behind each four at most.
        let payload = 8 * frame.data().len().min(8) as u64;
        let (fixed, stuffed) = match frame.id {
            CanId::Standard(_) => (47, 34),
            CanId::Extended(_) => (67, 54),
        };
        self.current.least += fixed + payload;
        self.current.most += fixed + payload + (stuffed + payload - 1) / 4;
        if let Some(bits) = &mut self.current.bits {
            *bits += u64::from(frame_bits(frame).unwrap_or(0));
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::frame::Timestamp;

    fn metered(bit_rate: Option<u32>, stamps: impl Iterator<Item = i64>) -> Meter {
        let mut meter = Meter::new(bit_rate);
        for (number, time) in (1..).zip(stamps) {
            let frame = Frame::data_frame(CanId::standard(0x555), &[]);
            meter.frame(&Frame { number, time: Some(Timestamp(time)), ..frame });
        }
        meter
    }

    #[test]
    fn seconds_are_counted_exactly_while_the_bus_may_be_busy() {
        // 47 bits without stuff bits, 48 as they are, 47 + 33 / 4 = 55 at most.
        let second = metered(Some(10_000), (0..11).map(|n| n * 100_000_000)).last;
        assert_eq!((second.number, second.count, second.least, second.most), (1, 10, 470, 550));
        assert_eq!((second.bits, second.frames), (None, FrameRange { first: 1, last: 10 }));
        let busy = metered(Some(1_000), (0..21).map(|n| n * 100_000_000)).last;
        assert_eq!((busy.number, busy.bits), (2, Some(480)));
        assert_eq!(metered(None, (0..21).map(|n| n * 100_000_000)).last.most, 0);
    }

    #[test]
    fn a_clock_set_back_ends_no_second() {
        // A second begins anew at 0.5 s: two frames until 1.5 s.
        let stamps = [1_000_000_000, 1_400_000_000, 500_000_000, 1_200_000_000, 1_500_000_000];
        let meter = metered(None, stamps.into_iter());
        assert_eq!((meter.last.number, meter.last.count, meter.frames), (1, 2, 5));
        assert!(meter.has_varied);
        assert!(!metered(None, (0..9).map(|n| n * 1_000)).has_varied);
    }
}
