//! The two captures of a comparison, their alignment and the tolerances.

use super::alignment::RoleAlignment;
use super::record::CaptureRecord;
use crate::bus_file::DiffTolerances;

/// Both captures and everything that applies to all sections.
#[derive(Debug)]
pub(super) struct ComparisonScope<'a> {
    pub(super) good: &'a CaptureRecord,
    pub(super) bad: &'a CaptureRecord,
    pub(super) alignment: RoleAlignment<'a>,
    pub(super) tolerances: &'a DiffTolerances,
}

impl ComparisonScope<'_> {
    /// Whether both captures have timestamps of a recorder.
    pub(super) fn is_timed(&self) -> bool {
        self.good.is_timed && self.bad.is_timed
    }

    /// Difference of times in ns that is never reported: the tolerance, or the granularity of the timestamps.
    pub(super) fn time_floor(&self) -> i64 {
        #[expect(clippy::cast_possible_truncation, reason = "saturates")]
        let floor = (self.tolerances.time_ms * 1e6) as i64;
        floor.max(self.granularity().saturating_mul(2))
    }

    /// The coarser granularity of the timestamps in ns, at most 10 ms: messages with an exact period look like a coarse clock.
    pub(super) fn granularity(&self) -> i64 {
        const COARSEST: i64 = 10_000_000;
        self.good.granularity.max(self.bad.granularity).min(COARSEST)
    }

    /// Durations of both captures in seconds.
    pub(super) fn seconds(&self) -> (f64, f64) {
        (self.good.seconds(), self.bad.seconds())
    }

    /// Whether counts differ as rates.
    pub(super) fn counts_differ(&self, good: u64, bad: u64) -> bool {
        let (one, other) = self.seconds();
        super::tolerance::counts_differ((good, one), (bad, other), self.tolerances.count)
    }
}
