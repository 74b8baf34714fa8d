//! The first reading of a capture: rules, stories, statistics, checkpoints.
//!
//! ```text
//! captures ─Walk─▶ events ─┬─▶ rules ─▶ findings      ┐
//!                          ├─▶ why, statistics, load  ├─▶ Survey
//!                          ├─▶ rows per block         │
//!                          └─▶ checkpoints            ┘
//! ```

use std::sync::Arc;

use cobscope_decoder::diagnosis::DiagnosisContext;
use cobscope_decoder::event::{Event, EventKind};
use cobscope_decoder::finding::CaptureFindings;
use cobscope_decoder::frame::Timestamp;
use cobscope_decoder::profile::Catalogue;
use cobscope_decoder::reading::{self, PlacedReading, PlacedSummary, ReadingPart, Survey};
use cobscope_decoder::replay::{
    CaptureWalk, Checkpoint, CheckpointIndex, EventPosition, PlacedEvent, ReplayState,
};
use cobscope_decoder::rules::RuleSetup;
use cobscope_decoder::session::Bus;
use cobscope_decoder::why::{self, WhyObserver, WhyScope};

use crate::counts::BlockRowCounts;
use crate::files::ContentSource;

/// Frames between the first checkpoints; doubled whenever there are too many.
const FIRST_INTERVAL: u64 = 65_536;

/// Results of the first reading.
pub struct CaptureSurvey {
    /// Findings in groups.
    pub findings: CaptureFindings,
    /// Changes before the stories.
    pub why: WhyObserver,
    /// Stories with the changes before them.
    pub answer: why::WhyReport,
    /// Transfers, errors, load, kinds of events, statistics.
    pub overview: Survey,
    /// Rows of all events.
    pub all: BlockRowCounts,
    /// Rows of events that are changes.
    pub news: BlockRowCounts,
    /// Checkpoints.
    pub index: CheckpointIndex,
    /// State after the last frame.
    pub end: ReplayState,
    /// Reason why the capture was not read to its end.
    pub failure: Option<String>,
}

/// A first reading in progress.
pub struct SurveyJob {
    reading: PlacedReading<ContentSource, (Survey, WhyObserver, RowTally)>,
    index: CheckpointIndex,
    failure: Option<String>,
}

/// Counts rows, and findings as they open.
#[derive(Default)]
struct RowTally {
    all: BlockRowCounts,
    news: BlockRowCounts,
    opened: u64,
}

impl ReadingPart for RowTally {
    fn event(&mut self, _event: &Event, _bus: &Bus) {}

    fn placed(&mut self, placed: &PlacedEvent<'_>) {
        self.all.count_row(placed.spot.frame);
        if placed.is_news {
            self.news.count_row(placed.spot.frame);
        }
    }

    fn finding(&mut self, event: &Event, _bus: &Bus) {
        self.opened += u64::from(matches!(event.kind, EventKind::FindingOpened(_)));
    }
}

impl SurveyJob {
    /// Starts at the beginning of the captures.
    pub fn new(walk: CaptureWalk<ContentSource>, setup: &Arc<RuleSetup>) -> Self {
        let parts = (Survey::default(), WhyObserver::new(WhyScope::default()), RowTally::default());
        let reading = PlacedReading::new(walk, setup, parts);
        Self { reading, index: CheckpointIndex::with_interval(FIRST_INTERVAL), failure: None }
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
                && let Some(mark) = reading.walk.mark_position()
            {
                index.add_checkpoint(mark);
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
        let setting = DiagnosisContext { zero: end.first_time(), ..DiagnosisContext::default() };
        let diagnosis = reading::diagnosis(&findings, setting);
        let answer = why.clone().build_report(diagnosis, end.buses(), catalogue);
        let RowTally { all, news, .. } = rows;
        CaptureSurvey { findings, why, answer, overview, all, news, index, end, failure }
    }
}

impl CaptureSurvey {
    /// Time of the first frame.
    pub fn zero(&self) -> Option<Timestamp> {
        self.end.first_time()
    }

    /// The next error event after a position, or the previous one before it.
    pub fn find_error(&self, from: EventPosition, is_backward: bool) -> Option<EventPosition> {
        let errors = &self.overview.errors;
        let at = errors.partition_point(|spot| if is_backward { *spot < from } else { *spot <= from });
        let at = if is_backward { at.checked_sub(1)? } else { at };
        errors.get(at).copied()
    }

    /// The last checkpoint at or before a frame.
    pub fn checkpoint_at(&self, frame: u64) -> Option<&Checkpoint> {
        self.index.before_frame(frame)
    }
}
