//! What is asked at the prompt, and what is done with the answer.

use cobscope_decoder::query::Filter;

use super::application::{App, Asking, Mode};
use crate::select::Bound;
use crate::state::{Place, Sought, pattern};
use crate::timeline::{Export, Matcher};
use crate::widgets::prompt::{Prompt, PromptEvent};

impl App {
    pub(super) fn ask(&mut self, asking: Asking, label: &'static str) {
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
    pub(super) fn export_name(&self) -> String {
        let name = self.core.timeline.lanes().first().map_or("-", |lane| lane.store.name());
        let stem = std::path::Path::new(name).file_stem().and_then(|stem| stem.to_str());
        let stem = stem.filter(|stem| *stem != "-").unwrap_or("capture");
        match self.core.selected_frames() {
            Some((first, last)) => format!("{stem}-{first}-{last}.log"),
            None => format!("{stem}-export.log"),
        }
    }

    /// The text in the prompt changed, is done or given up.
    pub(super) fn typed(&mut self, asking: Asking, event: PromptEvent) {
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
    pub(super) fn search_pane(&mut self, text: &str) -> bool {
        self.panes.get_mut(self.pane).is_some_and(|pane| pane.search(text, &self.core))
    }

    pub(super) fn submit(&mut self, asking: Asking, text: &str) {
        match asking {
            Asking::Filter => self.filter(text),
            Asking::Search => {
                self.core.sought =
                    pattern(text).ok().map(|pattern| Sought { text: text.to_owned(), pattern });
                self.core.search(false);
            }
            Asking::GoTo => match place(text) {
                Some(Ok(step)) => match self.core.time() {
                    Some(time) => self.core.go_to(Bound::Moment(time.plus(step))),
                    None => self.core.refuse("this capture has no times; go to a frame as #1234"),
                },
                Some(Err(bound)) => self.core.go_to(bound),
                None => {}
            },
            Asking::Export => self.core.export(text),
        }
        self.refresh_panes();
    }

    pub(super) fn filter(&mut self, text: &str) {
        let filter = if text.trim().is_empty() { Ok(None) } else { text.parse::<Filter>().map(Some) };
        match filter {
            Ok(filter) => {
                text.trim().clone_into(&mut self.core.filter);
                self.core.show(Matcher { filter, ..self.core.matcher.clone() });
            }
            Err(error) => self.core.refuse(&format!("{text}: {}", error.reason())),
        }
    }

    pub(super) fn filter_cell(&mut self) {
        let wanted = self.panes.get(self.pane).and_then(|pane| pane.filter_of_cell(&self.core));
        let Some(wanted) = wanted else { return self.core.refuse("nothing here can be filtered by") };
        let is_more = !self.core.filter.is_empty() && !self.core.filter.contains(&wanted);
        let text = if is_more { format!("({}) && {wanted}", self.core.filter) } else { wanted };
        self.filter(&text);
        self.core.say(&format!("filter {text}"));
    }

    pub(super) fn letter(&mut self, letter: char, is_new: bool) {
        if is_new {
            self.core.marks.insert(letter, self.core.cursor);
            self.core.say(&format!("mark {letter} is here"));
        } else if let Some(spot) = self.core.marks.get(&letter).copied() {
            self.core.go(Place::Spot(spot));
        } else {
            self.core.refuse(&format!("there is no mark {letter}"));
        }
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
            let known: Vec<_> =
                Export::suffixes().map(|(known, title)| format!(".{known} {title}")).collect();
            if Export::has_format(text.as_ref()) { Ok(()) } else { Err((text.len(), known.join(", "))) }
        }
        Asking::GoTo => {
            let expected =
                "expected 12.5 (seconds), #1234 (frame), -0.05 or +0.05 (from here), or a date and time";
            place(text).map(|_| ()).ok_or_else(|| (0, expected.to_owned()))
        }
    }
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
}
