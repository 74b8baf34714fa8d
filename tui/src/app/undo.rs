//! Undo and redo of filter, search, only changes and sort order.
//!
//! The state after each key is compared with the one before it, so that no action can be forgotten.

use super::application::{App, InputMode};
use crate::state::SearchPattern;
use crate::timeline::RowMatcher;

impl App {
    /// Adds the present state to the history, unless a text is being typed.
    pub(super) fn remember_state(&mut self) {
        if !matches!(self.mode, InputMode::Prompt(..)) {
            let shown = self.panes.row_selection(&self.core);
            self.history.add_state(shown);
        }
    }

    /// Goes one state back or forth, and reports the changes.
    pub(super) fn step_history(&mut self, is_undo: bool) {
        let Some(changes) = self.history.step_history(is_undo) else {
            return self.core.show_refusal(if is_undo { "nothing to undo" } else { "nothing to redo" });
        };
        let shown = self.history.present.clone();
        self.panes.restore_panes(shown.panes, &self.core);
        self.core.sought = shown.sought.and_then(|text| SearchPattern::new(&text).ok());
        if (&self.core.filter, self.core.matcher.only_news) != (&shown.filter, shown.only_news) {
            let filter = shown.filter.parse().ok();
            self.core.filter = shown.filter;
            self.core.show_events(RowMatcher {
                filter,
                only_news: shown.only_news,
                ..self.core.matcher.clone()
            });
        }
        self.core.columns = shown.columns;
        let done = if is_undo { "undone" } else { "redone" };
        self.core.show_message(&format!("{} {done}", changes.join(", ")));
        self.panes.refresh_panes(&self.core);
    }
}
