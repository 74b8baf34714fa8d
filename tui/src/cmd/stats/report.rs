//! Statistics of one capture, for all formats.

use cobscope_decoder::answers::statistics::CaptureStatistics;
use cobscope_decoder::decoder::Decoder;
use cobscope_decoder::session::Bus;
use cobscope_decoder::statistics::Statistics;

use super::arguments::StatsArgs;

/// Statistics of one capture, and the decoder after the last frame.
pub(super) struct StatisticsReport<'a> {
    pub(super) capture: String,
    pub(super) format: &'static str,
    pub(super) statistics: Statistics,
    pub(super) decoder: Decoder,
    pub(super) arguments: &'a StatsArgs,
}

impl StatisticsReport<'_> {
    /// All figures.
    pub(super) fn figures(&self) -> CaptureStatistics {
        let name = (self.capture.as_str(), self.format);
        CaptureStatistics::new(name, &self.statistics, self.decoder.buses(), |bus| self.bit_rate(bus))
    }

    /// Bit rate of a bus from the command line, else from the bus file.
    pub(super) fn bit_rate(&self, bus: &Bus) -> Option<u32> {
        let rates = &self.arguments.bitrate;
        let own = rates.iter().find(|rate| rate.bus.as_deref() == Some(bus.name()));
        let given = own.or_else(|| rates.iter().find(|rate| rate.bus.is_none()));
        given.map(|rate| rate.rate).or_else(|| bus.bit_rate())
    }
}
