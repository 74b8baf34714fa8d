//! `cobscope rules`.

use std::path::PathBuf;

use clap::{Args, ValueEnum};

/// `cobscope rules`.
#[derive(Debug, Args)]
pub struct RulesArgs {
    /// Output format
    #[arg(short, long, value_name = "FORMAT", default_value = "text")]
    pub format: RulesFormat,
    /// Add a folder with profiles, whose rules are also listed (repeatable)
    #[arg(long, value_name = "DIR")]
    pub profiles: Vec<PathBuf>,
}

/// Formats of the rule list.
#[derive(Debug, Clone, Copy, PartialEq, Eq, ValueEnum)]
pub enum RulesFormat {
    /// A table
    Text,
    /// One JSON array with all properties of each rule
    Json,
    /// Headings and text for a document
    Markdown,
}
