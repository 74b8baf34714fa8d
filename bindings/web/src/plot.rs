//! Samples signals over the capture.

use cobscope_decoder::answers::signals::SignalCurve;
use cobscope_decoder::capture::CaptureError;
use cobscope_decoder::frame::Timestamp;
use cobscope_decoder::replay::{CaptureWalk, PlacedEvent, ReplayState, SignalKey, SignalSampler};

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
    pub fn curves(&self) -> Vec<SignalCurve> {
        let all = self.signals.iter().zip(self.sampler.sampled_points());
        all.map(|(signal, points)| SignalCurve::new(signal, &points, self.zero)).collect()
    }
}
