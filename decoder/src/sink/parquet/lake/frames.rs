//! Rows of the table of frames.

use std::io;

use crate::frame::{CanId, Frame, FrameFlags};
use crate::sink::parquet::table::{Cell, Heading, Kind, always, maybe};
use crate::sink::parquet::time::{micros_of_date, nanos};

/// Columns of the table of frames.
pub(super) const HEADINGS: &[Heading] = &[
    maybe("time", Kind::Time),
    maybe("time_ns", Kind::Rising),
    always("capture", Kind::Name),
    always("bus", Kind::Name),
    always("frame", Kind::Rising),
    always("id", Kind::Number),
    always("extended", Kind::Truth),
    always("remote", Kind::Truth),
    always("error", Kind::Truth),
    always("fd", Kind::Truth),
    always("length", Kind::Number),
    always("data", Kind::Name),
];

/// Passes the row of a frame to `push`.
///
/// # Errors
/// If the row cannot be written.
pub(super) fn row(
    frame: &Frame,
    (capture, bus): (&str, &str),
    push: &mut dyn FnMut(&[Cell<'_>]) -> io::Result<()>,
) -> io::Result<()> {
    let mut data = Vec::new();
    crate::ascii::push_hex(&mut data, frame.data());
    let has = |flag| Cell::Truth(frame.flags.contains(flag));
    push(&[
        micros_of_date(frame.time),
        nanos(frame.time),
        Cell::Text(capture),
        Cell::Text(bus),
        Cell::Number(frame.number.cast_signed()),
        Cell::Number(frame.id.number().into()),
        Cell::Truth(matches!(frame.id, CanId::Extended(_))),
        has(FrameFlags::REMOTE),
        has(FrameFlags::ERROR),
        has(FrameFlags::FD),
        Cell::Number(frame.data().len().cast_signed() as i64),
        Cell::Text(&String::from_utf8_lossy(&data)),
    ])
}
