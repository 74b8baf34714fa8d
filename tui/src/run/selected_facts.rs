//! Facts of a capture for its stories, and findings within the selection.

use std::collections::BTreeSet;
use std::num::NonZeroUsize;

use cobscope_decoder::diagnosis::{Diagnosis, DiagnosisContext};
use cobscope_decoder::event::Event;
use cobscope_decoder::finding::CaptureFindings;
use cobscope_decoder::frame::{Frame, Timestamp};
use cobscope_decoder::reading::{self, ReadingPart};
use cobscope_decoder::session::{Bus, Buses, MessagePreview};
use cobscope_decoder::why::{FaultScope, NodeChoice, WhyObserver, WhyScope};

use super::messages::absent_value;
use super::selected_findings::SelectedFindings;
use crate::run::arguments::{InputArgs, SelectArgs};
use crate::select::{Selection, Span};
use crate::words::unknown_bus;

/// Facts of the capture, and findings within the selection.
pub struct SelectedFacts {
    why: WhyObserver,
    selection: Selection,
    /// The selection has a limit.
    is_limited: bool,
    findings: SelectedFindings,
    /// Scope of verdicts, without the range of the current capture.
    scope: FaultScope,
}

impl SelectedFacts {
    /// No facts yet.
    ///
    /// # Errors
    /// If the selection is inconsistent.
    pub fn new(question: WhyScope, select: &SelectArgs) -> anyhow::Result<Self> {
        Ok(Self {
            why: WhyObserver::new(question),
            selection: select.selection()?,
            is_limited: true,
            findings: SelectedFindings::new(select.selection()?),
            scope: FaultScope {
                has_filter: select.filter.is_some(),
                has_nodes: select.only_node.len() > 1,
                ..FaultScope::default()
            },
        })
    }

    /// Prepares the selection for a capture; see [`Selection::begin_capture`].
    ///
    /// # Errors
    /// If a bound is not possible for this capture.
    pub fn begin(&mut self, first: &Frame, span: Span<'_>) -> anyhow::Result<()> {
        self.selection.begin_capture(first, span)?;
        self.is_limited = self.selection.is_limited();
        self.findings.begin(first, span)
    }

    /// Message for a range after the end of the capture; see [`Selection::missed_text`].
    pub fn missed(&self, frame: u64, last: Option<Timestamp>) -> Option<String> {
        self.selection.missed_text(frame, last)
    }

    /// The facts, the numbers of the selected findings, and the scope of verdicts; `first` is the time of the
    /// first frame.
    pub fn results(
        self,
        findings: &CaptureFindings,
        first: Option<Timestamp>,
    ) -> (WhyObserver, BTreeSet<u64>, FaultScope) {
        let Self { why, selection, findings: selected, scope, .. } = self;
        let selected = selected.numbers(&findings.groups);
        let unselected = findings.leading_groups().filter(|group| !selected.contains(&group.id));
        let scope = FaultScope {
            from: selection.from().map(|from| from.bound_text(first)),
            to: selection.range_end().map(|to| to.bound_text(first)),
            unselected: unselected.count(),
            ..scope
        };
        (why, selected, scope)
    }
}

impl ReadingPart for SelectedFacts {
    fn event(&mut self, event: &Event, bus: &Bus) {
        let may_report = self.selection.admits_event(event, bus);
        self.why.observe_event(event, bus, may_report);
    }

    fn finding(&mut self, event: &Event, bus: &Bus) {
        self.findings.finding(event, bus);
        self.why.observe_event(event, bus, true);
    }

    #[inline]
    fn need(&self, preview: &MessagePreview, bus: &Bus) -> bool {
        self.is_limited || self.why.needs_event(preview, bus)
    }

    #[inline]
    fn skip(&mut self, preview: &MessagePreview, bus: &Bus) {
        self.why.skip_event(preview, bus);
    }
}

/// Stories and notes with a selected finding, about the chosen node.
pub fn diagnosis(
    findings: &CaptureFindings,
    selected: &BTreeSet<u64>,
    setting: DiagnosisContext,
    (question, buses): (&WhyScope, Buses<'_>),
) -> Diagnosis {
    let mut diagnosis = reading::diagnosis(findings, setting);
    diagnosis.keep_findings(|id| selected.contains(&id));
    if let Some(chosen) = &question.chosen {
        diagnosis.keep_node(|index, node| {
            let bus = buses.iter().find(|bus| bus.index() == index);
            node == chosen.node
                && chosen.bus.as_deref().is_none_or(|name| bus.is_some_and(|bus| bus.name() == name))
        });
    }
    diagnosis
}

/// Warnings for buses of `--only-node` that do not occur in a capture.
pub fn unknown_buses(capture: &str, select: &SelectArgs, buses: Buses<'_>) -> Vec<String> {
    let has: Vec<_> = buses.iter().map(Bus::name).collect();
    let named: BTreeSet<_> = select.only_node.iter().filter_map(|node| node.bus.as_deref()).collect();
    named.into_iter().filter_map(|bus| unknown_bus(capture, bus, "--only-node", &has)).collect()
}

/// Checks that the story of `--story` exists; `failure` ended reading early.
///
/// # Errors
/// If the capture has fewer stories.
pub fn ensure_story(
    capture: &str,
    story: usize,
    diagnosis: &Diagnosis,
    failure: Option<&anyhow::Error>,
) -> anyhow::Result<()> {
    let stories = diagnosis.stories.len();
    if story <= stories {
        return Ok(());
    }
    Err(absent_value(format!("{capture}: --story {story}: no such story; stories: {stories}"), failure))
}

/// The question of a command line: a node without a profile is the chosen node.
pub fn question(input: &InputArgs, select: &SelectArgs, story: Option<NonZeroUsize>) -> WhyScope {
    let chosen = input.node.iter().find(|node| node.profile.is_none());
    let only = match select.only_node.as_slice() {
        [node] => Some(node),
        _ => None,
    };
    let chosen = chosen.or(only).map(|node| NodeChoice { bus: node.bus.clone(), node: node.id });
    WhyScope { chosen, latest: false, story: story.map_or(0, usize::from) }
}
