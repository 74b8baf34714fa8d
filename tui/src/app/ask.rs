//! Prompts: input, checks and effects.

use cobscope_decoder::query::Filter;

use super::application::{App, Mode, PromptPurpose};
use super::report::has_format as has_report_format;
use crate::select::Bound;
use crate::state::{Core, JumpPlace, SearchPattern, TimeDisplay};
use crate::timeline::{Export, Matcher};
use crate::widgets::prompt::{Prompt, PromptEvent};

impl App {
    pub(super) fn ask(&mut self, asking: PromptPurpose, label: &'static str) {
        let history = self.typed.iter().filter(|(other, _)| *other == asking).map(|(_, text)| text.clone());
        let mut prompt = Prompt::new(label).with_history(history);
        if asking == PromptPurpose::Filter {
            prompt.set_text(&self.core.filter);
            self.filter_before.clone_from(&self.core.filter);
        }
        if asking == PromptPurpose::Export {
            prompt.propose(&self.export_name());
        }
        self.mode = Mode::Prompt(asking, prompt);
        self.refresh_prompt_row();
    }

    /// Default file name of an export, in the current folder.
    pub(super) fn export_name(&self) -> String {
        let stem = self.capture_stem();
        match self.core.selected_frames() {
            Some((first, last)) => format!("{stem}-{first}-{last}.log"),
            None => format!("{stem}-export.log"),
        }
    }

    /// Name of the first capture without folder and suffix.
    pub(super) fn capture_stem(&self) -> String {
        let name = self.core.timeline.lanes().first().map_or("-", |lane| lane.store.name());
        let stem = std::path::Path::new(name).file_stem().and_then(|stem| stem.to_str());
        stem.filter(|stem| *stem != "-").unwrap_or("capture").to_owned()
    }

    /// Opens the prompt for a profile, device file or database of the selected node.
    pub(super) fn ask_assign(&mut self) {
        match self.assigned_node() {
            Ok(node) => {
                self.assigning = Some(node);
                self.ask(PromptPurpose::Assign, "profile, EDS or DBC");
                let proposed = self.proposed_profile(node);
                if let (Mode::Prompt(_, prompt), Some(profile)) = (&mut self.mode, proposed) {
                    prompt.propose(&profile);
                }
                self.refresh_prompt_row();
            }
            Err(reason) => self.core.refuse(&reason),
        }
    }

    /// Handles a change, submission or cancellation of the prompt.
    pub(super) fn typed(&mut self, asking: PromptPurpose, event: PromptEvent) {
        self.react(asking, event);
        self.refresh_prompt_row();
    }

    fn react(&mut self, asking: PromptPurpose, event: PromptEvent) {
        let Mode::Prompt(_, prompt) = &mut self.mode else { return };
        let text = prompt.text().to_owned();
        let is_text = matches!(event, PromptEvent::Changed | PromptEvent::Submitted);
        if asking == PromptPurpose::Search && is_text && self.search_pane(&text) {
            if event == PromptEvent::Submitted {
                self.mode = Mode::Panes;
            }
            return;
        }
        let Mode::Prompt(_, prompt) = &mut self.mode else { return };
        match event {
            PromptEvent::Ignored => {}
            PromptEvent::Cancelled => {
                self.mode = Mode::Panes;
                if asking == PromptPurpose::Search {
                    self.search_pane("");
                }
                if asking == PromptPurpose::Filter && self.core.filter != self.filter_before {
                    self.filter(&self.filter_before.clone());
                }
            }
            PromptEvent::Changed => {
                if let Err((offset, reason)) = check(asking, &text) {
                    return prompt.set_error(offset, reason);
                }
                prompt.clear_error();
                // The filter applies while it is typed.
                if asking == PromptPurpose::Filter && text.trim() != self.core.filter {
                    self.filter(&text);
                }
            }
            PromptEvent::Submitted
                if text.trim().is_empty()
                    && !matches!(asking, PromptPurpose::Filter | PromptPurpose::Columns) =>
            {
                self.mode = Mode::Panes;
            }
            PromptEvent::Submitted => self.submitted(asking, &text),
        }
    }

    /// Closes the prompt and applies its text, unless it has an error.
    fn submitted(&mut self, asking: PromptPurpose, text: &str) {
        let Mode::Prompt(_, prompt) = &mut self.mode else { return };
        if let Err((offset, reason)) = check(asking, text) {
            return prompt.set_error(offset, reason);
        }
        let done = match (asking, self.assigning) {
            (PromptPurpose::Assign, Some(node)) => self.assign(node, text),
            (PromptPurpose::Columns, _) => self.choose_columns(text),
            _ => Ok(()),
        };
        if let Err(reason) = done {
            if let Mode::Prompt(_, prompt) = &mut self.mode {
                prompt.set_error(0, reason);
            }
            return;
        }
        self.mode = Mode::Panes;
        self.typed.retain(|(other, old)| *other != asking || old != text);
        self.typed.push((asking, text.to_owned()));
        self.submit(asking, text);
    }

    /// Passes the search text to the pane; `false` if the pane has no search of its own.
    pub(super) fn search_pane(&mut self, text: &str) -> bool {
        self.panes.get_mut(self.pane).is_some_and(|pane| pane.search(text, &self.core))
    }

    pub(super) fn submit(&mut self, asking: PromptPurpose, text: &str) {
        match asking {
            PromptPurpose::Filter => self.filter(text),
            PromptPurpose::Search => {
                self.core.sought = SearchPattern::new(text).ok();
                self.core.search(false);
            }
            PromptPurpose::GoTo => match bound(&self.core, text) {
                Some(Ok(bound)) => self.core.go_to(bound),
                Some(Err(reason)) => self.core.refuse(&reason),
                None => {}
            },
            PromptPurpose::Export => self.core.export(text),
            PromptPurpose::Report => self.report(text),
            // Done while the prompt could still show an error.
            PromptPurpose::Assign | PromptPurpose::Columns => {}
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
        let Some(wanted) = wanted else { return self.core.refuse("no filter for this cell") };
        let is_more = !self.core.filter.is_empty() && !self.core.filter.contains(&wanted);
        let text = if is_more { format!("({}) && {wanted}", self.core.filter) } else { wanted };
        self.filter(&text);
        self.core.notify(&format!("filter {text}"));
    }

    pub(super) fn letter(&mut self, letter: char, is_new: bool) {
        if is_new {
            self.core.marks.insert(letter, self.core.cursor);
            self.core.notify(&format!("mark {letter} set"));
        } else if let Some(spot) = self.core.marks.get(&letter).copied() {
            self.core.go(JumpPlace::Event(spot));
        } else {
            self.core.refuse(&format!("mark {letter} is not set"));
        }
    }
}

/// The typed position; None for an incomplete text.
fn bound(core: &Core, text: &str) -> Option<Result<Bound, String>> {
    // While local times are shown, a typed time of day is local.
    let local = (core.clock == TimeDisplay::Local).then(|| Bound::local(text)).flatten().map(Err);
    Some(match local.or_else(|| place(text))? {
        Ok(step) => match core.time() {
            Some(time) => Ok(Bound::Moment(time.plus(step))),
            None => Err("this capture has no timestamps; enter a frame as #1234".to_owned()),
        },
        Err(bound) => Ok(bound),
    })
}

/// Target of the typed position, or the reason why there is none; None for an incomplete text.
pub(super) fn target(core: &Core, text: &str) -> Option<Result<JumpPlace, String>> {
    Some(bound(core, text)?.and_then(|bound| core.inside(bound)))
}

/// Checks a text; the error has a byte offset and a message.
pub(super) fn check(asking: PromptPurpose, text: &str) -> Result<(), (usize, String)> {
    match asking {
        _ if text.trim().is_empty() => Ok(()),
        PromptPurpose::Assign | PromptPurpose::Columns => Ok(()),
        PromptPurpose::Filter => match text.parse::<Filter>() {
            Ok(_) => Ok(()),
            Err(error) => Err((error.at().start, error.reason().to_owned())),
        },
        PromptPurpose::Search => SearchPattern::new(text).map(|_| ()).map_err(|error| (0, error)),
        PromptPurpose::Export => {
            let known: Vec<_> =
                Export::suffixes().map(|(known, title)| format!(".{known} {title}")).collect();
            if Export::has_format(text.as_ref()) { Ok(()) } else { Err((text.len(), known.join(", "))) }
        }
        PromptPurpose::Report => {
            let expected = ".html, .md".to_owned();
            if has_report_format(text.as_ref()) { Ok(()) } else { Err((text.len(), expected)) }
        }
        PromptPurpose::GoTo => {
            let expected = "expected 12.5 (seconds), #1234 (frame), -0.05 or +0.05 (relative), 22:13:25, or a date and time";
            place(text).map(|_| ()).ok_or_else(|| (0, expected.to_owned()))
        }
    }
}

/// A relative step in ns, or an absolute place.
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
        Bound::Frame(_) | Bound::Moment(_) | Bound::Clock(_) => None,
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
        assert!(matches!(place("22:13:25.5"), Some(Err(Bound::Clock(_)))));
        assert_eq!(place("later"), None);
    }
}
