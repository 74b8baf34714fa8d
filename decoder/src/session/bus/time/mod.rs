//! Monotonic time of a bus, and the intervals of its messages.

mod cadence;
mod clock;
mod history;
mod jumps;
mod moment;
mod pulse;
mod regularity;
mod skipped_times;

pub(in crate::session) use cadence::Cadence;
pub(crate) use clock::AmbiguousGap;
pub(in crate::session) use clock::BusClock;
pub(crate) use history::{PeriodChange, StreamBurst, StreamSilence};
pub(crate) use jumps::ValueJumps;
pub(in crate::session) use moment::FrameMoment;
pub(in crate::session) use pulse::IdentifierIntervals;
pub(crate) use pulse::PayloadChanges;
pub(crate) use regularity::StreamRegularity;
pub(crate) use skipped_times::SkippedTimes;
