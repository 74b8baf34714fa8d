//! Search for the events of a filter in the whole capture.

use cobscope_decoder::answers::events::EventRow;
use cobscope_decoder::capture::CaptureError;
use cobscope_decoder::frame::Timestamp;
use cobscope_decoder::replay::{CaptureWalk, PlacedEvent, ReplayRow};

use crate::counts::BlockRowCounts;
use crate::files::ContentSource;
use crate::matcher::EventMatcher;
use crate::rows::FindingMarks;

/// Maximum number of rows kept; with more matches they are decoded when they are shown.
const MOST_KEPT: usize = 5_000;

/// Events of a filter.
pub struct FilteredEvents {
    /// The filter.
    pub matcher: EventMatcher,
    /// Rows per block of frames.
    pub counts: BlockRowCounts,
    /// All rows; `None` if there are too many.
    pub kept: Option<Vec<EventRow>>,
}

/// A search for the events of a filter.
pub struct FilterJob {
    walk: CaptureWalk<ContentSource>,
    result: FilteredEvents,
}

impl FilterJob {
    /// Starts at the beginning.
    pub fn new(walk: CaptureWalk<ContentSource>, matcher: EventMatcher) -> Self {
        let result = FilteredEvents { matcher, counts: BlockRowCounts::default(), kept: Some(Vec::new()) };
        Self { walk, result }
    }

    /// Frames searched so far.
    pub fn frames(&self) -> u64 {
        self.walk.world.frames()
    }

    /// Searches up to `frames` more frames; `false` at the end.
    ///
    /// # Errors
    /// If the capture can no longer be read; a capture that ends early causes no error at the same place.
    pub fn step(
        &mut self,
        frames: u64,
        marks: &FindingMarks,
        zero: Option<Timestamp>,
    ) -> Result<bool, CaptureError> {
        let Self { walk, result } = self;
        let limit = walk.world.frames().saturating_add(frames);
        let mut see = |placed: PlacedEvent<'_>| {
            if result.matcher.takes(&placed) {
                let place = result.counts.total();
                result.counts.count_row(placed.spot.frame);
                if let Some(kept) = &mut result.kept {
                    let row = ReplayRow::new(&placed, result.matcher.only_news());
                    kept.push(marks.event_row(&row, place, zero));
                }
                result.kept.take_if(|kept| kept.len() > MOST_KEPT);
            }
        };
        while walk.world.frames() < limit {
            if !walk.skip_batch(limit, &mut see)? {
                return Ok(false);
            }
        }
        Ok(true)
    }

    /// The result.
    pub fn finish(self) -> FilteredEvents {
        self.result
    }
}
