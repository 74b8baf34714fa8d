//! Parts of the screen that know nothing of CAN: they draw what they are given into an area.
//!
//! All are drawn from `&`, hold no clock and stay inside the area they are given, whatever its size.

pub(crate) mod bits;
pub(crate) mod draw;
pub(crate) mod prompt;
pub(crate) mod table;
pub(crate) mod text_lines;
