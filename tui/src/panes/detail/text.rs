//! Drawing of the items, and the item at a screen position.

use ratatui::buffer::Buffer;
use ratatui::layout::Rect;
use ratatui::text::Line;

use super::item::DetailItem;
use super::{DetailContent, DetailPane};
use crate::state::UiState;
use crate::widgets::text_lines::TextLines;

impl DetailPane {
    /// Lines of all items, and the index of the first line of each.
    fn item_lines(
        &self,
        core: &UiState,
        reported: &DetailContent<'_>,
        width: u16,
    ) -> (Vec<Line<'static>>, Vec<usize>) {
        let selected = self.selected_item(reported);
        let (mut lines, mut starts, mut at) = (Vec::new(), Vec::new(), 0);
        for (index, item) in reported.items.iter().enumerate() {
            starts.push(at);
            let more = item.styled_lines(&core.theme, index == selected);
            at += TextLines::new(&core.theme, &more).line_count(width);
            lines.extend(more);
        }
        starts.push(at);
        (lines, starts)
    }

    /// First visible line: the selected item is in the upper third and completely visible.
    fn first_visible(&self, reported: &DetailContent<'_>, starts: &[usize], height: usize) -> usize {
        let selected = self.selected_item(reported);
        let start = starts.get(selected).copied().unwrap_or(0);
        let end = starts.get(selected + 1).copied().unwrap_or(start + 1);
        start.saturating_sub(height / 3).max(end.saturating_sub(height)).min(start)
    }

    pub(super) fn draw_text(
        &self,
        core: &UiState,
        reported: &DetailContent<'_>,
        area: Rect,
        buf: &mut Buffer,
    ) {
        let (lines, starts) = self.item_lines(core, reported, area.width.saturating_sub(1));
        let scroll = self.first_visible(reported, &starts, usize::from(area.height));
        TextLines::new(&core.theme, &lines).with_scroll(scroll).render(area, buf);
    }

    /// The item at a screen position.
    pub(super) fn item_at(
        &self,
        core: &UiState,
        reported: &DetailContent<'_>,
        area: Rect,
        x: u16,
        y: u16,
    ) -> Option<usize> {
        let is_inside = area.contains(ratatui::layout::Position::new(x, y));
        let (lines, starts) = self.item_lines(core, reported, area.width.saturating_sub(1));
        let last = TextLines::new(&core.theme, &lines).last_scroll(area);
        let scroll = self.first_visible(reported, &starts, usize::from(area.height)).min(last);
        let line = scroll + usize::from(y.saturating_sub(area.y));
        let at = starts.partition_point(|start| *start <= line).checked_sub(1)?;
        let is_item = reported.items.get(at).is_some_and(DetailItem::can_be_selected);
        (is_inside && is_item).then_some(at)
    }
}
