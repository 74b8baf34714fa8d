//! Findings within a selection.

use std::collections::BTreeSet;

use cobscope_decoder::capture::BusNames;
use cobscope_decoder::event::{Event, EventKind};
use cobscope_decoder::finding::{FindingCause, FindingGroup};
use cobscope_decoder::frame::{Frame, Timestamp};
use cobscope_decoder::reading::{FrameDemand, ReadingPart};
use cobscope_decoder::session::{Bus, MessagePreview};

use crate::select::{Selection, Span};

/// Findings that pass the filter and concern a selected node.
pub struct SelectedFindings {
    selection: Selection,
    numbers: BTreeSet<u64>,
}

impl SelectedFindings {
    /// No finding yet.
    pub fn new(selection: Selection) -> Self {
        Self { selection, numbers: BTreeSet::new() }
    }

    /// Prepares the selection for a capture; see [`Selection::begin_capture`].
    ///
    /// # Errors
    /// If a bound is not possible for this capture.
    pub fn begin(&mut self, first: &Frame, span: Span<'_>) -> anyhow::Result<()> {
        self.selection.begin_capture(first, span)
    }

    /// Message for a range after the end of the capture; see [`Selection::missed_text`].
    pub fn missed(&self, frame: u64, last: Option<Timestamp>) -> Option<String> {
        self.selection.missed_text(frame, last)
    }

    /// Numbers of the findings with a part in the range. A finding that covers one of them is selected.
    pub fn numbers(mut self, groups: &[FindingGroup]) -> BTreeSet<u64> {
        let mut all = BTreeSet::new();
        for group in groups {
            let is_match = !self.selection.has_filter() || self.numbers.contains(&group.id);
            // Called for all, because it also detects a range after the end.
            if !self.selection.overlaps_finding(group) || !is_match {
                continue;
            }
            all.insert(group.id);
            if let (true, Some(FindingCause::Group(cause))) = (group.is_absorbed, &group.cause) {
                all.insert(*cause);
            }
        }
        all
    }
}

impl ReadingPart for SelectedFindings {
    fn event(&mut self, _event: &Event, _bus: &Bus) {}

    fn finding(&mut self, event: &Event, bus: &Bus) {
        if let EventKind::FindingOpened(news) | EventKind::FindingClosed(news) = &event.kind
            && self.selection.admits_content(event, bus)
        {
            self.numbers.insert(news.id);
        }
    }

    fn need(&self, _preview: &MessagePreview, _bus: &Bus) -> bool {
        false
    }

    fn demand(&self) -> FrameDemand {
        FrameDemand::Batches
    }

    /// Detects a range after the end.
    fn frame(&mut self, frame: &Frame, _names: &BusNames) {
        self.selection.admits_frame(frame);
    }
}
