//! The terminal UI, apart from any terminal: keys and news go in, a screen comes out.
//!
//! ```text
//! key ─keymap─▶ Action ─update, pane─▶ Effect ─▶ Core (cursor, filter) ─order─▶ timeline ─News─▶ Core
//!                                                   └────────────view, panes──────────▶ screen
//! ```

mod application;
mod ask;
mod header;
mod news;
mod output;
mod start;
mod update;
mod view;

pub use application::App;
pub use output::Output;
pub use start::{Start, quoted};
