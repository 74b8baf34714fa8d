//! `rate`: limit for the change of a signal per second.

use super::plan::QuotedExpression;
use super::signal::{SignalName, Values};
use super::task::Task;
use super::words::{number, time};
use crate::event::{Event, EventKind};
use crate::finding::About;
use crate::rules::Context;

/// Minimum time for the computation of a rate, in ns: frames delayed by a busy bus follow closer than their
/// samples.
const SHORTEST: i64 = 1_000_000;

pub(super) struct Rate {
    values: Values<Option<Last>>,
    about: About,
    when: Option<QuotedExpression>,
    max: f64,
    /// Number of interruptions; no rate is computed across one.
    interrupted: u64,
}

/// Previous value.
#[derive(Debug, Clone, Copy)]
struct Last {
    number: f64,
    time: i64,
    interrupted: u64,
}

pub(super) fn new(signal: &SignalName, when: Option<&QuotedExpression>, max: f64) -> Rate {
    let about = signal.about();
    Rate { values: Values::new(signal.clone()), about, when: when.cloned(), max, interrupted: 0 }
}

impl Task for Rate {
    #[inline]
    fn event(&mut self, event: &Event, context: &mut Context<'_>) {
        if !context.has_time {
            return;
        }
        let Some(mut reading) = self.values.read(event, context) else { return };
        if self.when.as_ref().is_some_and(|when| !when.matches(event, context)) {
            return;
        }
        let now = Last { number: reading.number, time: context.now, interrupted: self.interrupted };
        // The time of an SDO upload depends on the client, so no rate is computed from it.
        let Some(last) = reading.known.as_mut().and_then(|known| known.replace(now)) else { return };
        if last.interrupted != now.interrupted {
            return;
        }
        let usual = match event.kind {
            EventKind::Pdo(_) => context.traffic.current().and_then(|slot| slot.median),
            _ => None,
        };
        let between = now.time.saturating_sub(last.time);
        let over = between.max(usual.unwrap_or(0)).max(SHORTEST);
        #[expect(clippy::cast_precision_loss, reason = "a time between two messages")]
        let rate = (now.number - last.number).abs() / (over as f64 / 1e9);
        if rate <= self.max {
            return context.pass();
        }
        let (unit, max) = (reading.unit(), self.max);
        let text = || {
            let (from, to, between) = (number(last.number), reading.show(), time(between));
            let (rate, max) = (number(rate), number(max));
            format!("{rate}{unit}/s (max {max}{unit}/s): {from} to {to} in {between}")
        };
        context.fail(event).about(self.about.clone()).measure(rate).report(text);
    }

    fn interrupt(&mut self, _context: &mut Context<'_>) {
        self.interrupted += 1;
    }

    fn idle(&self) -> String {
        self.values.idle()
    }
}
