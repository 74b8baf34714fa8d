//! TIME: the producer's clock, and traffic on its identifier that is not a clock.

use crate::event::EventKind;
use crate::frame::Frame;
use crate::session::context::MachineContext;
use crate::session::machine::ProtocolMachine;
use crate::wire::canopen::time;

/// Max deviation of a clock that was not set, in ms.
const CLOCK_TOLERANCE: i64 = 1_000;

/// Min time over which a clock must advance with the capture, in ms: the tolerance hides a constant below it.
const JUDGED_OVER: i64 = 2_000;

/// Milliseconds of a day (CiA 301 §7.1.6.5: TIME_OF_DAY counts from midnight).
const DAY: u32 = 86_400_000;

/// Contradictions after which the identifier is not TIME: a clock may be set, but not every time.
const CONTRADICTION_LIMIT: u32 = 10;

/// Number of consecutive intervals shorter than `FASTEST` after which the identifier is not TIME.
const FAST_LIMIT: u32 = 10;

/// Shortest plausible period of TIME in ns: its resolution is 1 ms, usual periods are 1 s and more.
const FASTEST: i64 = 10_000_000;

/// TIME messages, and whether they are a clock.
#[derive(Debug, Clone, Default)]
pub(in crate::session) struct TimeStamps {
    /// Last value in ms since 1984, and its monotonic time in ns.
    last: Option<(i64, i64)>,
    /// Value and time since which the clock was not set.
    anchor: Option<(i64, i64)>,
    agreements: u32,
    contradictions: u32,
    fast: u32,
    is_reported: bool,
}

impl TimeStamps {
    /// Whether a TIME matches the previous one plus the elapsed time.
    fn is_expected(&self, milliseconds: i64, now: i64) -> bool {
        self.last.is_some_and(|last| time_deviation(last, milliseconds, now) < CLOCK_TOLERANCE)
    }

    /// Compares a value with the time of the capture; without timestamps (`runs` false) it must only increase.
    fn weigh_value(&mut self, value: i64, is_of_day: bool, now: i64, runs: bool) {
        let before = self.last.replace((value, now));
        let is_fast = runs && before.is_some_and(|(_, at)| now.saturating_sub(at) < FASTEST);
        // A later pause does not turn fast traffic into a clock.
        if is_fast {
            self.fast = self.fast.saturating_add(1);
        } else if self.fast < FAST_LIMIT {
            self.fast = 0;
        }
        let anchor = *self.anchor.get_or_insert((value, now));
        let elapsed = now.saturating_sub(anchor.1) / 1_000_000;
        let is_contradicted = if runs {
            time_deviation(anchor, value, now) >= CLOCK_TOLERANCE
        } else {
            before.is_some_and(|(then, _)| value <= then)
        };
        if is_contradicted || !is_of_day {
            self.contradictions = self.contradictions.saturating_add(1);
            self.anchor = Some((value, now));
        } else if !runs && before.is_some() || elapsed >= JUDGED_OVER {
            self.agreements = self.agreements.saturating_add(1);
        }
    }

    /// Reason why the identifier is not TIME; `None` if it may be.
    fn rejection_reason(&self) -> Option<&'static str> {
        if self.fast >= FAST_LIMIT {
            return Some("period below 10 ms");
        }
        let is_rejected = self.contradictions >= CONTRADICTION_LIMIT && self.contradictions > self.agreements;
        is_rejected.then_some("value does not advance with time")
    }
}

/// Difference between a value and an earlier one plus the elapsed time, in ms.
fn time_deviation((then, at): (i64, i64), value: i64, now: i64) -> i64 {
    let elapsed = now.saturating_sub(at) / 1_000_000;
    value.saturating_sub(then).saturating_sub(elapsed).saturating_abs()
}

impl ProtocolMachine for TimeStamps {
    type Route<'a> = ();
    type Product = ();

    fn on_frame(&mut self, (): (), frame: &Frame, cx: &mut MachineContext<'_>) {
        let time = match time::parse(frame.data()) {
            Ok(time) => time,
            // The length alone is evidence only on a bus that uses CANopen.
            Err(error) if cx.is_settled(None) => {
                return cx.emit_malformed(frame, None, error, "TIME has six bytes");
            }
            Err(_) => return cx.emit_undecoded(frame, None),
        };
        let total = i64::from(time.days) * i64::from(DAY) + i64::from(time.milliseconds);
        let (now, runs) = (cx.bus.clock.now(), cx.bus.clock.has_timestamps());
        let routine = self.is_expected(total, now) && runs;
        self.weigh_value(total, time.milliseconds < DAY, now, runs);
        let is_given = cx.bus.routes.is_given(frame.id);
        if let Some(reason) = self.rejection_reason().filter(|_| !is_given) {
            return self.on_other_traffic(reason, frame, cx);
        }
        cx.bus.protocols.is_time_rejected = false;
        // Without evidence of CANopen, only a clock that was observed to run is TIME.
        let is_believed = is_given || cx.is_settled(None) || self.agreements > 0;
        if !is_believed {
            return cx.emit_undecoded(frame, None);
        }
        if cx.is_decoded(None, frame) {
            let kind = EventKind::Time { milliseconds: time.milliseconds, days: time.days };
            cx.emit_event(frame, None, routine, kind);
        }
    }
}

impl TimeStamps {
    /// Handles a frame on the identifier of TIME that is not a clock.
    fn on_other_traffic(&mut self, reason: &str, frame: &Frame, cx: &mut MachineContext<'_>) {
        cx.bus.protocols.is_time_rejected = true;
        if cx.is_settled(None) {
            cx.bus.protocols.omissions.time += 1;
            if !std::mem::replace(&mut self.is_reported, true) {
                let text =
                    format!("identifier {} is not TIME: {reason}; its frames are not decoded", frame.id);
                cx.emit_note(frame, text);
            }
        }
        cx.emit_undecoded(frame, None);
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const SECOND: i64 = 1_000_000_000;

    /// Weighs values in ms at times in ms.
    fn weighed(messages: impl Iterator<Item = (i64, i64)>, runs: bool) -> TimeStamps {
        let mut stamps = TimeStamps::default();
        messages.for_each(|(value, at)| stamps.weigh_value(value, true, at * 1_000_000, runs));
        stamps
    }

    #[test]
    fn a_clock_runs_with_the_capture_and_may_be_set() {
        let mut stamps = weighed((0..10).map(|count| (5_000 + count * 1_000, count * 1_000)), true);
        assert!(stamps.agreements >= 7 && stamps.rejection_reason().is_none());
        // Set by an hour: one contradiction.
        stamps.weigh_value(3_600_000, true, 10 * SECOND, true);
        assert_eq!((stamps.contradictions, stamps.rejection_reason()), (1, None));
    }

    #[test]
    fn a_constant_and_a_counter_of_frames_are_not_clocks() {
        let constant = weighed((0..11).map(|count| (7, count * 1_000)), true);
        assert_eq!(constant.rejection_reason(), Some("value does not advance with time"));
        // 11 messages 100 ms apart deviate by 1.1 s - 11 ms: one contradiction each time.
        let counter = weighed((0..111).map(|count| (count, count * 100)), true);
        assert_eq!(
            (counter.agreements, counter.rejection_reason()),
            (0, Some("value does not advance with time"))
        );
    }

    #[test]
    fn a_thousand_messages_per_second_are_not_time_even_if_they_advance() {
        let fast = weighed((0..12).map(|count| (count, count)), true);
        assert_eq!(fast.rejection_reason(), Some("period below 10 ms"));
        // Ten intervals of 10 ms are slow enough.
        assert_eq!(weighed((0..12).map(|count| (count * 10, count * 10)), true).rejection_reason(), None);
    }

    #[test]
    fn without_timestamps_the_value_must_increase() {
        assert_eq!(weighed((0..5).map(|count| (count, 0)), false).rejection_reason(), None);
        assert!(weighed((0..11).map(|_| (9, 0)), false).rejection_reason().is_some());
    }

    #[test]
    fn more_milliseconds_than_a_day_contradict() {
        let mut stamps = TimeStamps::default();
        (0..10).for_each(|count| stamps.weigh_value(86_400_000 + count * 1_000, false, count * SECOND, true));
        assert!(stamps.rejection_reason().is_some());
    }
}
