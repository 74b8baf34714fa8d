//! SYNC, TIME, and the marks of a conformance test.

use crate::event::EventKind;
use crate::frame::{CanId, Frame};
use crate::session::{Bus, Observer};
use crate::wire::canopen::{sync, test_marker, time};

/// What is known of the SYNC.
#[derive(Debug, Clone, Default)]
pub(in crate::session) struct SyncState {
    /// Identifier of the last one.
    pub(in crate::session) id: Option<CanId>,
    counter: Option<u8>,
    /// Last TIME in milliseconds since 1984, and when it came.
    time: Option<(i64, i64)>,
}

/// A clock that is off by less, in milliseconds, is the same clock.
const CLOCK_TOLERANCE: i64 = 1_000;

impl SyncState {
    /// Whether a TIME says what the one before and the time since let expect.
    fn expects(&mut self, milliseconds: i64, now: i64) -> bool {
        let before = self.time.replace((milliseconds, now));
        before.is_some_and(|(then, at)| {
            let elapsed = now.saturating_sub(at) / 1_000_000;
            (milliseconds - then - elapsed).abs() < CLOCK_TOLERANCE
        })
    }

    /// Takes the next counter; gives the one that should have come if another came.
    ///
    /// The overflow value (1019) may be unknown, so a step back to 1 is always right (CiA 301 §7.2.5.3).
    fn take(&mut self, counter: Option<u8>) -> Option<u8> {
        let before = std::mem::replace(&mut self.counter, counter);
        let (before, now) = (before?, counter?);
        let expected = if before >= 240 { 1 } else { before + 1 };
        (now != expected && now != 1).then_some(expected)
    }
}

impl Bus {
    pub(in crate::session) fn on_sync(&mut self, frame: &Frame, out: &mut dyn Observer) {
        if frame.length <= 1 {
            self.belief.saw_sync();
        } else {
            self.belief.contradict();
        }
        if !self.is_decoded(frame, out) {
            return;
        }
        self.clock.saw_periodic();
        let counter = sync::parse(frame.data());
        let first = self.sync.id.replace(frame.id).is_none();
        let expected = self.sync.take(counter);
        let routine = !first && expected.is_none();
        self.emit(frame, None, routine, EventKind::Sync { counter, expected }, out);
        self.device_saw_sync(frame, out);
    }

    /// The mark proves nothing of the bus: any frame may look like it.
    pub(in crate::session) fn on_test_marker(&mut self, frame: &Frame, out: &mut dyn Observer) {
        match test_marker::parse(frame.data()).filter(|_| self.belief.is_believed()) {
            Some(marker) => self.emit(frame, None, false, EventKind::TestCase(marker), out),
            None => self.undecoded(frame, None, out),
        }
    }

    pub(in crate::session) fn on_time(&mut self, frame: &Frame, out: &mut dyn Observer) {
        if !self.is_decoded(frame, out) {
            return;
        }
        match time::parse(frame.data()) {
            Ok(time) => {
                let kind = EventKind::Time { milliseconds: time.milliseconds, days: time.days };
                let total = i64::from(time.days) * 86_400_000 + i64::from(time.milliseconds);
                let now = self.clock.now();
                let routine = self.sync.expects(total, now) && self.clock.runs();
                self.emit(frame, None, routine, kind, out);
            }
            Err(error) => self.malformed(frame, None, error, "TIME has six bytes", out),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn counters_run_to_their_overflow_and_start_at_one() {
        let mut state = SyncState::default();
        let gaps: Vec<_> = [1, 2, 3, 1, 2, 5, 6].iter().map(|counter| state.take(Some(*counter))).collect();
        assert_eq!(gaps, [None, None, None, None, None, Some(3), None]);
        assert_eq!(state.take(None), None);
    }
}
