//! Selection and position of the visible columns.
//!
//! ```text
//! 100 columns   No   Time      ID   Node     Event              Data
//!  60 columns   No   Time      ID   Event              (Node and Data had the lowest priority)
//! ```

use std::borrow::Cow;

use crate::widgets::draw::TextAlignment;

/// Space between two columns.
const SPACE: u16 = 1;
/// Minimum width of a column that fills the rest.
const LEAST_FILL: u16 = 10;

/// Width of a column.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum ColumnWidth {
    /// A fixed width; 0 for a column that is not needed.
    Fixed(u16),
    /// A minimum width. The column grows if there is room and no `Fill` column.
    Min(u16),
    /// The rest of the width, but at least ten; several columns share it.
    Fill,
}

/// A column of a table.
#[derive(Clone, Debug)]
pub struct TableColumn {
    /// Column head.
    pub title: Cow<'static, str>,
    /// Width on the screen.
    pub width: ColumnWidth,
    /// Alignment of its text.
    pub align: TextAlignment,
    /// In a narrow table the column with the lowest priority is dropped first; of equal ones the rightmost.
    pub priority: u8,
}

impl TableColumn {
    /// A left-aligned column with the highest priority.
    pub fn new(title: impl Into<Cow<'static, str>>, width: ColumnWidth) -> Self {
        Self { title: title.into(), width, align: TextAlignment::Left, priority: u8::MAX }
    }

    /// Aligns the column to the right, for numbers.
    #[must_use]
    pub fn align_right(self) -> Self {
        Self { align: TextAlignment::Right, ..self }
    }

    /// Sets the priority.
    #[must_use]
    pub fn with_priority(self, priority: u8) -> Self {
        Self { priority, ..self }
    }
}

/// Minimum width.
fn least_of(width: ColumnWidth) -> u16 {
    match width {
        ColumnWidth::Fixed(least) | ColumnWidth::Min(least) => least,
        ColumnWidth::Fill => LEAST_FILL,
    }
}

/// A visible column.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct VisibleColumn {
    /// Index in the columns of the table.
    pub index: usize,
    /// Offset from the left edge of the table.
    pub x: u16,
    /// Width on the screen.
    pub width: u16,
}

/// Places the columns that fit into `available`, from left to right.
pub fn place_columns(columns: &[TableColumn], available: u16) -> Vec<VisibleColumn> {
    let is_needed = |(_, column): &(usize, &TableColumn)| column.width != ColumnWidth::Fixed(0);
    let mut kept: Vec<_> = columns.iter().enumerate().filter(is_needed).collect();
    while kept.len() > 1 && min_width(&kept) > available {
        // The rightmost of the columns with the lowest priority.
        let goes = kept.iter().enumerate().rev().min_by_key(|(_, (_, column))| column.priority);
        let Some((at, _)) = goes else { break };
        kept.remove(at);
    }
    let mut spare = available.saturating_sub(min_width(&kept));
    let has_fill = kept.iter().any(|(_, column)| column.width == ColumnWidth::Fill);
    let grows = |column: &TableColumn| match column.width {
        ColumnWidth::Fixed(_) => false,
        ColumnWidth::Min(_) => !has_fill,
        ColumnWidth::Fill => true,
    };
    let mut growing = kept.iter().filter(|(_, column)| grows(column)).count();
    let mut x = 0;
    let mut placed = Vec::with_capacity(kept.len());
    for (index, column) in kept {
        let mut width = least_of(column.width);
        if grows(column) {
            let part = spare / u16::try_from(growing).unwrap_or(u16::MAX).max(1);
            width += part;
            spare -= part;
            growing -= 1;
        }
        let width = width.min(available.saturating_sub(x));
        if width > 0 {
            placed.push(VisibleColumn { index, x, width });
        }
        x = x.saturating_add(width).saturating_add(SPACE);
    }
    placed
}

/// Minimum width of these columns with the spaces between them.
fn min_width(kept: &[(usize, &TableColumn)]) -> u16 {
    let widths = kept.iter().fold(0_u16, |sum, (_, column)| sum.saturating_add(least_of(column.width)));
    let spaces = u16::try_from(kept.len().saturating_sub(1)).unwrap_or(u16::MAX);
    widths.saturating_add(spaces.saturating_mul(SPACE))
}

#[cfg(test)]
mod tests {
    use super::*;

    fn columns() -> Vec<TableColumn> {
        vec![
            TableColumn::new("No", ColumnWidth::Fixed(4)).align_right().with_priority(5),
            TableColumn::new("Node", ColumnWidth::Min(6)).with_priority(2),
            TableColumn::new("What", ColumnWidth::Fill).with_priority(9),
            TableColumn::new("Data", ColumnWidth::Fixed(8)).with_priority(2),
        ]
    }

    fn placed(available: u16) -> Vec<(usize, u16, u16)> {
        place_columns(&columns(), available)
            .iter()
            .map(|column| (column.index, column.x, column.width))
            .collect()
    }

    #[test]
    fn what_is_left_goes_to_those_that_fill() {
        assert_eq!(placed(41), [(0, 0, 4), (1, 5, 6), (2, 12, 20), (3, 33, 8)]);
        assert_eq!(placed(31), [(0, 0, 4), (1, 5, 6), (2, 12, 10), (3, 23, 8)]);
    }

    #[test]
    fn the_least_important_goes_first_and_of_equal_ones_the_rightmost() {
        assert_eq!(placed(30), [(0, 0, 4), (1, 5, 6), (2, 12, 18)]);
        assert_eq!(placed(20), [(0, 0, 4), (2, 5, 15)]);
        assert_eq!(placed(14), [(2, 0, 14)]);
        assert_eq!(placed(3), [(2, 0, 3)]);
        assert_eq!(placed(0), []);
    }

    #[test]
    fn a_column_without_width_takes_no_space() {
        let columns = [
            TableColumn::new("a", ColumnWidth::Fixed(2)),
            TableColumn::new("b", ColumnWidth::Fixed(0)),
            TableColumn::new("c", ColumnWidth::Fill),
        ];
        let placed: Vec<_> =
            place_columns(&columns, 20).iter().map(|column| (column.index, column.x, column.width)).collect();
        assert_eq!(placed, [(0, 0, 2), (2, 3, 17)]);
    }

    #[test]
    fn without_one_that_fills_those_with_a_minimum_share() {
        let columns =
            [TableColumn::new("a", ColumnWidth::Min(3)), TableColumn::new("b", ColumnWidth::Min(5))];
        let widths: Vec<_> = place_columns(&columns, 14).iter().map(|column| column.width).collect();
        assert_eq!(widths, [5, 8]);
        assert_eq!(place_columns(&[], 14), []);
    }
}
