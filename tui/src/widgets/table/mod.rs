//! A table of any number of rows; only the visible rows are requested.
//!
//! ```text
//! No▲ Time      Node  Event               │  column heads with the sort mark
//!  17    0.412  boom  ▾ boot-up           █  an expanded row with its children below
//!  18    0.413  boom    EMCY 0000 no err… █  ◀ the whole selected row is highlighted
//!  19    0.900  boom  ▸ SDO download      │
//! ```

mod columns;
mod state;

use ratatui::buffer::Buffer;
use ratatui::layout::Rect;
use ratatui::style::{Modifier, Style};
use ratatui::text::Line;

pub use columns::{ColumnWidth, TableColumn};
pub use state::TableState;

use crate::theme::{Glyph, TextRole, Theme};
use crate::widgets::draw;
pub use crate::widgets::draw::TextAlignment;

/// A cell of a row.
#[derive(Clone, Debug, Default)]
pub struct TableCell<'a> {
    /// Text of the cell.
    pub text: Line<'a>,
    /// Style of the parts of the text without their own style.
    pub style: Style,
}

impl<'a> TableCell<'a> {
    /// A text in a style.
    pub fn new(text: impl Into<Line<'a>>, style: Style) -> Self {
        Self { text: text.into(), style }
    }
}

impl<'a, T: Into<Line<'a>>> From<T> for TableCell<'a> {
    fn from(text: T) -> Self {
        Self { text: text.into(), style: Style::new() }
    }
}

/// Position of a row in a tree.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct TreePosition {
    /// Depth, 0 at the root.
    pub level: u8,
    /// Whether its children are shown; None without children.
    pub open: Option<bool>,
}

/// A row of a table.
#[derive(Clone, Debug, Default)]
pub struct TableRow<'a> {
    /// Cells in column order; missing cells are empty.
    pub cells: Vec<TableCell<'a>>,
    /// Style under the styles of the cells.
    pub style: Style,
    /// Position in a tree, if the table is one.
    pub group: Option<TreePosition>,
}

impl<'a> TableRow<'a> {
    /// A row of cells.
    pub fn new<C: Into<TableCell<'a>>>(cells: impl IntoIterator<Item = C>) -> Self {
        Self { cells: cells.into_iter().map(Into::into).collect(), ..Self::default() }
    }

    /// Sets the style under the styles of the cells.
    #[must_use]
    pub fn with_style(self, style: Style) -> Self {
        Self { style, ..self }
    }

    /// Sets the position in a tree.
    #[must_use]
    pub fn with_group(self, level: u8, open: Option<bool>) -> Self {
        Self { group: Some(TreePosition { level, open }), ..self }
    }
}

/// Returns the row with an index.
type Rows<'a> = Box<dyn FnMut(usize) -> TableRow<'a> + 'a>;

/// A table with its rows and state.
pub struct TableWidget<'a> {
    theme: &'a Theme,
    columns: &'a [TableColumn],
    count: usize,
    rows: Rows<'a>,
    state: Option<&'a TableState>,
    is_focused: bool,
    tree_column: usize,
    empty: &'a str,
}

impl<'a> TableWidget<'a> {
    /// A table without rows.
    pub fn new(theme: &'a Theme, columns: &'a [TableColumn]) -> Self {
        let rows = Box::new(|_| TableRow::default());
        Self { theme, columns, count: 0, rows, state: None, is_focused: true, tree_column: 0, empty: "" }
    }

    /// Sets the number of rows.
    #[must_use]
    pub fn row_count(self, count: usize) -> Self {
        Self { count, ..self }
    }

    /// Sets the source of rows; it is called for visible rows only.
    #[must_use]
    #[expect(clippy::redundant_closure, reason = "the closure shortens the lifetime of the row")]
    pub fn with_rows<'row: 'a>(self, mut rows: impl FnMut(usize) -> TableRow<'row> + 'a) -> Self {
        Self { rows: Box::new(move |index| rows(index)), ..self }
    }

    /// Sets the selection and the visible part.
    #[must_use]
    pub fn with_state(self, state: &'a TableState) -> Self {
        Self { state: Some(state), ..self }
    }

    /// Sets whether keys act on this table.
    #[must_use]
    pub fn with_focus(self, is_focused: bool) -> Self {
        Self { is_focused, ..self }
    }

    /// Sets the column indented by [`TableRow::with_group`]; the default is the first one.
    #[must_use]
    pub fn tree_column(self, column: usize) -> Self {
        Self { tree_column: column, ..self }
    }

    /// Sets the text of an empty table.
    #[must_use]
    pub fn with_empty_text(self, text: &'a str) -> Self {
        Self { empty: text, ..self }
    }

    /// Number of visible rows in an area: the height for `TableState`.
    pub fn visible_height(area: Rect) -> usize {
        usize::from(body_area(area).height)
    }

    /// Width of a column in a table of `width`; 0 if it is not visible.
    pub fn width_of(columns: &[TableColumn], index: usize, width: u16) -> u16 {
        columns::place_columns(columns, width)
            .iter()
            .find(|placed| placed.index == index)
            .map_or(0, |placed| placed.width)
    }

    /// Draws the table.
    pub fn render(mut self, area: Rect, buf: &mut Buffer) {
        let area = area.intersection(buf.area);
        if area.is_empty() {
            return;
        }
        let inside = self.inside_area(area);
        let placed = columns::place_columns(self.columns, inside.width);
        let body = body_area(inside);
        if body.y > area.y {
            self.draw_titles(&placed, inside, buf);
        }
        if self.count == 0 {
            let text = Line::styled(self.empty, self.theme.role_style(TextRole::Quiet));
            draw::draw_line(buf, body, &text, TextAlignment::Left, self.theme);
            return;
        }
        let visible = self.visible_rows(area);
        let selected = self.state.map(|state| state.selected.min(self.count - 1));
        for (y, index) in (body.y..).zip(visible.clone()) {
            let row = (self.rows)(index);
            let place = Rect { y, height: 1, ..body };
            self.draw_row(&row, &placed, place, buf);
            if Some(index) == selected {
                buf.set_style(
                    Rect { width: area.width, ..place },
                    self.theme.selection_style(self.is_focused),
                );
                self.mark_cell(&placed, place, buf);
            }
        }
        if inside.width < area.width {
            draw::draw_scrollbar(
                buf,
                Rect { width: area.width, ..body },
                visible.start,
                self.count,
                self.theme,
            );
        }
    }

    /// The row at a screen line.
    pub fn row_at(&self, area: Rect, y: u16, state: &TableState) -> Option<usize> {
        let body = body_area(area);
        let line = usize::from(y.checked_sub(body.y)?);
        let visible = state.visible_rows(usize::from(body.height), self.count);
        (line < visible.len()).then(|| visible.start + line)
    }

    /// The column at a screen column; the space after a column belongs to it.
    pub fn column_at(&self, area: Rect, x: u16) -> Option<usize> {
        let inside = self.inside_area(area);
        if !(inside.left()..inside.right()).contains(&x) {
            return None;
        }
        let placed = columns::place_columns(self.columns, inside.width);
        placed.iter().rev().find(|column| inside.x + column.x <= x).map(|column| column.index)
    }

    /// Indices of the columns that are visible in an area.
    pub fn visible_columns(&self, area: Rect) -> Vec<usize> {
        let placed = columns::place_columns(self.columns, self.inside_area(area).width);
        placed.iter().map(|column| column.index).collect()
    }

    /// Whether a screen line is that of the column heads.
    pub fn is_title_at(area: Rect, y: u16) -> bool {
        area.y == y && body_area(area).y > y
    }

    /// Indices of the visible rows.
    fn visible_rows(&self, area: Rect) -> std::ops::Range<usize> {
        let height = Self::visible_height(area);
        self.state.map_or(0..height.min(self.count), |state| state.visible_rows(height, self.count))
    }

    /// The area without the scroll bar.
    fn inside_area(&self, area: Rect) -> Rect {
        let scrolls = self.count > Self::visible_height(area) && area.width > 2;
        Rect { width: area.width - u16::from(scrolls), ..area }
    }

    /// The visible column that keys act on; None without a selected one.
    fn current_column(&self, placed: &[columns::VisibleColumn]) -> Option<usize> {
        let state = self.state.filter(|state| self.is_focused && state.column < self.columns.len())?;
        Some(state.column_in(&placed.iter().map(|column| column.index).collect::<Vec<_>>()))
    }

    fn draw_titles(&self, placed: &[columns::VisibleColumn], area: Rect, buf: &mut Buffer) {
        let current = self.current_column(placed);
        let sort = self.state.and_then(|state| state.sort);
        for column in placed {
            let Some(TableColumn { title, align, .. }) = self.columns.get(column.index) else { continue };
            let mark = match sort {
                Some((index, is_descending)) if index == column.index => {
                    self.theme.glyph(if is_descending { Glyph::Down } else { Glyph::Up })
                }
                _ => "",
            };
            let mut place = Rect { x: area.x + column.x, width: column.width, height: 1, ..area };
            let mut style = self.theme.role_style(TextRole::HeaderCell);
            if current == Some(column.index) {
                style = style.patch(self.theme.role_style(TextRole::Key));
            }
            // The mark stays visible if the head is cut.
            let mark_width = draw::text_width(mark).min(place.width);
            place.width -= mark_width;
            draw::draw_line(buf, place, &Line::styled(title.as_ref(), style), *align, self.theme);
            let title_width = match align {
                TextAlignment::Left => draw::text_width(title).min(place.width),
                TextAlignment::Right => place.width,
            };
            draw::put_text(buf, place.x + title_width, place.y, mark_width, mark, style);
        }
    }

    fn draw_row(&self, row: &TableRow<'_>, placed: &[columns::VisibleColumn], area: Rect, buf: &mut Buffer) {
        buf.set_style(area, row.style);
        // If the column of the tree is not visible, the next one shows the tree.
        let tree = placed.iter().find(|column| column.index >= self.tree_column).or(placed.first());
        for column in placed {
            let mut place = Rect { x: area.x + column.x, width: column.width, ..area };
            let align = self.columns.get(column.index).map_or(TextAlignment::Left, |column| column.align);
            if let Some(group) = row.group
                && tree == Some(column)
            {
                place = self.draw_branch(group, place, buf);
            }
            if let Some(cell) = row.cells.get(column.index) {
                buf.set_style(place, cell.style);
                draw::draw_line(buf, place, &cell.text, align, self.theme);
            }
        }
    }

    /// Draws indent and mark of a tree row; returns the rest of the cell.
    fn draw_branch(&self, group: TreePosition, place: Rect, buf: &mut Buffer) -> Rect {
        let mark = match group.open {
            Some(true) => self.theme.glyph(Glyph::Open),
            Some(false) => self.theme.glyph(Glyph::Closed),
            None => " ",
        };
        let indent = (u16::from(group.level) * 2).min(place.width);
        draw::put_text(
            buf,
            place.x + indent,
            place.y,
            place.width - indent,
            mark,
            self.theme.role_style(TextRole::Quiet),
        );
        let used = (indent + 2).min(place.width);
        Rect { x: place.x + used, width: place.width - used, ..place }
    }

    /// Underlines the current column in the selected row.
    fn mark_cell(&self, placed: &[columns::VisibleColumn], place: Rect, buf: &mut Buffer) {
        let current = self.current_column(placed);
        if let Some(column) = placed.iter().find(|column| Some(column.index) == current) {
            let cell = Rect { x: place.x + column.x, width: column.width, ..place };
            buf.set_style(cell, Style::new().add_modifier(Modifier::UNDERLINED));
        }
    }
}

/// The area without the heads, which are dropped in an area of one line.
fn body_area(area: Rect) -> Rect {
    let titles = u16::from(area.height > 1);
    Rect { y: area.y + titles, height: area.height - titles, ..area }
}

#[cfg(test)]
mod tests {
    use std::cell::RefCell;

    use super::*;
    use crate::theme::{ColorDepth, LineCharacters, ThemePalette};
    use crate::widgets::draw::tests::{buffer_lines, in_every_small_size, plain_theme};

    fn columns() -> Vec<TableColumn> {
        vec![
            TableColumn::new("No", ColumnWidth::Fixed(4)).align_right().with_priority(5),
            TableColumn::new("Node", ColumnWidth::Fixed(6)).with_priority(2),
            TableColumn::new("What", ColumnWidth::Fill).with_priority(9),
        ]
    }

    fn row(index: usize) -> TableRow<'static> {
        let what = if index.is_multiple_of(2) { "boot-up" } else { "EMCY 8305 spool position error" };
        TableRow::new([TableCell::from(index.to_string()), "boom".into(), what.into()])
    }

    fn drawn(
        width: u16,
        height: u16,
        borders: LineCharacters,
        count: usize,
        state: &TableState,
    ) -> Vec<String> {
        let (theme, columns) = (plain_theme(borders), columns());
        let mut buf = Buffer::empty(Rect::new(0, 0, width, height));
        TableWidget::new(&theme, &columns)
            .row_count(count)
            .with_rows(row)
            .with_state(state)
            .render(buf.area, &mut buf);
        buffer_lines(&buf)
    }

    #[test]
    fn rows_titles_and_a_scrollbar() {
        let state = TableState { selected: 12, offset: 9, sort: Some((0, false)), column: 2 };
        assert_eq!(
            drawn(32, 7, LineCharacters::Unicode, 40, &state),
            [
                " No▲ Node   What",
                "   9 boom   EMCY 8305 spool po…│",
                "  10 boom   boot-up            █",
                "  11 boom   EMCY 8305 spool po…│",
                "  12 boom   boot-up            │",
                "  13 boom   EMCY 8305 spool po…│",
                "  14 boom   boot-up            │",
            ]
        );
        let state = TableState { sort: Some((1, true)), ..state };
        assert_eq!(
            drawn(32, 4, LineCharacters::Ascii, 40, &state),
            [
                "  No Nodev  What",
                "  11 boom   EMCY 8305 spool po~|",
                "  12 boom   boot-up            #",
                "  13 boom   EMCY 8305 spool po~|",
            ]
        );
    }

    #[test]
    fn narrow_tables_keep_what_matters() {
        let state = TableState::default();
        assert_eq!(
            drawn(20, 3, LineCharacters::Unicode, 2, &state),
            ["  No What", "   0 boot-up", "   1 EMCY 8305 spoo…"]
        );
        assert_eq!(drawn(9, 3, LineCharacters::Unicode, 9, &state), ["What", "boot-up █", "EMCY 83…│"]);
        assert_eq!(drawn(9, 1, LineCharacters::Unicode, 9, &state), ["boot-up █"]);
        assert_eq!(drawn(1, 2, LineCharacters::Unicode, 9, &state), ["…", "…"]);
    }

    #[test]
    fn only_rows_in_view_are_asked_for() {
        let (theme, columns) = (plain_theme(LineCharacters::Unicode), columns());
        let asked = RefCell::new(Vec::new());
        let state = TableState { selected: usize::MAX / 2, ..TableState::default() };
        let mut buf = Buffer::empty(Rect::new(0, 0, 30, 4));
        let rows = |index| {
            asked.borrow_mut().push(index);
            row(index)
        };
        TableWidget::new(&theme, &columns)
            .row_count(usize::MAX)
            .with_rows(rows)
            .with_state(&state)
            .render(buf.area, &mut buf);
        let middle = usize::MAX / 2;
        assert_eq!(asked.into_inner(), [middle - 1, middle, middle + 1]);
    }

    #[test]
    fn the_selected_line_is_highlighted_across() {
        let (theme, columns) = (plain_theme(LineCharacters::Unicode), columns());
        let state = TableState { selected: 1, column: 1, ..TableState::default() };
        let mut buf = Buffer::empty(Rect::new(0, 0, 30, 4));
        TableWidget::new(&theme, &columns)
            .row_count(2)
            .with_rows(row)
            .with_state(&state)
            .render(buf.area, &mut buf);
        for x in 0..30 {
            assert!(!buf[(x, 1)].modifier.contains(Modifier::REVERSED), "{x}");
            assert!(buf[(x, 2)].modifier.contains(Modifier::REVERSED), "{x}");
            assert_eq!(buf[(x, 2)].modifier.contains(Modifier::UNDERLINED), (5..11).contains(&x), "{x}");
        }
        let mut buf = Buffer::empty(Rect::new(0, 0, 30, 4));
        let table = TableWidget::new(&theme, &columns).row_count(2).with_rows(row).with_state(&state);
        table.with_focus(false).render(buf.area, &mut buf);
        assert_eq!(buf[(0, 2)].modifier, Modifier::UNDERLINED);
    }

    #[test]
    fn cells_keep_their_styles() {
        let theme = Theme::new(ThemePalette::Dark, ColorDepth::Sixteen, LineCharacters::Unicode);
        let columns = columns();
        let bad = theme.role_style(TextRole::Bad);
        let quiet = theme.role_style(TextRole::Quiet);
        let mut buf = Buffer::empty(Rect::new(0, 0, 30, 2));
        let row = |_| TableRow::new([TableCell::from("1"), TableCell::new("boom", bad)]).with_style(quiet);
        TableWidget::new(&theme, &columns).row_count(1).with_rows(row).render(buf.area, &mut buf);
        assert_eq!(
            (buf[(3, 1)].fg, buf[(5, 1)].fg, buf[(20, 1)].fg),
            (quiet.fg.unwrap(), bad.fg.unwrap(), quiet.fg.unwrap())
        );
    }

    #[test]
    fn a_tree_is_indented() {
        let columns = [
            TableColumn::new("Finding", ColumnWidth::Fill),
            TableColumn::new("Count", ColumnWidth::Fixed(5)).align_right(),
        ];
        let rows = |index| {
            let (level, open, text) =
                [(0, Some(true), "node-lost"), (1, None, "node 5"), (0, Some(false), "guard-late")][index];
            TableRow::new([text, "1"]).with_group(level, open)
        };
        let drawn = |borders| {
            let theme = plain_theme(borders);
            let mut buf = Buffer::empty(Rect::new(0, 0, 20, 4));
            TableWidget::new(&theme, &columns).row_count(3).with_rows(rows).render(buf.area, &mut buf);
            buffer_lines(&buf)
        };
        assert_eq!(
            drawn(LineCharacters::Unicode),
            ["Finding        Count", "▾ node-lost        1", "    node 5         1", "▸ guard-late       1"]
        );
        assert_eq!(drawn(LineCharacters::Ascii)[1], "- node-lost        1");
        assert_eq!(drawn(LineCharacters::Ascii)[3], "+ guard-late       1");
        let theme = plain_theme(LineCharacters::Unicode);
        let mut buf = Buffer::empty(Rect::new(0, 0, 22, 3));
        let table = TableWidget::new(&theme, &columns).row_count(2).tree_column(1);
        table
            .with_rows(|index| TableRow::new(["node-lost", "1"]).with_group(0, Some(index == 0)))
            .render(buf.area, &mut buf);
        assert_eq!(buffer_lines(&buf)[1..], ["node-lost        ▾   1", "node-lost        ▸   1"]);
    }

    #[test]
    fn an_empty_table_says_so() {
        let (theme, columns) = (plain_theme(LineCharacters::Unicode), columns());
        let mut buf = Buffer::empty(Rect::new(0, 0, 24, 3));
        TableWidget::new(&theme, &columns).with_empty_text("no events yet").render(buf.area, &mut buf);
        assert_eq!(buffer_lines(&buf), ["  No Node   What", "no events yet", ""]);
    }

    #[test]
    fn clicks_find_rows_and_columns() {
        let (theme, columns) = (plain_theme(LineCharacters::Unicode), columns());
        let area = Rect::new(10, 5, 30, 6);
        let state = TableState { selected: 20, offset: 18, ..TableState::default() };
        let table = TableWidget::new(&theme, &columns).row_count(22);
        assert_eq!(table.row_at(area, 4, &state), None);
        assert_eq!(table.row_at(area, 5, &state), None);
        assert_eq!(table.row_at(area, 6, &state), Some(17));
        assert_eq!(table.row_at(area, 10, &state), Some(21));
        assert_eq!(table.row_at(area, 11, &state), None);
        assert!(TableWidget::is_title_at(area, 5) && !TableWidget::is_title_at(area, 6));
        let at = |x| table.column_at(area, x);
        assert_eq!(
            [at(9), at(10), at(14), at(15), at(22), at(38), at(39)],
            [None, Some(0), Some(0), Some(1), Some(2), Some(2), None]
        );
    }

    #[test]
    fn every_small_size() {
        let (theme, columns) = (plain_theme(LineCharacters::Ascii), columns());
        for count in [0, 1, 100] {
            let state = TableState { selected: 50, sort: Some((2, true)), ..TableState::default() };
            in_every_small_size(|area, buf| {
                let table = TableWidget::new(&theme, &columns)
                    .row_count(count)
                    .with_state(&state)
                    .with_empty_text("none");
                let _ = (table.row_at(area, 2, &state), table.column_at(area, 4));
                table.with_rows(|index| row(index).with_group(200, Some(true))).render(area, buf);
            });
        }
    }
}
