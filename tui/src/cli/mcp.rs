//! `cobscope mcp`.

use std::path::PathBuf;

use clap::Args;

/// `cobscope mcp`.
#[derive(Debug, Args)]
pub struct McpArgs {
    /// Folder whose files may be read, with its subfolders (repeatable)
    #[arg(value_name = "DIR", required = true)]
    pub folders: Vec<PathBuf>,
    /// Add a folder with profiles and device files (repeatable)
    #[arg(long, value_name = "DIR")]
    pub profiles: Vec<PathBuf>,
}
