//! Selection of the events shown, and the search for them in the whole capture.

use cobscope_decoder::capture::CaptureError;
use cobscope_decoder::frame::Timestamp;
use cobscope_decoder::query::{self, Filter};
use cobscope_decoder::replay::{CaptureWalk, PlacedEvent, ReplayRow};
use serde_json::{Value, json};

use crate::counts::BlockRowCounts;
use crate::files::ContentSource;
use crate::rows::{FindingMarks, row_value};

/// Maximum number of rows kept; with more matches they are decoded when they are shown.
const MOST_KEPT: usize = 5_000;

/// Conditions for a shown event.
#[derive(Debug, Clone, Default)]
pub struct EventMatcher {
    filter: Option<Filter>,
    only_news: bool,
}

impl EventMatcher {
    /// All events, or changes only.
    pub fn new(only_news: bool) -> Self {
        Self { filter: None, only_news }
    }

    /// Events that a filter selects.
    ///
    /// # Errors
    /// If the filter is invalid: the reason, and the range of bytes that it concerns.
    pub fn parse(text: &str, only_news: bool) -> Result<Self, Value> {
        let filter: Filter = text.parse().map_err(|error: query::FilterError| {
            json!({"reason": error.reason(), "start": error.at().start, "end": error.at().end})
        })?;
        Ok(Self { filter: Some(filter), only_news })
    }

    /// Whether only changes match.
    pub fn only_news(&self) -> bool {
        self.only_news
    }

    /// Whether an event matches.
    pub fn takes(&self, placed: &PlacedEvent<'_>) -> bool {
        let is_shown = placed.is_news || !self.only_news;
        let filter = self.filter.as_ref();
        is_shown && filter.is_none_or(|filter| filter.matches_event(placed.event, placed.bus, None))
    }
}

/// Events of a filter.
pub struct FilteredEvents {
    /// The filter.
    pub matcher: EventMatcher,
    /// Rows per block of frames.
    pub counts: BlockRowCounts,
    /// All rows; `None` if there are too many.
    pub kept: Option<Vec<Value>>,
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
                    kept.push(row_value(
                        &ReplayRow::new(&placed, result.matcher.only_news),
                        place,
                        marks,
                        zero,
                    ));
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

/// Words that can follow at the end of an incomplete filter.
pub fn complete(text: &str) -> Value {
    match query::complete_filter(text) {
        Some(found) => json!({"start": found.start, "words": found.expected.possible_words()}),
        None => json!({"start": text.len(), "words": []}),
    }
}
