//! Options of `convert`.

use std::path::PathBuf;

use clap::Args;
use clap::builder::{PossibleValue, PossibleValuesParser};
use cobscope_decoder::capture::WRITABLE;
use cobscope_decoder::query::Filter;

use crate::run::arguments::{InputArgs, NodeArg, examples, from_help, parse_size};
use crate::run::print::McapCompression;
use crate::select::RangeBound;

/// Long help of `--filter`.
const FILTER_HELP: &str = "\
Convert only frames whose own message matches EXPR

Grammar and fields are those of decode --filter, limited to the fields of a single frame: bus, id, data, size, node, \
protocol, kind, and the fields of PDOs, EMCY, heartbeats, NMT and J1939 messages. A frame that is part of a transfer, \
such as an SDO segment, has the kind \"frame\".

  --filter 'id in {0x181 .. 0x1FF}'
  --filter 'kind == emcy || node == 5 && kind == pdo'";

/// Examples in the help.
const EXAMPLES: &str = examples![
    "cobscope convert customer.blf customer.log",
    "cobscope convert --from 120 --to 180 --bus-file part.bus.toml run.log part.pcapng",
    "cobscope convert --split-size 100M a.trc b.trc all.pcapng",
];

/// Convert captures to another format, complete or in part, to one file or several
///
/// convert IN… OUT: the captures, then the file to write, whose suffix selects the format. - for OUT is
/// stdout and requires -f. Several captures are merged by time. Reports data that the target format
/// cannot store.
#[derive(Debug, Args)]
#[command(
    mut_arg("captures", |arg| arg.value_name("IN… OUT").help("Captures to read, then the file to write")),
    override_usage = "cobscope convert [OPTIONS] <IN>… <OUT>",
    after_help = EXAMPLES
)]
pub struct ConvertArgs {
    #[command(flatten)]
    pub input: InputArgs,
    /// Write to OUT instead of the last argument
    #[arg(short, long, value_name = "OUT")]
    pub output: Option<PathBuf>,
    /// Write in FORMAT (default: from the suffix of OUT)
    #[arg(short, long, value_name = "FORMAT", value_parser = writable_formats())]
    pub format: Option<String>,
    /// Convert only frames whose own message matches EXPR, such as 'kind == emcy || id == 0x185'
    #[arg(long, value_name = "EXPR", long_help = FILTER_HELP)]
    pub filter: Option<Filter>,
    /// Convert only frames from WHEN on: 12.5 (seconds from the first frame), #1234 (frame), 22:13:25, a date,
    /// or both
    #[arg(long, value_name = "WHEN", long_help = from_help!("Convert only frames from WHEN on"))]
    pub from: Option<RangeBound>,
    /// Convert only frames up to WHEN, in the form of --from; a date includes the whole day
    #[arg(long, value_name = "WHEN")]
    pub to: Option<RangeBound>,
    /// Convert only frames from and to a node, with SYNC, TIME and NMT commands to all: 5, can0:5, sa:0x80
    /// (repeatable)
    #[arg(long, value_name = "[BUS:]ID")]
    pub only_node: Vec<NodeArg>,
    /// Write a bus file with the state before the first frame of --from: mappings, values of objects, NMT states
    ///
    /// decode --bus FILE then decodes the part with the mappings, values and states of the whole capture. The first state,
    /// mode, bits and set point of a device, trouble codes and silences are reported as new; rules on orders, rates and
    /// intervals start again. FILE contains the settings of --bus, --node, --eds and --dbc.
    #[arg(long, value_name = "FILE", conflicts_with_all = ["split_size", "split_at"])]
    pub bus_file: Option<PathBuf>,
    /// Add the meaning of each frame as a comment (pcapng, ASC, TRC, CSV)
    #[arg(long)]
    pub comments: bool,
    /// Start a new file at SIZE bytes: 100M, 2G (out.log becomes out-0001.log, out-0002.log, …)
    #[arg(long, value_name = "SIZE", value_parser = parse_size)]
    pub split_size: Option<u64>,
    /// Start a new file at each frame with an event that matches EXPR, such as 'kind == boot-up'
    #[arg(long, value_name = "EXPR")]
    pub split_at: Option<Filter>,
    /// Align the start of captures that have unrelated clocks
    #[arg(long)]
    pub align: bool,
    /// Compress MCAP chunks with METHOD
    #[arg(long, value_name = "METHOD", default_value = "zstd")]
    pub packing: McapCompression,
    /// Overwrite existing files
    #[arg(long)]
    pub force: bool,
}

/// Parser for writable formats.
fn writable_formats() -> PossibleValuesParser {
    PossibleValuesParser::new(
        WRITABLE.iter().map(|format| PossibleValue::new(format.name).help(format.title)),
    )
}
