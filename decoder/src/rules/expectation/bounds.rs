//! `bounds`: a signal must stay between two values.

use super::plan::{Limits, QuotedExpression};
use super::signal::{SignalName, Values};
use super::task::Task;
use super::words::number;
use crate::event::Event;
use crate::finding::About;
use crate::rules::Context;

pub(super) struct Bounds {
    values: Values<()>,
    about: About,
    when: Option<QuotedExpression>,
    limits: Limits<f64>,
}

pub(super) fn new(signal: &SignalName, when: Option<&QuotedExpression>, limits: Limits<f64>) -> Bounds {
    Bounds { values: Values::new(signal.clone()), about: signal.about(), when: when.cloned(), limits }
}

impl Task for Bounds {
    #[inline]
    fn event(&mut self, event: &Event, context: &mut Context<'_>) {
        let Some(reading) = self.values.read(event, context) else { return };
        if self.when.as_ref().is_some_and(|when| !when.matches(event, context)) {
            return;
        }
        let value = reading.number;
        let (excess, limit, word) = match self.limits {
            Limits { min: Some(min), .. } if value < min => (min - value, min, "min"),
            Limits { max: Some(max), .. } if value > max => (value - max, max, "max"),
            _ => return context.pass(),
        };
        let text = || format!("{} ({word} {}{})", reading.show(), number(limit), reading.unit());
        context.fail(event).about(self.about.clone()).measure(excess).report(text);
    }

    fn idle(&self) -> String {
        self.values.idle()
    }
}
