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
mod assignable;
mod candidates;
mod columns;
mod diagnosis;
mod header;
mod help;
mod hints;
mod history;
mod news;
mod output;
mod panes;
mod preferences;
mod prompt_row;
mod report;
mod requests;
mod shell;
mod start;
mod strip;
mod undo;
mod update;
mod view;

pub use added::{AddedOption, Reassign, ReassignedOptions};
pub use application::App;
pub use output::TerminalRequest;
pub use preferences::Preferences;
pub use requests::{Compare, ReportRequest, WriteReport};
pub use shell::quote_word;
pub use start::ViewSettings;
