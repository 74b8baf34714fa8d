//! Text tables with aligned columns.

use crate::escape::escape;

/// Alignment of the cells of a column.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum CellAlignment {
    /// Left-aligned, for text.
    Left,
    /// Right-aligned, for numbers.
    Right,
}

/// A text table; column widths follow the widest cell.
#[derive(Debug)]
pub struct TextTable {
    aligns: Vec<CellAlignment>,
    rows: Vec<Vec<String>>,
}

impl TextTable {
    /// Creates a table with one heading per column; an empty column keeps its heading.
    pub fn new(columns: &[(&str, CellAlignment)]) -> Self {
        let (headings, aligns) = columns.iter().map(|(text, align)| ((*text).to_owned(), *align)).unzip();
        Self { aligns, rows: vec![headings] }
    }

    /// Adds a row; control characters in its cells are escaped.
    pub fn add_row(&mut self, cells: impl IntoIterator<Item = String>) {
        self.rows.push(cells.into_iter().map(|cell| escape(&cell).into_owned()).collect());
    }

    /// Whether the table has no rows.
    pub fn is_empty(&self) -> bool {
        self.rows.len() < 2
    }

    /// Appends the table to `text`, indented by `indent` blanks.
    pub fn write_table(&self, indent: usize, text: &mut String) {
        let width = |column: usize| {
            let cells = self.rows.iter().filter_map(|row| row.get(column));
            cells.map(|cell| cell.chars().count()).max().unwrap_or(0)
        };
        let columns: Vec<_> =
            self.aligns.iter().enumerate().map(|(column, align)| (width(column), *align)).collect();
        for row in &self.rows {
            let mut line = " ".repeat(indent);
            for (cell, (width, align)) in row.iter().zip(&columns) {
                let blanks = " ".repeat(width.saturating_sub(cell.chars().count()));
                match align {
                    CellAlignment::Left => line.extend([cell, blanks.as_str()]),
                    CellAlignment::Right => line.extend([blanks.as_str(), cell]),
                }
                line.push_str("  ");
            }
            text.push_str(line.trim_end());
            text.push('\n');
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn columns_align_and_control_characters_are_shown() {
        let mut table = TextTable::new(&[("Name", CellAlignment::Left), ("ms", CellAlignment::Right)]);
        table.add_row(["größe".into(), "1.5".into()]);
        table.add_row(["a\u{1b}".into(), "100.0".into()]);
        let mut text = String::new();
        table.write_table(2, &mut text);
        assert_eq!(text, "  Name        ms\n  größe      1.5\n  a\\u{1b}  100.0\n");
    }
}
