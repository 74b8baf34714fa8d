//! Bars of values over time, and a progress bar.
//!
//! ```text
//! ▁▁▂▂▂▃▃▂▂▁▁▁▅▆█▇▅▂▂▁      in ASCII: tens of per cent, 01122332211156875221
//! indexing 34 % ██████▊░░░░░░░░░░░░
//! ```

use ratatui::buffer::Buffer;
use ratatui::layout::Rect;
use ratatui::style::Style;

use crate::theme::{Glyph, LineCharacters, TextRole, Theme};
use crate::widgets::draw;

/// Bus loads in per cent from which a bar has the role of a warning and of an error.
const CAUTION: f64 = 60.0;
const BAD: f64 = 80.0;

/// Blocks in eighths of a cell, from below and from the left.
const RISING: [&str; 9] = [" ", "▁", "▂", "▃", "▄", "▅", "▆", "▇", "█"];
const GROWING: [&str; 9] = ["", "▏", "▎", "▍", "▌", "▋", "▊", "▉", "█"];
const DIGITS: [&str; 10] = ["0", "1", "2", "3", "4", "5", "6", "7", "8", "9"];

/// Values over time as bars.
#[derive(Clone, Copy, Debug)]
pub struct Bars<'a> {
    theme: &'a Theme,
    values: &'a [f64],
    is_load: bool,
}

impl<'a> Bars<'a> {
    /// Loads in per cent at equal intervals; NaN leaves a gap.
    pub fn new(theme: &'a Theme, values: &'a [f64]) -> Self {
        Self { theme, values, is_load: true }
    }

    /// Scales the bars to the highest value and draws them without a role, for values of any unit.
    #[must_use]
    pub fn scale_relative(self) -> Self {
        Self { is_load: false, ..self }
    }

    /// Draws the bars over the whole width. A column shows the highest of its values; with fewer values than
    /// columns, bars are several columns wide.
    pub fn render(&self, area: Rect, buf: &mut Buffer) {
        let area = area.intersection(buf.area);
        if area.is_empty() || self.values.is_empty() {
            return;
        }
        let top = if self.is_load { 100.0 } else { highest_value(self.values) };
        let (count, columns) = (self.values.len(), usize::from(area.width));
        for (column, x) in (area.left()..area.right()).enumerate() {
            let start = column * count / columns;
            let end = ((column + 1) * count / columns).max(start + 1);
            let value = highest_value(self.values.get(start..end).unwrap_or_default());
            self.draw_column(value, top, Rect { x, width: 1, ..area }, buf);
        }
    }

    fn draw_column(&self, value: f64, top: f64, area: Rect, buf: &mut Buffer) {
        if !value.is_finite() {
            return;
        }
        let style = self.bar_style(value);
        let share = if top > 0.0 { value / top } else { 0.0 };
        if self.theme.borders() == LineCharacters::Ascii && area.height == 1 {
            let digit = DIGITS.iter().zip(1_u32..).find(|(_, next)| share * 10.0 < f64::from(*next));
            draw::put_text(buf, area.x, area.y, 1, digit.map_or("9", |(digit, _)| digit), style);
            return;
        }
        let mut eighths = draw::nearest_step(share, u32::from(area.height) * 8);
        if share > 0.0 {
            // A value above zero is always visible.
            eighths = eighths.max(1);
        }
        for y in (area.top()..area.bottom()).rev() {
            let filled = usize::try_from(eighths.min(8)).unwrap_or(8);
            eighths = eighths.saturating_sub(8);
            let symbol = match self.theme.borders() {
                LineCharacters::Unicode => RISING.get(filled).copied().unwrap_or(" "),
                LineCharacters::Ascii if filled == 0 => " ",
                LineCharacters::Ascii => self.theme.glyph(Glyph::Bar),
            };
            draw::put_text(buf, area.x, y, 1, symbol, style);
        }
    }

    fn bar_style(&self, value: f64) -> Style {
        self.theme.role_style(if self.is_load { load_role(value) } else { TextRole::Note })
    }
}

/// Role of a load in per cent.
pub fn load_role(percent: f64) -> TextRole {
    if percent >= BAD {
        TextRole::Bad
    } else if percent >= CAUTION {
        TextRole::Caution
    } else {
        TextRole::Good
    }
}

/// The highest value; NaN if there is none.
fn highest_value(values: &[f64]) -> f64 {
    values.iter().copied().filter(|value| value.is_finite()).fold(f64::NAN, f64::max)
}

/// A progress bar in one line.
#[derive(Clone, Copy, Debug)]
pub struct Gauge<'a> {
    theme: &'a Theme,
    share: f64,
    text: &'a str,
}

impl<'a> Gauge<'a> {
    /// A share from 0 to 1 with a text in front. In a small area the bar is dropped first.
    pub fn new(theme: &'a Theme, share: f64, text: &'a str) -> Self {
        Self { theme, share, text }
    }

    /// Draws the text, and the bar if there is room.
    pub fn render(&self, area: Rect, buf: &mut Buffer) {
        let area = Rect { height: area.height.min(1), ..area }.intersection(buf.area);
        let style = self.theme.role_style(TextRole::Note);
        let used = draw::text_width(self.text) + u16::from(!self.text.is_empty());
        draw::put_text(buf, area.x, area.y, area.width, self.text, self.theme.role_style(TextRole::Text));
        let room = area.width.saturating_sub(used);
        if area.is_empty() || room < 3 {
            return;
        }
        let (full, empty) = match self.theme.borders() {
            LineCharacters::Unicode => ("█", "░"),
            LineCharacters::Ascii => ("#", "."),
        };
        let steps = if self.theme.borders() == LineCharacters::Unicode { 8 } else { 1 };
        let mut left = draw::nearest_step(self.share, u32::from(room) * steps);
        for x in area.x + used..area.right() {
            let filled = left.min(steps);
            left -= filled;
            let (symbol, style) = match usize::try_from(filled) {
                Ok(0) | Err(_) => (empty, self.theme.role_style(TextRole::Border)),
                Ok(part) if filled < steps => (GROWING.get(part).copied().unwrap_or(full), style),
                Ok(_) => (full, style),
            };
            draw::put_text(buf, x, area.y, 1, symbol, style);
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::widgets::draw::tests::{buffer_lines, in_every_small_size, plain_theme};

    fn drawn(bars: Bars<'_>, width: u16, height: u16) -> Vec<String> {
        let mut buf = Buffer::empty(Rect::new(0, 0, width, height));
        bars.render(buf.area, &mut buf);
        buffer_lines(&buf)
    }

    const LOADS: [f64; 10] = [0.0, 0.4, 12.5, 25.0, 50.0, 62.0, 88.0, 100.0, 130.0, -5.0];

    #[test]
    fn a_row_of_blocks() {
        let (unicode, ascii) = (plain_theme(LineCharacters::Unicode), plain_theme(LineCharacters::Ascii));
        assert_eq!(drawn(Bars::new(&unicode, &LOADS), 10, 1), [" ▁▁▂▄▅▇██"]);
        assert_eq!(drawn(Bars::new(&ascii, &LOADS), 10, 1), ["0012568990"]);
        // A column shows the higher of two values.
        assert_eq!(drawn(Bars::new(&unicode, &LOADS), 5, 1), ["▁▂▅██"]);
        assert_eq!(drawn(Bars::new(&ascii, &LOADS), 5, 1), ["02699"]);
        // Fewer values than columns fill the whole width.
        assert_eq!(drawn(Bars::new(&ascii, &[10.0, f64::NAN, 90.0]), 9, 1), ["111   999"]);
        assert_eq!(drawn(Bars::new(&ascii, &[]), 9, 1), [""]);
    }

    #[test]
    fn higher_areas_have_finer_steps() {
        let (unicode, ascii) = (plain_theme(LineCharacters::Unicode), plain_theme(LineCharacters::Ascii));
        let loads = [0.0, 25.0, 50.0, 75.0, 100.0];
        assert_eq!(drawn(Bars::new(&unicode, &loads), 5, 2), ["   ▄█", " ▄███"]);
        assert_eq!(drawn(Bars::new(&ascii, &loads), 5, 2), ["   ##", " ####"]);
    }

    #[test]
    fn values_without_a_limit_are_scaled_to_the_highest() {
        let unicode = plain_theme(LineCharacters::Unicode);
        let rates = [0.0, 500.0, f64::INFINITY, 1000.0];
        assert_eq!(drawn(Bars::new(&unicode, &rates).scale_relative(), 4, 1), [" ▄ █"]);
        assert_eq!(drawn(Bars::new(&unicode, &[0.0, 0.0]).scale_relative(), 4, 1), [""]);
        assert_eq!(drawn(Bars::new(&unicode, &[f64::NAN]).scale_relative(), 4, 1), [""]);
    }

    #[test]
    fn loads_are_judged() {
        let judged = [0.0, 59.9, 60.0, 79.9, 80.0, 200.0].map(load_role);
        assert_eq!(
            judged,
            [
                TextRole::Good,
                TextRole::Good,
                TextRole::Caution,
                TextRole::Caution,
                TextRole::Bad,
                TextRole::Bad
            ]
        );
        let theme = plain_theme(LineCharacters::Unicode);
        let mut buf = Buffer::empty(Rect::new(0, 0, 3, 1));
        Bars::new(&theme, &[10.0, 70.0, 90.0]).render(buf.area, &mut buf);
        let styles = [0, 1, 2].map(|x| buf[(x, 0)].modifier);
        assert_eq!(
            styles,
            [TextRole::Good, TextRole::Caution, TextRole::Bad]
                .map(|role| theme.role_style(role).add_modifier)
        );
    }

    #[test]
    fn a_gauge_with_its_text() {
        let gauge = |share, width, borders| {
            let mut buf = Buffer::empty(Rect::new(0, 0, width, 1));
            Gauge::new(&plain_theme(borders), share, "indexing 34 %").render(buf.area, &mut buf);
            buffer_lines(&buf).remove(0)
        };
        assert_eq!(gauge(0.34, 24, LineCharacters::Unicode), "indexing 34 % ███▍░░░░░░");
        assert_eq!(gauge(0.34, 24, LineCharacters::Ascii), "indexing 34 % ###.......");
        assert_eq!(gauge(0.0, 24, LineCharacters::Ascii), "indexing 34 % ..........");
        assert_eq!(gauge(7.0, 24, LineCharacters::Unicode), "indexing 34 % ██████████");
        assert_eq!(gauge(f64::NAN, 24, LineCharacters::Ascii), "indexing 34 % ..........");
        assert_eq!(gauge(0.34, 16, LineCharacters::Unicode), "indexing 34 %");
        assert_eq!(gauge(0.34, 8, LineCharacters::Unicode), "indexing");
    }

    #[test]
    fn every_small_size() {
        for theme in [plain_theme(LineCharacters::Unicode), plain_theme(LineCharacters::Ascii)] {
            in_every_small_size(|area, buf| {
                Bars::new(&theme, &LOADS).render(area, buf);
                Bars::new(&theme, &LOADS).scale_relative().render(area, buf);
                Gauge::new(&theme, 0.5, "x").render(area, buf);
            });
        }
    }
}
