//! `cobscope convert`.

use std::path::PathBuf;

use clap::Args;
use clap::builder::{PossibleValue, PossibleValuesParser};
use cobscope_decoder::capture::WRITABLE;
use cobscope_decoder::query::Filter;

use super::size::bytes;
use super::{InputArgs, NodeArg, Packing};
use crate::select::Bound;

/// Help of `--filter`.
const FILTER_HELP: &str = "\
Only frames whose own message EXPR matches

The grammar and the fields are those of decode --filter, as far as one frame tells them: bus, id, data, size, node, \
protocol, kind, and the fields of PDOs, EMCY, heartbeats, NMT, J1939 messages. A frame that is a part of something larger, \
such as a segment of an SDO transfer, is of kind \"frame\".

  --filter 'id in {0x181 .. 0x1FF}'
  --filter 'kind == emcy || node == 5 && kind == pdo'";

/// `cobscope convert`.
#[derive(Debug, Args)]
pub struct ConvertArgs {
    #[command(flatten)]
    pub input: InputArgs,
    /// The file to write, instead of the last argument
    #[arg(short, long, value_name = "OUT")]
    pub output: Option<PathBuf>,
    /// Format of OUT (default: what the end of its name says)
    #[arg(short, long, value_name = "FORMAT", value_parser = formats())]
    pub format: Option<String>,
    /// Only frames whose own message EXPR matches, such as 'kind == emcy || id == 0x185'
    #[arg(long, value_name = "EXPR", long_help = FILTER_HELP)]
    pub filter: Option<Filter>,
    /// Only frames from WHEN on: 12.5 (seconds from the first frame), #1234 (frame), a date and time
    #[arg(long, value_name = "WHEN")]
    pub from: Option<Bound>,
    /// Only frames up to WHEN, given as with --from
    #[arg(long, value_name = "WHEN")]
    pub to: Option<Bound>,
    /// Only frames from a node or for it, with SYNC, TIME and commands to all: 5, can0:5, sa:0x80 (repeatable)
    #[arg(long, value_name = "[BUS:]ID")]
    pub only_node: Vec<NodeArg>,
    /// Write beside each frame what it means, where the format has comments (pcapng, ASC, TRC, CSV)
    #[arg(long)]
    pub comments: bool,
    /// Begin a new file when one has SIZE bytes: 100M, 2G. out.log becomes out-0001.log, out-0002.log, …
    #[arg(long, value_name = "SIZE", value_parser = bytes)]
    pub split_size: Option<u64>,
    /// Begin a new file with each frame at which an event happens that EXPR matches, such as 'kind == boot-up'
    #[arg(long, value_name = "EXPR")]
    pub split_at: Option<Filter>,
    /// Let captures begin together whose clocks have nothing to do with each other
    #[arg(long)]
    pub align: bool,
    /// How chunks of MCAP are packed
    #[arg(long, value_name = "METHOD", default_value = "zstd")]
    pub packing: Packing,
    /// Write over files that are there
    #[arg(long)]
    pub force: bool,
}

/// The formats that can be written.
fn formats() -> PossibleValuesParser {
    PossibleValuesParser::new(
        WRITABLE.iter().map(|format| PossibleValue::new(format.name).help(format.title)),
    )
}
