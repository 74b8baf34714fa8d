//! Selection and scroll position of a table, without drawing.
//!
//! ```text
//! offset ──▶  ┌──────────┐
//!             │          │
//! selected ─▶ │▒▒▒▒▒▒▒▒▒▒│   two rows before and after it stay visible
//!             │          │
//!             └──────────┘
//! ```

use std::ops::Range;

/// Number of visible rows kept before and after the selected one.
const MARGIN: usize = 2;

/// Selection, scroll position and sort order.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct TableState {
    /// The selected row.
    pub selected: usize,
    /// First visible row, unless the selection requires another; see [`TableState::visible_rows`].
    pub offset: usize,
    /// Column of the sort order, and whether it is descending.
    pub sort: Option<(usize, bool)>,
    /// The selected column.
    pub column: usize,
}

impl TableState {
    /// Moves the selection by `delta` rows, but not beyond the ends.
    pub fn move_by(&mut self, delta: isize, len: usize) {
        self.selected = self.selected.saturating_add_signed(delta);
        self.clamp_to(len);
    }

    /// Moves the selection by pages of `height` rows with an overlap of one row.
    pub fn page_selection(&mut self, delta: isize, height: usize, len: usize) {
        let rows = isize::try_from(height.saturating_sub(1).max(1)).unwrap_or(isize::MAX);
        let by = delta.saturating_mul(rows);
        self.offset = self.visible_rows(height, len).start.saturating_add_signed(by);
        self.move_by(by, len);
        self.settle_offset(height, len);
    }

    /// Scrolls; the selection moves only if it would leave the visible part.
    pub fn scroll_by(&mut self, delta: isize, height: usize, len: usize) {
        let last = len.saturating_sub(height);
        self.offset = self.visible_rows(height, len).start.saturating_add_signed(delta).min(last);
        let margin = scroll_margin(height);
        let first = if self.offset == 0 { 0 } else { self.offset.saturating_add(margin) };
        let end = if self.offset == last { len } else { self.offset.saturating_add(height - margin) };
        self.selected = self.selected.clamp(first, end.saturating_sub(1).max(first));
        self.clamp_to(len);
    }

    /// Selects the first row.
    pub fn select_first(&mut self) {
        self.selected = 0;
        self.offset = 0;
    }

    /// Selects the last row.
    pub fn select_last(&mut self, len: usize) {
        self.selected = usize::MAX;
        self.clamp_to(len);
    }

    /// The selected column. If it is not among the visible ones in `shown`, the next of them, or the last one.
    pub fn column_in(&self, shown: &[usize]) -> usize {
        let next = shown.iter().find(|column| **column >= self.column).or(shown.last());
        next.copied().unwrap_or(self.column)
    }

    /// Selects another of the visible columns in `shown`.
    pub fn move_column(&mut self, delta: isize, shown: &[usize]) {
        let present = self.column_in(shown);
        let place = shown.iter().position(|column| *column == present).unwrap_or(0);
        let place = place.saturating_add_signed(delta).min(shown.len().saturating_sub(1));
        self.column = shown.get(place).copied().unwrap_or(present);
    }

    /// Cycles the sort order of the current one of the visible columns in `shown`: ascending, descending, off.
    pub fn cycle_sort(&mut self, shown: &[usize]) {
        self.column = self.column_in(shown);
        self.sort = match self.sort {
            Some((column, false)) if column == self.column => Some((column, true)),
            Some((column, true)) if column == self.column => None,
            _ => Some((self.column, false)),
        };
    }

    /// Limits the selection to `len` rows.
    pub fn clamp_to(&mut self, len: usize) {
        self.selected = self.selected.min(len.saturating_sub(1));
    }

    /// Stores the visible part, so that it stays in place when the selection moves back. Called after moves,
    /// with the number of visible rows.
    pub fn settle_offset(&mut self, height: usize, len: usize) {
        self.offset = self.visible_rows(height, len).start;
    }

    /// The visible rows: from `offset`, moved as far as the selection and the end of the table require.
    pub fn visible_rows(&self, height: usize, len: usize) -> Range<usize> {
        let selected = self.selected.min(len.saturating_sub(1));
        let margin = scroll_margin(height);
        let earliest = selected.saturating_add(margin + 1).saturating_sub(height.max(1));
        let start = self.offset.min(selected.saturating_sub(margin)).max(earliest);
        let start = start.min(len.saturating_sub(height));
        start..start.saturating_add(height).min(len)
    }
}

/// Rows kept before and after the selection in a view of `height` rows.
fn scroll_margin(height: usize) -> usize {
    MARGIN.min(height.saturating_sub(1) / 2)
}

#[cfg(test)]
mod tests {
    use super::*;

    fn at(selected: usize, offset: usize) -> TableState {
        TableState { selected, offset, ..TableState::default() }
    }

    #[test]
    fn the_selection_stays_in_view_with_a_margin() {
        assert_eq!(at(0, 0).visible_rows(10, 100), 0..10);
        assert_eq!(at(7, 0).visible_rows(10, 100), 0..10);
        assert_eq!(at(8, 0).visible_rows(10, 100), 1..11);
        assert_eq!(at(99, 0).visible_rows(10, 100), 90..100);
        assert_eq!(at(42, 40).visible_rows(10, 100), 40..50);
        assert_eq!(at(41, 40).visible_rows(10, 100), 39..49);
        assert_eq!(at(1, 40).visible_rows(10, 100), 0..10);
    }

    #[test]
    fn views_of_few_rows() {
        assert_eq!(at(5, 0).visible_rows(0, 100), 5..5);
        assert_eq!(at(5, 0).visible_rows(1, 100), 5..6);
        assert_eq!(at(5, 0).visible_rows(2, 100), 4..6);
        assert_eq!(at(5, 0).visible_rows(3, 100), 4..7);
        assert_eq!(at(5, 3).visible_rows(10, 4), 0..4);
        assert_eq!(at(5, 3).visible_rows(10, 0), 0..0);
    }

    #[test]
    fn the_view_stays_when_the_selection_turns_back() {
        let mut state = at(0, 0);
        state.move_by(20, 100);
        state.settle_offset(10, 100);
        assert_eq!(state.visible_rows(10, 100), 13..23);
        state.move_by(-3, 100);
        assert_eq!(state.visible_rows(10, 100), 13..23);
    }

    #[test]
    fn moves_stop_at_both_ends() {
        let mut state = at(3, 0);
        state.move_by(-10, 100);
        assert_eq!(state.selected, 0);
        state.select_last(100);
        assert_eq!(state.selected, 99);
        state.move_by(isize::MAX, 100);
        assert_eq!(state.selected, 99);
        state.move_by(1, 0);
        assert_eq!(state.selected, 0);
        state.move_by(isize::MIN, usize::MAX);
        assert_eq!(state.selected, 0);
        state.select_first();
        assert_eq!((state.selected, state.offset), (0, 0));
    }

    #[test]
    fn a_page_leaves_one_row_in_view() {
        let mut state = at(0, 0);
        state.page_selection(1, 10, 100);
        assert_eq!((state.selected, state.offset), (9, 9 - 2));
        state.page_selection(1, 10, 100);
        assert_eq!((state.selected, state.offset), (18, 16));
        state.page_selection(-1, 10, 100);
        assert_eq!((state.selected, state.offset), (9, 7));
        state.page_selection(50, 10, 100);
        assert_eq!((state.selected, state.offset), (99, 90));
        state.page_selection(-1, 0, 100);
        assert_eq!(state.selected, 98);
    }

    #[test]
    fn the_wheel_drags_the_selection_only_where_it_must() {
        let mut state = at(5, 0);
        state.scroll_by(3, 10, 100);
        assert_eq!((state.selected, state.offset), (5, 3));
        state.scroll_by(3, 10, 100);
        assert_eq!((state.selected, state.offset), (8, 6));
        assert_eq!(state.visible_rows(10, 100), 6..16);
        state.scroll_by(-6, 10, 100);
        assert_eq!((state.selected, state.offset), (7, 0));
        state.scroll_by(1000, 10, 100);
        assert_eq!(state.visible_rows(10, 100), 90..100);
        state.scroll_by(1, 10, 3);
        assert_eq!((state.selected, state.offset), (2, 0));
        state.scroll_by(1, 0, 0);
        assert_eq!(state.selected, 0);
    }

    #[test]
    fn sorting_goes_round() {
        let mut state = TableState { column: 2, ..TableState::default() };
        let mut seen = Vec::new();
        let all = [0, 1, 2, 3];
        for _ in 0..3 {
            state.cycle_sort(&all);
            seen.push(state.sort);
        }
        assert_eq!(seen, [Some((2, false)), Some((2, true)), None]);
        state.cycle_sort(&all);
        state.move_column(1, &all);
        state.cycle_sort(&all);
        assert_eq!(state.sort, Some((3, false)));
        state.move_column(1, &all);
        assert_eq!(state.column, 3);
        state.move_column(-9, &all);
        assert_eq!(state.column, 0);
    }

    #[test]
    fn hidden_columns_are_skipped() {
        let shown = [1, 2, 5];
        let mut state = TableState::default();
        assert_eq!(state.column_in(&shown), 1);
        state.move_column(1, &shown);
        assert_eq!(state.column, 2);
        state.move_column(1, &shown);
        assert_eq!(state.column, 5);
        state.move_column(-1, &shown);
        assert_eq!(state.column, 2);
        // Columns can disappear: the next one is selected, else the last one.
        assert_eq!((state.column_in(&[0, 4]), state.column_in(&[0, 1]), state.column_in(&[])), (4, 1, 2));
        state.cycle_sort(&[0, 4]);
        assert_eq!((state.column, state.sort), (4, Some((4, false))));
        state.move_column(1, &[]);
        assert_eq!(state.column, 4);
    }
}
