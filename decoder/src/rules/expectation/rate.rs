//! `rate`: limit for the change of a signal per second.

use super::plan::QuotedExpression;
use super::signal::{SignalReference, SignalSources};
use super::task::ExpectationTask;
use super::words::{format_number, format_time};
use crate::event::{Event, EventKind};
use crate::finding::FindingSubject;
use crate::rules::RuleContext;

/// Minimum time for the computation of a rate, in ns: frames delayed by a busy bus follow closer than their
/// samples.
const SHORTEST: i64 = 1_000_000;

pub(super) struct RateTask {
    values: SignalSources<Option<PreviousValue>>,
    about: FindingSubject,
    when: Option<QuotedExpression>,
    max: f64,
    /// Number of interruptions; no rate is computed across one.
    interrupted: u64,
}

/// Previous value.
#[derive(Debug, Clone, Copy)]
struct PreviousValue {
    number: f64,
    time: i64,
    interrupted: u64,
}

pub(super) fn new(signal: &SignalReference, when: Option<&QuotedExpression>, max: f64) -> RateTask {
    let about = signal.finding_subject();
    RateTask { values: SignalSources::new(signal.clone()), about, when: when.cloned(), max, interrupted: 0 }
}

impl ExpectationTask for RateTask {
    #[inline]
    fn on_event(&mut self, event: &Event, context: &mut RuleContext<'_>) {
        if !context.has_time {
            return;
        }
        let Some(mut reading) = self.values.read_value(event, context) else { return };
        if self.when.as_ref().is_some_and(|when| !when.matches_event(event, context)) {
            return;
        }
        let now = PreviousValue { number: reading.number, time: context.now, interrupted: self.interrupted };
        // The time of an SDO upload depends on the client, so no rate is computed from it.
        let Some(last) = reading.known.as_mut().and_then(|known| known.replace(now)) else { return };
        if last.interrupted != now.interrupted {
            return;
        }
        let usual = match event.kind {
            EventKind::Pdo(_) => context.traffic.current_slot().and_then(|slot| slot.median),
            _ => None,
        };
        let between = now.time.saturating_sub(last.time);
        let over = between.max(usual.unwrap_or(0)).max(SHORTEST);
        #[expect(clippy::cast_precision_loss, reason = "a time between two messages")]
        let rate = (now.number - last.number).abs() / (over as f64 / 1e9);
        if rate <= self.max {
            return context.count_pass();
        }
        let (unit, max) = (reading.unit_suffix(), self.max);
        let text = || {
            let (from, to, between) =
                (format_number(last.number), reading.show_value(), format_time(between));
            let (rate, max) = (format_number(rate), format_number(max));
            format!("{rate}{unit}/s (max {max}{unit}/s): {from} to {to} in {between}")
        };
        context.start_finding(event).with_subject(self.about.clone()).with_measure(rate).report_finding(text);
    }

    fn on_gap(&mut self, _context: &mut RuleContext<'_>) {
        self.interrupted += 1;
    }

    fn idle_reason(&self) -> String {
        self.values.idle_reason()
    }
}
