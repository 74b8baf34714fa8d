//! What explains what: `causes.toml` as a table by effect.

use std::collections::HashMap;
use std::sync::{Arc, OnceLock};

use serde::Deserialize;

use crate::finding::{Cause, RuleInfo};

/// Among effects: all rules that judge times.
const TIMING: &str = "timing";

/// What becomes of a finding that another one explains.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub(in crate::rules) enum Effect {
    /// It follows from it: told beneath it, as severe as it is.
    Follows,
    /// It says the same: counted there and not told.
    Same,
    /// The capture or the bus is to blame as likely as the device: a note.
    Quality,
}

/// An explanation that was found.
#[derive(Debug, Clone, PartialEq, Eq)]
pub(in crate::rules) struct Explained {
    pub(in crate::rules) effect: Effect,
    pub(in crate::rules) by: Cause,
}

/// One line of the table.
#[derive(Debug)]
pub(in crate::rules) struct CauseEntry {
    /// Rule or kind of event that explains.
    pub(in crate::rules) by: String,
    /// What is said where it is a kind of event.
    pub(in crate::rules) text: Arc<str>,
    /// How long before the effect at most, in nanoseconds.
    pub(in crate::rules) within: i64,
    /// It must be of the same node.
    pub(in crate::rules) is_on_node: bool,
    /// What becomes of the effect.
    pub(in crate::rules) effect: Effect,
}

#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
struct File {
    cause: Vec<Row>,
}

#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
struct Row {
    by: Vec<String>,
    effects: Vec<String>,
    seconds: f64,
    on: Scope,
    becomes: Effect,
    #[serde(default)]
    text: String,
}

#[derive(Deserialize, PartialEq, Eq)]
#[serde(rename_all = "kebab-case")]
enum Scope {
    Node,
    Bus,
}

/// All lines by the name of the effect's rule.
#[derive(Debug, Default)]
pub(in crate::rules) struct Causes {
    by_effect: HashMap<String, Vec<Arc<CauseEntry>>>,
    by: Vec<String>,
}

impl Causes {
    /// What may explain findings of a rule, likeliest first: its own lines, then those of all rules about times.
    pub(in crate::rules) fn of(&self, rule: &RuleInfo) -> impl Iterator<Item = &CauseEntry> {
        let timing = self.by_effect.get(TIMING).filter(|_| rule.is_timing);
        let own = self.by_effect.get(&*rule.name);
        own.into_iter().chain(timing).flatten().map(Arc::as_ref)
    }

    /// Rules and kinds of events that explain.
    pub(in crate::rules) fn explaining(&self) -> &[String] {
        &self.by
    }

    /// Rules that are explained.
    #[cfg(test)]
    fn explained(&self) -> impl Iterator<Item = &String> {
        self.by_effect.keys()
    }
}

/// The table.
pub(in crate::rules) fn causes() -> &'static Causes {
    static CAUSES: OnceLock<Causes> = OnceLock::new();
    CAUSES.get_or_init(|| {
        // A test holds the file to be well-formed; a broken one explains nothing.
        let file: File = toml::from_str(include_str!("causes.toml")).unwrap_or(File { cause: Vec::new() });
        let mut causes = Causes::default();
        for row in file.cause {
            for by in &row.by {
                #[expect(clippy::cast_possible_truncation, reason = "seconds of a table of our own")]
                let entry = Arc::new(CauseEntry {
                    by: by.clone(),
                    text: if row.text.is_empty() { by.as_str().into() } else { row.text.as_str().into() },
                    within: (row.seconds * 1e9) as i64,
                    is_on_node: row.on == Scope::Node,
                    effect: row.becomes,
                });
                for effect in &row.effects {
                    causes.by_effect.entry(effect.clone()).or_default().push(Arc::clone(&entry));
                }
                causes.by.push(by.clone());
            }
        }
        causes
    })
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::query::KindSet;
    use crate::rules::declarations;

    #[test]
    fn every_name_is_a_rule_or_a_kind_of_event() {
        let rules: Vec<_> = declarations().map(|rule| rule.name).collect();
        toml::from_str::<File>(include_str!("causes.toml")).unwrap();
        assert!(!causes().explaining().is_empty());
        for name in causes().explaining() {
            assert!(rules.contains(&name.as_str()) || KindSet::ALL.contains_name(name), "{name}");
        }
        for name in causes().explained() {
            assert!(name == TIMING || rules.contains(&name.as_str()), "{name}");
        }
    }
}
