//! Options of `stats`.

use clap::Args;
use cobscope_decoder::session::Bus;

use crate::run::arguments::{InputArgs, ReportFormat, SelectArgs, examples, filter_grammar, from_help};

/// Long help of `--filter`.
const FILTER_HELP: &str = concat!(
    "Count only events, and frames whose own message, match EXPR\n\n",
    filter_grammar!(),
    "A field without a comparison tests whether the event has it. Fields are the keys of decode -f jsonl, nested ones \
with a dot, and many of Wireshark's names. A comparison with a missing field is false.\n\n  \
  --filter 'kind == emcy && node == 4'\n  \
  --filter 'canopen.sdo.abort_code == 0x06090011 || outcome == timeout'\n  \
  --filter 'object in {1800:01..1BFF:02} && direction == download'"
);

/// Examples in the help.
const EXAMPLES: &str = examples![
    "cobscope stats customer.log",
    "cobscope stats --from 10 --to 60 --bitrate 250k customer.log",
    "cobscope stats --bitrate can0:250k --bitrate can1:500k -f json customer.log",
];

/// Print statistics: nodes, message rates, timing and capture quality
///
/// --filter, --from, --to and --only-node select frames and events. All counts and times are those of the selection: also
/// boot-ups, losses and heartbeat periods. Only the names, NMT states and active errors of nodes are those at the end of
/// the capture.
#[derive(Debug, Args)]
#[command(after_help = EXAMPLES)]
#[command(mut_arg("filter", |arg| arg.help("Count only events, and frames whose own message, match EXPR").long_help(FILTER_HELP)))]
#[command(mut_arg("from", |arg| arg.help("Count only from WHEN on: 12.5 (seconds), #1234 (frame), 22:13:25, a date, or both").long_help(from_help!("Count only from WHEN on"))))]
#[command(mut_arg("to", |arg| arg.help("Count only up to WHEN, in the form of --from")))]
#[command(mut_arg("only_node", |arg| arg.help("Count only events and frames of a node: 5, can0:5, sa:0x80 (repeatable)")))]
pub struct StatsArgs {
    #[command(flatten)]
    pub input: InputArgs,
    /// Set the bit rate for the load in %, for one bus or all: 250k, 1M, 250000, can0:500k (repeatable)
    #[arg(long, value_name = "[BUS:]RATE")]
    pub bitrate: Vec<BitRateOption>,
    #[command(flatten)]
    pub select: SelectArgs,
    /// Output format
    #[arg(short, long, value_name = "FORMAT", default_value = "text")]
    pub format: ReportFormat,
}

impl StatsArgs {
    /// Bit rate of a bus from the command line, else from the bus file.
    pub fn bit_rate(&self, bus: &Bus) -> Option<u32> {
        let own = self.bitrate.iter().find(|rate| rate.bus.as_deref() == Some(bus.name()));
        let given = own.or_else(|| self.bitrate.iter().find(|rate| rate.bus.is_none()));
        given.map(|rate| rate.rate).or_else(|| bus.bit_rate())
    }
}

/// Bit rate of one bus or of all.
#[derive(Debug, Clone)]
pub struct BitRateOption {
    /// Name of the bus; `None` for all.
    pub bus: Option<String>,
    /// Bit rate in bit/s.
    pub rate: u32,
}

impl std::str::FromStr for BitRateOption {
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
            _ => Err("expected a bit rate such as 250k, 1M or can0:500k"),
        }
    }
}
