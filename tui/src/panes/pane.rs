//! The interface of a pane.

use ratatui::buffer::Buffer;
use ratatui::layout::Rect;

use super::effect::Effect;
use crate::action::Action;
use crate::state::Core;

/// One view of the captures.
pub trait Pane {
    /// Draws it.
    fn render(&self, core: &Core, area: Rect, buf: &mut Buffer);

    /// Does what the user wants in it.
    fn act(&mut self, action: Action, core: &Core) -> Vec<Effect>;

    /// The mouse was pressed at a place of `area`, which is what [`Pane::render`] was given; twice in a row
    /// means [`Action::Open`] too.
    fn click(&mut self, x: u16, y: u16, area: Rect, core: &Core) -> Vec<Effect>;

    /// The cursor moved, or more is known: time to look after selections.
    fn refresh(&mut self, _core: &Core) {}

    /// Something another pane, or the application, offers to all.
    fn offer(&mut self, _effect: &Effect, _core: &Core) {}

    /// Takes what is typed behind `/`, with each letter; `false`: it is for the events.
    fn search(&mut self, _text: &str, _core: &Core) -> bool {
        false
    }

    /// What of it can be done with keys, for the line at the bottom.
    fn actions(&self) -> &'static [Action];

    /// The filter that shows only what has the value of the selected cell.
    fn filter_of_cell(&self, _core: &Core) -> Option<String> {
        None
    }

    /// The selected line as text.
    fn line(&self, core: &Core) -> Option<String>;
}
