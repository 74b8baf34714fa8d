//! Jumps to the next finding, story and error.

use cobscope_decoder::sink::escape;

use super::application::App;
use crate::state::JumpPlace;

impl App {
    pub(super) fn finding(&mut self, is_forward: bool) {
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
                self.core.go(JumpPlace::Frame(place.frame));
                let text = self.core.finding_text(place.id);
                self.core.notify(&text);
            }
            None if is_complete => self.core.refuse("no further finding in this direction"),
            None => self.core.refuse("no further finding yet; the rules still run"),
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
            Some(spot) => self.core.go(JumpPlace::Event(spot)),
            None => self.core.refuse("no further error in this direction"),
        }
    }
}
