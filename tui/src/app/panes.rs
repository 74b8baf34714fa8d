//! The panes on the screen: focus, layout, zoom, strip of time, and the remembered choice of them.

use ratatui::layout::Rect;

use super::application::{App, InputMode};
use super::preferences::Preferences;
use super::view::{self, ScreenAreas};
use crate::panes::{PaneArrangement, PaneId, PaneLayout, PlacedPane, SPLIT};

impl App {
    /// Areas of the screen.
    pub(super) fn screen_areas(&self) -> ScreenAreas {
        view::divide_screen(self.area, self.has_strip)
    }

    /// Cells of the shown panes.
    pub(super) fn shown_cells(&self, body: Rect) -> Vec<PlacedPane> {
        self.arrangement.placed_panes(self.pane, self.area, body)
    }

    /// Whether keys act on the panes.
    pub(super) fn is_in_panes(&self) -> bool {
        matches!(self.mode, InputMode::Panes)
    }

    /// Updates the size of the focused pane.
    pub(super) fn update_size(&mut self) {
        let body = self.screen_areas().body;
        let cells = self.shown_cells(body);
        let area = cells.iter().find(|cell| cell.pane == self.pane).map_or(body, |cell| cell.area);
        (self.core.height, self.core.width) = (area.height, area.width);
    }

    /// Shows a pane; the previous one is remembered for `Back`.
    pub(super) fn show_pane(&mut self, pane: PaneId) {
        if pane != self.pane {
            self.trail.retain(|other| *other != pane);
            self.trail.push(self.pane);
            self.focus_pane(pane);
            self.refresh_panes();
        }
    }

    /// Keys act on this pane from now on.
    pub(super) fn focus_pane(&mut self, pane: PaneId) {
        let body = self.screen_areas().body;
        self.arrangement.focus_pane(pane, self.area, body);
        self.pane = pane;
        self.update_size();
    }

    /// The next of the panes that are shown together; of all panes if only one is shown.
    pub(super) fn next_pane(&mut self, is_forward: bool) {
        let cells = self.shown_cells(self.screen_areas().body);
        let panes: Vec<PaneId> = match cells.len() {
            0 | 1 => PaneId::ALL.to_vec(),
            _ => cells.iter().map(|cell| cell.pane).collect(),
        };
        let at = panes.iter().position(|pane| *pane == self.pane).unwrap_or(0);
        let by = if is_forward { 1 } else { panes.len().saturating_sub(1) };
        if let Some(pane) = panes.get((at + by) % panes.len().max(1)) {
            self.show_pane(*pane);
        }
    }

    pub(super) fn next_layout(&mut self) {
        let layout = self.arrangement.next(self.area);
        self.update_size();
        let count = self.shown_cells(self.screen_areas().body).len();
        let is_small = count < 2 && layout != PaneLayout::One;
        let small = if is_small { ": this terminal has room for one pane" } else { "" };
        self.core.show_message(&format!("layout {}{small}", layout.name()));
        self.core.refresh_window();
    }

    pub(super) fn toggle_zoom(&mut self) {
        if !self.arrangement.is_zoomed && self.shown_cells(self.screen_areas().body).len() < 2 {
            return self.core.show_refusal("only one pane is shown; | chooses a layout with several");
        }
        self.arrangement.is_zoomed = !self.arrangement.is_zoomed;
        self.update_size();
    }

    pub(super) fn move_split(&mut self, is_right: bool) {
        let cells = self.shown_cells(self.screen_areas().body);
        if cells.iter().all(|cell| cell.area.x == 0) {
            return self.core.show_refusal("the panes are not in two columns; | chooses another layout");
        }
        self.arrangement.move_split(is_right);
        self.update_size();
    }

    pub(super) fn toggle_strip(&mut self) {
        self.has_strip = !self.has_strip;
        self.update_size();
    }

    /// Layout, strip and colours as they are now; None if the user discarded the remembered view and changed
    /// nothing since.
    pub fn changed_preferences(&self) -> Option<Preferences> {
        let split = self.arrangement.split_share();
        let now = Preferences {
            layout: self.arrangement.chosen,
            split: Some(split).filter(|split| *split != SPLIT || self.defaults.split.is_some()),
            has_strip: self.has_strip,
            palette: self.core.theme.palette(),
            columns: self.core.columns.clone(),
        };
        if self.is_forgotten && now == self.defaults { None } else { Some(now) }
    }

    /// Whether the user discarded the remembered view.
    pub fn is_forgotten(&self) -> bool {
        self.is_forgotten
    }

    /// Discards the remembered view.
    pub(super) fn forget_view(&mut self) {
        self.is_forgotten = true;
        self.arrangement = PaneArrangement::new(self.defaults.layout, self.defaults.split);
        self.has_strip = self.defaults.has_strip;
        self.core.columns = self.defaults.columns.clone();
        self.core.theme = self.core.theme.with_colours(self.defaults.palette, self.core.theme.depth());
        self.update_size();
        self.core.show_message("the remembered layout, split, strip, columns and colours are discarded");
    }
}
