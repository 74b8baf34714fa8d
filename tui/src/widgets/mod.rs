//! Parts of the screen that know nothing of CAN: they draw what they are given into an area.
//!
//! All are drawn from `&`, hold no clock and stay inside the area they are given, whatever its size.

pub mod bars;
pub mod bits;
pub mod draw;
pub mod plot;
pub mod prompt;
pub mod table;
pub mod text_lines;
