//! Rows of the table of frames.

use std::io;

use crate::frame::{CanId, Frame, FrameFlags};
use crate::sink::parquet::table::{ColumnHeading, ColumnType, RowCell, optional_column, required_column};
use crate::sink::parquet::time::{micros_of_date, nanos_cell};

/// Columns of the table of frames.
pub(super) const HEADINGS: &[ColumnHeading] = &[
    optional_column("time", ColumnType::Time),
    optional_column("time_ns", ColumnType::Rising),
    required_column("capture", ColumnType::Name),
    required_column("bus", ColumnType::Name),
    required_column("frame", ColumnType::Rising),
    required_column("id", ColumnType::Number),
    required_column("extended", ColumnType::Truth),
    required_column("remote", ColumnType::Truth),
    required_column("error", ColumnType::Truth),
    required_column("fd", ColumnType::Truth),
    required_column("length", ColumnType::Number),
    required_column("data", ColumnType::Name),
];

/// Passes the row of a frame to `push`.
///
/// # Errors
/// If the row cannot be written.
pub(super) fn push_row(
    frame: &Frame,
    (capture, bus): (&str, &str),
    push: &mut dyn FnMut(&[RowCell<'_>]) -> io::Result<()>,
) -> io::Result<()> {
    let mut data = Vec::new();
    crate::ascii::push_hex(&mut data, frame.data());
    let has = |flag| RowCell::Truth(frame.flags.contains(flag));
    push(&[
        micros_of_date(frame.time),
        nanos_cell(frame.time),
        RowCell::Text(capture),
        RowCell::Text(bus),
        RowCell::Number(frame.number.cast_signed()),
        RowCell::Number(frame.id.number().into()),
        RowCell::Truth(matches!(frame.id, CanId::Extended(_))),
        has(FrameFlags::REMOTE),
        has(FrameFlags::ERROR),
        has(FrameFlags::FD),
        RowCell::Number(frame.data().len().cast_signed() as i64),
        RowCell::Text(&String::from_utf8_lossy(&data)),
    ])
}
