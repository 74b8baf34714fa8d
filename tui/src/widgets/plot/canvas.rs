//! Dots in cells: eight to a braille character, or one to an ASCII character.
//!
//! ```text
//! ⠀⠀⡠⠒⠉⢢⣀⣀        ··***|**
//! ```

use ratatui::buffer::Buffer;
use ratatui::layout::{Position, Rect};

use crate::theme::Borders;

/// The dots of a braille character by row from above, left and right.
const DOTS: [[u8; 2]; 4] = [[0x01, 0x08], [0x02, 0x10], [0x04, 0x20], [0x40, 0x80]];
/// What stands for values in ASCII, a character a series, since there may be no colours either.
const MARKS: [char; 6] = ['*', 'o', 'x', '+', '#', '@'];

/// Why a dot is where it is; what says more hides what says less.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, PartialOrd, Ord)]
pub enum Ink {
    /// The value still holds.
    #[default]
    Hold,
    /// From one value to the next.
    Join,
    /// A value was there.
    Value,
}

#[derive(Clone, Copy, Debug, Default)]
struct Cell {
    dots: u8,
    ink: Ink,
    series: usize,
}

/// An area to draw dots on; dot 0, 0 is at the bottom left.
#[derive(Clone, Debug)]
pub struct Canvas {
    borders: Borders,
    width: u16,
    height: u16,
    cells: Vec<Cell>,
}

impl Canvas {
    /// An empty canvas of so many cells.
    pub fn new(width: u16, height: u16, borders: Borders) -> Self {
        let cells = vec![Cell::default(); usize::from(width) * usize::from(height)];
        Self { borders, width, height, cells }
    }

    /// Columns and rows of dots in a cell.
    fn per_cell(&self) -> (u32, u32) {
        match self.borders {
            Borders::Unicode => (2, 4),
            Borders::Ascii => (1, 1),
        }
    }

    /// Columns of dots.
    pub fn columns(&self) -> u32 {
        u32::from(self.width) * self.per_cell().0
    }

    /// Rows of dots.
    pub fn rows(&self) -> u32 {
        u32::from(self.height) * self.per_cell().1
    }

    /// Sets the dots of a column between two rows, both included.
    pub fn span(&mut self, column: u32, from: u32, to: u32, series: usize, ink: Ink) {
        for row in from..=to.min(self.rows().saturating_sub(1)) {
            self.set(column, row, series, ink);
        }
    }

    fn set(&mut self, column: u32, row: u32, series: usize, ink: Ink) {
        let (wide, high) = self.per_cell();
        let Some(row) = self.rows().checked_sub(row + 1).filter(|_| column < self.columns()) else { return };
        let index = row / high * u32::from(self.width) + column / wide;
        let Some(cell) = usize::try_from(index).ok().and_then(|index| self.cells.get_mut(index)) else {
            return;
        };
        let (x, y) = ((column % wide) as usize, (row % high) as usize);
        cell.dots |= DOTS.get(y).and_then(|dots| dots.get(x)).copied().unwrap_or_default();
        // The later series lies above the earlier one, since a cell has one colour.
        if cell.series != series {
            (cell.series, cell.ink) = (series, ink);
        }
        cell.ink = cell.ink.max(ink);
    }

    /// Draws the cells that have dots, each in the style of its series.
    pub fn render(&self, area: Rect, buf: &mut Buffer, style: impl Fn(usize) -> ratatui::style::Style) {
        let places =
            (area.top()..area.bottom()).flat_map(|y| (area.left()..area.right()).map(move |x| (x, y)));
        for (place, drawn) in places.zip(&self.cells) {
            if drawn.dots == 0 {
                continue;
            }
            if let Some(cell) = buf.cell_mut(Position::from(place)) {
                cell.set_char(self.symbol(*drawn)).set_style(style(drawn.series));
            }
        }
    }

    fn symbol(&self, cell: Cell) -> char {
        match (self.borders, cell.ink) {
            (Borders::Unicode, _) => char::from_u32(0x2800 + u32::from(cell.dots)).unwrap_or(' '),
            (Borders::Ascii, Ink::Hold) => '.',
            (Borders::Ascii, Ink::Join) => '|',
            (Borders::Ascii, Ink::Value) => mark(cell.series),
        }
    }
}

/// What stands for the values of a series in ASCII.
pub fn mark(series: usize) -> char {
    MARKS.get(series % MARKS.len()).copied().unwrap_or('*')
}

#[cfg(test)]
mod tests {
    use ratatui::style::Style;

    use super::*;
    use crate::widgets::draw::tests::shown;

    fn drawn(canvas: &Canvas) -> Vec<String> {
        let mut buf = Buffer::empty(Rect::new(0, 0, canvas.width, canvas.height));
        canvas.render(buf.area, &mut buf, |_| Style::new());
        shown(&buf)
    }

    #[test]
    fn dots_are_counted_from_the_bottom_left() {
        let mut canvas = Canvas::new(2, 2, Borders::Unicode);
        assert_eq!((canvas.columns(), canvas.rows()), (4, 8));
        canvas.span(0, 0, 0, 0, Ink::Value);
        canvas.span(3, 7, 7, 0, Ink::Value);
        canvas.span(1, 0, 3, 0, Ink::Value);
        assert_eq!(drawn(&canvas), [" ⠈", "⣸"]);
    }

    #[test]
    fn what_is_outside_is_not_drawn() {
        let mut canvas = Canvas::new(1, 1, Borders::Unicode);
        canvas.span(2, 0, 3, 0, Ink::Value);
        canvas.span(0, 4, u32::MAX, 0, Ink::Value);
        assert_eq!(drawn(&canvas), [""]);
        canvas.span(0, 0, u32::MAX, 0, Ink::Value);
        assert_eq!(drawn(&canvas), ["⡇"]);
        let mut none = Canvas::new(0, 3, Borders::Ascii);
        none.span(0, 0, 2, 0, Ink::Value);
        assert_eq!(drawn(&none), ["", "", ""]);
    }

    #[test]
    fn values_hide_joins_and_later_series_earlier_ones() {
        let mut canvas = Canvas::new(3, 3, Borders::Ascii);
        canvas.span(0, 0, 2, 0, Ink::Join);
        canvas.span(0, 0, 0, 0, Ink::Value);
        canvas.span(1, 0, 0, 0, Ink::Value);
        canvas.span(1, 0, 0, 0, Ink::Hold);
        canvas.span(2, 0, 0, 0, Ink::Value);
        canvas.span(2, 0, 0, 1, Ink::Hold);
        assert_eq!(drawn(&canvas), ["|", "|", "**."]);
    }
}
