//! The command line. These texts are its help, its man page and its completions.

mod view;

use std::ffi::OsString;
use std::num::NonZeroUsize;
use std::path::PathBuf;

use clap::{Args, Parser, Subcommand, ValueEnum};
use cobscope_decoder::query::Filter;
use cobscope_decoder::wire::NodeId;
pub use view::{ThemeName, ViewArgs};

use crate::select::Bound;

/// Read CAN buses: what did the CANopen and J1939 devices do?
///
/// A capture may be candump text in any dialect, pcap, pcapng, PEAK TRC or Vector ASC, plain or
/// compressed with gzip or zstd; its format is found by content. `cobscope CAPTURE` is short for `cobscope view` on a
/// terminal, and for `cobscope decode` elsewhere.
#[derive(Debug, Parser)]
#[command(name = "cobscope", version, max_term_width = 100)]
pub struct Cli {
    /// What to do.
    #[command(subcommand)]
    pub command: Command,
}

/// The subcommands.
#[derive(Debug, Subcommand)]
pub enum Command {
    /// Look at captures: events, nodes, signals and findings in a terminal UI, at any moment
    ///
    /// Several captures are put on one line of time. ? lists the keys.
    View(ViewArgs),
    /// Print what happened, one event a line
    Decode(DecodeArgs),
    /// Show who is on the bus, how often, how late, and how far the capture can be trusted
    Stats(StatsArgs),
    /// Show what is known of the nodes' objects, and from where
    Objects(ObjectsArgs),
    /// Say what went wrong first, what was before it, and what to check
    ///
    /// The node is chosen by --node 5 and told what it is by --node 5=PROFILE; both may stand together.
    Why(WhyArgs),
    /// Judge captures by rules: what violates a standard, a manual or your expectations
    ///
    /// A folder stands for all captures in and below it, in the order of their names; files in it that are no
    /// captures, and hidden ones, are passed over. Ends with 1 where there are findings at or above --fail-on, a
    /// rule of --require-exercised is not exercised, or one that the baseline has exercised is not any more.
    Check(CheckArgs),
    /// List the rules: name, severity, whether it is on, whether it judges times, the defect
    Rules(RulesArgs),
    /// Say what a code, an identifier, an object, one frame or a rule means
    ///
    /// THING is a rule (node-lost, rexroth-sydfec:NAME; cobscope rules lists them), an SDO abort code (06020000), an EMCY code (8130), an object (1018:01, 0x1018:01,
    /// 1018h:01h, 1018sub1), a COB-ID (185), a 29-bit identifier (18FECA80), a J1939 group (pgn:65226,
    /// pgn:0xFECA), a J1939 fault (298985/19: SPN/FMI) or one frame in candump's log form (701#05).
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
    /// Write the manual page to stdout (`cobscope man | man -l -`)
    Man,
}

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

/// How captures are read and understood.
#[derive(Debug, Args)]
pub struct InputArgs {
    /// Captures to read; `-` is standard input
    #[arg(value_name = "CAPTURE")]
    pub captures: Vec<PathBuf>,
    /// What ambiguous time stamps in candump text mean (default: found out from the first 1,000 lines)
    #[arg(long, value_name = "STYLE")]
    pub time: Option<StampStyle>,
    /// What is known of the buses: names of nodes, identifiers, bit rates, object values (TOML)
    #[arg(long, value_name = "FILE")]
    pub bus: Option<PathBuf>,
    /// What a node is: 2=rexroth-sydfec, can0:5=my-device, at a J1939 address sa:0x80=danfoss-pve-ci (repeatable)
    #[arg(long, value_name = "[BUS:]ID=PROFILE")]
    pub node: Vec<NodeArg>,
    /// Device file of a node, EDS, DCF, XDD or XDC: 5=pump.eds, can0:5=pump.dcf (repeatable)
    #[arg(long, value_name = "[BUS:]ID=FILE")]
    pub eds: Vec<FileArg>,
    /// Signals of messages that no profile knows: a DBC, or the JSON of pretty_j1939 (repeatable, the first counts)
    #[arg(long, value_name = "FILE")]
    pub dbc: Vec<PathBuf>,
    /// Folder with profiles and device files of your own (repeatable)
    #[arg(long, value_name = "DIR")]
    pub profiles: Vec<PathBuf>,
    /// What the traffic is taken for
    #[arg(long, value_name = "PROTOCOL", default_value = "auto")]
    pub protocol: Protocol,
    /// Seconds without a further frame after which an SDO transfer counts as unanswered
    #[arg(long, value_name = "SECONDS", default_value = "1", value_parser = positive_seconds)]
    pub sdo_timeout: f64,
}

/// Help of `--filter`.
const FILTER_HELP: &str = "\
Print only events that EXPR matches

The grammar is that of Wireshark's display filters: == != < <= > >=, in {}, contains, matches, && || ! (), \
or in words eq ne lt le gt ge and or not. A field alone asks whether the event has it. Fields are the keys of \
-f jsonl, nested ones with a dot, and many of Wireshark's names. A comparison with a field the event does not \
have is false. The filter chooses among what is printed anyway; see --all, --pdo and --frames.

  --filter 'kind == emcy && node == 4'
  --filter 'canopen.sdo.abort_code == 0x06090011 || outcome == timeout'
  --filter 'object in {1800:01..1BFF:02} && direction == download'";

/// Which events are printed. All of a capture is understood either way.
#[derive(Debug, Default, Args)]
pub struct SelectArgs {
    /// Print only events that EXPR matches, such as 'kind == emcy && node == 4'
    #[arg(long, value_name = "EXPR", long_help = FILTER_HELP)]
    pub filter: Option<Filter>,
    /// Print only events from WHEN on: 12.5 (seconds from the first frame), #1234 (frame), a date and time
    #[arg(long, value_name = "WHEN")]
    pub from: Option<Bound>,
    /// Print only events up to WHEN, given as with --from; dates as 2024-01-31T12:00:00Z
    #[arg(long, value_name = "WHEN")]
    pub to: Option<Bound>,
}

/// `cobscope decode`.
#[derive(Debug, Args)]
pub struct DecodeArgs {
    #[command(flatten)]
    pub input: InputArgs,
    #[command(flatten)]
    pub select: SelectArgs,
    /// Output format
    #[arg(short, long, value_name = "FORMAT", default_value = "text")]
    pub format: Format,
    /// Write to FILE instead of standard output
    #[arg(short, long, value_name = "FILE")]
    pub output: Option<PathBuf>,
    /// Which PDOs, J1939 messages and frames a DBC describes to print: those that say something new, all or
    /// none (default: change for text, all for others)
    #[arg(long, value_name = "WHICH")]
    pub pdo: Option<Pdo>,
    /// Print repetitions too: heartbeats, SYNC, guarding (text; other formats always have them)
    #[arg(long)]
    pub all: bool,
    /// Print frames too that no protocol explains
    #[arg(long)]
    pub frames: bool,
    /// Print everything known of each event, on further lines (text)
    #[arg(short, long)]
    pub verbose: bool,
    /// Time column: a(bsolute), d(elta), z(ero: since the first frame), A (date, UTC) (text)
    #[arg(short = 't', value_name = "COLUMN", default_value = "z")]
    pub time_column: TimeColumn,
    /// Do not judge: no findings among the events
    #[arg(long)]
    pub no_findings: bool,
    /// Colours: auto uses them on a terminal unless NO_COLOR is set
    #[arg(long, value_name = "WHEN", default_value = "auto")]
    pub color: Color,
}

/// `cobscope stats`.
#[derive(Debug, Args)]
pub struct StatsArgs {
    #[command(flatten)]
    pub input: InputArgs,
    /// Bit rate for the load in %: 250k, 1M or 250000, of one bus or all (repeatable)
    #[arg(long, value_name = "[BUS:]RATE")]
    pub bitrate: Vec<BitRate>,
    /// Output format
    #[arg(short, long, value_name = "FORMAT", default_value = "text")]
    pub format: ReportFormat,
}

/// A bit rate, of one bus or all.
#[derive(Debug, Clone)]
pub struct BitRate {
    /// Name of the bus.
    pub bus: Option<String>,
    /// Bits a second.
    pub rate: u32,
}

impl std::str::FromStr for BitRate {
    type Err = &'static str;

    fn from_str(text: &str) -> Result<Self, Self::Err> {
        let (bus, rate) = match text.rsplit_once(':') {
            Some((bus, rate)) => (Some(bus.to_owned()), rate),
            None => (None, text),
        };
        let (digits, factor) = match rate.strip_suffix(['k', 'K']) {
            Some(digits) => (digits, 1_000),
            None => rate.strip_suffix('M').map_or((rate, 1), |digits| (digits, 1_000_000)),
        };
        let rate = digits.parse::<u32>().ok().and_then(|rate| rate.checked_mul(factor));
        match rate {
            Some(rate @ 1_000..=20_000_000) => Ok(Self { bus, rate }),
            _ => Err("expected a bit rate, as 250k, 1M or can0:500k"),
        }
    }
}

/// `cobscope objects`.
#[derive(Debug, Args)]
pub struct ObjectsArgs {
    #[command(flatten)]
    pub input: InputArgs,
    /// Show them as they were then: 12.5 (seconds from the first frame), #1234 (frame), or a date and time
    #[arg(long, value_name = "TIME")]
    pub at: Option<Bound>,
    /// Compare them with what a DCF or XDC wants of --node, else of the node of that file
    #[arg(long, value_name = "FILE")]
    pub want: Option<PathBuf>,
    /// Output format
    #[arg(short, long, value_name = "FORMAT", default_value = "text")]
    pub format: ReportFormat,
}

/// `cobscope why`.
#[derive(Debug, Args)]
pub struct WhyArgs {
    #[command(flatten)]
    pub input: InputArgs,
    /// Look from this moment back, for the latest fault: 12.5 (seconds from the first frame), #1234 (frame), or a date and time
    #[arg(long, value_name = "TIME")]
    pub at: Option<Bound>,
    /// Output format
    #[arg(short, long, value_name = "FORMAT", default_value = "text")]
    pub format: ReportFormat,
}

/// `cobscope check`.
#[derive(Debug, Args)]
pub struct CheckArgs {
    #[command(flatten)]
    pub input: InputArgs,
    /// Output format
    #[arg(short, long, value_name = "FORMAT", default_value = "text")]
    pub format: FindingFormat,
    /// Write to FILE instead of standard output
    #[arg(short, long, value_name = "FILE")]
    pub output: Option<PathBuf>,
    /// Findings from which on the exit status is 1
    #[arg(long, value_name = "SEVERITY", default_value = "error")]
    pub fail_on: FailOn,
    /// Findings that are known and accepted: only others, and worse ones, fail (JSON, see --update-baseline)
    #[arg(long, value_name = "FILE")]
    pub baseline: Option<PathBuf>,
    /// Write what is found now to the file of --baseline, instead of comparing with it
    #[arg(long, requires = "baseline")]
    pub update_baseline: bool,
    /// Fail if one of these rules had nothing to judge in any capture
    #[arg(long, value_name = "RULE", value_delimiter = ',')]
    pub require_exercised: Vec<String>,
    /// Show how often each rule, and each case of CiA's conformance test plan, was judged (text; jsonl always
    /// says it)
    #[arg(long)]
    pub coverage: bool,
    /// Show every occurrence that was kept, and what is suppressed or accepted (text)
    #[arg(short, long)]
    pub verbose: bool,
    /// Captures judged at the same time; the output is the same (default: as many as there are processors)
    #[arg(long, value_name = "N")]
    pub threads: Option<NonZeroUsize>,
    /// Day on which suppressions of the bus file may have run out (default: today)
    #[arg(long, value_name = "DATE")]
    pub today: Option<jiff::civil::Date>,
    /// Use the profiles in $XDG_CONFIG_HOME/cobscope/profiles too; without, every machine judges alike
    #[arg(long)]
    pub user_profiles: bool,
    /// Colours: auto uses them on a terminal unless NO_COLOR is set
    #[arg(long, value_name = "WHEN", default_value = "auto")]
    pub color: Color,
}

/// Formats of findings.
#[derive(Debug, Clone, Copy, PartialEq, Eq, ValueEnum)]
pub enum FindingFormat {
    /// Lines and a table for people
    Text,
    /// One JSON object a finding and a capture, and a total (docs/check.schema.json)
    Jsonl,
    /// JUnit XML: a suite a capture, a case a rule
    Junit,
    /// SARIF 2.1.0 for code scanning
    Sarif,
    /// Commands of GitHub Actions: notes beside the lines of captures
    Github,
}

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

/// Findings that make `check` fail.
#[derive(Debug, Clone, Copy, PartialEq, Eq, ValueEnum)]
pub enum FailOn {
    /// Errors
    Error,
    /// Errors and warnings
    Warning,
    /// None
    Never,
}

/// Formats of reports.
#[derive(Debug, Clone, Copy, PartialEq, Eq, ValueEnum)]
pub enum ReportFormat {
    /// Tables for people
    Text,
    /// One JSON object a line
    Json,
}

/// A node, with its bus if that matters, and what it is: `5`, `can0:5`, `sa:0x80`, `5=rexroth-sydfec`.
#[derive(Debug, Clone)]
pub struct NodeArg {
    /// Name of the bus.
    pub bus: Option<String>,
    /// Node-ID or J1939 address.
    pub id: NodeId,
    /// Profile and variant; without one the node is only chosen.
    pub profile: Option<String>,
}

impl std::str::FromStr for NodeArg {
    type Err = &'static str;

    fn from_str(text: &str) -> Result<Self, Self::Err> {
        let (node, profile) = match text.split_once('=') {
            Some((node, profile)) => (node, Some(profile.to_owned())),
            None => (text, None),
        };
        // The whole may be sa:0x80; a bus of that name would be sa:sa:0x80.
        if let Ok(id) = node.parse() {
            return Ok(Self { bus: None, id, profile });
        }
        let placed = node.split_once(':').and_then(|(bus, id)| Some((bus, id.parse().ok()?)));
        match placed {
            Some((bus, id)) => Ok(Self { bus: Some(bus.to_owned()), id, profile }),
            None => Err(
                "expected a node-ID, 1 to 127, or a J1939 address: 5, 0x05, can0:5, sa:0x80, can0:sa:0x80",
            ),
        }
    }
}

/// A device file of a node: `5=pump.eds`, `can0:5=pump.dcf`.
#[derive(Debug, Clone)]
pub struct FileArg {
    /// The node.
    pub node: NodeArg,
    /// The file.
    pub file: PathBuf,
}

impl std::str::FromStr for FileArg {
    type Err = &'static str;

    fn from_str(text: &str) -> Result<Self, Self::Err> {
        match text.split_once('=') {
            Some((node, file)) if !file.is_empty() => Ok(Self { node: node.parse()?, file: file.into() }),
            _ => Err("expected a node-ID and a file, as 5=pump.eds or can0:5=pump.dcf"),
        }
    }
}

/// Meaning of candump's relative stamps.
#[derive(Debug, Clone, Copy, ValueEnum)]
pub enum StampStyle {
    /// Each stamp stands for itself (candump -t a, -t z, -l)
    #[value(name = "a", aliases = ["z", "absolute", "zero"])]
    Absolute,
    /// Each stamp is the time since the line before (candump -t d)
    #[value(name = "d", alias = "delta")]
    Delta,
}

/// What traffic is taken for.
#[derive(Debug, Clone, Copy, ValueEnum)]
pub enum Protocol {
    /// By evidence
    Auto,
    /// Identifiers of 11 bits are CANopen, whatever the evidence
    Canopen,
    /// Identifiers of 29 bits are J1939, whatever the evidence
    J1939,
    /// No protocol: frames only
    None,
}

/// Output formats of `decode`.
#[derive(Debug, Clone, Copy, PartialEq, Eq, ValueEnum)]
pub enum Format {
    /// Lines for people
    Text,
    /// One JSON object a line
    Jsonl,
    /// Nothing: reads and decodes only
    None,
}

/// Which PDOs are printed.
#[derive(Debug, Clone, Copy, PartialEq, Eq, ValueEnum)]
pub enum Pdo {
    /// The first of each identifier and those that say something new
    Change,
    /// All
    All,
    /// None
    None,
}

/// Time columns, as candump's -t.
#[derive(Debug, Clone, Copy, ValueEnum)]
pub enum TimeColumn {
    /// Seconds as recorded
    #[value(name = "a")]
    Absolute,
    /// Seconds since the line before
    #[value(name = "d")]
    Delta,
    /// Seconds since the first frame
    #[value(name = "z")]
    Zero,
    /// Date and time, UTC
    #[value(name = "A")]
    Date,
}

/// When to use colours.
#[derive(Debug, Clone, Copy, PartialEq, Eq, ValueEnum)]
pub enum Color {
    /// On a terminal, unless NO_COLOR is set
    Auto,
    /// Always
    Always,
    /// Never
    Never,
}

/// A number of seconds above 0.
fn positive_seconds(text: &str) -> Result<f64, String> {
    match text.parse::<f64>() {
        Ok(seconds) if seconds > 0.0 && seconds.is_finite() => Ok(seconds),
        _ => Err("expected a number of seconds above 0".into()),
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
        Some(first) => !first.to_str().is_some_and(is_command),
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
