//! Figures of intervals and durations.

use serde::Serialize;

use crate::answers::numbers::{to_millis, to_seconds};
use crate::statistics::{DurationDistribution, IntervalStatistics};

/// Lengths of intervals.
#[derive(Debug, Clone, Serialize)]
pub struct IntervalFigures {
    /// Maximum.
    pub max: f64,
    /// Mean.
    pub mean: f64,
    /// Minimum.
    pub min: f64,
    /// Start of the longest interval, in s.
    pub worst_from: f64,
}

/// Distribution of durations.
#[derive(Debug, Clone, Serialize)]
pub struct DurationFigures {
    /// Number of durations.
    pub count: u64,
    /// Maximum.
    pub max: f64,
    /// Median.
    pub p50: Option<f64>,
    /// 90 %.
    pub p90: Option<f64>,
    /// 99 %.
    pub p99: Option<f64>,
}

impl IntervalFigures {
    pub(super) fn new(intervals: &IntervalStatistics) -> Option<Self> {
        let (longest, began) = intervals.longest()?;
        Some(Self {
            max: to_millis(longest),
            mean: to_millis(intervals.mean()?),
            min: to_millis(intervals.shortest()?),
            worst_from: to_seconds(began),
        })
    }
}

impl DurationFigures {
    pub(super) fn new(durations: &DurationDistribution) -> Option<Self> {
        let part = |part| durations.percentile(part).map(to_millis);
        (durations.duration_count() > 0).then(|| Self {
            count: durations.duration_count(),
            max: to_millis(durations.longest()),
            p50: part(50),
            p90: part(90),
            p99: part(99),
        })
    }
}
