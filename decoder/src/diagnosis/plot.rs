//! Findings of one story.

use std::sync::Arc;

use super::incident::{Incident, IncidentFinding};
use crate::finding::{FactCause, FindingCause, FindingGroup, Severity};
use crate::frame::BusIndex;
use crate::wire::NodeId;

/// Findings of one story: an incident, or all incidents with the same fact as their cause.
pub(super) struct StoryPlot<'a> {
    /// Fact that is the cause; else the first finding is the cause.
    pub(super) fact: Option<Arc<FactCause>>,
    pub(super) findings: Vec<IncidentFinding<'a>>,
}

impl<'a> StoryPlot<'a> {
    /// All findings, each followed by those printed with it.
    pub(super) fn groups(&self) -> impl Iterator<Item = &'a FindingGroup> {
        self.findings.iter().flat_map(|it| [it.group].into_iter().chain(it.members.iter().copied()))
    }

    /// Nodes that the findings concern, in ascending order.
    pub(super) fn nodes(&self) -> Vec<(BusIndex, NodeId)> {
        let of_nodes = self.findings.iter().flat_map(|it| {
            it.group.nodes.iter().chain(&it.group.key.node).map(|node| (it.group.key.bus, *node))
        });
        let mut nodes: Vec<_> = of_nodes.collect();
        nodes.sort_unstable();
        nodes.dedup();
        nodes
    }

    /// Highest severity of the findings.
    pub(super) fn severity(&self) -> Severity {
        let all = self.findings.iter().map(IncidentFinding::severity);
        all.max().unwrap_or(Severity::Note)
    }

    /// The finding that is the cause, or the first effect of a fact.
    pub(super) fn root_finding(&self) -> Option<&FindingGroup> {
        self.findings.first().map(|finding| finding.group)
    }
}

/// Joins incidents with the same fact as their cause.
pub(super) fn join_incidents(incidents: Vec<Incident<'_>>) -> Vec<StoryPlot<'_>> {
    let mut plots: Vec<StoryPlot<'_>> = Vec::new();
    for incident in incidents {
        let fact = match incident.findings.first().and_then(|it| it.group.cause.as_ref()) {
            Some(FindingCause::Fact(fact)) => Some(Arc::clone(fact)),
            _ => None,
        };
        let known = plots.iter_mut().find(|plot| fact.is_some() && plot.fact == fact);
        match known {
            Some(plot) => plot.findings.extend(incident.findings),
            None => plots.push(StoryPlot { fact, findings: incident.findings }),
        }
    }
    plots
}
