//! `ranking.toml`: weights of findings, and findings that state an effect only.

use std::collections::HashMap;
use std::sync::OnceLock;

use serde::Deserialize;

use crate::finding::{FindingGroup, FindingSubject, Severity};

/// Weights and roles of findings.
#[derive(Debug, Default)]
pub(super) struct FindingWeights {
    weight: RuleWeight,
    part: f64,
    usage: Vec<String>,
    /// Findings that state an effect, by rule.
    effects: HashMap<String, EffectRole>,
}

/// Role of a finding that states an effect.
#[derive(Debug, Clone)]
struct EffectRole {
    /// What to record next.
    record: String,
    /// First and last EMCY code.
    codes: Option<[u16; 2]>,
}

#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
struct RankingFile {
    weight: RuleWeight,
    usage: RuleUsage,
    effect: Vec<RankingRow>,
}

#[derive(Debug, Default, Deserialize)]
#[serde(deny_unknown_fields)]
struct RuleWeight {
    error: f64,
    warning: f64,
    note: f64,
}

#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
struct RuleUsage {
    part: f64,
    rules: Vec<String>,
}

#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
struct RankingRow {
    rules: Vec<String>,
    record: String,
    #[serde(default)]
    codes: Option<[u16; 2]>,
}

impl FindingWeights {
    /// Weight of a finding of a rule.
    pub(super) fn finding_weight(&self, rule: &str, severity: Severity) -> f64 {
        let weight = match severity {
            Severity::Error => self.weight.error,
            Severity::Warning => self.weight.warning,
            Severity::Note => self.weight.note,
        };
        if self.usage.iter().any(|known| known == rule) { weight * self.part } else { weight }
    }

    /// What to record next, if a finding states an effect only.
    pub(super) fn record_hint(&self, group: &FindingGroup) -> Option<&str> {
        let role = self.effects.get(&*group.rule)?;
        let is_meant = match (role.codes, &group.key.about) {
            (Some([first, last]), FindingSubject::Code(code)) => (first..=last).contains(code),
            _ => true,
        };
        is_meant.then_some(role.record.as_str())
    }
}

/// Table of weights and roles, parsed once.
pub(super) fn load_ranking() -> &'static FindingWeights {
    static RANKING: OnceLock<FindingWeights> = OnceLock::new();
    RANKING.get_or_init(|| {
        // A unit test checks that the file is valid; an invalid file would yield an empty table.
        let Ok(file) = toml::from_str::<RankingFile>(include_str!("ranking.toml")) else {
            return FindingWeights::default();
        };
        let effects = file.effect.into_iter().flat_map(|row| {
            let role = EffectRole { record: row.record, codes: row.codes };
            row.rules.into_iter().map(move |rule| (rule, role.clone()))
        });
        FindingWeights {
            weight: file.weight,
            part: file.usage.part,
            usage: file.usage.rules,
            effects: effects.collect(),
        }
    })
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::rules::all_declarations;

    #[test]
    fn every_name_is_a_rule() {
        let rules: Vec<_> = all_declarations().map(|rule| rule.name).collect();
        toml::from_str::<RankingFile>(include_str!("ranking.toml")).unwrap();
        let ranking = load_ranking();
        assert!(!ranking.effects.is_empty() && !ranking.usage.is_empty());
        for name in ranking.effects.keys().chain(&ranking.usage) {
            assert!(rules.contains(&name.as_str()), "{name}");
        }
    }

    #[test]
    fn use_of_a_protocol_weighs_less_than_a_fault() {
        let ranking = load_ranking();
        let weight = |rule| ranking.finding_weight(rule, Severity::Warning);
        assert!(weight("emcy-raised") > weight("access-type"));
    }
}
