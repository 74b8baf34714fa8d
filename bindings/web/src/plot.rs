//! Samples signals over the capture.

use cobscope_decoder::capture::CaptureError;
use cobscope_decoder::frame::Timestamp;
use cobscope_decoder::replay::{
    CaptureWalk, PlacedEvent, ReplayState, SampleBucket, SignalKey, SignalPoints, SignalSampler,
};
use serde_json::{Value, json};

use crate::files::ContentSource;
use crate::request::FieldOfIdentifier;

/// Maximum number of signals sampled together.
pub const MOST_SIGNALS: usize = 12;

/// Sampling continues for this time after the range, in ns, because timestamps may step back.
const SLACK: i64 = 1_000_000_000;

/// Signals while they are sampled.
pub struct PlotJob {
    walk: CaptureWalk<ContentSource>,
    sampler: SignalSampler,
    signals: Vec<SignalKey>,
    zero: Timestamp,
    to: i64,
}

/// The signal of a request, in the state at its frame.
pub fn find_signal(world: &ReplayState, name: &FieldOfIdentifier) -> Option<SignalKey> {
    let rows = world.identifiers().rows().iter();
    let mut rows = rows.filter(|row| row.bus.0 == name.bus && !row.is_remote);
    let row = rows.find(|row| row.id.to_string() == name.id)?;
    SignalKey::new(row.bus, row.id, row.layout.as_ref()?, name.field)
}

impl PlotJob {
    /// Samples from `from` to `to`, in ns; `walk` is before the range.
    pub fn new(
        walk: CaptureWalk<ContentSource>,
        mut signals: Vec<SignalKey>,
        zero: Timestamp,
        (from, to): (i64, i64),
    ) -> Self {
        signals.truncate(MOST_SIGNALS);
        let mut sampler = SignalSampler::new(&signals, from, Some(to));
        sampler.take_world(&walk.world);
        Self { walk, sampler, signals, zero, to }
    }

    /// Frames read so far.
    pub fn frames(&self) -> u64 {
        self.walk.world.frames()
    }

    /// Reads up to `frames` more frames; `false` at the end of the range.
    ///
    /// # Errors
    /// If the capture can no longer be read.
    pub fn step(&mut self, frames: u64) -> Result<bool, CaptureError> {
        let Self { walk, sampler, to, .. } = self;
        let limit = walk.world.frames().saturating_add(frames);
        while walk.world.frames() < limit {
            if !walk.skip_batch(limit, &mut |placed: PlacedEvent<'_>| sampler.take_event(&placed))? {
                return Ok(false);
            }
            if walk.world.last_time().is_some_and(|time| time.0 > to.saturating_add(SLACK)) {
                return Ok(false);
            }
        }
        Ok(true)
    }

    /// The samples so far.
    pub fn curves(&self) -> Value {
        let all = self.signals.iter().zip(self.sampler.sampled_points());
        Value::Array(all.map(|(signal, points)| curve_value(signal, &points, self.zero)).collect())
    }
}

/// Times, last, lowest and highest values; NaN is null.
fn curve_value(signal: &SignalKey, points: &SignalPoints, zero: Timestamp) -> Value {
    #[expect(clippy::cast_precision_loss, reason = "for display")]
    let time = |bucket: &SampleBucket| Timestamp(bucket.t).since(zero) as f64 / 1e9;
    let column = |value: fn(&SampleBucket) -> f64| {
        let values = points.buckets.iter().map(|bucket| Some(value(bucket)).filter(|it| it.is_finite()));
        values.collect::<Vec<_>>()
    };
    json!({
        "name": signal.name,
        "unit": signal.unit,
        "presumed": points.is_assumed,
        "exact": points.is_exact,
        "times": points.buckets.iter().map(time).collect::<Vec<_>>(),
        "last": column(|bucket| bucket.last),
        "min": column(|bucket| bucket.min),
        "max": column(|bucket| bucket.max),
    })
}
