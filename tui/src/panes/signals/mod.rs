//! Signals: a list of all signals, and a plot of the chosen ones over time.
//!
//! ```text
//!   Node  From   Signal            Value │ 0.000 to 0.306 s, whole capture
//! ✓ 2/02  TPDO1  Actual pressure   124.9 │ bar         A
//!   2/02  TPDO1  Swivel angle     49.4 % │ 150┤     ⡏⠉⠉⠉⠉⡇
//!   2/02  RPDO1  Control byte        00h │    │⣀⣀⣀⣀⣀⠇ ┆  ⠧⠤⠤⠤
//!                                        │    └┬──────┬──────
//!                                        │             A 0.140 s  min  max
//!                                        │ ⠤⠤ Actual…      157.4   …
//! ```
//!
//! In a narrow pane the list is above the plot. The cursor is cursor A of the plot.

mod drawn;
mod list;
mod marks;
mod offered;
mod view;

use cobscope_decoder::frame::Timestamp;
use ratatui::buffer::Buffer;
use ratatui::layout::{Position, Rect};
use ratatui::text::Line;

use self::list::SignalList;
pub use self::offered::plot_requests;
use self::view::PlotView;
use super::legend::{self, PaneLegend};
use super::{Pane, PaneRequest};
use crate::action::Action;
use crate::state::{JumpPlace, UiState};
use crate::theme::{Glyph, TextRole};
use crate::timeline::{MOST_SIGNALS, SignalKey};
use crate::widgets::draw;
use crate::widgets::plot::TimePlot;
use crate::widgets::table::{TableColumn, TableWidget};

/// Width from which the list is next to the plot.
const WIDE: u16 = 100;

/// Height below which a pane of at least this width has the plot next to the list.
const LOW: u16 = 16;
const LOW_WIDTH: u16 = 70;

/// Minimum width of the list next to the plot; in wide panes it takes a third.
const LIST_WIDTH: u16 = 46;

/// Height of the list above the plot, with its heads.
const LIST_HEIGHT: u16 = 6;

/// Width of the plot legend without the names.
const OF_LEGEND: u16 = 52;

struct PlottedKey {
    key: SignalKey,
    /// Number of its highlight colour, fixed while it is plotted.
    look: u8,
}

/// Cursor B.
struct SecondCursor {
    time: i64,
    /// Values at cursor B of the signals plotted when it was set.
    values: Vec<(SignalKey, Option<f64>)>,
}

/// The list of signals and the plot.
#[derive(Default)]
pub struct SignalsPane {
    list: SignalList,
    picked: Vec<PlottedKey>,
    view: PlotView,
    second: Option<SecondCursor>,
    /// The plot takes the whole pane.
    is_large: bool,
    /// The last action was a click on the list.
    is_list_clicked: bool,
    /// Number of signals refused because the plot was full.
    refused: usize,
}

/// Screen areas of this pane.
struct SignalAreas {
    list: Rect,
    title: Rect,
    plot: Rect,
}

impl SignalsPane {
    fn pane_areas(&self, area: Rect) -> SignalAreas {
        let (list, right) = if self.picked.is_empty() {
            let hint = u16::from(area.height > 2);
            let list = Rect { height: area.height - hint, ..area };
            (list, Rect { y: list.bottom(), height: hint, ..area })
        } else if self.is_large {
            (Rect { width: 0, height: 0, ..area }, area)
        } else if area.width >= WIDE || (area.height < LOW && area.width >= LOW_WIDTH) {
            let width = if area.width < WIDE { area.width * 2 / 5 } else { LIST_WIDTH.max(area.width / 3) };
            (Rect { width, ..area }, Rect { x: area.x + width + 1, width: area.width - width - 1, ..area })
        } else {
            let height = LIST_HEIGHT.min(area.height / 3);
            let list = Rect { height, ..area };
            (list, Rect { y: list.bottom(), height: area.height - height, ..area })
        };
        let title = Rect { height: right.height.min(1), ..right };
        let plot = Rect { y: title.bottom(), height: right.height - title.height, ..right };
        SignalAreas { list, title, plot }
    }

    fn plot_area(core: &UiState) -> Rect {
        Rect::new(0, 0, core.width, core.height)
    }

    fn look_of(&self, key: &SignalKey) -> Option<TextRole> {
        let picked = self.picked.iter().find(|picked| picked.key == *key)?;
        Some(TextRole::Highlight(picked.look))
    }

    fn plotted_keys(&self) -> Vec<SignalKey> {
        self.picked.iter().map(|picked| picked.key.clone()).collect()
    }

    /// Adds a signal to the plot; `false` if the plot is full.
    fn add_to_plot(&mut self, key: &SignalKey) -> bool {
        if self.look_of(key).is_some() {
            return true;
        }
        let is_free = |look: &u8| self.picked.iter().all(|picked| picked.look != *look);
        let most = u8::try_from(MOST_SIGNALS).unwrap_or(u8::MAX);
        let Some(look) = (0..most).find(is_free) else { return false };
        self.picked.push(PlottedKey { key: key.clone(), look });
        true
    }

    fn toggle_signal(&mut self, core: &UiState) -> Vec<PaneRequest> {
        let Some(key) = self.list.selected_signal().cloned() else {
            return vec![PaneRequest::Refuse("no signal to plot".into())];
        };
        self.refused = 0;
        if self.look_of(&key).is_some() {
            self.picked.retain(|picked| picked.key != key);
        } else if !self.add_to_plot(&key) {
            return vec![PaneRequest::Refuse(format!(
                "max {MOST_SIGNALS} signals; x removes the selected one"
            ))];
        }
        self.view.refresh_range(core, &self.plotted_keys());
        Vec::new()
    }

    /// Moves the cursor by `columns` columns of the plot.
    fn step_cursor(&mut self, core: &UiState, columns: i64) -> Vec<PaneRequest> {
        let area = self.pane_areas(Self::plot_area(core)).plot;
        let Some((zero, last)) = PlotView::whole_range(core) else { return vec![no_times()] };
        let time = self.view.cursor_time(core).unwrap_or(zero);
        let wanted = self.with_plot(core, |plot| plot.time_beside(area, time, columns)).unwrap_or(time);
        self.go_to_time(wanted.clamp(zero, last))
    }

    fn go_to_time(&mut self, time: i64) -> Vec<PaneRequest> {
        self.view.aim_at(time);
        vec![PaneRequest::Go(JumpPlace::Time(Timestamp(time)))]
    }

    /// Sets cursor B at the cursor, or removes it if it is there.
    fn set_second(&mut self, core: &UiState) -> Vec<PaneRequest> {
        let Some(time) = self.view.cursor_time(core) else { return vec![no_times()] };
        if self.second.as_ref().is_some_and(|second| second.time == time) {
            self.second = None;
            return vec![PaneRequest::Say("cursor B removed".into())];
        }
        let value = |picked: &PlottedKey| (picked.key.clone(), list::cursor_value(core, &picked.key));
        let values = self.picked.iter().map(value).collect();
        self.second = Some(SecondCursor { time, values });
        vec![PaneRequest::Say("cursor B set; b again removes it".into())]
    }

    fn clear_plot(&mut self, core: &UiState) {
        if self.list.is_narrowed() {
            self.list.search_signals("");
        } else {
            self.picked.clear();
            self.second = None;
            self.refused = 0;
            self.view.refresh_range(core, &[]);
        }
    }

    fn zoom_plot(&mut self, core: &UiState, is_in: bool) -> Vec<PaneRequest> {
        let refused = self.view.zoom_range(core, is_in).err();
        self.view.refresh_range(core, &self.plotted_keys());
        refused.map(|reason| PaneRequest::Refuse(reason.into())).into_iter().collect()
    }

    fn open_time(&mut self, core: &UiState, was_clicked: bool) -> Vec<PaneRequest> {
        if was_clicked || self.picked.is_empty() {
            return self.toggle_signal(core);
        }
        self.is_large = !self.is_large;
        Vec::new()
    }
}

impl Pane for SignalsPane {
    fn render_pane(&self, core: &UiState, area: Rect, buf: &mut Buffer) {
        let parts = self.pane_areas(area);
        self.list.draw_list(core, parts.list, buf, |key| self.look_of(key));
        let quiet = core.theme.role_style(TextRole::Quiet);
        let title = match self.picked.is_empty() {
            true if core.window.is_some() && PlotView::whole_range(core).is_none() => {
                "no plot: this capture has no timestamps".to_owned()
            }
            true => {
                "x plots the selected signal, / searches; p in other panes plots the selected item".into()
            }
            false => self.plot_title(core),
        };
        draw::draw_line(
            buf,
            parts.title,
            &Line::styled(title, quiet),
            draw::TextAlignment::Left,
            &core.theme,
        );
        if self.picked.is_empty() {
            return;
        }
        for y in area.top()..area.bottom() {
            let x = parts.list.right();
            if parts.list.width > 0 && x < parts.plot.x {
                draw::put_text(
                    buf,
                    x,
                    y,
                    1,
                    core.theme.glyph(Glyph::Vertical),
                    core.theme.role_style(TextRole::Border),
                );
            }
        }
        self.with_plot(core, |plot| plot.render(parts.plot, buf));
    }

    fn on_action(&mut self, action: Action, core: &UiState) -> Vec<PaneRequest> {
        let was_clicked = std::mem::take(&mut self.is_list_clicked);
        let height = TableWidget::visible_height(self.pane_areas(Self::plot_area(core)).list);
        match action {
            Action::Down => self.list.move_by(1),
            Action::Up => self.list.move_by(-1),
            Action::PageDown => self.list.page_selection(1, height),
            Action::PageUp => self.list.page_selection(-1, height),
            Action::Top => return vec![PaneRequest::Go(JumpPlace::Start)],
            Action::Bottom => return vec![PaneRequest::Go(JumpPlace::End)],
            Action::Left => return self.step_cursor(core, -1),
            Action::Right => return self.step_cursor(core, 1),
            Action::Toggle | Action::Plot => return self.toggle_signal(core),
            Action::Open => return self.open_time(core, was_clicked),
            Action::ZoomIn => return self.zoom_plot(core, true),
            Action::ZoomOut => return self.zoom_plot(core, false),
            Action::SetCursor => return self.set_second(core),
            Action::Clear => self.clear_plot(core),
            Action::Back if self.list.is_narrowed() => {
                self.list.search_signals("");
                return vec![PaneRequest::Say("all signals".into())];
            }
            Action::Back if self.is_large => {
                self.is_large = false;
                return vec![PaneRequest::Say("list shown".into())];
            }
            _ => {}
        }
        Vec::new()
    }

    fn on_click(&mut self, x: u16, y: u16, area: Rect, core: &UiState) -> Vec<PaneRequest> {
        let parts = self.pane_areas(area);
        self.is_list_clicked = parts.list.contains(Position::new(x, y));
        if self.is_list_clicked {
            self.list.click_row(core, parts.list, y);
            return Vec::new();
        }
        let time = |plot: &TimePlot<'_>| {
            plot.time_at(parts.plot, x).map(|time| plot.time_beside(parts.plot, time, 0))
        };
        let is_plot = !self.picked.is_empty() && parts.plot.contains(Position::new(x, y));
        match self.with_plot(core, time).flatten().filter(|_| is_plot) {
            Some(time) => self.go_to_time(time),
            None => Vec::new(),
        }
    }

    fn refresh_state(&mut self, core: &UiState) {
        self.list.refresh_entries(core);
        self.view.refresh_range(core, &self.plotted_keys());
    }

    fn on_request(&mut self, effect: &PaneRequest, core: &UiState) {
        match effect {
            PaneRequest::Plot(key) => {
                if self.list.selected_signal().is_none_or(|selected| self.look_of(selected).is_none()) {
                    self.list.select_signal(key);
                }
                self.refused += usize::from(!self.add_to_plot(key));
            }
            PaneRequest::Go(JumpPlace::Time(time)) if self.view.cursor_time(core) == Some(time.0) => {}
            PaneRequest::Go(_) => self.view.forget_aim(),
            _ => {}
        }
    }

    fn search_text(&mut self, text: &str, _core: &UiState) -> bool {
        self.list.search_signals(text);
        true
    }

    fn sought_text(&self) -> Option<&str> {
        Some(self.list.search_text())
    }

    fn pane_legend(&self) -> &'static PaneLegend {
        &legend::SIGNALS
    }

    fn table_heads(&self) -> Vec<TableColumn> {
        self.list.list_columns(Rect::ZERO).to_vec()
    }

    fn performed_actions(&self) -> &'static [Action] {
        &[
            Action::Left,
            Action::Right,
            Action::Toggle,
            Action::Plot,
            Action::ZoomIn,
            Action::ZoomOut,
            Action::SetCursor,
        ]
    }

    fn key_bar_actions(&self) -> &'static [Action] {
        &[
            Action::Toggle,
            Action::Search,
            Action::ZoomIn,
            Action::ZoomOut,
            Action::SetCursor,
            Action::Clear,
            Action::Copy,
            Action::Open,
        ]
    }

    fn filter_of_cell(&self, _core: &UiState) -> Option<String> {
        self.list.selected_signal().map(|signal| format!("signals.name == {:?}", signal.name))
    }

    #[expect(
        clippy::redundant_closure_for_method_calls,
        reason = "the method path does not accept a plot of any lifetime"
    )]
    fn selected_line(&self, core: &UiState) -> Option<String> {
        if self.picked.is_empty() {
            return self.list.selected_text(core);
        }
        self.with_plot(core, |plot| plot.legend_text())
    }
}

fn no_times() -> PaneRequest {
    PaneRequest::Refuse("this capture has no timestamps".into())
}
