//! Walks to any frame: from the nearest checkpoint, with further checkpoints near the positions visited.

use std::collections::VecDeque;

use cobscope_decoder::capture::CaptureError;
use cobscope_decoder::frame::Timestamp;
use cobscope_decoder::replay::{Checkpoint, PlacedEvent, Walk};

use crate::capture::Captures;
use crate::files::Source;
use crate::survey::CaptureSurvey;

/// Frames between two checkpoints near a visited position.
const NEAR: u64 = 8_192;

/// Maximum number of such checkpoints, and of their bytes.
const MOST_NEAR: (usize, usize) = (48, 32 << 20);

/// Checkpoints near the positions visited last.
#[derive(Default)]
pub struct Seek {
    near: VecDeque<Checkpoint>,
    bytes: usize,
}

impl Seek {
    /// A walk before the events of frame `frame`.
    ///
    /// # Errors
    /// If the capture can no longer be read.
    pub fn before(
        &mut self,
        captures: &Captures,
        survey: &CaptureSurvey,
        frame: u64,
    ) -> Result<Walk<Source>, CaptureError> {
        let before = frame.saturating_sub(1);
        let near = self.near.iter().filter(|mark| mark.frames <= before);
        let mark = near.chain(survey.mark(before)).max_by_key(|mark| mark.frames);
        let mut walk = match mark {
            Some(mark) => captures.resume(mark)?,
            None => captures.start()?,
        };
        let mut next = walk.world.frames().saturating_add(NEAR);
        while walk.world.frames() < before {
            if !walk.leap(before, &mut |_| ())? {
                break;
            }
            self.remember(&walk, &mut next);
        }
        Ok(walk)
    }

    /// The last frame up to a time.
    ///
    /// # Errors
    /// If the capture can no longer be read.
    pub fn frame_at(
        &mut self,
        captures: &Captures,
        survey: &CaptureSurvey,
        time: Timestamp,
    ) -> Result<u64, CaptureError> {
        let is_before = |mark: &&Checkpoint| mark.time.is_some_and(|at| at < time);
        let near = self.near.iter().filter(is_before).map(|mark| mark.frames).max().unwrap_or(0);
        let far = survey.index.before_time(time).map_or(0, |mark| mark.frames);
        let mut walk = self.before(captures, survey, near.max(far).saturating_add(1))?;
        let mut next = walk.world.frames().saturating_add(NEAR);
        while walk.world.frames() < survey.end.frames() {
            if walk.peek()?.and_then(|frame| frame.time).is_some_and(|next| next > time) {
                break;
            }
            if !walk.step(&mut |_| ())? {
                break;
            }
            self.remember(&walk, &mut next);
        }
        Ok(walk.world.frames())
    }

    /// Steps to the next frame or notice and keeps checkpoints; `false` at the end.
    ///
    /// # Errors
    /// If the capture can no longer be read.
    pub fn step(
        &mut self,
        walk: &mut Walk<Source>,
        see: &mut impl FnMut(PlacedEvent<'_>),
    ) -> Result<bool, CaptureError> {
        let mut next = walk.world.frames() / NEAR * NEAR + NEAR;
        let more = walk.step(see)?;
        self.remember(walk, &mut next);
        Ok(more)
    }

    fn remember(&mut self, walk: &Walk<Source>, next: &mut u64) {
        let frames = walk.world.frames();
        if frames < *next || self.near.iter().any(|mark| mark.frames.abs_diff(frames) < NEAR / 2) {
            return;
        }
        let Some(mark) = walk.mark() else { return };
        *next = frames.saturating_add(NEAR);
        self.bytes = self.bytes.saturating_add(mark.world.footprint());
        self.near.push_back(mark);
        while self.near.len() > MOST_NEAR.0 || (self.bytes > MOST_NEAR.1 && self.near.len() > 1) {
            let dropped = self.near.pop_front();
            let size = dropped.map_or(0, |mark| mark.world.footprint());
            self.bytes = self.bytes.saturating_sub(size);
        }
    }
}
