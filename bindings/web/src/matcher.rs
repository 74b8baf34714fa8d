//! Selection of the events shown.

use cobscope_decoder::query::{self, Filter};
use cobscope_decoder::replay::PlacedEvent;
use serde_json::{Value, json};

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

/// Words that can follow at the end of an incomplete filter.
pub fn complete(text: &str) -> Value {
    match query::complete_filter(text) {
        Some(found) => json!({"start": found.start, "words": found.expected.possible_words()}),
        None => json!({"start": text.len(), "words": []}),
    }
}
