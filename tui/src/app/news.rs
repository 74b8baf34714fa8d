//! To the next finding, the next error.

use super::application::App;
use crate::state::Place;

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
                self.core.go(Place::Frame(place.frame));
                let text = self.core.finding_text(place.id);
                self.core.say(&text);
            }
            None if is_complete => self.core.refuse("no further finding that way"),
            None => self.core.refuse("no further finding so far; the capture is still being judged"),
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
            Some(spot) => self.core.go(Place::Spot(spot)),
            None => self.core.refuse("no further error that way"),
        }
    }
}
