//! Handling of keys, mouse and paste.

use ratatui::crossterm::event::{KeyCode, KeyEvent, KeyModifiers, MouseButton, MouseEvent, MouseEventKind};
use ratatui::layout::Position;

use super::application::{App, InputMode, PromptPurpose};
use super::ask::{apply_filter, use_mark};
use super::requests::TerminalRequest;
use super::{screen, view};
use crate::action::Action;
use crate::panes::{OPTIONAL, PaneId, PaneRequest};
use crate::state::{JumpPlace, UiState};
use crate::theme::{ColorDepth, ThemePalette};
use crate::timeline::RowMatcher;

/// Maximum number of keys kept until the position before them is known.
const MOST_EARLY: usize = 64;

/// Rows per step of the mouse wheel.
const WHEEL: usize = 3;

impl App {
    /// Handles a key.
    pub fn on_key(&mut self, key: KeyEvent) {
        // Terminals report Esc followed at once by a key as Alt and that key. Only prompts use Alt.
        let modifiers = key.modifiers.difference(KeyModifiers::ALT);
        let is_one_byte = matches!(key.code, KeyCode::Char(_) | KeyCode::Enter);
        if modifiers != key.modifiers && is_one_byte && !matches!(self.mode, InputMode::Prompt(..)) {
            self.one_key(KeyCode::Esc.into());
            self.one_key(KeyEvent { modifiers, ..key });
        } else {
            self.one_key(key);
        }
        self.remember_state();
    }

    fn one_key(&mut self, key: KeyEvent) {
        self.jumps.opens_at_story = false;
        if self.is_early(key) {
            return;
        }
        self.core.stated = None;
        self.jumps.awaited = None;
        match &mut self.mode {
            InputMode::Panes => {
                if let Some(action) = self.keymap.action_for(&key) {
                    self.perform_action(action);
                }
            }
            InputMode::Prompt(asking, prompt) => {
                let asking = *asking;
                if matches!(key.code, KeyCode::Tab | KeyCode::BackTab) {
                    return self.complete_word(key.code);
                }
                let event = prompt.on_key(key);
                self.on_typed(asking, event);
            }
            InputMode::Letter { is_new } => {
                let is_new = *is_new;
                self.mode = InputMode::Panes;
                if let KeyCode::Char(letter) = key.code {
                    use_mark(&mut self.core, letter, is_new);
                }
            }
            InputMode::Help(scroll) => match self.keymap.action_for(&key) {
                Some(Action::Down) => *scroll += 1,
                Some(Action::Up) => *scroll = scroll.saturating_sub(1),
                Some(Action::PageDown) => *scroll += usize::from(self.panes.area.height / 2),
                Some(Action::PageUp) => {
                    *scroll = scroll.saturating_sub(usize::from(self.panes.area.height / 2));
                }
                _ => self.mode = InputMode::Panes,
            },
        }
    }

    /// Keeps a key whose meaning depends on an unread row. Quit acts at once, and Back ends a search.
    fn is_early(&mut self, key: KeyEvent) -> bool {
        let is_moving = matches!(self.mode, InputMode::Panes) && self.core.is_moving();
        if !is_moving && self.core.window.is_some() {
            return false;
        }
        match self.keymap.action_for(&key) {
            Some(Action::Quit) => return false,
            Some(Action::Back) if is_moving && self.core.is_searching() => {
                self.early.clear();
                self.core.end_search();
            }
            _ if self.early.len() < MOST_EARLY => self.early.push(key),
            _ => {}
        }
        true
    }

    /// Handles pasted text.
    pub fn on_paste(&mut self, text: &str) {
        if let InputMode::Prompt(asking, prompt) = &mut self.mode {
            let asking = *asking;
            let event = prompt.paste_text(text);
            self.on_typed(asking, event);
        }
    }

    /// Handles a mouse event.
    pub fn on_mouse(&mut self, event: MouseEvent) {
        if !matches!(event.kind, MouseEventKind::Moved) {
            self.jumps.opens_at_story = false;
            self.jumps.awaited = None;
        }
        // Some terminals report coordinate 0 as 65535.
        let x = event.column.min(self.panes.area.width.saturating_sub(1));
        let y = event.row.min(self.panes.area.height.saturating_sub(1));
        let parts = self.panes.screen_areas();
        let is_pressed = matches!(event.kind, MouseEventKind::Down(MouseButton::Left));
        if is_pressed {
            self.is_dragging = parts.strip.contains(Position::new(x, y));
        }
        if self.is_dragging && (is_pressed || matches!(event.kind, MouseEventKind::Drag(MouseButton::Left))) {
            return match screen::time_at(&self.core, parts.strip, x) {
                Some(time) => self.core.jump_to(JumpPlace::Time(time)),
                None => self.core.show_refusal("this capture has no timestamps"),
            };
        }
        let cell = self
            .panes
            .shown_cells(parts.body)
            .into_iter()
            .find(|cell| cell.area.contains(Position::new(x, y)));
        if let Some(cell) = cell.filter(|cell| {
            cell.pane != self.panes.focus
                && !matches!(event.kind, MouseEventKind::Moved)
                && matches!(self.mode, InputMode::Panes)
        }) {
            self.panes.show_pane(cell.pane, &mut self.core);
        }
        match event.kind {
            MouseEventKind::ScrollDown => (0..WHEEL).for_each(|_| self.perform_action(Action::Down)),
            MouseEventKind::ScrollUp => (0..WHEEL).for_each(|_| self.perform_action(Action::Up)),
            MouseEventKind::Down(MouseButton::Left) if cell.is_some() => {
                let area = cell.map_or(parts.body, |cell| cell.area);
                let is_second = self.clicked == Some((x, y));
                self.clicked = if is_second { None } else { Some((x, y)) };
                let effects = self.panes.focused_pane_mut().map(|pane| pane.on_click(x, y, area, &self.core));
                self.apply_requests(effects.unwrap_or_default());
                if is_second {
                    self.perform_action(Action::Open);
                }
            }
            MouseEventKind::Down(MouseButton::Left) if y == parts.tabs.y => {
                if let Some(pane) = view::tab_at(x, self.panes.area.width) {
                    self.panes.show_pane(pane, &mut self.core);
                }
            }
            _ => {}
        }
        self.remember_state();
    }

    /// Handles a new size of the terminal.
    pub fn on_resize(&mut self, width: u16, height: u16) {
        self.panes.area = ratatui::layout::Rect::new(0, 0, width, height);
        self.core.screen_height = height;
        self.panes.update_size(&mut self.core);
        self.core.refresh_window();
    }

    /// Performs an action.
    pub fn perform_action(&mut self, action: Action) {
        match action {
            Action::Quit => self.outputs.push(TerminalRequest::Quit),
            Action::Help => self.mode = InputMode::Help(0),
            Action::Pane(number) => match PaneId::ALL.get(usize::from(number)) {
                Some(pane) => self.panes.show_pane(*pane, &mut self.core),
                None => self.core.show_refusal(&format!("no pane {number}")),
            },
            Action::NextPane => self.panes.next_pane(true, &mut self.core),
            Action::PreviousPane => self.panes.next_pane(false, &mut self.core),
            Action::Layout => self.panes.next_layout(&mut self.core),
            Action::Zoom => self.panes.toggle_zoom(&mut self.core),
            Action::SplitLeft => self.panes.move_split(false, &mut self.core),
            Action::SplitRight => self.panes.move_split(true, &mut self.core),
            Action::Strip => self.panes.toggle_strip(&mut self.core),
            Action::Columns => self.ask_columns(),
            Action::Forget => self.remembered.forget_view(&mut self.panes, &mut self.core),
            Action::Filter => self.open_prompt(PromptPurpose::Filter, "filter"),
            Action::Search => self.open_prompt(PromptPurpose::Search, "search"),
            Action::GoTo => self.open_prompt(PromptPurpose::GoTo, "go to"),
            Action::Export => self.open_prompt(PromptPurpose::Export, "write to"),
            Action::Report => self.ask_report(),
            Action::Select => open_selection(&mut self.core),
            Action::Pause => pause_following(&mut self.core),
            Action::SearchNext => self.core.search_row(false),
            Action::SearchPrevious => self.core.search_row(true),
            Action::NextStory | Action::PreviousStory => {
                self.jumps.step_story(&mut self.core, action == Action::NextStory);
                self.panes.refresh_panes(&self.core);
            }
            Action::NextFinding | Action::PreviousFinding => {
                self.jumps.goto_finding(&mut self.core, action == Action::NextFinding);
                self.panes.refresh_panes(&self.core);
            }
            Action::NextError => self.jumps.goto_error(&mut self.core, true),
            Action::PreviousError => self.jumps.goto_error(&mut self.core, false),
            Action::Clock => self.core.next_clock(),
            Action::SetMark => self.mode = InputMode::Letter { is_new: true },
            Action::ToMark => self.mode = InputMode::Letter { is_new: false },
            Action::FilterCell => self.filter_cell(),
            Action::Assign => self.ask_assign(),
            Action::News => toggle_news(&mut self.core),
            Action::Copy => self.copy_line(),
            Action::Theme => next_theme(&mut self.core),
            Action::Clear => self.clear_pane(),
            _ => self.move_or_pass(action),
        }
    }

    /// Performs an action of the history, else passes it to the focused pane.
    fn move_or_pass(&mut self, action: Action) {
        match action {
            Action::Undo => self.step_history(true),
            Action::Redo => self.step_history(false),
            Action::Back => self.go_back(),
            _ => self.pass_action(action),
        }
    }

    fn copy_line(&mut self) {
        match self.panes.focused_pane().and_then(|pane| pane.selected_line(&self.core)) {
            Some(line) => self.apply_requests(vec![PaneRequest::Copy(line)]),
            None => self.core.show_refusal("nothing selected"),
        }
    }

    fn clear_pane(&mut self) {
        let before = self.panes.row_selection(&self.core);
        self.core.sought = None;
        if self.core.matcher.filter.is_some() {
            apply_filter(&mut self.core, "");
        }
        self.pass_action(Action::Clear);
        let cleared = before.cleared_by(&self.panes.row_selection(&self.core));
        if !cleared.is_empty() {
            self.core.show_message(&format!("cleared: {}; u undoes it", cleared.join(", ")));
        }
    }

    /// Passes the action to the current pane. If the pane does not perform it, the panes that do are named.
    fn pass_action(&mut self, action: Action) {
        let Some(pane) = self.panes.focused_pane_mut() else { return };
        let effects = pane.on_action(action, &self.core);
        if effects.is_empty() && OPTIONAL.contains(&action) && !pane.performed_actions().contains(&action) {
            return self.refuse_action(action);
        }
        self.apply_requests(effects);
    }

    /// `nothing to plot here; p works in Nodes, Events, Frames, Detail, Signals`.
    fn refuse_action(&mut self, action: Action) {
        let panes = self.panes.performing_titles(action);
        let does = match action {
            Action::Left | Action::Right => "move to",
            Action::Toggle => "expand",
            Action::Sort => "sort",
            Action::Highlight => "highlight",
            Action::Plot => "plot",
            _ => "zoom",
        };
        let nothing = match action {
            Action::SetCursor => "no plot".to_owned(),
            _ => format!("nothing to {does}"),
        };
        let key = self.keymap.keys_for(action).first().map_or("it", String::as_str);
        self.core.show_refusal(&format!("{nothing} here; {key} works in {}", panes.join(", ")));
    }

    fn apply_requests(&mut self, effects: Vec<PaneRequest>) {
        let mut is_plotted = false;
        for effect in effects {
            for pane in self.panes.all_mut() {
                pane.on_request(&effect, &self.core);
            }
            match effect {
                PaneRequest::Go(place) => self.core.jump_to(place),
                PaneRequest::ShowEvents => self.panes.show_pane(PaneId::Events, &mut self.core),
                PaneRequest::ShowDetail => self.panes.show_pane(PaneId::Detail, &mut self.core),
                PaneRequest::ShowSignals => self.panes.show_pane(PaneId::Signals, &mut self.core),
                PaneRequest::Filter(text) => apply_filter(&mut self.core, &text),
                PaneRequest::Node(node) => self.core.node = Some(node),
                PaneRequest::Plot(_) => is_plotted = true,
                PaneRequest::Say(text) => self.core.show_message(&text),
                PaneRequest::Refuse(text) => self.core.show_refusal(&text),
                PaneRequest::Copy(text) => {
                    self.core.show_message("copied");
                    self.outputs.push(TerminalRequest::Copy(text));
                }
            }
        }
        if is_plotted {
            self.panes.show_pane(PaneId::Signals, &mut self.core);
        }
        self.panes.refresh_panes(&self.core);
    }

    /// Closes the open part of the pane, else shows the previous pane.
    fn go_back(&mut self) {
        let effects = self.panes.focused_pane_mut().map(|pane| pane.on_action(Action::Back, &self.core));
        match effects {
            Some(effects) if !effects.is_empty() => self.apply_requests(effects),
            _ => self.panes.show_previous(&mut self.core),
        }
    }
}

fn open_selection(core: &mut UiState) {
    core.selection = match core.selection {
        Some(_) => None,
        None => Some(core.cursor.frame),
    };
    match core.selection {
        Some(frame) => {
            core.show_message(&format!("selected from #{frame} to the cursor; w writes it"));
        }
        None => core.show_message("selection cleared"),
    }
}

fn pause_following(core: &mut UiState) {
    if !core.timeline.may_grow() && !core.is_following {
        return core.show_refusal("the capture is complete; no new frames to follow");
    }
    core.is_following = !core.is_following;
    core.show_message(if core.is_following { "following new frames" } else { "paused at the cursor" });
    if core.is_following {
        core.jump_to(JumpPlace::End);
    }
}

fn toggle_news(core: &mut UiState) {
    let only_news = !core.matcher.only_news;
    core.show_events(RowMatcher { only_news, ..core.matcher.clone() });
    core.show_message(if only_news { "only changes" } else { "all events" });
}

fn next_theme(core: &mut UiState) {
    let theme = core.theme;
    core.theme = match (theme.depth(), theme.palette()) {
        (ColorDepth::None, _) => theme.with_colours(ThemePalette::Dark, ColorDepth::Full),
        (ColorDepth::Full, ThemePalette::Dark) => theme.with_colours(ThemePalette::Light, ColorDepth::Full),
        (ColorDepth::Full, ThemePalette::Light) => {
            theme.with_colours(ThemePalette::Dark, ColorDepth::Sixteen)
        }
        (ColorDepth::Sixteen, ThemePalette::Dark) => {
            theme.with_colours(ThemePalette::Light, ColorDepth::Sixteen)
        }
        (ColorDepth::Sixteen, ThemePalette::Light) => {
            theme.with_colours(ThemePalette::Dark, ColorDepth::None)
        }
    };
}
