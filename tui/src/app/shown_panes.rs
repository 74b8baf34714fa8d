//! The panes on the screen: focus, layout, zoom, strip of time.

use ratatui::buffer::Buffer;
use ratatui::layout::Rect;

use super::history::{PaneShown, RowSelection};
use super::screen::{ScreenAreas, divide_screen};
use crate::action::Action;
use crate::panes::{Pane, PaneArrangement, PaneId, PaneLayout, Panes, PlacedPane};
use crate::state::UiState;
use crate::theme::{Glyph, TextRole, Theme};
use crate::widgets::draw;

/// The panes, their arrangement on the screen, and the one on which keys act.
pub(super) struct ShownPanes {
    all: Panes,
    /// The pane on which keys act.
    pub(super) focus: PaneId,
    /// Panes that are shown together.
    pub(super) arrangement: PaneArrangement,
    /// The strip of time is shown.
    pub(super) has_strip: bool,
    /// Area of the terminal.
    pub(super) area: Rect,
    /// Panes shown before, for `Back`.
    trail: Vec<PaneId>,
}

impl ShownPanes {
    /// The panes of a view that starts with `focus`.
    pub(super) fn new(focus: PaneId, arrangement: PaneArrangement, has_strip: bool) -> Self {
        let area = Rect::new(0, 0, 80, 24);
        Self { all: Panes::default(), focus, arrangement, has_strip, area, trail: Vec::new() }
    }

    /// The pane on which keys act.
    pub(super) fn focused_pane(&self) -> Option<&dyn Pane> {
        self.all.get(self.focus)
    }

    /// The pane on which keys act, to change its view state.
    pub(super) fn focused_pane_mut(&mut self) -> Option<&mut Box<dyn Pane>> {
        self.all.get_mut(self.focus)
    }

    /// All panes, to change their view state.
    pub(super) fn all_mut(&mut self) -> impl Iterator<Item = &mut Box<dyn Pane>> {
        self.all.all_mut()
    }

    /// Areas of the screen.
    pub(super) fn screen_areas(&self) -> ScreenAreas {
        divide_screen(self.area, self.has_strip)
    }

    /// Cells of the shown panes.
    pub(super) fn shown_cells(&self, body: Rect) -> Vec<PlacedPane> {
        self.arrangement.placed_panes(self.focus, self.area, body)
    }

    /// Updates the size of the focused pane.
    pub(super) fn update_size(&self, core: &mut UiState) {
        let body = self.screen_areas().body;
        let cells = self.shown_cells(body);
        let area = cells.iter().find(|cell| cell.pane == self.focus).map_or(body, |cell| cell.area);
        (core.height, core.width) = (area.height, area.width);
    }

    /// Takes the present state into all panes.
    pub(super) fn refresh_panes(&mut self, core: &UiState) {
        for pane in self.all.all_mut() {
            pane.refresh_state(core);
        }
    }

    /// Shows a pane; the previous one is remembered for `Back`.
    pub(super) fn show_pane(&mut self, pane: PaneId, core: &mut UiState) {
        if pane != self.focus {
            self.trail.retain(|other| *other != pane);
            self.trail.push(self.focus);
            self.focus_pane(pane, core);
            self.refresh_panes(core);
        }
    }

    /// Shows the pane before this one, if there was one.
    pub(super) fn show_previous(&mut self, core: &mut UiState) {
        if let Some(pane) = self.trail.pop() {
            self.focus_pane(pane, core);
        }
    }

    /// Keys act on this pane from now on.
    fn focus_pane(&mut self, pane: PaneId, core: &mut UiState) {
        let body = self.screen_areas().body;
        self.arrangement.focus_pane(pane, self.area, body);
        self.focus = pane;
        self.update_size(core);
    }

    /// The next of the panes that are shown together; of all panes if only one is shown.
    pub(super) fn next_pane(&mut self, is_forward: bool, core: &mut UiState) {
        let cells = self.shown_cells(self.screen_areas().body);
        let panes: Vec<PaneId> = match cells.len() {
            0 | 1 => PaneId::ALL.to_vec(),
            _ => cells.iter().map(|cell| cell.pane).collect(),
        };
        let at = panes.iter().position(|pane| *pane == self.focus).unwrap_or(0);
        let by = if is_forward { 1 } else { panes.len().saturating_sub(1) };
        if let Some(pane) = panes.get((at + by) % panes.len().max(1)) {
            self.show_pane(*pane, core);
        }
    }

    pub(super) fn next_layout(&mut self, core: &mut UiState) {
        let layout = self.arrangement.next(self.area);
        self.update_size(core);
        let count = self.shown_cells(self.screen_areas().body).len();
        let is_small = count < 2 && layout != PaneLayout::One;
        let small = if is_small { ": this terminal has room for one pane" } else { "" };
        core.show_message(&format!("layout {}{small}", layout.name()));
        core.refresh_window();
    }

    pub(super) fn toggle_zoom(&mut self, core: &mut UiState) {
        if !self.arrangement.is_zoomed && self.shown_cells(self.screen_areas().body).len() < 2 {
            return core.show_refusal("only one pane is shown; | chooses a layout with several");
        }
        self.arrangement.is_zoomed = !self.arrangement.is_zoomed;
        self.update_size(core);
    }

    pub(super) fn move_split(&mut self, is_right: bool, core: &mut UiState) {
        let cells = self.shown_cells(self.screen_areas().body);
        if cells.iter().all(|cell| cell.area.x == 0) {
            return core.show_refusal("the panes are not in two columns; | chooses another layout");
        }
        self.arrangement.move_split(is_right);
        self.update_size(core);
    }

    pub(super) fn toggle_strip(&mut self, core: &mut UiState) {
        self.has_strip = !self.has_strip;
        self.update_size(core);
    }

    /// Passes the search text to the focused pane; `false` if it has no search of its own.
    pub(super) fn search_text(&mut self, text: &str, core: &UiState) -> bool {
        self.focused_pane_mut().is_some_and(|pane| pane.search_text(text, core))
    }

    /// Titles of all columns of the focused pane.
    pub(super) fn column_titles(&self) -> Vec<String> {
        let heads = self.focused_pane().map_or_else(Vec::new, Pane::table_heads);
        heads.into_iter().map(|head| head.title.into_owned()).filter(|title| !title.is_empty()).collect()
    }

    /// Titles of the panes that perform an action.
    pub(super) fn performing_titles(&self, action: Action) -> Vec<&'static str> {
        let performs =
            |id: &&PaneId| self.all.get(**id).is_some_and(|pane| pane.performed_actions().contains(&action));
        PaneId::ALL.iter().filter(performs).map(|id| id.title()).collect()
    }

    /// The present filters, searches and sort orders.
    pub(super) fn row_selection(&self, core: &UiState) -> RowSelection {
        let pane = |id: &PaneId| {
            let pane = self.all.get(*id)?;
            Some(PaneShown {
                pane: *id,
                sorting: pane.table_sorting(),
                sought: pane.sought_text().unwrap_or_default().to_owned(),
            })
        };
        RowSelection {
            filter: core.filter.clone(),
            only_news: core.matcher.only_news,
            sought: core.sought.as_ref().map(|sought| sought.text.clone()),
            panes: PaneId::ALL.iter().filter_map(pane).collect(),
            columns: core.columns.clone(),
        }
    }

    /// Restores sort order and search of the panes.
    pub(super) fn restore_panes(&mut self, shown: Vec<PaneShown>, core: &UiState) {
        for PaneShown { pane, sorting, sought } in shown {
            let Some(pane) = self.all.get_mut(pane) else { continue };
            pane.set_sorting(sorting);
            if pane.sought_text().is_some_and(|present| present != sought) {
                pane.search_text(&sought, core);
            }
        }
    }

    /// Draws the panes of the layout with their titles.
    pub(super) fn draw_panes(&self, core: &mut UiState, body: Rect, buf: &mut Buffer) {
        let theme = core.theme;
        for cell in self.shown_cells(body) {
            let is_focused = cell.pane == self.focus;
            core.theme = theme.with_focus(is_focused);
            if !cell.title.is_empty() {
                draw_title(&cell, is_focused, &theme, buf);
            }
            if let Some(beside) = cell.area.x.checked_sub(1).filter(|x| *x >= body.x) {
                for y in cell.title.top()..cell.area.bottom() {
                    let line = theme.glyph(Glyph::Vertical);
                    draw::put_text(buf, beside, y, 1, line, theme.role_style(TextRole::Border));
                }
            }
            if let Some(pane) = self.all.get(cell.pane) {
                pane.render_pane(core, cell.area, buf);
            }
        }
        core.theme = theme;
    }
}

fn draw_title(cell: &PlacedPane, is_focused: bool, theme: &Theme, buf: &mut Buffer) {
    let Rect { x, y, width, .. } = cell.title;
    let (border, role) = if is_focused {
        (TextRole::BorderActive, TextRole::Selected)
    } else {
        (TextRole::Border, TextRole::Title)
    };
    let line = theme.glyph(Glyph::Horizontal).repeat(usize::from(width));
    draw::put_text(buf, x, y, width, &line, theme.role_style(border));
    let title = format!(" {} {} ", cell.pane as usize, cell.pane.title());
    draw::put_text(buf, x + 1, y, width, &title, theme.role_style(role));
}
