//! Cells of times and node numbers.

use super::table::Cell;
use crate::frame::Timestamp;
use crate::wire::NodeId;

/// Conversion of a time to a cell.
pub(super) type TimeCell = fn(Option<Timestamp>) -> Cell<'static>;

/// Time in µs, rounded down.
pub(super) fn micros(time: Option<Timestamp>) -> Cell<'static> {
    time.map_or(Cell::Null, |Timestamp(time)| Cell::Number(time.div_euclid(1_000)))
}

/// Time in µs, rounded down; null for a time that counts from the start of a capture.
pub(super) fn micros_of_date(time: Option<Timestamp>) -> Cell<'static> {
    micros(time.filter(|time| time.has_date()))
}

/// Time in ns.
pub(super) fn nanos(time: Option<Timestamp>) -> Cell<'static> {
    time.map_or(Cell::Null, |Timestamp(time)| Cell::Number(time))
}

/// Node-ID or J1939 address.
pub(super) fn node_number(node: Option<NodeId>) -> Cell<'static> {
    small_number(node.map(NodeId::number))
}

/// A small number.
pub(super) fn small_number(number: Option<u8>) -> Cell<'static> {
    number.map_or(Cell::Null, |number| Cell::Number(i64::from(number)))
}
