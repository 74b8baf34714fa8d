//! Bus: load and error frames over the whole capture, the cursor, SYNC, NMT commands and quality of the
//! capture.
//!
//! ```text
//! can0  CANopen, 250 kbit/s                                     1 column = 70.000 ms, all
//!  31 % ▁▁▂▂▂▃▃▂▂▁▁▁▅▆█▇▅▂▂▁▁▁
//! 0.0 s ──────────────▲───────
//!       t 4.030 s  12 %, 80 frames/s    17 error frames  6.130 s
//!    17 ▁▁█▁
//! frames   181 frames, 29.5/s, 1691 bit/s; worst second 47 frames …
//! ```

mod axis;
mod figures;

use cobscope_decoder::frame::Timestamp;
use cobscope_decoder::session::{Bus, Buses};
use cobscope_decoder::sink::escape;
use cobscope_decoder::words::plural;
use ratatui::buffer::Buffer;
use ratatui::layout::Rect;
use ratatui::text::{Line, Span};

use self::axis::{Axis, Content, MOST_ZOOM, further};
use super::common::{bus_name, last_world};
use super::legend::{self, Legend};
use super::{Effect, Pane};
use crate::action::Action;
use crate::figures::{bits, millis, seconds};
use crate::state::{Core, JumpPlace};
use crate::theme::{Glyph, Role};
use crate::timeline::SurveyResults;
use crate::widgets::bars::Bars;
use crate::widgets::draw;
use crate::words::protocols;

/// Width of the scale.
const SCALE: u16 = 12;

/// Height from which the bars are higher.
const TALL: u16 = 26;

/// The pane of the buses, one at a time.
#[derive(Debug, Default)]
pub struct BusPane {
    /// Index of the bus.
    bus: usize,
    /// Number of halvings of the time range.
    zoom: u32,
    /// First visible line of the text.
    scroll: usize,
}

/// Screen areas of this pane.
struct Parts {
    title: Rect,
    load: Rect,
    axis: Rect,
    cursor: Rect,
    errors: Rect,
    text: Rect,
}

fn parts(area: Rect, has_times: bool, has_errors: bool) -> Parts {
    let line = |y: u16, height: u16| {
        let y = y.min(area.height);
        Rect { y: area.y + y, height: height.min(area.height - y), ..area }
    };
    let high = match (has_times, area.height) {
        (false, _) => 0,
        (true, TALL..) => 6,
        (true, 12..) => 3,
        (true, _) => 1,
    };
    let errors = u16::from(has_times && has_errors) * if area.height >= TALL { 2 } else { 1 };
    let times = u16::from(has_times);
    let text = 1 + high + 2 * times + errors;
    Parts {
        title: line(0, 1),
        load: line(1, high),
        axis: line(1 + high, times),
        cursor: line(1 + high + times, times),
        errors: line(1 + high + 2 * times, errors),
        text: line(text + 1, area.height),
    }
}

/// The part of a line to the right of the scale.
fn behind_scale(area: Rect) -> Rect {
    let scale = SCALE.min(area.width);
    Rect { x: area.x + scale, width: area.width - scale, ..area }
}

impl BusPane {
    /// Times of the columns; None without timestamps.
    fn axis(&self, core: &Core, width: u16) -> Option<Axis> {
        let (first, last) = core.timeline.progress().times()?;
        let cursor = core.time().unwrap_or(first);
        let columns = width.saturating_sub(SCALE);
        (columns > 0).then(|| Axis::new(first.0, last.0, cursor.0, self.zoom, columns))
    }

    fn draw_title(
        &self,
        core: &Core,
        bus: Option<&Bus>,
        (axis, count): (Option<&Axis>, usize),
        area: Rect,
        buf: &mut Buffer,
    ) {
        let theme = &core.theme;
        let mut spans = Vec::new();
        if let Some(bus) = bus {
            spans.push(Span::styled(escape(bus.name()).into_owned(), theme.style(Role::Title)));
            let rate = bus.bit_rate().map_or(String::new(), |rate| format!(", {} kbit/s", rate / 1_000));
            spans.push(Span::raw(format!("  {}{rate}", escape(&protocols(bus)))));
        }
        if count > 1 {
            let text = format!("  (bus {} of {count})", self.bus.min(count - 1) + 1);
            spans.push(Span::styled(text, theme.style(Role::Quiet)));
        }
        draw::line(buf, area, &Line::from(spans), draw::Align::Left, theme);
        if let Some(axis) = axis {
            let part = if self.zoom == 0 {
                "all".to_owned()
            } else {
                format!("1/{} of the capture", 1_u64 << self.zoom)
            };
            let text = format!("  1 column = {} ms, {part}", millis(axis.column));
            draw::line(buf, area, &Line::styled(text, theme.style(Role::Quiet)), draw::Align::Right, theme);
        }
    }

    /// Draws bars with their highest value on the left.
    fn draw_bars(core: &Core, values: &[f64], (top, is_load): (&str, bool), area: Rect, buf: &mut Buffer) {
        let theme = &core.theme;
        let scale = Rect { width: SCALE.saturating_sub(1).min(area.width), height: 1, ..area };
        draw::line(
            buf,
            scale,
            &Line::styled(top.to_owned(), theme.style(Role::Quiet)),
            draw::Align::Right,
            theme,
        );
        let bars = Bars::new(theme, values);
        let bars = if is_load { bars } else { bars.relative() };
        bars.render(behind_scale(area), buf);
    }

    /// Draws the time axis with the cursor. The start time is to the left of it and the end time below it, so
    /// that the cursor can reach every column.
    fn draw_axis(core: &Core, axis: &Axis, area: Rect, buf: &mut Buffer) {
        let theme = &core.theme;
        let inside = behind_scale(area);
        let style = theme.style(Role::Border);
        draw::put(
            buf,
            inside.x,
            inside.y,
            inside.width,
            &theme.glyph(Glyph::Horizontal).repeat(usize::from(inside.width)),
            style,
        );
        let begin = Line::styled(moment(core, axis.start), theme.style(Role::Quiet));
        draw::line(buf, Rect { width: SCALE - 1, ..area }, &begin, draw::Align::Right, theme);
        if let Some(column) = core.time().or(core.zero()).and_then(|time| axis.column_of(time.0)) {
            draw::put(buf, inside.x + column, inside.y, 1, theme.glyph(Glyph::Up), theme.style(Role::Cursor));
        }
    }

    /// Draws load and frames at the cursor, and the end time on the right.
    fn draw_cursor(
        core: &Core,
        axis: &Axis,
        contents: &[Content],
        rate: Option<u32>,
        area: Rect,
        buf: &mut Buffer,
    ) {
        let theme = &core.theme;
        let end = moment(core, axis.end());
        let inside = behind_scale(area);
        let room = inside.width.saturating_sub(draw::width(&end) + 1);
        draw::line(buf, inside, &Line::styled(end, theme.style(Role::Quiet)), draw::Align::Right, theme);
        let Some(time) = core.time().or(core.zero()) else { return };
        let Some(content) = axis.column_of(time.0).and_then(|column| contents.get(usize::from(column)))
        else {
            return;
        };
        let load = match rate {
            Some(rate) => format!("{:.1} %", percent(content.bits, rate)),
            None => format!("{}/s", bits(u128::from(content.bits))),
        };
        let mut spans = vec![
            Span::styled(format!("t {}", moment(core, time.0)), theme.style(Role::Title)),
            Span::raw(format!("  {load}, {} frames/s", content.frames)),
        ];
        if content.errors > 0 {
            let text = format!("  {}", plural(content.errors, "error frame"));
            spans.push(Span::styled(text, theme.style(Role::Bad)));
        }
        let here = Rect { width: room, ..inside };
        draw::line(buf, here, &Line::from(spans), draw::Align::Left, theme);
    }

    /// Moves the cursor one column, or further if the column contains no frame.
    fn step(&self, core: &Core, is_right: bool) -> Vec<Effect> {
        let (Some(axis), Some(time)) = (self.axis(core, core.width), core.time().or(core.zero())) else {
            return vec![Effect::Refuse("this capture has no timestamps".into())];
        };
        let survey = core.timeline.survey();
        let target = if is_right {
            further(&survey.overview.load, time.0, axis.column)
                .map_or(JumpPlace::End, |time| JumpPlace::Time(Timestamp(time)))
        } else {
            let target = time.0.saturating_sub(axis.column);
            let is_before = core.zero().is_none_or(|zero| target < zero.0);
            if is_before { JumpPlace::Start } else { JumpPlace::Time(Timestamp(target)) }
        };
        vec![Effect::Go(target)]
    }

    fn zoom(&mut self, core: &Core, is_in: bool) -> Vec<Effect> {
        if !is_in {
            self.zoom = self.zoom.saturating_sub(1);
            return Vec::new();
        }
        let step = core.timeline.survey().overview.load.iter().map(crate::timeline::LoadOverTime::step).min();
        let column = self.axis(core, core.width).map(|axis| axis.column);
        match (column, step) {
            (Some(column), Some(step)) if column > step && self.zoom < MOST_ZOOM => self.zoom += 1,
            _ => return vec![Effect::Refuse("finest load resolution reached".into())],
        }
        Vec::new()
    }
}

/// Seconds from the first frame.
fn moment(core: &Core, time: i64) -> String {
    format!("{} s", seconds(Timestamp(time).since(core.zero().unwrap_or_default())))
}

#[expect(clippy::cast_precision_loss, reason = "shown with a few digits")]
fn percent(bits: u64, rate: u32) -> f64 {
    bits as f64 * 100.0 / f64::from(rate.max(1))
}

#[expect(clippy::cast_precision_loss, reason = "drawn in eighths of a cell")]
fn values(contents: &[Content], value: impl Fn(&Content) -> u64) -> Vec<f64> {
    contents.iter().map(|content| value(content) as f64).collect()
}

/// Load per column, and the text of the highest.
fn load(contents: &[Content], rate: Option<u32>) -> (Vec<f64>, String) {
    let highest = contents.iter().map(|content| content.bits).max().unwrap_or(0);
    match rate {
        Some(rate) => {
            let loads = contents.iter().map(|content| percent(content.bits, rate)).collect();
            (loads, format!("max {:.0} %", percent(highest, rate)))
        }
        None => (values(contents, |content| content.bits), bits(u128::from(highest)) + "/s"),
    }
}

impl Pane for BusPane {
    fn render(&self, core: &Core, area: Rect, buf: &mut Buffer) {
        let survey = core.timeline.survey();
        let world = last_world(core);
        let buses = world.as_ref().map_or(Buses::default(), |world| world.buses());
        let place = self.bus.min(buses.len().saturating_sub(1));
        let (bus, steps) = (buses.get(place), survey.overview.load.get(place));
        let axis = self.axis(core, area.width).filter(|_| steps.is_some());
        let contents = axis.as_ref().zip(steps).map(|(axis, steps)| axis.contents(steps)).unwrap_or_default();
        let has_errors =
            survey.overview.load.iter().any(|load| load.steps().iter().any(|step| step.errors > 0));
        let parts = parts(area, axis.is_some(), has_errors);
        self.draw_title(core, bus, (axis.as_ref(), buses.len()), parts.title, buf);
        let rate = bus.and_then(Bus::bit_rate);
        if let Some(axis) = &axis {
            let (loads, top) = load(&contents, rate);
            Self::draw_bars(core, &loads, (&top, rate.is_some()), parts.load, buf);
            Self::draw_axis(core, axis, parts.axis, buf);
            Self::draw_cursor(core, axis, &contents, rate, parts.cursor, buf);
            if parts.errors.height > 0 {
                let most = contents.iter().map(|content| content.errors).max().unwrap_or(0);
                let errors = values(&contents, |content| content.errors);
                Self::draw_bars(core, &errors, (&format!("{most} err"), false), parts.errors, buf);
            }
        }
        let lines =
            figures::lines(core, &survey, bus.zip(survey.overview.statistics.buses.get(place)), buses.len());
        lines.render(&core.theme, self.scroll, parts.text, buf);
    }

    fn act(&mut self, action: Action, core: &Core) -> Vec<Effect> {
        let buses = last_world(core).map_or(0, |world| world.buses().len());
        match action {
            Action::Left | Action::Right => return self.step(core, action == Action::Right),
            Action::Top => return vec![Effect::Go(JumpPlace::Start)],
            Action::Bottom => return vec![Effect::Go(JumpPlace::End)],
            Action::ZoomIn | Action::ZoomOut => return self.zoom(core, action == Action::ZoomIn),
            Action::Open => return vec![Effect::ShowEvents],
            Action::Down if buses > 1 => self.bus = (self.bus + 1).min(buses - 1),
            Action::Up if buses > 1 => self.bus = self.bus.saturating_sub(1),
            Action::Down | Action::PageDown => self.scroll = (self.scroll + 1).min(self.last_scroll(core)),
            Action::Up | Action::PageUp => self.scroll = self.scroll.saturating_sub(1),
            _ => {}
        }
        Vec::new()
    }

    fn click(&mut self, x: u16, y: u16, area: Rect, core: &Core) -> Vec<Effect> {
        let inside = behind_scale(area);
        let Some(axis) = self.axis(core, area.width) else { return Vec::new() };
        let (is_bars, column) = (y < area.y + area.height / 2, x.checked_sub(inside.x));
        let time = column.filter(|_| is_bars).map(|column| Timestamp(axis.time_of(column)));
        time.map(|time| Effect::Go(JumpPlace::Time(time))).into_iter().collect()
    }

    fn legend(&self) -> &'static Legend {
        &legend::BUS
    }

    fn performs(&self) -> &'static [Action] {
        &[Action::Left, Action::Right, Action::ZoomIn, Action::ZoomOut]
    }

    fn actions(&self) -> &'static [Action] {
        &[
            Action::Left,
            Action::Right,
            Action::ZoomIn,
            Action::ZoomOut,
            Action::NextFinding,
            Action::NextError,
            Action::GoTo,
            Action::FilterCell,
        ]
    }

    fn filter_of_cell(&self, core: &Core) -> Option<String> {
        let world = last_world(core)?;
        let bus = world.buses().get(self.bus.min(world.buses().len().saturating_sub(1)))?;
        Some(format!("bus == {:?}", bus.name()))
    }

    fn line(&self, core: &Core) -> Option<String> {
        let world = last_world(core)?;
        let place = self.bus.min(world.buses().len().saturating_sub(1));
        let bus = world.buses().get(place)?;
        let survey = core.timeline.survey();
        let text = figures::rates_of(&survey, bus, survey.overview.statistics.buses.get(place)?).join("; ");
        drop(survey);
        Some(format!("{} {text}", bus_name(core, bus.index())))
    }
}

impl BusPane {
    /// Scroll position that shows the last line.
    fn last_scroll(&self, core: &Core) -> usize {
        let survey: &SurveyResults = &core.timeline.survey();
        let world = last_world(core);
        let buses = world.as_ref().map_or(Buses::default(), |world| world.buses());
        let place = self.bus.min(buses.len().saturating_sub(1));
        let area = Rect::new(0, 0, core.width, core.height);
        let has_errors =
            survey.overview.load.iter().any(|load| load.steps().iter().any(|step| step.errors > 0));
        let text = parts(area, self.axis(core, core.width).is_some(), has_errors).text;
        let lines = figures::lines(
            core,
            survey,
            buses.get(place).zip(survey.overview.statistics.buses.get(place)),
            buses.len(),
        );
        lines.last_scroll(&core.theme, text)
    }
}
