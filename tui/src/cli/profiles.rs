//! `cobscope profiles`.

use std::path::PathBuf;

use clap::{Subcommand, ValueEnum};

/// `cobscope profiles`.
#[derive(Debug, Subcommand)]
pub enum ProfilesCommand {
    /// List all devices and their variants
    List,
    /// Show what is known of a device
    Show {
        /// Profile, with its variant if you like: rexroth-sydfec, wandfluh-md2:controller
        profile: String,
        /// Only count what is described
        #[arg(long)]
        count: bool,
        /// Output format
        #[arg(short, long, value_name = "FORMAT", default_value = "text")]
        format: PageFormat,
    },
    /// Check profiles: their grammar, ranges, references, samples; of device files what cannot be read
    Check {
        /// Profiles (TOML) and device files (EDS, DCF, XDD, XDC)
        #[arg(required = true, value_name = "FILE")]
        files: Vec<PathBuf>,
    },
    /// Write the profile that a device file makes to stdout
    Import {
        /// EDS, DCF, XDD or XDC
        file: PathBuf,
    },
}

/// Formats of a device's page.
#[derive(Debug, Clone, Copy, PartialEq, Eq, ValueEnum)]
pub enum PageFormat {
    /// Everything, folded for a terminal
    Text,
    /// Tables for a document: all but the objects
    Markdown,
}
