//! The interface of a pane.

use ratatui::buffer::Buffer;
use ratatui::layout::Rect;

use super::effect::PaneRequest;
use super::legend::PaneLegend;
use crate::action::Action;
use crate::state::{NodeKey, UiState};
use crate::widgets::table::TableColumn;

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
    fn render_pane(&self, core: &UiState, area: Rect, buf: &mut Buffer);

    /// Handles an action of the user; returns the requests that follow from it.
    fn on_action(&mut self, action: Action, core: &UiState) -> Vec<PaneRequest>;

    /// Handles a mouse press at a position of `area`, which is the area passed to [`Pane::render_pane`]. A second
    /// press at the same position is followed by [`Action::Open`].
    fn on_click(&mut self, x: u16, y: u16, area: Rect, core: &UiState) -> Vec<PaneRequest>;

    /// Updates the selection after the cursor moved or more data was read.
    fn refresh_state(&mut self, _core: &UiState) {}

    /// Receives the request of another pane or of the application.
    fn on_request(&mut self, _effect: &PaneRequest, _core: &UiState) {}

    /// Searches in the pane while the text is typed; `false` if the pane has no search of its own.
    fn search_text(&mut self, _text: &str, _core: &UiState) -> bool {
        false
    }

    /// Text of its own search.
    fn sought_text(&self) -> Option<&str> {
        None
    }

    /// Sort order of its table.
    fn table_sorting(&self) -> Sorting {
        None
    }

    /// Sorts its table.
    fn set_sorting(&mut self, _sorting: Sorting) {}

    /// Meaning of its columns, marks and colours.
    fn pane_legend(&self) -> &'static PaneLegend;

    /// All columns of its table; empty without a table.
    fn table_heads(&self) -> Vec<TableColumn> {
        Vec::new()
    }

    /// Those of [`OPTIONAL`] that the pane performs.
    fn performed_actions(&self) -> &'static [Action] {
        &[]
    }

    /// Actions shown in the key bar.
    fn key_bar_actions(&self) -> &'static [Action];

    /// The filter for the value of the selected cell.
    fn filter_of_cell(&self, _core: &UiState) -> Option<String> {
        None
    }

    /// The node of the selected row.
    fn selected_node(&self, _core: &UiState) -> Option<NodeKey> {
        None
    }

    /// Id of the finding of the selected row, or of the first finding of its story.
    fn selected_finding(&self, _core: &UiState) -> Option<u64> {
        None
    }

    /// The selected line as text.
    fn selected_line(&self, core: &UiState) -> Option<String>;
}
