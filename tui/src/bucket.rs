//! Samples of a signal, summarised per time interval.

/// Values of a time interval.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Bucket {
    /// Start, in ns.
    pub t: i64,
    /// Lowest value.
    pub min: f64,
    /// Highest value.
    pub max: f64,
    /// Last value; it applies until the next bucket.
    pub last: f64,
}

impl Bucket {
    /// Lowest and highest value; None if all are NaN.
    pub fn bounds(&self) -> Option<(f64, f64)> {
        // `min` and `max` ignore a NaN.
        let (low, high) = (self.min.min(self.max).min(self.last), self.max.max(self.min).max(self.last));
        (!low.is_nan()).then_some((low, high))
    }
}
