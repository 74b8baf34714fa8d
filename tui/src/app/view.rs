//! Drawing of the screen.
//!
//! ```text
//! can0 250k  load 34 %  errframes 0 …  FINDINGS 2 err 3 warn          t 412.306 s     header
//! 0 Why  1 Nodes  2 Events  3 Frames …                                                 panes
//! 2 errors 3 warnings: 32/20 EMCY 8305 spool position error, 7.204 s  ] finding  0 why diagnosis
//! load ▁▂█ ▂▂▂▂▂▂▂▂▂▂▂▂▂▂▂▃▂▂▂▂▂▂▂▂▂▂▂▂▂▂▃▂▂▂▂▄▂▂▂▂▂▂▂▂▂▂▂▂▂▂▂▂▂▂▂▂▂▂▂▂▃▂  0 to       strip
//! find ··································Ewwwwwwwwwwwwwwwwww·············  13.8 s
//! ┌─────────────────────────────────────────────────────────────────────────────────┐
//! │ the panes of the layout                                                         │
//! └─────────────────────────────────────────────────────────────────────────────────┘
//! cobscope view a.log --pane events --at '#1842'                         #1842/9950    command for this view
//! enter open  f filter  ] finding  ? help  q quit                                      key bar or prompt
//! ```

use cobscope_decoder::words::count_noun;
use ratatui::buffer::Buffer;
use ratatui::layout::Rect;
use ratatui::text::Line;

use super::application::{App, InputMode};
use super::hints::{self, KeyHint};
use super::{diagnosis, header, strip};
use crate::ascii;
use crate::panes::PaneId;
use crate::theme::{Glyph, LineCharacters, TextRole};
use crate::widgets::bars::Gauge;
use crate::widgets::draw;

/// Width of the progress bar of the index.
const GAUGE: u16 = 20;

/// Height of the pane up to which its last line is not used for the row above a prompt.
const LEAST_BODY: u16 = 3;

/// Heights from which the line of the diagnosis, one line and two lines of the strip of time are shown.
const LOW: u16 = 10;
const STRIP_FROM: u16 = 12;
const LOAD_FROM: u16 = 20;

/// Areas of the screen.
pub(super) struct ScreenAreas {
    pub(super) header: Rect,
    pub(super) tabs: Rect,
    /// One line of the diagnosis; empty on low screens.
    pub(super) diagnosis: Rect,
    /// Strip of time; empty on low screens.
    pub(super) strip: Rect,
    pub(super) body: Rect,
    pub(super) status: Rect,
    pub(super) footer: Rect,
}

/// Divides the screen.
pub(super) fn divide_screen(area: Rect, has_strip: bool) -> ScreenAreas {
    let line = |y: u16| Rect { y: area.y + y.min(area.height), height: u16::from(y < area.height), ..area };
    let below = |from_end: u16| line(area.height.saturating_sub(from_end));
    let diagnosis = u16::from(area.height >= LOW);
    let strip = match area.height {
        _ if !has_strip => 0,
        ..STRIP_FROM => 0,
        STRIP_FROM..LOAD_FROM => 1,
        _ => 2,
    };
    let above = 2 + diagnosis + strip;
    ScreenAreas {
        header: line(0),
        tabs: line(1),
        diagnosis: if diagnosis > 0 { line(2) } else { Rect::ZERO },
        strip: Rect { y: area.y + 2 + diagnosis, height: strip, ..area },
        body: Rect {
            y: area.y + above.min(area.height),
            height: area.height.saturating_sub(above + 2),
            ..area
        },
        status: if area.height > 3 { below(2) } else { Rect::ZERO },
        footer: if area.height > 2 { below(1) } else { Rect::ZERO },
    }
}

/// Numbered titles of the panes; without spaces around them if `width` is too small.
fn pane_tabs(width: u16) -> Vec<(PaneId, String)> {
    let all = |is_wide: bool| {
        let title = move |pane: &PaneId| match (*pane as usize, is_wide) {
            (number, true) => format!(" {number} {} ", pane.title()),
            (number, false) => format!("{number}{} ", pane.title()),
        };
        PaneId::ALL.iter().map(|pane| (*pane, title(pane))).collect::<Vec<_>>()
    };
    let wide = all(true);
    let fits = wide.iter().map(|(_, title)| draw::text_width(title)).sum::<u16>() <= width;
    if fits { wide } else { all(false) }
}

/// The pane whose title is at a screen column.
pub(super) fn tab_at(x: u16, width: u16) -> Option<PaneId> {
    let mut end = 0;
    let mut tabs = pane_tabs(width).into_iter();
    tabs.find(|(_, title)| {
        end += draw::text_width(title);
        x < end
    })
    .map(|(pane, _)| pane)
}

impl App {
    /// Draws the screen.
    pub fn draw(&mut self, area: Rect, buf: &mut Buffer) {
        let parts = divide_screen(area, self.has_strip);
        header::draw_header(&self.core, parts.header, buf);
        self.draw_tabs(parts.tabs, buf);
        diagnosis::draw_diagnosis(&self.core, parts.diagnosis, buf);
        strip::draw_strip(&self.core, parts.strip, buf);
        match &self.mode {
            InputMode::Help(scroll) => self.draw_help(*scroll, parts.body, buf),
            _ => self.draw_panes(parts.body, buf),
        }
        self.draw_status(parts.status, buf);
        self.draw_footer(&parts, buf);
        if self.core.theme.borders() == LineCharacters::Ascii {
            // All text ends here, also that of captures.
            ascii::replace_symbols(buf);
        }
    }

    /// Draws the panes of the layout with their titles.
    fn draw_panes(&mut self, body: Rect, buf: &mut Buffer) {
        let theme = self.core.theme;
        for cell in self.shown_cells(body) {
            let is_focused = cell.pane == self.pane;
            self.core.theme = theme.with_focus(is_focused);
            let role = if is_focused { TextRole::BorderActive } else { TextRole::Border };
            if !cell.title.is_empty() {
                let line = theme.glyph(Glyph::Horizontal).repeat(usize::from(cell.title.width));
                draw::put_text(
                    buf,
                    cell.title.x,
                    cell.title.y,
                    cell.title.width,
                    &line,
                    theme.role_style(role),
                );
                let title = format!(" {} {} ", cell.pane as usize, cell.pane.title());
                let role = if is_focused { TextRole::Selected } else { TextRole::Title };
                draw::put_text(
                    buf,
                    cell.title.x + 1,
                    cell.title.y,
                    cell.title.width,
                    &title,
                    theme.role_style(role),
                );
            }
            if let Some(beside) = cell.area.x.checked_sub(1).filter(|x| *x >= body.x) {
                for y in cell.title.top()..cell.area.bottom() {
                    let line = theme.glyph(Glyph::Vertical);
                    draw::put_text(buf, beside, y, 1, line, theme.role_style(TextRole::Border));
                }
            }
            if let Some(pane) = self.panes.get(cell.pane) {
                pane.render_pane(&self.core, cell.area, buf);
            }
        }
        self.core.theme = theme;
    }

    fn draw_tabs(&self, area: Rect, buf: &mut Buffer) {
        let mut x = area.x;
        for (pane, title) in pane_tabs(area.width) {
            let is_shown = pane == self.pane && !matches!(self.mode, InputMode::Help(_));
            let role = if is_shown { TextRole::Selected } else { TextRole::Title };
            let room = area.right().saturating_sub(x);
            x = draw::put_text(buf, x, area.y, room, &title, self.core.theme.role_style(role));
        }
    }

    fn draw_status(&self, area: Rect, buf: &mut Buffer) {
        let core = &self.core;
        let progress = core.timeline.progress();
        let total = progress.frames();
        let place = match core.cursor.frame {
            frame if frame > total => total,
            frame => frame,
        };
        let mut right = format!("#{place}/{total}");
        if !progress.is_complete() {
            let growing = if core.timeline.live().is_some() { "live" } else { "indexing" };
            right = format!("{growing}  {right}");
        }
        if let Some((first, last)) = core.selected_frames() {
            right = format!("selected #{first} to #{last}  {right}");
        }
        if core.is_following {
            right = format!("following  {right}");
        }
        if core.is_pending() {
            right = format!("state pending  {right}");
        }
        if let Some(matches) = core.timeline.search_matches().filter(|_| core.matcher.filter.is_some()) {
            let so_far = if matches.is_complete() { "" } else { " so far" };
            right = format!("{} shown{so_far}  {right}", count_noun(matches.match_count(), "event"));
        }
        let room = area.width.saturating_sub(draw::text_width(&right) + 2);
        let quiet = core.theme.role_style(TextRole::Quiet);
        let left = match &core.stated {
            Some((role, text)) => Line::styled(text.clone(), core.theme.role_style(*role)),
            // The end of a long command shows the changing part.
            None => Line::styled(draw::fit_tail(&self.view_command(), room, &core.theme), quiet),
        };
        draw::draw_line(buf, Rect { width: room, ..area }, &left, draw::TextAlignment::Left, &core.theme);
        draw::draw_line(buf, area, &Line::styled(right, quiet), draw::TextAlignment::Right, &core.theme);
    }

    fn draw_footer(&self, parts: &ScreenAreas, buf: &mut Buffer) {
        let theme = &self.core.theme;
        match &self.mode {
            InputMode::Prompt(asking, prompt) => {
                // The error of the prompt needs a second line, so the prompt uses the two bottom lines.
                let area = Rect { height: parts.status.height + parts.footer.height, ..parts.status };
                for y in area.top()..area.bottom() {
                    let blank = " ".repeat(usize::from(area.width));
                    draw::put_text(buf, area.x, y, area.width, &blank, theme.role_style(TextRole::Text));
                }
                prompt.render(theme, area, buf);
                if parts.body.height > LEAST_BODY {
                    let above = Rect { y: parts.body.bottom() - 1, height: 1, ..parts.body };
                    self.draw_prompt_row(*asking, above, buf);
                }
            }
            InputMode::Letter { is_new } => {
                let text = if *is_new { "set mark: type a letter" } else { "go to mark: type its letter" };
                draw::put_text(
                    buf,
                    parts.footer.x,
                    parts.footer.y,
                    parts.footer.width,
                    text,
                    theme.role_style(TextRole::Key),
                );
            }
            InputMode::Help(_) => {
                let hints = [KeyHint::new("j/k", "scroll"), KeyHint::new("any other key", "closes")];
                hints::draw_hints(theme, &hints, parts.footer, buf);
            }
            InputMode::Panes => {
                let actions = self.panes.get(self.pane).map_or(&[][..], |pane| pane.key_bar_actions());
                let hints = hints::of_pane(&self.keymap, actions, self.pane == PaneId::Why, theme);
                let gauge = if self.has_gauge(parts.footer) { GAUGE + 1 } else { 0 };
                let area = Rect { width: parts.footer.width.saturating_sub(gauge), ..parts.footer };
                hints::draw_hints(theme, &hints, area, buf);
                self.draw_progress(parts.footer, buf);
            }
        }
    }

    /// Whether the progress of the index is shown.
    fn has_gauge(&self, area: Rect) -> bool {
        let (_, is_all) = self.core.timeline.length();
        !self.core.timeline.progress().is_complete() && is_all && area.width >= GAUGE * 2
    }

    /// Draws the progress of the index on the right until it is complete.
    fn draw_progress(&self, area: Rect, buf: &mut Buffer) {
        if !self.has_gauge(area) {
            return;
        }
        let progress = self.core.timeline.progress();
        let (length, _) = self.core.timeline.length();
        let percent =
            u8::try_from(progress.bytes().saturating_mul(100) / length.max(1)).unwrap_or(100).min(100);
        let place = Rect { x: area.right() - GAUGE, width: GAUGE, ..area };
        Gauge::new(&self.core.theme, f64::from(percent) / 100.0, &format!("{percent} %")).render(place, buf);
    }
}
