//! `[[expect]]`: the user's own rules. What they say in expressions `rules/` reads, so places are kept.

use std::ops::Range;
use std::sync::Arc;

use serde::Deserialize;
use toml::Spanned;

use super::written::{NodeNumber, Written, Wrong, node_id};
use crate::profile::device::Severity;
use crate::wire::NodeId;

/// Expectations of a file.
pub(crate) const EXPECTATION_LIMIT: usize = 1_000;

/// Steps of one `order`.
pub(crate) const STEP_LIMIT: usize = 64;

/// Longest time an expectation waits, in seconds: the year that a capture may last.
const LONGEST: f64 = 31_536_000.0;

/// How far apart from its period something may come where nothing is said, in percent.
const USUAL_TOLERANCE: f64 = 10.0;

/// One expectation.
#[derive(Debug, Clone, PartialEq)]
pub struct Expectation {
    /// Its name.
    pub id: Written,
    /// What is expected.
    pub demand: Demand,
    /// Bus; each if none.
    pub bus: Option<String>,
    /// The node it is about; all if none.
    pub node: Option<NodeId>,
    /// Each node is judged apart.
    pub is_per_node: bool,
    /// How bad it is where it is not met.
    pub severity: Severity,
    /// Why.
    pub reason: Arc<str>,
}

/// What is expected; times in nanoseconds.
#[derive(Debug, Clone, PartialEq)]
#[expect(missing_docs, reason = "each kind's line says what its parts are")]
pub enum Demand {
    /// Each event meant by `when` is meant by `expect` too.
    Always { when: Written, expect: Written },
    /// No event is meant by `when`.
    Never { when: Written },
    /// Behind an event of `when` one of `expect` comes in time.
    Within { when: Written, expect: Written, time: i64 },
    /// Events of `when` come one a period.
    Every { when: Written, period: i64, tolerance: i64 },
    /// So many events of `when` come, over all or in each window.
    Count { when: Written, min: Option<u64>, max: Option<u64>, window: Option<i64> },
    /// Events come in this order, from the first to the last in this time.
    Order { steps: Vec<Written>, time: Option<i64> },
    /// A signal stays between two values.
    Bounds { signal: Written, when: Option<Written>, min: Option<f64>, max: Option<f64> },
    /// A signal changes no faster.
    Rate { signal: Written, when: Option<Written>, max_per_second: f64 },
}

impl Demand {
    /// Its `kind` in the file.
    pub const fn name(&self) -> &'static str {
        match self {
            Self::Always { .. } => "always",
            Self::Never { .. } => "never",
            Self::Within { .. } => "within",
            Self::Every { .. } => "every",
            Self::Count { .. } => "count",
            Self::Order { .. } => "order",
            Self::Bounds { .. } => "bounds",
            Self::Rate { .. } => "rate",
        }
    }
}

/// Which keys each kind has beside those all have; the first ones it needs.
const KINDS: &[(&str, &[&str], &[&str])] = &[
    ("always", &["when", "expect"], &[]),
    ("never", &["when"], &[]),
    ("within", &["when", "expect", "seconds"], &["per"]),
    ("every", &["when", "seconds"], &["tolerance", "per"]),
    ("count", &["when"], &["min", "max", "per_seconds", "per"]),
    ("order", &["steps"], &["seconds", "per"]),
    ("bounds", &["signal"], &["min", "max", "when"]),
    ("rate", &["signal", "max_per_second"], &["when"]),
];

/// One `[[expect]]`.
#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
pub(super) struct Entry {
    id: Spanned<String>,
    kind: Spanned<String>,
    reason: Spanned<String>,
    #[serde(default)]
    severity: Option<Spanned<String>>,
    #[serde(default)]
    bus: Option<String>,
    #[serde(default)]
    node: Option<Spanned<NodeNumber>>,
    #[serde(default)]
    per: Option<Spanned<String>>,
    #[serde(default)]
    when: Option<Spanned<String>>,
    #[serde(default)]
    expect: Option<Spanned<String>>,
    #[serde(default)]
    steps: Option<Spanned<Vec<Spanned<String>>>>,
    #[serde(default)]
    signal: Option<Spanned<String>>,
    #[serde(default)]
    seconds: Option<Spanned<f64>>,
    #[serde(default)]
    per_seconds: Option<Spanned<f64>>,
    #[serde(default)]
    tolerance: Option<Spanned<Amount>>,
    #[serde(default)]
    min: Option<Spanned<f64>>,
    #[serde(default)]
    max: Option<Spanned<f64>>,
    #[serde(default)]
    max_per_second: Option<Spanned<f64>>,
}

#[derive(Deserialize)]
#[serde(untagged, expecting = "a number of seconds, or a share as \"10 %\"")]
enum Amount {
    Seconds(f64),
    Text(String),
}

/// Takes all expectations, or tells the first thing wrong with them.
pub(super) fn check(all: Vec<Entry>) -> Result<Vec<Expectation>, Wrong> {
    let mut known: Vec<Expectation> = Vec::new();
    for one in all {
        if known.len() == EXPECTATION_LIMIT {
            return Err((one.id.span(), format!("a file holds at most {EXPECTATION_LIMIT} expectations")));
        }
        let one = one.check()?;
        if known.iter().any(|other| other.id.text == one.id.text) {
            return Err((one.id.span, format!("the id '{}' is given twice", one.id.text)));
        }
        known.push(one);
    }
    Ok(known)
}

impl Entry {
    fn check(mut self) -> Result<Expectation, Wrong> {
        check_id(&self.id)?;
        if self.reason.get_ref().trim().is_empty() {
            return Err((self.reason.span(), "an expectation needs its reason".into()));
        }
        self.check_keys()?;
        let severity = match self.severity.as_ref().map(|word| (word.get_ref().as_str(), word.span())) {
            None | Some(("error", _)) => Severity::Error,
            Some(("warning", _)) => Severity::Warning,
            Some(("note", _)) => Severity::Note,
            Some((_, span)) => return Err((span, "a severity is error, warning or note".into())),
        };
        let node = self.node.as_ref().map(node_id).transpose()?;
        let is_per_node = match &self.per {
            None => false,
            Some(per) if per.get_ref() != "node" => {
                return Err((per.span(), "per is \"node\", or left out".into()));
            }
            Some(per) if node.is_some() => {
                return Err((per.span(), "node names one node, so there is nothing to tell apart".into()));
            }
            Some(_) => true,
        };
        let (id, bus, reason) =
            (self.id.clone().into(), self.bus.take(), self.reason.get_ref().trim().into());
        Ok(Expectation { id, demand: self.demand()?, bus, node, is_per_node, severity, reason })
    }

    /// What belongs to the kind is there, and nothing else.
    fn check_keys(&self) -> Result<(), Wrong> {
        let kind = self.kind.get_ref().as_str();
        let Some((_, needs, takes)) = KINDS.iter().find(|(name, ..)| *name == kind) else {
            let names: Vec<_> = KINDS.iter().map(|(name, ..)| *name).collect();
            return Err((self.kind.span(), format!("'{kind}' is no kind: there are {}", names.join(", "))));
        };
        let given = self.given();
        for (name, span) in &given {
            if let Some(span) = span
                && !needs.contains(name)
                && !takes.contains(name)
            {
                let all: Vec<_> = needs.iter().chain(*takes).copied().collect();
                return Err((span.clone(), format!("{kind} has {}, not {name}", all.join(", "))));
            }
        }
        let is_missing = |name: &str| given.iter().any(|(key, span)| *key == name && span.is_none());
        match needs.iter().find(|name| is_missing(name)) {
            Some(name) => Err((self.kind.span(), format!("{kind} needs {name}"))),
            None => Ok(()),
        }
    }

    /// Keys that not all kinds have, with the places of those that are given.
    fn given(&self) -> [(&'static str, Option<Range<usize>>); 11] {
        fn at<T>(value: Option<&Spanned<T>>) -> Option<Range<usize>> {
            value.map(Spanned::span)
        }
        [
            ("per", at(self.per.as_ref())),
            ("when", at(self.when.as_ref())),
            ("expect", at(self.expect.as_ref())),
            ("steps", at(self.steps.as_ref())),
            ("signal", at(self.signal.as_ref())),
            ("seconds", at(self.seconds.as_ref())),
            ("per_seconds", at(self.per_seconds.as_ref())),
            ("tolerance", at(self.tolerance.as_ref())),
            ("min", at(self.min.as_ref())),
            ("max", at(self.max.as_ref())),
            ("max_per_second", at(self.max_per_second.as_ref())),
        ]
    }

    fn demand(self) -> Result<Demand, Wrong> {
        let kind = self.kind.span();
        // What a kind needs is there: `check_keys` saw it.
        let needed = |text: Option<Spanned<String>>| {
            text.map(Written::from).ok_or_else(|| (kind.clone(), "an expression is missing".to_owned()))
        };
        let needed_time = |seconds: Option<&Spanned<f64>>| {
            let given = seconds.ok_or_else(|| (kind.clone(), "seconds are missing".to_owned()));
            given.and_then(nanoseconds)
        };
        Ok(match self.kind.get_ref().as_str() {
            "always" => Demand::Always { when: needed(self.when)?, expect: needed(self.expect)? },
            "never" => Demand::Never { when: needed(self.when)? },
            "within" => {
                let time = needed_time(self.seconds.as_ref())?;
                Demand::Within { when: needed(self.when)?, expect: needed(self.expect)?, time }
            }
            "every" => {
                let period = needed_time(self.seconds.as_ref())?;
                let tolerance = tolerance(self.tolerance.as_ref(), period)?;
                Demand::Every { when: needed(self.when)?, period, tolerance }
            }
            "count" => {
                let window = self.per_seconds.as_ref().map(nanoseconds).transpose()?;
                let (min, max) = (whole(self.min.as_ref())?, whole(self.max.as_ref())?);
                limits(&kind, min, max)?;
                Demand::Count { when: needed(self.when)?, min, max, window }
            }
            "order" => {
                let time = self.seconds.as_ref().map(nanoseconds).transpose()?;
                Demand::Order { steps: steps(&kind, self.steps)?, time }
            }
            "bounds" => {
                let (min, max) = (finite(self.min.as_ref())?, finite(self.max.as_ref())?);
                limits(&kind, min, max)?;
                let when = self.when.map(Written::from);
                Demand::Bounds { signal: signal(needed(self.signal)?)?, when, min, max }
            }
            _ => {
                let most = finite(self.max_per_second.as_ref())?.filter(|most| *most > 0.0);
                let span = self.max_per_second.as_ref().map_or(kind.clone(), Spanned::span);
                let wrong = || (span, "max_per_second is a number above 0".to_owned());
                let (signal, when) = (signal(needed(self.signal)?)?, self.when.map(Written::from));
                Demand::Rate { signal, when, max_per_second: most.ok_or_else(wrong)? }
            }
        })
    }
}

/// Letters, digits and single hyphens, as the names of rules are.
fn check_id(id: &Spanned<String>) -> Result<(), Wrong> {
    let is_part = |part: &str| {
        !part.is_empty() && part.bytes().all(|byte| byte.is_ascii_lowercase() || byte.is_ascii_digit())
    };
    if id.get_ref().split('-').all(is_part) {
        return Ok(());
    }
    Err((id.span(), "an id is of a-z, 0-9 and hyphens: \"pump-answers\"".into()))
}

fn nanoseconds(seconds: &Spanned<f64>) -> Result<i64, Wrong> {
    time(*seconds.get_ref()).ok_or_else(|| (seconds.span(), "a time is above 0, in seconds".into()))
}

/// A time in nanoseconds: at least one, at most [`LONGEST`].
fn time(seconds: f64) -> Option<i64> {
    let fits = (1e-9..=LONGEST).contains(&seconds);
    #[expect(clippy::cast_possible_truncation, reason = "held to a year")]
    fits.then_some((seconds * 1e9).round() as i64)
}

fn tolerance(amount: Option<&Spanned<Amount>>, period: i64) -> Result<i64, Wrong> {
    let (given, span) = match amount {
        None => (Some((USUAL_TOLERANCE, true)), 0..0),
        Some(amount) => {
            let given = match amount.get_ref() {
                Amount::Seconds(seconds) => Some((*seconds, false)),
                Amount::Text(text) => text
                    .strip_suffix('%')
                    .and_then(|number| number.trim().parse().ok())
                    .map(|number: f64| (number, true)),
            };
            (given, amount.span())
        }
    };
    #[expect(clippy::cast_precision_loss, reason = "a period of at most a year")]
    let nanoseconds = period as f64;
    let seconds =
        given.map(|(number, is_share)| if is_share { number / 100.0 * nanoseconds / 1e9 } else { number });
    if seconds.is_some_and(|seconds| seconds * 1e9 >= nanoseconds) {
        let reason =
            "a tolerance as long as the period switches the check off: something would always be in time";
        return Err((span, reason.into()));
    }
    let time = match seconds {
        Some(0.0) => Some(0),
        Some(seconds) => time(seconds),
        None => None,
    };
    time.ok_or_else(|| {
        (span, "a tolerance is a number of seconds, or a share of the period as \"10 %\"".into())
    })
}

fn finite(number: Option<&Spanned<f64>>) -> Result<Option<f64>, Wrong> {
    match number {
        Some(number) if !number.get_ref().is_finite() => Err((number.span(), "a limit is a number".into())),
        other => Ok(other.map(|number| *number.get_ref())),
    }
}

fn whole(number: Option<&Spanned<f64>>) -> Result<Option<u64>, Wrong> {
    let Some(number) = number else { return Ok(None) };
    let value = *number.get_ref();
    let fits = value >= 0.0 && value <= f64::from(u32::MAX) && value.fract() == 0.0;
    #[expect(clippy::cast_possible_truncation, clippy::cast_sign_loss, reason = "a whole number of 32 bits")]
    let value = fits.then_some(value as u64);
    value.map(Some).ok_or_else(|| (number.span(), "a count is a whole number from 0".into()))
}

/// One limit or both, and in order.
fn limits<T: PartialOrd>(kind: &Range<usize>, min: Option<T>, max: Option<T>) -> Result<(), Wrong> {
    match (min, max) {
        (None, None) => Err((kind.clone(), "give min, max or both".into())),
        (Some(min), Some(max)) if min > max => Err((kind.clone(), "min is above max".into())),
        _ => Ok(()),
    }
}

fn steps(kind: &Range<usize>, steps: Option<Spanned<Vec<Spanned<String>>>>) -> Result<Vec<Written>, Wrong> {
    let span = steps.as_ref().map_or(kind.clone(), Spanned::span);
    let steps: Vec<Written> =
        steps.map_or_else(Vec::new, Spanned::into_inner).into_iter().map(Written::from).collect();
    if !(2..=STEP_LIMIT).contains(&steps.len()) {
        return Err((span, format!("an order has 2 to {STEP_LIMIT} steps")));
    }
    Ok(steps)
}

fn signal(name: Written) -> Result<Written, Wrong> {
    if name.text.trim().is_empty() {
        return Err((name.span, "a signal is its name, an object as \"6041:00\", or \"spn:190\"".into()));
    }
    Ok(name)
}
