//! Frame statistics of a bus per second: frames, error frames and bits for the bus load.
//!
//! The exact length of a frame with stuff bits is slow to compute. It is counted only if the bus may be busy;
//! otherwise the minimum and maximum lengths are sufficient.

use crate::event::FrameRange;
use crate::frame::{CanId, Frame, FrameFlags};
use crate::statistics::frame_bits;

/// One second in ns.
const SECOND: i64 = 1_000_000_000;

/// SocketCAN error classes for a disturbed frame: protocol, no acknowledgement, bus error. The other classes
/// report states, or no error (lost arbitration).
const DISTURBED: u32 = 0x008 | 0x020 | 0x080;

/// Statistics of one second of bus time.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub struct BusSecond {
    /// Sequence number, from 1; 0 before the end of the first second.
    pub number: u64,
    /// First and last frame.
    pub frames: FrameRange,
    /// Number of frames, including error frames.
    pub count: u64,
    /// Error frames for a disturbed frame.
    pub errors: u64,
    /// Bits without stuff bits.
    pub least: u64,
    /// Bits with the maximum number of stuff bits.
    pub most: u64,
    /// Exact number of bits; None if it was not counted.
    pub bits: Option<u64>,
}

/// Frame statistics of a bus.
#[derive(Debug, Clone, Default)]
pub struct FrameMeter {
    /// Bit rate in bit/s, if known.
    pub bit_rate: Option<u32>,
    /// Number of frames, including error frames.
    pub frames: u64,
    /// Error frames for a disturbed frame.
    pub errors: u64,
    /// Two intervals between timestamps differed, so the timestamps are real.
    pub has_varied: bool,
    /// Last complete second.
    pub last: BusSecond,
    /// The second that has begun; its number of frames and its last frame are added at its end.
    current: BusSecond,
    /// Number of frames before the current second.
    before: u64,
    last_frame: u64,
    began: i64,
    /// [`SECOND`] if a later timestamp has an effect only after the current second, otherwise 0.
    window: u64,
    time: Option<i64>,
    interval: Option<i64>,
    /// A second ended since the last call of `take_over`.
    is_over: bool,
}

impl FrameMeter {
    pub(in crate::rules) fn new(bit_rate: Option<u32>) -> Self {
        Self { bit_rate: bit_rate.filter(|rate| *rate > 0), ..Self::default() }
    }

    /// Whether a second ended since the last call of [`Self::take_over`].
    #[inline]
    pub(in crate::rules) fn is_over(&self) -> bool {
        self.is_over
    }

    /// Whether a second ended since the last call.
    #[inline]
    pub(in crate::rules) fn take_over(&mut self) -> bool {
        std::mem::take(&mut self.is_over)
    }

    #[inline]
    pub(in crate::rules) fn measure_frame(&mut self, frame: &Frame) {
        // The difference to an earlier time is more than any window.
        if let Some(time) = frame.time
            && !self.is_in_second(time.0)
        {
            self.move_to(time.0, frame.number);
        }
        self.frames += 1;
        self.last_frame = frame.number;
        if self.bit_rate.is_some() || frame.flags.contains(FrameFlags::ERROR) {
            self.count_frame(frame);
        }
    }

    /// Whether a frame at this time has no other effect than its count.
    #[inline]
    pub(in crate::rules) fn is_in_second(&self, time: i64) -> bool {
        time.wrapping_sub(self.began).cast_unsigned() < self.window
    }

    /// Counts frames for which [`Self::is_in_second`] holds; none of them is an error frame.
    pub(in crate::rules) fn count_frames(&mut self, frames: &[Frame]) {
        self.frames += frames.len() as u64;
        self.last_frame = frames.last().map_or(self.last_frame, |frame| frame.number);
        if self.bit_rate.is_some() {
            for frame in frames {
                self.count_frame(frame);
            }
        }
    }

    #[cold]
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
        self.window = if self.has_varied { SECOND.cast_unsigned() } else { 0 };
    }

    fn next_second(&mut self, time: i64, frame: u64, is_restart: bool) {
        let mut is_busy = false;
        // A second in which the clock was set back is dropped.
        if !is_restart {
            let number = self.last.number + 1;
            let count = self.frames - self.before;
            let frames = FrameRange { last: self.last_frame, ..self.current.frames };
            self.last = BusSecond { number, frames, count, ..self.current };
            self.is_over = true;
            is_busy = self.bit_rate.is_some_and(|rate| self.last.most > u64::from(rate) / 2);
        }
        self.began = time;
        self.before = self.frames;
        self.current =
            BusSecond { frames: FrameRange::one(frame), bits: is_busy.then_some(0), ..BusSecond::default() };
    }

    /// Counts an error frame, or the bits of another frame.
    #[inline(never)]
    fn count_frame(&mut self, frame: &Frame) {
        if frame.flags.contains(FrameFlags::ERROR) {
            let is_disturbed = frame.id.number() & DISTURBED != 0;
            self.errors += u64::from(is_disturbed);
            self.current.errors += u64::from(is_disturbed);
        } else if self.bit_rate.is_some() {
            self.count_bits(frame);
        }
    }

    fn count_bits(&mut self, frame: &Frame) {
        if frame.flags.contains(FrameFlags::FD) {
            return;
        }
        // ISO 11898-1 §10.4, §10.5: fixed fields, the payload, and at most one stuff bit after every four
        // bits.
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

    fn metered(bit_rate: Option<u32>, stamps: impl Iterator<Item = i64>) -> FrameMeter {
        let mut meter = FrameMeter::new(bit_rate);
        for (number, time) in (1..).zip(stamps) {
            let frame = Frame::data_frame(CanId::from_standard(0x555), &[]);
            meter.measure_frame(&Frame { number, time: Some(Timestamp(time)), ..frame });
        }
        meter
    }

    #[test]
    fn seconds_are_counted_exactly_while_the_bus_may_be_busy() {
        // 47 bits without stuff bits, 48 actual, 47 + 33 / 4 = 55 at most.
        let second = metered(Some(10_000), (0..11).map(|n| n * 100_000_000)).last;
        assert_eq!((second.number, second.count, second.least, second.most), (1, 10, 470, 550));
        assert_eq!((second.bits, second.frames), (None, FrameRange { first: 1, last: 10 }));
        let busy = metered(Some(1_000), (0..21).map(|n| n * 100_000_000)).last;
        assert_eq!((busy.number, busy.bits), (2, Some(480)));
        assert_eq!(metered(None, (0..21).map(|n| n * 100_000_000)).last.most, 0);
    }

    #[test]
    fn a_clock_set_back_ends_no_second() {
        // A new second starts at 0.5 s: two frames until 1.5 s.
        let stamps = [1_000_000_000, 1_400_000_000, 500_000_000, 1_200_000_000, 1_500_000_000];
        let meter = metered(None, stamps.into_iter());
        assert_eq!((meter.last.number, meter.last.count, meter.frames), (1, 2, 5));
        assert!(meter.has_varied);
        assert!(!metered(None, (0..9).map(|n| n * 1_000)).has_varied);
    }
}
