//! The row above a prompt: examples, words that complete the input, or the frame of a position.
//!
//! ```text
//! emcy 2  nmt-state 4  nmt-command 3                                        tab completes
//! filter kind == █
//!                ^ expected a value
//! ```

use cobscope_decoder::sink::escape;
use ratatui::buffer::Buffer;
use ratatui::crossterm::event::KeyCode;
use ratatui::layout::Rect;
use ratatui::text::{Line, Span};

use super::application::{App, InputMode, PromptPurpose};
use super::ask::parse_target;
use super::candidates::{Candidate, PromptRow, assignable_names, find_candidates};
use super::columns::columns_left;
use crate::state::UiState;
use crate::theme::{Glyph, TextRole, Theme};
use crate::widgets::draw::{self, TextAlignment};
use crate::widgets::prompt::{LinePrompt, PromptEvent};

/// Key that completes.
const KEY: &str = "tab completes";

/// Examples of a prompt; each is valid.
pub(super) const fn prompt_examples(asking: PromptPurpose) -> [&'static str; 3] {
    match asking {
        PromptPurpose::Filter => ["kind == emcy", "node == 5 && kind == pdo", "severity == error"],
        PromptPurpose::Search => ["emcy", "tpdo[12]", "fault|lost"],
        PromptPurpose::GoTo => ["12.5", "#1234", "-0.05"],
        PromptPurpose::Export => ["part.log", "part.pcapng", "events.csv"],
        PromptPurpose::Report => ["case.html", "case-7.html", "case.md"],
        PromptPurpose::Assign => ["rexroth-sydfec", "pump.eds", "vehicle.dbc"],
        PromptPurpose::Columns => ["Time, Node, Event", "No, Time, ID, Data", "Node, Kind"],
    }
}

/// The row for the content of a prompt.
fn prompt_row(core: &UiState, asking: PromptPurpose, prompt: &LinePrompt) -> PromptRow {
    let text = prompt.text();
    if text.trim().is_empty() && asking != PromptPurpose::Columns {
        let text = format!("examples:  {}", prompt_examples(asking).join("   "));
        return PromptRow { text, ..PromptRow::default() };
    }
    match asking {
        _ if prompt.is_proposed() => PromptRow {
            text: "typing replaces the name, an arrow key keeps it".to_owned(),
            ..PromptRow::default()
        },
        PromptPurpose::Filter => {
            let before = text.get(..prompt.cursor()).unwrap_or_default();
            let (start, candidates, text) = find_candidates(core, before);
            PromptRow { start, candidates, chosen: None, text }
        }
        PromptPurpose::Assign => {
            let before = text.get(..prompt.cursor()).unwrap_or_default();
            PromptRow { candidates: assignable_names(core, before), ..PromptRow::default() }
        }
        _ => PromptRow::default(),
    }
}

impl App {
    /// Updates the row after a change of the prompt.
    pub(super) fn refresh_prompt_row(&mut self) {
        let InputMode::Prompt(asking, prompt) = &self.mode else { return };
        self.prompt_row = match asking {
            PromptPurpose::Columns => {
                let before = prompt.text().get(..prompt.cursor()).unwrap_or_default();
                let (start, candidates) = columns_left(&self.panes.column_titles(), before);
                PromptRow { start, candidates, ..PromptRow::default() }
            }
            _ => prompt_row(&self.core, *asking, prompt),
        };
        if *asking == PromptPurpose::GoTo {
            let wanted = parse_target(&self.core, prompt.text());
            self.core.look_at(wanted);
        }
    }

    /// Completes the word at the cursor: first as far as all candidates agree, then to each of them in turn.
    pub(super) fn complete_word(&mut self, key: KeyCode) {
        let InputMode::Prompt(asking, prompt) = &mut self.mode else { return };
        let row = &self.prompt_row;
        let typed = prompt.text().get(row.start..prompt.cursor()).unwrap_or_default();
        let common = common_prefix(&row.candidates);
        let (text, chosen) = match row.candidates.as_slice() {
            [] => return,
            [only] => {
                let is_at_end = prompt.cursor() == prompt.text().len();
                (format!("{}{}", only.text, if is_at_end { " " } else { "" }), None)
            }
            _ if row.chosen.is_none() && common.len() > typed.len() => (common, None),
            several => {
                let next = match (row.chosen, key) {
                    (None | Some(0), KeyCode::BackTab) => several.len() - 1,
                    (Some(at), KeyCode::BackTab) => at - 1,
                    (None, _) => 0,
                    (Some(at), _) => (at + 1) % several.len(),
                };
                (several.get(next).map(|one| one.text.clone()).unwrap_or_default(), Some(next))
            }
        };
        prompt.complete_word(row.start, &text);
        let (asking, start) = (*asking, row.start);
        let kept = chosen.map(|_| std::mem::take(&mut self.prompt_row.candidates));
        self.on_typed(asking, PromptEvent::Changed);
        if let Some(candidates) = kept {
            self.prompt_row = PromptRow { start, candidates, chosen, text: String::new() };
        }
    }
}

impl PromptRow {
    /// Draws the row above the prompt.
    pub(super) fn draw_row(&self, core: &UiState, asking: PromptPurpose, area: Rect, buf: &mut Buffer) {
        let theme = &core.theme;
        let (text, quiet) = (theme.role_style(TextRole::Text), theme.role_style(TextRole::Quiet));
        let preview = core.preview_text().filter(|_| asking == PromptPurpose::GoTo);
        let line = match (preview, self.candidates.is_empty()) {
            (Some(preview), _) => Line::styled(preview, theme.role_style(TextRole::Note)),
            (None, true) => Line::styled(self.text.clone(), quiet),
            (None, false) => self.candidate_line(theme, area.width.saturating_sub(draw::text_width(KEY) + 2)),
        };
        if line.width() == 0 {
            return;
        }
        draw::put_text(buf, area.x, area.y, area.width, &" ".repeat(usize::from(area.width)), text);
        draw::draw_line(buf, area, &line, TextAlignment::Left, theme);
        if !self.candidates.is_empty() {
            draw::draw_line(buf, area, &Line::styled(KEY, quiet), TextAlignment::Right, theme);
        }
    }

    /// Candidates from the chosen one on, as many as fit.
    fn candidate_line(&self, theme: &Theme, room: u16) -> Line<'static> {
        let more = theme.glyph(Glyph::Ellipsis);
        let mut spans = Vec::new();
        let mut used = draw::text_width(more);
        // A chosen candidate far to the right is shown with those after it.
        let first = self.chosen.map_or(0, |chosen| chosen.saturating_sub(2));
        for (place, candidate) in self.candidates.iter().enumerate().skip(first) {
            let count = candidate.count.map_or(String::new(), |count| format!(" {count}"));
            let word = escape(&candidate.text).into_owned();
            used = used.saturating_add(draw::text_width(&word)).saturating_add(draw::text_width(&count) + 2);
            if used > room {
                spans.push(Span::styled(more, theme.role_style(TextRole::Quiet)));
                break;
            }
            let role = if self.chosen == Some(place) { TextRole::Selected } else { TextRole::Text };
            spans.push(Span::styled(word, theme.role_style(role)));
            spans.push(Span::styled(format!("{count}  "), theme.role_style(TextRole::Quiet)));
        }
        Line::from(spans)
    }
}

/// The longest text with which all candidates start.
fn common_prefix(candidates: &[Candidate]) -> String {
    let mut texts = candidates.iter().map(|candidate| candidate.text.as_str());
    let first = texts.next().unwrap_or_default();
    let shared = |one: &str, other: &str| {
        one.chars().zip(other.chars()).take_while(|(one, other)| one == other).map(|(one, _)| one).collect()
    };
    texts.fold(first.to_owned(), |common, text| shared(&common, text))
}

#[cfg(test)]
mod tests {
    use super::super::ask::check_text;
    use super::*;

    #[test]
    fn every_example_is_valid() {
        for asking in
            [PromptPurpose::Filter, PromptPurpose::Search, PromptPurpose::GoTo, PromptPurpose::Export]
        {
            for example in prompt_examples(asking) {
                assert_eq!(check_text(asking, example), Ok(()), "{example}");
            }
        }
    }

    #[test]
    fn candidates_share_their_start() {
        let of = |texts: &[&str]| {
            let candidates: Vec<_> = texts.iter().map(|text| Candidate::new(text, None)).collect();
            common_prefix(&candidates)
        };
        assert_eq!(of(&["sdo-transfer", "sdo-start", "sdö"]), "sd");
        assert_eq!(of(&["emcy"]), "emcy");
        assert_eq!(of(&[]), "");
    }
}
