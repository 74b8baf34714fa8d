//! The command line. These texts are its help, its man page and its completions.

mod check;
mod convert;
mod decode;
mod input;
mod live;
mod notes;
mod objects;
mod profiles;
mod report;
mod rules;
mod size;
mod stats;
mod view;
mod why;

use std::ffi::OsString;
use std::path::PathBuf;

use clap::{Parser, Subcommand};

pub use check::{CheckArgs, FailOn};
pub use convert::ConvertArgs;
pub use decode::{DecodeArgs, Packing, Pdo, PrintArgs, TimeColumn};
pub use input::{FileArg, InputArgs, NodeArg, Protocol, SelectArgs, StampStyle};
use input::{Otherwise, filter_help};
pub use live::LiveArgs;
pub use objects::ObjectsArgs;
pub use profiles::{PageFormat, ProfilesCommand};
pub use report::{Color, ReportFormat};
pub use rules::{RulesArgs, RulesFormat};
pub use stats::StatsArgs;
pub use view::{ScreenArgs, ThemeName, ViewArgs};
pub use why::WhyArgs;

/// Read CAN buses: what did the CANopen, J1939 and UDS devices do?
///
/// A capture may be candump text in any dialect, pcap, pcapng, PEAK TRC, Vector ASC or BLF, MDF4, MCAP, BUSMASTER, CRTD,
/// CSV and text of further programs, plain or compressed with gzip or zstd; its format is found by content. `cobscope CAPTURE` is short for `cobscope view` on a
/// terminal, and for `cobscope decode` elsewhere.
#[derive(Debug, Parser)]
#[command(
    name = "cobscope",
    version,
    max_term_width = 100,
    after_help = notes::EXIT_STATUS,
    override_usage = "cobscope [OPTIONS] <CAPTURE>…\n       cobscope <COMMAND>"
)]
pub struct Cli {
    /// What to do.
    #[command(subcommand)]
    pub command: Command,
}

/// Help of `--node` where one without a profile chooses.
const NODE_HELP: &str =
    "Choose a node: 5, can0:5, sa:0x80; or say what one is: 2=rexroth-sydfec, can0:5=my-device (repeatable)";

/// The subcommands.
#[derive(Debug, Subcommand)]
pub enum Command {
    /// Look at captures: events, nodes, signals and findings in a terminal UI, at any moment
    ///
    /// Several captures are put on one line of time. ? lists the keys.
    #[command(after_help = notes::VIEW)]
    View(ViewArgs),
    /// Watch buses as they are: CAN interfaces, serial adapters, servers, growing files
    ///
    /// SOURCE is an interface (can0, any; with candump's filters: can0,123:7FF,400~7F0,#FFFFFFFF), a serial adapter
    /// (slcan:/dev/ttyACM0@500000), a bus of a server (socketcand://host/can0), - for candump text on standard input
    /// (ssh machine candump -L any | cobscope live -), or a growing file with --follow. Without SOURCE the interfaces
    /// of this computer are listed. Nothing is ever transmitted.
    #[command(
        mut_arg("captures", |arg| arg.value_name("SOURCE").help("What to watch")),
        after_help = notes::LIVE
    )]
    Live(Box<LiveArgs>),
    /// Print what happened, one event a line
    ///
    /// Columns: seconds from the first frame, node (or who to whom), kind, what happened, {frames}. What is marked ? is not
    /// proven. Lines of all buses but the first begin with the bus's name. Repetitions (heartbeats, SYNC, PDOs that did not
    /// change) are left out; --all prints them.
    #[command(after_help = notes::DECODE)]
    Decode(DecodeArgs),
    /// Write captures in another format, whole or cut: one file, or several by size or event
    ///
    /// convert IN… OUT: the captures, then the file to write, whose name's end says the format; - for OUT is standard
    /// output and wants -f. Several captures are put on one line of time. What a format has no place for is said.
    #[command(
        mut_arg("captures", |arg| arg.value_name("IN… OUT").help("Captures to read, then the file to write")),
        override_usage = "cobscope convert [OPTIONS] <IN>… <OUT>",
        after_help = notes::CONVERT
    )]
    Convert(Box<ConvertArgs>),
    /// Show who is on the bus, how often, how late, and how far the capture can be trusted
    #[command(after_help = notes::STATS)]
    Stats(StatsArgs),
    /// Show what is known of the nodes' objects, and from where
    ///
    /// Without --node the nodes that have objects are listed; --node 5 shows those of one, and --node 5=PROFILE tells
    /// what it is; both may stand together. Long names and values are cut; -f json has them whole.
    #[command(after_help = notes::OBJECTS)]
    #[command(mut_arg("node", |arg| arg.value_name("[BUS:]ID[=PROFILE]").help(NODE_HELP)))]
    Objects(ObjectsArgs),
    /// Say what went wrong first, what was before it, and what to check
    ///
    /// The node is chosen by --node 5 and told what it is by --node 5=PROFILE; both may stand together.
    #[command(after_help = notes::WHY)]
    #[command(mut_arg("node", |arg| arg.value_name("[BUS:]ID[=PROFILE]").help(NODE_HELP)))]
    Why(WhyArgs),
    /// Judge captures by rules: what violates a standard, a manual or your expectations
    ///
    /// A folder stands for all captures in and below it, in the order of their names; files in it that are no
    /// captures, and hidden ones, are passed over. Ends with 1 where there are findings at or above --fail-on, a
    /// rule of --require-exercised is not exercised, one that the baseline has exercised is not any more, or a capture
    /// that the baseline has in a folder could not be judged.
    #[command(after_help = notes::check())]
    Check(CheckArgs),
    /// List the rules: name, severity, whether it is on, whether it judges times, the defect
    Rules(RulesArgs),
    /// Say what a code, an identifier, an object, one frame or a rule means
    ///
    /// THING is a rule (node-lost, rexroth-sydfec:NAME; cobscope rules lists them), an SDO abort code (06020000), an EMCY
    /// code (8130), an object (1018:01, 0x1018:01, 1018h:01h, 1018sub1), a COB-ID (185), a 29-bit identifier (18FECA80),
    /// a J1939 group (pgn:65226, pgn:0xFECA), a J1939 fault (298985/19: SPN/FMI), a UDS response code (nrc:31) or
    /// identifier (did:F190), or one frame in candump's log form (701#05).
    #[command(after_help = notes::EXPLAIN)]
    Explain {
        /// What to explain
        thing: String,
        /// Answer by this device's manual beside the standard: rexroth-sydfec, wandfluh-md2:controller
        #[arg(long, value_name = "PROFILE")]
        device: Option<String>,
        /// Folder with profiles of your own (repeatable)
        #[arg(long, value_name = "DIR")]
        profiles: Vec<PathBuf>,
    },
    /// List the devices that are known, show one, check a profile, make one of a device file
    #[command(after_help = notes::PROFILES)]
    Profiles {
        /// What to do
        #[command(subcommand)]
        command: ProfilesCommand,
        /// Folder with profiles and device files of your own (repeatable)
        #[arg(long, value_name = "DIR", global = true)]
        profiles: Vec<PathBuf>,
    },
    /// Write shell completions to stdout
    Completions {
        /// Which shell
        shell: clap_complete::Shell,
    },
    /// Write a manual page to stdout (`cobscope man | man -l -`)
    Man {
        /// Of this command (check, profiles-import); without, of the program as a whole
        #[arg(value_name = "COMMAND")]
        of: Option<String>,
    },
}

impl Command {
    /// The captures it reads, which are standard input where none is named.
    pub fn captures(&self) -> Option<&[PathBuf]> {
        let input = match self {
            Self::View(arguments) => &arguments.input,
            Self::Decode(arguments) => &arguments.input,
            Self::Stats(arguments) => &arguments.input,
            Self::Objects(arguments) => &arguments.input,
            Self::Why(arguments) => &arguments.input,
            Self::Check(arguments) => &arguments.input,
            Self::Live(_)
            | Self::Convert(_)
            | Self::Rules(_)
            | Self::Explain { .. }
            | Self::Profiles { .. }
            | Self::Completions { .. }
            | Self::Man { .. } => return None,
        };
        Some(&input.captures)
    }

    /// What of `--node` cannot be.
    ///
    /// # Errors
    /// A node without profile where none is chosen; a node with two profiles.
    pub fn check_nodes(&self) -> Result<(), String> {
        let (input, otherwise) = match self {
            Self::View(arguments) => (&arguments.input, Some(Otherwise::Filter)),
            Self::Live(arguments) => (&arguments.input, Some(Otherwise::Filter)),
            Self::Decode(arguments) => (&arguments.input, Some(Otherwise::Filter)),
            Self::Convert(arguments) => (&arguments.input, Some(Otherwise::OnlyNode)),
            Self::Stats(arguments) => (&arguments.input, Some(Otherwise::Decode)),
            Self::Check(arguments) => (&arguments.input, Some(Otherwise::Decode)),
            Self::Objects(arguments) => (&arguments.input, None),
            Self::Why(arguments) => (&arguments.input, None),
            Self::Rules(_)
            | Self::Explain { .. }
            | Self::Profiles { .. }
            | Self::Completions { .. }
            | Self::Man { .. } => return Ok(()),
        };
        otherwise.map_or(Ok(()), |otherwise| input.check_no_choice(otherwise))?;
        input.check_devices()
    }
}

/// Puts `view` or `decode` before arguments that begin with a capture or an option of one: `view` where a terminal
/// shows the output and it knows all options.
pub fn with_default_command(
    arguments: impl Iterator<Item = OsString>,
    is_on_terminal: bool,
) -> Vec<OsString> {
    let mut arguments: Vec<OsString> = arguments.collect();
    let is_command = |text: &str| {
        use clap::CommandFactory as _;
        let own = matches!(text, "help" | "-h" | "--help" | "-V" | "--version");
        own || Cli::command().get_subcommands().any(|command| command.get_name() == text)
    };
    let needs_default = match arguments.get(1) {
        Some(first) => !first.to_str().is_some_and(|first| is_command(first) || is_misspelt(first)),
        None => !std::io::IsTerminal::is_terminal(&std::io::stdin()),
    };
    if needs_default {
        arguments.insert(1, "view".into());
        let is_view = is_on_terminal && Cli::try_parse_from(&arguments).is_ok();
        if let (false, Some(command)) = (is_view, arguments.get_mut(1)) {
            *command = "decode".into();
        }
    }
    arguments
}

/// Whether this is meant to be a command rather than a capture: there is no such file, and it begins like one. What is
/// meant the parser then says.
fn is_misspelt(text: &str) -> bool {
    use clap::CommandFactory as _;
    const BEGINNING: usize = 3;
    let is_word = text.bytes().all(|byte| byte.is_ascii_lowercase());
    let begins = |command: &clap::Command| command.get_name().get(..BEGINNING) == text.get(..BEGINNING);
    is_word
        && text.len() > BEGINNING
        && Cli::command().get_subcommands().any(begins)
        && !std::path::Path::new(text).exists()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_definition_is_sound() {
        use clap::CommandFactory as _;
        Cli::command().debug_assert();
    }

    #[test]
    fn a_capture_alone_is_decoded() {
        let with = |arguments: &[&str]| {
            let all = std::iter::once("cobscope").chain(arguments.iter().copied()).map(OsString::from);
            with_default_command(all, false)
                .into_iter()
                .skip(1)
                .map(|a| a.into_string().unwrap())
                .collect::<Vec<_>>()
        };
        assert_eq!(with(&["x.log"]), ["decode", "x.log"]);
        assert_eq!(with(&["-f", "jsonl", "x.log"]), ["decode", "-f", "jsonl", "x.log"]);
        assert_eq!(with(&["man"]), ["man"]);
        assert_eq!(with(&["decod", "x.log"]), ["decod", "x.log"], "the parser says what is meant");
        assert_eq!(with(&["decod.log"]), ["decode", "decod.log"]);
        assert_eq!(with(&["--help"]), ["--help"]);
    }

    #[test]
    fn on_a_terminal_a_capture_is_viewed_unless_lines_are_asked_for() {
        let command = |arguments: &[&str]| {
            let all = std::iter::once("cobscope").chain(arguments.iter().copied()).map(OsString::from);
            with_default_command(all, true).remove(1)
        };
        assert_eq!(command(&["x.log"]), "view");
        assert_eq!(command(&["--pane", "events", "x.log"]), "view");
        assert_eq!(command(&["-f", "jsonl", "x.log"]), "decode");
    }
}
