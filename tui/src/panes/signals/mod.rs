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

use self::list::List;
pub use self::offered::plot;
use self::view::View;
use super::legend::{self, Legend};
use super::{Effect, Pane};
use crate::action::Action;
use crate::state::{Core, JumpPlace};
use crate::theme::{Glyph, Role};
use crate::timeline::{MOST_SIGNALS, SignalKey};
use crate::widgets::draw;
use crate::widgets::plot::Plot;
use crate::widgets::table::{Column, Table};

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
pub struct Signals {
    list: List,
    picked: Vec<PlottedKey>,
    view: View,
    second: Option<SecondCursor>,
    /// The plot takes the whole pane.
    is_large: bool,
    /// The last action was a click on the list.
    is_list_clicked: bool,
    /// Number of signals refused because the plot was full.
    refused: usize,
}

/// Screen areas of this pane.
struct Parts {
    list: Rect,
    title: Rect,
    plot: Rect,
}

impl Signals {
    fn parts(&self, area: Rect) -> Parts {
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
        Parts { list, title, plot }
    }

    fn area(core: &Core) -> Rect {
        Rect::new(0, 0, core.width, core.height)
    }

    fn look_of(&self, key: &SignalKey) -> Option<Role> {
        let picked = self.picked.iter().find(|picked| picked.key == *key)?;
        Some(Role::Highlight(picked.look))
    }

    fn keys(&self) -> Vec<SignalKey> {
        self.picked.iter().map(|picked| picked.key.clone()).collect()
    }

    /// Adds a signal to the plot; `false` if the plot is full.
    fn pick(&mut self, key: &SignalKey) -> bool {
        if self.look_of(key).is_some() {
            return true;
        }
        let is_free = |look: &u8| self.picked.iter().all(|picked| picked.look != *look);
        let most = u8::try_from(MOST_SIGNALS).unwrap_or(u8::MAX);
        let Some(look) = (0..most).find(is_free) else { return false };
        self.picked.push(PlottedKey { key: key.clone(), look });
        true
    }

    fn toggle(&mut self, core: &Core) -> Vec<Effect> {
        let Some(key) = self.list.selected().cloned() else {
            return vec![Effect::Refuse("no signal to plot".into())];
        };
        self.refused = 0;
        if self.look_of(&key).is_some() {
            self.picked.retain(|picked| picked.key != key);
        } else if !self.pick(&key) {
            return vec![Effect::Refuse(format!("max {MOST_SIGNALS} signals; x removes the selected one"))];
        }
        self.view.refresh(core, &self.keys());
        Vec::new()
    }

    /// Moves the cursor by `columns` columns of the plot.
    fn step(&mut self, core: &Core, columns: i64) -> Vec<Effect> {
        let area = self.parts(Self::area(core)).plot;
        let Some((zero, last)) = View::whole(core) else { return vec![no_times()] };
        let time = self.view.cursor(core).unwrap_or(zero);
        let wanted = self.with_plot(core, |plot| plot.beside(area, time, columns)).unwrap_or(time);
        self.go(wanted.clamp(zero, last))
    }

    fn go(&mut self, time: i64) -> Vec<Effect> {
        self.view.aim(time);
        vec![Effect::Go(JumpPlace::Time(Timestamp(time)))]
    }

    /// Sets cursor B at the cursor, or removes it if it is there.
    fn set_second(&mut self, core: &Core) -> Vec<Effect> {
        let Some(time) = self.view.cursor(core) else { return vec![no_times()] };
        if self.second.as_ref().is_some_and(|second| second.time == time) {
            self.second = None;
            return vec![Effect::Say("cursor B removed".into())];
        }
        let value = |picked: &PlottedKey| (picked.key.clone(), list::number(core, &picked.key));
        let values = self.picked.iter().map(value).collect();
        self.second = Some(SecondCursor { time, values });
        vec![Effect::Say("cursor B set; b again removes it".into())]
    }

    fn clear(&mut self, core: &Core) {
        if self.list.is_narrowed() {
            self.list.search("");
        } else {
            self.picked.clear();
            self.second = None;
            self.refused = 0;
            self.view.refresh(core, &[]);
        }
    }

    fn zoom(&mut self, core: &Core, is_in: bool) -> Vec<Effect> {
        let refused = self.view.zoom(core, is_in).err();
        self.view.refresh(core, &self.keys());
        refused.map(|reason| Effect::Refuse(reason.into())).into_iter().collect()
    }

    fn open(&mut self, core: &Core, was_clicked: bool) -> Vec<Effect> {
        if was_clicked || self.picked.is_empty() {
            return self.toggle(core);
        }
        self.is_large = !self.is_large;
        Vec::new()
    }
}

impl Pane for Signals {
    fn render(&self, core: &Core, area: Rect, buf: &mut Buffer) {
        let parts = self.parts(area);
        self.list.render(core, parts.list, buf, |key| self.look_of(key));
        let quiet = core.theme.style(Role::Quiet);
        let title = match self.picked.is_empty() {
            true if core.window.is_some() && View::whole(core).is_none() => {
                "no plot: this capture has no timestamps".to_owned()
            }
            true => {
                "x plots the selected signal, / searches; p in other panes plots the selected item".into()
            }
            false => self.title(core),
        };
        draw::line(buf, parts.title, &Line::styled(title, quiet), draw::Align::Left, &core.theme);
        if self.picked.is_empty() {
            return;
        }
        for y in area.top()..area.bottom() {
            let x = parts.list.right();
            if parts.list.width > 0 && x < parts.plot.x {
                draw::put(buf, x, y, 1, core.theme.glyph(Glyph::Vertical), core.theme.style(Role::Border));
            }
        }
        self.with_plot(core, |plot| plot.render(parts.plot, buf));
    }

    fn act(&mut self, action: Action, core: &Core) -> Vec<Effect> {
        let was_clicked = std::mem::take(&mut self.is_list_clicked);
        let height = Table::height(self.parts(Self::area(core)).list);
        match action {
            Action::Down => self.list.move_by(1),
            Action::Up => self.list.move_by(-1),
            Action::PageDown => self.list.page(1, height),
            Action::PageUp => self.list.page(-1, height),
            Action::Top => return vec![Effect::Go(JumpPlace::Start)],
            Action::Bottom => return vec![Effect::Go(JumpPlace::End)],
            Action::Left => return self.step(core, -1),
            Action::Right => return self.step(core, 1),
            Action::Toggle | Action::Plot => return self.toggle(core),
            Action::Open => return self.open(core, was_clicked),
            Action::ZoomIn => return self.zoom(core, true),
            Action::ZoomOut => return self.zoom(core, false),
            Action::SetCursor => return self.set_second(core),
            Action::Clear => self.clear(core),
            Action::Back if self.list.is_narrowed() => {
                self.list.search("");
                return vec![Effect::Say("all signals".into())];
            }
            Action::Back if self.is_large => {
                self.is_large = false;
                return vec![Effect::Say("list shown".into())];
            }
            _ => {}
        }
        Vec::new()
    }

    fn click(&mut self, x: u16, y: u16, area: Rect, core: &Core) -> Vec<Effect> {
        let parts = self.parts(area);
        self.is_list_clicked = parts.list.contains(Position::new(x, y));
        if self.is_list_clicked {
            self.list.click(core, parts.list, y);
            return Vec::new();
        }
        let time = |plot: &Plot<'_>| plot.time_at(parts.plot, x).map(|time| plot.beside(parts.plot, time, 0));
        let is_plot = !self.picked.is_empty() && parts.plot.contains(Position::new(x, y));
        match self.with_plot(core, time).flatten().filter(|_| is_plot) {
            Some(time) => self.go(time),
            None => Vec::new(),
        }
    }

    fn refresh(&mut self, core: &Core) {
        self.list.refresh(core);
        self.view.refresh(core, &self.keys());
    }

    fn offer(&mut self, effect: &Effect, core: &Core) {
        match effect {
            Effect::Plot(key) => {
                if self.list.selected().is_none_or(|selected| self.look_of(selected).is_none()) {
                    self.list.select(key);
                }
                self.refused += usize::from(!self.pick(key));
            }
            Effect::Go(JumpPlace::Time(time)) if self.view.cursor(core) == Some(time.0) => {}
            Effect::Go(_) => self.view.forget_aim(),
            _ => {}
        }
    }

    fn search(&mut self, text: &str, _core: &Core) -> bool {
        self.list.search(text);
        true
    }

    fn sought(&self) -> Option<&str> {
        Some(self.list.sought())
    }

    fn legend(&self) -> &'static Legend {
        &legend::SIGNALS
    }

    fn heads(&self) -> Vec<Column> {
        self.list.columns(Rect::ZERO).to_vec()
    }

    fn performs(&self) -> &'static [Action] {
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

    fn actions(&self) -> &'static [Action] {
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

    fn filter_of_cell(&self, _core: &Core) -> Option<String> {
        self.list.selected().map(|signal| format!("signals.name == {:?}", signal.name))
    }

    #[expect(
        clippy::redundant_closure_for_method_calls,
        reason = "the method path does not accept a plot of any lifetime"
    )]
    fn line(&self, core: &Core) -> Option<String> {
        if self.picked.is_empty() {
            return self.list.line(core);
        }
        self.with_plot(core, |plot| plot.legend())
    }
}

fn no_times() -> Effect {
    Effect::Refuse("this capture has no timestamps".into())
}
