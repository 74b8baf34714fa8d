//! Options for input: captures, profiles and the selection of events.

use std::num::NonZeroUsize;
use std::path::PathBuf;

use clap::{Args, ValueEnum};
use cobscope_decoder::capture::ColumnList;
use cobscope_decoder::query::Filter;
use cobscope_decoder::why::NodeChoice;
use cobscope_decoder::wire::NodeId;

use jiff::tz::TimeZone;

use crate::select::{RangeBound, Selection};

/// Heading of options for reading; a command's own options precede it.
const READING: &str = "Reading";

/// Help of `--node` for commands in which a node without a profile selects.
pub const NODE_HELP: &str = "Choose a node: 5, can0:5, sa:0x80; or assign its profile: 2=rexroth-sydfec, can0:5=my-device (repeatable)";

/// Options for reading and decoding captures.
#[derive(Debug, Clone, Args)]
pub struct InputArgs {
    /// Captures to read; `-` is stdin
    #[arg(value_name = "CAPTURE")]
    pub captures: Vec<PathBuf>,
    /// Interpret ambiguous timestamps in candump text as STYLE (default: detected from the first 1,000 lines)
    #[arg(long, help_heading = READING, value_name = "STYLE")]
    pub time: Option<StampStyle>,
    /// Read text captures as these columns, such as 'time:ms id len data' (default: inferred if the format is unknown)
    ///
    /// Names in the order of a line: time and delta (time since the frame before), with a unit (s, ms, 0.1ms, us, ns;
    /// default: s) or as time of day; date; id and data, hexadecimal or decimal (id:dec, data:dec); len (a length or DLC);
    /// bus, dir, kind, ext, rtr; skip (a column without meaning). Words such as Rx, Std or labels are not counted, unless
    /// separators mark each cell: 'skip time:us id len data' for `17;12034;181;2;37 02`.
    #[arg(long, help_heading = READING, value_name = "COLUMNS")]
    pub columns: Option<ColumnList>,
    /// Read times in CSV in UNIT (default: the unit of the program; milliseconds if no bus could carry the frames in
    /// microseconds)
    #[arg(long, help_heading = READING, value_name = "UNIT")]
    pub time_unit: Option<TimeUnitOption>,
    /// Read local times of recorders as times in ZONE, such as Europe/Berlin (default: the time zone of the bus in the bus
    /// file, otherwise UTC)
    ///
    /// Vector ASC, BLF, PEAK TRC, BUSMASTER and text with dates store the local time of the recorder without its zone. Of the
    /// two times in the hour that is repeated at the end of daylight saving time, the earlier one is used, unless times
    /// then step back.
    #[arg(long, help_heading = READING, value_name = "ZONE", value_parser = find_zone)]
    pub time_zone: Option<TimeZone>,
    /// Read names of nodes, identifiers, bit rates and object values from a bus file (TOML)
    #[arg(long, help_heading = READING, value_name = "FILE")]
    pub bus: Option<PathBuf>,
    /// Assign a profile to a node: 2=rexroth-sydfec, can0:5=my-device, or sa:0x80=danfoss-pve-ci for J1939
    /// (repeatable)
    #[arg(long, help_heading = READING, value_name = "[BUS:]ID=PROFILE")]
    pub node: Vec<NodeArg>,
    /// Assign an EDS, DCF, XDD or XDC to a node: 5=pump.eds, can0:5=pump.dcf (repeatable)
    #[arg(long, help_heading = READING, value_name = "[BUS:]ID=FILE")]
    pub eds: Vec<EdsArg>,
    /// Decode messages without a profile by a DBC or pretty_j1939 JSON file (repeatable; the first one takes
    /// precedence)
    #[arg(long, help_heading = READING, value_name = "FILE")]
    pub dbc: Vec<PathBuf>,
    /// Add a folder with profiles and device files (repeatable)
    #[arg(long, help_heading = READING, value_name = "DIR")]
    pub profiles: Vec<PathBuf>,
    /// Decode the traffic as PROTOCOL
    #[arg(long, help_heading = READING, value_name = "PROTOCOL", default_value = "auto")]
    pub protocol: ProtocolOption,
    /// Read each CAPTURE alone: do not join the parts of one capture
    ///
    /// Files are parts of one capture if they have the same format, clock and bus names, their names differ
    /// only in a counter (or they follow each other on the command line), and each one starts 0 to 5 s after
    /// the last frame of the one before.
    #[arg(long, help_heading = READING)]
    pub separate: bool,
    /// Read all CAPTUREs as parts of one capture, in this order
    ///
    /// For parts whose relative clocks each start again, which are never joined otherwise: the times of a part continue at
    /// the last frame of the one before. Parts on an absolute clock must not overlap.
    #[arg(long, help_heading = READING, conflicts_with = "separate")]
    pub join: bool,
    /// Join parts of one capture with gaps of up to SECONDS between them
    #[arg(long, help_heading = READING, value_name = "SECONDS", default_value = "5", value_parser = parse_seconds)]
    pub part_gap: f64,
    /// Report an SDO transfer as unanswered after SECONDS without a further frame
    #[arg(long, help_heading = READING, value_name = "SECONDS", default_value = "1", value_parser = positive_seconds)]
    pub sdo_timeout: f64,
}

/// Option that restricts a command to one node, if its `--node` only assigns profiles.
#[derive(Debug, Clone, Copy)]
pub enum NodeOption {
    /// `--filter`.
    Filter,
    /// `--only-node`.
    OnlyNode,
    /// `decode --filter`.
    Decode,
}

impl InputArgs {
    /// Checks the values of `--node`; `otherwise` is the option that selects a node, if `--node` does not.
    ///
    /// # Errors
    /// If a node has no profile and the command does not select nodes, or if a node has two profiles.
    pub fn check_nodes(&self, otherwise: Option<NodeOption>) -> Result<(), String> {
        otherwise.map_or(Ok(()), |otherwise| self.check_no_choice(otherwise))?;
        self.check_devices()
    }

    /// # Errors
    /// If a node has no profile.
    fn check_no_choice(&self, otherwise: NodeOption) -> Result<(), String> {
        let Some(node) = self.node.iter().find(|node| node.profile.is_none()) else { return Ok(()) };
        let shown = node.typed_text();
        let filter = node.event_filter();
        let only = match otherwise {
            NodeOption::Filter => format!("--filter '{filter}'"),
            NodeOption::OnlyNode => format!("--only-node {shown}"),
            NodeOption::Decode => format!("decode --filter '{filter}'"),
        };
        Err(format!(
            "--node {shown}: profile missing; --node {shown}=PROFILE assigns one, {only} selects the node"
        ))
    }

    /// # Errors
    /// If a node has two profiles.
    fn check_devices(&self) -> Result<(), String> {
        let given = || self.node.iter().filter_map(|node| Some((node, node.profile.as_deref()?)));
        for (place, (node, profile)) in given().enumerate() {
            let is_other = |(other, device): &(&NodeArg, &str)| {
                (&other.bus, other.id) == (&node.bus, node.id) && *device != profile
            };
            if let Some((_, other)) = given().take(place).find(is_other) {
                let shown = node.typed_text();
                return Err(format!("--node {shown}={profile}: conflicts with --node {shown}={other}"));
            }
        }
        Ok(())
    }
}

/// Grammar of filters.
macro_rules! filter_grammar {
    () => {
        "The grammar is that of Wireshark display filters: == != < <= > >=, in {}, contains, matches, && || ! (), \
or eq ne lt le gt ge and or not. "
    };
}
pub(crate) use filter_grammar;

/// Long help of `--filter` for findings, after its first sentence.
macro_rules! finding_filter_help {
    ($first:literal) => {
        concat!(
            $first,
            "\n\n",
            $crate::run::arguments::filter_grammar!(),
            "A field without a comparison tests whether the finding has it. Fields are rule, severity, bus, node, object \
and text. A comparison with a missing field is false.\n\n  \
  --filter 'node == 5 && severity == error'\n  \
  --filter 'rule == node-lost || text contains \"EMCY\"'\n  \
  --filter 'object in {1800:01..1BFF:02}'"
        )
    };
}
pub(crate) use finding_filter_help;

/// Long help of `--filter`: the verb, and the options that determine the events to select from.
macro_rules! filter_help {
    ($does:literal, $options:literal) => {
        concat!(
            $does,
            " only events that match EXPR\n\n",
            $crate::run::arguments::filter_grammar!(),
            "A field without a comparison tests whether the event has it. Fields are the keys of \
-f jsonl, nested ones with a dot, and many of Wireshark's names. A comparison with a missing field is \
false. The filter selects among the events that are enabled; see ",
            $options,
            ".\n\n  \
  --filter 'kind == emcy && node == 4'\n  \
  --filter 'canopen.sdo.abort_code == 0x06090011 || outcome == timeout'\n  \
  --filter 'object in {1800:01..1BFF:02} && direction == download'"
        )
    };
}
pub(crate) use filter_help;

/// Long help of `--filter` for printed events.
const FILTER_HELP: &str = filter_help!("Print", "--all, --pdo and --frames");

/// Long help of `--from`, after its first sentence.
macro_rules! from_help {
    ($first:literal) => {
        concat!(
            $first,
            "\n\n\
WHEN is 12.5 (seconds from the first frame), #1234 (frame), a time of day (22:13:25), a date (2024-01-31) or both \
(2024-01-31T22:13:25). Times are UTC, as printed by decode -t A; add ' local' for the time zone of this computer, or \
an offset (22:13:25+01:00). A time of day that occurs several times in the capture is an error that lists the \
candidates."
        )
    };
}
pub(crate) use from_help;

/// Selection of printed events; the complete capture is decoded in any case.
#[derive(Debug, Default, Args)]
pub struct SelectArgs {
    /// Print only events that match EXPR, such as 'kind == emcy && node == 4'
    #[arg(long, value_name = "EXPR", long_help = FILTER_HELP)]
    pub filter: Option<Filter>,
    /// Print only events from WHEN on: 12.5 (seconds from the first frame), #1234 (frame), 22:13:25, a date,
    /// or both
    #[arg(long, value_name = "WHEN", long_help = from_help!("Print only events from WHEN on"))]
    pub from: Option<RangeBound>,
    /// Print only events up to WHEN, in the form of --from; a date includes the whole day
    #[arg(long, value_name = "WHEN")]
    pub to: Option<RangeBound>,
    /// Print only events of a node, with SYNC, TIME and NMT commands to all: 5, can0:5, sa:0x80 (repeatable)
    #[arg(long, value_name = "[BUS:]ID")]
    pub only_node: Vec<NodeArg>,
}

impl SelectArgs {
    /// The selection of a command.
    ///
    /// # Errors
    /// `--from` is after `--to`, or `--only-node` has a profile.
    pub fn selection(&self) -> anyhow::Result<Selection> {
        let nodes = node_choices(&self.only_node)?;
        Selection::new(self.filter.clone(), (self.from, self.to), nodes)
    }

    /// Whether anything is selected.
    pub fn is_any(&self) -> bool {
        self.filter.is_some() || self.from.is_some() || self.to.is_some() || !self.only_node.is_empty()
    }
}

/// Nodes of `--only-node`.
///
/// # Errors
/// If a node has a profile.
pub fn node_choices(nodes: &[NodeArg]) -> anyhow::Result<Vec<NodeChoice>> {
    anyhow::ensure!(
        nodes.iter().all(|node| node.profile.is_none()),
        "--only-node selects a node; use --node to assign its profile"
    );
    Ok(nodes.iter().map(|node| NodeChoice { bus: node.bus.clone(), node: node.id }).collect())
}

/// A node with optional bus and profile: `5`, `can0:5`, `sa:0x80`, `5=rexroth-sydfec`.
#[derive(Debug, Clone)]
pub struct NodeArg {
    /// Name of the bus.
    pub bus: Option<String>,
    /// Node-ID or J1939 address.
    pub id: NodeId,
    /// Profile and variant; without one the argument selects the node.
    pub profile: Option<String>,
}

impl NodeArg {
    /// The node as typed: `can0:5`.
    pub fn typed_text(&self) -> String {
        self.bus.as_ref().map_or_else(|| self.id.to_string(), |bus| format!("{bus}:{}", self.id))
    }

    /// Filter for the events of the node.
    fn event_filter(&self) -> String {
        let node = format!("node == {}", self.id.number());
        self.bus.as_ref().map_or_else(|| node.clone(), |bus| format!("bus == \"{bus}\" && {node}"))
    }
}

impl std::str::FromStr for NodeArg {
    type Err = &'static str;

    fn from_str(text: &str) -> Result<Self, Self::Err> {
        let (node, profile) = match text.split_once('=') {
            Some((node, profile)) => (node, Some(profile.to_owned())),
            None => (text, None),
        };
        // `sa:0x80` is an address; a bus named `sa` needs `sa:sa:0x80`.
        if let Ok(id) = node.parse() {
            return Ok(Self { bus: None, id, profile });
        }
        let placed = node.split_once(':').and_then(|(bus, id)| Some((bus, id.parse().ok()?)));
        match placed {
            Some((bus, id)) => Ok(Self { bus: Some(bus.to_owned()), id, profile }),
            None => Err(
                "expected a node-ID (1 to 127) or a J1939 address: 5, 0x05, can0:5, sa:0x80, can0:sa:0x80",
            ),
        }
    }
}

/// A device file of a node: `5=pump.eds`, `can0:5=pump.dcf`.
#[derive(Debug, Clone)]
pub struct EdsArg {
    /// The node.
    pub node: NodeArg,
    /// The file.
    pub file: PathBuf,
}

impl std::str::FromStr for EdsArg {
    type Err = &'static str;

    fn from_str(text: &str) -> Result<Self, Self::Err> {
        match text.split_once('=') {
            Some((node, file)) if !file.is_empty() => Ok(Self { node: node.parse()?, file: file.into() }),
            _ => Err("expected a node-ID and a file, such as 5=pump.eds or can0:5=pump.dcf"),
        }
    }
}

/// Interpretation of candump's relative timestamps.
#[derive(Debug, Clone, Copy, ValueEnum)]
pub enum StampStyle {
    /// Timestamps are absolute (candump -t a, -t z, -l)
    #[value(name = "a", aliases = ["z", "absolute", "zero"])]
    Absolute,
    /// Timestamps are the time since the previous line (candump -t d)
    #[value(name = "d", alias = "delta")]
    Delta,
}

/// Unit of times in text.
#[derive(Debug, Clone, Copy, ValueEnum)]
pub enum TimeUnitOption {
    /// Seconds
    S,
    /// Milliseconds
    Ms,
    /// Microseconds
    Us,
    /// Nanoseconds
    Ns,
}

/// Protocol of the traffic.
#[derive(Debug, Clone, Copy, ValueEnum)]
pub enum ProtocolOption {
    /// Detected from the traffic
    Auto,
    /// 11-bit identifiers as CANopen, without detection
    Canopen,
    /// 29-bit identifiers as J1939, without detection
    J1939,
    /// No protocol: frames only
    None,
}

/// Parses a number from 1.
pub fn parse_count(text: &str) -> Result<NonZeroUsize, &'static str> {
    text.parse().map_err(|_| "expected 1 or more")
}

/// Finds a time zone by its name.
pub fn find_zone(name: &str) -> Result<TimeZone, &'static str> {
    TimeZone::get(name).map_err(|_| "unknown time zone; expected a name such as Europe/Berlin, or UTC")
}

/// Parses a date.
pub fn parse_date(text: &str) -> Result<jiff::civil::Date, &'static str> {
    text.parse().map_err(|_| "expected a date such as 2026-01-31")
}

/// Parses a number of seconds, at least 0.
fn parse_seconds(text: &str) -> Result<f64, String> {
    match text.parse::<f64>() {
        Ok(seconds) if seconds >= 0.0 && seconds.is_finite() => Ok(seconds),
        _ => Err("expected a number of seconds, 0 or more".into()),
    }
}

/// Parses a number of seconds greater than 0.
fn positive_seconds(text: &str) -> Result<f64, String> {
    match text.parse::<f64>() {
        Ok(seconds) if seconds > 0.0 && seconds.is_finite() => Ok(seconds),
        _ => Err("expected a number of seconds greater than 0".into()),
    }
}
