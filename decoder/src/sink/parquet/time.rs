//! Cells of times and node numbers.

use super::table::RowCell;
use crate::frame::Timestamp;
use crate::wire::NodeId;

/// Conversion of a time to a cell.
pub(super) type TimeCell = fn(Option<Timestamp>) -> RowCell<'static>;

/// Time in µs, rounded down.
pub(super) fn micros_cell(time: Option<Timestamp>) -> RowCell<'static> {
    time.map_or(RowCell::Null, |Timestamp(time)| RowCell::Number(time.div_euclid(1_000)))
}

/// Time in µs, rounded down; null for a time that counts from the start of a capture.
pub(super) fn micros_of_date(time: Option<Timestamp>) -> RowCell<'static> {
    micros_cell(time.filter(|time| time.has_date()))
}

/// Time in ns.
pub(super) fn nanos_cell(time: Option<Timestamp>) -> RowCell<'static> {
    time.map_or(RowCell::Null, |Timestamp(time)| RowCell::Number(time))
}

/// Node-ID or J1939 address.
pub(super) fn node_number(node: Option<NodeId>) -> RowCell<'static> {
    small_number(node.map(NodeId::number))
}

/// A small number.
pub(super) fn small_number(number: Option<u8>) -> RowCell<'static> {
    number.map_or(RowCell::Null, |number| RowCell::Number(i64::from(number)))
}
