//! A line editor with a history and an error mark.
//!
//! ```text
//! filter: sdo.index == 0x60zz█
//!                          ^ not a hexadecimal digit
//! ```

use std::borrow::Cow;

use ratatui::buffer::Buffer;
use ratatui::crossterm::event::{KeyCode, KeyEvent, KeyEventKind, KeyModifiers};
use ratatui::layout::{Position, Rect};
use ratatui::text::Line;

use crate::theme::{Role, Theme};
use crate::widgets::draw;

/// Maximum number of lines in the history.
const HISTORY: usize = 200;
/// Minimum width of the text; below it the label is shortened.
const LEAST_TEXT: u16 = 8;

/// Effect of a key.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum PromptEvent {
    /// The text or the cursor may have changed.
    Changed,
    /// Submitted by the user.
    Submitted,
    /// Cancelled by the user.
    Cancelled,
    /// The key has no effect on the prompt.
    Ignored,
}

/// Edit command of a key.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Edit {
    Insert(char),
    Move(CursorReach),
    Delete(CursorReach),
    Older,
    Newer,
    Submit,
    Cancel,
}

/// Distance from the cursor.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum CursorReach {
    CharLeft,
    CharRight,
    WordLeft,
    WordRight,
    Home,
    End,
}

/// The edited line with its history.
#[derive(Clone, Debug, Default)]
pub struct Prompt {
    label: Cow<'static, str>,
    text: String,
    /// Byte offset at a character boundary.
    cursor: usize,
    history: Vec<String>,
    /// Index of the recalled line of the history.
    recalled: Option<usize>,
    /// Text typed before a line was recalled.
    draft: String,
    error: Option<(usize, String)>,
}

impl Prompt {
    /// An empty line.
    pub fn new(label: impl Into<Cow<'static, str>>) -> Self {
        Self { label: label.into(), ..Self::default() }
    }

    /// Sets the history, oldest line first.
    #[must_use]
    pub fn with_history(self, lines: impl IntoIterator<Item = String>) -> Self {
        Self { history: lines.into_iter().collect(), ..self }
    }

    /// The text typed so far.
    pub fn text(&self) -> &str {
        &self.text
    }

    /// Byte offset of the cursor.
    pub fn cursor(&self) -> usize {
        self.cursor
    }

    /// Submitted lines, oldest first.
    pub fn history(&self) -> &[String] {
        &self.history
    }

    /// Replaces the text and moves the cursor to its end.
    pub fn set_text(&mut self, text: &str) {
        self.text.clear();
        self.text.extend(text.chars().filter_map(typeable));
        self.cursor = self.text.len();
        self.recalled = None;
        self.error = None;
    }

    /// Shows an error at a byte offset until the text changes.
    pub fn set_error(&mut self, offset: usize, message: impl Into<String>) {
        self.error = Some((offset, message.into()));
    }

    /// Removes the error.
    pub fn clear_error(&mut self) {
        self.error = None;
    }

    /// Inserts a text at the cursor; line breaks become spaces.
    pub fn paste(&mut self, text: &str) -> PromptEvent {
        // A copied line may end with a line break.
        for typed in text.trim_end_matches(['\r', '\n']).chars().filter_map(typeable) {
            self.insert(typed);
        }
        PromptEvent::Changed
    }

    /// Applies a key.
    pub fn key(&mut self, key: KeyEvent) -> PromptEvent {
        let Some(edit) = edit_of(key) else { return PromptEvent::Ignored };
        match edit {
            Edit::Insert(typed) => self.insert(typed),
            Edit::Move(reach) => self.cursor = self.reached(reach),
            Edit::Delete(reach) => self.delete(reach),
            Edit::Older => self.recall(true),
            Edit::Newer => self.recall(false),
            Edit::Submit => {
                self.remember();
                return PromptEvent::Submitted;
            }
            Edit::Cancel => return PromptEvent::Cancelled,
        }
        PromptEvent::Changed
    }

    /// Draws the line, and the error in a second line if there is one.
    pub fn render(&self, theme: &Theme, area: Rect, buf: &mut Buffer) {
        let area = area.intersection(buf.area);
        if area.is_empty() {
            return;
        }
        let label = draw::width(&self.label) + u16::from(!self.label.is_empty());
        let label = if area.width >= label.saturating_add(LEAST_TEXT) { label } else { 0 };
        if label > 0 {
            draw::put(buf, area.x, area.y, label, &self.label, theme.style(Role::Key));
        }
        let place = Rect { x: area.x + label, width: area.width - label, height: 1, ..area };
        let start = self.first_shown(place.width);
        let shown = self.text.get(start..).unwrap_or_default();
        draw::put(buf, place.x, place.y, place.width, shown, theme.style(Role::Text));
        let before = self.text.get(start..self.cursor).unwrap_or_default();
        if let Some(cell) = buf.cell_mut(Position::new(place.x.saturating_add(draw::width(before)), place.y))
        {
            cell.set_style(theme.style(Role::Cursor));
        }
        if area.height > 1 {
            self.draw_error(theme, start, Rect { y: area.y + 1, ..place }, area, buf);
        }
    }

    /// Draws a caret below the error and the message on the side with enough room.
    fn draw_error(&self, theme: &Theme, start: usize, place: Rect, area: Rect, buf: &mut Buffer) {
        let Some((offset, message)) = &self.error else { return };
        let style = theme.style(Role::Bad);
        let before = self.text.get(start..(*offset).min(self.text.len())).unwrap_or_default();
        let caret = place.x.saturating_add(draw::width(before)).min(place.right().saturating_sub(1));
        draw::put(buf, caret, place.y, 1, "^", style);
        let line = Line::styled(message.as_str(), style);
        let wanted = draw::width(message);
        let (left, right) = (caret - area.x, place.right() - caret - 1);
        if wanted < right || right >= left {
            let x = caret.saturating_add(2);
            let room = Rect { x, width: place.right().saturating_sub(x), height: 1, ..place };
            draw::line(buf, room, &line, draw::Align::Left, theme);
        } else {
            let room = Rect { x: area.x, width: left.saturating_sub(1), height: 1, ..place };
            draw::line(buf, room, &line, draw::Align::Right, theme);
        }
    }

    /// Offset of the first visible character; the cursor is always visible.
    fn first_shown(&self, room: u16) -> usize {
        let before = self.text.get(..self.cursor).unwrap_or_default();
        let mut used = draw::width(before);
        let mut start = 0;
        for (at, next) in before.char_indices() {
            if used < room {
                break;
            }
            used = used.saturating_sub(draw::width(next.encode_utf8(&mut [0; 4])));
            start = at + next.len_utf8();
        }
        start
    }

    fn insert(&mut self, typed: char) {
        self.text.insert(self.cursor, typed);
        self.cursor += typed.len_utf8();
        self.edited();
    }

    fn delete(&mut self, reach: CursorReach) {
        let other = self.reached(reach);
        let range = self.cursor.min(other)..self.cursor.max(other);
        self.cursor = range.start;
        self.text.drain(range);
        self.edited();
    }

    /// Clears error and recall after an edit.
    fn edited(&mut self) {
        self.recalled = None;
        self.error = None;
    }

    fn reached(&self, reach: CursorReach) -> usize {
        let (before, behind) = self.text.split_at_checked(self.cursor).unwrap_or_default();
        let is_blank = |text: char| !(text.is_alphanumeric() || text == '_');
        match reach {
            CursorReach::CharLeft => self.cursor - before.chars().next_back().map_or(0, char::len_utf8),
            CursorReach::CharRight => self.cursor + behind.chars().next().map_or(0, char::len_utf8),
            CursorReach::WordLeft => {
                before.trim_end_matches(is_blank).trim_end_matches(|c| !is_blank(c)).len()
            }
            CursorReach::WordRight => {
                let rest = behind.trim_start_matches(is_blank).trim_start_matches(|c| !is_blank(c));
                self.text.len() - rest.len()
            }
            CursorReach::Home => 0,
            CursorReach::End => self.text.len(),
        }
    }

    fn recall(&mut self, is_older: bool) {
        let next = match (self.recalled, is_older) {
            (None, true) => self.history.len().checked_sub(1),
            (Some(at), true) => Some(at.saturating_sub(1)),
            (None, false) => return,
            (Some(at), false) => Some(at + 1).filter(|next| *next < self.history.len()),
        };
        if self.recalled.is_none() {
            if next.is_none() {
                return;
            }
            self.draft = self.text.clone();
        }
        let text = next.and_then(|at| self.history.get(at)).unwrap_or(&self.draft).clone();
        self.set_text(&text);
        self.recalled = next;
    }

    fn remember(&mut self) {
        self.recalled = None;
        if !self.text.is_empty() {
            self.history.retain(|line| *line != self.text);
            self.history.push(self.text.clone());
            let excess = self.history.len().saturating_sub(HISTORY);
            self.history.drain(..excess);
        }
    }
}

/// A character as it is inserted: blanks become spaces, other control characters are dropped.
fn typeable(typed: char) -> Option<char> {
    match typed {
        '\t' | '\n' => Some(' '),
        _ => Some(typed).filter(|typed| !typed.is_control()),
    }
}

/// Edit command of a key, with the bindings of shells.
fn edit_of(key: KeyEvent) -> Option<Edit> {
    use Edit::{Cancel, Delete, Insert, Move, Newer, Older, Submit};
    if key.kind == KeyEventKind::Release {
        return None;
    }
    let control = key.modifiers.contains(KeyModifiers::CONTROL);
    let alt = key.modifiers.contains(KeyModifiers::ALT);
    Some(match (key.code, control, alt) {
        // Some systems report AltGr as Ctrl and Alt.
        (KeyCode::Char(typed), false, false) | (KeyCode::Char(typed), true, true) => Insert(typeable(typed)?),
        (KeyCode::Enter, ..) | (KeyCode::Char('j' | 'm'), true, _) => Submit,
        (KeyCode::Esc, ..) | (KeyCode::Char('c' | 'g'), true, _) => Cancel,
        (KeyCode::Up, ..) | (KeyCode::Char('p'), true, _) => Older,
        (KeyCode::Down, ..) | (KeyCode::Char('n'), true, _) => Newer,
        (KeyCode::Home, ..) | (KeyCode::Char('a'), true, _) => Move(CursorReach::Home),
        (KeyCode::End, ..) | (KeyCode::Char('e'), true, _) => Move(CursorReach::End),
        (KeyCode::Left, false, false) | (KeyCode::Char('b'), true, _) => Move(CursorReach::CharLeft),
        (KeyCode::Right, false, false) | (KeyCode::Char('f'), true, _) => Move(CursorReach::CharRight),
        (KeyCode::Left, ..) | (KeyCode::Char('b'), _, true) => Move(CursorReach::WordLeft),
        (KeyCode::Right, ..) | (KeyCode::Char('f'), _, true) => Move(CursorReach::WordRight),
        (KeyCode::Backspace, false, false) | (KeyCode::Char('h'), true, _) => Delete(CursorReach::CharLeft),
        (KeyCode::Delete, false, false) | (KeyCode::Char('d'), true, _) => Delete(CursorReach::CharRight),
        (KeyCode::Backspace, ..) | (KeyCode::Char('w'), true, _) => Delete(CursorReach::WordLeft),
        (KeyCode::Delete, ..) | (KeyCode::Char('d'), _, true) => Delete(CursorReach::WordRight),
        (KeyCode::Char('u'), true, _) => Delete(CursorReach::Home),
        (KeyCode::Char('k'), true, _) => Delete(CursorReach::End),
        _ => return None,
    })
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::theme::Borders;
    use crate::widgets::draw::tests::{in_every_small_size, plain, shown};

    fn press(prompt: &mut Prompt, code: KeyCode, modifiers: KeyModifiers) -> PromptEvent {
        prompt.key(KeyEvent::new(code, modifiers))
    }

    fn typed(prompt: &mut Prompt, text: &str) {
        for letter in text.chars() {
            assert_eq!(press(prompt, KeyCode::Char(letter), KeyModifiers::NONE), PromptEvent::Changed);
        }
    }

    fn control(prompt: &mut Prompt, letter: char) -> PromptEvent {
        press(prompt, KeyCode::Char(letter), KeyModifiers::CONTROL)
    }

    /// The text with a bar at the cursor.
    fn line(prompt: &Prompt) -> String {
        let (before, behind) = prompt.text().split_at(prompt.cursor());
        format!("{before}|{behind}")
    }

    #[test]
    fn typing_and_deleting() {
        let mut prompt = Prompt::new("filter:");
        typed(&mut prompt, "nöde = 5");
        assert_eq!(line(&prompt), "nöde = 5|");
        for _ in 0..6 {
            press(&mut prompt, KeyCode::Left, KeyModifiers::NONE);
        }
        assert_eq!(line(&prompt), "nö|de = 5");
        press(&mut prompt, KeyCode::Backspace, KeyModifiers::NONE);
        press(&mut prompt, KeyCode::Delete, KeyModifiers::NONE);
        assert_eq!(line(&prompt), "n|e = 5");
        typed(&mut prompt, "日");
        assert_eq!(line(&prompt), "n日|e = 5");
        press(&mut prompt, KeyCode::End, KeyModifiers::NONE);
        press(&mut prompt, KeyCode::Delete, KeyModifiers::NONE);
        press(&mut prompt, KeyCode::Right, KeyModifiers::NONE);
        assert_eq!(line(&prompt), "n日e = 5|");
        press(&mut prompt, KeyCode::Home, KeyModifiers::NONE);
        press(&mut prompt, KeyCode::Backspace, KeyModifiers::NONE);
        press(&mut prompt, KeyCode::Left, KeyModifiers::NONE);
        assert_eq!(line(&prompt), "|n日e = 5");
    }

    #[test]
    fn words() {
        let mut prompt = Prompt::new("");
        prompt.set_text("sdo.index == 0x6040  ");
        control(&mut prompt, 'w');
        assert_eq!(line(&prompt), "sdo.index == |");
        control(&mut prompt, 'w');
        assert_eq!(line(&prompt), "sdo.|");
        prompt.set_text("state = läuft gut");
        press(&mut prompt, KeyCode::Left, KeyModifiers::CONTROL);
        press(&mut prompt, KeyCode::Char('b'), KeyModifiers::ALT);
        assert_eq!(line(&prompt), "state = |läuft gut");
        press(&mut prompt, KeyCode::Right, KeyModifiers::CONTROL);
        assert_eq!(line(&prompt), "state = läuft| gut");
        press(&mut prompt, KeyCode::Char('d'), KeyModifiers::ALT);
        assert_eq!(line(&prompt), "state = läuft|");
        control(&mut prompt, 'a');
        press(&mut prompt, KeyCode::Char('f'), KeyModifiers::ALT);
        control(&mut prompt, 'k');
        assert_eq!(line(&prompt), "state|");
        control(&mut prompt, 'u');
        assert_eq!(line(&prompt), "|");
        assert_eq!(control(&mut prompt, 'w'), PromptEvent::Changed);
    }

    #[test]
    fn history_goes_back_to_what_was_typed() {
        let mut prompt = Prompt::new("").with_history(["first".to_owned(), "second".to_owned()]);
        typed(&mut prompt, "dra");
        let up = |prompt: &mut Prompt| press(prompt, KeyCode::Up, KeyModifiers::NONE);
        let down = |prompt: &mut Prompt| press(prompt, KeyCode::Down, KeyModifiers::NONE);
        down(&mut prompt);
        assert_eq!(line(&prompt), "dra|");
        let older = [(); 3].map(|()| {
            up(&mut prompt);
            line(&prompt)
        });
        assert_eq!(older, ["second|", "first|", "first|"]);
        let newer = [(); 3].map(|()| {
            down(&mut prompt);
            line(&prompt)
        });
        assert_eq!(newer, ["second|", "dra|", "dra|"]);
        up(&mut prompt);
        up(&mut prompt);
        assert_eq!(press(&mut prompt, KeyCode::Enter, KeyModifiers::NONE), PromptEvent::Submitted);
        assert_eq!(prompt.history(), ["second", "first"]);
        prompt.set_text("");
        assert_eq!(control(&mut prompt, 'm'), PromptEvent::Submitted);
        assert_eq!(prompt.history().len(), 2);
        // An edited line of the history becomes a new draft.
        up(&mut prompt);
        typed(&mut prompt, "!");
        up(&mut prompt);
        down(&mut prompt);
        assert_eq!(line(&prompt), "first!|");
        let mut empty = Prompt::new("");
        typed(&mut empty, "x");
        up(&mut empty);
        assert_eq!(line(&empty), "x|");
    }

    #[test]
    fn keys_for_somebody_else() {
        let mut prompt = Prompt::new("");
        assert_eq!(press(&mut prompt, KeyCode::Esc, KeyModifiers::NONE), PromptEvent::Cancelled);
        assert_eq!(control(&mut prompt, 'c'), PromptEvent::Cancelled);
        assert_eq!(press(&mut prompt, KeyCode::Tab, KeyModifiers::NONE), PromptEvent::Ignored);
        assert_eq!(press(&mut prompt, KeyCode::F(1), KeyModifiers::NONE), PromptEvent::Ignored);
        assert_eq!(control(&mut prompt, 'z'), PromptEvent::Ignored);
        let mut released = KeyEvent::new(KeyCode::Char('a'), KeyModifiers::NONE);
        released.kind = KeyEventKind::Release;
        assert_eq!(prompt.key(released), PromptEvent::Ignored);
        assert_eq!(prompt.text(), "");
    }

    #[test]
    fn what_is_pasted_becomes_one_line() {
        let mut prompt = Prompt::new("");
        prompt.set_text("ab");
        press(&mut prompt, KeyCode::Left, KeyModifiers::NONE);
        assert_eq!(prompt.paste("x\ty\r\nz\x1b[2J\r\n"), PromptEvent::Changed);
        assert_eq!(line(&prompt), "ax y z[2J|b");
    }

    fn drawn(prompt: &Prompt, width: u16) -> Vec<String> {
        let mut buf = Buffer::empty(Rect::new(0, 0, width, 2));
        prompt.render(&plain(Borders::Unicode), buf.area, &mut buf);
        shown(&buf)
    }

    #[test]
    fn the_caret_is_under_what_is_wrong() {
        let mut prompt = Prompt::new("filter:");
        prompt.set_text("nö == 0x6z");
        prompt.set_error(10, "not a digit");
        assert_eq!(drawn(&prompt, 40), ["filter: nö == 0x6z", "                 ^ not a digit"]);
        assert_eq!(drawn(&prompt, 24), ["filter: nö == 0x6z", "     not a digit ^"]);
        // Inside a character, after the end: never a panic.
        prompt.set_error(2, "?");
        assert_eq!(drawn(&prompt, 24)[1], "        ^ ?");
        prompt.set_error(99, "more is wanted");
        assert_eq!(drawn(&prompt, 40)[1], "                  ^ more is wanted");
        typed(&mut prompt, "1");
        assert_eq!(drawn(&prompt, 40)[1], "");
        prompt.set_error(0, "no");
        prompt.clear_error();
        assert_eq!(drawn(&prompt, 40)[1], "");
    }

    #[test]
    fn the_cursor_stays_in_view() {
        let mut prompt = Prompt::new("filter:");
        prompt.set_text("0123456789abcdef");
        assert_eq!(drawn(&prompt, 18), ["filter: 789abcdef", ""]);
        assert_eq!(drawn(&prompt, 10), ["789abcdef", ""]);
        control(&mut prompt, 'a');
        assert_eq!(drawn(&prompt, 10), ["0123456789", ""]);
        prompt.set_text("日本語日本語");
        assert_eq!(drawn(&prompt, 7), ["日本語", ""]);
        let mut buf = Buffer::empty(Rect::new(0, 0, 7, 1));
        let theme = plain(Borders::Unicode);
        prompt.render(&theme, buf.area, &mut buf);
        assert_eq!(buf[(6, 0)].modifier, theme.style(Role::Cursor).add_modifier);
    }

    #[test]
    fn every_small_size() {
        let mut prompt = Prompt::new("filter:");
        prompt.set_text("日本語 0123456789");
        prompt.set_error(3, "日本語日本語日本語");
        in_every_small_size(|area, buf| prompt.render(&plain(Borders::Ascii), area, buf));
    }
}
