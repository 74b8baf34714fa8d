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
use cobscope_decoder::words::count_noun;
use ratatui::buffer::Buffer;
use ratatui::layout::Rect;
use ratatui::text::{Line, Span};

use self::axis::{AxisColumnContent, MOST_ZOOM, TimeAxis, further_time};
use super::common::{bus_name, last_world};
use super::legend::{self, PaneLegend};
use super::{Pane, PaneRequest};
use crate::action::Action;
use crate::state::{JumpPlace, UiState};
use crate::theme::{Glyph, TextRole};
use crate::timeline::SurveyResults;
use crate::widgets::bars::Bars;
use crate::widgets::draw;
use cobscope_decoder::answers::statistics::phrases::protocols_text;
use cobscope_decoder::figures::{format_bits, format_load, format_millis, format_seconds};

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
struct BusAreas {
    title: Rect,
    load: Rect,
    axis: Rect,
    cursor: Rect,
    errors: Rect,
    text: Rect,
}

fn pane_areas(area: Rect, has_times: bool, has_errors: bool) -> BusAreas {
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
    BusAreas {
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
    fn time_axis(&self, core: &UiState, width: u16) -> Option<TimeAxis> {
        let (first, last) = core.timeline.progress().time_range()?;
        let cursor = core.cursor_time().unwrap_or(first);
        let columns = width.saturating_sub(SCALE);
        (columns > 0).then(|| TimeAxis::new(first.0, last.0, cursor.0, self.zoom, columns))
    }

    fn draw_title(
        &self,
        core: &UiState,
        bus: Option<&Bus>,
        (axis, count): (Option<&TimeAxis>, usize),
        area: Rect,
        buf: &mut Buffer,
    ) {
        let theme = &core.theme;
        let mut spans = Vec::new();
        if let Some(bus) = bus {
            spans.push(Span::styled(escape(bus.name()).into_owned(), theme.role_style(TextRole::Title)));
            let rate = bus.bit_rate().map_or(String::new(), |rate| format!(", {} kbit/s", rate / 1_000));
            spans.push(Span::raw(format!("  {}{rate}", escape(&protocols_text(bus)))));
        }
        if count > 1 {
            let text = format!("  (bus {} of {count})", self.bus.min(count - 1) + 1);
            spans.push(Span::styled(text, theme.role_style(TextRole::Quiet)));
        }
        draw::draw_line(buf, area, &Line::from(spans), draw::TextAlignment::Left, theme);
        if let Some(axis) = axis {
            let part = if self.zoom == 0 {
                "all".to_owned()
            } else {
                format!("1/{} of the capture", 1_u64 << self.zoom)
            };
            let text = format!("  1 column = {} ms, {part}", format_millis(axis.column));
            draw::draw_line(
                buf,
                area,
                &Line::styled(text, theme.role_style(TextRole::Quiet)),
                draw::TextAlignment::Right,
                theme,
            );
        }
    }

    /// Draws bars with their highest value on the left.
    fn draw_bars(core: &UiState, values: &[f64], (top, is_load): (&str, bool), area: Rect, buf: &mut Buffer) {
        let theme = &core.theme;
        let scale = Rect { width: SCALE.saturating_sub(1).min(area.width), height: 1, ..area };
        draw::draw_line(
            buf,
            scale,
            &Line::styled(top.to_owned(), theme.role_style(TextRole::Quiet)),
            draw::TextAlignment::Right,
            theme,
        );
        let bars = Bars::new(theme, values);
        let bars = if is_load { bars } else { bars.scale_relative() };
        bars.render(behind_scale(area), buf);
    }

    /// Draws the time axis with the cursor. The start time is to the left of it and the end time below it, so
    /// that the cursor can reach every column.
    fn draw_axis(core: &UiState, axis: &TimeAxis, area: Rect, buf: &mut Buffer) {
        let theme = &core.theme;
        let inside = behind_scale(area);
        let style = theme.role_style(TextRole::Border);
        draw::put_text(
            buf,
            inside.x,
            inside.y,
            inside.width,
            &theme.glyph(Glyph::Horizontal).repeat(usize::from(inside.width)),
            style,
        );
        let begin = Line::styled(moment_text(core, axis.start), theme.role_style(TextRole::Quiet));
        draw::draw_line(buf, Rect { width: SCALE - 1, ..area }, &begin, draw::TextAlignment::Right, theme);
        if let Some(column) = core.cursor_time().or(core.first_time()).and_then(|time| axis.column_of(time.0))
        {
            draw::put_text(
                buf,
                inside.x + column,
                inside.y,
                1,
                theme.glyph(Glyph::Up),
                theme.role_style(TextRole::Cursor),
            );
        }
    }

    /// Draws load and frames at the cursor, and the end time on the right.
    fn draw_cursor(
        core: &UiState,
        axis: &TimeAxis,
        contents: &[AxisColumnContent],
        rate: Option<u32>,
        area: Rect,
        buf: &mut Buffer,
    ) {
        let theme = &core.theme;
        let end = moment_text(core, axis.axis_end());
        let inside = behind_scale(area);
        let room = inside.width.saturating_sub(draw::text_width(&end) + 1);
        draw::draw_line(
            buf,
            inside,
            &Line::styled(end, theme.role_style(TextRole::Quiet)),
            draw::TextAlignment::Right,
            theme,
        );
        let Some(time) = core.cursor_time().or(core.first_time()) else { return };
        let Some(content) = axis.column_of(time.0).and_then(|column| contents.get(usize::from(column)))
        else {
            return;
        };
        let load = match rate {
            Some(rate) => format_load(content.bits.into(), SECOND, rate),
            None => format!("{}/s", format_bits(u128::from(content.bits))),
        };
        let mut spans = vec![
            Span::styled(format!("t {}", moment_text(core, time.0)), theme.role_style(TextRole::Title)),
            Span::raw(format!("  {load}, {} frames/s", content.frames)),
        ];
        if content.errors > 0 {
            let text = format!("  {}", count_noun(content.errors, "error frame"));
            spans.push(Span::styled(text, theme.role_style(TextRole::Bad)));
        }
        let here = Rect { width: room, ..inside };
        draw::draw_line(buf, here, &Line::from(spans), draw::TextAlignment::Left, theme);
    }

    /// Moves the cursor one column, or further if the column contains no frame.
    fn step_cursor(&self, core: &UiState, is_right: bool) -> Vec<PaneRequest> {
        let (Some(axis), Some(time)) =
            (self.time_axis(core, core.width), core.cursor_time().or(core.first_time()))
        else {
            return vec![PaneRequest::Refuse("this capture has no timestamps".into())];
        };
        let survey = core.timeline.survey();
        let target = if is_right {
            further_time(&survey.overview.load, time.0, axis.column)
                .map_or(JumpPlace::End, |time| JumpPlace::Time(Timestamp(time)))
        } else {
            let target = time.0.saturating_sub(axis.column);
            let is_before = core.first_time().is_none_or(|zero| target < zero.0);
            if is_before { JumpPlace::Start } else { JumpPlace::Time(Timestamp(target)) }
        };
        vec![PaneRequest::Go(target)]
    }

    fn zoom_axis(&mut self, core: &UiState, is_in: bool) -> Vec<PaneRequest> {
        if !is_in {
            self.zoom = self.zoom.saturating_sub(1);
            return Vec::new();
        }
        let step = core.timeline.survey().overview.load.iter().map(crate::timeline::LoadOverTime::step).min();
        let column = self.time_axis(core, core.width).map(|axis| axis.column);
        match (column, step) {
            (Some(column), Some(step)) if column > step && self.zoom < MOST_ZOOM => self.zoom += 1,
            _ => return vec![PaneRequest::Refuse("finest load resolution reached".into())],
        }
        Vec::new()
    }
}

/// Seconds from the first frame.
fn moment_text(core: &UiState, time: i64) -> String {
    format!("{} s", format_seconds(Timestamp(time).since(core.first_time().unwrap_or_default())))
}

/// One second in ns, the window of the bits of a column.
const SECOND: u128 = 1_000_000_000;

#[expect(clippy::cast_precision_loss, reason = "the height of a bar")]
fn load_percent(bits: u64, rate: u32) -> f64 {
    bits as f64 * 100.0 / f64::from(rate.max(1))
}

#[expect(clippy::cast_precision_loss, reason = "drawn in eighths of a cell")]
fn column_values(contents: &[AxisColumnContent], value: impl Fn(&AxisColumnContent) -> u64) -> Vec<f64> {
    contents.iter().map(|content| value(content) as f64).collect()
}

/// Load per column, and the text of the highest.
fn load_values(contents: &[AxisColumnContent], rate: Option<u32>) -> (Vec<f64>, String) {
    let highest = contents.iter().map(|content| content.bits).max().unwrap_or(0);
    match rate {
        Some(rate) => {
            let loads = contents.iter().map(|content| load_percent(content.bits, rate)).collect();
            (loads, format!("max {:.0} %", load_percent(highest, rate)))
        }
        None => (column_values(contents, |content| content.bits), format_bits(u128::from(highest)) + "/s"),
    }
}

impl Pane for BusPane {
    fn render_pane(&self, core: &UiState, area: Rect, buf: &mut Buffer) {
        let survey = core.timeline.survey();
        let world = last_world(core);
        let buses = world.as_ref().map_or(Buses::default(), |world| world.buses());
        let place = self.bus.min(buses.len().saturating_sub(1));
        let (bus, steps) = (buses.get(place), survey.overview.load.get(place));
        let axis = self.time_axis(core, area.width).filter(|_| steps.is_some());
        let contents =
            axis.as_ref().zip(steps).map(|(axis, steps)| axis.column_contents(steps)).unwrap_or_default();
        let has_errors =
            survey.overview.load.iter().any(|load| load.steps().iter().any(|step| step.errors > 0));
        let parts = pane_areas(area, axis.is_some(), has_errors);
        self.draw_title(core, bus, (axis.as_ref(), buses.len()), parts.title, buf);
        let rate = bus.and_then(Bus::bit_rate);
        if let Some(axis) = &axis {
            let (loads, top) = load_values(&contents, rate);
            Self::draw_bars(core, &loads, (&top, rate.is_some()), parts.load, buf);
            Self::draw_axis(core, axis, parts.axis, buf);
            Self::draw_cursor(core, axis, &contents, rate, parts.cursor, buf);
            if parts.errors.height > 0 {
                let most = contents.iter().map(|content| content.errors).max().unwrap_or(0);
                let errors = column_values(&contents, |content| content.errors);
                Self::draw_bars(core, &errors, (&format!("{most} err"), false), parts.errors, buf);
            }
        }
        let lines = figures::figure_lines(
            core,
            &survey,
            bus.zip(survey.overview.statistics.buses.get(place)),
            buses.len(),
        );
        lines.render(&core.theme, self.scroll, parts.text, buf);
    }

    fn on_action(&mut self, action: Action, core: &UiState) -> Vec<PaneRequest> {
        let buses = last_world(core).map_or(0, |world| world.buses().len());
        match action {
            Action::Left | Action::Right => return self.step_cursor(core, action == Action::Right),
            Action::Top => return vec![PaneRequest::Go(JumpPlace::Start)],
            Action::Bottom => return vec![PaneRequest::Go(JumpPlace::End)],
            Action::ZoomIn | Action::ZoomOut => return self.zoom_axis(core, action == Action::ZoomIn),
            Action::Open => return vec![PaneRequest::ShowEvents],
            Action::Down if buses > 1 => self.bus = (self.bus + 1).min(buses - 1),
            Action::Up if buses > 1 => self.bus = self.bus.saturating_sub(1),
            Action::Down | Action::PageDown => self.scroll = (self.scroll + 1).min(self.last_scroll(core)),
            Action::Up | Action::PageUp => self.scroll = self.scroll.saturating_sub(1),
            _ => {}
        }
        Vec::new()
    }

    fn on_click(&mut self, x: u16, y: u16, area: Rect, core: &UiState) -> Vec<PaneRequest> {
        let inside = behind_scale(area);
        let Some(axis) = self.time_axis(core, area.width) else { return Vec::new() };
        let (is_bars, column) = (y < area.y + area.height / 2, x.checked_sub(inside.x));
        let time = column.filter(|_| is_bars).map(|column| Timestamp(axis.time_of(column)));
        time.map(|time| PaneRequest::Go(JumpPlace::Time(time))).into_iter().collect()
    }

    fn pane_legend(&self) -> &'static PaneLegend {
        &legend::BUS
    }

    fn performed_actions(&self) -> &'static [Action] {
        &[Action::Left, Action::Right, Action::ZoomIn, Action::ZoomOut]
    }

    fn key_bar_actions(&self) -> &'static [Action] {
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

    fn filter_of_cell(&self, core: &UiState) -> Option<String> {
        let world = last_world(core)?;
        let bus = world.buses().get(self.bus.min(world.buses().len().saturating_sub(1)))?;
        Some(format!("bus == {:?}", bus.name()))
    }

    fn selected_line(&self, core: &UiState) -> Option<String> {
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
    fn last_scroll(&self, core: &UiState) -> usize {
        let survey: &SurveyResults = &core.timeline.survey();
        let world = last_world(core);
        let buses = world.as_ref().map_or(Buses::default(), |world| world.buses());
        let place = self.bus.min(buses.len().saturating_sub(1));
        let area = Rect::new(0, 0, core.width, core.height);
        let has_errors =
            survey.overview.load.iter().any(|load| load.steps().iter().any(|step| step.errors > 0));
        let text = pane_areas(area, self.time_axis(core, core.width).is_some(), has_errors).text;
        let lines = figures::figure_lines(
            core,
            survey,
            buses.get(place).zip(survey.overview.statistics.buses.get(place)),
            buses.len(),
        );
        lines.last_scroll(&core.theme, text)
    }
}
