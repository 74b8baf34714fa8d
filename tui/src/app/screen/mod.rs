//! Lines around the panes: header, diagnosis, strip of time, key bar.

mod areas;
mod diagnosis;
mod header;
mod hints;
mod strip;

pub(super) use areas::{ScreenAreas, divide_screen};
pub(super) use diagnosis::draw_diagnosis;
pub(super) use header::draw_header;
pub(super) use hints::{KeyHint, draw_hints, of_pane};
pub(super) use strip::{draw_strip, time_at};
