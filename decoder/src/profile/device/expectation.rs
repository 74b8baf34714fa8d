//! `[[expect]]` of bus files and profiles: rules as expressions on events. `rules/` parses the expressions, so each keeps
//! its place in the file.

use std::ops::Range;
use std::sync::Arc;

use serde::Deserialize;
use toml::Spanned;

use super::rule::Severity;
use crate::profile::authored::TextProblem;
use crate::profile::written::{NodeNumber, SpannedText, node_id};
use crate::wire::NodeId;

/// Max `[[expect]]` entries per file.
pub(crate) const EXPECTATION_LIMIT: usize = 1_000;

/// Max steps of one `order`.
pub(crate) const STEP_LIMIT: usize = 64;

/// Max duration of an expectation, in seconds: one year, the max length of a capture.
const LONGEST: f64 = 31_536_000.0;

/// Tolerance of a period without a `tolerance` key, in percent.
const USUAL_TOLERANCE: f64 = 10.0;

/// A checked `[[expect]]` entry.
#[derive(Debug, Clone, PartialEq)]
pub struct ExpectEntry {
    /// Unique identifier within the file; also the name of the finding.
    pub id: SpannedText,
    /// Condition that the capture must fulfil.
    pub demand: ExpectCondition,
    /// Bus it applies to; `None` for every bus.
    pub bus: Option<String>,
    /// Node it applies to; `None` for every node.
    pub node: Option<NodeId>,
    /// Id of the profile that contains it; it applies to each node with that profile. `None` in a bus file.
    pub profile: Option<Arc<str>>,
    /// Whether each node is checked separately (`per = "node"`).
    pub is_per_node: bool,
    /// Severity of the finding; error by default.
    pub severity: Severity,
    /// Reason from the file, printed with the finding.
    pub reason: Arc<str>,
}

/// Condition of an expectation; times in nanoseconds.
#[derive(Debug, Clone, PartialEq)]
#[expect(missing_docs, reason = "the line of each variant explains its fields")]
pub enum ExpectCondition {
    /// Each event that matches `when` also matches `expect`.
    Always { when: SpannedText, expect: SpannedText },
    /// No event matches `when`.
    Never { when: SpannedText },
    /// Within `time` after each event that matches `when`, an event matches `expect`.
    Within { when: SpannedText, expect: SpannedText, time: i64 },
    /// Events that match `when` occur once per `period`.
    Every { when: SpannedText, period: i64, tolerance: i64 },
    /// The number of events that match `when` is within `min` and `max`, in total or per `window`.
    Count { when: SpannedText, min: Option<u64>, max: Option<u64>, window: Option<i64> },
    /// Events match the steps in this order, first to last within `time`.
    Order { steps: Vec<SpannedText>, time: Option<i64> },
    /// The signal stays within `min` and `max`.
    Bounds { signal: SpannedText, when: Option<SpannedText>, min: Option<f64>, max: Option<f64> },
    /// The signal changes by at most `max_per_second`.
    Rate { signal: SpannedText, when: Option<SpannedText>, max_per_second: f64 },
}

impl ExpectCondition {
    /// Value of the `kind` key in the file.
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

/// Kind, required keys and optional keys; keys that every kind accepts are not listed.
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

/// One `[[expect]]` table as parsed.
#[derive(Debug, Clone, Deserialize)]
#[serde(deny_unknown_fields)]
pub(crate) struct ExpectTable {
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
    tolerance: Option<Spanned<TextAmount>>,
    #[serde(default)]
    min: Option<Spanned<f64>>,
    #[serde(default)]
    max: Option<Spanned<f64>>,
    #[serde(default)]
    max_per_second: Option<Spanned<f64>>,
}

#[derive(Debug, Clone, Deserialize)]
#[serde(untagged, expecting = "expected a number of seconds, or a percentage such as \"10 %\"")]
enum TextAmount {
    Seconds(f64),
    Text(String),
}

/// Checks all entries of a bus file, or of the profile with this id; returns the first problem.
pub(crate) fn check_entries(
    all: Vec<ExpectTable>,
    profile: Option<&str>,
) -> Result<Vec<ExpectEntry>, TextProblem> {
    let profile = profile.map(Arc::from);
    let mut known: Vec<ExpectEntry> = Vec::new();
    for one in all {
        if known.len() == EXPECTATION_LIMIT {
            return Err((one.id.span(), format!("more than {EXPECTATION_LIMIT} expectations in one file")));
        }
        let one = one.check_entry(profile.as_ref())?;
        if known.iter().any(|other| other.id.text == one.id.text) {
            return Err((one.id.span, format!("duplicate id '{}'", one.id.text)));
        }
        known.push(one);
    }
    Ok(known)
}

impl ExpectTable {
    fn check_entry(mut self, profile: Option<&Arc<str>>) -> Result<ExpectEntry, TextProblem> {
        if profile.is_some() && (self.bus.is_some() || self.node.is_some() || self.per.is_some()) {
            let message = "bus, node and per are valid in bus files only; each node with the profile is checked separately";
            return Err((self.id.span(), message.into()));
        }
        check_id(&self.id)?;
        if self.reason.get_ref().trim().is_empty() {
            return Err((self.reason.span(), "empty reason; expected a text".into()));
        }
        self.check_keys()?;
        let severity = match self.severity.as_ref().map(|word| (word.get_ref().as_str(), word.span())) {
            None | Some(("error", _)) => Severity::Error,
            Some(("warning", _)) => Severity::Warning,
            Some(("note", _)) => Severity::Note,
            Some((_, span)) => {
                return Err((span, "unknown severity; expected \"error\", \"warning\" or \"note\"".into()));
            }
        };
        let node = self.node.as_ref().map(node_id).transpose()?;
        let is_per_node = match &self.per {
            None => profile.is_some(),
            Some(per) if per.get_ref() != "node" => {
                return Err((per.span(), "unknown per; expected \"node\" or no per".into()));
            }
            Some(per) if node.is_some() => {
                return Err((
                    per.span(),
                    "per = \"node\" has no effect with a single node; remove per or node".into(),
                ));
            }
            Some(_) => true,
        };
        let (id, bus, reason) =
            (self.id.clone().into(), self.bus.take(), self.reason.get_ref().trim().into());
        let profile = profile.cloned();
        Ok(ExpectEntry {
            id,
            demand: self.parse_demand()?,
            bus,
            node,
            profile,
            is_per_node,
            severity,
            reason,
        })
    }

    /// Checks that all keys required by the kind are present and all others belong to it.
    fn check_keys(&self) -> Result<(), TextProblem> {
        let kind = self.kind.get_ref().as_str();
        let Some((_, needs, takes)) = KINDS.iter().find(|(name, ..)| *name == kind) else {
            let names: Vec<_> = KINDS.iter().map(|(name, ..)| *name).collect();
            return Err((self.kind.span(), format!("unknown kind '{kind}'; expected {}", names.join(", "))));
        };
        let given = self.given_keys();
        for (name, span) in &given {
            if let Some(span) = span
                && !needs.contains(name)
                && !takes.contains(name)
            {
                let all: Vec<_> = needs.iter().chain(*takes).copied().collect();
                return Err((
                    span.clone(),
                    format!("{name} is not valid for kind {kind}; expected {}", all.join(", ")),
                ));
            }
        }
        let is_missing = |name: &str| given.iter().any(|(key, span)| *key == name && span.is_none());
        match needs.iter().find(|name| is_missing(name)) {
            Some(name) => Err((self.kind.span(), format!("{name} is missing; kind {kind} requires it"))),
            None => Ok(()),
        }
    }

    /// Keys specific to some kinds, with the place of each one present.
    fn given_keys(&self) -> [(&'static str, Option<Range<usize>>); 11] {
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

    fn parse_demand(self) -> Result<ExpectCondition, TextProblem> {
        let kind = self.kind.span();
        // `check_keys` has verified that required keys are present.
        let needed = |text: Option<Spanned<String>>| {
            text.map(SpannedText::from).ok_or_else(|| (kind.clone(), "an expression is missing".to_owned()))
        };
        let needed_time = |seconds: Option<&Spanned<f64>>| {
            let given = seconds.ok_or_else(|| (kind.clone(), "seconds are missing".to_owned()));
            given.and_then(parse_nanoseconds)
        };
        Ok(match self.kind.get_ref().as_str() {
            "always" => ExpectCondition::Always { when: needed(self.when)?, expect: needed(self.expect)? },
            "never" => ExpectCondition::Never { when: needed(self.when)? },
            "within" => {
                let time = needed_time(self.seconds.as_ref())?;
                ExpectCondition::Within { when: needed(self.when)?, expect: needed(self.expect)?, time }
            }
            "every" => {
                let period = needed_time(self.seconds.as_ref())?;
                let tolerance = parse_tolerance(self.tolerance.as_ref(), period)?;
                ExpectCondition::Every { when: needed(self.when)?, period, tolerance }
            }
            "count" => {
                let window = self.per_seconds.as_ref().map(parse_nanoseconds).transpose()?;
                let (min, max) = (parse_whole(self.min.as_ref())?, parse_whole(self.max.as_ref())?);
                check_limits(&kind, min, max)?;
                ExpectCondition::Count { when: needed(self.when)?, min, max, window }
            }
            "order" => {
                let time = self.seconds.as_ref().map(parse_nanoseconds).transpose()?;
                ExpectCondition::Order { steps: check_steps(&kind, self.steps)?, time }
            }
            "bounds" => {
                let (min, max) = (parse_finite(self.min.as_ref())?, parse_finite(self.max.as_ref())?);
                check_limits(&kind, min, max)?;
                let when = self.when.map(SpannedText::from);
                ExpectCondition::Bounds { signal: check_signal(needed(self.signal)?)?, when, min, max }
            }
            _ => {
                let most = parse_finite(self.max_per_second.as_ref())?.filter(|most| *most > 0.0);
                let span = self.max_per_second.as_ref().map_or(kind.clone(), Spanned::span);
                let wrong = || (span, "max_per_second is invalid; expected a number > 0".to_owned());
                let (signal, when) = (check_signal(needed(self.signal)?)?, self.when.map(SpannedText::from));
                ExpectCondition::Rate { signal, when, max_per_second: most.ok_or_else(wrong)? }
            }
        })
    }
}

/// Checks for lower-case letters, digits and single hyphens, as in rule names.
fn check_id(id: &Spanned<String>) -> Result<(), TextProblem> {
    let is_part = |part: &str| {
        !part.is_empty() && part.bytes().all(|byte| byte.is_ascii_lowercase() || byte.is_ascii_digit())
    };
    if id.get_ref().split('-').all(is_part) {
        return Ok(());
    }
    Err((id.span(), "invalid id; expected a-z, 0-9 and single hyphens, such as \"pump-responds\"".into()))
}

fn parse_nanoseconds(seconds: &Spanned<f64>) -> Result<i64, TextProblem> {
    to_nanoseconds(*seconds.get_ref())
        .ok_or_else(|| (seconds.span(), "time out of range; expected seconds > 0, max one year".into()))
}

/// Time in nanoseconds: at least 1 ns, at most [`LONGEST`].
fn to_nanoseconds(seconds: f64) -> Option<i64> {
    let fits = (1e-9..=LONGEST).contains(&seconds);
    #[expect(clippy::cast_possible_truncation, reason = "limited to one year")]
    fits.then_some((seconds * 1e9).round() as i64)
}

fn parse_tolerance(amount: Option<&Spanned<TextAmount>>, period: i64) -> Result<i64, TextProblem> {
    let (given, span) = match amount {
        None => (Some((USUAL_TOLERANCE, true)), 0..0),
        Some(amount) => {
            let given = match amount.get_ref() {
                TextAmount::Seconds(seconds) => Some((*seconds, false)),
                TextAmount::Text(text) => text
                    .strip_suffix('%')
                    .and_then(|number| number.trim().parse().ok())
                    .map(|number: f64| (number, true)),
            };
            (given, amount.span())
        }
    };
    #[expect(clippy::cast_precision_loss, reason = "the period is at most one year")]
    let nanoseconds = period as f64;
    let seconds =
        given.map(|(number, is_share)| if is_share { number / 100.0 * nanoseconds / 1e9 } else { number });
    if seconds.is_some_and(|seconds| seconds * 1e9 >= nanoseconds) {
        let reason =
            "the tolerance is not shorter than the period, so the check could never fail; expected less";
        return Err((span, reason.into()));
    }
    let time = match seconds {
        Some(0.0) => Some(0),
        Some(seconds) => to_nanoseconds(seconds),
        None => None,
    };
    time.ok_or_else(|| {
        (span, "invalid tolerance; expected a number of seconds, or a percentage such as \"10 %\"".into())
    })
}

fn parse_finite(number: Option<&Spanned<f64>>) -> Result<Option<f64>, TextProblem> {
    match number {
        Some(number) if !number.get_ref().is_finite() => {
            Err((number.span(), "the limit is not finite; expected a number".into()))
        }
        other => Ok(other.map(|number| *number.get_ref())),
    }
}

fn parse_whole(number: Option<&Spanned<f64>>) -> Result<Option<u64>, TextProblem> {
    let Some(number) = number else { return Ok(None) };
    let value = *number.get_ref();
    let fits = value >= 0.0 && value <= f64::from(u32::MAX) && value.fract() == 0.0;
    #[expect(
        clippy::cast_possible_truncation,
        clippy::cast_sign_loss,
        reason = "an integer of at most 32 bits"
    )]
    let value = fits.then_some(value as u64);
    value.map(Some).ok_or_else(|| (number.span(), "invalid count; expected an integer ≥ 0".into()))
}

/// Checks that at least one limit is present and `min` ≤ `max`.
fn check_limits<T: PartialOrd>(
    kind: &Range<usize>,
    min: Option<T>,
    max: Option<T>,
) -> Result<(), TextProblem> {
    match (min, max) {
        (None, None) => Err((kind.clone(), "min and max are missing; expected at least one".into())),
        (Some(min), Some(max)) if min > max => Err((kind.clone(), "min > max; expected min ≤ max".into())),
        _ => Ok(()),
    }
}

fn check_steps(
    kind: &Range<usize>,
    steps: Option<Spanned<Vec<Spanned<String>>>>,
) -> Result<Vec<SpannedText>, TextProblem> {
    let span = steps.as_ref().map_or(kind.clone(), Spanned::span);
    let steps: Vec<SpannedText> =
        steps.map_or_else(Vec::new, Spanned::into_inner).into_iter().map(SpannedText::from).collect();
    if !(2..=STEP_LIMIT).contains(&steps.len()) {
        return Err((span, format!("step count {}; expected 2 to {STEP_LIMIT}", steps.len())));
    }
    Ok(steps)
}

fn check_signal(name: SpannedText) -> Result<SpannedText, TextProblem> {
    if name.text.trim().is_empty() {
        return Err((
            name.span,
            "empty signal; expected a name, an object such as \"6041:00\", or \"spn:190\"".into(),
        ));
    }
    Ok(name)
}
