//! The first reading of a capture: rules, stories, statistics, checkpoints.
//!
//! ```text
//! captures ─Walk─▶ events ─┬─▶ rules ─▶ findings      ┐
//!                          ├─▶ why, statistics, load  ├─▶ Survey
//!                          ├─▶ rows per block         │
//!                          └─▶ checkpoints            ┘
//! ```

use std::sync::Arc;

use cobscope_decoder::diagnosis::Setting;
use cobscope_decoder::event::{Event, EventKind};
use cobscope_decoder::finding::Findings;
use cobscope_decoder::frame::Timestamp;
use cobscope_decoder::profile::Catalogue;
use cobscope_decoder::reading::{self, PlacedReading, PlacedSummary, ReadingPart, Survey};
use cobscope_decoder::replay::{Checkpoint, EventPosition, Index, PlacedEvent, ReplayState, Walk};
use cobscope_decoder::rules::Setup;
use cobscope_decoder::session::Bus;
use cobscope_decoder::why::{self, Question, Why};

use crate::counts::RowCounts;
use crate::files::Source;

/// Frames between the first checkpoints; doubled whenever there are too many.
const FIRST_INTERVAL: u64 = 65_536;

/// Results of the first reading.
pub struct CaptureSurvey {
    /// Findings in groups.
    pub findings: Findings,
    /// Changes before the stories.
    pub why: Why,
    /// Stories with the changes before them.
    pub answer: why::Report,
    /// Transfers, errors, load, kinds of events, statistics.
    pub overview: Survey,
    /// Rows of all events.
    pub all: RowCounts,
    /// Rows of events that are changes.
    pub news: RowCounts,
    /// Checkpoints.
    pub index: Index,
    /// State after the last frame.
    pub end: ReplayState,
    /// Reason why the capture was not read to its end.
    pub failure: Option<String>,
}

/// A first reading in progress.
pub struct Surveying {
    reading: PlacedReading<Source, (Survey, Why, RowTally)>,
    index: Index,
    failure: Option<String>,
}

/// Counts rows, and findings as they open.
#[derive(Default)]
struct RowTally {
    all: RowCounts,
    news: RowCounts,
    opened: u64,
}

impl ReadingPart for RowTally {
    fn event(&mut self, _event: &Event, _bus: &Bus) {}

    fn placed(&mut self, placed: &PlacedEvent<'_>) {
        self.all.add(placed.spot.frame);
        if placed.is_news {
            self.news.add(placed.spot.frame);
        }
    }

    fn finding(&mut self, event: &Event, _bus: &Bus) {
        self.opened += u64::from(matches!(event.kind, EventKind::FindingOpened(_)));
    }
}

impl Surveying {
    /// Starts at the beginning of the captures.
    pub fn new(walk: Walk<Source>, setup: &Arc<Setup>) -> Self {
        let parts = (Survey::default(), Why::new(Question::default()), RowTally::default());
        let reading = PlacedReading::new(walk, setup, parts);
        Self { reading, index: Index::every(FIRST_INTERVAL), failure: None }
    }

    /// Frames read so far, decompressed bytes, and findings opened.
    pub fn progress(&self) -> (u64, u64, u64) {
        let (walk, (_, _, rows)) = (&self.reading.walk, self.reading.part());
        (walk.world.frames(), walk.offset(), rows.opened)
    }

    /// Reads up to `frames` more frames; `false` at the end.
    pub fn step(&mut self, frames: u64) -> bool {
        let Self { reading, index, failure } = self;
        let limit = reading.walk.world.frames().saturating_add(frames);
        while reading.walk.world.frames() < limit {
            if index.is_due(reading.walk.world.frames())
                && let Some(mark) = reading.walk.mark()
            {
                index.add(mark);
            }
            let has_more = reading.step();
            if let Some(error) = reading.take_failure() {
                failure.get_or_insert(error.to_string()).truncate(1_000);
            }
            if !has_more {
                return false;
            }
        }
        true
    }

    /// The results.
    pub fn finish(self, catalogue: &Catalogue) -> CaptureSurvey {
        let Self { reading, index, failure } = self;
        let PlacedSummary { findings, part: (overview, why, rows), end } = reading.finish();
        let setting = Setting { zero: end.zero(), ..Setting::default() };
        let diagnosis = reading::diagnosis(&findings, setting);
        let answer = why.clone().report(diagnosis, end.buses(), catalogue);
        let RowTally { all, news, .. } = rows;
        CaptureSurvey { findings, why, answer, overview, all, news, index, end, failure }
    }
}

impl CaptureSurvey {
    /// Time of the first frame.
    pub fn zero(&self) -> Option<Timestamp> {
        self.end.zero()
    }

    /// The next error event after a position, or the previous one before it.
    pub fn error(&self, from: EventPosition, is_backward: bool) -> Option<EventPosition> {
        let errors = &self.overview.errors;
        let at = errors.partition_point(|spot| if is_backward { *spot < from } else { *spot <= from });
        let at = if is_backward { at.checked_sub(1)? } else { at };
        errors.get(at).copied()
    }

    /// The last checkpoint at or before a frame.
    pub fn mark(&self, frame: u64) -> Option<&Checkpoint> {
        self.index.before_frame(frame)
    }
}
