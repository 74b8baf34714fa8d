//! Causes of findings: `causes.toml`, indexed by the rule of the effect.

use std::collections::HashMap;
use std::sync::{Arc, OnceLock};

use serde::Deserialize;

use super::fact_row::FactRow;
use crate::event::{Kind, KindSet};
use crate::finding::{FindingCause, RuleInfo, RuleOrigin};

/// Name in `by` and `effects` for device rules about a parameter of the device.
pub(super) const DEVICE_WRITE: &str = "device-write";

/// Name in `effects` for all rules that check times.
const TIMING: &str = "timing";

/// Consequence for a finding that has a cause.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub(in crate::rules) enum CauseEffect {
    /// Consequence of the cause: printed below it with unchanged severity.
    Follows,
    /// Same fault as the cause: counted there, not printed.
    Same,
    /// The capture or the bus may be the reason instead of the device: reduced to a note.
    Quality,
}

/// A cause found for a finding.
#[derive(Debug, Clone, PartialEq)]
pub(in crate::rules) struct CauseExplanation {
    pub(in crate::rules) effect: CauseEffect,
    pub(in crate::rules) by: FindingCause,
}

/// One row of the table.
#[derive(Debug)]
pub(in crate::rules) struct CauseEntry {
    /// Rule, fact or event kind of the cause.
    pub(in crate::rules) by: String,
    /// Event kind with this name, if there is one.
    pub(in crate::rules) kind: Option<Kind>,
    /// Description of the cause if it is an event kind.
    pub(in crate::rules) text: Arc<str>,
    /// Maximum time from cause to effect, in ns.
    pub(in crate::rules) within: i64,
    /// Maximum time from effect to cause, in ns: a device may report an effect first, and a deadline ends after
    /// its effects.
    pub(in crate::rules) before: i64,
    /// An ongoing cause explains effects until it ends, without `within`.
    pub(in crate::rules) lasts: bool,
    /// Reason that the effect must have, such as a gate.
    pub(in crate::rules) reason: Option<Box<str>>,
    /// The effect must be about a parameter of the device.
    pub(in crate::rules) is_of_parameter: bool,
    /// First and last EMCY code that the effect must have.
    pub(in crate::rules) codes: Option<[u16; 2]>,
    /// Cause and effect must be at the same node.
    pub(in crate::rules) is_on_node: bool,
    /// Consequence for the effect.
    pub(in crate::rules) effect: CauseEffect,
}

#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
struct CausesFile {
    follows: CauseLimits,
    fact: Vec<FactRow>,
    cause: Vec<CauseRow>,
}

#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
struct CauseLimits {
    seconds: f64,
    before: f64,
}

/// Limits for rules in `follows` of a device rule.
#[derive(Debug, Default)]
pub(in crate::rules) struct FollowLimits {
    /// Maximum time from the end of the cause to the effect, in ns.
    pub(in crate::rules) within: i64,
    /// Maximum time from the effect to the report of the cause, in ns.
    pub(in crate::rules) before: i64,
}

#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
struct CauseRow {
    by: Vec<String>,
    effects: Vec<String>,
    seconds: f64,
    #[serde(default)]
    before: f64,
    #[serde(default)]
    lasts: bool,
    on: CauseScope,
    becomes: CauseEffect,
    #[serde(default)]
    text: String,
    #[serde(default)]
    reason: Option<Box<str>>,
    #[serde(default)]
    codes: Option<[u16; 2]>,
}

#[derive(Deserialize, PartialEq, Eq)]
#[serde(rename_all = "kebab-case")]
enum CauseScope {
    Node,
    Bus,
}

/// All rows, by the rule of the effect.
#[derive(Debug, Default)]
pub(in crate::rules) struct CauseTable {
    /// Limits for rules in `follows` of a device rule.
    pub(in crate::rules) follows: FollowLimits,
    /// Facts that can be a cause.
    pub(super) facts: Vec<FactRow>,
    by_effect: HashMap<String, Vec<Arc<CauseEntry>>>,
    explaining: KindSet,
}

impl CauseTable {
    /// Possible causes for findings of a rule, most specific first: rows of the rule, those of the rules that
    /// it absorbs, then those for all timing rules. Absorbed rules count for timing rules only: an interval of
    /// the device has the causes of the general interval.
    pub(in crate::rules) fn causes_of<'a>(
        &'a self,
        rule: &'a RuleInfo,
        absorbed: &'a [Arc<str>],
    ) -> impl Iterator<Item = &'a CauseEntry> {
        let rows = |name: &str| self.by_effect.get(name).into_iter().flatten();
        let is_absorbed = |entry: &&Arc<CauseEntry>| absorbed.iter().any(|name| **name == *entry.by);
        let of_absorbed = absorbed.iter().filter(|_| rule.is_timing).flat_map(move |name| rows(name));
        let of_absorbed = of_absorbed.filter(move |entry| !is_absorbed(entry));
        let timing = self.by_effect.get(TIMING).filter(|_| rule.is_timing);
        let of_device = rows(DEVICE_WRITE).filter(|_| rule.origin == RuleOrigin::Device);
        rows(&rule.name)
            .chain(of_absorbed)
            .chain(of_device)
            .chain(timing.into_iter().flatten())
            .map(Arc::as_ref)
    }

    /// Event kinds that can be a cause.
    pub(in crate::rules) fn explaining_names(&self) -> KindSet {
        self.explaining
    }

    /// Whether a fact has this name.
    pub(in crate::rules) fn is_fact(&self, name: &str) -> bool {
        self.facts.iter().any(|fact| fact.name == name)
    }

    /// Rules that can be an effect.
    #[cfg(test)]
    fn explained_rules(&self) -> impl Iterator<Item = &String> {
        self.by_effect.keys()
    }
}

/// Table of causes, parsed once.
pub(in crate::rules) fn cause_table() -> &'static CauseTable {
    static CAUSES: OnceLock<CauseTable> = OnceLock::new();
    CAUSES.get_or_init(|| {
        // A unit test checks that the file is valid; an invalid file would yield an empty table.
        toml::from_str::<CausesFile>(include_str!("causes.toml"))
            .map_or_else(|_| CauseTable::default(), build_table)
    })
}

/// Seconds of a table of our own, in ns.
#[expect(clippy::cast_possible_truncation, reason = "seconds of a table of our own")]
fn to_nanoseconds(seconds: f64) -> i64 {
    (seconds * 1e9) as i64
}

fn build_table(file: CausesFile) -> CauseTable {
    let mut causes = CauseTable::default();
    causes.follows.within = to_nanoseconds(file.follows.seconds);
    causes.follows.before = to_nanoseconds(file.follows.before);
    causes.facts = file.fact;
    for row in file.cause {
        for by in &row.by {
            let kind = Kind::from_name(by);
            let entry = |is_of_parameter| CauseEntry {
                by: by.clone(),
                kind,
                text: if row.text.is_empty() { by.as_str().into() } else { row.text.as_str().into() },
                within: to_nanoseconds(row.seconds),
                before: to_nanoseconds(row.before),
                lasts: row.lasts,
                reason: row.reason.clone(),
                codes: row.codes,
                is_on_node: row.on == CauseScope::Node,
                effect: row.becomes,
                is_of_parameter,
            };
            let common = Arc::new(entry(false));
            for effect in &row.effects {
                let entry = if effect == DEVICE_WRITE { Arc::new(entry(true)) } else { Arc::clone(&common) };
                causes.by_effect.entry(effect.clone()).or_default().push(entry);
            }
            causes.explaining = causes.explaining.or(kind.into_iter().collect());
        }
    }
    causes
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::rules::all_declarations;

    #[test]
    fn every_name_is_a_rule_or_a_kind_of_event() {
        let rules: Vec<_> = all_declarations().map(|rule| rule.name).collect();
        toml::from_str::<CausesFile>(include_str!("causes.toml")).unwrap();
        let explaining = cause_table().explaining_names();
        assert!(explaining.contains_kind(Kind::LostFrames) && !explaining.contains_kind(Kind::Heartbeat));
        for entry in cause_table().by_effect.values().flatten() {
            let name = entry.by.as_str();
            let is_other = cause_table().is_fact(name) || entry.kind.is_some() || name == DEVICE_WRITE;
            assert!(rules.contains(&name) || is_other, "{name}");
        }
        for name in cause_table().explained_rules() {
            assert!(name == TIMING || name == DEVICE_WRITE || rules.contains(&name.as_str()), "{name}");
        }
    }
}
