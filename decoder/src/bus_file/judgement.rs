//! User settings for rules: severity, tolerances, suppressed findings and expectations.

use std::collections::BTreeMap;
use std::ops::Range;
use std::sync::Arc;

use serde::Deserialize;
use toml::Spanned;

use super::written::{NodeNumber, TextProblem, node_id};
use crate::profile::device::{DeviceRule, Severity};
use crate::profile::{ExpectEntry, ExpectTable, check_entries};
use crate::wire::NodeId;

/// Rule settings of the file. `rules/` checks the rule names, so each keeps its place in the file.
#[derive(Debug, Clone, Default, PartialEq)]
pub struct Judgement {
    /// Entries `[rules.<name>]`.
    pub rules: Vec<RuleSettings>,
    /// Entries `[[suppress]]`.
    pub suppressions: Vec<Suppression>,
    /// Entries `[[expect]]`.
    pub expectations: Vec<ExpectEntry>,
    /// Entries `[[rule]]`, one per repeat.
    pub node_rules: Vec<NodeRule>,
}

/// A rule of a node in the grammar of profiles.
#[derive(Debug, Clone)]
pub struct NodeRule {
    /// Bus it applies to; `None` for every bus.
    pub bus: Option<String>,
    /// Node it applies to.
    pub node: NodeId,
    /// The rule without bus and node.
    pub rule: Arc<DeviceRule>,
    /// Position in the file, in bytes.
    pub span: Range<usize>,
}

/// Entries of one file are equal if they have the same position.
impl PartialEq for NodeRule {
    fn eq(&self, other: &Self) -> bool {
        (&self.bus, self.node, &self.rule.name, &self.span)
            == (&other.bus, other.node, &other.rule.name, &other.span)
    }
}

/// Settings of one rule.
#[derive(Debug, Clone, PartialEq)]
pub struct RuleSettings {
    /// Rule slug as written.
    pub rule: String,
    /// Position of the rule name in the file, in bytes.
    pub span: Range<usize>,
    /// Severity override; `Some(None)` disables the rule.
    pub severity: Option<Option<Severity>>,
    /// Tolerances: key, its position in the file, value.
    pub tolerances: Vec<(String, Range<usize>, f64)>,
}

/// Known and accepted findings.
#[derive(Debug, Clone, PartialEq)]
pub struct Suppression {
    /// Rule slug as written.
    pub rule: String,
    /// Position of the rule name in the file, in bytes.
    pub span: Range<usize>,
    /// Bus it applies to; `None` for every bus.
    pub bus: Option<String>,
    /// Node it applies to; `None` for every node.
    pub node: Option<NodeId>,
    /// Object, code or name as printed in the finding; `None` for all.
    pub about: Option<String>,
    /// Reason from the file, printed with the suppressed finding.
    pub reason: Arc<str>,
    /// Last day on which it applies, as `2026-01-31`; `None` without end.
    pub until: Option<String>,
}

const SEVERITIES: &str = "unknown severity; expected \"error\", \"warning\", \"note\" or \"off\"";

/// Table `[rules]`: settings by rule name.
pub(super) type Rules = BTreeMap<Spanned<String>, BTreeMap<Spanned<String>, Spanned<RuleSetting>>>;

#[derive(Deserialize)]
#[serde(untagged, expecting = "expected a number or a severity")]
pub(super) enum RuleSetting {
    Number(f64),
    Word(String),
}

/// One `[[suppress]]` table as parsed.
#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
pub(super) struct SuppressTable {
    rule: Spanned<String>,
    #[serde(default)]
    bus: Option<String>,
    #[serde(default)]
    node: Option<Spanned<NodeNumber>>,
    #[serde(default)]
    about: Option<String>,
    reason: Spanned<String>,
    #[serde(default)]
    until: Option<Spanned<DayEntry>>,
}

#[derive(Deserialize)]
#[serde(untagged, expecting = "expected a date such as 2026-01-31")]
enum DayEntry {
    Date(toml::value::Datetime),
    Text(String),
}

/// Checks all tables on rules; returns the first problem.
pub(super) fn check_judgement(
    rules: Rules,
    suppress: Vec<SuppressTable>,
    expect: Vec<ExpectTable>,
    added: Vec<Spanned<DeviceRule>>,
) -> Result<Judgement, TextProblem> {
    let rules =
        rules.into_iter().map(|(name, keys)| check_settings(&name, keys)).collect::<Result<_, _>>()?;
    let suppressions =
        suppress.into_iter().map(SuppressTable::check_suppression).collect::<Result<_, _>>()?;
    let node_rules = check_node_rules(added)?;
    Ok(Judgement { rules, suppressions, expectations: check_entries(expect, None)?, node_rules })
}

/// Maximum number of `[[rule]]` entries per file, including repeats.
const NODE_RULE_LIMIT: usize = 1_000;

fn check_node_rules(all: Vec<Spanned<DeviceRule>>) -> Result<Vec<NodeRule>, TextProblem> {
    let mut known: Vec<NodeRule> = Vec::new();
    for written in all {
        let span = written.span();
        let mut rule = written.into_inner();
        let wrong = |message: String| (span.clone(), message);
        let Some(node) = rule.node.take() else {
            return Err(wrong("node is missing; a rule in a bus file applies to one node".into()));
        };
        let (node, bus) = (node_id(&node)?, rule.bus.take());
        if let Some(message) = rule.alone_problem() {
            return Err(wrong(message));
        }
        if known.iter().any(|other| other.rule.name == rule.name) {
            return Err(wrong(format!("duplicate rule '{}'", rule.name)));
        }
        if known.len() + usize::from(rule.repeat.count) > NODE_RULE_LIMIT {
            return Err(wrong(format!("more than {NODE_RULE_LIMIT} rules in one file")));
        }
        let repeats = (0..rule.repeat.count).map(|nth| Arc::new(rule.pin_repeat(nth)));
        known.extend(repeats.map(|rule| NodeRule { bus: bus.clone(), node, rule, span: span.clone() }));
    }
    Ok(known)
}

fn check_settings(
    name: &Spanned<String>,
    keys: BTreeMap<Spanned<String>, Spanned<RuleSetting>>,
) -> Result<RuleSettings, TextProblem> {
    let mut settings = RuleSettings {
        rule: name.get_ref().clone(),
        span: name.span(),
        severity: None,
        tolerances: Vec::new(),
    };
    for (key, value) in keys {
        let span = value.span();
        match (key.get_ref().as_str(), value.into_inner()) {
            ("severity", RuleSetting::Word(word)) => {
                settings.severity = Some(match word.as_str() {
                    "off" => None,
                    "note" => Some(Severity::Note),
                    "warning" => Some(Severity::Warning),
                    "error" => Some(Severity::Error),
                    _ => return Err((span, SEVERITIES.into())),
                });
            }
            ("severity", RuleSetting::Number(_)) => {
                return Err((span, SEVERITIES.into()));
            }
            (other, RuleSetting::Number(number)) if number.is_finite() && number >= 0.0 => {
                settings.tolerances.push((other.to_owned(), key.span(), number));
            }
            _ => return Err((span, "invalid tolerance; expected a number ≥ 0".into())),
        }
    }
    Ok(settings)
}

impl SuppressTable {
    fn check_suppression(self) -> Result<Suppression, TextProblem> {
        if self.reason.get_ref().trim().is_empty() {
            return Err((self.reason.span(), "empty reason; expected a text".into()));
        }
        let node = match &self.node {
            Some(node) => Some(node_id(node)?),
            None => None,
        };
        let until = match &self.until {
            Some(day) => Some(parse_date(day)?),
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

fn parse_date(day: &Spanned<DayEntry>) -> Result<String, TextProblem> {
    let text = match day.get_ref() {
        DayEntry::Date(date) => date.to_string(),
        DayEntry::Text(text) => text.clone(),
    };
    match text.parse::<jiff::civil::Date>() {
        Ok(date) if date.to_string() == text => Ok(text),
        _ => Err((day.span(), "invalid date; expected the form 2026-01-31".into())),
    }
}
