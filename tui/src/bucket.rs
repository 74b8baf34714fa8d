//! Samples of a signal in an interval, for plots.

pub use cobscope_decoder::replay::SampleBucket;
