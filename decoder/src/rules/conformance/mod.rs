//! The cases of CiA's conformance test plan, by name: `cases.toml` as a table.

use std::sync::OnceLock;

use serde::Deserialize;

/// One case of the plan.
#[derive(Debug, Clone, Deserialize)]
pub struct Case {
    /// `2.1`, as rules name it.
    pub id: String,
    /// Its subject in our words.
    pub name: String,
}

#[derive(Deserialize)]
struct File {
    case: Vec<Case>,
}

/// All cases, in the order of the plan.
pub fn cases() -> &'static [Case] {
    static CASES: OnceLock<Vec<Case>> = OnceLock::new();
    CASES.get_or_init(|| {
        // A test holds the file to be well-formed.
        toml::from_str(include_str!("cases.toml")).map_or_else(|_| Vec::new(), |file: File| file.case)
    })
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::rules::declarations;

    #[test]
    fn every_case_a_rule_names_is_one_of_the_plan() {
        assert_eq!(cases().len(), 127);
        for rule in declarations() {
            for case in rule.cases {
                assert!(cases().iter().any(|known| known.id == *case), "{}: {case}", rule.name);
            }
        }
    }
}
