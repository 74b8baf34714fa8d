//! Jumps to the next finding and the next error.

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
