//! Keys, clicks and texts to changes.

use cobscope_decoder::query::Filter;
use ratatui::crossterm::event::{KeyCode, KeyEvent, MouseButton, MouseEvent, MouseEventKind};
use ratatui::layout::Position;
use regex_lite::Regex;

use super::{Action, App, Asking, Effect, Mode, PaneId, Place, Sought, view};
use crate::keymap;
use crate::select::Bound;
use crate::theme::{Depth, Palette};
use crate::timeline::{Export, Matcher};
use crate::widgets::prompt::{Prompt, PromptEvent};

/// What the terminal is to do.
#[derive(Debug, Clone, PartialEq, Eq)]
pub enum Output {
    /// Leave.
    Quit,
    /// Put a text on the clipboard.
    Copy(String),
}

/// Keys kept until there is something they can mean.
const MOST_EARLY: usize = 64;

/// Rows a turn of the mouse wheel goes.
const WHEEL: usize = 3;

impl App {
    /// A key was pressed.
    pub fn key(&mut self, key: KeyEvent) {
        if self.core.window.is_none() && keymap::action(&key) != Some(Action::Quit) {
            if self.early.len() < MOST_EARLY {
                self.early.push(key);
            }
            return;
        }
        self.core.said = None;
        match &mut self.mode {
            Mode::Panes => {
                if let Some(action) = keymap::action(&key) {
                    self.act(action);
                }
            }
            Mode::Asking(asking, prompt) => {
                let asking = *asking;
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
            Mode::Help(scroll) => match keymap::action(&key) {
                Some(Action::Down) => *scroll += 1,
                Some(Action::Up) => *scroll = scroll.saturating_sub(1),
                Some(Action::PageDown) => *scroll += usize::from(self.area.height / 2),
                Some(Action::PageUp) => *scroll = scroll.saturating_sub(usize::from(self.area.height / 2)),
                Some(Action::Quit) => self.outputs.push(Output::Quit),
                _ => self.mode = Mode::Panes,
            },
        }
    }

    /// A text was pasted.
    pub fn paste(&mut self, text: &str) {
        if let Mode::Asking(asking, prompt) = &mut self.mode {
            let asking = *asking;
            let event = prompt.paste(text);
            self.typed(asking, event);
        }
    }

    /// The mouse did something.
    pub fn mouse(&mut self, event: MouseEvent) {
        // A report of coordinate 0 comes as 65535.
        let x = event.column.min(self.area.width.saturating_sub(1));
        let y = event.row.min(self.area.height.saturating_sub(1));
        let parts = view::parts(self.area);
        match event.kind {
            MouseEventKind::ScrollDown => (0..WHEEL).for_each(|_| self.act(Action::Down)),
            MouseEventKind::ScrollUp => (0..WHEEL).for_each(|_| self.act(Action::Up)),
            MouseEventKind::Down(MouseButton::Left) if parts.body.contains(Position::new(x, y)) => {
                let is_second = self.clicked == Some((x, y));
                self.clicked = if is_second { None } else { Some((x, y)) };
                let effects =
                    self.panes.get_mut(self.pane).map(|pane| pane.click(x, y, parts.body, &self.core));
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
    }

    /// The terminal has another size.
    pub fn resize(&mut self, width: u16, height: u16) {
        self.area = ratatui::layout::Rect::new(0, 0, width, height);
        let body = view::parts(self.area).body;
        (self.core.height, self.core.width) = (body.height, body.width);
        self.core.refresh();
    }

    /// Does what a key stands for.
    pub fn act(&mut self, action: Action) {
        match action {
            Action::Quit => self.outputs.push(Output::Quit),
            Action::Help => self.mode = Mode::Help(0),
            Action::Pane(number) => match PaneId::ALL.get(usize::from(number).saturating_sub(1)) {
                Some(pane) => self.show(*pane),
                None => self.core.refuse(&format!("there is no pane {number}")),
            },
            Action::NextPane => self.next_pane(1),
            Action::PreviousPane => self.next_pane(PaneId::ALL.len() - 1),
            Action::Filter => self.ask(Asking::Filter, "filter"),
            Action::Search => self.ask(Asking::Search, "search"),
            Action::GoTo => self.ask(Asking::GoTo, "go to"),
            Action::Export => self.ask(Asking::Export, "write to"),
            Action::Select => self.select(),
            Action::Pause => self.pause(),
            Action::SearchNext => self.core.search(false),
            Action::SearchPrevious => self.core.search(true),
            Action::NextFinding => self.finding(true),
            Action::PreviousFinding => self.finding(false),
            Action::NextError => self.error(true),
            Action::PreviousError => self.error(false),
            Action::SetMark => self.mode = Mode::Letter { is_new: true },
            Action::ToMark => self.mode = Mode::Letter { is_new: false },
            Action::FilterCell => self.filter_cell(),
            Action::News => {
                let only_news = !self.core.matcher.only_news;
                self.core.show(Matcher { only_news, ..self.core.matcher.clone() });
                self.core.say(if only_news { "only what says something new" } else { "all events" });
            }
            Action::Copy => match self.panes.get(self.pane).and_then(|pane| pane.line(&self.core)) {
                Some(line) => self.apply(vec![Effect::Copy(line)]),
                None => self.core.refuse("nothing is selected"),
            },
            Action::CopyCommand => self.apply(vec![Effect::Copy(self.command())]),
            Action::Theme => self.next_theme(),
            Action::Clear => {
                self.core.sought = None;
                if self.core.matcher.filter.is_some() {
                    self.filter("");
                }
                self.pass(action);
            }
            Action::Back => self.back(),
            _ => self.pass(action),
        }
    }

    fn select(&mut self) {
        self.core.selection = match self.core.selection {
            Some(_) => None,
            None => Some(self.core.cursor.frame),
        };
        match self.core.selection {
            Some(frame) => self.core.say(&format!("selected from #{frame} to the cursor; w writes it")),
            None => self.core.say("nothing is selected"),
        }
    }

    fn pause(&mut self) {
        self.core.is_following = !self.core.is_following;
        self.core.say(if self.core.is_following { "following what comes" } else { "staying here" });
        self.core.follow();
    }

    /// Lets the pane do it.
    fn pass(&mut self, action: Action) {
        let effects = self.panes.get_mut(self.pane).map(|pane| pane.act(action, &self.core));
        self.apply(effects.unwrap_or_default());
    }

    fn apply(&mut self, effects: Vec<Effect>) {
        let mut is_plotted = false;
        for effect in effects {
            for pane in self.panes.all_mut() {
                pane.offer(&effect, &self.core);
            }
            match effect {
                Effect::Go(place) => self.core.go(place),
                Effect::Show(pane) => self.show(pane),
                Effect::Filter(text) => self.filter(&text),
                Effect::Node(node) => self.core.node = Some(node),
                Effect::Plot(_) => is_plotted = true,
                Effect::Say(text) => self.core.say(&text),
                Effect::Refuse(text) => self.core.refuse(&text),
                Effect::Copy(text) => {
                    self.core.say("copied");
                    self.outputs.push(Output::Copy(text));
                }
            }
        }
        if is_plotted {
            self.show(PaneId::Signals);
        }
        self.refresh_panes();
    }

    fn show(&mut self, pane: PaneId) {
        if pane != self.pane {
            self.trail.retain(|other| *other != pane);
            self.trail.push(self.pane);
            self.pane = pane;
            self.refresh_panes();
        }
    }

    fn next_pane(&mut self, by: usize) {
        let next = (self.pane as usize + by) % PaneId::ALL.len();
        if let Some(pane) = PaneId::ALL.get(next) {
            self.show(*pane);
        }
    }

    /// Out of what the pane has open, else to the pane before.
    fn back(&mut self) {
        let effects = self.panes.get_mut(self.pane).map(|pane| pane.act(Action::Back, &self.core));
        match effects {
            Some(effects) if !effects.is_empty() => self.apply(effects),
            _ => {
                if let Some(pane) = self.trail.pop() {
                    self.pane = pane;
                }
            }
        }
    }

    fn ask(&mut self, asking: Asking, label: &'static str) {
        let history = self.typed.iter().filter(|(other, _)| *other == asking).map(|(_, text)| text.clone());
        let mut prompt = Prompt::new(label).with_history(history);
        if asking == Asking::Filter {
            prompt.set_text(&self.core.filter);
            self.filter_before.clone_from(&self.core.filter);
        }
        if asking == Asking::Export {
            prompt.set_text(&self.export_name());
        }
        self.mode = Mode::Asking(asking, prompt);
    }

    /// A name for an export, in the folder the program was started in.
    fn export_name(&self) -> String {
        let name = self.core.timeline.lanes().first().map_or("-", |lane| lane.store.name());
        let stem = std::path::Path::new(name).file_stem().and_then(|stem| stem.to_str());
        let stem = stem.filter(|stem| *stem != "-").unwrap_or("capture");
        match self.core.selected_frames() {
            Some((first, last)) => format!("{stem}-{first}-{last}.log"),
            None => format!("{stem}-export.log"),
        }
    }

    /// The text in the prompt changed, is done or given up.
    fn typed(&mut self, asking: Asking, event: PromptEvent) {
        let Mode::Asking(_, prompt) = &mut self.mode else { return };
        let text = prompt.text().to_owned();
        let is_text = matches!(event, PromptEvent::Changed | PromptEvent::Submitted);
        if asking == Asking::Search && is_text && self.search_pane(&text) {
            if event == PromptEvent::Submitted {
                self.mode = Mode::Panes;
            }
            return;
        }
        let Mode::Asking(_, prompt) = &mut self.mode else { return };
        match event {
            PromptEvent::Ignored => {}
            PromptEvent::Cancelled => {
                self.mode = Mode::Panes;
                if asking == Asking::Search {
                    self.search_pane("");
                }
                if asking == Asking::Filter && self.core.filter != self.filter_before {
                    self.filter(&self.filter_before.clone());
                }
            }
            PromptEvent::Changed => {
                if let Err((offset, reason)) = check(asking, &text) {
                    return prompt.set_error(offset, reason);
                }
                prompt.clear_error();
                // What is shown follows what is typed.
                if asking == Asking::Filter && text.trim() != self.core.filter {
                    self.filter(&text);
                }
            }
            PromptEvent::Submitted if text.trim().is_empty() && asking != Asking::Filter => {
                self.mode = Mode::Panes;
            }
            PromptEvent::Submitted => {
                if let Err((offset, reason)) = check(asking, &text) {
                    return prompt.set_error(offset, reason);
                }
                self.mode = Mode::Panes;
                self.typed.retain(|(other, old)| *other != asking || *old != text);
                self.typed.push((asking, text.clone()));
                self.submit(asking, &text);
            }
        }
    }

    /// Lets the pane look for a text, if it does so itself.
    fn search_pane(&mut self, text: &str) -> bool {
        self.panes.get_mut(self.pane).is_some_and(|pane| pane.search(text, &self.core))
    }

    fn submit(&mut self, asking: Asking, text: &str) {
        match asking {
            Asking::Filter => self.filter(text),
            Asking::Search => {
                self.core.sought =
                    pattern(text).ok().map(|pattern| Sought { text: text.to_owned(), pattern });
                self.core.search(false);
            }
            Asking::GoTo => match place(text) {
                Some(Ok(step)) => self.core.go(Place::Step(step)),
                Some(Err(Bound::Frame(frame))) => self.core.go(Place::Frame(frame)),
                Some(Err(Bound::Moment(time))) => self.core.go(Place::Time(time)),
                Some(Err(Bound::Offset(offset))) => match self.core.zero() {
                    Some(zero) => self.core.go(Place::Time(zero.plus(offset))),
                    None => self.core.refuse("this capture has no times; go to a frame as #1234"),
                },
                None => {}
            },
            Asking::Export => self.core.export(text),
        }
        self.refresh_panes();
    }

    fn filter(&mut self, text: &str) {
        let filter = if text.trim().is_empty() { Ok(None) } else { text.parse::<Filter>().map(Some) };
        match filter {
            Ok(filter) => {
                text.trim().clone_into(&mut self.core.filter);
                self.core.show(Matcher { filter, ..self.core.matcher.clone() });
            }
            Err(error) => self.core.refuse(&format!("{text}: {}", error.reason())),
        }
    }

    fn filter_cell(&mut self) {
        let wanted = self.panes.get(self.pane).and_then(|pane| pane.filter_of_cell(&self.core));
        let Some(wanted) = wanted else { return self.core.refuse("nothing here can be filtered by") };
        let is_more = !self.core.filter.is_empty() && !self.core.filter.contains(&wanted);
        let text = if is_more { format!("({}) && {wanted}", self.core.filter) } else { wanted };
        self.filter(&text);
        self.core.say(&format!("filter {text}"));
    }

    fn letter(&mut self, letter: char, is_new: bool) {
        if is_new {
            self.core.marks.insert(letter, self.core.cursor);
            self.core.say(&format!("mark {letter} is here"));
        } else if let Some(spot) = self.core.marks.get(&letter).copied() {
            self.core.go(Place::Spot(spot));
        } else {
            self.core.refuse(&format!("there is no mark {letter}"));
        }
    }

    fn finding(&mut self, is_forward: bool) {
        let cursor = self.core.cursor.frame;
        let survey = self.core.timeline.survey();
        let places = survey.places.iter();
        let next = if is_forward {
            places.clone().find(|place| place.frame > cursor)
        } else {
            places.rev().find(|place| place.frame < cursor)
        }
        .copied();
        let is_complete = survey.is_complete;
        drop(survey);
        match next {
            Some(place) => {
                self.core.go(Place::Frame(place.frame));
                let text = self.core.finding_text(place.id);
                self.core.say(&text);
            }
            None if is_complete => self.core.refuse("no further finding that way"),
            None => self.core.refuse("no further finding so far; the capture is still being judged"),
        }
        self.refresh_panes();
    }

    fn error(&mut self, is_forward: bool) {
        let cursor = self.core.cursor;
        let survey = self.core.timeline.survey();
        let at = survey.errors.partition_point(|spot| *spot <= cursor);
        let before = survey.errors.partition_point(|spot| *spot < cursor);
        let next = if is_forward {
            survey.errors.get(at)
        } else {
            before.checked_sub(1).and_then(|at| survey.errors.get(at))
        };
        let next = next.copied();
        drop(survey);
        match next {
            Some(spot) => self.core.go(Place::Spot(spot)),
            None => self.core.refuse("no further error that way"),
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

/// What is wrong with a text, and from which byte on.
fn check(asking: Asking, text: &str) -> Result<(), (usize, String)> {
    match asking {
        _ if text.trim().is_empty() => Ok(()),
        Asking::Filter => match text.parse::<Filter>() {
            Ok(_) => Ok(()),
            Err(error) => Err((error.at().start, error.reason().to_owned())),
        },
        Asking::Search => pattern(text).map(|_| ()).map_err(|error| (0, error)),
        Asking::Export => {
            let suffix = text.rsplit_once('.').map_or("", |(_, suffix)| suffix);
            let is_known = Export::suffixes().any(|(known, _)| known == suffix);
            let known: Vec<_> =
                Export::suffixes().map(|(known, title)| format!(".{known} {title}")).collect();
            if is_known { Ok(()) } else { Err((text.len(), known.join(", "))) }
        }
        Asking::GoTo => {
            let expected =
                "expected 12.5 (seconds), #1234 (frame), -0.05 or +0.05 (from here), or a date and time";
            place(text).map(|_| ()).ok_or_else(|| (0, expected.to_owned()))
        }
    }
}

/// A pattern; without capital letters in it case does not matter.
///
/// # Errors
/// What is wrong with it.
pub fn pattern(text: &str) -> Result<Regex, String> {
    let is_any_case = !text.chars().any(char::is_uppercase);
    let written = if is_any_case { format!("(?i){text}") } else { text.to_owned() };
    Regex::new(&written).map_err(|error| error.to_string())
}

/// A step from here, or a place.
fn place(text: &str) -> Option<Result<i64, Bound>> {
    let text = text.trim();
    let sign = match text.chars().next()? {
        '+' => 1,
        '-' => -1,
        _ => return text.parse().ok().map(Err),
    };
    let rest = text.get(1..)?.trim_end_matches('s');
    let (number, factor) = match rest.strip_suffix('m') {
        Some(number) => (number, 1_000),
        None => (rest, 1),
    };
    match number.parse().ok()? {
        Bound::Offset(offset) => Some(Ok(sign * offset / factor)),
        Bound::Frame(_) | Bound::Moment(_) => None,
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn places_are_steps_from_here_or_on_their_own() {
        assert_eq!(place("-0.05"), Some(Ok(-50_000_000)));
        assert_eq!(place("+50ms"), Some(Ok(50_000_000)));
        assert_eq!(place("-2s"), Some(Ok(-2_000_000_000)));
        assert_eq!(place("12.5"), Some(Err(Bound::Offset(12_500_000_000))));
        assert_eq!(place("#7"), Some(Err(Bound::Frame(7))));
        assert_eq!(place("-#7"), None);
        assert_eq!(place("later"), None);
    }

    #[test]
    fn a_search_minds_case_only_if_it_is_typed_with_some() {
        assert!(pattern("emcy").unwrap().is_match("EMCY"));
        assert!(!pattern("Emcy").unwrap().is_match("EMCY"));
        assert!(pattern("[").is_err());
    }
}
