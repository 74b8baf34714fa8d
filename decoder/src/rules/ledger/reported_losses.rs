//! Reports of the recorder that it lost frames.

use crate::event::{Event, EventKind};
use crate::finding::Occurrence;
use crate::frame::{BusIndex, Timestamp};

/// Max time between a finding and a report of lost frames, in ns.
const NEAR: u64 = 2_000_000_000;

/// Max number of reports that are kept.
const REPORTED_LOSSES: usize = 1_024;

/// Reports of the recorder that it lost frames.
#[derive(Debug, Clone, Default)]
pub(super) struct ReportedLosses(Vec<(BusIndex, Timestamp)>);

impl ReportedLosses {
    /// Registers an event that may be such a report.
    pub(super) fn note_event(&mut self, event: &Event) {
        if let (EventKind::LostFrames { .. }, Some(time)) = (&event.kind, event.time)
            && self.0.len() < REPORTED_LOSSES
        {
            self.0.push((event.bus, time));
        }
    }

    /// Whether an occurrence is near a report on its bus.
    pub(super) fn is_near(&self, bus: BusIndex, at: &Occurrence) -> bool {
        let is_close = |time: Timestamp| {
            self.0.iter().any(|(losing, loss)| *losing == bus && loss.0.abs_diff(time.0) <= NEAR)
        };
        at.time.is_some_and(is_close)
    }
}
