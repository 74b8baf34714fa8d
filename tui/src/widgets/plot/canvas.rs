//! Canvas of dots: eight per braille character, one per ASCII character.
//!
//! ```text
//! ⠀⠀⡠⠒⠉⢢⣀⣀        ··***|**         one series
//! ⠤*⠤⠤══⠤o⠤⠤      ooo====|***      several: each has a mark, `═` is on several curves
//! ```

use ratatui::buffer::Buffer;
use ratatui::layout::{Position, Rect};

use crate::theme::LineCharacters;

/// Bits of a braille character by row from above; left and right column.
const DOTS: [[u8; 2]; 4] = [[0x01, 0x08], [0x02, 0x10], [0x04, 0x20], [0x40, 0x80]];
/// Marks of the series: in ASCII each of their characters, in Unicode one in [`MARK_COLUMNS`] columns.
const MARKS: [char; 6] = ['*', 'o', 'x', '+', '#', '@'];
/// Columns from a mark to the next one of the same series, and from a series to the next one.
const MARK_COLUMNS: usize = 8;
const MARK_SHIFT: usize = 3;

/// Reason of a dot; a later variant covers an earlier one.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, PartialOrd, Ord)]
pub enum DotReason {
    /// The value still applies.
    #[default]
    Hold,
    /// Join from one value to the next.
    Join,
    /// A value.
    Value,
}

#[derive(Clone, Copy, Debug, Default)]
struct CanvasCell {
    dots: u8,
    ink: DotReason,
    series: usize,
    /// The first series with a value.
    first: Option<usize>,
    /// Several series have a value.
    is_shared: bool,
}

/// An area of dots; dot 0, 0 is at the bottom left.
#[derive(Clone, Debug)]
pub struct DotCanvas {
    borders: LineCharacters,
    width: u16,
    height: u16,
    cells: Vec<CanvasCell>,
}

impl DotCanvas {
    /// An empty canvas of `width` × `height` cells.
    pub fn new(width: u16, height: u16, borders: LineCharacters) -> Self {
        let cells = vec![CanvasCell::default(); usize::from(width) * usize::from(height)];
        Self { borders, width, height, cells }
    }

    /// Columns and rows of dots per cell.
    fn per_cell(&self) -> (u32, u32) {
        match self.borders {
            LineCharacters::Unicode => (2, 4),
            LineCharacters::Ascii => (1, 1),
        }
    }

    /// Number of columns of dots.
    pub fn columns(&self) -> u32 {
        u32::from(self.width) * self.per_cell().0
    }

    /// Number of rows of dots.
    pub fn rows(&self) -> u32 {
        u32::from(self.height) * self.per_cell().1
    }

    /// Sets the dots of a column between two rows, inclusive.
    pub fn set_span(&mut self, column: u32, from: u32, to: u32, series: usize, ink: DotReason) {
        for row in from..=to.min(self.rows().saturating_sub(1)) {
            self.set_dot(column, row, series, ink);
        }
    }

    fn set_dot(&mut self, column: u32, row: u32, series: usize, ink: DotReason) {
        let (wide, high) = self.per_cell();
        let Some(row) = self.rows().checked_sub(row + 1).filter(|_| column < self.columns()) else { return };
        let index = row / high * u32::from(self.width) + column / wide;
        let Some(cell) = usize::try_from(index).ok().and_then(|index| self.cells.get_mut(index)) else {
            return;
        };
        let (x, y) = ((column % wide) as usize, (row % high) as usize);
        let dot = DOTS.get(y).and_then(|dots| dots.get(x)).copied().unwrap_or_default();
        // A cell has one colour: a later series covers an earlier one.
        if cell.series != series {
            (cell.series, cell.ink) = (series, ink);
        }
        if ink != DotReason::Join {
            cell.is_shared |= *cell.first.get_or_insert(series) != series;
        }
        cell.dots |= dot;
        cell.ink = cell.ink.max(ink);
    }

    /// Draws the cells with dots in the styles of their series. A series that is alone needs no marks.
    pub fn render(
        &self,
        area: Rect,
        buf: &mut Buffer,
        is_alone: bool,
        style: impl Fn(usize) -> ratatui::style::Style,
    ) {
        let places =
            (area.top()..area.bottom()).flat_map(|y| (area.left()..area.right()).map(move |x| (x, y)));
        for ((x, y), drawn) in places.zip(&self.cells) {
            if drawn.dots == 0 {
                continue;
            }
            if let Some(cell) = buf.cell_mut(Position::from((x, y))) {
                let symbol = self.cell_symbol(*drawn, usize::from(x - area.x), is_alone);
                cell.set_char(symbol).set_style(style(drawn.series));
            }
        }
    }

    fn cell_symbol(&self, cell: CanvasCell, column: usize, is_alone: bool) -> char {
        if cell.is_shared {
            return shared_symbol(self.borders);
        }
        let shift = cell.series.wrapping_mul(MARK_SHIFT);
        let has_mark = !is_alone && column % MARK_COLUMNS == shift % MARK_COLUMNS;
        match (self.borders, cell.ink) {
            (LineCharacters::Ascii, DotReason::Join) => '|',
            (LineCharacters::Ascii, DotReason::Hold) if is_alone => '.',
            (LineCharacters::Ascii, DotReason::Hold | DotReason::Value) => series_mark(cell.series),
            (LineCharacters::Unicode, DotReason::Hold | DotReason::Value) if has_mark => {
                series_mark(cell.series)
            }
            (LineCharacters::Unicode, _) => char::from_u32(0x2800 + u32::from(cell.dots)).unwrap_or(' '),
        }
    }
}

/// Character of values on several curves.
pub fn shared_symbol(borders: LineCharacters) -> char {
    if borders == LineCharacters::Unicode { '═' } else { '=' }
}

/// Mark of a series.
pub fn series_mark(series: usize) -> char {
    MARKS.get(series % MARKS.len()).copied().unwrap_or('*')
}

#[cfg(test)]
mod tests {
    use ratatui::style::Style;

    use super::*;
    use crate::widgets::draw::tests::buffer_lines;

    fn drawn(canvas: &DotCanvas) -> Vec<String> {
        let mut buf = Buffer::empty(Rect::new(0, 0, canvas.width, canvas.height));
        canvas.render(buf.area, &mut buf, true, |_| Style::new());
        buffer_lines(&buf)
    }

    #[test]
    fn dots_are_counted_from_the_bottom_left() {
        let mut canvas = DotCanvas::new(2, 2, LineCharacters::Unicode);
        assert_eq!((canvas.columns(), canvas.rows()), (4, 8));
        canvas.set_span(0, 0, 0, 0, DotReason::Value);
        canvas.set_span(3, 7, 7, 0, DotReason::Value);
        canvas.set_span(1, 0, 3, 0, DotReason::Value);
        assert_eq!(drawn(&canvas), [" ⠈", "⣸"]);
    }

    #[test]
    fn what_is_outside_is_not_drawn() {
        let mut canvas = DotCanvas::new(1, 1, LineCharacters::Unicode);
        canvas.set_span(2, 0, 3, 0, DotReason::Value);
        canvas.set_span(0, 4, u32::MAX, 0, DotReason::Value);
        assert_eq!(drawn(&canvas), [""]);
        canvas.set_span(0, 0, u32::MAX, 0, DotReason::Value);
        assert_eq!(drawn(&canvas), ["⡇"]);
        let mut none = DotCanvas::new(0, 3, LineCharacters::Ascii);
        none.set_span(0, 0, 2, 0, DotReason::Value);
        assert_eq!(drawn(&none), ["", "", ""]);
    }

    #[test]
    fn values_hide_joins_and_curves_that_meet_have_their_own_character() {
        let mut canvas = DotCanvas::new(4, 3, LineCharacters::Ascii);
        canvas.set_span(0, 0, 2, 0, DotReason::Join);
        canvas.set_span(0, 0, 0, 0, DotReason::Value);
        canvas.set_span(1, 0, 0, 0, DotReason::Value);
        canvas.set_span(1, 0, 0, 0, DotReason::Hold);
        canvas.set_span(2, 0, 0, 0, DotReason::Value);
        canvas.set_span(2, 0, 0, 1, DotReason::Hold);
        // A join that crosses a curve is not on both.
        canvas.set_span(3, 0, 0, 0, DotReason::Value);
        canvas.set_span(3, 0, 0, 1, DotReason::Join);
        assert_eq!(drawn(&canvas), ["|", "|", "**=|"]);
    }

    #[test]
    fn several_series_have_marks() {
        let mut canvas = DotCanvas::new(8, 1, LineCharacters::Unicode);
        (0..6).for_each(|column| canvas.set_span(column, 3, 3, 0, DotReason::Value));
        (4..8).for_each(|column| canvas.set_span(column, 0, 0, 1, DotReason::Value));
        canvas.set_span(8, 0, 3, 1, DotReason::Join);
        (9..16).for_each(|column| canvas.set_span(column, 0, 0, 2, DotReason::Hold));
        let mut buf = Buffer::empty(Rect::new(0, 0, 8, 1));
        canvas.render(buf.area, &mut buf, false, |_| Style::new());
        assert_eq!(buffer_lines(&buf), ["*⠉═o⣇⣀x⣀"]);
    }
}
