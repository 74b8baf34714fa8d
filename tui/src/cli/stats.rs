//! `cobscope stats`.

use clap::Args;

use super::{InputArgs, ReportFormat};
use crate::select::Bound;

/// `cobscope stats`.
#[derive(Debug, Args)]
pub struct StatsArgs {
    #[command(flatten)]
    pub input: InputArgs,
    /// Bit rate for the load in %: 250k, 1M or 250000, of one bus or all (repeatable)
    #[arg(long, value_name = "[BUS:]RATE")]
    pub bitrate: Vec<BitRate>,
    /// Count only from WHEN on: 12.5 (seconds from the first frame), #1234 (frame), a date and time
    #[arg(long, value_name = "WHEN")]
    pub from: Option<Bound>,
    /// Count only up to WHEN, given as with --from; nodes and their states stay those of the whole capture
    #[arg(long, value_name = "WHEN")]
    pub to: Option<Bound>,
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
