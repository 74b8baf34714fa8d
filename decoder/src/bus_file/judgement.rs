//! What the user says of rules: how strict, and which findings are known and accepted.

use std::collections::BTreeMap;
use std::ops::Range;
use std::sync::Arc;

use serde::Deserialize;
use toml::Spanned;

use super::expectation::{self, Expectation};
use super::written::{NodeNumber, Wrong, node_id};
use crate::profile::device::Severity;
use crate::wire::NodeId;

/// Everything said of rules. Whether they exist is known to `rules/`, so places are kept.
#[derive(Debug, Clone, Default, PartialEq)]
pub struct Judgement {
    /// `[rules.<name>]`.
    pub rules: Vec<RuleSettings>,
    /// `[[suppress]]`.
    pub suppressions: Vec<Suppression>,
    /// `[[expect]]`.
    pub expectations: Vec<Expectation>,
}

/// What is said of one rule.
#[derive(Debug, Clone, PartialEq)]
pub struct RuleSettings {
    /// Name.
    pub rule: String,
    /// Its place in the file.
    pub span: Range<usize>,
    /// `Some(None)` switches it off.
    pub severity: Option<Option<Severity>>,
    /// Tolerances by key, with their places.
    pub tolerances: Vec<(String, Range<usize>, f64)>,
}

/// Findings that are known and accepted.
#[derive(Debug, Clone, PartialEq)]
pub struct Suppression {
    /// Rule.
    pub rule: String,
    /// Its place in the file.
    pub span: Range<usize>,
    /// Bus; all if none.
    pub bus: Option<String>,
    /// Node; all if none.
    pub node: Option<NodeId>,
    /// Object, code or name, as the finding prints it; all if none.
    pub about: Option<String>,
    /// Why.
    pub reason: Arc<str>,
    /// Last day it holds, as `2026-01-31`.
    pub until: Option<String>,
}

/// `[rules]`.
pub(super) type Rules = BTreeMap<Spanned<String>, BTreeMap<Spanned<String>, Spanned<Setting>>>;

#[derive(Deserialize)]
#[serde(untagged, expecting = "a number, or a severity")]
pub(super) enum Setting {
    Number(f64),
    Word(String),
}

/// One `[[suppress]]`.
#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
pub(super) struct Suppress {
    rule: Spanned<String>,
    #[serde(default)]
    bus: Option<String>,
    #[serde(default)]
    node: Option<Spanned<NodeNumber>>,
    #[serde(default)]
    about: Option<String>,
    reason: Spanned<String>,
    #[serde(default)]
    until: Option<Spanned<Day>>,
}

#[derive(Deserialize)]
#[serde(untagged, expecting = "a day, as 2026-01-31")]
enum Day {
    Date(toml::value::Datetime),
    Text(String),
}

/// Takes what the file says, or tells the first thing wrong with it.
pub(super) fn check(
    rules: Rules,
    suppress: Vec<Suppress>,
    expect: Vec<expectation::Entry>,
) -> Result<Judgement, Wrong> {
    let rules = rules.into_iter().map(|(name, keys)| settings(&name, keys)).collect::<Result<_, _>>()?;
    let suppressions = suppress.into_iter().map(Suppress::check).collect::<Result<_, _>>()?;
    Ok(Judgement { rules, suppressions, expectations: expectation::check(expect)? })
}

fn settings(
    name: &Spanned<String>,
    keys: BTreeMap<Spanned<String>, Spanned<Setting>>,
) -> Result<RuleSettings, Wrong> {
    let mut settings = RuleSettings {
        rule: name.get_ref().clone(),
        span: name.span(),
        severity: None,
        tolerances: Vec::new(),
    };
    for (key, value) in keys {
        let span = value.span();
        match (key.get_ref().as_str(), value.into_inner()) {
            ("severity", Setting::Word(word)) => {
                settings.severity = Some(match word.as_str() {
                    "off" => None,
                    "note" => Some(Severity::Note),
                    "warning" => Some(Severity::Warning),
                    "error" => Some(Severity::Error),
                    _ => return Err((span, "a severity is error, warning, note or off".into())),
                });
            }
            ("severity", Setting::Number(_)) => {
                return Err((span, "a severity is \"error\", \"warning\", \"note\" or \"off\"".into()));
            }
            (other, Setting::Number(number)) if number.is_finite() && number >= 0.0 => {
                settings.tolerances.push((other.to_owned(), key.span(), number));
            }
            _ => return Err((span, "a tolerance is a number from 0".into())),
        }
    }
    Ok(settings)
}

impl Suppress {
    fn check(self) -> Result<Suppression, Wrong> {
        if self.reason.get_ref().trim().is_empty() {
            return Err((self.reason.span(), "a suppression needs its reason".into()));
        }
        let node = match &self.node {
            Some(node) => Some(node_id(node)?),
            None => None,
        };
        let until = match &self.until {
            Some(day) => Some(date(day)?),
            None => None,
        };
        Ok(Suppression {
            span: self.rule.span(),
            rule: self.rule.into_inner(),
            bus: self.bus,
            node,
            about: self.about,
            reason: self.reason.into_inner().into(),
            until,
        })
    }
}

fn date(day: &Spanned<Day>) -> Result<String, Wrong> {
    let text = match day.get_ref() {
        Day::Date(date) => date.to_string(),
        Day::Text(text) => text.clone(),
    };
    match text.parse::<jiff::civil::Date>() {
        Ok(date) if date.to_string() == text => Ok(text),
        _ => Err((day.span(), "a day is written 2026-01-31".into())),
    }
}
