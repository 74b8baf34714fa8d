//! Marks of the plot: findings and changes of the NMT state of the plotted nodes.
//!
//! ```text
//! find     N         E wwwwwwww
//! ```

use cobscope_decoder::finding::{Group, Severity};
use cobscope_decoder::frame::BusIndex;
use cobscope_decoder::wire::NodeId;

use super::Signals;
use crate::state::Core;
use crate::theme::Role;
use crate::timeline::SurveyResults;
use crate::widgets::plot::Mark;

const ERROR: &str = "E";
const WARNING: &str = "w";
const NMT: &str = "N";

/// Buses of the plotted signals with their nodes.
type Nodes = Vec<(BusIndex, Option<NodeId>)>;

impl Signals {
    /// Marks of the plotted nodes and their buses; later ones cover earlier ones. A begin covers a duration, an
    /// error covers an NMT change, and this a warning.
    pub(super) fn marks(&self, core: &Core, last: i64) -> Vec<Mark> {
        let nodes = self.nodes(core);
        let survey = core.timeline.survey();
        let warnings = of_severity(&survey, Severity::Warning, &nodes, last);
        let errors = of_severity(&survey, Severity::Error, &nodes, last);
        let begin = |mark: &Mark| Mark { to: mark.from, ..*mark };
        let begins = |marks: &[Mark]| marks.iter().map(begin).collect::<Vec<_>>();
        let (of_warnings, of_errors) = (begins(&warnings), begins(&errors));
        let lasting = warnings.into_iter().chain(errors);
        lasting.chain(of_warnings).chain(nmt_changes(&survey, &nodes)).chain(of_errors).collect()
    }

    fn nodes(&self, core: &Core) -> Nodes {
        let end = core.timeline.end();
        let worlds: Vec<_> = end.as_deref().into_iter().chain(core.world()).collect();
        let node = |bus, id| {
            let mut rows = worlds.iter().flat_map(|world| world.identifiers().rows());
            rows.find(|row| row.bus == bus && row.id == id && row.node.is_some())?.node
        };
        let keys = self.picked.iter().map(|picked| (picked.key.bus, picked.key.id));
        keys.map(|(bus, id)| (bus, node(bus, id))).collect()
    }
}

/// Whether a finding concerns a plotted node or its whole bus.
fn concerns(nodes: &Nodes, bus: BusIndex, node: Option<NodeId>) -> bool {
    nodes.iter().any(|(of, plotted)| *of == bus && (node.is_none() || node == *plotted))
}

fn of_severity(survey: &SurveyResults, severity: Severity, nodes: &Nodes, last: i64) -> Vec<Mark> {
    let Some(findings) = &survey.findings else {
        // Until the rules are done, only the begin of a finding is known.
        let opened =
            survey.overview.opened.iter().filter(|opened| {
                opened.news.severity == severity && concerns(nodes, opened.bus, opened.node)
            });
        let times = opened.filter_map(|opened| opened.time);
        return times.map(|time| mark(severity, time.0, time.0)).collect();
    };
    let groups = findings
        .counting()
        .filter(|group| group.severity == severity && concerns(nodes, group.key.bus, group.key.node));
    groups.flat_map(|group| ranges(group, last)).map(|(from, to)| mark(severity, from, to)).collect()
}

/// Times of a finding: of its condition, else of each kept occurrence.
fn ranges(group: &Group, last: i64) -> Vec<(i64, i64)> {
    let (Some(began), Some(ended)) = (group.began().time, group.ended().time) else { return Vec::new() };
    let kept: Vec<_> = group.first.iter().chain(&group.last).collect();
    if let Some(lasted) = group.lasted {
        let end = if group.lasts_to_end { last } else { began.0.saturating_add(lasted) };
        return vec![(began.0, end.max(ended.0))];
    }
    if kept.len() as u64 == group.count {
        return kept.iter().filter_map(|one| one.time).map(|time| (time.0, time.0)).collect();
    }
    vec![(began.0, ended.0)]
}

fn nmt_changes<'a>(survey: &'a SurveyResults, nodes: &'a Nodes) -> impl Iterator<Item = Mark> + 'a {
    let own = survey
        .overview
        .nmt
        .iter()
        .filter(|moment| moment.is_change && nodes.contains(&(moment.bus, moment.node)));
    own.map(|moment| Mark { from: moment.time.0, to: moment.time.0, symbol: NMT, role: Role::Note })
}

fn mark(severity: Severity, from: i64, to: i64) -> Mark {
    let (symbol, role) = match severity {
        Severity::Error => (ERROR, Role::Bad),
        _ => (WARNING, Role::Caution),
    };
    Mark { from, to, symbol, role }
}
