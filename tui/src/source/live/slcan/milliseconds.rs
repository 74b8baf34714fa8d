//! Millisecond timestamps of 16 bits.

use cobscope_decoder::frame::Timestamp;

use super::super::stamps::StampClock;

const MILLISECOND: i64 = 1_000_000;

/// Time after which timestamps restart at 0 (CAN232 manual, command Z)…
const WRAP: i64 = 60_000 * MILLISECOND;

/// …and after which they restart with firmware that uses all sixteen bits.
const LONG_WRAP: i64 = 65_536 * MILLISECOND;

/// Maps timestamps to times.
#[derive(Debug, Clone, Default)]
pub struct MillisecondClock {
    clock: StampClock,
    is_long: bool,
}

impl MillisecondClock {
    /// Time of a frame with timestamp `milliseconds` that arrived at `arrival`.
    pub fn time_of(&mut self, milliseconds: u16, arrival: Timestamp) -> Timestamp {
        let stamp = i64::from(milliseconds) * MILLISECOND;
        self.is_long |= stamp >= WRAP;
        let wrap = if self.is_long { LONG_WRAP } else { WRAP };
        self.clock.time_of(stamp, wrap, arrival)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn firmware_whose_stamps_run_to_65_535_is_recognised() {
        let mut clock = MillisecondClock::default();
        let frames = [(59_000, 0), (65_000, 6_000), (464, 7_000), (465, 7_003)];
        let times = frames.map(|(stamp, arrival)| {
            clock.time_of(stamp, Timestamp(1_700_000_000_000 * MILLISECOND + arrival * MILLISECOND)).0
                / MILLISECOND
                - 1_700_000_000_000
        });
        assert_eq!(times, [0, 6_000, 7_000, 7_001]);
    }
}
