//! Shared parts of the subcommands: options, input, output, messages, captures, printed events.

pub mod arguments;
pub mod capture_answers;
pub mod capture_job;
pub mod captures;
pub mod cut;
pub mod describe;
pub mod frame_comment;
pub mod input;
#[cfg(feature = "parquet")]
pub mod lake_index;
pub mod messages;
pub mod output;
pub mod print;
pub mod remarks;
pub mod replaced;
pub mod screen;
pub mod selected_facts;
pub mod selected_findings;
