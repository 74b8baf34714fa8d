//! A line editor with a history and an error mark.
//!
//! ```text
//! filter: sdo.index == 0x60zz█
//!                          ^ not a hexadecimal digit
//! ```

mod edit;

use std::borrow::Cow;

use ratatui::buffer::Buffer;
use ratatui::crossterm::event::KeyEvent;
use ratatui::layout::{Position, Rect};
use ratatui::text::Line;

use self::edit::{CursorReach, EditCommand, edit_of, to_typeable};
use crate::theme::{TextRole, Theme};
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

/// The edited line with its history.
#[derive(Clone, Debug, Default)]
pub struct LinePrompt {
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
    /// The text is a proposal, which typed text replaces.
    is_proposed: bool,
}

impl LinePrompt {
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
        self.text.extend(text.chars().filter_map(to_typeable));
        self.cursor = self.text.len();
        self.is_proposed = false;
        self.on_edit();
    }

    /// Sets a text that the first typed character replaces; any other key keeps it.
    pub fn propose_text(&mut self, text: &str) {
        self.set_text(text);
        self.is_proposed = true;
    }

    /// Whether the next typed character replaces the text.
    pub fn is_proposed(&self) -> bool {
        self.is_proposed
    }

    /// Replaces the text from a byte offset to the cursor.
    pub fn complete_word(&mut self, start: usize, text: &str) {
        if self.text.get(start..self.cursor).is_some() {
            self.text.replace_range(start..self.cursor, text);
            self.cursor = start + text.len();
            self.on_edit();
        }
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
    pub fn paste_text(&mut self, text: &str) -> PromptEvent {
        self.replace_proposal();
        // A copied line may end with a line break.
        for typed in text.trim_end_matches(['\r', '\n']).chars().filter_map(to_typeable) {
            self.insert(typed);
        }
        PromptEvent::Changed
    }

    /// Applies a key.
    pub fn on_key(&mut self, key: KeyEvent) -> PromptEvent {
        let Some(edit) = edit_of(key) else { return PromptEvent::Ignored };
        match edit {
            EditCommand::Insert(typed) => {
                self.replace_proposal();
                self.insert(typed);
            }
            EditCommand::Move(reach) => self.cursor = self.position_at(reach),
            EditCommand::Delete(reach) => self.delete_to(reach),
            EditCommand::Older => self.recall_line(true),
            EditCommand::Newer => self.recall_line(false),
            EditCommand::Submit => {
                self.remember_line();
                return PromptEvent::Submitted;
            }
            EditCommand::Cancel => return PromptEvent::Cancelled,
        }
        self.is_proposed = false;
        PromptEvent::Changed
    }

    /// Draws the line, and the error in a second line if there is one.
    pub fn render(&self, theme: &Theme, area: Rect, buf: &mut Buffer) {
        let area = area.intersection(buf.area);
        if area.is_empty() {
            return;
        }
        let label = draw::text_width(&self.label) + u16::from(!self.label.is_empty());
        let label = if area.width >= label.saturating_add(LEAST_TEXT) { label } else { 0 };
        if label > 0 {
            draw::put_text(buf, area.x, area.y, label, &self.label, theme.role_style(TextRole::Key));
        }
        let place = Rect { x: area.x + label, width: area.width - label, height: 1, ..area };
        let start = self.first_shown(place.width);
        let shown = self.text.get(start..).unwrap_or_default();
        let role = if self.is_proposed { TextRole::Selected } else { TextRole::Text };
        draw::put_text(buf, place.x, place.y, place.width, shown, theme.role_style(role));
        let before = self.text.get(start..self.cursor).unwrap_or_default();
        if let Some(cell) =
            buf.cell_mut(Position::new(place.x.saturating_add(draw::text_width(before)), place.y))
        {
            cell.set_style(theme.role_style(TextRole::Cursor));
        }
        if area.height > 1 {
            self.draw_error(theme, start, Rect { y: area.y + 1, ..place }, area, buf);
        }
    }

    /// Draws a caret below the error and the message on the side with enough room.
    fn draw_error(&self, theme: &Theme, start: usize, place: Rect, area: Rect, buf: &mut Buffer) {
        let Some((offset, message)) = &self.error else { return };
        let style = theme.role_style(TextRole::Bad);
        let before = self.text.get(start..(*offset).min(self.text.len())).unwrap_or_default();
        let caret = place.x.saturating_add(draw::text_width(before)).min(place.right().saturating_sub(1));
        draw::put_text(buf, caret, place.y, 1, "^", style);
        let line = Line::styled(message.as_str(), style);
        let wanted = draw::text_width(message);
        let (left, right) = (caret - area.x, place.right() - caret - 1);
        if wanted < right || right >= left {
            let x = caret.saturating_add(2);
            let room = Rect { x, width: place.right().saturating_sub(x), height: 1, ..place };
            draw::draw_line(buf, room, &line, draw::TextAlignment::Left, theme);
        } else {
            let room = Rect { x: area.x, width: left.saturating_sub(1), height: 1, ..place };
            draw::draw_line(buf, room, &line, draw::TextAlignment::Right, theme);
        }
    }

    /// Offset of the first visible character; the cursor is always visible.
    fn first_shown(&self, room: u16) -> usize {
        let before = self.text.get(..self.cursor).unwrap_or_default();
        let mut used = draw::text_width(before);
        let mut start = 0;
        for (at, next) in before.char_indices() {
            if used < room {
                break;
            }
            used = used.saturating_sub(draw::text_width(next.encode_utf8(&mut [0; 4])));
            start = at + next.len_utf8();
        }
        start
    }

    fn replace_proposal(&mut self) {
        if std::mem::take(&mut self.is_proposed) {
            self.set_text("");
        }
    }

    fn insert(&mut self, typed: char) {
        self.text.insert(self.cursor, typed);
        self.cursor += typed.len_utf8();
        self.on_edit();
    }

    fn delete_to(&mut self, reach: CursorReach) {
        let other = self.position_at(reach);
        let range = self.cursor.min(other)..self.cursor.max(other);
        self.cursor = range.start;
        self.text.drain(range);
        self.on_edit();
    }

    /// Clears error and recall after an edit.
    fn on_edit(&mut self) {
        self.recalled = None;
        self.error = None;
    }

    fn position_at(&self, reach: CursorReach) -> usize {
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

    fn recall_line(&mut self, is_older: bool) {
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

    fn remember_line(&mut self) {
        self.recalled = None;
        if !self.text.is_empty() {
            self.history.retain(|line| *line != self.text);
            self.history.push(self.text.clone());
            let excess = self.history.len().saturating_sub(HISTORY);
            self.history.drain(..excess);
        }
    }
}

#[cfg(test)]
mod tests;
