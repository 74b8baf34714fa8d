//! Rules selected on the command line.

/// Names of rules, each exact or a prefix with `*`: `pdo-lost`, `pdo-*`, `rexroth-sydfec:*`.
#[derive(Debug, Clone, Default)]
pub struct RuleSelection {
    /// Only these rules are active; all if empty.
    pub select: Vec<String>,
    /// These rules are not active.
    pub ignore: Vec<String>,
}

impl RuleSelection {
    /// Whether a rule is active.
    pub fn admits_rule(&self, rule: &str) -> bool {
        let is_meant = |patterns: &[String]| patterns.iter().any(|pattern| matches_rule(pattern, rule));
        (self.select.is_empty() || is_meant(&self.select)) && !is_meant(&self.ignore)
    }
}

/// Whether a pattern means a rule.
pub(super) fn matches_rule(pattern: &str, rule: &str) -> bool {
    match pattern.strip_suffix('*') {
        Some(prefix) => rule.starts_with(prefix),
        None => rule == pattern,
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn names_and_prefixes_select_rules() {
        let names = |all: &[&str]| all.iter().map(|name| (*name).to_owned()).collect();
        let chosen = RuleSelection { select: names(&["pdo-*", "node-lost"]), ignore: names(&["pdo-long"]) };
        assert!(chosen.admits_rule("pdo-lost") && chosen.admits_rule("node-lost"));
        assert!(!chosen.admits_rule("pdo-long") && !chosen.admits_rule("emcy-raised"));
        let all = RuleSelection { ignore: names(&["rexroth-sydfec:*"]), ..RuleSelection::default() };
        assert!(all.admits_rule("pdo-long") && !all.admits_rule("rexroth-sydfec:eeprom-wear"));
    }
}
