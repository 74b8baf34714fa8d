//! State changed by the application and drawn by the panes: captures, cursor, filter, marks, theme.

mod clock;
mod core;
mod place;
mod positions;
mod search;

pub use clock::TimeDisplay;
pub use core::Core;
pub use place::{JumpPlace, NodeKey};
pub use search::{SearchPattern, pattern};
