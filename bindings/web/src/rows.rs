//! Rows of the event list, decoded when they are shown.

use std::collections::BTreeMap;

use cobscope_decoder::answers::events::{EventDetail, EventRow};
use cobscope_decoder::capture::CaptureError;
use cobscope_decoder::finding::{CaptureFindings, Severity};
use cobscope_decoder::frame::Timestamp;
use cobscope_decoder::replay::{CaptureWalk, EventPosition, PlacedEvent, ReplayRow};

use crate::capture::CaptureSet;
use crate::counts::BlockRowCounts;
use crate::files::ContentSource;
use crate::matcher::EventMatcher;
use crate::seek::RecentCheckpoints;
use crate::survey::CaptureSurvey;

/// Maximum number of rows per request.
pub const MOST_ROWS: u64 = 500;

/// Severest finding of each frame with a kept occurrence.
#[derive(Default)]
pub struct FindingMarks(BTreeMap<u64, Severity>);

impl FindingMarks {
    /// Marks of all findings.
    pub fn marks_of(findings: &CaptureFindings) -> Self {
        let mut marks = BTreeMap::new();
        for group in findings.reported_groups() {
            for occurrence in group.first.iter().chain(&group.last) {
                let mark = marks.entry(occurrence.frames.last).or_insert(group.severity);
                *mark = group.severity.max(*mark);
            }
        }
        Self(marks)
    }

    /// Row number `place` of a list.
    pub fn event_row(&self, row: &ReplayRow, place: u64, zero: Option<Timestamp>) -> EventRow {
        EventRow::new(row, place, self.0.get(&row.event.frames.last).copied(), zero)
    }
}

/// A list of rows with the means to decode them.
pub struct RowList<'a> {
    /// The captures.
    pub captures: &'a CaptureSet,
    /// Results of the first reading.
    pub survey: &'a CaptureSurvey,
    /// Frames with findings.
    pub marks: &'a FindingMarks,
    /// Rows per block of frames.
    pub counts: &'a BlockRowCounts,
    /// Selection of the events.
    pub matcher: &'a EventMatcher,
    /// All rows, if they are kept.
    pub kept: Option<&'a [EventRow]>,
}

impl RowList<'_> {
    /// Rows `from` to `from + count`.
    ///
    /// # Errors
    /// If the capture can no longer be read.
    pub fn rows(
        &self,
        seek: &mut RecentCheckpoints,
        from: u64,
        count: u64,
    ) -> Result<Vec<EventRow>, CaptureError> {
        let end = from.saturating_add(count.min(MOST_ROWS)).min(self.counts.total());
        if let Some(kept) = self.kept {
            let place = |row: u64| usize::try_from(row).unwrap_or(usize::MAX);
            return Ok(kept.get(place(from)..place(end)).unwrap_or_default().to_vec());
        }
        let (start, mut place) = self.counts.block_of_row(from);
        let mut rows = Vec::new();
        if from >= end {
            return Ok(rows);
        }
        let mut walk = seek.walk_before(self.captures, self.survey, start)?;
        let zero = self.survey.zero();
        while place < end {
            let mut see = |placed: PlacedEvent<'_>| {
                if placed.spot.frame >= start && self.matcher.takes(&placed) {
                    if (from..end).contains(&place) {
                        let row = ReplayRow::new(&placed, self.matcher.only_news());
                        rows.push(self.marks.event_row(&row, place, zero));
                    }
                    place = place.saturating_add(1);
                }
            };
            if !seek.step_frame(&mut walk, &mut see)? {
                break;
            }
        }
        Ok(rows)
    }

    /// Index of the first row at or after a position.
    ///
    /// # Errors
    /// If the capture can no longer be read.
    pub fn locate_row(&self, seek: &mut RecentCheckpoints, at: EventPosition) -> Result<u64, CaptureError> {
        let (start, mut place) = self.counts.block_of_frame(at.frame);
        let mut walk = seek.walk_before(self.captures, self.survey, start)?;
        let mut is_met = false;
        while !is_met && place < self.counts.total() {
            let mut see = |placed: PlacedEvent<'_>| {
                if is_met || placed.spot.frame < start || !self.matcher.takes(&placed) {
                    return;
                }
                is_met = placed.spot >= at;
                place = place.saturating_add(u64::from(!is_met));
            };
            if !seek.step_frame(&mut walk, &mut see)? {
                break;
            }
        }
        Ok(place.min(self.counts.total().saturating_sub(1)))
    }
}

/// The event at a position as `decode -f jsonl` prints it, with its payload; `walk` is before its frame.
///
/// # Errors
/// If the capture can no longer be read.
pub fn event_detail(
    mut walk: CaptureWalk<ContentSource>,
    at: EventPosition,
    zero: Option<Timestamp>,
) -> Result<Option<EventDetail>, CaptureError> {
    let mut found = None;
    while found.is_none() && walk.world.frames() <= at.frame {
        let mut see = |placed: PlacedEvent<'_>| {
            if placed.spot == at {
                found = Some(EventDetail::new(&placed, zero));
            }
        };
        if !walk.step_item(&mut see)? {
            break;
        }
    }
    Ok(found)
}
