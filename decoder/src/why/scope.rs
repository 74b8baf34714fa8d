//! Part of a capture that a report selects faults from.

use super::WhyScope;
use crate::words::count_noun;

/// Part of a capture that a report selects faults from; the default is the whole capture.
#[derive(Debug, Clone, Default)]
pub struct FaultScope {
    /// Start: `1.000 s`, `frame 12`.
    pub from: Option<String>,
    /// End, in the form of the start.
    pub to: Option<String>,
    /// `--filter` selects events.
    pub has_filter: bool,
    /// `--only-node` selects several nodes; a single one is the chosen node of the question.
    pub has_nodes: bool,
    /// Number of findings that are not selected.
    pub unselected: usize,
}

impl FaultScope {
    /// Completes `no fault`: `that matches --filter; 3 findings not selected`; empty for the whole capture.
    pub fn scope_text(&self, question: &WhyScope) -> String {
        let chosen = question.chosen.as_ref().map(|chosen| format!("of {}", chosen.node.sentence_label()));
        let parts: Vec<String> = chosen.into_iter().chain(self.range_parts(None)).collect();
        format!("{}{}", parts.join(" "), self.rest_text())
    }

    /// Selection and range; `end` overrides the end. `in this capture` for the whole capture.
    pub fn range_text(&self, end: Option<&str>) -> String {
        let parts = self.range_parts(end);
        if parts.is_empty() { "in this capture".to_owned() } else { parts.join(" ") }
    }

    /// `; 3 findings not selected`; a range of time alone already states the limits.
    pub fn rest_text(&self) -> String {
        if self.unselected == 0 || !(self.has_filter || self.has_nodes) {
            return String::new();
        }
        format!("; {} not selected", count_noun(self.unselected, "finding"))
    }

    fn range_parts(&self, end: Option<&str>) -> Vec<String> {
        let mut parts = Vec::new();
        if self.has_nodes {
            parts.push("of the nodes of --only-node".to_owned());
        }
        if self.has_filter {
            parts.push("that matches --filter".to_owned());
        }
        match (self.from.as_deref(), end.or(self.to.as_deref())) {
            (None, None) => {}
            (None, Some(end)) => parts.push(format!("up to {end}")),
            (Some(from), None) => parts.push(format!("from {from} on")),
            (Some(from), Some(end)) => parts.push(format!("from {from} to {end}")),
        }
        parts
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_verdict_names_its_selection() {
        let text = |value: &str| Some(value.to_owned());
        let all = FaultScope { unselected: 2, ..FaultScope::default() };
        assert_eq!(
            (all.range_text(None), all.scope_text(&WhyScope::default())),
            ("in this capture".into(), String::new())
        );
        let late = FaultScope { from: text("1.000 s"), ..all.clone() };
        assert_eq!((late.range_text(None), late.rest_text()), ("from 1.000 s on".into(), String::new()));
        assert_eq!(late.range_text(Some("2.000 s")), "from 1.000 s to 2.000 s");
        let filtered = FaultScope { has_filter: true, has_nodes: true, to: text("frame 9"), ..all };
        assert_eq!(
            filtered.scope_text(&WhyScope::default()),
            "of the nodes of --only-node that matches --filter up to frame 9; 2 findings not selected"
        );
    }
}
