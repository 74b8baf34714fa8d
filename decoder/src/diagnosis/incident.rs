//! Incidents: findings grouped by their common cause.

use std::cmp::Reverse;
use std::collections::{BTreeMap, BTreeSet};
use std::fmt;

use crate::finding::{CaptureFindings, FindingCause, FindingGroup, Severity};
use crate::words::count_noun;

/// A finding and its consequences.
pub struct Incident<'a> {
    /// Highest severity in the incident.
    pub severity: Severity,
    /// Findings with their indentation depth, cause first.
    pub findings: Vec<IncidentFinding<'a>>,
}

/// A finding of an incident.
#[derive(Debug, Clone)]
pub struct IncidentFinding<'a> {
    /// Indentation depth: 0 for the cause.
    pub depth: usize,
    /// The group that is printed.
    pub group: &'a FindingGroup,
    /// Groups of the same fault with other subjects, in order of appearance.
    pub members: Vec<&'a FindingGroup>,
}

impl IncidentFinding<'_> {
    /// Highest severity of the group and its members.
    pub fn severity(&self) -> Severity {
        self.members.iter().fold(self.group.severity, |highest, member| highest.max(member.severity))
    }

    /// `also 1A00:01, 1A00:02; 7 times in all`; `None` without members. After eight, only their number
    /// follows.
    pub fn member_text(&self) -> Option<String> {
        let shown: Vec<_> =
            self.members.iter().take(SHOWN_MEMBERS).map(|it| it.key.about.to_string()).collect();
        let rest = self.members.len().saturating_sub(SHOWN_MEMBERS);
        let more = if rest > 0 { format!(" and {rest} more") } else { String::new() };
        let total = self.members.iter().fold(self.group.count, |total, it| total.saturating_add(it.count));
        (!shown.is_empty()).then(|| format!("also {}{more}; {total} times in all", shown.join(", ")))
    }
}

/// Maximum number of members listed with a finding.
const SHOWN_MEMBERS: usize = 8;

/// Number of printed findings of a severity: members count with their group.
pub fn printed_count<'a>(telling: impl Iterator<Item = &'a FindingGroup>, severity: Severity) -> usize {
    let all = group_incidents(telling);
    let findings = all.iter().flat_map(|incident| &incident.findings);
    findings.filter(|finding| finding.severity() == severity).count()
}

/// Groups findings by cause, most severe incident first.
pub fn group_incidents<'a>(telling: impl Iterator<Item = &'a FindingGroup>) -> Vec<Incident<'a>> {
    let all: BTreeMap<u64, &FindingGroup> = telling.map(|group| (group.id, group)).collect();
    let (by_id, members) = merge_members(all);
    let represented = members.iter().flat_map(|(id, members)| members.iter().map(|it| (it.id, *id)));
    let represented: BTreeMap<u64, u64> = represented.collect();
    let cause = |group: &FindingGroup| match group.cause {
        Some(FindingCause::Group(id)) => {
            let id = represented.get(&id).copied().unwrap_or(id);
            by_id.get(&id).copied().filter(|cause| cause.id != group.id)
        }
        _ => None,
    };
    let mut effects: BTreeMap<u64, Vec<&FindingGroup>> = BTreeMap::new();
    for group in by_id.values() {
        if let Some(cause) = cause(group) {
            effects.entry(cause.id).or_default().push(group);
        }
    }
    let mut incidents = Vec::new();
    let mut seen = BTreeSet::new();
    // Groups that are causes of each other have no root; each such cycle starts at its earliest group.
    let roots = by_id.values().filter(|group| cause(group).is_none());
    for root in roots.chain(by_id.values()) {
        let groups = collect_effects(root, &effects, &mut seen);
        let of = |(depth, group): (usize, &'a FindingGroup)| IncidentFinding {
            depth,
            group,
            members: members.get(&group.id).cloned().unwrap_or_default(),
        };
        let findings: Vec<_> = groups.into_iter().map(of).collect();
        let severity = findings.iter().map(IncidentFinding::severity).max();
        incidents.extend(severity.map(|severity| Incident { severity, findings }));
    }
    incidents.sort_by_key(|incident| {
        (Reverse(incident.severity), incident.findings.first().map(|finding| finding.group.id))
    });
    incidents
}

/// Groups that are printed, and the members of each by its id. If the first group of a fault is not printed,
/// the next one represents the others.
fn merge_members(
    all: BTreeMap<u64, &FindingGroup>,
) -> (BTreeMap<u64, &FindingGroup>, BTreeMap<u64, Vec<&FindingGroup>>) {
    let mut printed: BTreeMap<u64, &FindingGroup> = BTreeMap::new();
    let mut members: BTreeMap<u64, Vec<&FindingGroup>> = BTreeMap::new();
    // An effect of another cause is not the same fault.
    let mut first: BTreeMap<(u64, Option<u64>), u64> = BTreeMap::new();
    for (id, group) in all {
        let cause = match group.cause {
            Some(FindingCause::Group(cause)) => Some(cause),
            _ => None,
        };
        let first = *first.entry((group.member_of.unwrap_or(id), cause)).or_insert(id);
        if first == id {
            printed.insert(id, group);
        } else {
            members.entry(first).or_default().push(group);
        }
    }
    (printed, members)
}

/// A group and all its consequences that are not yet in `seen`.
fn collect_effects<'a>(
    root: &'a FindingGroup,
    effects: &BTreeMap<u64, Vec<&'a FindingGroup>>,
    seen: &mut BTreeSet<u64>,
) -> Vec<(usize, &'a FindingGroup)> {
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
        write!(f, "{} of other rules: {}", count_noun(self.count, "finding"), rules.join(", "))
    }
}

/// Covered findings by the id of the covering group.
pub fn absorbed_findings(findings: &CaptureFindings) -> BTreeMap<u64, AbsorbedFindings<'_>> {
    let mut all: BTreeMap<u64, AbsorbedFindings> = BTreeMap::new();
    for group in findings.groups.iter().filter(|group| group.is_absorbed && group.suppressed.is_none()) {
        if let Some(FindingCause::Group(id)) = group.cause {
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
    use crate::finding::{FindingSubject, GroupKey};
    use crate::frame::BusIndex;

    fn group(id: u64, severity: Severity, cause: Option<u64>) -> FindingGroup {
        FindingGroup {
            id,
            key: GroupKey { rule: 0, bus: BusIndex(0), node: None, about: FindingSubject::Whole },
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
            cause: cause.map(FindingCause::Group),
            is_absorbed: false,
            member_of: None,
            scene: None,
            downgraded: None,
            suppressed: None,
            is_open: false,
            nodes: Vec::new(),
        }
    }

    fn reading(groups: Vec<FindingGroup>) -> Vec<Vec<(usize, u64)>> {
        let findings = CaptureFindings { groups, ..CaptureFindings::default() };
        let all = group_incidents(findings.reported_groups());
        all.iter()
            .map(|incident| incident.findings.iter().map(|it| (it.depth, it.group.id)).collect())
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
