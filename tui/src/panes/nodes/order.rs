//! Columns of the node table and its sort orders.

use crate::panes::Sorting;
use crate::widgets::table::{Column, Width};

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
pub(super) enum Order {
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

impl Order {
    pub(super) const fn next(self) -> Self {
        match self {
            Self::Number => Self::Worst,
            Self::Worst => Self::Name,
            Self::Name => Self::Device,
            Self::Device => Self::Number,
        }
    }

    /// Column with the sort mark, and whether it is descending.
    pub(super) const fn column(self) -> Sorting {
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
        orders.into_iter().find(|order| order.column() == column).unwrap_or_default()
    }

    pub(super) const fn words(self) -> &'static str {
        match self {
            Self::Number => "sorted by number",
            Self::Worst => "sorted worst first: errors, no effect, silent, others",
            Self::Name => "sorted by name",
            Self::Device => "sorted by device",
        }
    }
}

pub(super) fn columns(width: u16) -> Vec<Column> {
    let wide = |narrow, normal, wide| {
        Width::Fixed(match width {
            ..NARROW => narrow,
            WIDE.. => wide,
            _ => normal,
        })
    };
    vec![
        Column::new("ID/hex", Width::Fixed(6)).right(),
        Column::new("Name", wide(8, 8, 14)).priority(8),
        Column::new("Device", wide(7, 7, 10)).priority(1),
        Column::new("NMT", Width::Fixed(6)).priority(6),
        Column::new("State", wide(12, 16, 22)),
        Column::new("Set → actual", Width::Min(LEAST_VALUES)),
        Column::new("Eff", Width::Fixed(3)),
        Column::new("Alive", Width::Fixed(10)),
        Column::new("Errors", wide(8, 9, 22)),
    ]
}
