//! The UI without a terminal: it takes keys and messages and draws a screen.
//!
//! ```text
//! key ─keymap─▶ Action ─update, pane─▶ Effect ─▶ Core (cursor, filter) ─order─▶ timeline ─News─▶ Core
//!                                                   └────────────view, panes──────────▶ screen
//! ```

mod application;
mod ask;
mod candidates;
mod assign;
mod diagnosis;
mod header;
mod hints;
mod help;
mod news;
mod output;
mod start;
mod undo;
mod update;
mod view;

pub use application::App;
pub use output::Output;
pub use start::{Start, quoted};
