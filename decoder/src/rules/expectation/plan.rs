//! Compilation of the expectations in the bus file.

use std::fmt;
use std::ops::Range;
use std::sync::Arc;

use super::quoted::source_offset;
use super::signal::{self, SignalReference};
use super::words::{clip_expression, format_number, format_time};
use crate::bus_file::{ExpectCondition, SpannedText};
use crate::event::{Event, Kind, KindSet};
use crate::profile::TextError;
use crate::query::Filter;
use crate::rules::RuleContext;

/// A compiled expectation; times in ns.
#[derive(Debug, Clone)]
pub(super) enum ExpectationPlan {
    Always { when: QuotedExpression, expect: QuotedExpression },
    Never { when: QuotedExpression },
    Within { when: QuotedExpression, expect: QuotedExpression, time: i64 },
    Every { when: QuotedExpression, period: i64, tolerance: i64 },
    Count { when: QuotedExpression, limits: ValueLimits<u64>, window: Option<i64> },
    Order { steps: Vec<QuotedExpression>, time: Option<i64> },
    Bounds { signal: SignalReference, when: Option<QuotedExpression>, limits: ValueLimits<f64> },
    Rate { signal: SignalReference, when: Option<QuotedExpression>, max: f64 },
}

/// Lower and upper limit.
#[derive(Debug, Clone, Copy)]
pub(super) struct ValueLimits<T> {
    pub(super) min: Option<T>,
    pub(super) max: Option<T>,
}

/// A compiled expression with its text for findings.
#[derive(Debug, Clone)]
pub(super) struct QuotedExpression {
    filter: Filter,
    text: Arc<str>,
}

impl QuotedExpression {
    /// Whether the event matches the expression.
    #[inline]
    pub(super) fn matches_event(&self, event: &Event, context: &RuleContext<'_>) -> bool {
        self.filter.matches_event(event, context.bus, None)
    }

    /// Reason text if no event matched.
    pub(super) fn idle_reason(&self) -> String {
        format!("no event matched {self}")
    }
}

impl fmt::Display for QuotedExpression {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(&self.text)
    }
}

impl ExpectationPlan {
    pub(super) fn plan_for(demand: &ExpectCondition, text: &str) -> Result<Self, TextError> {
        let ask = |written: &SpannedText| compile_expression(written, text);
        let valued = |written: &Option<SpannedText>| {
            written.as_ref().map(|when| compile_value_expression(when, text)).transpose()
        };
        Ok(match demand {
            ExpectCondition::Always { when, expect } => {
                Self::Always { when: ask(when)?, expect: ask(expect)? }
            }
            ExpectCondition::Never { when } => Self::Never { when: ask(when)? },
            ExpectCondition::Within { when, expect, time } => {
                Self::Within { when: ask(when)?, expect: ask(expect)?, time: *time }
            }
            ExpectCondition::Every { when, period, tolerance } => {
                Self::Every { when: ask(when)?, period: *period, tolerance: *tolerance }
            }
            ExpectCondition::Count { when, min, max, window } => Self::Count {
                when: ask(when)?,
                limits: ValueLimits { min: *min, max: *max },
                window: *window,
            },
            ExpectCondition::Order { steps, time } => {
                Self::Order { steps: steps.iter().map(ask).collect::<Result<_, _>>()?, time: *time }
            }
            ExpectCondition::Bounds { signal, when, min, max } => Self::Bounds {
                signal: SignalReference::parse_reference(signal.text.trim()),
                when: valued(when)?,
                limits: ValueLimits { min: *min, max: *max },
            },
            ExpectCondition::Rate { signal, when, max_per_second } => Self::Rate {
                signal: SignalReference::parse_reference(signal.text.trim()),
                when: valued(when)?,
                max: *max_per_second,
            },
        })
    }

    /// Event kinds that the expectation needs.
    pub(super) fn needed_kinds(&self) -> KindSet {
        let of = |asked: &QuotedExpression| asked.filter.kinds();
        let interrupts = KindSet::of(&[Kind::BusSilent, Kind::ClockStep]);
        let values = KindSet::of(&signal::KINDS);
        match self {
            Self::Always { when, .. } | Self::Never { when } | Self::Count { when, window: None, .. } => {
                of(when)
            }
            Self::Within { when, expect, .. } => of(when).or(of(expect)),
            Self::Every { when, .. } | Self::Count { when, .. } => of(when).or(interrupts),
            Self::Order { steps, .. } => steps.iter().fold(KindSet::NONE, |all, step| all.or(of(step))),
            Self::Bounds { when, .. } => when.as_ref().map_or(values, |when| of(when).and(values)),
            Self::Rate { when, .. } => {
                when.as_ref().map_or(values, |when| of(when).and(values)).or(interrupts)
            }
        }
    }

    /// Expressions that must match before anything is checked.
    pub(super) fn conditions(&self) -> impl Iterator<Item = &Filter> {
        let (one, steps) = match self {
            Self::Always { when, .. }
            | Self::Never { when }
            | Self::Within { when, .. }
            | Self::Every { when, .. }
            | Self::Count { when, .. } => (Some(when), &[][..]),
            Self::Order { steps, .. } => (None, steps.as_slice()),
            Self::Bounds { when, .. } | Self::Rate { when, .. } => (when.as_ref(), &[][..]),
        };
        one.into_iter().chain(steps).map(|asked| &asked.filter)
    }

    /// Whether the expectation checks times.
    pub(super) const fn is_timing(&self) -> bool {
        match self {
            Self::Within { .. }
            | Self::Every { .. }
            | Self::Count { window: Some(_), .. }
            | Self::Order { time: Some(_), .. }
            | Self::Rate { .. } => true,
            Self::Always { .. }
            | Self::Never { .. }
            | Self::Count { .. }
            | Self::Order { .. }
            | Self::Bounds { .. } => false,
        }
    }
}

/// Summary in one line, used as the title of the rule.
impl fmt::Display for ExpectationPlan {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::Always { when, expect } => write!(f, "always {expect} if {when}"),
            Self::Never { when } => write!(f, "never {when}"),
            Self::Within { when, expect, time: limit } => {
                write!(f, "within {} of {when}: {expect}", format_time(*limit))
            }
            Self::Every { when, period, tolerance } => {
                write!(f, "every {} ± {}: {when}", format_time(*period), format_time(*tolerance))
            }
            Self::Count { when, limits: ValueLimits { min, max }, window } => {
                write_range(f, min.map(|min| min.to_string()), max.map(|max| max.to_string()))?;
                match window {
                    Some(window) => write!(f, " per {}: {when}", format_time(*window)),
                    None => write!(f, ": {when}"),
                }
            }
            Self::Order { steps, time: limit } => {
                let steps: Vec<_> = steps.iter().map(ToString::to_string).collect();
                let within =
                    limit.map_or_else(String::new, |limit| format!(" within {}", format_time(limit)));
                write!(f, "order{within}: {}", steps.join(", then "))
            }
            Self::Bounds { signal, limits: ValueLimits { min, max }, .. } => {
                write!(f, "{signal} ")?;
                write_range(f, min.map(format_number), max.map(format_number))
            }
            Self::Rate { signal, max, .. } => {
                write!(f, "{signal} change max {}/s", format_number(*max))
            }
        }
    }
}

fn write_range(f: &mut fmt::Formatter<'_>, min: Option<String>, max: Option<String>) -> fmt::Result {
    match (min, max) {
        (Some(min), Some(max)) => write!(f, "{min} to {max}"),
        (Some(min), None) => write!(f, "min {min}"),
        (None, Some(max)) => write!(f, "max {max}"),
        (None, None) => Ok(()),
    }
}

/// Compiles an expression; an error has its position in the file.
fn compile_expression(written: &SpannedText, text: &str) -> Result<QuotedExpression, TextError> {
    let raw = text.get(written.span.clone()).unwrap_or_default();
    let at = |within: Range<usize>| {
        let [start, end] = [within.start, within.end].map(|at| written.span.start + source_offset(raw, at));
        start..end.max(start)
    };
    let filter: Filter = written.text.parse().map_err(|error: crate::query::FilterError| {
        TextError::at_place(text, at(error.at()), error.reason())
    })?;
    let wrong = |message: &str| Err(TextError::at_place(text, written.span.clone(), message));
    if filter.uses_field("capture") {
        return wrong("'capture' is not available in expectations; each capture is checked on its own");
    }
    // Rules emit events of findings and do not receive them.
    let possible = filter.kinds().and(KindSet::FINDINGS.complement());
    if possible == KindSet::NONE && filter.kinds() != KindSet::NONE {
        return wrong(
            "finding events are not available in expectations; expected an expression on other events",
        );
    }
    if possible == KindSet::NONE {
        return wrong("expression never matches: no event kind has all these fields");
    }
    Ok(QuotedExpression { text: clip_expression(&written.text).into(), filter })
}

/// Compiles an expression that must match events with values.
fn compile_value_expression(written: &SpannedText, text: &str) -> Result<QuotedExpression, TextError> {
    let asked = compile_expression(written, text)?;
    if asked.filter.kinds().and(KindSet::of(&signal::KINDS)) == KindSet::NONE {
        let message = format!(
            "expression matches no event with values; expected one of {}",
            signal::KINDS.map(Kind::name).join(", ")
        );
        return Err(TextError::at_place(text, written.span.clone(), message));
    }
    Ok(asked)
}
