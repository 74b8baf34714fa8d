//! Command line: its subcommands, and the default one.

use std::ffi::OsString;
use std::path::PathBuf;

use clap::{Parser, Subcommand};

use super::check::CheckArgs;
use super::convert::ConvertArgs;
use super::decode::DecodeArgs;
use super::diff::DiffArgs;
use super::explain::ExplainArgs;
use super::extcap::ExtcapArgs;
#[cfg(feature = "parquet")]
use super::lake::{LakeArgs, LakeCommand};
use super::live::LiveArgs;
use super::mcp::McpArgs;
use super::objects::ObjectsArgs;
use super::profiles::ProfilesArgs;
use super::report::ReportArgs;
use super::rules::RulesArgs;
use super::shell::{CompletionsArgs, ManArgs};
use super::stats::StatsArgs;
use super::view::ViewArgs;
use super::why::WhyArgs;
use crate::run::arguments::{EXIT_STATUS, InputArgs, NodeOption, parse_words};

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
    after_help = EXIT_STATUS,
    override_usage = "cobscope [OPTIONS] <CAPTURE>…\n       cobscope <COMMAND>"
)]
pub struct Cli {
    /// Command to run.
    #[command(subcommand)]
    pub command: CliCommand,
}

impl Cli {
    /// Parses the arguments of the process. The definitions of all commands take longer to build than a small capture to
    /// decode: they are built for a command that reads no capture, for help and for messages about mistakes.
    ///
    /// # Errors
    /// If the arguments are not valid, and for a request for help or the version.
    pub fn parse_arguments(arguments: &[OsString]) -> Result<Self, clap::Error> {
        match CliCommand::parse_alone(arguments) {
            Some(command) => Ok(Self { command }),
            None => Self::try_parse_from(arguments),
        }
    }
}

/// The subcommands, in the order of the help. Their arguments have their descriptions.
#[allow(missing_docs, reason = "a doc comment of a variant replaces the help of its arguments")]
#[derive(Debug, Subcommand)]
pub enum CliCommand {
    View(ViewArgs),
    Live(Box<LiveArgs>),
    Decode(DecodeArgs),
    Convert(Box<ConvertArgs>),
    Stats(StatsArgs),
    Objects(ObjectsArgs),
    Why(WhyArgs),
    Diff(Box<DiffArgs>),
    Report(Box<ReportArgs>),
    Check(CheckArgs),
    Rules(RulesArgs),
    Explain(ExplainArgs),
    Profiles(ProfilesArgs),
    Extcap(ExtcapArgs),
    Mcp(McpArgs),
    #[cfg(feature = "parquet")]
    Lake(LakeArgs),
    Completions(CompletionsArgs),
    Man(ManArgs),
}

impl CliCommand {
    /// Parses the arguments of a command that reads captures, without the definitions of the others; `None` for all other
    /// commands, for mistakes and for requests for help.
    fn parse_alone(arguments: &[OsString]) -> Option<Self> {
        let [_, name, words @ ..] = arguments else { return None };
        let words = words.iter().cloned();
        let command = match name.to_str()? {
            "view" => Self::View(parse_words("view", words).ok()?),
            "live" => Self::Live(parse_words("live", words).ok()?),
            "decode" => Self::Decode(parse_words("decode", words).ok()?),
            "convert" => Self::Convert(parse_words("convert", words).ok()?),
            "stats" => Self::Stats(parse_words("stats", words).ok()?),
            "objects" => Self::Objects(parse_words("objects", words).ok()?),
            "why" => Self::Why(parse_words("why", words).ok()?),
            "diff" => Self::Diff(parse_words("diff", words).ok()?),
            "report" => Self::Report(parse_words("report", words).ok()?),
            "check" => Self::Check(parse_words("check", words).ok()?),
            _ => return None,
        };
        Some(command)
    }

    /// Options for reading, and the option that selects a node if `--node` only assigns profiles; `None` for commands
    /// that read no capture.
    fn input(&self) -> Option<(&InputArgs, Option<NodeOption>)> {
        Some(match self {
            Self::View(arguments) => (&arguments.input, Some(NodeOption::Filter)),
            Self::Live(arguments) => (&arguments.input, Some(NodeOption::Filter)),
            Self::Decode(arguments) => (&arguments.input, Some(NodeOption::Filter)),
            Self::Convert(arguments) => (&arguments.input, Some(NodeOption::OnlyNode)),
            Self::Stats(arguments) => (&arguments.input, Some(NodeOption::Decode)),
            Self::Check(arguments) => (&arguments.input, Some(NodeOption::Decode)),
            Self::Diff(arguments) => (&arguments.input, Some(NodeOption::Decode)),
            #[cfg(feature = "parquet")]
            Self::Lake(LakeArgs { command: LakeCommand::Add(arguments) }) => {
                (&arguments.input, Some(NodeOption::Decode))
            }
            Self::Objects(arguments) => (&arguments.input, None),
            Self::Why(arguments) => (&arguments.input, None),
            Self::Report(arguments) => (&arguments.input, None),
            Self::Rules(_)
            | Self::Explain(_)
            | Self::Profiles(_)
            | Self::Extcap(_)
            | Self::Mcp(_)
            | Self::Completions(_)
            | Self::Man(_) => return None,
        })
    }

    /// Whether the command reads stdin, because no capture is named.
    pub fn reads_stdin(&self) -> bool {
        let has_own_check = match self {
            Self::Live(_) | Self::Convert(_) => true,
            Self::Report(arguments) => arguments.has_lake(),
            _ => false,
        };
        !has_own_check && self.input().is_some_and(|(input, _)| input.captures.is_empty())
    }

    /// Folders of `--profiles`.
    pub fn profile_folders(&self) -> &[PathBuf] {
        match self {
            Self::Rules(arguments) => &arguments.profiles,
            Self::Explain(arguments) => &arguments.profiles,
            Self::Profiles(arguments) => &arguments.profiles,
            Self::Mcp(arguments) => &arguments.profiles,
            other => other.input().map_or(&[], |(input, _)| &input.profiles),
        }
    }

    /// Checks the values of `--node`; see [`InputArgs::check_nodes`].
    ///
    /// # Errors
    /// If a node has no profile and the command does not select nodes, or if a node has two profiles.
    pub fn check_nodes(&self) -> Result<(), String> {
        self.input().map_or(Ok(()), |(input, otherwise)| input.check_nodes(otherwise))
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
        let is_view = is_on_terminal && Cli::parse_arguments(&arguments).is_ok();
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
    use clap::CommandFactory as _;

    use super::*;

    #[test]
    fn the_definition_is_sound() {
        Cli::command().debug_assert();
    }

    #[test]
    fn the_long_help_of_an_option_starts_with_its_short_help() {
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

    /// Commands without examples.
    const PLAIN: [&str; 3] = ["rules", "completions", "man"];

    #[test]
    fn every_command_has_examples() {
        let cli = Cli::command();
        let without = cli.get_subcommands().filter(|command| examples(command).is_empty());
        assert_eq!(without.map(clap::Command::get_name).collect::<Vec<_>>(), PLAIN);
    }

    #[test]
    fn examples_are_understood() {
        let examples: Vec<_> = Cli::command().get_subcommands().flat_map(examples).collect();
        assert!(examples.len() > 30, "{}", examples.len());
        for example in examples {
            let line = example.split(" > ").next().unwrap();
            let parts = line.split('\'').enumerate();
            let words =
                parts.flat_map(
                    |(at, part)| {
                        if at % 2 == 1 { vec![part] } else { part.split_whitespace().collect() }
                    },
                );
            let words: Vec<OsString> = words.map(OsString::from).collect();
            let whole = Cli::try_parse_from(&words).unwrap_or_else(|error| panic!("{example}: {error}"));
            if let Some(alone) = CliCommand::parse_alone(&words) {
                assert_eq!(format!("{alone:?}"), format!("{:?}", whole.command), "{example}");
            }
        }
    }

    #[test]
    fn mistakes_and_help_have_the_texts_of_the_whole_definition() {
        for line in ["decode --help", "chek x.log", "check --fail-on x", "convert", "view --bus", "", "rules"]
        {
            let words: Vec<OsString> =
                std::iter::once("cobscope").chain(line.split_whitespace()).map(OsString::from).collect();
            let text = |parsed: Result<Cli, clap::Error>| parsed.map_err(|error| error.to_string());
            assert_eq!(
                format!("{:?}", text(Cli::parse_arguments(&words))),
                format!("{:?}", text(Cli::try_parse_from(&words))),
                "{line}"
            );
        }
    }

    /// Examples in the help of a command.
    fn examples(command: &clap::Command) -> Vec<String> {
        let help = command.get_after_help().map(ToString::to_string).unwrap_or_default();
        let lines = help.strip_prefix("Examples:\n").unwrap_or_default().lines();
        lines.take_while(|line| !line.is_empty()).map(|line| line.trim().to_owned()).collect()
    }
}
