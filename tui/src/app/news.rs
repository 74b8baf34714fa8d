//! Jumps to the next finding, story and error.

use cobscope_decoder::replay::EventPosition;
use cobscope_decoder::sink::escape;

use super::application::App;
use crate::panes::filtered_places;
use crate::state::JumpPlace;

impl App {
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
        let has_filtered = self.core.timeline.matches().is_none_or(|matches| matches.is_complete());
        let is_complete = survey.is_complete && has_filtered;
        drop(survey);
        match next {
            Some(place) => {
                self.core.go(JumpPlace::Frame(place.frame));
                let text = self.core.finding_text(place.id);
                self.core.notify(&format!("{}{text}", skipped_text(skipped)));
            }
            None if is_complete => self.core.refuse(&nothing_further("finding", skipped)),
            None => self.core.refuse("no further finding yet; rules and filter still run"),
        }
        self.refresh_panes();
    }

    /// Goes to the story that is `by` stories after the one at the cursor; without one at the cursor, to the first.
    pub(super) fn step_story(&mut self, by: isize) {
        let survey = self.core.timeline.survey();
        let Some(diagnosis) = &survey.diagnosis else {
            drop(survey);
            return self.core.refuse("no story yet; the rules still run");
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
            return self.core.refuse("no further story in this direction");
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

    pub(super) fn error(&mut self, is_forward: bool) {
        let cursor = self.core.cursor;
        let matches = self.core.timeline.matches().filter(|_| self.core.matcher.filter.is_some());
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
        let next = next.copied();
        drop(survey);
        match next {
            Some(spot) => {
                self.core.go(JumpPlace::Event(spot));
                if skipped > 0 {
                    self.core.notify(skipped_text(skipped).trim_end_matches("; "));
                }
            }
            None => self.core.refuse(&nothing_further("error", skipped)),
        }
    }
}

/// Number of places outside the filter, before another text.
fn skipped_text(skipped: usize) -> String {
    if skipped == 0 { String::new() } else { format!("{skipped} outside the filter skipped; ") }
}

fn nothing_further(what: &str, skipped: usize) -> String {
    match skipped {
        0 => format!("no further {what} in this direction"),
        _ => format!("no further {what}; the filter hides {skipped} (c clears it)"),
    }
}
