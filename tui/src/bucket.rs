//! Values of a signal, summed up by time.

/// The values of a piece of time.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Bucket {
    /// When, in nanoseconds.
    pub t: i64,
    /// The lowest of its values.
    pub min: f64,
    /// The highest of its values.
    pub max: f64,
    /// The last of its values, which holds until the next bucket.
    pub last: f64,
}

impl Bucket {
    /// The lowest and the highest value, if any is a number.
    pub fn bounds(&self) -> Option<(f64, f64)> {
        // `min` and `max` give the other one where one is NaN.
        let (low, high) = (self.min.min(self.max).min(self.last), self.max.max(self.min).max(self.last));
        (!low.is_nan()).then_some((low, high))
    }
}
