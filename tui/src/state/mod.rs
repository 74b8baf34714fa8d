//! State changed by the application and drawn by the panes: captures, cursor, filter, marks, theme.

mod against;
mod clock;
mod core;
mod place;
mod positions;
mod search;

pub use against::{CaptureDifferences, DIFFERS, OtherCapture, both_values, other_value};
pub use clock::TimeDisplay;
pub use core::UiState;
pub use place::{JumpPlace, NodeKey};
pub use search::SearchPattern;
