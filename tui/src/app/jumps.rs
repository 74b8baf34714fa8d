//! Jumps to the next finding, story and error.

use cobscope_decoder::replay::EventPosition;
use cobscope_decoder::sink::escape;

use crate::action::Action;
use crate::panes::filtered_places;
use crate::state::{JumpPlace, UiState};

/// Jumps between the results of the survey.
#[derive(Debug, Default)]
pub(super) struct ResultJumps {
    /// The survey has reported its end.
    pub(super) is_surveyed: bool,
    /// The view opens at the first story: no position was requested and no key pressed.
    pub(super) opens_at_story: bool,
    /// Index of the story of the last jump; several stories can have the same frame.
    pub(super) last_story: Option<usize>,
    /// A jump whose target was not known when it was requested.
    pub(super) awaited: Option<Action>,
}

impl ResultJumps {
    /// Goes to the next or previous finding.
    pub(super) fn goto_finding(&mut self, core: &mut UiState, is_forward: bool) {
        let cursor = core.cursor.frame;
        let survey = core.timeline.survey();
        let is_next = |frame: u64| if is_forward { frame > cursor } else { frame < cursor };
        let inside = filtered_places(core, &survey);
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
        let is_known = is_forward || core.timeline.may_grow() || has_all_results(core);
        if let Some(place) = next.filter(|_| is_known) {
            core.jump_to(JumpPlace::Frame(place.frame));
            let text = core.finding_text(place.id);
            core.show_message(&format!("{}{text}", skipped_text(skipped)));
        } else {
            let action = if is_forward { Action::NextFinding } else { Action::PreviousFinding };
            self.nothing_further(core, "finding", action, skipped);
        }
    }

    /// Without a target in the results so far: waits for the remaining ones, or reports that none exists.
    fn nothing_further(&mut self, core: &mut UiState, what: &str, action: Action, skipped: usize) {
        if has_all_results(core) {
            return core.show_refusal(&match skipped {
                0 => format!("no further {what} in this direction"),
                _ => format!("no further {what}; the filter hides {skipped} (c clears it)"),
            });
        }
        // A growing capture may never have another one; a jump much later would surprise.
        if core.timeline.may_grow() {
            return core.show_refusal(&format!("no further {what} so far"));
        }
        self.awaited = Some(action);
        let is_back =
            matches!(action, Action::PreviousFinding | Action::PreviousError | Action::PreviousStory);
        let which = if is_back { "previous" } else { "next" };
        core.show_message(&format!("goes to the {which} {what} when it is known; any key stops this"));
    }

    /// Goes to the story after or before the one at the cursor; without one at the cursor, to the first.
    pub(super) fn step_story(&mut self, core: &mut UiState, is_forward: bool) {
        let survey = core.timeline.survey();
        let stories = survey.diagnosis.iter().flat_map(|diagnosis| &diagnosis.stories);
        let frames: Vec<u64> = stories.map(|story| story.began.frames.last).collect();
        drop(survey);
        let Some(next) = next_story(&frames, core.cursor.frame, self.last_story, is_forward) else {
            let action = if is_forward { Action::NextStory } else { Action::PreviousStory };
            return self.nothing_further(core, "story", action, 0);
        };
        let Some((frame, title)) = story_target(core, next) else { return };
        self.last_story = Some(next);
        core.jump_to(JumpPlace::Frame(frame));
        core.show_message(&format!("story {} of {}: {title}", next.saturating_add(1), frames.len()));
    }

    /// Goes to the next or previous error.
    pub(super) fn goto_error(&mut self, core: &mut UiState, is_forward: bool) {
        let cursor = core.cursor;
        let matches = core.timeline.search_matches().filter(|_| core.matcher.filter.is_some());
        // Beyond the frames searched so far it is unknown what the filter hides.
        let known =
            matches.as_ref().filter(|matches| !matches.is_complete()).map(|matches| matches.scanned_frames());
        let is_shown = |spot: &EventPosition| matches.as_ref().is_none_or(|matches| matches.has_match(*spot));
        let survey = core.timeline.survey();
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
            core.jump_to(JumpPlace::Event(spot));
            if skipped > 0 {
                core.show_message(skipped_text(skipped).trim_end_matches("; "));
            }
        } else {
            let action = if is_forward { Action::NextError } else { Action::PreviousError };
            self.nothing_further(core, "error", action, skipped);
        }
    }
}

/// Whether the rules and the search for the shown events have reached the end.
fn has_all_results(core: &UiState) -> bool {
    let is_searched = core.timeline.search_matches().is_none_or(|matches| matches.is_complete());
    is_searched && core.timeline.survey().is_complete
}

/// First frame and title of a story.
pub(super) fn story_target(core: &UiState, index: usize) -> Option<(u64, String)> {
    let survey = core.timeline.survey();
    let story = survey.diagnosis.as_ref()?.stories.get(index)?;
    let frame = Some(story.began.frames.last).filter(|frame| *frame > 0)?;
    Some((frame, escape(&story.title).into_owned()))
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
