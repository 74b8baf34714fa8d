//! What is read, how it is understood, and what of it is wanted.

use std::path::PathBuf;

use clap::{Args, ValueEnum};
use cobscope_decoder::query::Filter;
use cobscope_decoder::wire::NodeId;

use crate::select::Bound;

/// Heading of what says how captures are read; a command's own options stand before it.
const READING: &str = "Reading";

/// How captures are read and understood.
#[derive(Debug, Args)]
pub struct InputArgs {
    /// Captures to read; `-` is standard input
    #[arg(value_name = "CAPTURE")]
    pub captures: Vec<PathBuf>,
    /// What ambiguous time stamps in candump text mean (default: found out from the first 1,000 lines)
    #[arg(long, help_heading = READING, value_name = "STYLE")]
    pub time: Option<StampStyle>,
    /// What is known of the buses: names of nodes, identifiers, bit rates, object values (TOML)
    #[arg(long, help_heading = READING, value_name = "FILE")]
    pub bus: Option<PathBuf>,
    /// What a node is: 2=rexroth-sydfec, can0:5=my-device, at a J1939 address sa:0x80=danfoss-pve-ci (repeatable)
    #[arg(long, help_heading = READING, value_name = "[BUS:]ID=PROFILE")]
    pub node: Vec<NodeArg>,
    /// Device file of a node, EDS, DCF, XDD or XDC: 5=pump.eds, can0:5=pump.dcf (repeatable)
    #[arg(long, help_heading = READING, value_name = "[BUS:]ID=FILE")]
    pub eds: Vec<FileArg>,
    /// Signals of messages that no profile knows: a DBC, or the JSON of pretty_j1939 (repeatable, the first counts)
    #[arg(long, help_heading = READING, value_name = "FILE")]
    pub dbc: Vec<PathBuf>,
    /// Folder with profiles and device files of your own (repeatable)
    #[arg(long, help_heading = READING, value_name = "DIR")]
    pub profiles: Vec<PathBuf>,
    /// What the traffic is taken for
    #[arg(long, help_heading = READING, value_name = "PROTOCOL", default_value = "auto")]
    pub protocol: Protocol,
    /// Seconds without a further frame after which an SDO transfer counts as unanswered
    #[arg(long, help_heading = READING, value_name = "SECONDS", default_value = "1", value_parser = positive_seconds)]
    pub sdo_timeout: f64,
}

/// How one node only is seen by a command whose `--node` does not choose.
#[derive(Debug, Clone, Copy)]
pub(super) enum Otherwise {
    /// It has `--filter`.
    Filter,
    /// It has `--only-node`.
    OnlyNode,
    /// Another command shows it.
    Decode,
}

impl InputArgs {
    /// # Errors
    /// A node without a profile.
    pub(super) fn check_no_choice(&self, otherwise: Otherwise) -> Result<(), String> {
        let Some(node) = self.node.iter().find(|node| node.profile.is_none()) else { return Ok(()) };
        let shown = node.shown();
        let filter = node.filter();
        let only = match otherwise {
            Otherwise::Filter => format!("--filter '{filter}'"),
            Otherwise::OnlyNode => format!("--only-node {shown}"),
            Otherwise::Decode => format!("decode --filter '{filter}'"),
        };
        Err(format!(
            "--node {shown}: --node {shown}=PROFILE assigns a device; to see one node only use {only}"
        ))
    }

    /// # Errors
    /// Two profiles for one node.
    pub(super) fn check_devices(&self) -> Result<(), String> {
        let given = || self.node.iter().filter_map(|node| Some((node, node.profile.as_deref()?)));
        for (place, (node, profile)) in given().enumerate() {
            let is_other = |(other, device): &(&NodeArg, &str)| {
                (&other.bus, other.id) == (&node.bus, node.id) && *device != profile
            };
            if let Some((_, other)) = given().take(place).find(is_other) {
                let shown = node.shown();
                return Err(format!(
                    "--node {shown}={profile}: --node {shown}={other} says that it is another device"
                ));
            }
        }
        Ok(())
    }
}

/// Help of `--filter`: what it does with events, and which options say what it chooses from.
macro_rules! filter_help {
    ($does:literal, $options:literal) => {
        concat!(
            $does,
            " only events that EXPR matches\n\n\
The grammar is that of Wireshark's display filters: == != < <= > >=, in {}, contains, matches, && || ! (), \
or in words eq ne lt le gt ge and or not. A field alone asks whether the event has it. Fields are the keys of \
-f jsonl, nested ones with a dot, and many of Wireshark's names. A comparison with a field the event does not \
have is false. The filter chooses among what is there anyway; see ",
            $options,
            ".\n\n  \
  --filter 'kind == emcy && node == 4'\n  \
  --filter 'canopen.sdo.abort_code == 0x06090011 || outcome == timeout'\n  \
  --filter 'object in {1800:01..1BFF:02} && direction == download'"
        )
    };
}
pub(super) use filter_help;

/// Help of `--filter` where events are printed.
const FILTER_HELP: &str = filter_help!("Print", "--all, --pdo and --frames");

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

impl NodeArg {
    /// `can0:5`, as it is given.
    fn shown(&self) -> String {
        self.bus.as_ref().map_or_else(|| self.id.to_string(), |bus| format!("{bus}:{}", self.id))
    }

    /// What matches its events.
    fn filter(&self) -> String {
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

/// A number of seconds above 0.
fn positive_seconds(text: &str) -> Result<f64, String> {
    match text.parse::<f64>() {
        Ok(seconds) if seconds > 0.0 && seconds.is_finite() => Ok(seconds),
        _ => Err("expected a number of seconds above 0".into()),
    }
}
