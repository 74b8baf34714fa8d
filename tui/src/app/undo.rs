//! Undo and redo of filter, search, only changes and sort order.
//!
//! The state after each key is compared with the one before it, so that no action can be forgotten.

use super::application::{App, InputMode};
use super::history::{PaneShown, RowSelection};
use crate::panes::PaneId;
use crate::state::SearchPattern;
use crate::timeline::RowMatcher;

impl App {
    /// The present filters, searches and sort orders.
    pub(super) fn row_selection(&self) -> RowSelection {
        let pane = |id: &PaneId| {
            let pane = self.panes.get(*id)?;
            Some(PaneShown {
                pane: *id,
                sorting: pane.table_sorting(),
                sought: pane.sought_text().unwrap_or_default().to_owned(),
            })
        };
        RowSelection {
            filter: self.core.filter.clone(),
            only_news: self.core.matcher.only_news,
            sought: self.core.sought.as_ref().map(|sought| sought.text.clone()),
            panes: PaneId::ALL.iter().filter_map(pane).collect(),
            columns: self.core.columns.clone(),
        }
    }

    /// Adds the present state to the history, unless a text is being typed.
    pub(super) fn remember_state(&mut self) {
        if !matches!(self.mode, InputMode::Prompt(..)) {
            let shown = self.row_selection();
            self.history.add_state(shown);
        }
    }

    /// Goes one state back or forth, and reports the changes.
    pub(super) fn step_history(&mut self, is_undo: bool) {
        let Some(changes) = self.history.step_history(is_undo) else {
            return self.core.show_refusal(if is_undo { "nothing to undo" } else { "nothing to redo" });
        };
        let shown = self.history.present.clone();
        for PaneShown { pane, sorting, sought } in shown.panes {
            let Some(pane) = self.panes.get_mut(pane) else { continue };
            pane.set_sorting(sorting);
            if pane.sought_text().is_some_and(|present| present != sought) {
                pane.search_text(&sought, &self.core);
            }
        }
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
        self.refresh_panes();
    }
}
