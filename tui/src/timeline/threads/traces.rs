//! Samples signals over their time range.

use std::sync::atomic::Ordering;
use std::sync::mpsc::Sender;
use std::sync::{Arc, PoisonError};

use cobscope_decoder::capture::CaptureError;
use cobscope_decoder::frame::Timestamp;
use cobscope_decoder::replay::{PlacedEvent, SignalSampler};

use crate::timeline::news::TimelineNews;
use crate::timeline::shared::SharedResults;
use crate::timeline::traces::SignalTraces;
use crate::timeline::walk::{self, TimelineWalk};

/// Number of frames between two publications; it doubles from the first to the second value.
const STRIDES: (u64, u64) = (16_384, 262_144);

/// Interval of publications of a growing capture, in ns.
const SOON: i64 = 100_000_000;

/// Sampling continues for this time after the range, in ns, because timestamps may step back.
const SLACK: i64 = 1_000_000_000;

/// Samples the signals over their range.
pub(in crate::timeline) fn run_sampling(
    shared: &SharedResults,
    traces: &Arc<SignalTraces>,
    news: &Sender<TimelineNews>,
) {
    let mut sampler = SignalSampler::new(&traces.signals, traces.from, traces.to);
    // The index reports read errors.
    if let Ok(mut walk) = begin_walk(shared, traces, &mut sampler) {
        sample_walk(shared, traces, &mut sampler, &mut walk, news);
    }
    traces.set_points(sampler.sampled_points());
    traces.complete_sampling();
    shared.tracing.fetch_sub(1, Ordering::Release);
    // The application may have ended.
    let _ = news.send(TimelineNews::Traced);
}

/// Starts at the last mark before the range, with the values that apply there.
fn begin_walk(
    shared: &SharedResults,
    traces: &SignalTraces,
    sampler: &mut SignalSampler,
) -> Result<TimelineWalk, CaptureError> {
    let index = shared.index.read().unwrap_or_else(PoisonError::into_inner);
    match index.before_time(Timestamp(traces.from)) {
        Some(mark) => {
            let walk = walk::resume_walk(shared, mark)?;
            drop(index);
            sampler.take_world(&walk.world);
            Ok(walk)
        }
        None => walk::start_walk(shared),
    }
}

fn sample_walk(
    shared: &SharedResults,
    traces: &SignalTraces,
    sampler: &mut SignalSampler,
    walk: &mut TimelineWalk,
    news: &Sender<TimelineNews>,
) {
    let end = traces.to.map_or(i64::MAX, |to| to.saturating_add(SLACK));
    let (mut stride, most) = STRIDES;
    let (mut next, mut reported) = (walk.world.frames() + stride, i64::MIN);
    while !shared.is_over() && !traces.is_stopped() {
        match walk.skip_batch(u64::MAX, &mut |reported: PlacedEvent<'_>| sampler.take_event(&reported)) {
            Ok(true) => {}
            Ok(false) => return,
            Err(error) => return shared.fail_reading(&error),
        }
        let time = walk.world.last_time().map_or(traces.from, |time| time.0);
        traces.set_reached(time);
        if time > end {
            return;
        }
        let frames = walk.world.frames();
        let is_at_head = time >= reported.saturating_add(SOON) && shared.is_at_head(frames);
        if frames >= next || is_at_head {
            stride = if is_at_head { stride } else { most.min(stride * 2) };
            (next, reported) = (frames + stride, time);
            traces.set_points(sampler.sampled_points());
            if news.send(TimelineNews::Traced).is_err() {
                return;
            }
        }
    }
}
