//! Columns of the node table and its sort orders.

use crate::panes::Sorting;
use crate::widgets::table::{ColumnWidth, TableColumn};

/// Index of `Eff`.
pub(super) const EFFECT: usize = 6;
/// Index of `Errors`.
pub(super) const ERRORS: usize = 8;
/// Index of `Set → actual`.
pub(super) const VALUES: usize = 5;
/// Minimum width of the set points before other columns are dropped.
pub(super) const LEAST_VALUES: u16 = 19;
/// Width from which the wide columns are used.
pub(super) const WIDE: u16 = 124;
/// Width below which the narrow columns are used.
pub(super) const NARROW: u16 = 96;

/// Sort order of the rows.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub(super) enum NodeOrder {
    /// By node-ID, the master first.
    #[default]
    Number,
    /// Errors, no effect, silent, others.
    Worst,
    /// By name.
    Name,
    /// By device.
    Device,
}

impl NodeOrder {
    pub(super) const fn next(self) -> Self {
        match self {
            Self::Number => Self::Worst,
            Self::Worst => Self::Name,
            Self::Name => Self::Device,
            Self::Device => Self::Number,
        }
    }

    /// Column with the sort mark, and whether it is descending.
    pub(super) const fn sorted_column(self) -> Sorting {
        match self {
            Self::Number => None,
            Self::Worst => Some((ERRORS, true)),
            Self::Name => Some((1, false)),
            Self::Device => Some((2, false)),
        }
    }

    /// The order with this sort mark.
    pub(super) fn of_column(column: Sorting) -> Self {
        let orders = [Self::Worst, Self::Name, Self::Device];
        orders.into_iter().find(|order| order.sorted_column() == column).unwrap_or_default()
    }

    pub(super) const fn order_text(self) -> &'static str {
        match self {
            Self::Number => "sorted by number",
            Self::Worst => "sorted worst first: errors, no effect, silent, others",
            Self::Name => "sorted by name",
            Self::Device => "sorted by device",
        }
    }
}

pub(super) fn node_columns(width: u16) -> Vec<TableColumn> {
    let wide = |narrow, normal, wide| {
        ColumnWidth::Fixed(match width {
            ..NARROW => narrow,
            WIDE.. => wide,
            _ => normal,
        })
    };
    vec![
        TableColumn::new("ID/hex", ColumnWidth::Fixed(6)).align_right(),
        TableColumn::new("Name", wide(8, 8, 14)).with_priority(8),
        TableColumn::new("Device", wide(7, 7, 10)).with_priority(1),
        TableColumn::new("NMT", ColumnWidth::Fixed(6)).with_priority(6),
        TableColumn::new("State", wide(12, 16, 22)),
        TableColumn::new("Set → actual", ColumnWidth::Min(LEAST_VALUES)),
        TableColumn::new("Eff", ColumnWidth::Fixed(3)),
        TableColumn::new("Alive", ColumnWidth::Fixed(10)),
        TableColumn::new("Errors", wide(8, 9, 22)),
    ]
}
