//! Widgets without knowledge of CAN. They draw their arguments into an area.
//!
//! All draw from `&self`, hold no clock and stay inside their area, whatever its size.

pub mod bars;
pub mod bits;
pub mod draw;
pub mod fit;
pub mod plot;
pub mod prompt;
pub mod table;
pub mod text_lines;
