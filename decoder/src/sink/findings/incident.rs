//! Incidents: findings grouped by their common cause.

use std::cmp::Reverse;
use std::collections::{BTreeMap, BTreeSet};
use std::fmt;

use crate::finding::{Cause, Findings, Group, Severity};
use crate::words::plural;

/// A finding and its consequences.
pub struct Incident<'a> {
    /// Highest severity in the incident.
    pub severity: Severity,
    /// Groups with their indentation depth, cause first.
    pub groups: Vec<(usize, &'a Group)>,
}

/// Groups findings by cause, most severe incident first.
pub fn incidents<'a>(telling: impl Iterator<Item = &'a Group>) -> Vec<Incident<'a>> {
    let by_id: BTreeMap<u64, &Group> = telling.map(|group| (group.id, group)).collect();
    let mut effects: BTreeMap<u64, Vec<&Group>> = BTreeMap::new();
    for group in by_id.values() {
        if let Some(cause) = cause(group, &by_id) {
            effects.entry(cause.id).or_default().push(group);
        }
    }
    let mut incidents = Vec::new();
    let mut seen = BTreeSet::new();
    // Groups that are causes of each other have no root; each such cycle starts at its earliest group.
    let roots = by_id.values().filter(|group| cause(group, &by_id).is_none());
    for root in roots.chain(by_id.values()) {
        let groups = below(root, &effects, &mut seen);
        let severity = groups.iter().map(|(_, group)| group.severity).max();
        incidents.extend(severity.map(|severity| Incident { severity, groups }));
    }
    incidents.sort_by_key(|incident| {
        (Reverse(incident.severity), incident.groups.first().map(|(_, group)| group.id))
    });
    incidents
}

fn cause<'a>(group: &Group, by_id: &BTreeMap<u64, &'a Group>) -> Option<&'a Group> {
    match group.cause {
        Some(Cause::Group(id)) => by_id.get(&id).copied(),
        _ => None,
    }
}

/// A group and all its consequences that are not yet in `seen`.
fn below<'a>(
    root: &'a Group,
    effects: &BTreeMap<u64, Vec<&'a Group>>,
    seen: &mut BTreeSet<u64>,
) -> Vec<(usize, &'a Group)> {
    let mut found = Vec::new();
    let mut waiting = vec![(0, root)];
    while let Some((depth, group)) = waiting.pop() {
        if !seen.insert(group.id) {
            continue;
        }
        found.push((depth, group));
        let next = effects.get(&group.id).into_iter().flatten().rev();
        waiting.extend(next.map(|effect| (depth + 1, *effect)));
    }
    found
}

/// Findings that another group also covers, because it is their cause and describes the same defect.
#[derive(Debug, Default)]
pub struct AbsorbedFindings<'a> {
    /// Number of findings covered.
    pub count: usize,
    /// Rules of the findings covered.
    pub rules: BTreeSet<&'a str>,
}

impl fmt::Display for AbsorbedFindings<'_> {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let rules: Vec<_> = self.rules.iter().copied().collect();
        write!(f, "{} of other rules: {}", plural(self.count, "finding"), rules.join(", "))
    }
}

/// Covered findings by the id of the covering group.
pub fn absorbed(findings: &Findings) -> BTreeMap<u64, AbsorbedFindings<'_>> {
    let mut all: BTreeMap<u64, AbsorbedFindings> = BTreeMap::new();
    for group in findings.groups.iter().filter(|group| group.is_absorbed && group.suppressed.is_none()) {
        if let Some(Cause::Group(id)) = group.cause {
            let absorbed = all.entry(id).or_default();
            absorbed.count += 1;
            absorbed.rules.insert(&group.rule);
        }
    }
    all
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::finding::{About, Key};
    use crate::frame::BusIndex;

    fn group(id: u64, severity: Severity, cause: Option<u64>) -> Group {
        Group {
            id,
            key: Key { rule: 0, bus: BusIndex(0), node: None, about: About::Whole },
            rule: "r".into(),
            bus: "can0".into(),
            node_name: None,
            object_name: None,
            next_step: None,
            manual: None,
            severity,
            text: format!("text {id}"),
            worst: None,
            count: 1,
            lasted: None,
            lasts_to_end: false,
            first: Vec::new(),
            last: std::collections::VecDeque::new(),
            cause: cause.map(Cause::Group),
            is_absorbed: false,
            downgraded: None,
            suppressed: None,
            is_open: false,
        }
    }

    fn reading(groups: Vec<Group>) -> Vec<Vec<(usize, u64)>> {
        let findings = Findings { groups, ..Findings::default() };
        let all = incidents(findings.counting());
        all.iter()
            .map(|incident| incident.groups.iter().map(|(depth, group)| (*depth, group.id)).collect())
            .collect()
    }

    #[test]
    fn effects_follow_their_cause_and_the_worst_incident_is_first() {
        let groups = vec![
            group(1, Severity::Warning, None),
            group(2, Severity::Note, Some(4)),
            group(3, Severity::Error, Some(2)),
            group(4, Severity::Note, None),
            group(5, Severity::Note, Some(4)),
        ];
        assert_eq!(reading(groups), [vec![(0, 4), (1, 2), (2, 3), (1, 5)], vec![(0, 1)]]);
    }

    #[test]
    fn findings_that_explain_each_other_are_one_incident() {
        let groups = vec![
            group(1, Severity::Error, Some(2)),
            group(2, Severity::Error, Some(1)),
            group(3, Severity::Error, Some(9)),
        ];
        assert_eq!(reading(groups), [vec![(0, 1), (1, 2)], vec![(0, 3)]]);
    }

    #[test]
    fn an_effect_of_a_cause_that_does_not_count_counts_itself() {
        let mut cause = group(1, Severity::Error, None);
        cause.suppressed = Some("known".into());
        assert_eq!(reading(vec![cause, group(2, Severity::Note, Some(1))]), [vec![(0, 2)]]);
    }
}
