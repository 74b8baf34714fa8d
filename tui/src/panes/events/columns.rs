//! Columns of the events: as wide as their longest value, and removed by need.
//!
//! ```text
//! 100 columns   No  Time  Δt  ID  Node  Kind  Event
//!  80 columns       Time          Node  Kind  Event
//!  30 columns       Time          Node        Event
//! ```

use cobscope_decoder::session::{Bus, Node};

use crate::panes::common;
use crate::state::UiState;
use crate::timeline::ReplayRow as EventRow;
use crate::widgets::draw;
use crate::widgets::table::{ColumnWidth, TableColumn};

/// Index of each column.
pub(super) const SEVERITY: usize = 0;
pub(super) const NUMBER: usize = 1;
pub(super) const TIME: usize = 2;
pub(super) const DELTA: usize = 3;
pub(super) const BUS: usize = 4;
pub(super) const ID: usize = 5;
pub(super) const NODE: usize = 6;
pub(super) const KIND: usize = 7;
pub(super) const OBJECT: usize = 8;
pub(super) const EVENT: usize = 9;
pub(super) const DATA: usize = 10;
pub(super) const COUNT: usize = 11;

/// Width of the event text up to which other columns are removed for it.
const WANTED_TEXT: u16 = 60;

/// Maximum widths of a node, and of an object up to a fifth of the pane.
const WIDEST_NODE: u16 = 20;
const WIDEST_OBJECT: u16 = 24;

/// Widths of all columns but the event; 0 for a column that is not needed.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
struct ColumnWidths {
    number: u16,
    time: u16,
    delta: u16,
    bus: u16,
    id: u16,
    node: u16,
    kind: u16,
    object: u16,
    data: u16,
}

impl ColumnWidths {
    /// Widths of the longest values known, and of those in the rows around the cursor.
    fn widths_for(core: &UiState, width: u16) -> Self {
        let longest = |least: u16, text: &dyn Fn(&EventRow) -> u16| {
            core.shown_rows().iter().map(text).fold(least, u16::max)
        };
        let world = common::last_world(core);
        let buses = world.iter().flat_map(|world| world.buses());
        let nodes = buses.flat_map(Bus::nodes);
        let name = |node: &Node| node.name().map_or(0, |name| draw::text_width(name).saturating_add(1));
        let node = nodes.map(|node| draw::text_width(&node.id().label()).saturating_add(name(node)));
        let node = node.fold(4, u16::max);
        let widest = if width < NARROW { NARROW_NODE } else { WIDEST_NODE.min(width / 4) };
        let digits = core.timeline.progress().frames().checked_ilog10().map_or(1, |digits| digits + 1);
        Self {
            number: u16::try_from(digits).unwrap_or(u16::MAX).max(2),
            time: common::time_width(core),
            delta: common::time_width(core).min(9),
            bus: common::bus_width(core, width),
            id: longest(3, &|row| row.id().map_or(0, |id| draw::text_width(&id.to_string()))),
            node: longest(node, &|row| draw::text_width(&row.who)).min(widest),
            kind: if width < KIND_FROM { 0 } else { longest(5, &|row| draw::text_width(row.kind)) },
            object: longest(6, &|row| draw::text_width(&row.object)).min(WIDEST_OBJECT.max(width / 5)),
            data: longest(4, &|row| draw::text_width(&row.data_text())),
        }
    }

    /// Width of the columns that are always shown, with the spaces after them.
    fn fixed_width(self) -> u16 {
        let shown = [1, self.time, self.bus, self.node, self.kind];
        shown.into_iter().filter(|width| *width > 0).map(|width| width.saturating_add(1)).sum()
    }
}

/// Width of the pane from which the kind is shown.
const KIND_FROM: u16 = 39;

/// Width of the pane below which a node has only room for its number, and the width of that number.
const NARROW: u16 = 48;
const NARROW_NODE: u16 = 6;

/// Columns for a table of `width`.
pub(super) fn event_columns(core: &UiState, width: u16) -> Vec<TableColumn> {
    let columns = arrange_columns(common::time_title(core), ColumnWidths::widths_for(core, width), width);
    common::chosen_columns(core, "events", all_columns(), columns)
}

/// All columns.
pub(super) fn all_columns() -> Vec<TableColumn> {
    arrange_columns("Time", ColumnWidths { bus: 4, kind: 5, ..ColumnWidths::default() }, 0)
}

fn arrange_columns(time: &'static str, widths: ColumnWidths, width: u16) -> Vec<TableColumn> {
    let event = width.saturating_sub(widths.fixed_width()).min(WANTED_TEXT.max(width / 2));
    vec![
        TableColumn::new("", ColumnWidth::Fixed(1)),
        TableColumn::new("No", ColumnWidth::Fixed(widths.number)).align_right().with_priority(4),
        TableColumn::new(time, ColumnWidth::Fixed(widths.time)).align_right(),
        TableColumn::new("Δt", ColumnWidth::Fixed(widths.delta)).align_right().with_priority(2),
        TableColumn::new(common::bus_title(widths.bus), ColumnWidth::Fixed(widths.bus)),
        TableColumn::new("ID", ColumnWidth::Fixed(widths.id)).with_priority(3),
        TableColumn::new("Node", ColumnWidth::Fixed(widths.node)),
        TableColumn::new("Kind", ColumnWidth::Fixed(widths.kind)),
        TableColumn::new("Object", ColumnWidth::Fixed(widths.object)).with_priority(1),
        TableColumn::new("Event", ColumnWidth::Min(event)),
        TableColumn::new("Data", ColumnWidth::Fixed(widths.data)).with_priority(0),
    ]
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::widgets::table::TableWidget;

    const WIDTHS: ColumnWidths =
        ColumnWidths { number: 3, time: 6, delta: 6, bus: 0, id: 3, node: 9, kind: 5, object: 24, data: 23 };

    /// Heads of the visible columns, and the width of the event.
    fn shown(widths: ColumnWidths, width: u16) -> (String, u16) {
        let columns = arrange_columns("Time", widths, width);
        let visible = (0..COUNT).filter(|column| TableWidget::width_of(&columns, *column, width) > 0);
        let heads: Vec<_> =
            visible.filter_map(|column| columns.get(column)).map(|column| &*column.title).collect();
        (heads.join(" ").trim().to_owned(), TableWidget::width_of(&columns, EVENT, width))
    }

    #[test]
    fn columns_are_removed_in_order() {
        let mut widths = WIDTHS;
        assert_eq!(shown(widths, 199), ("No Time Δt ID Node Kind Object Event Data".into(), 110));
        assert_eq!(shown(widths, 120), ("No Time Δt ID Node Kind Event".into(), 80));
        assert_eq!(shown(widths, 79), ("Time Node Kind Event".into(), 54));
        (widths.bus, widths.node) = (4, 9);
        assert_eq!(shown(widths, 79), ("Time Bus Node Kind Event".into(), 49));
        (widths.bus, widths.node, widths.kind) = (1, 7, 0);
        assert_eq!(shown(widths, 29), ("Time B Node Event".into(), 10));
    }
}
