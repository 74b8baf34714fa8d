//! Drawing of the screen.
//!
//! ```text
//! can0 250k  load 34 %  errframes 0 …  FINDINGS 2 err 3 warn          t 412.306 s     header
//! 0 Why  1 Nodes  2 Events  3 Frames …                                                 panes
//! 2 errors 3 warnings: 32/20 EMCY 8305 spool position error, 7.204 s  ] finding  0 why diagnosis
//! ┌─────────────────────────────────────────────────────────────────────────────────┐
//! │ the pane                                                                        │
//! └─────────────────────────────────────────────────────────────────────────────────┘
//! cobscope view a.log --pane events --at '#1842'                         #1842/9950    command for this view
//! enter open  f filter  ] finding  ? help  q quit                                      key bar or prompt
//! ```

use cobscope_decoder::words::plural;
use ratatui::buffer::Buffer;
use ratatui::layout::Rect;
use ratatui::text::{Line, Span};

use super::application::{App, Mode};
use super::{diagnosis, header};
use crate::ascii;
use crate::keymap;
use crate::panes::PaneId;
use crate::theme::{Borders, Role};
use crate::widgets::bars::Gauge;
use crate::widgets::draw;

/// Width of the progress bar of the index.
const GAUGE: u16 = 20;

/// Height of the pane up to which its last line is not used for the row above a prompt.
const LEAST_BODY: u16 = 3;

/// Height from which the line of the diagnosis is shown.
const LOW: u16 = 10;

/// Areas of the screen.
pub(super) struct Parts {
    pub(super) header: Rect,
    pub(super) tabs: Rect,
    /// One line of the diagnosis; empty on low screens.
    pub(super) diagnosis: Rect,
    pub(super) body: Rect,
    pub(super) status: Rect,
    pub(super) footer: Rect,
}

/// Divides the screen.
pub(super) fn parts(area: Rect) -> Parts {
    let line = |y: u16| Rect { y: area.y + y.min(area.height), height: u16::from(y < area.height), ..area };
    let below = |from_end: u16| line(area.height.saturating_sub(from_end));
    let diagnosis = u16::from(area.height >= LOW);
    let above = 2 + diagnosis;
    Parts {
        header: line(0),
        tabs: line(1),
        diagnosis: if diagnosis > 0 { line(2) } else { Rect::ZERO },
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
fn tabs(width: u16) -> Vec<(PaneId, String)> {
    let all = |is_wide: bool| {
        let title = move |pane: &PaneId| match (*pane as usize, is_wide) {
            (number, true) => format!(" {number} {} ", pane.title()),
            (number, false) => format!("{number}{} ", pane.title()),
        };
        PaneId::ALL.iter().map(|pane| (*pane, title(pane))).collect::<Vec<_>>()
    };
    let wide = all(true);
    let fits = wide.iter().map(|(_, title)| draw::width(title)).sum::<u16>() <= width;
    if fits { wide } else { all(false) }
}

/// The pane whose title is at a screen column.
pub(super) fn tab_at(x: u16, width: u16) -> Option<PaneId> {
    let mut end = 0;
    let mut tabs = tabs(width).into_iter();
    tabs.find(|(_, title)| {
        end += draw::width(title);
        x < end
    })
    .map(|(pane, _)| pane)
}

impl App {
    /// Draws the screen.
    pub fn draw(&self, area: Rect, buf: &mut Buffer) {
        let parts = parts(area);
        header::draw(&self.core, parts.header, buf);
        self.draw_tabs(parts.tabs, buf);
        diagnosis::draw(&self.core, parts.diagnosis, buf);
        match &self.mode {
            Mode::Help(scroll) => self.draw_help(*scroll, parts.body, buf),
            _ => {
                if let Some(pane) = self.panes.get(self.pane) {
                    pane.render(&self.core, parts.body, buf);
                }
            }
        }
        self.draw_status(parts.status, buf);
        self.draw_footer(&parts, buf);
        if self.core.theme.borders() == Borders::Ascii {
            // All text ends here, also that of captures.
            ascii::replace(buf);
        }
    }

    fn draw_tabs(&self, area: Rect, buf: &mut Buffer) {
        let mut x = area.x;
        for (pane, title) in tabs(area.width) {
            let is_shown = pane == self.pane && !matches!(self.mode, Mode::Help(_));
            let role = if is_shown { Role::Selected } else { Role::Title };
            let room = area.right().saturating_sub(x);
            x = draw::put(buf, x, area.y, room, &title, self.core.theme.style(role));
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
        if let Some(matches) = core.timeline.matches().filter(|_| core.matcher.filter.is_some()) {
            let so_far = if matches.is_complete() { "" } else { " so far" };
            right = format!("{} shown{so_far}  {right}", plural(matches.count(), "event"));
        }
        let room = area.width.saturating_sub(draw::width(&right) + 2);
        let quiet = core.theme.style(Role::Quiet);
        let left = match &core.said {
            Some((role, text)) => Line::styled(text.clone(), core.theme.style(*role)),
            // The end of a long command shows the changing part.
            None => Line::styled(draw::tail(&self.command(), room, &core.theme), quiet),
        };
        draw::line(buf, Rect { width: room, ..area }, &left, draw::Align::Left, &core.theme);
        draw::line(buf, area, &Line::styled(right, quiet), draw::Align::Right, &core.theme);
    }

    fn draw_footer(&self, parts: &Parts, buf: &mut Buffer) {
        let theme = &self.core.theme;
        match &self.mode {
            Mode::Prompt(asking, prompt) => {
                // The error of the prompt needs a second line, so the prompt uses the two bottom lines.
                let area = Rect { height: parts.status.height + parts.footer.height, ..parts.status };
                for y in area.top()..area.bottom() {
                    let blank = " ".repeat(usize::from(area.width));
                    draw::put(buf, area.x, y, area.width, &blank, theme.style(Role::Text));
                }
                prompt.render(theme, area, buf);
                if parts.body.height > LEAST_BODY {
                    let above = Rect { y: parts.body.bottom() - 1, height: 1, ..parts.body };
                    self.draw_hint(*asking, above, buf);
                }
            }
            Mode::Letter { is_new } => {
                let text = if *is_new { "set mark: type a letter" } else { "go to mark: type its letter" };
                draw::put(
                    buf,
                    parts.footer.x,
                    parts.footer.y,
                    parts.footer.width,
                    text,
                    theme.style(Role::Key),
                );
            }
            Mode::Help(_) => self.draw_keys(&["j/k scroll", "any other key closes"], parts.footer, buf),
            Mode::Panes => {
                let actions = self.panes.get(self.pane).map_or(&[][..], |pane| pane.actions());
                let shown = actions.iter().filter_map(|action| keymap::binding(*action));
                let keys: Vec<String> = shown
                    .map(|binding| format!("{} {}", binding.keys.first().unwrap_or(&""), binding.short))
                    .collect();
                let keys: Vec<&str> =
                    ["? help", "q quit"].into_iter().chain(keys.iter().map(String::as_str)).collect();
                self.draw_keys(&keys, parts.footer, buf);
                self.draw_progress(parts.footer, buf);
            }
        }
    }

    /// Draws the progress of the index on the right until it is complete.
    fn draw_progress(&self, area: Rect, buf: &mut Buffer) {
        let progress = self.core.timeline.progress();
        let (length, is_all) = self.core.timeline.length();
        if progress.is_complete() || !is_all || area.width < GAUGE * 2 {
            return;
        }
        let percent =
            u8::try_from(progress.bytes().saturating_mul(100) / length.max(1)).unwrap_or(100).min(100);
        let place = Rect { x: area.right() - GAUGE, width: GAUGE, ..area };
        Gauge::new(&self.core.theme, f64::from(percent) / 100.0, &format!("{percent} %")).render(place, buf);
    }

    /// Draws the key bar: `f filter  ] finding`.
    fn draw_keys(&self, keys: &[&str], area: Rect, buf: &mut Buffer) {
        let theme = &self.core.theme;
        let mut spans = Vec::new();
        for key in keys {
            let (name, does) = key.split_once(' ').unwrap_or((key, ""));
            spans.push(Span::styled(name.to_owned(), theme.style(Role::Key)));
            spans.push(Span::styled(format!(" {does}  "), theme.style(Role::Quiet)));
        }
        draw::line(buf, area, &Line::from(spans), draw::Align::Left, theme);
    }
}
