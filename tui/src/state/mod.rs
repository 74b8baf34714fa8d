//! State that the application changes and the panes draw: captures, cursor, filter, marks, theme.

mod core;
mod place;
mod search;

pub use core::Core;
pub use place::{NodeKey, Place};
pub use search::{Sought, pattern};
