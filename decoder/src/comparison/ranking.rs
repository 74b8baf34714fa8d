//! `ranking.toml`: order of differences.

use std::collections::BTreeMap;
use std::sync::OnceLock;

use serde::Deserialize;

/// Weights of differences.
#[derive(Debug, Default, Deserialize)]
#[serde(deny_unknown_fields, rename_all = "kebab-case")]
pub(super) struct DifferenceWeights {
    story: StoryWeight,
    weight: BTreeMap<String, f64>,
    error_frames: ErrorFrameRules,
}

#[derive(Debug, Default, Deserialize)]
#[serde(deny_unknown_fields, rename_all = "kebab-case")]
struct StoryWeight {
    base: f64,
    per_rank: f64,
    most: f64,
    effect_part: f64,
}

#[derive(Debug, Default, Deserialize)]
#[serde(deny_unknown_fields)]
struct ErrorFrameRules {
    rules: Vec<String>,
}

impl DifferenceWeights {
    /// Weight of a kind of difference; 0 for an unknown one.
    pub(super) fn difference_weight(&self, kind: &str) -> f64 {
        self.weight.get(kind).copied().unwrap_or(0.0)
    }

    /// Weight of a new story.
    pub(super) fn story_weight(&self, rank: f64, is_cause_visible: bool) -> f64 {
        let StoryWeight { base, per_rank, most, effect_part } = self.story;
        let part = if is_cause_visible { 1.0 } else { effect_part };
        (base + per_rank * rank).min(most) * part
    }

    /// Whether a rule depends on error frames.
    pub(super) fn needs_error_frames(&self, rule: &str) -> bool {
        self.error_frames.rules.iter().any(|known| known == rule)
    }
}

/// The table, parsed once.
pub(super) fn load_ranking() -> &'static DifferenceWeights {
    static RANKING: OnceLock<DifferenceWeights> = OnceLock::new();
    RANKING.get_or_init(|| {
        // A unit test checks that the file is valid; an invalid file would yield an empty table.
        toml::from_str(include_str!("ranking.toml")).unwrap_or_default()
    })
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::comparison::difference::DifferenceKind;
    use crate::rules::all_declarations;

    #[test]
    fn every_kind_has_a_weight_and_every_name_is_a_rule() {
        toml::from_str::<DifferenceWeights>(include_str!("ranking.toml")).unwrap();
        let ranking = load_ranking();
        for kind in DifferenceKind::ALL {
            assert!(ranking.difference_weight(kind.name()) > 0.0, "{}", kind.name());
        }
        let known: Vec<_> = DifferenceKind::ALL.iter().map(|kind| kind.name()).collect();
        for name in ranking.weight.keys() {
            assert!(known.contains(&name.as_str()), "{name}");
        }
        let rules: Vec<_> = all_declarations().map(|rule| rule.name).collect();
        for name in &ranking.error_frames.rules {
            assert!(rules.contains(&name.as_str()), "{name}");
        }
    }

    #[test]
    fn a_visible_cause_precedes_its_effects() {
        let ranking = load_ranking();
        assert!(ranking.story_weight(6.0, true) > ranking.difference_weight("parameter"));
        assert!(ranking.story_weight(6.0, false) < ranking.difference_weight("parameter"));
    }
}
