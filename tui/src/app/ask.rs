//! Prompts: input, checks and effects.

use cobscope_decoder::query::Filter;

use super::application::{App, InputMode, PromptPurpose};
use super::assign::proposed_profile;
use super::requests::has_format as has_report_format;
use crate::select::RangeBound;
use crate::state::{JumpPlace, SearchPattern, TimeDisplay, UiState};
use crate::timeline::{ExportRequest, RowMatcher};
use crate::widgets::prompt::{LinePrompt, PromptEvent};

impl App {
    pub(super) fn open_prompt(&mut self, asking: PromptPurpose, label: &'static str) {
        let history = self.typed.iter().filter(|(other, _)| *other == asking).map(|(_, text)| text.clone());
        let mut prompt = LinePrompt::new(label).with_history(history);
        if asking == PromptPurpose::Filter {
            prompt.set_text(&self.core.filter);
            self.filter_before.clone_from(&self.core.filter);
        }
        if asking == PromptPurpose::Export {
            prompt.propose_text(&export_name(&self.core));
        }
        self.mode = InputMode::Prompt(asking, prompt);
        self.refresh_prompt_row();
    }

    /// Opens the prompt for a profile, device file or database of the selected node.
    pub(super) fn ask_assign(&mut self) {
        match self.assigned_node() {
            Ok(node) => {
                self.assigning = Some(node);
                self.open_prompt(PromptPurpose::Assign, "profile, EDS or DBC");
                let proposed = proposed_profile(&self.core, node);
                if let (InputMode::Prompt(_, prompt), Some(profile)) = (&mut self.mode, proposed) {
                    prompt.propose_text(&profile);
                }
                self.refresh_prompt_row();
            }
            Err(reason) => self.core.show_refusal(&reason),
        }
    }

    /// Handles a change, submission or cancellation of the prompt.
    pub(super) fn on_typed(&mut self, asking: PromptPurpose, event: PromptEvent) {
        self.on_prompt(asking, event);
        self.refresh_prompt_row();
    }

    fn on_prompt(&mut self, asking: PromptPurpose, event: PromptEvent) {
        let InputMode::Prompt(_, prompt) = &mut self.mode else { return };
        let text = prompt.text().to_owned();
        let is_text = matches!(event, PromptEvent::Changed | PromptEvent::Submitted);
        if asking == PromptPurpose::Search && is_text && self.panes.search_text(&text, &self.core) {
            if event == PromptEvent::Submitted {
                self.mode = InputMode::Panes;
            }
            return;
        }
        let InputMode::Prompt(_, prompt) = &mut self.mode else { return };
        match event {
            PromptEvent::Ignored => {}
            PromptEvent::Cancelled => {
                self.mode = InputMode::Panes;
                if asking == PromptPurpose::Search {
                    self.panes.search_text("", &self.core);
                }
                if asking == PromptPurpose::Filter && self.core.filter != self.filter_before {
                    apply_filter(&mut self.core, &self.filter_before);
                }
            }
            PromptEvent::Changed => {
                if let Err((offset, reason)) = check_text(asking, &text) {
                    return prompt.set_error(offset, reason);
                }
                prompt.clear_error();
                // The filter applies while it is typed.
                if asking == PromptPurpose::Filter && text.trim() != self.core.filter {
                    apply_filter(&mut self.core, &text);
                }
            }
            PromptEvent::Submitted
                if text.trim().is_empty()
                    && !matches!(asking, PromptPurpose::Filter | PromptPurpose::Columns) =>
            {
                self.mode = InputMode::Panes;
            }
            PromptEvent::Submitted => self.on_submitted(asking, &text),
        }
    }

    /// Closes the prompt and applies its text, unless it has an error.
    fn on_submitted(&mut self, asking: PromptPurpose, text: &str) {
        let InputMode::Prompt(_, prompt) = &mut self.mode else { return };
        if let Err((offset, reason)) = check_text(asking, text) {
            return prompt.set_error(offset, reason);
        }
        let done = match (asking, self.assigning) {
            (PromptPurpose::Assign, Some(node)) => self.assign_profile(node, text),
            (PromptPurpose::Columns, _) => self.choose_columns(text),
            _ => Ok(()),
        };
        if let Err(reason) = done {
            if let InputMode::Prompt(_, prompt) = &mut self.mode {
                prompt.set_error(0, reason);
            }
            return;
        }
        self.mode = InputMode::Panes;
        self.typed.retain(|(other, old)| *other != asking || old != text);
        self.typed.push((asking, text.to_owned()));
        self.apply_text(asking, text);
    }

    pub(super) fn apply_text(&mut self, asking: PromptPurpose, text: &str) {
        match asking {
            PromptPurpose::Filter => apply_filter(&mut self.core, text),
            PromptPurpose::Search => {
                self.core.sought = SearchPattern::new(text).ok();
                self.core.search_row(false);
            }
            PromptPurpose::GoTo => match parse_bound(&self.core, text) {
                Some(Ok(bound)) => self.core.go_to(bound),
                Some(Err(reason)) => self.core.show_refusal(&reason),
                None => {}
            },
            PromptPurpose::Export => self.core.export_file(text),
            PromptPurpose::Report => self.reports.write_page(&mut self.core, text),
            // Done while the prompt could still show an error.
            PromptPurpose::Assign | PromptPurpose::Columns => {}
        }
        self.panes.refresh_panes(&self.core);
    }

    pub(super) fn filter_cell(&mut self) {
        let wanted = self.panes.focused_pane().and_then(|pane| pane.filter_of_cell(&self.core));
        let Some(wanted) = wanted else { return self.core.show_refusal("no filter for this cell") };
        let is_more = !self.core.filter.is_empty() && !self.core.filter.contains(&wanted);
        let text = if is_more { format!("({}) && {wanted}", self.core.filter) } else { wanted };
        apply_filter(&mut self.core, &text);
        self.core.show_message(&format!("filter {text}"));
    }
}

/// Default file name of an export, in the current folder.
fn export_name(core: &UiState) -> String {
    let stem = capture_stem(core);
    match core.selected_frames() {
        Some((first, last)) => format!("{stem}-{first}-{last}.log"),
        None => format!("{stem}-export.log"),
    }
}

/// Name of the first capture without folder and suffix.
pub(super) fn capture_stem(core: &UiState) -> String {
    let name = core.timeline.open_captures().first().map_or("-", |lane| lane.store.name());
    let stem = std::path::Path::new(name).file_stem().and_then(|stem| stem.to_str());
    stem.filter(|stem| *stem != "-").unwrap_or("capture").to_owned()
}

/// Shows only events that match a filter.
pub(super) fn apply_filter(core: &mut UiState, text: &str) {
    let filter = if text.trim().is_empty() { Ok(None) } else { text.parse::<Filter>().map(Some) };
    match filter {
        Ok(filter) => {
            text.trim().clone_into(&mut core.filter);
            core.show_events(RowMatcher { filter, ..core.matcher.clone() });
        }
        Err(error) => core.show_refusal(&format!("{text}: {}", error.reason())),
    }
}

/// Sets a mark at the cursor, or goes to it.
pub(super) fn use_mark(core: &mut UiState, letter: char, is_new: bool) {
    if is_new {
        core.marks.insert(letter, core.cursor);
        core.show_message(&format!("mark {letter} set"));
    } else if let Some(spot) = core.marks.get(&letter).copied() {
        core.jump_to(JumpPlace::Event(spot));
    } else {
        core.show_refusal(&format!("mark {letter} is not set"));
    }
}

/// The typed position; None for an incomplete text.
fn parse_bound(core: &UiState, text: &str) -> Option<Result<RangeBound, String>> {
    // While local times are shown, a typed time of day is local.
    let local = (core.clock == TimeDisplay::Local).then(|| RangeBound::local_time(text)).flatten().map(Err);
    Some(match local.or_else(|| parse_place(text))? {
        Ok(step) => match core.cursor_time() {
            Some(time) => Ok(RangeBound::Moment(time.plus(step))),
            None => Err("this capture has no timestamps; enter a frame as #1234".to_owned()),
        },
        Err(bound) => Ok(bound),
    })
}

/// Target of the typed position, or the reason why there is none; None for an incomplete text.
pub(super) fn parse_target(core: &UiState, text: &str) -> Option<Result<JumpPlace, String>> {
    Some(parse_bound(core, text)?.and_then(|bound| core.position_inside(bound)))
}

/// Checks a text; the error has a byte offset and a message.
pub(super) fn check_text(asking: PromptPurpose, text: &str) -> Result<(), (usize, String)> {
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
                ExportRequest::all_suffixes().map(|(known, title)| format!(".{known} {title}")).collect();
            if ExportRequest::has_format(text.as_ref()) {
                Ok(())
            } else {
                Err((text.len(), known.join(", ")))
            }
        }
        PromptPurpose::Report => {
            let expected = ".html, .md".to_owned();
            if has_report_format(text.as_ref()) { Ok(()) } else { Err((text.len(), expected)) }
        }
        PromptPurpose::GoTo => {
            let expected = "expected 12.5 (seconds), #1234 (frame), -0.05 or +0.05 (relative), 22:13:25, or a date and time";
            parse_place(text).map(|_| ()).ok_or_else(|| (0, expected.to_owned()))
        }
    }
}

/// A relative step in ns, or an absolute place.
fn parse_place(text: &str) -> Option<Result<i64, RangeBound>> {
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
        RangeBound::Offset(offset) => Some(Ok(sign * offset / factor)),
        RangeBound::Frame(_) | RangeBound::Moment(_) | RangeBound::Clock(_) => None,
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn places_are_steps_from_here_or_on_their_own() {
        assert_eq!(parse_place("-0.05"), Some(Ok(-50_000_000)));
        assert_eq!(parse_place("+50ms"), Some(Ok(50_000_000)));
        assert_eq!(parse_place("-2s"), Some(Ok(-2_000_000_000)));
        assert_eq!(parse_place("12.5"), Some(Err(RangeBound::Offset(12_500_000_000))));
        assert_eq!(parse_place("#7"), Some(Err(RangeBound::Frame(7))));
        assert_eq!(parse_place("-#7"), None);
        assert!(matches!(parse_place("22:13:25.5"), Some(Err(RangeBound::Clock(_)))));
        assert_eq!(parse_place("later"), None);
    }
}
