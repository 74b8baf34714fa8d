//! Drawing shared by all widgets: clipped text and the scroll bar.
//!
//! ```text
//! │spool position err…│        412.3│
//! ```

use ratatui::buffer::Buffer;
use ratatui::layout::{Position, Rect};
use ratatui::style::Style;
use ratatui::text::{Line, Span};

use crate::theme::{Glyph, TextRole, Theme};

/// Alignment of a text within its area.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum TextAlignment {
    /// Left, for names and sentences.
    #[default]
    Left,
    /// Right, for numbers.
    Right,
}

/// A count of lines or columns as a terminal coordinate.
pub fn to_cells(count: usize) -> u16 {
    u16::try_from(count).unwrap_or(u16::MAX)
}

/// A share from 0 to 1 as the nearest of `steps` steps; NaN is 0.
#[expect(clippy::cast_possible_truncation, clippy::cast_sign_loss, reason = "clamped to 0 and `steps`")]
pub fn nearest_step(share: f64, steps: u32) -> u32 {
    // `as` converts NaN to 0.
    (share.clamp(0.0, 1.0) * f64::from(steps)).round() as u32
}

/// Number of columns of a text.
pub fn text_width(text: &str) -> u16 {
    to_cells(Span::raw(text).width())
}

/// Draws a text at `x` in at most `room` columns; returns the column after it.
pub fn put_text(buf: &mut Buffer, x: u16, y: u16, room: u16, text: &str, style: Style) -> u16 {
    if buf.area.contains(Position::new(x, y)) {
        buf.set_stringn(x, y, text, usize::from(room), style).0
    } else {
        x
    }
}

/// The end of a text that fits into `room` columns, with an ellipsis in front if it was cut.
pub fn fit_tail(text: &str, room: u16, theme: &Theme) -> String {
    if text_width(text) <= room {
        return text.to_owned();
    }
    let ellipsis = theme.glyph(Glyph::Ellipsis);
    let room = room.saturating_sub(text_width(ellipsis));
    let mut rest = text;
    while text_width(rest) > room {
        let mut characters = rest.chars();
        characters.next();
        rest = characters.as_str();
    }
    format!("{ellipsis}{rest}")
}

/// Draws a line into the first line of `area`, with an ellipsis if it is cut.
pub fn draw_line(buf: &mut Buffer, area: Rect, line: &Line<'_>, align: TextAlignment, theme: &Theme) {
    let area = area.intersection(buf.area);
    if area.is_empty() {
        return;
    }
    let wanted = to_cells(line.width());
    if wanted <= area.width {
        let before = if align == TextAlignment::Right { area.width - wanted } else { 0 };
        buf.set_line(area.x + before, area.y, line, area.width - before);
        return;
    }
    let ellipsis = theme.glyph(Glyph::Ellipsis);
    let room = area.width.saturating_sub(text_width(ellipsis));
    let (end, _) = buf.set_line(area.x, area.y, line, room);
    put_text(buf, end, area.y, area.right().saturating_sub(end), ellipsis, line.style);
}

/// Draws a scroll bar into the last column of `area`, for `count` rows of one line from row `start`.
pub fn draw_scrollbar(buf: &mut Buffer, area: Rect, start: usize, count: usize, theme: &Theme) {
    let (top, length) = thumb_place(start, usize::from(area.height), count);
    for (line, y) in (area.top()..area.bottom()).enumerate() {
        let is_thumb = (top..top + length).contains(&line);
        let (glyph, role) =
            if is_thumb { (Glyph::Bar, TextRole::Quiet) } else { (Glyph::Vertical, TextRole::Border) };
        put_text(buf, area.right().saturating_sub(1), y, 1, theme.glyph(glyph), theme.role_style(role));
    }
}

/// First line and length of the thumb. It is at the top only if the first row is visible, at the bottom only
/// if the last row is.
fn thumb_place(start: usize, height: usize, count: usize) -> (usize, usize) {
    let length = (height * height / count.max(1)).clamp(1, height.max(1));
    let (lines, rows) = (height.saturating_sub(length), count.saturating_sub(height));
    let top = match start {
        0 => 0,
        _ if start >= rows => lines,
        // 128 bits: a table may have as many rows as `usize` can count.
        _ => usize::try_from(start as u128 * lines as u128 / rows as u128)
            .unwrap_or(lines)
            .clamp(1.min(lines), lines.saturating_sub(1).max(1.min(lines))),
    };
    (top, length)
}

#[cfg(test)]
pub mod tests {
    //! Helpers for the tests of all widgets.

    use super::*;
    use crate::theme::{ColorDepth, LineCharacters, ThemePalette};

    /// A theme without colours.
    pub fn plain_theme(borders: LineCharacters) -> Theme {
        Theme::new(ThemePalette::Dark, ColorDepth::None, borders)
    }

    /// The lines of a buffer without trailing blanks.
    pub fn buffer_lines(buf: &Buffer) -> Vec<String> {
        let row = |y| (buf.area.left()..buf.area.right()).map(move |x| (x, y));
        (buf.area.top()..buf.area.bottom())
            .map(|y| {
                let mut wide = 0;
                let mut text = String::new();
                for at in row(y) {
                    // A wide character covers the next cell.
                    if wide == 0 {
                        text.push_str(buf[at].symbol());
                        wide = text_width(buf[at].symbol()).max(1);
                    }
                    wide -= 1;
                }
                text.trim_end().to_owned()
            })
            .collect()
    }

    /// Draws into small areas and asserts that nothing panics.
    pub fn in_every_small_size(mut draw: impl FnMut(Rect, &mut Buffer)) {
        for width in 0..14 {
            for height in 0..5 {
                let mut buf = Buffer::empty(Rect::new(3, 2, width, height));
                draw(buf.area, &mut buf);
                // An area larger than the screen, as after a resize.
                let mut buf = Buffer::empty(Rect::new(0, 0, width, height));
                draw(Rect::new(1, 1, 40, 12), &mut buf);
            }
        }
    }

    #[test]
    fn cut_text_ends_with_an_ellipsis() {
        let drawn = |text: &str, width, align, borders| {
            let mut buf = Buffer::empty(Rect::new(0, 0, width, 1));
            draw_line(&mut buf, Rect::new(0, 0, width, 1), &Line::from(text), align, &plain_theme(borders));
            buffer_lines(&buf).remove(0)
        };
        assert_eq!(drawn("spool", 6, TextAlignment::Left, LineCharacters::Unicode), "spool");
        assert_eq!(drawn("spool", 6, TextAlignment::Right, LineCharacters::Unicode), " spool");
        assert_eq!(drawn("spool position", 6, TextAlignment::Right, LineCharacters::Unicode), "spool…");
        assert_eq!(drawn("spool position", 6, TextAlignment::Left, LineCharacters::Ascii), "spool~");
        // A wide character without enough room is dropped as a whole.
        assert_eq!(drawn("日本語", 6, TextAlignment::Left, LineCharacters::Unicode), "日本語");
        assert_eq!(drawn("日本語", 4, TextAlignment::Left, LineCharacters::Unicode), "日…");
        assert_eq!(drawn("ab", 1, TextAlignment::Left, LineCharacters::Unicode), "…");
        assert_eq!(drawn("ab", 1, TextAlignment::Left, LineCharacters::Ascii), "~");
    }

    #[test]
    fn the_thumb_is_at_an_end_only_there() {
        assert_eq!(thumb_place(0, 10, 20), (0, 5));
        assert_eq!(thumb_place(1, 10, 20), (1, 5));
        assert_eq!(thumb_place(9, 10, 20), (4, 5));
        assert_eq!(thumb_place(10, 10, 20), (5, 5));
        assert_eq!(thumb_place(1, 10, usize::MAX), (1, 1));
        assert_eq!(thumb_place(5, 1, 20), (0, 1));
        assert_eq!(thumb_place(5, 2, 20), (1, 1));
    }
}
