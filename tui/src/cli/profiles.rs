//! `cobscope profiles`.

use std::path::PathBuf;

use clap::{Subcommand, ValueEnum};

/// `cobscope profiles`.
#[derive(Debug, Subcommand)]
pub enum ProfilesCommand {
    /// List all devices and variants
    List,
    /// Print the contents of a profile
    Show {
        /// Profile, with optional variant: rexroth-sydfec, wandfluh-md2:controller
        profile: String,
        /// Print only the number of entries
        #[arg(long)]
        count: bool,
        /// Output format
        #[arg(short, long, value_name = "FORMAT", default_value = "text")]
        format: PageFormat,
    },
    /// Check the syntax, ranges, references and samples of profiles, and report defects of device files
    Check {
        /// Profiles (TOML) and device files (EDS, DCF, XDD, XDC)
        #[arg(required = true, value_name = "FILE")]
        files: Vec<PathBuf>,
    },
    /// Print the profile generated from a device file
    Import {
        /// EDS, DCF, XDD or XDC file
        file: PathBuf,
    },
}

/// Formats of a profile page.
#[derive(Debug, Clone, Copy, PartialEq, Eq, ValueEnum)]
pub enum PageFormat {
    /// Complete text, wrapped for a terminal
    Text,
    /// Tables for a document, without the objects
    Markdown,
}
