//! `rate`: a signal changes no faster than a limit.

use super::plan::Asked;
use super::signal::{SignalName, Values};
use super::task::Task;
use super::words::{number, time};
use crate::event::{Event, EventKind};
use crate::finding::About;
use crate::rules::Context;

/// Frames that waited for the bus come closer together than their values were taken: no change is judged over
/// less time than this, in nanoseconds.
const SHORTEST: i64 = 1_000_000;

pub(super) struct Rate {
    values: Values<Option<Last>>,
    about: About,
    when: Option<Asked>,
    max: f64,
    /// Interruptions so far: no change is judged across one.
    interrupted: u64,
}

/// The value before.
#[derive(Debug, Clone, Copy)]
struct Last {
    number: f64,
    time: i64,
    interrupted: u64,
}

pub(super) fn new(signal: &SignalName, when: Option<&Asked>, max: f64) -> Rate {
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
        // What an SDO transfer reads comes at the client's time, not the signal's.
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
            format!(
                "from {from} to {to} in {between}: {}{unit}/s; at most {}{unit}/s",
                number(rate),
                number(max)
            )
        };
        context.fail(event).about(self.about.clone()).measure(rate).say(text);
    }

    fn interrupt(&mut self, _context: &mut Context<'_>) {
        self.interrupted += 1;
    }

    fn idle(&self) -> String {
        self.values.idle()
    }
}
