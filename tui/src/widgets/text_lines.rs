//! Styled text, wrapped at words and scrolled.
//!
//! ```text
//! node-lost                          █
//!   The node sent no heartbeat for   │  wrapped rows keep the indent
//!   longer than its 0x1017 promises. │
//! ```

use std::ops::Range;

use ratatui::buffer::Buffer;
use ratatui::layout::Rect;
use ratatui::style::Style;
use ratatui::text::{Line, StyledGrapheme};

use crate::theme::Theme;
use crate::widgets::draw;

/// A text with its scroll position.
#[derive(Clone, Copy, Debug)]
pub struct TextLines<'a> {
    theme: &'a Theme,
    lines: &'a [Line<'a>],
    scroll: usize,
}

impl<'a> TextLines<'a> {
    /// A text at its start.
    pub fn new(theme: &'a Theme, lines: &'a [Line<'a>]) -> Self {
        Self { theme, lines, scroll: 0 }
    }

    /// Skips `scroll` screen lines, but at most as many as show the end.
    #[must_use]
    pub fn with_scroll(self, scroll: usize) -> Self {
        Self { scroll, ..self }
    }

    /// Number of screen lines at a width.
    pub fn line_count(&self, width: u16) -> usize {
        self.lines.iter().map(|line| row_count(line, width)).sum()
    }

    /// Scroll position that shows the end.
    pub fn last_scroll(&self, area: Rect) -> usize {
        self.inside_area(area).1.saturating_sub(usize::from(area.height))
    }

    /// Draws the text.
    pub fn render(&self, area: Rect, buf: &mut Buffer) {
        let area = area.intersection(buf.area);
        if area.is_empty() {
            return;
        }
        let (inside, total) = self.inside_area(area);
        let scroll = self.scroll.min(total.saturating_sub(usize::from(area.height)));
        let (mut skipped, mut y) = (0, inside.y);
        for line in self.lines {
            if y == inside.bottom() {
                break;
            }
            let rows = if skipped < scroll { row_count(line, inside.width) } else { 0 };
            if skipped + rows <= scroll && rows > 0 {
                skipped += rows;
                continue;
            }
            let line = WrappedLine::new(line, inside.width);
            for (at, row) in line.rows.iter().enumerate().skip(scroll - skipped) {
                if y == inside.bottom() {
                    break;
                }
                let indent = if at == 0 { 0 } else { line.indent };
                line.draw_row(row.clone(), inside.x + indent, y, inside.right(), buf);
                y += 1;
            }
            skipped = scroll;
        }
        if inside.width < area.width {
            draw::draw_scrollbar(buf, area, scroll, total, self.theme);
        }
    }

    /// The area without the scroll bar, which is drawn only if the text does not fit, and the number of screen lines.
    fn inside_area(&self, area: Rect) -> (Rect, usize) {
        let total = self.line_count(area.width);
        if area.width <= 2 || total <= usize::from(area.height) {
            return (area, total);
        }
        let inside = Rect { width: area.width - 1, ..area };
        (inside, self.line_count(inside.width))
    }
}

/// Number of rows of a line at a width. All lines of a text are counted for each drawing, so most of them, whose characters
/// have one column, are counted without being split into graphemes.
fn row_count(line: &Line<'_>, width: u16) -> usize {
    let characters = || line.spans.iter().flat_map(|span| span.content.chars());
    if !characters().all(has_one_column) {
        return WrappedLine::new(line, width).rows.len();
    }
    if characters().count() <= usize::from(width) {
        return 1;
    }
    let blanks: Vec<bool> = characters().map(|character| character == ' ').collect();
    wrap_rows(&blanks, width, |is_blank| (*is_blank, 1)).0.len()
}

/// Whether a character is a grapheme of one column, whatever follows that is one too: Latin letters, punctuation, arrows.
fn has_one_column(character: char) -> bool {
    matches!(character, ' '..='~' | '\u{A1}'..='\u{AC}' | '\u{AE}'..='\u{FF}' | '\u{2010}'..='\u{2027}' | '\u{2190}'..='\u{21FF}')
}

/// A line broken into rows.
struct WrappedLine<'a> {
    graphemes: Vec<StyledGrapheme<'a>>,
    rows: Vec<Range<usize>>,
    /// Indent of all rows after the first.
    indent: u16,
}

impl<'a> WrappedLine<'a> {
    fn new(line: &'a Line<'_>, width: u16) -> Self {
        let graphemes: Vec<_> = line.styled_graphemes(Style::new()).collect();
        let (rows, indent) = wrap_rows(&graphemes, width, |grapheme| {
            (grapheme.symbol == " ", draw::text_width(grapheme.symbol))
        });
        Self { graphemes, rows, indent }
    }

    fn draw_row(&self, row: Range<usize>, mut x: u16, y: u16, right: u16, buf: &mut Buffer) {
        for grapheme in self.graphemes.get(row).unwrap_or_default() {
            x = draw::put_text(buf, x, y, right.saturating_sub(x), grapheme.symbol, grapheme.style);
        }
    }
}

/// Rows of graphemes, and the indent of all rows after the first. `measure` tells whether a grapheme is a blank, and its columns.
fn wrap_rows<T>(
    graphemes: &[T],
    width: u16,
    measure: impl Fn(&T) -> (bool, u16),
) -> (Vec<Range<usize>>, u16) {
    let blank = graphemes.iter().take_while(|grapheme| measure(grapheme).0).count();
    let indent = Some(draw::to_cells(blank)).filter(|indent| *indent <= width / 2).unwrap_or(0);
    let mut rows = Vec::new();
    let mut start = 0;
    loop {
        let room = if start == 0 { width } else { width - indent };
        let first = if start == 0 { usize::from(indent) } else { 0 };
        let (end, next) = row_end(graphemes.get(start..).unwrap_or_default(), room, first, &measure);
        rows.push(start..start + end);
        start += next;
        if start >= graphemes.len() {
            break;
        }
    }
    (rows, indent)
}

/// Number of graphemes in the row, and number consumed: the blanks at the break are dropped. Breaks are at
/// `first` or later.
fn row_end<T>(
    graphemes: &[T],
    room: u16,
    first: usize,
    measure: impl Fn(&T) -> (bool, u16),
) -> (usize, usize) {
    let mut used = 0;
    let mut blank = None;
    for (at, grapheme) in graphemes.iter().enumerate() {
        let (is_blank, columns) = measure(grapheme);
        if is_blank && at >= first {
            blank = Some(at);
        }
        used += columns;
        if used > room {
            // A word longer than a row is broken anywhere. Each row takes at least one grapheme, so that the
            // loop ends.
            let end = blank.filter(|blank| *blank > 0).unwrap_or(at.max(1));
            let rest = graphemes.get(end..).unwrap_or_default();
            let blanks = rest.iter().take_while(|grapheme| measure(grapheme).0).count();
            return (end, end + blanks);
        }
    }
    (graphemes.len(), graphemes.len())
}

#[cfg(test)]
mod tests {
    use ratatui::style::Stylize as _;

    use super::*;
    use crate::theme::LineCharacters;
    use crate::widgets::draw::tests::{buffer_lines, in_every_small_size, plain_theme};

    fn drawn(lines: &[Line<'_>], width: u16, height: u16, scroll: usize) -> Vec<String> {
        let mut buf = Buffer::empty(Rect::new(0, 0, width, height));
        TextLines::new(&plain_theme(LineCharacters::Unicode), lines)
            .with_scroll(scroll)
            .render(buf.area, &mut buf);
        buffer_lines(&buf)
    }

    #[test]
    fn wraps_at_words_and_keeps_the_indent() {
        let lines = [
            Line::from("node-lost"),
            Line::default(),
            Line::from("  no heartbeat for  longer than 0x1017 says"),
        ];
        assert_eq!(
            drawn(&lines, 20, 6, 0),
            ["node-lost", "", "  no heartbeat for", "  longer than 0x1017", "  says", ""]
        );
        let plain = plain_theme(LineCharacters::Unicode);
        let text = TextLines::new(&plain, &lines);
        assert_eq!((text.line_count(20), text.line_count(80), text.line_count(9)), (5, 3, 9));
    }

    #[test]
    fn long_words_and_wide_characters_are_broken_anywhere() {
        assert_eq!(drawn(&[Line::from("0123456789")], 4, 3, 0), ["0123", "4567", "89"]);
        assert_eq!(drawn(&[Line::from("日本語")], 5, 2, 0), ["日本", "語"]);
        assert_eq!(drawn(&[Line::from("日")], 1, 2, 0), ["", ""]);
        assert_eq!(drawn(&[Line::from("exactly so")], 10, 2, 0), ["exactly so", ""]);
        assert_eq!(drawn(&[Line::from("exactly  so")], 8, 2, 0), ["exactly", "so"]);
    }

    #[test]
    fn styles_go_on_over_a_break() {
        let lines = [Line::from(vec!["a ".into(), "bold word".bold(), " z".into()])];
        let mut buf = Buffer::empty(Rect::new(0, 0, 7, 2));
        TextLines::new(&plain_theme(LineCharacters::Unicode), &lines).render(buf.area, &mut buf);
        let mut expected = Buffer::with_lines([
            Line::from(vec!["a ".into(), "bold".bold(), " ".into()]),
            Line::from(vec!["word".bold(), " z ".into()]),
        ]);
        expected.set_style(Rect::new(6, 0, 1, 1), Style::new());
        assert_eq!(buf, expected);
    }

    #[test]
    fn scrolls_to_the_end_and_no_further() {
        let lines: Vec<_> = (1..=9).map(|number| Line::from(format!("line {number}"))).collect();
        assert_eq!(drawn(&lines, 10, 3, 0), ["line 1   █", "line 2   │", "line 3   │"]);
        assert_eq!(drawn(&lines, 10, 3, 4), ["line 5   │", "line 6   █", "line 7   │"]);
        assert_eq!(drawn(&lines, 10, 3, 99), ["line 7   │", "line 8   │", "line 9   █"]);
        let theme = plain_theme(LineCharacters::Unicode);
        assert_eq!(TextLines::new(&theme, &lines).last_scroll(Rect::new(0, 0, 10, 3)), 6);
        assert_eq!(TextLines::new(&theme, &lines).last_scroll(Rect::new(0, 0, 10, 9)), 0);
        assert_eq!(drawn(&[], 10, 2, 5), ["", ""]);
    }

    #[test]
    fn characters_of_one_column_are_counted_as_graphemes_are() {
        for character in ('\0'..='\u{FFFF}').filter(|character| has_one_column(*character)) {
            assert_eq!(draw::text_width(&character.to_string()), 1, "{character:?}");
        }
        let texts = [
            "  +2 ms  ACTIVE → FAULT HOLD × 3 although…",
            "",
            "        ",
            "0123456789abcdef",
            " a  b   c ",
            "±1 °C  ¿–?",
        ];
        for text in texts {
            for width in 1..=45 {
                let line = Line::from(vec![text.into(), text.into()]);
                assert_eq!(
                    row_count(&line, width),
                    WrappedLine::new(&line, width).rows.len(),
                    "{text:?} at {width}"
                );
            }
        }
    }

    #[test]
    fn every_small_size() {
        let lines = [Line::from("   日本語 a long_long_long_word   "), Line::default(), Line::from("      ")];
        let theme = plain_theme(LineCharacters::Ascii);
        for scroll in [0, 3, 99] {
            in_every_small_size(|area, buf| {
                TextLines::new(&theme, &lines).with_scroll(scroll).render(area, buf);
            });
        }
    }
}
