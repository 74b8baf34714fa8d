//! The clock of this computer in the format of frame timestamps.

use std::time::{Instant, SystemTime, UNIX_EPOCH};

use cobscope_decoder::frame::Timestamp;

/// Nanoseconds since 1970.
pub fn now() -> Timestamp {
    let since = SystemTime::now().duration_since(UNIX_EPOCH).unwrap_or_default();
    Timestamp(i64::try_from(since.as_nanos()).unwrap_or(i64::MAX))
}

/// Difference in ns between wall clock and monotonic clock from which the wall clock was set; smaller ones are corrections of its
/// speed.
const SET: i64 = 1_000_000_000;

/// Detects that the clock of this computer is set forward: frame timestamps jump with it. Backward steps are visible in
/// the timestamps themselves.
pub struct ClockWatch {
    wall: Timestamp,
    at: Instant,
}

impl ClockWatch {
    /// Starts at a time of the wall clock and of the monotonic clock.
    pub fn new(wall: Timestamp, at: Instant) -> Self {
        Self { wall, at }
    }

    /// Size in ns of a forward step since the last call.
    pub fn step_since(&mut self, wall: Timestamp, at: Instant) -> Option<i64> {
        let elapsed = i64::try_from(at.saturating_duration_since(self.at).as_nanos()).unwrap_or(i64::MAX);
        let step = wall.0.saturating_sub(self.wall.0).saturating_sub(elapsed);
        (self.wall, self.at) = (wall, at);
        (step >= SET).then_some(step)
    }
}

#[cfg(test)]
mod tests {
    use std::time::Duration;

    use super::*;

    #[test]
    fn a_clock_that_is_set_forward_is_noticed_once() {
        let (begin, second) = (Instant::now(), 1_000_000_000);
        let mut watch = ClockWatch::new(Timestamp(100 * second), begin);
        let after = |seconds| begin + Duration::from_secs(seconds);
        assert_eq!(watch.step_since(Timestamp(110 * second), after(10)), None);
        assert_eq!(watch.step_since(Timestamp(3_711 * second), after(11)), Some(3_600 * second));
        assert_eq!(watch.step_since(Timestamp(3_712 * second), after(12)), None);
        // Set back, and corrected slowly.
        assert_eq!(watch.step_since(Timestamp(100 * second), after(13)), None);
        assert_eq!(watch.step_since(Timestamp(101 * second + second / 2), after(14)), None);
    }
}
