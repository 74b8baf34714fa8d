//! Answers to questions about a whole capture: typed, and serialized with the keys of the command line for every front end.
//!
//! The descriptions of a schema in `docs/*.schema.json` are the doc comments of these types. Fields are declared in the order
//! in which they are printed.

pub mod comparison;
pub mod events;
pub mod findings;
pub mod identifiers;
pub mod nodes;
mod numbers;
pub mod objects;
pub mod overview;
pub mod signals;
pub mod statistics;
pub mod stories;
pub mod transfers;

use serde::Serialize;

use crate::sink::escape_json;
pub use events::EventObject;
pub use numbers::seconds_after;

/// An answer as one JSON object in one line, without characters that control a terminal, and its line end.
pub fn format_line(answer: &impl Serialize) -> String {
    // The keys of all maps are strings, the only reason for which an answer could not be serialized.
    let json = serde_json::to_string(answer).unwrap_or_default();
    let mut line = escape_json(&json).into_owned();
    line.push('\n');
    line
}
