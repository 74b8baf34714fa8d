//! The cases of CiA's conformance test plan: `cases.toml`.

use std::sync::OnceLock;

use serde::Deserialize;

/// Requirements for a verdict on a case from a capture.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Deserialize)]
pub enum CaseClass {
    /// Any capture is sufficient.
    P,
    /// The stimulus must occur in the capture.
    S,
    /// The stimulus must occur, and the object dictionary of the device must be known.
    E,
    /// The stimulus hardly ever occurs outside a test bench.
    A,
}

/// One test case.
#[derive(Debug, Clone, PartialEq, Eq, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct TestCase {
    group: u8,
    #[serde(rename = "case")]
    number: u8,
    /// Number in the test plan, such as `7.101`.
    pub id: String,
    /// Subject, in our own words.
    pub name: String,
    /// Requirements for a verdict.
    pub class: CaseClass,
    #[serde(default)]
    stimulus: Option<Stimulus>,
    /// The verdict requires usable timestamps.
    #[serde(default)]
    pub timing: bool,
    /// Rules that check the case.
    pub rules: Vec<String>,
}

#[derive(Debug, Clone, Copy, PartialEq, Eq, Deserialize)]
#[serde(rename_all = "kebab-case")]
enum Stimulus {
    Negative,
}

impl TestCase {
    /// Whether the case provokes aborts, emergencies or silence on purpose.
    pub(crate) fn is_negative(&self) -> bool {
        self.stimulus == Some(Stimulus::Negative)
    }
}

/// All test cases.
#[derive(Debug, Default, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct TestCases {
    case: Vec<TestCase>,
}

impl TestCases {
    /// Looks up a case by the numbers in its marker.
    pub fn find_case(&self, group: u8, case: u8) -> Option<&TestCase> {
        self.case.iter().find(|known| (known.group, known.number) == (group, case))
    }

    /// Looks up a case by its number in the test plan.
    pub fn by_id(&self, id: &str) -> Option<&TestCase> {
        self.case.iter().find(|known| known.id == id)
    }

    /// Iterates in the order of the test plan.
    pub fn iter(&self) -> impl Iterator<Item = &TestCase> {
        self.case.iter()
    }
}

/// Table of cases, parsed once.
pub fn test_cases() -> &'static TestCases {
    static CASES: OnceLock<TestCases> = OnceLock::new();
    // A unit test checks that the file is valid; an invalid file would yield an empty table.
    CASES.get_or_init(|| toml::from_str(include_str!("cases.toml")).unwrap_or_default())
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::rules::all_declarations;

    #[test]
    fn the_table_has_all_cases() {
        let file: TestCases = toml::from_str(include_str!("cases.toml")).unwrap();
        assert_eq!(file.iter().count(), 127);
        for case in file.iter() {
            assert_eq!(case.id, format!("{}.{}", case.group, case.number));
            assert_eq!(file.by_id(&case.id), Some(case));
        }
    }

    #[test]
    fn every_rule_that_is_named_exists() {
        let known: Vec<_> = all_declarations().map(|rule| rule.name).collect();
        for case in test_cases().iter() {
            for rule in &case.rules {
                assert!(known.contains(&rule.as_str()), "{}: {rule}", case.id);
            }
        }
    }
}
