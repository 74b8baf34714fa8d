//! The cases of CiA's conformance test plan: `cases.toml`.

use std::sync::OnceLock;

use serde::Deserialize;

/// What a case needs to be judged from a capture.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Deserialize)]
pub enum Class {
    /// Any capture shows it.
    P,
    /// Judged whenever its stimulus occurs.
    S,
    /// The same, and the device's dictionary must be known.
    E,
    /// Needs a stimulus hardly ever seen outside a test bench.
    A,
}

/// One case.
#[derive(Debug, Clone, PartialEq, Eq, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Case {
    group: u8,
    #[serde(rename = "case")]
    number: u8,
    /// `7.101`.
    pub id: String,
    /// Its subject, in our words.
    pub name: String,
    /// What it needs.
    pub class: Class,
    #[serde(default)]
    stimulus: Option<Stimulus>,
    /// Its verdict needs real times.
    #[serde(default)]
    pub timing: bool,
    /// Rules that judge it.
    pub rules: Vec<String>,
}

#[derive(Debug, Clone, Copy, PartialEq, Eq, Deserialize)]
#[serde(rename_all = "kebab-case")]
enum Stimulus {
    Negative,
}

impl Case {
    /// Whether it provokes aborts, emergencies or silence on purpose.
    pub(crate) fn is_negative(&self) -> bool {
        self.stimulus == Some(Stimulus::Negative)
    }
}

/// All cases.
#[derive(Debug, Default, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Cases {
    case: Vec<Case>,
}

impl Cases {
    /// A case by the numbers of its mark.
    pub fn find(&self, group: u8, case: u8) -> Option<&Case> {
        self.case.iter().find(|known| (known.group, known.number) == (group, case))
    }

    /// A case by its name in reports.
    pub fn by_id(&self, id: &str) -> Option<&Case> {
        self.case.iter().find(|known| known.id == id)
    }

    /// All of them, in the plan's order.
    pub fn iter(&self) -> impl Iterator<Item = &Case> {
        self.case.iter()
    }
}

/// The table.
pub fn cases() -> &'static Cases {
    static CASES: OnceLock<Cases> = OnceLock::new();
    // A test holds the file to be well-formed; a broken one has no cases.
    CASES.get_or_init(|| toml::from_str(include_str!("cases.toml")).unwrap_or_default())
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::rules::declarations;

    #[test]
    fn the_table_has_all_cases() {
        let file: Cases = toml::from_str(include_str!("cases.toml")).unwrap();
        assert_eq!(file.iter().count(), 127);
        for case in file.iter() {
            assert_eq!(case.id, format!("{}.{}", case.group, case.number));
            assert_eq!(file.by_id(&case.id), Some(case));
        }
    }

    #[test]
    fn every_rule_that_is_named_exists() {
        let known: Vec<_> = declarations().map(|rule| rule.name).collect();
        for case in cases().iter() {
            for rule in &case.rules {
                assert!(known.contains(&rule.as_str()), "{}: {rule}", case.id);
            }
        }
    }
}
