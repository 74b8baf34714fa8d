//! Findings selected by the current filter.
//!
//! ```text
//! node == 5      findings have a node: the findings of node 5
//! kind == emcy   findings have no such field: the findings in frames of matching events
//! ```

use std::collections::BTreeSet;

use cobscope_decoder::event::{Event, EventKind, FindingNews, FrameRange, Kind};
use cobscope_decoder::finding::{CaptureFindings, FindingGroup, Occurrence};
use cobscope_decoder::frame::BusIndex;
use cobscope_decoder::query::Filter;
use cobscope_decoder::replay::ReplayState;
use cobscope_decoder::wire::NodeId;
use cobscope_decoder::words::count_noun;

use crate::panes::common::last_world;
use crate::state::UiState;
use crate::timeline::{FindingOccurrence, SearchMatches, SurveyResults};

/// Inputs of the selection; it is repeated if one of them changes.
#[derive(Debug, Clone, PartialEq, Eq)]
pub(super) struct FilterKey {
    text: String,
    only_news: bool,
    buses: usize,
    /// For a selection by frames: number of matching events, and whether the search is complete.
    shown: Option<(u64, bool)>,
}

impl FilterKey {
    pub(super) fn new(core: &UiState) -> Option<Self> {
        let filter = core.matcher.filter.as_ref()?;
        let matches = if is_of_findings(filter) { None } else { core.timeline.search_matches() };
        let shown = matches.map(|matches| (matches.match_count(), matches.is_complete()));
        let buses = last_world(core).map_or(0, |world| world.buses().len());
        Some(Self { text: core.filter.clone(), only_news: core.matcher.only_news, buses, shown })
    }
}

/// Whether the filter can match finding events.
fn is_of_findings(filter: &Filter) -> bool {
    filter.kinds().contains_kind(Kind::FindingOpened)
}

/// The selected findings.
#[derive(Debug, Clone)]
pub(super) struct ChosenFindings {
    ids: BTreeSet<u64>,
    /// Number of findings without the filter.
    all: usize,
    /// Description of the selection, with the filter.
    how: String,
}

impl ChosenFindings {
    /// Applies the current filter; None without a filter.
    pub(super) fn new(core: &UiState, survey: &SurveyResults) -> Option<Self> {
        let filter = core.matcher.filter.as_ref()?;
        let all = all_findings(survey);
        let (ids, how) = if is_of_findings(filter) {
            let world = last_world(core)?;
            (FindingFilter { filter, world: &world }.selected_ids(survey), "match")
        } else {
            let shown = core.timeline.search_matches()?;
            let how =
                if shown.is_complete() { "in frames that match" } else { "so far in frames that match" };
            (in_frames(survey, &shown), how)
        };
        let how = format!("{how} {}", core.filter);
        Some(Self { ids: ids.intersection(&all).copied().collect(), all: all.len(), how })
    }

    /// Whether a finding is selected.
    pub(super) fn is_selected(&self, id: u64) -> bool {
        self.ids.contains(&id)
    }

    /// Whether there are no findings at all.
    pub(super) fn is_of_none(&self) -> bool {
        self.all == 0
    }

    /// `2 of 4 findings match node == 5; c shows all`
    pub(super) fn selection_text(&self) -> String {
        format!("{} of {} {}; c shows all", self.ids.len(), count_noun(self.all, "finding"), self.how)
    }
}

/// Kept occurrences of findings inside the current filter; None without a filter.
pub fn filtered_places(core: &UiState, survey: &SurveyResults) -> Option<Vec<FindingOccurrence>> {
    let filter = core.matcher.filter.as_ref()?;
    let result = ChosenFindings::new(core, survey)?;
    let shown = if is_of_findings(filter) { None } else { core.timeline.search_matches() };
    let is_shown = |frame| shown.as_ref().is_none_or(|shown| shown.has_frame(frame));
    let places = survey.places.iter().filter(|place| result.is_selected(place.id) && is_shown(place.frame));
    Some(places.copied().collect())
}

fn all_findings(survey: &SurveyResults) -> BTreeSet<u64> {
    match &survey.findings {
        Some(findings) => {
            let groups =
                findings.groups.iter().filter(|group| group.is_reported() || group.suppressed.is_some());
            groups.map(|group| group.id).collect()
        }
        None => survey.overview.opened.iter().map(|opened| opened.news.id).collect(),
    }
}

/// Findings in frames of matching events: where they opened, and their kept occurrences.
fn in_frames(survey: &SurveyResults, shown: &SearchMatches) -> BTreeSet<u64> {
    let opened = survey.overview.opened.iter().map(|opened| (opened.news.id, opened.spot.frame));
    let groups = survey.findings.iter().flat_map(|findings| &findings.groups);
    let seen = groups.flat_map(|group| all_occurrences(group).map(|seen| (group.id, seen.frames.last)));
    opened.chain(seen).filter(|(_, frame)| shown.has_frame(*frame)).map(|(id, _)| id).collect()
}

fn all_occurrences(group: &FindingGroup) -> impl Iterator<Item = Occurrence> {
    group.first.iter().chain(&group.last).copied()
}

/// Applies the filter to the events of findings.
struct FindingFilter<'a> {
    filter: &'a Filter,
    world: &'a ReplayState,
}

impl FindingFilter<'_> {
    fn selected_ids(&self, survey: &SurveyResults) -> BTreeSet<u64> {
        if let Some(findings) = &survey.findings {
            let groups = findings.groups.iter().filter(|group| self.takes_group(findings, group));
            return groups.map(|group| group.id).collect();
        }
        let opened = survey.overview.opened.iter().filter(|opened| {
            let at = Occurrence { time: opened.time, frames: FrameRange::one(opened.spot.frame) };
            self.matches_finding((opened.bus, opened.node), at, &opened.news)
        });
        opened.map(|opened| opened.news.id).collect()
    }

    /// Filters by time or frame match if any kept occurrence matches.
    fn takes_group(&self, findings: &CaptureFindings, group: &FindingGroup) -> bool {
        let Some(rule) = findings.rules.get(usize::from(group.key.rule)) else { return false };
        let news = group.opening_news(rule);
        all_occurrences(group).any(|at| self.matches_finding((group.key.bus, group.key.node), at, &news))
    }

    fn matches_finding(
        &self,
        (bus, node): (BusIndex, Option<NodeId>),
        at: Occurrence,
        news: &FindingNews,
    ) -> bool {
        let Some(reported) = self.world.buses().get(usize::from(bus.0)) else { return false };
        let mut event = Event::new(bus, at.frames, EventKind::FindingOpened(Box::new(news.clone())));
        (event.time, event.node) = (at.time, node);
        self.filter.matches_event(&event, reported, None)
    }
}
