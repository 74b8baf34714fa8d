//! A signal over a range of a capture, with its extremes.

use serde::Serialize;

use crate::reading::ListedSignal;

/// A signal over a range.
#[derive(Debug, Clone, Serialize)]
pub struct RangeSignal {
    /// Name of the bus.
    pub bus: String,
    /// Number of values.
    pub count: u64,
    /// Sample with the highest number.
    pub max: Option<RangeSample>,
    /// Sample with the lowest number.
    pub min: Option<RangeSample>,
    /// Name of the signal.
    pub name: String,
    /// Node.
    pub node: String,
    /// Object or message.
    pub object: String,
    /// Values at regular intervals of their number.
    pub samples: Vec<RangeSample>,
    /// Unit.
    pub unit: String,
    /// Every value of so many is kept.
    #[serde(skip)]
    stride: u64,
}

/// A value.
#[derive(Debug, Clone, Serialize)]
pub struct RangeSample {
    /// Frame that carried it.
    pub frame: u64,
    /// Seconds from the first frame.
    pub seconds: Option<f64>,
    /// The value with its unit.
    pub value: String,
    /// The value as a number.
    #[serde(skip)]
    pub number: Option<f64>,
}

impl RangeSignal {
    /// A signal without any value so far.
    pub fn new(signal: &ListedSignal) -> Self {
        let ListedSignal { bus, node, object, name, unit } = signal.clone();
        let (max, min, samples) = (None, None, Vec::new());
        Self { bus, count: 0, max, min, name, node, object, samples, unit, stride: 1 }
    }

    /// Adds a value; fewer than twice `most` samples are kept.
    pub fn add_sample(&mut self, sample: RangeSample, most: usize) {
        if let Some(number) = sample.number.filter(|number| number.is_finite()) {
            let least = self.min.as_ref().and_then(|sample| sample.number);
            if least.is_none_or(|least| number < least) {
                self.min = Some(sample.clone());
            }
            let highest = self.max.as_ref().and_then(|sample| sample.number);
            if highest.is_none_or(|highest| number > highest) {
                self.max = Some(sample.clone());
            }
        }
        if self.count.is_multiple_of(self.stride) {
            self.samples.push(sample);
        }
        self.count = self.count.saturating_add(1);
        if self.samples.len() >= most.saturating_mul(2) {
            let mut is_kept = false;
            self.samples.retain(|_| {
                is_kept = !is_kept;
                is_kept
            });
            self.stride = self.stride.saturating_mul(2);
        }
    }
}
