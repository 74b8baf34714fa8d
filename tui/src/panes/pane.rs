//! The interface of a pane.

use ratatui::buffer::Buffer;
use ratatui::layout::Rect;

use super::effect::Effect;
use super::legend::Legend;
use crate::action::Action;
use crate::state::{Core, NodeKey};
use crate::widgets::table::Column;

/// Column of a sort order, and whether it is descending; None for the order of the pane.
pub type Sorting = Option<(usize, bool)>;

/// Actions that only some panes perform.
pub const OPTIONAL: [Action; 9] = [
    Action::Left,
    Action::Right,
    Action::Toggle,
    Action::Sort,
    Action::Highlight,
    Action::Plot,
    Action::ZoomIn,
    Action::ZoomOut,
    Action::SetCursor,
];

/// A view of the captures with its own selection.
pub trait Pane {
    /// Draws the pane into `area`.
    fn render(&self, core: &Core, area: Rect, buf: &mut Buffer);

    /// Handles an action of the user; returns the requests that follow from it.
    fn act(&mut self, action: Action, core: &Core) -> Vec<Effect>;

    /// Handles a mouse press at a position of `area`, which is the area passed to [`Pane::render`]. A second
    /// press at the same position is followed by [`Action::Open`].
    fn click(&mut self, x: u16, y: u16, area: Rect, core: &Core) -> Vec<Effect>;

    /// Updates the selection after the cursor moved or more data was read.
    fn refresh(&mut self, _core: &Core) {}

    /// Receives the request of another pane or of the application.
    fn offer(&mut self, _effect: &Effect, _core: &Core) {}

    /// Searches in the pane while the text is typed; `false` if the pane has no search of its own.
    fn search(&mut self, _text: &str, _core: &Core) -> bool {
        false
    }

    /// Text of its own search.
    fn sought(&self) -> Option<&str> {
        None
    }

    /// Sort order of its table.
    fn sorting(&self) -> Sorting {
        None
    }

    /// Sorts its table.
    fn set_sorting(&mut self, _sorting: Sorting) {}

    /// Meaning of its columns, marks and colours.
    fn legend(&self) -> &'static Legend;

    /// All columns of its table; empty without a table.
    fn heads(&self) -> Vec<Column> {
        Vec::new()
    }

    /// Those of [`OPTIONAL`] that the pane performs.
    fn performs(&self) -> &'static [Action] {
        &[]
    }

    /// Actions shown in the key bar.
    fn actions(&self) -> &'static [Action];

    /// The filter for the value of the selected cell.
    fn filter_of_cell(&self, _core: &Core) -> Option<String> {
        None
    }

    /// The node of the selected row.
    fn node(&self, _core: &Core) -> Option<NodeKey> {
        None
    }

    /// Id of the finding of the selected row, or of the first finding of its story.
    fn finding(&self, _core: &Core) -> Option<u64> {
        None
    }

    /// The selected line as text.
    fn line(&self, core: &Core) -> Option<String>;
}
