//! Common parts of text captures: lines, fields, payload and printing.

pub(super) mod bus_labels;
pub(super) mod columns;
pub(super) mod day;
pub(super) mod evidence;
pub(super) mod line_format;
pub(super) mod lines;
pub(super) mod payload;
pub(super) mod print;
pub(super) mod stamp;
