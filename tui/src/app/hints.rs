//! The key bar: whole hints, the most needed first.
//!
//! ```text
//! ? help  q quit  ] finding  0 why  enter open  f filter  ← → move  …
//! ```

use ratatui::buffer::Buffer;
use ratatui::layout::Rect;

use crate::action::Action;
use crate::keymap::{Keymap, binding};
use crate::theme::{Borders, Glyph, Role, Theme};
use crate::widgets::draw;

/// Hints of all panes: before and after those of the pane.
const FIRST: [Action; 4] = [Action::Help, Action::Quit, Action::NextFinding, Action::Pane(0)];
const LAST: [Action; 4] = [Action::Layout, Action::Zoom, Action::Top, Action::Bottom];

/// Symbols of keys whose names are longer.
const SYMBOLS: [(&str, &str); 4] = [("left", "←"), ("right", "→"), ("up", "↑"), ("down", "↓")];

/// A key, or keys with the same effect, and what they do.
#[derive(Debug, PartialEq, Eq)]
pub(super) struct Hint {
    key: String,
    does: String,
}

impl Hint {
    /// `j/k scroll`.
    pub(super) fn new(key: &str, does: &str) -> Self {
        Self { key: key.to_owned(), does: does.to_owned() }
    }

    fn width(&self) -> u16 {
        draw::width(&self.key).saturating_add(1).saturating_add(draw::width(&self.does))
    }
}

/// Hints of a pane with these actions.
pub(super) fn of_pane(keymap: &Keymap, actions: &[Action], is_why: bool, theme: &Theme) -> Vec<Hint> {
    let first = FIRST.into_iter().filter(|action| !(is_why && *action == Action::Pane(0)));
    let own = actions.iter().copied().filter(|action| !FIRST.contains(action) && !LAST.contains(action));
    let mut hints: Vec<Hint> = Vec::new();
    for action in first.chain(own).chain(LAST) {
        let Some((binding, name)) = binding(action).zip(keymap.keys(action).first()) else { continue };
        let symbol = SYMBOLS.iter().find(|(long, _)| long == name && theme.borders() == Borders::Unicode);
        let key = symbol.map_or(name.as_str(), |(_, symbol)| symbol);
        let does = if action == Action::Pane(0) { "why" } else { binding.short };
        match hints.last_mut().filter(|last| last.does == does) {
            Some(last) => last.key = format!("{} {key}", last.key),
            None => hints.push(Hint::new(key, does)),
        }
    }
    hints
}

/// Draws the hints that fit completely; an ellipsis replaces the others.
pub(super) fn draw(theme: &Theme, hints: &[Hint], area: Rect, buf: &mut Buffer) {
    let ellipsis = theme.glyph(Glyph::Ellipsis);
    let mut x = area.x;
    for (index, hint) in hints.iter().enumerate() {
        let is_last = index + 1 == hints.len();
        let behind = if is_last { 0 } else { draw::width(ellipsis).saturating_add(2) };
        if x.saturating_add(hint.width()).saturating_add(behind) > area.right() {
            draw::put(buf, x, area.y, area.right().saturating_sub(x), ellipsis, theme.style(Role::Quiet));
            return;
        }
        x = draw::put(buf, x, area.y, area.right() - x, &hint.key, theme.style(Role::Key)) + 1;
        x = draw::put(buf, x, area.y, area.right() - x, &hint.does, theme.style(Role::Quiet)) + 2;
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::theme::{Depth, Palette};
    use crate::widgets::draw::tests::{in_every_small_size, plain, shown};

    fn bar(actions: &[Action], width: u16, borders: Borders) -> String {
        let theme = Theme::new(Palette::Dark, Depth::None, borders);
        let mut buf = Buffer::empty(Rect::new(0, 0, width, 1));
        draw(&theme, &of_pane(&Keymap::default(), actions, false, &theme), buf.area, &mut buf);
        shown(&buf).remove(0)
    }

    #[test]
    fn hints_are_whole_and_the_needed_ones_stay() {
        let actions = [Action::Filter, Action::Left, Action::Right, Action::NextFinding];
        let all = bar(&actions, 100, Borders::Unicode);
        assert_eq!(
            all,
            "? help  q quit  ] finding  0 why  f filter  ← → move  | layout  \\ zoom  g start  G end"
        );
        assert_eq!(bar(&actions, 50, Borders::Unicode), "? help  q quit  ] finding  0 why  f filter  …");
        assert_eq!(bar(&actions, 30, Borders::Unicode), "? help  q quit  ] finding  …");
        assert!(bar(&actions, 100, Borders::Ascii).contains("left right move"));
    }

    #[test]
    fn every_small_size() {
        let theme = plain(Borders::Unicode);
        let hints = of_pane(&Keymap::default(), &[Action::Open], true, &theme);
        in_every_small_size(|area, buf| draw(&theme, &hints, area, buf));
    }
}
