//! Jumps to the next finding, story and error.

use cobscope_decoder::replay::EventPosition;
use cobscope_decoder::sink::escape;

use super::application::App;
use crate::action::Action;
use crate::panes::filtered_places;
use crate::state::JumpPlace;

impl App {
    /// Goes to the next or previous finding.
    pub(super) fn goto_finding(&mut self, is_forward: bool) {
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
        let is_known = is_forward || self.core.timeline.may_grow() || self.has_all_results();
        if let Some(place) = next.filter(|_| is_known) {
            self.core.jump_to(JumpPlace::Frame(place.frame));
            let text = self.core.finding_text(place.id);
            self.core.show_message(&format!("{}{text}", skipped_text(skipped)));
        } else {
            let action = if is_forward { Action::NextFinding } else { Action::PreviousFinding };
            self.nothing_further("finding", action, skipped);
        }
        self.refresh_panes();
    }

    /// Without a target in the results so far: waits for the remaining ones, or reports that none exists.
    fn nothing_further(&mut self, what: &str, action: Action, skipped: usize) {
        if self.has_all_results() {
            return self.core.show_refusal(&match skipped {
                0 => format!("no further {what} in this direction"),
                _ => format!("no further {what}; the filter hides {skipped} (c clears it)"),
            });
        }
        // A growing capture may never have another one; a jump much later would surprise.
        if self.core.timeline.may_grow() {
            return self.core.show_refusal(&format!("no further {what} so far"));
        }
        self.awaited_jump = Some(action);
        let is_back =
            matches!(action, Action::PreviousFinding | Action::PreviousError | Action::PreviousStory);
        let which = if is_back { "previous" } else { "next" };
        self.core.show_message(&format!("goes to the {which} {what} when it is known; any key stops this"));
    }

    /// Whether the rules and the search for the shown events have reached the end.
    fn has_all_results(&self) -> bool {
        let is_searched = self.core.timeline.search_matches().is_none_or(|matches| matches.is_complete());
        is_searched && self.core.timeline.survey().is_complete
    }

    /// Tries a jump again that was requested before its target was known.
    pub(super) fn jump_if_known(&mut self) {
        if let Some(action) = self.awaited_jump.take() {
            self.perform_action(action);
        }
    }

    /// Goes to the story after or before the one at the cursor; without one at the cursor, to the first.
    pub(super) fn step_story(&mut self, is_forward: bool) {
        let survey = self.core.timeline.survey();
        let stories = survey.diagnosis.iter().flat_map(|diagnosis| &diagnosis.stories);
        let frames: Vec<u64> = stories.map(|story| story.began.frames.last).collect();
        drop(survey);
        let Some(next) = next_story(&frames, self.core.cursor.frame, self.last_story, is_forward) else {
            let action = if is_forward { Action::NextStory } else { Action::PreviousStory };
            return self.nothing_further("story", action, 0);
        };
        let Some((frame, title)) = self.story_target(next) else { return };
        self.last_story = Some(next);
        self.core.jump_to(JumpPlace::Frame(frame));
        self.core.show_message(&format!("story {} of {}: {title}", next.saturating_add(1), frames.len()));
        self.refresh_panes();
    }

    /// First frame and title of a story.
    pub(super) fn story_target(&self, index: usize) -> Option<(u64, String)> {
        let survey = self.core.timeline.survey();
        let story = survey.diagnosis.as_ref()?.stories.get(index)?;
        let frame = Some(story.began.frames.last).filter(|frame| *frame > 0)?;
        Some((frame, escape(&story.title).into_owned()))
    }

    /// Goes to the next or previous error.
    pub(super) fn goto_error(&mut self, is_forward: bool) {
        let cursor = self.core.cursor;
        let matches = self.core.timeline.search_matches().filter(|_| self.core.matcher.filter.is_some());
        // Beyond the frames searched so far it is unknown what the filter hides.
        let known =
            matches.as_ref().filter(|matches| !matches.is_complete()).map(|matches| matches.scanned_frames());
        let is_shown = |spot: &EventPosition| matches.as_ref().is_none_or(|matches| matches.has_match(*spot));
        let survey = self.core.timeline.survey();
        let at = survey.overview.errors.partition_point(|spot| *spot <= cursor);
        let before = survey.overview.errors.partition_point(|spot| *spot < cursor);
        let ahead: Box<dyn Iterator<Item = &EventPosition>> = if is_forward {
            Box::new(survey.overview.errors.iter().skip(at))
        } else {
            Box::new(survey.overview.errors.iter().take(before).rev())
        };
        let mut skipped = 0;
        let next = ahead.into_iter().find(|spot| {
            skipped += usize::from(!is_shown(spot));
            is_shown(spot)
        });
        let next = next.copied().filter(|spot| known.is_none_or(|frames| spot.frame <= frames));
        drop(survey);
        if let Some(spot) = next {
            self.core.jump_to(JumpPlace::Event(spot));
            if skipped > 0 {
                self.core.show_message(skipped_text(skipped).trim_end_matches("; "));
            }
        } else {
            let action = if is_forward { Action::NextError } else { Action::PreviousError };
            self.nothing_further("error", action, skipped);
        }
    }
}

/// Index of the story after or before the one at the cursor; without one at the cursor, of the first. Stories
/// without a frame, 0, have no place to go to. `last` is the story of the last jump: several stories can have
/// the same frame.
fn next_story(frames: &[u64], cursor: u64, last: Option<usize>, is_forward: bool) -> Option<usize> {
    let has_place = |at: &usize| frames.get(*at).is_some_and(|frame| *frame > 0);
    let is_here = |at: &usize| frames.get(*at) == Some(&cursor);
    let here = last.filter(is_here).or_else(|| (0..frames.len()).find(is_here));
    match here {
        None => (0..frames.len()).find(has_place),
        Some(at) if is_forward => (at.saturating_add(1)..frames.len()).find(has_place),
        Some(at) => (0..at).rev().find(has_place),
    }
}

/// Number of places outside the filter, before another text.
fn skipped_text(skipped: usize) -> String {
    if skipped == 0 { String::new() } else { format!("{skipped} outside the filter skipped; ") }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Story 1 in frame 30, stories 2 and 4 in frame 12, story 3 without a frame.
    #[test]
    fn stories_of_one_frame_are_visited_one_after_the_other() {
        let frames = [30, 12, 0, 12];
        let visit = |is_forward: bool| {
            let (mut cursor, mut last, mut visited) = (1, None, Vec::new());
            while let Some(next) = next_story(&frames, cursor, last, is_forward) {
                (cursor, last) = (frames[next], Some(next));
                visited.push(next);
            }
            visited
        };
        assert_eq!(visit(true), [0, 1, 3]);
        // From outside all stories also the previous one is the first.
        assert_eq!(visit(false), [0]);
        assert_eq!(next_story(&frames, 12, Some(3), false), Some(1));
        assert_eq!(next_story(&frames, 12, Some(1), false), Some(0));
        // The cursor was moved to the frame by other means.
        assert_eq!(next_story(&frames, 12, Some(0), true), Some(3));
        assert_eq!(next_story(&[0], 12, None, true), None);
    }
}
