//! Jumps to the next finding, story and error.

use cobscope_decoder::replay::EventPosition;
use cobscope_decoder::sink::escape;

use super::application::App;
use crate::action::Action;
use crate::panes::filtered_places;
use crate::state::JumpPlace;

impl App {
    /// Goes to the next or previous finding.
    pub(super) fn finding(&mut self, is_forward: bool) {
        let cursor = self.core.cursor.frame;
        let survey = self.core.timeline.survey();
        let is_next = |frame: u64| if is_forward { frame > cursor } else { frame < cursor };
        let inside = filtered_places(&self.core, &survey);
        let listed = inside.as_deref().unwrap_or(&survey.places);
        let ahead = || listed.iter().filter(|place| is_next(place.frame));
        let next = if is_forward { ahead().next() } else { ahead().next_back() }.copied();
        let is_between = |frame: u64| {
            let is_before =
                next.is_none_or(|next| if is_forward { frame < next.frame } else { frame > next.frame });
            is_next(frame) && is_before
        };
        // Without a filter nothing is between the cursor and the next place.
        let skipped = survey.places.iter().filter(|place| is_between(place.frame)).count();
        drop(survey);
        // Until the end only the first occurrence of a finding is known: a later one may be nearer, backwards.
        let is_known = is_forward || self.core.timeline.grows() || self.has_all_results();
        if let Some(place) = next.filter(|_| is_known) {
            self.core.go(JumpPlace::Frame(place.frame));
            let text = self.core.finding_text(place.id);
            self.core.notify(&format!("{}{text}", skipped_text(skipped)));
        } else {
            let action = if is_forward { Action::NextFinding } else { Action::PreviousFinding };
            self.nothing_further("finding", action, skipped);
        }
        self.refresh_panes();
    }

    /// Without a target in the results so far: waits for the remaining ones, or reports that none exists.
    fn nothing_further(&mut self, what: &str, action: Action, skipped: usize) {
        if self.has_all_results() {
            return self.core.refuse(&match skipped {
                0 => format!("no further {what} in this direction"),
                _ => format!("no further {what}; the filter hides {skipped} (c clears it)"),
            });
        }
        // A growing capture may never have another one; a jump much later would surprise.
        if self.core.timeline.grows() {
            return self.core.refuse(&format!("no further {what} so far"));
        }
        self.awaited_jump = Some(action);
        let is_back =
            matches!(action, Action::PreviousFinding | Action::PreviousError | Action::PreviousStory);
        let which = if is_back { "previous" } else { "next" };
        self.core.notify(&format!("goes to the {which} {what} when it is known; any key stops this"));
    }

    /// Whether the rules and the search for the shown events have reached the end.
    fn has_all_results(&self) -> bool {
        let is_searched = self.core.timeline.matches().is_none_or(|matches| matches.is_complete());
        is_searched && self.core.timeline.survey().is_complete
    }

    /// Tries a jump again that was requested before its target was known.
    pub(super) fn jump_if_known(&mut self) {
        if let Some(action) = self.awaited_jump.take() {
            self.act(action);
        }
    }

    /// Goes to the story that is `by` stories after the one at the cursor; without one at the cursor, to the first.
    pub(super) fn step_story(&mut self, by: isize) {
        let survey = self.core.timeline.survey();
        let Some(diagnosis) = &survey.diagnosis else {
            drop(survey);
            return self.nothing_further(
                "story",
                if by < 0 { Action::PreviousStory } else { Action::NextStory },
                0,
            );
        };
        let frames: Vec<u64> = diagnosis.stories.iter().map(|story| story.began.frames.last).collect();
        drop(survey);
        let at = frames.iter().position(|frame| *frame == self.core.cursor.frame);
        let next = match at {
            Some(at) => at.checked_add_signed(by),
            None => Some(0),
        };
        let count = frames.len();
        let Some((next, (frame, title))) = next.and_then(|next| Some((next, self.story(next)?))) else {
            return self.nothing_further(
                "story",
                if by < 0 { Action::PreviousStory } else { Action::NextStory },
                0,
            );
        };
        self.core.go(JumpPlace::Frame(frame));
        self.core.notify(&format!("story {} of {count}: {title}", next.saturating_add(1)));
        self.refresh_panes();
    }

    /// First frame and title of a story.
    pub(super) fn story(&self, index: usize) -> Option<(u64, String)> {
        let survey = self.core.timeline.survey();
        let story = survey.diagnosis.as_ref()?.stories.get(index)?;
        let frame = Some(story.began.frames.last).filter(|frame| *frame > 0)?;
        Some((frame, escape(&story.title).into_owned()))
    }

    /// Goes to the next or previous error.
    pub(super) fn error(&mut self, is_forward: bool) {
        let cursor = self.core.cursor;
        let matches = self.core.timeline.matches().filter(|_| self.core.matcher.filter.is_some());
        // Beyond the frames searched so far it is unknown what the filter hides.
        let known =
            matches.as_ref().filter(|matches| !matches.is_complete()).map(|matches| matches.scanned());
        let is_shown = |spot: &EventPosition| matches.as_ref().is_none_or(|matches| matches.has(*spot));
        let survey = self.core.timeline.survey();
        let at = survey.errors.partition_point(|spot| *spot <= cursor);
        let before = survey.errors.partition_point(|spot| *spot < cursor);
        let ahead: Box<dyn Iterator<Item = &EventPosition>> = if is_forward {
            Box::new(survey.errors.iter().skip(at))
        } else {
            Box::new(survey.errors.iter().take(before).rev())
        };
        let mut skipped = 0;
        let next = ahead.into_iter().find(|spot| {
            skipped += usize::from(!is_shown(spot));
            is_shown(spot)
        });
        let next = next.copied().filter(|spot| known.is_none_or(|frames| spot.frame <= frames));
        drop(survey);
        if let Some(spot) = next {
            self.core.go(JumpPlace::Event(spot));
            if skipped > 0 {
                self.core.notify(skipped_text(skipped).trim_end_matches("; "));
            }
        } else {
            let action = if is_forward { Action::NextError } else { Action::PreviousError };
            self.nothing_further("error", action, skipped);
        }
    }
}

/// Number of places outside the filter, before another text.
fn skipped_text(skipped: usize) -> String {
    if skipped == 0 { String::new() } else { format!("{skipped} outside the filter skipped; ") }
}
