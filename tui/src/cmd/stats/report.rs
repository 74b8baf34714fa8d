//! Statistics of one capture, for all formats.

use cobscope_decoder::decoder::Decoder;
use cobscope_decoder::session::Bus;
use cobscope_decoder::statistics::Statistics;

use crate::cli::StatsArgs;

/// Statistics of one capture, and the decoder after the last frame.
pub(in crate::cmd) struct Report<'a> {
    pub(in crate::cmd) capture: String,
    pub(in crate::cmd) format: &'static str,
    pub(in crate::cmd) statistics: Statistics,
    pub(in crate::cmd) decoder: Decoder,
    pub(in crate::cmd) arguments: &'a StatsArgs,
}

impl Report<'_> {
    /// Bit rate of a bus from the command line, else from the bus file.
    pub(super) fn bit_rate(&self, bus: &Bus) -> Option<u32> {
        let rates = &self.arguments.bitrate;
        let own = rates.iter().find(|rate| rate.bus.as_deref() == Some(bus.name()));
        let given = own.or_else(|| rates.iter().find(|rate| rate.bus.is_none()));
        given.map(|rate| rate.rate).or_else(|| bus.bit_rate())
    }
}
