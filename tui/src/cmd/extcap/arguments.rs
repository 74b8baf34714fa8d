//! Options of `extcap`, and of the calls by which Wireshark uses it.

use std::ffi::OsString;
use std::path::PathBuf;

use clap::{Args, Parser};

use crate::run::arguments::examples;

/// Examples in the help.
const EXAMPLES: &str = examples![
    "cobscope extcap --install",
    "cobscope extcap --install --dir /usr/lib/x86_64-linux-gnu/wireshark/extcap",
];

/// Show buses and captures of any format in Wireshark, with decoded comments
///
/// Wireshark then lists the interfaces "cobscope: …": CAN interfaces, other live sources, and captures in any format.
/// Nothing is transmitted.
#[derive(Debug, Args)]
#[command(after_help = EXAMPLES)]
pub struct ExtcapArgs {
    /// Link this program in Wireshark's folder for extcap programs
    #[arg(long, required = true)]
    pub install: bool,
    /// Link it in DIR instead of the user's own folder (Wireshark: Help, About, Folders)
    #[arg(long, value_name = "DIR")]
    pub dir: Option<PathBuf>,
}

/// A call by Wireshark.
#[derive(Debug, Parser)]
#[command(name = "cobscope", disable_help_flag = true, disable_version_flag = true)]
pub struct ExtcapCall {
    /// List the interfaces.
    #[arg(long)]
    pub extcap_interfaces: bool,
    /// Version of Wireshark.
    #[arg(long)]
    pub extcap_version: Option<String>,
    /// Interface of the other requests.
    #[arg(long)]
    pub extcap_interface: Option<String>,
    /// List the link types of the interface.
    #[arg(long)]
    pub extcap_dlts: bool,
    /// List the options of the interface.
    #[arg(long)]
    pub extcap_config: bool,
    /// Expression that the user gave as capture filter.
    #[arg(long)]
    pub extcap_capture_filter: Option<String>,
    /// Write frames to the pipe.
    #[arg(long)]
    pub capture: bool,
    /// Pipe for the frames.
    #[arg(long)]
    pub fifo: Option<PathBuf>,
    /// Capture of the interface for files.
    #[arg(long)]
    pub file: Option<PathBuf>,
    /// Source of the interface for live sources.
    #[arg(long)]
    pub source: Option<String>,
    /// Profiles of nodes, separated by spaces.
    #[arg(long)]
    pub node: Option<String>,
    /// Bus file.
    #[arg(long)]
    pub bus: Option<PathBuf>,
    /// Database of messages.
    #[arg(long)]
    pub dbc: Option<PathBuf>,
}

/// Whether the arguments are a call by Wireshark, which knows no subcommand.
pub fn is_extcap_call(arguments: &[OsString]) -> bool {
    let first = arguments.get(1).and_then(|first| first.to_str());
    first.is_some_and(|first| first.starts_with("--extcap-") || first == "--capture")
}
