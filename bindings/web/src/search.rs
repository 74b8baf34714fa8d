//! Search for the next or previous row with a text.

use cobscope_decoder::capture::CaptureError;
use cobscope_decoder::replay::{CaptureWalk, EventPosition, PlacedEvent, ReplayRow, RowPattern};

use crate::files::ContentSource;
use crate::matcher::EventMatcher;

/// Condition that the event must fulfil.
#[derive(Clone)]
pub struct SearchQuestion {
    /// Pattern for the text of the row.
    pub pattern: RowPattern,
    /// Rows of the list.
    pub matcher: EventMatcher,
    /// Position at which the search starts.
    pub from: EventPosition,
    /// Towards the start of the capture.
    pub is_backward: bool,
}

/// A search in progress: forward to the end, or backward through the frames between two checkpoints.
pub struct SearchJob {
    walk: CaptureWalk<ContentSource>,
    question: SearchQuestion,
    /// Frames before this part.
    start: u64,
    /// Last frame of this part.
    last: u64,
    met: Option<EventPosition>,
}

/// Result of a search.
pub enum SearchResult {
    /// The row, or none in this direction.
    Row(Option<EventPosition>),
    /// None in this part; the frames up to `.1` remain.
    Further(SearchQuestion, u64),
}

impl SearchJob {
    /// Starts where `walk` is; reads up to frame `last`.
    pub fn new(walk: CaptureWalk<ContentSource>, question: SearchQuestion, last: u64) -> Self {
        let start = walk.world.frames();
        Self { walk, question, start, last, met: None }
    }

    /// Frames read so far.
    pub fn frames(&self) -> u64 {
        self.walk.world.frames()
    }

    /// Reads up to about `frames` more frames; `false` at the end.
    ///
    /// # Errors
    /// If the capture can no longer be read.
    pub fn step(&mut self, frames: u64) -> Result<bool, CaptureError> {
        let Self { walk, question, last, met, .. } = self;
        let SearchQuestion { pattern, matcher, from, is_backward } = question;
        let limit = walk.world.frames().saturating_add(frames);
        let mut see = |placed: PlacedEvent<'_>| {
            let is_beyond =
                if *is_backward { placed.spot < *from } else { placed.spot > *from && met.is_none() };
            if is_beyond
                && matcher.takes(&placed)
                && pattern.is_match(&ReplayRow::new(&placed, matcher.only_news()).row_text())
            {
                *met = Some(placed.spot);
            }
        };
        while walk.world.frames() < limit {
            if walk.world.frames() > *last || !walk.skip_batch(last.saturating_add(1), &mut see)? {
                return Ok(false);
            }
        }
        Ok(*is_backward || met.is_none())
    }

    /// The result.
    pub fn finish(self) -> SearchResult {
        let Self { question, start, met, .. } = self;
        if met.is_none() && question.is_backward && start > 0 {
            return SearchResult::Further(question, start);
        }
        SearchResult::Row(met)
    }
}
