//! What text captures have in common: lines, their fields, and how they are printed.

pub(super) mod columns;
pub(super) mod line_format;
pub(super) mod lines;
pub(super) mod payload;
pub(super) mod print;
