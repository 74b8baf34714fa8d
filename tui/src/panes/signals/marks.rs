//! Marks of the plot: findings and changes of the NMT state of the plotted nodes.
//!
//! ```text
//! find     N         E wwwwwwww
//! ```

use cobscope_decoder::finding::{FindingGroup, Severity};
use cobscope_decoder::frame::BusIndex;
use cobscope_decoder::wire::NodeId;

use super::SignalsPane;
use crate::state::UiState;
use crate::theme::TextRole;
use crate::timeline::SurveyResults;
use crate::widgets::plot::TimeMark;

const ERROR: &str = "E";
const WARNING: &str = "w";
const NMT: &str = "N";

/// Buses of the plotted signals with their nodes.
type Nodes = Vec<(BusIndex, Option<NodeId>)>;

impl SignalsPane {
    /// Marks of the plotted nodes and their buses; later ones cover earlier ones. A begin covers a duration, an
    /// error covers an NMT change, and this a warning.
    pub(super) fn plot_marks(&self, core: &UiState, last: i64) -> Vec<TimeMark> {
        let nodes = self.plotted_nodes(core);
        let survey = core.timeline.survey();
        let warnings = of_severity(&survey, Severity::Warning, &nodes, last);
        let errors = of_severity(&survey, Severity::Error, &nodes, last);
        let begin = |mark: &TimeMark| TimeMark { to: mark.from, ..*mark };
        let begins = |marks: &[TimeMark]| marks.iter().map(begin).collect::<Vec<_>>();
        let (of_warnings, of_errors) = (begins(&warnings), begins(&errors));
        let lasting = warnings.into_iter().chain(errors);
        lasting.chain(of_warnings).chain(nmt_changes(&survey, &nodes)).chain(of_errors).collect()
    }

    fn plotted_nodes(&self, core: &UiState) -> Nodes {
        let end = core.timeline.end_state();
        let worlds: Vec<_> = end.as_deref().into_iter().chain(core.bus_state()).collect();
        let node = |bus, id| {
            let mut rows = worlds.iter().flat_map(|world| world.identifiers().rows());
            rows.find(|row| row.bus == bus && row.id == id && row.node.is_some())?.node
        };
        let keys = self.picked.iter().map(|picked| (picked.key.bus, picked.key.id));
        keys.map(|(bus, id)| (bus, node(bus, id))).collect()
    }
}

/// Whether a finding concerns a plotted node or its whole bus.
fn concerns_plotted(nodes: &Nodes, bus: BusIndex, node: Option<NodeId>) -> bool {
    nodes.iter().any(|(of, plotted)| *of == bus && (node.is_none() || node == *plotted))
}

fn of_severity(survey: &SurveyResults, severity: Severity, nodes: &Nodes, last: i64) -> Vec<TimeMark> {
    let Some(findings) = &survey.findings else {
        // Until the rules are done, only the begin of a finding is known.
        let opened = survey.overview.opened.iter().filter(|opened| {
            opened.news.severity == severity && concerns_plotted(nodes, opened.bus, opened.node)
        });
        let times = opened.filter_map(|opened| opened.time);
        return times.map(|time| severity_mark(severity, time.0, time.0)).collect();
    };
    let groups = findings
        .reported_groups()
        .filter(|group| group.severity == severity && concerns_plotted(nodes, group.key.bus, group.key.node));
    groups
        .flat_map(|group| finding_ranges(group, last))
        .map(|(from, to)| severity_mark(severity, from, to))
        .collect()
}

/// Times of a finding: of its condition, else of each kept occurrence.
fn finding_ranges(group: &FindingGroup, last: i64) -> Vec<(i64, i64)> {
    let (Some(began), Some(ended)) = (group.first_occurrence().time, group.last_occurrence().time) else {
        return Vec::new();
    };
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

fn nmt_changes<'a>(survey: &'a SurveyResults, nodes: &'a Nodes) -> impl Iterator<Item = TimeMark> + 'a {
    let own = survey
        .overview
        .nmt
        .iter()
        .filter(|moment| moment.is_change && nodes.contains(&(moment.bus, moment.node)));
    own.map(|moment| TimeMark { from: moment.time.0, to: moment.time.0, symbol: NMT, role: TextRole::Note })
}

fn severity_mark(severity: Severity, from: i64, to: i64) -> TimeMark {
    let (symbol, role) = match severity {
        Severity::Error => (ERROR, TextRole::Bad),
        _ => (WARNING, TextRole::Caution),
    };
    TimeMark { from, to, symbol, role }
}
