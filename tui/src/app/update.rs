//! Handling of keys, mouse and paste.

use ratatui::crossterm::event::{KeyCode, KeyEvent, KeyModifiers, MouseButton, MouseEvent, MouseEventKind};
use ratatui::layout::Position;

use super::application::{App, Mode, PromptPurpose};
use super::output::Output;
use super::{strip, view};
use crate::action::Action;
use crate::panes::{Effect, OPTIONAL, PaneId};
use crate::state::JumpPlace;
use crate::theme::{Depth, Palette};
use crate::timeline::Matcher;

/// Maximum number of keys kept until the position before them is known.
const MOST_EARLY: usize = 64;

/// Rows per step of the mouse wheel.
const WHEEL: usize = 3;

impl App {
    /// Handles a key.
    pub fn key(&mut self, key: KeyEvent) {
        // Terminals report Esc followed at once by a key as Alt and that key. Only prompts use Alt.
        let modifiers = key.modifiers.difference(KeyModifiers::ALT);
        let is_one_byte = matches!(key.code, KeyCode::Char(_) | KeyCode::Enter);
        if modifiers != key.modifiers && is_one_byte && !matches!(self.mode, Mode::Prompt(..)) {
            self.one_key(KeyCode::Esc.into());
            self.one_key(KeyEvent { modifiers, ..key });
        } else {
            self.one_key(key);
        }
        self.remember();
    }

    fn one_key(&mut self, key: KeyEvent) {
        self.opens_at_story = false;
        if self.is_early(key) {
            return;
        }
        self.core.said = None;
        self.awaited_jump = None;
        match &mut self.mode {
            Mode::Panes => {
                if let Some(action) = self.keymap.action(&key) {
                    self.act(action);
                }
            }
            Mode::Prompt(asking, prompt) => {
                let asking = *asking;
                if matches!(key.code, KeyCode::Tab | KeyCode::BackTab) {
                    return self.complete(key.code);
                }
                let event = prompt.key(key);
                self.typed(asking, event);
            }
            Mode::Letter { is_new } => {
                let is_new = *is_new;
                self.mode = Mode::Panes;
                if let KeyCode::Char(letter) = key.code {
                    self.letter(letter, is_new);
                }
            }
            Mode::Help(scroll) => match self.keymap.action(&key) {
                Some(Action::Down) => *scroll += 1,
                Some(Action::Up) => *scroll = scroll.saturating_sub(1),
                Some(Action::PageDown) => *scroll += usize::from(self.area.height / 2),
                Some(Action::PageUp) => *scroll = scroll.saturating_sub(usize::from(self.area.height / 2)),
                _ => self.mode = Mode::Panes,
            },
        }
    }

    /// Keeps a key whose meaning depends on an unread row. Quit acts at once, and Back ends a search.
    fn is_early(&mut self, key: KeyEvent) -> bool {
        let is_moving = matches!(self.mode, Mode::Panes) && self.core.is_moving();
        if !is_moving && self.core.window.is_some() {
            return false;
        }
        match self.keymap.action(&key) {
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
    pub fn paste(&mut self, text: &str) {
        if let Mode::Prompt(asking, prompt) = &mut self.mode {
            let asking = *asking;
            let event = prompt.paste(text);
            self.typed(asking, event);
        }
    }

    /// Handles a mouse event.
    pub fn mouse(&mut self, event: MouseEvent) {
        if !matches!(event.kind, MouseEventKind::Moved) {
            self.opens_at_story = false;
            self.awaited_jump = None;
        }
        // Some terminals report coordinate 0 as 65535.
        let x = event.column.min(self.area.width.saturating_sub(1));
        let y = event.row.min(self.area.height.saturating_sub(1));
        let parts = self.parts();
        let is_pressed = matches!(event.kind, MouseEventKind::Down(MouseButton::Left));
        if is_pressed {
            self.is_dragging = parts.strip.contains(Position::new(x, y));
        }
        if self.is_dragging && (is_pressed || matches!(event.kind, MouseEventKind::Drag(MouseButton::Left))) {
            return match strip::time_at(&self.core, parts.strip, x) {
                Some(time) => self.core.go(JumpPlace::Time(time)),
                None => self.core.refuse("this capture has no timestamps"),
            };
        }
        let cell = self.cells(parts.body).into_iter().find(|cell| cell.area.contains(Position::new(x, y)));
        if let Some(cell) = cell.filter(|cell| {
            cell.pane != self.pane && !matches!(event.kind, MouseEventKind::Moved) && self.is_in_panes()
        }) {
            self.show(cell.pane);
        }
        match event.kind {
            MouseEventKind::ScrollDown => (0..WHEEL).for_each(|_| self.act(Action::Down)),
            MouseEventKind::ScrollUp => (0..WHEEL).for_each(|_| self.act(Action::Up)),
            MouseEventKind::Down(MouseButton::Left) if cell.is_some() => {
                let area = cell.map_or(parts.body, |cell| cell.area);
                let is_second = self.clicked == Some((x, y));
                self.clicked = if is_second { None } else { Some((x, y)) };
                let effects = self.panes.get_mut(self.pane).map(|pane| pane.click(x, y, area, &self.core));
                self.apply(effects.unwrap_or_default());
                if is_second {
                    self.act(Action::Open);
                }
            }
            MouseEventKind::Down(MouseButton::Left) if y == parts.tabs.y => {
                if let Some(pane) = view::tab_at(x, self.area.width) {
                    self.show(pane);
                }
            }
            _ => {}
        }
        self.remember();
    }

    /// Handles a new size of the terminal.
    pub fn resize(&mut self, width: u16, height: u16) {
        self.area = ratatui::layout::Rect::new(0, 0, width, height);
        self.core.screen_height = height;
        self.fit();
        self.core.refresh();
    }

    /// Performs an action.
    pub fn act(&mut self, action: Action) {
        match action {
            Action::Quit => self.outputs.push(Output::Quit),
            Action::Help => self.mode = Mode::Help(0),
            Action::Pane(number) => match PaneId::ALL.get(usize::from(number)) {
                Some(pane) => self.show(*pane),
                None => self.core.refuse(&format!("no pane {number}")),
            },
            Action::NextPane => self.next_pane(true),
            Action::PreviousPane => self.next_pane(false),
            Action::Layout => self.next_layout(),
            Action::Zoom => self.zoom(),
            Action::SplitLeft => self.move_split(false),
            Action::SplitRight => self.move_split(true),
            Action::Strip => self.toggle_strip(),
            Action::Columns => self.ask_columns(),
            Action::Forget => self.forget(),
            Action::Filter => self.ask(PromptPurpose::Filter, "filter"),
            Action::Search => self.ask(PromptPurpose::Search, "search"),
            Action::GoTo => self.ask(PromptPurpose::GoTo, "go to"),
            Action::Export => self.ask(PromptPurpose::Export, "write to"),
            Action::Report => self.ask_report(),
            Action::Select => self.select(),
            Action::Pause => self.pause(),
            Action::SearchNext => self.core.search(false),
            Action::SearchPrevious => self.core.search(true),
            Action::NextStory => self.step_story(true),
            Action::PreviousStory => self.step_story(false),
            Action::NextFinding => self.finding(true),
            Action::PreviousFinding => self.finding(false),
            Action::NextError => self.error(true),
            Action::PreviousError => self.error(false),
            Action::Clock => self.core.next_clock(),
            Action::SetMark => self.mode = Mode::Letter { is_new: true },
            Action::ToMark => self.mode = Mode::Letter { is_new: false },
            Action::FilterCell => self.filter_cell(),
            Action::Assign => self.ask_assign(),
            Action::News => self.toggle_news(),
            Action::Copy => self.copy_line(),
            Action::Theme => self.next_theme(),
            Action::Clear => self.clear(),
            Action::Undo => self.undo(true),
            Action::Redo => self.undo(false),
            Action::Back => self.back(),
            Action::Up
            | Action::Down
            | Action::Left
            | Action::Right
            | Action::PageUp
            | Action::PageDown
            | Action::Top
            | Action::Bottom
            | Action::Open
            | Action::Toggle
            | Action::Sort
            | Action::Highlight
            | Action::Plot
            | Action::ZoomIn
            | Action::ZoomOut
            | Action::SetCursor => self.pass(action),
        }
    }

    fn select(&mut self) {
        self.core.selection = match self.core.selection {
            Some(_) => None,
            None => Some(self.core.cursor.frame),
        };
        match self.core.selection {
            Some(frame) => self.core.notify(&format!("selected from #{frame} to the cursor; w writes it")),
            None => self.core.notify("selection cleared"),
        }
    }

    fn pause(&mut self) {
        if !self.core.timeline.grows() && !self.core.is_following {
            return self.core.refuse("the capture is complete; no new frames to follow");
        }
        self.core.is_following = !self.core.is_following;
        self.core.notify(if self.core.is_following {
            "following new frames"
        } else {
            "paused at the cursor"
        });
        if self.core.is_following {
            self.core.go(JumpPlace::End);
        }
    }

    fn toggle_news(&mut self) {
        let only_news = !self.core.matcher.only_news;
        self.core.show(Matcher { only_news, ..self.core.matcher.clone() });
        self.core.notify(if only_news { "only changes" } else { "all events" });
    }

    fn copy_line(&mut self) {
        match self.panes.get(self.pane).and_then(|pane| pane.line(&self.core)) {
            Some(line) => self.apply(vec![Effect::Copy(line)]),
            None => self.core.refuse("nothing selected"),
        }
    }

    fn clear(&mut self) {
        let before = self.shown();
        self.core.sought = None;
        if self.core.matcher.filter.is_some() {
            self.filter("");
        }
        self.pass(Action::Clear);
        let cleared = before.cleared(&self.shown());
        if !cleared.is_empty() {
            self.core.notify(&format!("cleared: {}; u undoes it", cleared.join(", ")));
        }
    }

    /// Passes the action to the current pane. If the pane does not perform it, the panes that do are named.
    fn pass(&mut self, action: Action) {
        let Some(pane) = self.panes.get_mut(self.pane) else { return };
        let effects = pane.act(action, &self.core);
        if effects.is_empty() && OPTIONAL.contains(&action) && !pane.performs().contains(&action) {
            return self.refuse_action(action);
        }
        self.apply(effects);
    }

    /// `nothing to plot here; p works in Nodes, Events, Frames, Detail, Signals`.
    fn refuse_action(&mut self, action: Action) {
        let performs =
            |id: &&PaneId| self.panes.get(**id).is_some_and(|pane| pane.performs().contains(&action));
        let panes: Vec<&str> = PaneId::ALL.iter().filter(performs).map(|id| id.title()).collect();
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
        let key = self.keymap.keys(action).first().map_or("it", String::as_str);
        self.core.refuse(&format!("{nothing} here; {key} works in {}", panes.join(", ")));
    }

    fn apply(&mut self, effects: Vec<Effect>) {
        let mut is_plotted = false;
        for effect in effects {
            for pane in self.panes.all_mut() {
                pane.offer(&effect, &self.core);
            }
            match effect {
                Effect::Go(place) => self.core.go(place),
                Effect::ShowEvents => self.show(PaneId::Events),
                Effect::ShowDetail => self.show(PaneId::Detail),
                Effect::ShowSignals => self.show(PaneId::Signals),
                Effect::Filter(text) => self.filter(&text),
                Effect::Node(node) => self.core.node = Some(node),
                Effect::Plot(_) => is_plotted = true,
                Effect::Say(text) => self.core.notify(&text),
                Effect::Refuse(text) => self.core.refuse(&text),
                Effect::Copy(text) => {
                    self.core.notify("copied");
                    self.outputs.push(Output::Copy(text));
                }
            }
        }
        if is_plotted {
            self.show(PaneId::Signals);
        }
        self.refresh_panes();
    }

    /// Closes the open part of the pane, else shows the previous pane.
    fn back(&mut self) {
        let effects = self.panes.get_mut(self.pane).map(|pane| pane.act(Action::Back, &self.core));
        match effects {
            Some(effects) if !effects.is_empty() => self.apply(effects),
            _ => {
                if let Some(pane) = self.trail.pop() {
                    self.focus(pane);
                }
            }
        }
    }

    fn next_theme(&mut self) {
        let theme = self.core.theme;
        self.core.theme = match (theme.depth(), theme.palette()) {
            (Depth::None, _) => theme.with(Palette::Dark, Depth::Full),
            (Depth::Full, Palette::Dark) => theme.with(Palette::Light, Depth::Full),
            (Depth::Full, Palette::Light) => theme.with(Palette::Dark, Depth::Sixteen),
            (Depth::Sixteen, Palette::Dark) => theme.with(Palette::Light, Depth::Sixteen),
            (Depth::Sixteen, Palette::Light) => theme.with(Palette::Dark, Depth::None),
        };
    }
}
