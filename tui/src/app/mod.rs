//! The UI without a terminal: it takes keys and messages and draws a screen.
//!
//! ```text
//! key ─keymap─▶ Action ─update, pane─▶ Effect ─▶ Core (cursor, filter) ─order─▶ timeline ─News─▶ Core
//!                                                   └────────────view, panes──────────▶ screen
//! ```

mod added;
mod application;
mod ask;
mod assign;
mod candidates;
mod columns;
mod help;
mod history;
mod jumps;
mod preferences;
mod prompt_row;
mod report;
mod requests;
mod screen;
mod shown_panes;
mod start;
mod undo;
mod update;
mod view;

pub use added::{AddedOption, Reassign, ReassignedOptions, quote_word};
pub use application::App;
pub use preferences::Preferences;
pub use requests::{Compare, ReportRequest, TerminalRequest, WriteReport};
pub use start::ViewSettings;
