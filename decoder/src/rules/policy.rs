//! Settings of the bus file for rules: severities, tolerances and suppressions.

use std::collections::HashMap;
use std::sync::Arc;

use super::declaration::Declaration;
use super::selection::{self, RuleSelection};
use crate::bus_file::{NodeRule, Suppression};
use crate::conclusion::{all_hypotheses, find_hypothesis};
use crate::finding::{FindingGroup, FindingSubject, RuleInfo, Severity, SuppressionUse};
use crate::wire::NodeId;

/// Rules with their settings.
#[derive(Debug, Clone, Default)]
pub struct RulePolicy {
    pub(super) rules: Vec<RuleInfo>,
    pub(super) severities: HashMap<String, Severity>,
    /// Device rules that are switched off.
    pub(super) off: Vec<String>,
    /// Rules selected on the command line.
    pub(super) selection: RuleSelection,
    pub(super) tolerances: HashMap<(&'static str, &'static str), f64>,
    pub(super) suppressions: Vec<Suppression>,
    /// Rules of single nodes.
    pub(super) node_rules: Vec<NodeRule>,
    pub(super) today: Option<String>,
}

impl RulePolicy {
    /// Whether a rule exists. A name with a colon is accepted: it names a device rule, known once the device
    /// is identified.
    pub(super) fn knows_rule(&self, rule: &str) -> bool {
        rule.contains(':')
            || self.rules.iter().any(|known| *known.name == *rule)
            || find_hypothesis(rule).is_some()
    }

    /// Whether a pattern on the command line means a rule; one with a colon may mean a device rule.
    pub(super) fn knows_pattern(&self, pattern: &str) -> bool {
        let is_meant = |name: &str| selection::matches_rule(pattern, name);
        pattern.contains(':')
            || self.rules.iter().any(|known| is_meant(&known.name))
            || all_hypotheses().iter().any(|row| is_meant(&row.id))
    }

    /// Value of a tolerance: from the bus file, else the default.
    pub fn tolerance_value(&self, declaration: &Declaration, key: &'static str) -> f64 {
        let given = self.tolerances.get(&(declaration.name, key)).copied();
        let default = declaration.tolerances.iter().find(|tolerance| tolerance.key == key);
        given.or(default.map(|tolerance| tolerance.default)).unwrap_or(f64::INFINITY)
    }

    /// Tolerance in ms, converted to ns.
    pub fn tolerance_ns(&self, declaration: &Declaration, key: &'static str) -> i64 {
        #[expect(clippy::cast_possible_truncation, reason = "saturates")]
        let value = (self.tolerance_value(declaration, key) * 1e6) as i64;
        value
    }

    /// Severity of a rule in the bus file.
    pub(super) fn severity_of(&self, rule: &str) -> Option<Severity> {
        self.severities.get(rule).copied()
    }

    /// Whether a device rule is switched off.
    pub(super) fn is_off(&self, rule: &str) -> bool {
        !self.selection.admits_rule(rule) || self.off.iter().any(|off| off == rule)
    }

    /// Reason of the suppression that applies to a group.
    pub(super) fn suppression_reason(&self, group: &FindingGroup) -> Option<Arc<str>> {
        let mut all = self.suppressions.iter().filter(|one| !self.is_over(one));
        all.find(|one| covers_group(one, group)).map(|one| Arc::clone(&one.reason))
    }

    fn is_over(&self, suppression: &Suppression) -> bool {
        // ISO dates sort as text.
        matches!((&suppression.until, &self.today), (Some(until), Some(today)) if until < today)
    }

    /// Number of groups that each suppression matched.
    pub(super) fn count_suppressions(&self, groups: &[FindingGroup]) -> Vec<SuppressionUse> {
        let uses = self.suppressions.iter().map(|one| {
            let is_over = self.is_over(one);
            let met =
                if is_over { 0 } else { groups.iter().filter(|group| covers_group(one, group)).count() };
            let ended = one.until.clone().filter(|_| is_over);
            SuppressionUse { what: suppression_text(one), reason: Arc::clone(&one.reason), ended, met }
        });
        uses.collect()
    }
}

/// Description of a suppression: `node-lost of can0 node 5 1018:01`.
fn suppression_text(suppression: &Suppression) -> String {
    let node = suppression.node.map(NodeId::sentence_label);
    let parts = [suppression.bus.clone(), node, suppression.about.clone()];
    let of: Vec<_> = parts.into_iter().flatten().collect();
    let of = if of.is_empty() { String::new() } else { format!(" of {}", of.join(" ")) };
    format!("{}{of}", suppression.rule)
}

fn covers_group(suppression: &Suppression, group: &FindingGroup) -> bool {
    *suppression.rule == *group.rule
        && suppression.bus.as_deref().is_none_or(|bus| *bus == *group.bus)
        && suppression.node.is_none_or(|node| group.key.node == Some(node))
        && suppression.about.as_deref().is_none_or(|about| is_about(&group.key.about, about))
}

/// Compares a subject with the notation of a user: objects in any notation, codes and identifiers with or
/// without `0x`.
fn is_about(about: &FindingSubject, written: &str) -> bool {
    let bare = written.strip_prefix("0x").unwrap_or(written);
    match about {
        FindingSubject::Object(object) => written.parse() == Ok(*object),
        FindingSubject::Code(_) | FindingSubject::Id(_) => about.to_string().eq_ignore_ascii_case(bare),
        _ => about.to_string() == written,
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::wire::canopen::ObjectAddress;

    #[test]
    fn what_a_suppression_is_about_is_written_as_people_do() {
        let object = FindingSubject::Object(ObjectAddress::new(0x5208, 2));
        for written in ["5208:02", "5208:2", "0x5208:02", "5208sub2"] {
            assert!(is_about(&object, written), "{written}");
        }
        assert!(!is_about(&object, "5208"));
        for written in ["FF10", "ff10", "0xFF10"] {
            assert!(is_about(&FindingSubject::Code(0xFF10), written), "{written}");
        }
        assert!(
            is_about(&FindingSubject::Name("lamp".into()), "lamp")
                && !is_about(&FindingSubject::Whole, "5208:02")
        );
    }
}
