//! The key bar: whole hints, the most needed first.
//!
//! ```text
//! ? help  q quit  ] finding  0 why  enter open  f filter  ← → move  …
//! ```

use ratatui::buffer::Buffer;
use ratatui::layout::Rect;

use crate::action::Action;
use crate::keymap::{Keymap, default_binding};
use crate::theme::{Glyph, LineCharacters, TextRole, Theme};
use crate::widgets::draw;

/// Hints of all panes: before and after those of the pane.
const FIRST: [Action; 4] = [Action::Help, Action::Quit, Action::NextFinding, Action::Pane(0)];
const LAST: [Action; 4] = [Action::Layout, Action::Zoom, Action::Top, Action::Bottom];

/// Symbols of keys whose names are longer.
const SYMBOLS: [(&str, &str); 4] = [("left", "←"), ("right", "→"), ("up", "↑"), ("down", "↓")];

/// A key, or keys with the same effect, and what they do.
#[derive(Debug, PartialEq, Eq)]
pub(in crate::app) struct KeyHint {
    key: String,
    does: String,
}

impl KeyHint {
    /// `j/k scroll`.
    pub(in crate::app) fn new(key: &str, does: &str) -> Self {
        Self { key: key.to_owned(), does: does.to_owned() }
    }

    fn hint_width(&self) -> u16 {
        draw::text_width(&self.key).saturating_add(1).saturating_add(draw::text_width(&self.does))
    }
}

/// Hints of a pane with these actions.
pub(in crate::app) fn of_pane(
    keymap: &Keymap,
    actions: &[Action],
    is_why: bool,
    theme: &Theme,
) -> Vec<KeyHint> {
    let first = FIRST.into_iter().filter(|action| !(is_why && *action == Action::Pane(0)));
    let own = actions.iter().copied().filter(|action| !FIRST.contains(action) && !LAST.contains(action));
    let mut hints: Vec<KeyHint> = Vec::new();
    for action in first.chain(own).chain(LAST) {
        let Some((binding, name)) = default_binding(action).zip(keymap.keys_for(action).first()) else {
            continue;
        };
        let symbol =
            SYMBOLS.iter().find(|(long, _)| long == name && theme.borders() == LineCharacters::Unicode);
        let key = symbol.map_or(name.as_str(), |(_, symbol)| symbol);
        let does = if action == Action::Pane(0) { "why" } else { binding.short };
        match hints.last_mut().filter(|last| last.does == does) {
            Some(last) => last.key = format!("{} {key}", last.key),
            None => hints.push(KeyHint::new(key, does)),
        }
    }
    hints
}

/// Draws the hints that fit completely; an ellipsis replaces the others.
pub(in crate::app) fn draw_hints(theme: &Theme, hints: &[KeyHint], area: Rect, buf: &mut Buffer) {
    let ellipsis = theme.glyph(Glyph::Ellipsis);
    let mut x = area.x;
    for (index, hint) in hints.iter().enumerate() {
        let is_last = index + 1 == hints.len();
        let behind = if is_last { 0 } else { draw::text_width(ellipsis).saturating_add(2) };
        if x.saturating_add(hint.hint_width()).saturating_add(behind) > area.right() {
            draw::put_text(
                buf,
                x,
                area.y,
                area.right().saturating_sub(x),
                ellipsis,
                theme.role_style(TextRole::Quiet),
            );
            return;
        }
        x = draw::put_text(buf, x, area.y, area.right() - x, &hint.key, theme.role_style(TextRole::Key)) + 1;
        x = draw::put_text(buf, x, area.y, area.right() - x, &hint.does, theme.role_style(TextRole::Quiet))
            + 2;
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::theme::{ColorDepth, ThemePalette};
    use crate::widgets::draw::tests::{buffer_lines, in_every_small_size, plain_theme};

    fn bar(actions: &[Action], width: u16, borders: LineCharacters) -> String {
        let theme = Theme::new(ThemePalette::Dark, ColorDepth::None, borders);
        let mut buf = Buffer::empty(Rect::new(0, 0, width, 1));
        draw_hints(&theme, &of_pane(&Keymap::default(), actions, false, &theme), buf.area, &mut buf);
        buffer_lines(&buf).remove(0)
    }

    #[test]
    fn hints_are_whole_and_the_needed_ones_stay() {
        let actions = [Action::Filter, Action::Left, Action::Right, Action::NextFinding];
        let all = bar(&actions, 100, LineCharacters::Unicode);
        assert_eq!(
            all,
            "? help  q quit  ] finding  0 why  f filter  ← → move  | layout  \\ zoom  g start  G end"
        );
        assert_eq!(
            bar(&actions, 50, LineCharacters::Unicode),
            "? help  q quit  ] finding  0 why  f filter  …"
        );
        assert_eq!(bar(&actions, 30, LineCharacters::Unicode), "? help  q quit  ] finding  …");
        assert!(bar(&actions, 100, LineCharacters::Ascii).contains("left right move"));
    }

    #[test]
    fn every_small_size() {
        let theme = plain_theme(LineCharacters::Unicode);
        let hints = of_pane(&Keymap::default(), &[Action::Open], true, &theme);
        in_every_small_size(|area, buf| draw_hints(&theme, &hints, area, buf));
    }
}
