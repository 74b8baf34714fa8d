//! Command line: source of the help, the manual pages and the completions.

mod check;
mod convert;
mod decode;
mod diff;
mod duration;
mod extcap;
mod formats;
mod input;
#[cfg(feature = "parquet")]
mod lake;
mod live;
mod mcp;
mod notes;
mod objects;
mod profiles;
mod report;
mod rules;
mod size;
mod stats;
mod trigger;
mod view;
mod why;

use std::ffi::OsString;
use std::path::PathBuf;

use clap::{Parser, Subcommand};

pub use check::{CheckArgs, FailOn};
pub use convert::ConvertArgs;
pub use decode::{DecodeArgs, McapCompression, PdoOption, PrintArgs, TimeColumnChoice};
pub use diff::DiffArgs;
pub use extcap::{ExtcapArgs, ExtcapCall, is_extcap_call};
pub use formats::{Color, DiffFormat, ReportFormat};
pub use input::{EdsArg, InputArgs, NodeArg, ProtocolOption, SelectArgs, StampStyle, TimeUnitOption, node_choices};
use input::{NodeOption, filter_help, finding_filter_help, from_help};
#[cfg(feature = "parquet")]
pub use lake::{LakeAddArgs, LakeCommand};
pub use live::LiveArgs;
pub use mcp::McpArgs;
pub use objects::ObjectsArgs;
pub use profiles::{PageFormat, ProfilesCommand};
pub use report::{AttachPlace, FindingArg, PageStyle, ReportArgs};
pub use rules::{RulesArgs, RulesFormat};
pub use stats::StatsArgs;
pub use trigger::TriggerArgs;
pub use view::{ScreenArgs, ViewArgs};
pub use why::WhyArgs;

/// Decode CAN captures and live buses: events and faults of CANopen, J1939 and UDS devices
///
/// Formats of captures: candump text in any dialect, pcap, pcapng, PEAK TRC, Vector ASC and BLF, MDF4, MCAP,
/// BUSMASTER, CRTD, CSV and text of other programs, also compressed with gzip or zstd. The format is detected
/// from the content. `cobscope CAPTURE` runs `cobscope view` on a terminal, else `cobscope decode`.
#[derive(Debug, Parser)]
#[command(
    name = "cobscope",
    version,
    max_term_width = 100,
    after_help = notes::EXIT_STATUS,
    override_usage = "cobscope [OPTIONS] <CAPTURE>…\n       cobscope <COMMAND>"
)]
pub struct Cli {
    /// Command to run.
    #[command(subcommand)]
    pub command: CliCommand,
}

/// Help of `--node` for commands in which a node without a profile selects.
const NODE_HELP: &str = "Choose a node: 5, can0:5, sa:0x80; or assign its profile: 2=rexroth-sydfec, can0:5=my-device (repeatable)";

/// The subcommands.
#[derive(Debug, Subcommand)]
pub enum CliCommand {
    /// Show captures in a terminal UI: events, nodes, signals and findings at any moment
    ///
    /// Several captures are merged by time. Press ? for the list of keys.
    #[command(after_help = notes::VIEW)]
    View(ViewArgs),
    /// Show live buses: CAN interfaces, adapters, servers, growing files
    ///
    /// SOURCE is an interface (can0, any; with candump's filters: can0,123:7FF,400~7F0,#FFFFFFFF), a serial
    /// adapter (slcan:/dev/ttyACM0@500k), an adapter of PEAK (pcan:USB1@500k) or Kvaser (kvaser:0@500k) with its
    /// installed driver, a gs_usb adapter such as candleLight or CANable 2 (gs_usb:@500k, gs_usb:SERIAL@500k), a bus of a server (socketcand://host/can0), - for candump text on stdin (ssh machine
    /// candump -L any | cobscope live -), or a growing file with --follow. Without SOURCE the interfaces and
    /// adapters of this computer are listed. No frame is ever transmitted. Adapters are opened in listen-only mode, or
    /// refused. A CAN interface keeps the mode that the system has set, and a server decides about its own; in normal
    /// mode they acknowledge frames.
    #[command(
        mut_arg("captures", |arg| arg.value_name("SOURCE").help("Bus or file to show")),
        mut_arg("separate", |arg| arg.hide(true)),
        mut_arg("join", |arg| arg.hide(true)),
        mut_arg("part_gap", |arg| arg.hide(true)),
        after_help = notes::LIVE
    )]
    Live(Box<LiveArgs>),
    /// Print events, one line per event
    ///
    /// Columns: seconds from the first frame, node (or source → destination), kind, description, {frames}. A
    /// ? marks presumed values. Lines of further buses start with the bus name. Repeated events (heartbeat,
    /// SYNC, unchanged PDOs) are omitted; --all prints them.
    #[command(after_help = notes::DECODE)]
    Decode(DecodeArgs),
    /// Convert captures to another format, complete or in part, to one file or several
    ///
    /// convert IN… OUT: the captures, then the file to write, whose suffix selects the format. - for OUT is
    /// stdout and requires -f. Several captures are merged by time. Reports data that the target format
    /// cannot store.
    #[command(
        mut_arg("captures", |arg| arg.value_name("IN… OUT").help("Captures to read, then the file to write")),
        override_usage = "cobscope convert [OPTIONS] <IN>… <OUT>",
        after_help = notes::CONVERT
    )]
    Convert(Box<ConvertArgs>),
    /// Print statistics: nodes, message rates, timing and capture quality
    ///
    /// --filter, --from, --to and --only-node select frames and events. All counts and times are those of the selection: also
    /// boot-ups, losses and heartbeat periods. Only the names, NMT states and active errors of nodes are those at the end of
    /// the capture.
    #[command(after_help = notes::STATS)]
    #[command(mut_arg("filter", |arg| arg.help("Count only events, and frames whose own message, match EXPR").long_help(stats::FILTER_HELP)))]
    #[command(mut_arg("from", |arg| arg.help("Count only from WHEN on: 12.5 (seconds), #1234 (frame), 22:13:25, a date, or both").long_help(from_help!("Count only from WHEN on"))))]
    #[command(mut_arg("to", |arg| arg.help("Count only up to WHEN, in the form of --from")))]
    #[command(mut_arg("only_node", |arg| arg.help("Count only events and frames of a node: 5, can0:5, sa:0x80 (repeatable)")))]
    Stats(StatsArgs),
    /// Print the object values of nodes, with their origin
    ///
    /// Without --node, the nodes with known objects are listed. --node 5 selects the node; --node 5=PROFILE
    /// assigns its profile. They can be combined. Long names and values are truncated; -f json contains them
    /// completely.
    #[command(after_help = notes::OBJECTS)]
    #[command(mut_arg("node", |arg| arg.value_name("[BUS:]ID[=PROFILE]").help(NODE_HELP)))]
    Objects(ObjectsArgs),
    /// Show the most likely cause, its effects, and the steps to take
    ///
    /// --node 5 selects the node; --node 5=PROFILE assigns its profile. They can be combined.
    #[command(after_help = notes::WHY)]
    #[command(mut_arg("node", |arg| arg.value_name("[BUS:]ID[=PROFILE]").help(NODE_HELP)))]
    #[command(mut_arg("filter", |arg| arg.help("Report only faults whose event matches EXPR").long_help(finding_filter_help!("Report only faults whose event matches EXPR"))))]
    #[command(mut_arg("from", |arg| arg.help("Report only faults from WHEN on: 12.5 (seconds), #1234 (frame), 22:13:25, a date, or both").long_help(from_help!("Report only faults from WHEN on"))))]
    #[command(mut_arg("to", |arg| arg.help("Report only faults up to WHEN, in the form of --from")))]
    #[command(mut_arg("only_node", |arg| arg.help("Report only faults of a node: 5, can0:5, sa:0x80 (repeatable)")))]
    Why(WhyArgs),
    /// Compare the behaviour in two captures: configuration, nodes, states, timing, faults
    ///
    /// Captures are compared by meaning and aligned by role: bus name, name of the node in the bus file, node-ID with vendor
    /// and product, vendor and product alone. Actual values, counters, error histories and serial numbers are not
    /// compared. GOOD and BAD are two files or folders; more files must form two series. A subject that one capture never
    /// showed is "not seen" and not a difference. The exit status is 0 without a difference and 1 with one.
    ///
    /// Default tolerances, in percent of the smaller value: median of a period 5, 99th percentile of its intervals (from
    /// 100 intervals on) 20, longest interval 100, median and 99th percentile of latencies 100, rates of counts 100, bus
    /// load 20, range of a set point 20. Differences of times below 5 ms are ignored for gaps and latencies. The table
    /// [diff] of the bus file changes them.
    #[command(
        mut_arg("captures", |arg| arg.value_name("GOOD BAD").help("Captures to compare: files or folders")),
        mut_arg("join", |arg| {
            let help = "Read all files of a folder as parts of one capture, also if their relative clocks start again";
            arg.help(help).long_help(help)
        }),
        override_usage = "cobscope diff [OPTIONS] <GOOD> <BAD>",
        after_help = notes::diff_notes()
    )]
    Diff(Box<DiffArgs>),
    /// Write a page with the claim, its evidence and its origin, to mail and print
    ///
    /// The page contains the stories of why with numbered frames, plots, object values, manual sections,
    /// assumptions, quality and hashes of the capture; it needs no script and no network. For a folder or
    /// several captures, --output names a folder: it gets one page per capture and an index page. --node 5
    /// selects the node; --node 5=PROFILE assigns its profile.
    #[command(after_help = notes::REPORT)]
    #[command(mut_arg("node", |arg| arg.value_name("[BUS:]ID[=PROFILE]").help(NODE_HELP)))]
    #[command(mut_arg("filter", |arg| arg.help("Report only findings that match EXPR").long_help(finding_filter_help!("Report only findings that match EXPR"))))]
    #[command(mut_arg("from", |arg| arg.help("Report only findings present from WHEN on: 12.5 (seconds), #1234 (frame), 22:13:25, a date, or both").long_help(from_help!("Report only findings present from WHEN on"))))]
    #[command(mut_arg("to", |arg| arg.help("Report only findings present up to WHEN, in the form of --from")))]
    #[command(mut_arg("only_node", |arg| arg.help("Report only findings of a node: 5, can0:5, sa:0x80 (repeatable)")))]
    Report(Box<ReportArgs>),
    /// Check captures against the rules of standards, of manuals and of the bus file
    ///
    /// For a folder, all captures in it and in its subfolders are checked, in the order of their names;
    /// hidden files and other files are skipped. The exit status is 1 if there are findings at or above
    /// --fail-on, if a rule of --require-exercised is not exercised, if a rule is no longer exercised that is
    /// exercised in the baseline, or if a capture of the baseline in a folder was not checked.
    #[command(after_help = notes::check_notes())]
    #[command(mut_arg("filter", |arg| arg.help("Print only findings that match EXPR, such as 'node == 5 && severity == error'").long_help(finding_filter_help!("Print only findings that match EXPR"))))]
    #[command(mut_arg("from", |arg| arg.help("Print only findings present from WHEN on: 12.5 (seconds), #1234 (frame), 22:13:25, a date, or both").long_help(from_help!("Print only findings present from WHEN on"))))]
    #[command(mut_arg("to", |arg| arg.help("Print only findings present up to WHEN, in the form of --from")))]
    #[command(mut_arg("only_node", |arg| arg.help("Print only findings of a node: 5, can0:5, sa:0x80 (repeatable)")))]
    Check(CheckArgs),
    /// List the rules: name, severity, on or off, timing rule, defect
    Rules(RulesArgs),
    /// Explain a code, an identifier, an object, a frame or a rule
    ///
    /// THING is a rule (node-lost, rexroth-sydfec:NAME; see cobscope rules), an SDO abort code (06020000), an
    /// EMCY error code (8130), an object (1018:01, 0x1018:01, 1018h:01h, 1018sub1), a COB-ID (185), a 29-bit
    /// identifier (18FECA80), a J1939 PGN (pgn:65226, pgn:0xFECA), a J1939 fault (298985/19: SPN/FMI; 938FE9: as a
    /// number or as sent), a UDS
    /// response code (nrc:31) or identifier (did:F190), or a frame in candump's log form (701#05).
    #[command(after_help = notes::EXPLAIN)]
    Explain {
        /// Code, identifier, object, frame or rule to explain
        thing: String,
        /// Add the text of the manual of a device: rexroth-sydfec, wandfluh-md2:controller
        #[arg(long, value_name = "PROFILE")]
        device: Option<String>,
        /// Add a folder with profiles (repeatable)
        #[arg(long, value_name = "DIR")]
        profiles: Vec<PathBuf>,
    },
    /// List, show, check and import device profiles
    #[command(after_help = notes::PROFILES)]
    Profiles {
        /// Command to run
        #[command(subcommand)]
        command: ProfilesCommand,
        /// Add a folder with profiles and device files (repeatable)
        #[arg(long, value_name = "DIR", global = true)]
        profiles: Vec<PathBuf>,
    },
    /// Show buses and captures of any format in Wireshark, with decoded comments
    ///
    /// Wireshark then lists the interfaces "cobscope: …": CAN interfaces, other live sources, and captures in any format.
    /// Nothing is transmitted.
    #[command(after_help = notes::EXTCAP)]
    Extcap(ExtcapArgs),
    /// Answer the questions of an AI agent about captures (Model Context Protocol)
    ///
    /// A read-only server on standard input and output. Its tools are captures, summary, why, findings, events, objects,
    /// signals, explain and diff; each answer has at most 64 KiB. Only files in the given folders are read.
    #[command(after_help = notes::MCP)]
    Mcp(McpArgs),
    /// Collect captures of many machines in tables that DuckDB, Polars and Spark read
    ///
    /// A lake is a folder of Parquet files, partitioned by machine and day: captures, findings, events, signals, objects,
    /// and frames on request. docs/lake.md describes the columns and has queries.
    #[cfg(feature = "parquet")]
    #[command(after_help = notes::LAKE)]
    Lake {
        /// Command to run
        #[command(subcommand)]
        command: LakeCommand,
    },
    /// Print shell completions
    Completions {
        /// Shell
        shell: clap_complete::Shell,
    },
    /// Print a manual page (`cobscope man | man -l -`)
    Man {
        /// Command, such as check or profiles-import (default: the whole program)
        #[arg(value_name = "COMMAND")]
        of: Option<String>,
    },
}

impl CliCommand {
    /// Captures to read (stdin if empty); `None` for commands without captures.
    pub fn captures(&self) -> Option<&[PathBuf]> {
        let input = match self {
            Self::View(arguments) => &arguments.input,
            Self::Decode(arguments) => &arguments.input,
            Self::Stats(arguments) => &arguments.input,
            Self::Objects(arguments) => &arguments.input,
            Self::Why(arguments) => &arguments.input,
            Self::Report(arguments) if arguments.has_lake() => return None,
            Self::Report(arguments) => &arguments.input,
            Self::Check(arguments) => &arguments.input,
            Self::Diff(arguments) => &arguments.input,
            #[cfg(feature = "parquet")]
            Self::Lake { command: LakeCommand::Add(arguments) } => &arguments.input,
            Self::Live(_)
            | Self::Convert(_)
            | Self::Rules(_)
            | Self::Explain { .. }
            | Self::Profiles { .. }
            | Self::Extcap(_)
            | Self::Mcp(_)
            | Self::Completions { .. }
            | Self::Man { .. } => return None,
        };
        Some(&input.captures)
    }

    /// Folders of `--profiles`.
    pub fn profile_folders(&self) -> &[PathBuf] {
        match self {
            Self::View(arguments) => &arguments.input.profiles,
            Self::Live(arguments) => &arguments.input.profiles,
            Self::Decode(arguments) => &arguments.input.profiles,
            Self::Convert(arguments) => &arguments.input.profiles,
            Self::Stats(arguments) => &arguments.input.profiles,
            Self::Objects(arguments) => &arguments.input.profiles,
            Self::Why(arguments) => &arguments.input.profiles,
            Self::Report(arguments) => &arguments.input.profiles,
            Self::Check(arguments) => &arguments.input.profiles,
            Self::Diff(arguments) => &arguments.input.profiles,
            Self::Rules(arguments) => &arguments.profiles,
            Self::Explain { profiles, .. } | Self::Profiles { profiles, .. } => profiles,
            Self::Mcp(arguments) => &arguments.profiles,
            #[cfg(feature = "parquet")]
            Self::Lake { command: LakeCommand::Add(arguments) } => &arguments.input.profiles,
            Self::Extcap(_) | Self::Completions { .. } | Self::Man { .. } => &[],
        }
    }

    /// Checks the values of `--node`.
    ///
    /// # Errors
    /// If a node has no profile and the command does not select nodes, or if a node has two profiles.
    pub fn check_nodes(&self) -> Result<(), String> {
        let (input, otherwise) = match self {
            Self::View(arguments) => (&arguments.input, Some(NodeOption::Filter)),
            Self::Live(arguments) => (&arguments.input, Some(NodeOption::Filter)),
            Self::Decode(arguments) => (&arguments.input, Some(NodeOption::Filter)),
            Self::Convert(arguments) => (&arguments.input, Some(NodeOption::OnlyNode)),
            Self::Stats(arguments) => (&arguments.input, Some(NodeOption::Decode)),
            Self::Check(arguments) => (&arguments.input, Some(NodeOption::Decode)),
            Self::Diff(arguments) => (&arguments.input, Some(NodeOption::Decode)),
            #[cfg(feature = "parquet")]
            Self::Lake { command: LakeCommand::Add(arguments) } => {
                (&arguments.input, Some(NodeOption::Decode))
            }
            Self::Objects(arguments) => (&arguments.input, None),
            Self::Why(arguments) => (&arguments.input, None),
            Self::Report(arguments) => (&arguments.input, None),
            Self::Rules(_)
            | Self::Explain { .. }
            | Self::Profiles { .. }
            | Self::Extcap(_)
            | Self::Mcp(_)
            | Self::Completions { .. }
            | Self::Man { .. } => return Ok(()),
        };
        otherwise.map_or(Ok(()), |otherwise| input.check_no_choice(otherwise))?;
        input.check_devices()
    }
}

/// Inserts `view` or `decode` if the first argument is not a command: `view` if the output is a terminal and
/// all options are valid for it.
pub fn with_default_command(
    arguments: impl Iterator<Item = OsString>,
    is_on_terminal: bool,
) -> Vec<OsString> {
    let mut arguments: Vec<OsString> = arguments.collect();
    let is_command = |text: &str| {
        let own = matches!(text, "help" | "-h" | "--help" | "-V" | "--version");
        own || COMMANDS.contains(&text)
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

/// Names of the subcommands: building the parser only for them would take longer than decoding a small capture.
const COMMANDS: &[&str] = &[
    "view",
    "live",
    "decode",
    "convert",
    "stats",
    "objects",
    "why",
    "diff",
    "report",
    "check",
    "rules",
    "explain",
    "profiles",
    "extcap",
    "mcp",
    #[cfg(feature = "parquet")]
    "lake",
    "completions",
    "man",
];

/// Largest number of wrong, missing or exchanged letters of a misspelt command.
const WRONG_LETTERS: usize = 2;

/// Smallest number of letters of a misspelt command; with fewer, most words would resemble one.
const LETTERS: usize = 4;

/// Whether an argument is a misspelt command rather than a capture: a word that resembles a command, and no such file
/// exists. The parser then suggests the command.
fn is_misspelt(text: &str) -> bool {
    let is_word =
        text.len() >= LETTERS && text.bytes().all(|byte| byte.is_ascii_alphabetic() || byte == b'-');
    let resembles =
        |command: &&str| strsim::damerau_levenshtein(command, &text.to_ascii_lowercase()) <= WRONG_LETTERS;
    is_word && COMMANDS.iter().any(resembles) && !std::path::Path::new(text).exists()
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
    fn the_long_help_of_an_option_starts_with_its_short_help() {
        use clap::CommandFactory as _;
        for command in Cli::command().get_subcommands() {
            for option in command.get_arguments().filter(|option| option.get_long_help().is_some()) {
                let short = option.get_help().map(ToString::to_string).unwrap_or_default();
                let start = short.split([',', ':', '(']).next().unwrap_or_default().trim_end();
                let long = option.get_long_help().map(ToString::to_string).unwrap_or_default();
                let name = command.get_name();
                assert!(long.starts_with(start), "{name} {}: {short} / {long}", option.get_id());
            }
        }
    }

    #[test]
    fn numbers_and_dates_state_what_is_expected() {
        let lines = [
            ("why --story 0", "expected 1 or more"),
            ("why --story x", "expected 1 or more"),
            ("report --story 0", "expected 1 or more"),
            ("check --threads 0", "expected 1 or more"),
            ("check --today 2024-13-01", "expected a date such as 2026-01-31"),
            #[cfg(feature = "parquet")]
            ("lake add --threads 0 lake", "expected 1 or more"),
            #[cfg(feature = "parquet")]
            ("lake add --day 2024-13-01 lake", "expected a date such as 2026-01-31"),
        ];
        for (line, expected) in lines {
            let words = std::iter::once("cobscope").chain(line.split(' '));
            let error = Cli::try_parse_from(words).unwrap_err().to_string();
            assert!(error.contains(expected), "{line}: {error}");
        }
    }

    #[test]
    fn all_commands_are_known_by_name() {
        use clap::CommandFactory as _;
        let mut names: Vec<_> = Cli::command().get_subcommands().map(|it| it.get_name().to_owned()).collect();
        names.sort();
        let mut known = COMMANDS.to_vec();
        known.sort_unstable();
        assert_eq!(known, names);
    }

    #[test]
    fn a_misspelt_command_is_no_capture() {
        let misspelt = ["chek", "covnert", "decdoe", "Check", "stat", "veiw", "diffs", "profile", "objcets"];
        assert_eq!(misspelt.iter().filter(|word| !is_misspelt(word)).collect::<Vec<_>>(), [&""; 0]);
        let captures = ["run.log", "-f", "machine", "c", "/dev/stdin", "capture-12"];
        assert_eq!(captures.iter().filter(|word| is_misspelt(word)).collect::<Vec<_>>(), [&""; 0]);
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
        assert_eq!(with(&["decod", "x.log"]), ["decod", "x.log"], "the parser suggests the command");
        assert_eq!(with(&["decod.log"]), ["decode", "decod.log"]);
        assert_eq!(with(&["--help"]), ["--help"]);
    }

    #[test]
    fn on_a_terminal_view_is_the_default_unless_lines_are_requested() {
        let command = |arguments: &[&str]| {
            let all = std::iter::once("cobscope").chain(arguments.iter().copied()).map(OsString::from);
            with_default_command(all, true).remove(1)
        };
        assert_eq!(command(&["x.log"]), "view");
        assert_eq!(command(&["--pane", "events", "x.log"]), "view");
        assert_eq!(command(&["-f", "jsonl", "x.log"]), "decode");
    }
}
