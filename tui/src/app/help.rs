//! The help screen: legend of the current pane, and all keys.

use ratatui::buffer::Buffer;
use ratatui::layout::Rect;
use ratatui::text::{Line, Span};

use super::shown_panes::ShownPanes;
use crate::keymap::{HelpGroup, Keymap, default_bindings};
use crate::panes::{COMMON, LegendEntry};
use crate::theme::{TextRole, Theme};
use crate::widgets::draw;
use crate::widgets::text_lines::TextLines;

/// Width from which legend and keys are next to each other.
const WIDE: u16 = 170;

/// Width of marks and keys.
const MARK: usize = 16;

/// Draws the legend of the focused pane and the keys: next to each other in a wide terminal, else the keys below the
/// legend.
pub(super) fn draw_help(
    theme: &Theme,
    (panes, keymap): (&ShownPanes, &Keymap),
    scroll: usize,
    area: Rect,
    buf: &mut Buffer,
) {
    let mut legend = legend_lines(theme, panes);
    let keys = key_lines(theme, keymap);
    if area.width >= WIDE {
        let left = Rect { width: area.width / 2, ..area };
        let right = Rect { x: left.right(), width: area.width - left.width, ..area };
        TextLines::new(theme, &legend).with_scroll(scroll).render(left, buf);
        TextLines::new(theme, &keys).with_scroll(scroll).render(right, buf);
    } else {
        legend.extend(keys);
        TextLines::new(theme, &legend).with_scroll(scroll).render(area, buf);
    }
}

/// Legend of the focused pane, and marks of all panes.
fn legend_lines(theme: &Theme, panes: &ShownPanes) -> Vec<Line<'static>> {
    let Some(pane) = panes.focused_pane() else { return Vec::new() };
    let legend = pane.pane_legend();
    let title = format!("{}: {}", panes.focus.title(), legend.purpose);
    let mut lines = vec![Line::styled(title, theme.role_style(TextRole::Title))];
    lines.extend(legend.columns.iter().chain(legend.marks).map(|entry| entry_line(theme, entry)));
    lines.push(Line::default());
    lines.push(Line::styled("All panes", theme.role_style(TextRole::Title)));
    lines.extend(COMMON.iter().map(|entry| entry_line(theme, entry)));
    lines.push(Line::default());
    lines
}

/// All keys by group, from the keymap.
fn key_lines(theme: &Theme, keymap: &Keymap) -> Vec<Line<'static>> {
    let mut lines = Vec::new();
    for group in HelpGroup::ALL {
        lines.push(Line::styled(group.title(), theme.role_style(TextRole::Title)));
        for binding in default_bindings().filter(|binding| binding.group == group) {
            lines.push(mark_line(
                theme,
                &keymap.keys_for(binding.action).join(" "),
                TextRole::Key,
                binding.help.to_owned(),
            ));
        }
        lines.push(Line::default());
    }
    lines
}

fn entry_line(theme: &Theme, entry: &LegendEntry) -> Line<'static> {
    mark_line(theme, entry.mark, entry.role, entry.meaning.to_owned())
}

/// A mark in its style, and its meaning in a second column.
fn mark_line(theme: &Theme, mark: &str, role: TextRole, meaning: String) -> Line<'static> {
    let blank = MARK.saturating_sub(usize::from(draw::text_width(mark))) + 1;
    Line::from(vec![
        Span::raw("  "),
        Span::styled(mark.to_owned(), theme.role_style(role)),
        Span::raw(" ".repeat(blank)),
        Span::styled(meaning, theme.role_style(TextRole::Text)),
    ])
}
