//! What is expected, from what the bus file says to what can be judged.

use std::fmt;
use std::ops::Range;
use std::sync::Arc;

use super::quoted::place;
use super::signal::{self, SignalName};
use super::words::{clipped, number, time};
use crate::bus_file::{Demand, Written};
use crate::event::Event;
use crate::profile::TextError;
use crate::query::{Filter, KindSet};
use crate::rules::Context;

/// Kinds of events no rule is asked about: they are what rules say.
const NEWS: [&str; 2] = ["finding-opened", "finding-closed"];

/// What is expected, ready to be judged; times in nanoseconds.
#[derive(Debug, Clone)]
pub(super) enum Plan {
    Always { when: Asked, expect: Asked },
    Never { when: Asked },
    Within { when: Asked, expect: Asked, time: i64 },
    Every { when: Asked, period: i64, tolerance: i64 },
    Count { when: Asked, limits: Limits<u64>, window: Option<i64> },
    Order { steps: Vec<Asked>, time: Option<i64> },
    Bounds { signal: SignalName, when: Option<Asked>, limits: Limits<f64> },
    Rate { signal: SignalName, when: Option<Asked>, max: f64 },
}

/// At least so much, at most so much.
#[derive(Debug, Clone, Copy)]
pub(super) struct Limits<T> {
    pub(super) min: Option<T>,
    pub(super) max: Option<T>,
}

/// An expression, and how lines show it.
#[derive(Debug, Clone)]
pub(super) struct Asked {
    filter: Filter,
    text: Arc<str>,
}

impl Asked {
    /// Whether an event is meant.
    #[inline]
    pub(super) fn matches(&self, event: &Event, context: &Context<'_>) -> bool {
        self.filter.matches(event, context.bus, None)
    }

    /// What is said where no event was.
    pub(super) fn idle(&self) -> String {
        format!("nothing matched: {self}")
    }
}

impl fmt::Display for Asked {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(&self.text)
    }
}

impl Plan {
    pub(super) fn of(demand: &Demand, text: &str) -> Result<Self, TextError> {
        let ask = |written: &Written| asked(written, text);
        let valued = |written: &Option<Written>| written.as_ref().map(|when| valued(when, text)).transpose();
        Ok(match demand {
            Demand::Always { when, expect } => Self::Always { when: ask(when)?, expect: ask(expect)? },
            Demand::Never { when } => Self::Never { when: ask(when)? },
            Demand::Within { when, expect, time } => {
                Self::Within { when: ask(when)?, expect: ask(expect)?, time: *time }
            }
            Demand::Every { when, period, tolerance } => {
                Self::Every { when: ask(when)?, period: *period, tolerance: *tolerance }
            }
            Demand::Count { when, min, max, window } => {
                Self::Count { when: ask(when)?, limits: Limits { min: *min, max: *max }, window: *window }
            }
            Demand::Order { steps, time } => {
                Self::Order { steps: steps.iter().map(ask).collect::<Result<_, _>>()?, time: *time }
            }
            Demand::Bounds { signal, when, min, max } => Self::Bounds {
                signal: SignalName::read(signal.text.trim()),
                when: valued(when)?,
                limits: Limits { min: *min, max: *max },
            },
            Demand::Rate { signal, when, max_per_second } => Self::Rate {
                signal: SignalName::read(signal.text.trim()),
                when: valued(when)?,
                max: *max_per_second,
            },
        })
    }

    /// Kinds of events that are looked at.
    pub(super) fn kinds(&self) -> KindSet {
        let of = |asked: &Asked| asked.filter.kinds();
        let interrupts = KindSet::by_name(|name| name == "bus-silent" || name == "clock-step");
        let values = KindSet::by_name(|name| signal::KINDS.contains(&name));
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

    /// Expressions that have to match before anything is judged.
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

    /// Whether it judges times.
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

/// What is expected in a line.
impl fmt::Display for Plan {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::Always { when, expect } => write!(f, "where {when}, always {expect}"),
            Self::Never { when } => write!(f, "never {when}"),
            Self::Within { when, expect, time: limit } => {
                write!(f, "within {} of {when}: {expect}", time(*limit))
            }
            Self::Every { when, period, tolerance } => {
                write!(f, "each {} ± {}: {when}", time(*period), time(*tolerance))
            }
            Self::Count { when, limits: Limits { min, max }, window } => {
                range(f, min.map(|min| min.to_string()), max.map(|max| max.to_string()))?;
                match window {
                    Some(window) => write!(f, " in each {}: {when}", time(*window)),
                    None => write!(f, ": {when}"),
                }
            }
            Self::Order { steps, time: limit } => {
                let steps: Vec<_> = steps.iter().map(ToString::to_string).collect();
                let within = limit.map_or_else(String::new, |limit| format!(" within {}", time(limit)));
                write!(f, "in this order{within}: {}", steps.join(", then "))
            }
            Self::Bounds { signal, limits: Limits { min, max }, .. } => {
                write!(f, "{signal} ")?;
                range(f, min.map(number), max.map(number))
            }
            Self::Rate { signal, max, .. } => {
                write!(f, "{signal} changes by at most {} a second", number(*max))
            }
        }
    }
}

fn range(f: &mut fmt::Formatter<'_>, min: Option<String>, max: Option<String>) -> fmt::Result {
    match (min, max) {
        (Some(min), Some(max)) => write!(f, "{min} to {max}"),
        (Some(min), None) => write!(f, "at least {min}"),
        (None, Some(max)) => write!(f, "at most {max}"),
        (None, None) => Ok(()),
    }
}

/// An expression, or what is wrong with it at its place in the file.
fn asked(written: &Written, text: &str) -> Result<Asked, TextError> {
    let raw = text.get(written.span.clone()).unwrap_or_default();
    let at = |within: Range<usize>| {
        let [start, end] = [within.start, within.end].map(|at| written.span.start + place(raw, at));
        start..end.max(start)
    };
    let filter: Filter = written
        .text
        .parse()
        .map_err(|error: crate::query::FilterError| TextError::at(text, at(error.at()), error.reason()))?;
    let wrong = |message: &str| Err(TextError::at(text, written.span.clone(), message));
    if filter.asks("capture") {
        return wrong("an expectation knows no 'capture': it is judged in each by itself");
    }
    let findings = KindSet::by_name(|name| name.starts_with("finding-"));
    if filter.kinds().and(findings.complement()) == KindSet::NONE && filter.kinds() != KindSet::NONE {
        return wrong(
            "findings cannot be asked for in expectations: they are judged of events, not of each other",
        );
    }
    let news = KindSet::by_name(|name| NEWS.contains(&name));
    if filter.kinds().and(news.complement()) == KindSet::NONE {
        return wrong("no event can match this: no kind of event has all these fields");
    }
    Ok(Asked { text: clipped(&written.text).into(), filter })
}

/// The same of one that picks values.
fn valued(written: &Written, text: &str) -> Result<Asked, TextError> {
    let asked = asked(written, text)?;
    let values = KindSet::by_name(|name| signal::KINDS.contains(&name));
    if asked.filter.kinds().and(values) == KindSet::NONE {
        let message = format!("no event with values can match this: they are {}", signal::KINDS.join(", "));
        return Err(TextError::at(text, written.span.clone(), message));
    }
    Ok(asked)
}
