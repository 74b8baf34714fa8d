//! Filters, searches and sort orders before and after the present ones.
//!
//! ```text
//! undo  [ all ] [ kind == emcy ]   present   [ node == 5 ]  redo
//! ```

use std::collections::BTreeMap;

use crate::panes::{PaneId, Sorting};

/// Maximum number of states that can be restored.
const MOST: usize = 100;

/// The user's selection of rows and their order.
#[derive(Debug, Clone, PartialEq, Default)]
pub(super) struct RowSelection {
    pub(super) filter: String,
    pub(super) only_news: bool,
    /// Text of the search for rows.
    pub(super) sought: Option<String>,
    pub(super) panes: Vec<PaneShown>,
    /// Chosen columns by name of the pane.
    pub(super) columns: BTreeMap<String, Vec<String>>,
}

/// Choices in one pane.
#[derive(Debug, Clone, PartialEq)]
pub(super) struct PaneShown {
    pub(super) pane: PaneId,
    pub(super) sorting: Sorting,
    /// Text of its own search.
    pub(super) sought: String,
}

impl RowSelection {
    /// Filters and searches that `next` no longer has.
    pub(super) fn cleared_by(&self, next: &Self) -> Vec<String> {
        let gone = |what: &str, old: &str, new: &str| {
            if old.is_empty() || !new.is_empty() { None } else { Some(format!("{what} {old}")) }
        };
        let texts = |shown: &Self| shown.sought.clone().unwrap_or_default();
        let panes = self.panes.iter().zip(&next.panes);
        let of_panes = panes.filter_map(|(old, new)| gone("search", &old.sought, &new.sought));
        let own = [gone("filter", &self.filter, &next.filter), gone("search", &texts(self), &texts(next))];
        own.into_iter().flatten().chain(of_panes).collect()
    }
}

/// States before and after the present one.
#[derive(Debug, Default)]
pub(super) struct ViewHistory {
    pub(super) present: RowSelection,
    undo: Vec<RowSelection>,
    redo: Vec<RowSelection>,
}

impl ViewHistory {
    /// A history that begins with a state.
    pub(super) fn starting_with(present: RowSelection) -> Self {
        Self { present, ..Self::default() }
    }

    /// Adds the state after an action; equal states are one.
    pub(super) fn add_state(&mut self, next: RowSelection) {
        if next == self.present {
            return;
        }
        self.redo.clear();
        self.undo.push(std::mem::replace(&mut self.present, next));
        if self.undo.len() > MOST {
            self.undo.remove(0);
        }
    }

    /// Goes one state back or forth; returns the changes from the older to the newer state.
    pub(super) fn step_history(&mut self, is_undo: bool) -> Option<Vec<String>> {
        let (from, to) =
            if is_undo { (&mut self.undo, &mut self.redo) } else { (&mut self.redo, &mut self.undo) };
        let next = from.pop()?;
        let left = std::mem::replace(&mut self.present, next);
        let (old, new) = if is_undo { (&self.present, &left) } else { (&left, &self.present) };
        let changes = change_texts(old, new);
        to.push(left);
        Some(changes)
    }
}

/// The changes from one state to another in words: `filter kind == emcy`, `clearing of the filter node == 5`.
fn change_texts(old: &RowSelection, new: &RowSelection) -> Vec<String> {
    let text = |what: &str, old: &str, new: &str| match (old == new, new) {
        (true, _) => None,
        (false, "") => Some(format!("clearing of the {what} {old}")),
        (false, new) => Some(format!("{what} {new}")),
    };
    let sought = |shown: &RowSelection| shown.sought.clone().unwrap_or_default();
    let mut found: Vec<String> = text("filter", &old.filter, &new.filter).into_iter().collect();
    found.extend(text("search", &sought(old), &sought(new)));
    if old.only_news != new.only_news {
        found.push(if new.only_news { "only changes" } else { "all events" }.to_owned());
    }
    for pane in PaneId::ALL.iter().filter(|pane| old.columns.get(pane.name()) != new.columns.get(pane.name()))
    {
        found.push(format!("columns of {}", pane.title()));
    }
    for (old, new) in old.panes.iter().zip(&new.panes) {
        let title = new.pane.title();
        found.extend(text("search", &old.sought, &new.sought).map(|text| format!("{text} in {title}")));
        if old.sorting != new.sorting {
            found.push(format!("sort order of {title}"));
        }
    }
    found
}

#[cfg(test)]
mod tests {
    use super::*;

    fn filter(text: &str) -> RowSelection {
        RowSelection { filter: text.to_owned(), ..RowSelection::default() }
    }

    #[test]
    fn states_are_restored_in_both_directions() {
        let mut history = ViewHistory::starting_with(filter(""));
        history.add_state(filter("kind == emcy"));
        history.add_state(filter("kind == emcy"));
        history.add_state(filter(""));
        assert_eq!(history.step_history(true).unwrap(), ["clearing of the filter kind == emcy"]);
        assert_eq!(history.step_history(true).unwrap(), ["filter kind == emcy"]);
        assert_eq!(history.step_history(true), None);
        assert_eq!(history.step_history(false).unwrap(), ["filter kind == emcy"]);
        assert_eq!(history.present, filter("kind == emcy"));
        // A new change ends the possible redo.
        history.add_state(filter("node == 5"));
        assert_eq!(history.step_history(false), None);
        assert_eq!(history.step_history(true).unwrap(), ["filter node == 5"]);
    }

    #[test]
    fn the_history_is_limited() {
        let mut history = ViewHistory::starting_with(filter(""));
        (0..MOST * 2).for_each(|node| history.add_state(filter(&format!("node == {node}"))));
        assert_eq!(history.undo.len(), MOST);
    }

    #[test]
    fn several_changes_of_one_key_are_listed() {
        let old = RowSelection { sought: Some("emcy".to_owned()), only_news: true, ..filter("node == 5") };
        let texts = change_texts(&old, &RowSelection::default());
        assert_eq!(texts, ["clearing of the filter node == 5", "clearing of the search emcy", "all events"]);
    }
}
