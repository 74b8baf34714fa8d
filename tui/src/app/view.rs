//! Drawing of the screen.
//!
//! ```text
//! can0 250k  load 3.4 % (1 s)  errframes 0 …  FINDINGS 2 err 3 warn          t 412.306 s     header
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
use super::help::draw_help;
use super::screen::{
    KeyHint, ScreenAreas, divide_screen, draw_diagnosis, draw_header, draw_hints, draw_strip, of_pane,
};
use crate::ascii;
use crate::panes::PaneId;
use crate::state::UiState;
use crate::theme::{LineCharacters, TextRole};
use crate::widgets::bars::Gauge;
use crate::widgets::draw;

/// Width of the progress bar of the index.
const GAUGE: u16 = 20;

/// Height of the pane up to which its last line is not used for the row above a prompt.
const LEAST_BODY: u16 = 3;

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
        let parts = divide_screen(area, self.panes.has_strip);
        draw_header(&self.core, parts.header, buf);
        self.draw_tabs(parts.tabs, buf);
        draw_diagnosis(&self.core, parts.diagnosis, buf);
        draw_strip(&self.core, parts.strip, buf);
        match &self.mode {
            InputMode::Help(scroll) => {
                draw_help(&self.core.theme, (&self.panes, &self.keymap), *scroll, parts.body, buf);
            }
            _ => self.panes.draw_panes(&mut self.core, parts.body, buf),
        }
        self.draw_status(parts.status, buf);
        self.draw_footer(&parts, buf);
        if self.core.theme.borders() == LineCharacters::Ascii {
            // All text ends here, also that of captures.
            ascii::replace_symbols(buf);
        }
    }

    fn draw_tabs(&self, area: Rect, buf: &mut Buffer) {
        let mut x = area.x;
        for (pane, title) in pane_tabs(area.width) {
            let is_shown = pane == self.panes.focus && !matches!(self.mode, InputMode::Help(_));
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
                    self.prompt_row.draw_row(&self.core, *asking, above, buf);
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
                draw_hints(theme, &hints, parts.footer, buf);
            }
            InputMode::Panes => {
                let actions = self.panes.focused_pane().map_or(&[][..], |pane| pane.key_bar_actions());
                let hints = of_pane(&self.keymap, actions, self.panes.focus == PaneId::Why, theme);
                let gauge = if has_gauge(&self.core, parts.footer) { GAUGE + 1 } else { 0 };
                let area = Rect { width: parts.footer.width.saturating_sub(gauge), ..parts.footer };
                draw_hints(theme, &hints, area, buf);
                draw_progress(&self.core, parts.footer, buf);
            }
        }
    }
}

/// Whether the progress of the index is shown.
fn has_gauge(core: &UiState, area: Rect) -> bool {
    let (_, is_all) = core.timeline.length();
    !core.timeline.progress().is_complete() && is_all && area.width >= GAUGE * 2
}

/// Draws the progress of the index on the right until it is complete.
fn draw_progress(core: &UiState, area: Rect, buf: &mut Buffer) {
    if !has_gauge(core, area) {
        return;
    }
    let progress = core.timeline.progress();
    let (length, _) = core.timeline.length();
    let percent = u8::try_from(progress.bytes().saturating_mul(100) / length.max(1)).unwrap_or(100).min(100);
    let place = Rect { x: area.right() - GAUGE, width: GAUGE, ..area };
    Gauge::new(&core.theme, f64::from(percent) / 100.0, &format!("{percent} %")).render(place, buf);
}
