//! Behaviour of the program as seen by its user.
#![expect(clippy::unwrap_used, reason = "a test that cannot go on has failed")]

mod actions;
mod adapters;
mod baseline;
mod bus_file;
mod changed;
mod check;
mod check_schema;
mod cli;
mod columns;
mod convert;
mod cross_checks;
mod dbc;
mod diff;
mod docs;
mod eds;
mod embedded;
mod explain;
mod exports;
mod extcap;
mod faults;
mod filter;
mod inputs;
mod journeys;
#[cfg(feature = "parquet")]
mod lake;
mod live;
mod mcp;
mod objects;
mod output;
#[cfg(unix)]
mod page;
mod panes;
mod profiles;
mod readme;
mod report;
mod reports;
mod schema;
mod screens;
mod select;
mod series;
mod stats;
#[path = "../support/mod.rs"]
mod support;
mod terminal;
mod tidy;
mod traces;
mod triggers;
mod verdicts;
mod whole_files;
mod why;
