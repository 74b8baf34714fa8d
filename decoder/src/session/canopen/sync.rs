//! SYNC, TIME, and the marks of a conformance test.

use crate::event::EventKind;
use crate::frame::Frame;
use crate::session::context::Context;
use crate::session::machine::Machine;
use crate::wire::canopen::{sync, test_marker, time};

/// SYNC and its counter.
#[derive(Debug, Clone, Default)]
pub(in crate::session) struct Sync {
    /// Counter of the last one.
    counter: Option<u8>,
}

/// TIME.
#[derive(Debug, Clone, Default)]
pub(in crate::session) struct TimeStamps {
    /// The last one in milliseconds since 1984, and its monotonic time in ns.
    last: Option<(i64, i64)>,
}

/// Marks of CiA's conformance test tool. They are no evidence of CANopen: any frame may look like one.
#[derive(Debug, Clone)]
pub(in crate::session) struct ConformanceMarks;

/// A clock that is off by less, in milliseconds, is the same clock.
const CLOCK_TOLERANCE: i64 = 1_000;

impl TimeStamps {
    /// Whether a TIME says what the one before and the time since let expect.
    fn is_expected(&mut self, milliseconds: i64, now: i64) -> bool {
        let before = self.last.replace((milliseconds, now));
        before.is_some_and(|(then, at)| {
            let elapsed = now.saturating_sub(at) / 1_000_000;
            (milliseconds - then - elapsed).abs() < CLOCK_TOLERANCE
        })
    }
}

impl Sync {
    /// Takes the next counter; gives the one that should have come if another came.
    ///
    /// The overflow value (1019) may be unknown, so a step back to 1 is always right (CiA 301 §7.2.5.3).
    fn take_counter(&mut self, counter: Option<u8>) -> Option<u8> {
        let before = std::mem::replace(&mut self.counter, counter);
        let (before, now) = (before?, counter?);
        let expected = if before >= 240 { 1 } else { before + 1 };
        (now != expected && now != 1).then_some(expected)
    }
}

impl Machine for Sync {
    type Route<'a> = ();
    /// Whether it is a SYNC of CANopen, on which devices act.
    type Product = bool;

    fn on_frame(&mut self, (): (), frame: &Frame, cx: &mut Context<'_>) -> bool {
        if frame.length <= 1 {
            cx.bus.canopen.count_sync();
        } else {
            cx.bus.canopen.add_contradiction();
        }
        if !cx.is_decoded(frame) {
            return false;
        }
        cx.bus.clock.saw_periodic();
        let counter = sync::parse(frame.data());
        let first = cx.bus.last_sync.replace(frame.id).is_none();
        let expected = self.take_counter(counter);
        let routine = !first && expected.is_none();
        cx.emit(frame, None, routine, EventKind::Sync { counter, expected });
        true
    }
}

impl Machine for ConformanceMarks {
    type Route<'a> = ();
    type Product = ();

    fn on_frame(&mut self, (): (), frame: &Frame, cx: &mut Context<'_>) {
        match test_marker::parse(frame.data()).filter(|_| cx.bus.canopen.is_confirmed()) {
            Some(marker) => cx.emit(frame, None, false, EventKind::TestCase(marker)),
            None => cx.emit_undecoded(frame, None),
        }
    }
}

impl Machine for TimeStamps {
    type Route<'a> = ();
    type Product = ();

    fn on_frame(&mut self, (): (), frame: &Frame, cx: &mut Context<'_>) {
        if !cx.is_decoded(frame) {
            return;
        }
        match time::parse(frame.data()) {
            Ok(time) => {
                let kind = EventKind::Time { milliseconds: time.milliseconds, days: time.days };
                let total = i64::from(time.days) * 86_400_000 + i64::from(time.milliseconds);
                let now = cx.bus.clock.now();
                let routine = self.is_expected(total, now) && cx.bus.clock.runs();
                cx.emit(frame, None, routine, kind);
            }
            Err(error) => cx.emit_malformed(frame, None, error, "TIME has six bytes"),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn counters_run_to_their_overflow_and_start_at_one() {
        let mut state = Sync::default();
        let gaps: Vec<_> =
            [1, 2, 3, 1, 2, 5, 6].iter().map(|counter| state.take_counter(Some(*counter))).collect();
        assert_eq!(gaps, [None, None, None, None, None, Some(3), None]);
        assert_eq!(state.take_counter(None), None);
    }
}
