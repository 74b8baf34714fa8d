//! `bounds`: a signal must stay between two values.

use super::plan::{QuotedExpression, ValueLimits};
use super::signal::{SignalReference, SignalSources};
use super::task::ExpectationTask;
use super::words::format_number;
use crate::event::Event;
use crate::finding::FindingSubject;
use crate::rules::RuleContext;

pub(super) struct BoundsTask {
    values: SignalSources<()>,
    about: FindingSubject,
    when: Option<QuotedExpression>,
    limits: ValueLimits<f64>,
}

pub(super) fn new(
    signal: &SignalReference,
    when: Option<&QuotedExpression>,
    limits: ValueLimits<f64>,
) -> BoundsTask {
    BoundsTask {
        values: SignalSources::new(signal.clone()),
        about: signal.finding_subject(),
        when: when.cloned(),
        limits,
    }
}

impl ExpectationTask for BoundsTask {
    #[inline]
    fn on_event(&mut self, event: &Event, context: &mut RuleContext<'_>) {
        let Some(reading) = self.values.read_value(event, context) else { return };
        if self.when.as_ref().is_some_and(|when| !when.matches_event(event, context)) {
            return;
        }
        let value = reading.number;
        let (excess, limit, word) = match self.limits {
            ValueLimits { min: Some(min), .. } if value < min => (min - value, min, "min"),
            ValueLimits { max: Some(max), .. } if value > max => (value - max, max, "max"),
            _ => return context.count_pass(),
        };
        let text =
            || format!("{} ({word} {}{})", reading.show_value(), format_number(limit), reading.unit_suffix());
        context
            .start_finding(event)
            .with_subject(self.about.clone())
            .with_measure(excess)
            .report_finding(text);
    }

    fn idle_reason(&self) -> String {
        self.values.idle_reason()
    }
}
