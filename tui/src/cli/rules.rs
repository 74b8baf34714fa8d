//! `cobscope rules`.

use std::path::PathBuf;

use clap::{Args, ValueEnum};

/// `cobscope rules`.
#[derive(Debug, Args)]
pub struct RulesArgs {
    /// Output format
    #[arg(short, long, value_name = "FORMAT", default_value = "text")]
    pub format: RulesFormat,
    /// Folder with profiles of your own, whose rules are listed too (repeatable)
    #[arg(long, value_name = "DIR")]
    pub profiles: Vec<PathBuf>,
}

/// Formats of the list of rules.
#[derive(Debug, Clone, Copy, PartialEq, Eq, ValueEnum)]
pub enum RulesFormat {
    /// A table
    Text,
    /// One JSON array, with everything known of each rule
    Json,
    /// The same for a document
    Markdown,
}
